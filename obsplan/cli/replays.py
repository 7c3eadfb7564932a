"""Commands on recordings: replay one, and list those that are shipped."""

from enum import StrEnum
from time import perf_counter
from typing import TYPE_CHECKING, Annotated, Any

import typer

from obsplan.cli.arguments import NoBound, Out, Settings
from obsplan.cli.progress import progress
from obsplan.cli.stopping import WRITTEN, keeping
from obsplan.cli.terminal import say, say_written, show

if TYPE_CHECKING:
    from obsplan.replay import Recording
    from obsplan.run import Run


NOT_COMMANDED = (
    "a recording has only the motion that vehicles measured: filters predict by it, and not as "
    'estimator.motion = "commanded" asks'
)


class Calibrate(StrEnum):
    """For which ranges a scale and a bias are found."""

    NONE = "none"
    COMMON = "common"
    EACH = "each"


def replay(
    recording: Annotated[
        str,
        typer.Argument(
            metavar="RECORDING", help="Folder or file of a log, or name of a shipped recording."
        ),
    ],
    calibrate: Annotated[
        Calibrate,
        typer.Option(
            "--calibrate", help="Find scale and bias of ranges: common to all, or of each beacon."
        ),
    ] = Calibrate.NONE,
    plan: Annotated[
        bool,
        typer.Option(
            "--plan",
            help="Say what the aid vehicle's path was worth, and what the default planner's is.",
        ),
    ] = False,
    settings: Settings = None,
    out: Out = None,
    no_bound: NoBound = False,
) -> None:
    """Replay a recorded mission: filter its ranges, say why some are rejected, smooth tracks."""
    from dataclasses import replace

    from obsplan.cli.commands import certified
    from obsplan.replay import read
    from obsplan.replay.shipped import find
    from obsplan.report import filter_notes, free_folder, run_table, verdicts, write_free, write_run
    from obsplan.report.words import capital

    read_in = changed(read(find(recording)), settings or [])
    name = read_in.scenario.table.name
    free_folder(out, name)  # a folder that cannot be made is refused before anything is done
    with progress(f"{name}, filter and smoother"):
        run, notes = replayed(read_in, calibrate)
    run = replace(run, bounded=not no_bound)
    if not run.unbounded:
        with progress(f"{name}, certified bound") as advance:
            run = certified(run, advance)
    weighed, told = after_all(run) if plan else (None, [])
    read_notes = [f"{capital(note).rstrip('.')}." for note in (*read_in.notes, *notes)]
    said = [*verdicts(run), *filter_notes(run), *told]
    everything = [*said, *read_notes]
    folder = write_free(
        out, name, lambda folder: write_run(run, folder, hindsight=weighed, notes=everything)
    )
    with keeping(folder, WRITTEN):
        for note in read_notes:
            say(note)
        show(run_table(run))
        for sentence in said:
            say(sentence)
        say_written(
            folder,
            "report.html, map.png, errors.png, ranges.csv, tracks.csv, smoothed.csv and more",
        )


def changed(recording: "Recording", settings: list[str]) -> "Recording":
    """The recording with other keys in its scenario.

    Raises
    ------
    ObsplanError
        A key or value that a scenario cannot have.
    """
    from dataclasses import replace

    from obsplan.scenario import from_dict
    from obsplan.scenario.settings import with_setting

    scenario = recording.scenario
    data = scenario.table.model_dump(exclude_unset=True, exclude_none=True)
    for setting in settings:
        data = with_setting(data, setting)
    other = from_dict(data, source=scenario.source, folder=scenario.folder)
    return replace(recording, scenario=other)


def replayed(recording: "Recording", calibrate: Calibrate) -> "tuple[Run, list[str]]":
    """A recording as filters and smoother see it, and what is to be known of that.

    Ranges are corrected first by the scale and bias that are found, if asked for.
    """
    from obsplan.replay.estimate import estimate
    from obsplan.replay.result import run_of
    from obsplan.smoothing import calibrate as calibrated
    from obsplan.smoothing import smooth

    tape, scenario, notes = recording.tape, recording.scenario, list[str]()
    if scenario.table.estimator.motion == "commanded":
        notes.append(NOT_COMMANDED)
    if calibrate is not Calibrate.NONE:
        found = calibrated(tape, scenario, per_beacon=calibrate is Calibrate.EACH)
        tape = found.tape
        notes += [f"Calibrated: {words}." for words in found.words]
    begun = perf_counter()
    estimates = estimate(tape, scenario)
    seconds = perf_counter() - begun
    smoothed = smooth(tape, scenario, start=estimates.mean)
    notes += [f"Smoother: {words}." for words in smoothed.words]
    run = run_of(
        tape,
        scenario,
        estimates,
        smoothed=smoothed,
        discarded=recording.discarded,
        began=recording.start,
        seconds=seconds,
    )
    return run, notes


def after_all(run: "Run") -> tuple[dict[str, Any] | None, list[str]]:
    """What the aid vehicle's path was worth, for the summary and in words."""
    from obsplan.report.hindsight import hindsight
    from obsplan.types import ObsplanError

    try:
        with progress(f"{run.scenario.table.name}, hindsight") as advance:
            found = hindsight(run, progress=advance)
    except ObsplanError as error:
        return None, [f"No hindsight: {error}."]
    return found.summary(), [found.sentence]


def recordings() -> None:
    """List the recorded missions that come with obsplan."""
    from obsplan.replay.shipped import shipped

    for name, description in shipped().items():
        say(f"{name:12}  {description}", indent=4)
