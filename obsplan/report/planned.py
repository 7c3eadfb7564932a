"""The paths that planners had in mind, as a table."""

from collections.abc import Iterator

from obsplan.planned import Planned
from obsplan.report.files import BLOCK, rounded, table_csv
from obsplan.run import Run

PLANNED_COLUMNS = ("decided_s", "cna", "time_s", "x_m", "y_m")


def planned_csv(run: Run) -> Iterator[str]:
    """One row a place of a path, path after path of each aid vehicle, in pieces.

    Where all was planned beforehand and flown so there is one row, with no place.
    """
    yield table_csv([PLANNED_COLUMNS])
    for name, planned in zip(run.aid_names, run.planned, strict=True):
        if planned is not None:
            yield from _of_one(name, planned)


def _of_one(name: str, planned: Planned) -> Iterator[str]:
    if planned.is_flown:
        yield table_csv([(*rounded(planned.decided), name, "", "", "")])
    decided = planned.decided[planned.path]
    for begin in range(0, planned.time.size, BLOCK):
        some = slice(begin, begin + BLOCK)
        names = [name] * planned.time[some].size
        figures = map(rounded, (planned.time[some], *planned.place[some].T))
        yield table_csv(zip(rounded(decided[some]), names, *figures, strict=True))
