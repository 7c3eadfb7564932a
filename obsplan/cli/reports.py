"""The command that makes pages of folders already there, and opens them."""

import webbrowser
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from obsplan.cli.stopping import WRITTEN, keeping
from obsplan.cli.terminal import say, say_written

if TYPE_CHECKING:
    from obsplan.run import Run


def report(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="DIR...", help="Folders of runs, replays or campaigns."),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="One page, FILE.html, with the runs given side by side."),
    ] = None,
    mission: Annotated[
        str | None,
        typer.Option(
            "--mission",
            metavar="CELL/SEED",
            help="Fly this mission of a campaign again, into a folder of its own.",
        ),
    ] = None,
    charts: Annotated[
        list[Path] | None,
        typer.Option(
            "--chart",
            metavar="FILE",
            help="A chart under the map: GeoTIFF, MBTiles, lines of GeoJSON. Again for more.",
        ),
    ] = None,
    opened: Annotated[bool, typer.Option("--open", help="Open what is made in a browser.")] = False,
) -> None:
    """Make report.html, to open in a browser, of runs and campaigns already there."""
    from obsplan.types import ObsplanError

    if mission is not None and (out is not None or charts):
        raise ObsplanError(
            "--mission writes all files of a run into a folder of its own: leave --out and --chart "
            "out, and give them with that folder afterwards"
        )
    if mission is not None:
        made = [flown_again(folders, mission)]
    elif out is not None:
        made = [side_by_side(folders, out, charts or ())]
    else:
        made = [written(folder, charts or ()) for folder in folders]
    for path in made if opened else ():
        open_in_browser(path)


def open_in_browser(path: Path) -> None:
    """Show a page, or say that it cannot be shown from here."""
    if not webbrowser.open(path.resolve().as_uri()):
        say(f"No browser can be started here: open {path} in one.")


def written(folder: Path, charts: Sequence[Path] = ()) -> Path:
    """Write the page of a run or a campaign into its folder.

    Raises
    ------
    ObsplanError
        A campaign is given a chart, or see `page_of`.
    """
    from obsplan.campaign.faults import FILE
    from obsplan.files import write_atomically
    from obsplan.report.files import REPORT
    from obsplan.report.page.missions import campaign_page
    from obsplan.types import ObsplanError

    made = folder / REPORT
    if (folder / FILE).is_file():
        if charts:
            raise ObsplanError(f"{folder} is a campaign, whose page has no map: leave --chart out")
        write_atomically(made, campaign_page(folder))
    else:
        write_atomically(made, page_of(folder, charts))
    say_written(folder, REPORT)
    return made


def page_of(folder: Path, charts: Sequence[Path] = ()) -> str:
    """The page of a run from its folder.

    Raises
    ------
    ObsplanError
        It is not the folder of a run, or a chart cannot be drawn.
    """
    from obsplan.report.page.chart import chart_of, surroundings
    from obsplan.report.page.folder import read_run
    from obsplan.report.page.run import run_page
    from obsplan.types import ObsplanError

    if (folder / "compare.csv").is_file():
        raise ObsplanError(
            f"{folder} has figures of a comparison, and no tracks: run `obsplan compare` again, "
            "whose folder then has a report.html"
        )
    run = read_run(folder)
    return run_page(run, notes_of(run), chart_of(charts, [surroundings(run)]))


def notes_of(run: "Run") -> list[str]:
    """What is said of a run that was read: all but of bounds and reports, which are not there."""
    from obsplan.report.consistency import filter_notes
    from obsplan.report.sea import sea_notes
    from obsplan.report.verdict import limit_notes, planner_notes, verdicts
    from obsplan.report.words import NO_BOUND

    said = [*verdicts(run), *filter_notes(run), *sea_notes(run), *limit_notes(run)]
    return [note for note in (*said, *planner_notes(run)) if note != NO_BOUND]


def side_by_side(folders: Sequence[Path], out: Path, charts: Sequence[Path] = ()) -> Path:
    """Write one page of several runs.

    Raises
    ------
    ObsplanError
        The file's name does not end in .html, it exists, or a chart cannot be drawn.
    """
    from obsplan.files import write_atomically
    from obsplan.report.page.chart import chart_of, surroundings
    from obsplan.report.page.comparison import comparison_page, side_of
    from obsplan.report.page.folder import read_run
    from obsplan.types import ObsplanError

    if out.suffix != ".html":
        raise ObsplanError(f"--out {out}: a page ends in .html; write {out}.html")
    if out.exists():
        raise ObsplanError(f"{out} exists and is not overwritten; give another name with --out")
    sides, around = [], []
    for folder in folders:  # one after the other: what is kept of a run is small
        run = read_run(folder)
        sides.append(side_of(run, str(folder), runs=len(folders)))
        around.append(surroundings(run))
    drawn = chart_of(charts, around)
    write_atomically(out, comparison_page(sides, "Runs side by side", chart=drawn))
    say(f"Written to {out}.")
    return out


def flown_again(folders: Sequence[Path], mission: str) -> Path:
    """Fly one mission of a campaign again, and write its folder.

    Raises
    ------
    ObsplanError
        More than one folder is given, or the mission is not in it.
    """
    from dataclasses import replace

    from obsplan.cli.progress import progress
    from obsplan.report import run_notes, write_free, write_run
    from obsplan.report.files import REPORT
    from obsplan.report.page.missions import scenario_of
    from obsplan.simulation import simulate
    from obsplan.types import ObsplanError

    if len(folders) > 1:
        raise ObsplanError("--mission is of one campaign: give one folder")
    scenario, seed = scenario_of(folders[0], mission)
    name = f"{scenario.table.name}-{mission.replace('/', '-')}"
    with progress(name) as advance:
        flown = replace(simulate(scenario, seed=seed, progress=advance), bounded=False)
    said = run_notes(flown)
    folder = write_free(None, name, lambda folder: write_run(flown, folder, notes=said))
    with keeping(folder, WRITTEN):
        for sentence in said:
            say(sentence)
        say_written(folder, f"{REPORT} and all files of a run")
    return folder / REPORT
