"""All that is said of a run under its table, in order."""

from collections.abc import Sequence

from obsplan.report.consistency import filter_notes
from obsplan.report.hearing import hearing_notes
from obsplan.report.sea import sea_notes
from obsplan.report.verdict import limit_notes, planner_notes, verdicts
from obsplan.run import Run


def run_notes(run: Run, smoother: Sequence[str] = ()) -> tuple[str, ...]:
    """Sentences on a run; ``smoother`` are those on how its tracks were smoothed."""
    return (
        *verdicts(run),
        *filter_notes(run),
        *smoother,
        *sea_notes(run),
        *hearing_notes(run),
        *limit_notes(run),
        *planner_notes(run),
    )
