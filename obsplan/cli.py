"""``obsplan ...``: the command line. What a command needs is imported when it runs."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from obsplan.campaign.plan import Cell

app = typer.Typer(
    help="Plan the path of an aid vehicle so that AUVs measuring only acoustic range to it know where they are.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
)

INTERRUPTED = 130  # exit code of a program that Ctrl-C ended

ScenarioName = Annotated[
    str, typer.Argument(metavar="SCENARIO", help="A scenario file, or the name of a shipped one.")
]
PlannerName = Annotated[
    str | None, typer.Option("--planner", help="Replace the scenario's planner.")
]
Seed = Annotated[
    int | None,
    typer.Option("--seed", min=0, help="Of all random numbers; default: the scenario's."),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one key; may be repeated."),
]
Out = Annotated[
    Path | None, typer.Option("--out", help="Folder to make; default: ./NAME, then ./NAME-2, ...")
]


@app.command()
def run(
    scenario: ScenarioName,
    planner: PlannerName = None,
    seed: Seed = None,
    settings: Settings = None,
    out: Out = None,
) -> None:
    """Simulate a survey: plan the aid vehicle's path, estimate, report, write files a vehicle can load."""
    from obsplan.report import (
        export_sentences,
        free_folder,
        limit_notes,
        make_export,
        planner_notes,
        run_table,
        verdicts,
        write_run,
    )
    from obsplan.scenario import load
    from obsplan.simulation import simulate

    loaded = load(scenario, planner=planner, settings=settings or ())
    folder = free_folder(out, loaded.table.name)
    with progress_bar(f"{loaded.table.name}, {loaded.table.planner.kind}") as advance:
        flown = simulate(loaded, seed=seed, progress=advance)
    with progress_bar(f"{loaded.table.name}, path as loaded") as advance:
        export = make_export(flown, progress=advance)
    write_run(flown, folder, export)
    show(run_table(flown))
    notes = (*verdicts(flown), *limit_notes(flown), *planner_notes(flown))
    for sentence in (*notes, *export_sentences(export)):
        say(sentence)
    paths = [f"path.{name}" for name in dict.fromkeys(loaded.table.export.formats)]
    files = ["map.png", "errors.png", *paths, "tracks.csv and more"]
    say(f"Written to {folder}{'' if folder.is_absolute() else '/'}: {', '.join(files)}.")


@app.command()
def compare(
    scenario: ScenarioName,
    planners: Annotated[
        str | None,
        typer.Option("--planners", metavar="A,B,...", help="Default: all that are quick."),
    ] = None,
    runs: Annotated[
        int, typer.Option("--runs", min=1, help="Seeds per planner; the same for each of them.")
    ] = 1,
    seed: Seed = None,
    settings: Settings = None,
    out: Out = None,
) -> None:
    """Compare planners on one scenario under the same noise, or on the whole `suite` of them."""
    from obsplan.planners import PLANNERS, SLOW
    from obsplan.report import compare_table, free_folder, write_comparison
    from obsplan.report.words import title
    from obsplan.scenario import load
    from obsplan.simulation import simulate

    names = named(planners) or [name for name in PLANNERS if name not in SLOW]
    if scenario == "suite":
        compare_suite(names, runs, seed, settings or [], out or Path("suite"))
        return
    loaded = {
        name: load(scenario, planner=name, settings=settings or ()) for name in dict.fromkeys(names)
    }
    table = next(iter(loaded.values())).table
    folder = free_folder(out, f"{table.name}-compare")
    first = table.seed if seed is None else seed
    rows: list[dict[str, Any]] = []
    with progress_bar(f"{table.name}, {len(loaded)} planners") as advance:
        for name, one in loaded.items():
            for number in range(first, first + runs):
                rows.append(
                    {"planner": name, "seed": number, **simulate(one, seed=number).summary()["all"]}
                )
                advance(len(rows), runs * len(loaded))
    write_comparison(rows, folder, title=f"{title(table.name)}, {runs} run{'s' * (runs > 1)} each")
    show(compare_table(rows))
    say(f"Written to {folder}{'' if folder.is_absolute() else '/'}: compare.csv, compare.png.")


def compare_suite(
    planners: list[str], runs: int, seed: int | None, settings: list[str], out: Path
) -> None:
    """Fly a campaign of planners over the suite, and say who wins where; the folder is resumed if it is there."""
    import numpy as np

    from obsplan.campaign import load_campaign, plan_cells
    from obsplan.report import scenario_table, suite_table, write_suite
    from obsplan.report.suite import FEWEST, decision_time, least_error, missions_of, read_suite
    from obsplan.scenario import load, suite

    cells = plan_cells(suite(), planners=planners, vary=settings, runs=runs, seed=seed)
    failed = fly(cells, out)
    table = missions_of(cells, load_campaign(out), out)
    settings = [*settings, *([] if seed is None else [f"seed={seed}"])]
    bounds = {
        name.removeprefix("suite/"): least_error(load(name, planner="circle", settings=settings))
        for name in suite()
    }
    brief = [*settings, "duration=60.0"]
    times = {
        p: float(
            np.median([decision_time(load(name, planner=p, settings=brief)) for name in suite()])
        )
        for p in planners
    }
    result = read_suite(table, bounds, times)
    files = write_suite(result, out)
    show(suite_table(result))
    show(scenario_table(result))
    if runs < FEWEST:
        say(
            f"With fewer than {FEWEST} seeds (--runs) no difference can be told from chance: all planners count as equal."
        )
    say(f"Written to {out}{'' if out.is_absolute() else '/'}: {', '.join(files)}, campaign.csv.")
    if failed:
        raise typer.Exit(3)


@app.command()
def campaign(
    scenarios: Annotated[
        list[str],
        typer.Argument(metavar="SCENARIO...", help="Scenario files, or names of shipped ones."),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", help="Folder of the results; one that has a campaign is resumed."),
    ],
    planners: Annotated[
        str | None,
        typer.Option("--planners", metavar="A,B,...", help="Default: each scenario's own."),
    ] = None,
    runs: Annotated[
        int,
        typer.Option(
            "--runs", min=1, help="Seeds per combination; the same for each planner and setting."
        ),
    ] = 1,
    seed: Annotated[
        int | None,
        typer.Option("--seed", min=0, help="The first of them; default: the scenario's."),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="KEY=A,B,...", help="Values of one key; may be repeated."),
    ] = None,
    workers: Annotated[
        int | None, typer.Option("--workers", min=1, help="Local processes; default: one per core.")
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster to fly on."),
    ] = None,
) -> None:
    """Fly scenarios x planners x seeds x settings into one table; what was flown is never lost, and never flown again."""
    from obsplan.campaign import plan_cells

    cells = plan_cells(scenarios, planners=named(planners), vary=vary or (), runs=runs, seed=seed)
    failed = fly(cells, out, workers=workers, scheduler=scheduler)
    say(
        f"Written to {out}{'' if out.is_absolute() else '/'}: campaign.parquet, campaign.csv. Next: obsplan campaign-report {out}"
    )
    if failed:
        raise typer.Exit(3)


def fly(
    cells: tuple["Cell", ...],
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> int:
    """Fly a campaign and say what became of it; returns how many missions failed."""
    from obsplan.campaign import fly_campaign

    try:
        with campaign_bar(f"{len(cells)} combinations") as progress:
            report = fly_campaign(
                cells, out, workers=workers, scheduler=scheduler, progress=progress
            )
    except KeyboardInterrupt:
        typer.echo(
            f"obsplan: interrupted; what was flown is kept in {out}, and the same command goes on from there",
            err=True,
        )
        sys.exit(INTERRUPTED)  # not by way of `main`, which says that nothing was written
    say(
        f"{report.missions} missions: {report.flown} flown now, {report.missions - report.flown} were there, {report.failed} failed."
    )
    for cell, number, reason in report.failures:
        typer.echo(f"obsplan: {cell.label}, seed {number}: {reason}", err=True)
    if report.failed > len(report.failures):
        typer.echo(
            f"obsplan: and {report.failed - len(report.failures)} more; see campaign.csv", err=True
        )
    return report.failed


@app.command()
def campaign_report(
    folder: Annotated[
        Path, typer.Argument(metavar="DIR", help="Folder of a campaign, finished or not.")
    ],
) -> None:
    """Read a campaign: medians with intervals, planners compared under the same noise, errors against what was varied."""
    from obsplan.report import campaign_table, write_campaign_report

    report = write_campaign_report(folder)
    show(campaign_table(report.medians))
    for sentence in report.sentences:
        say(sentence)
    target = folder / "report"
    say(f"Written to {target}{'' if target.is_absolute() else '/'}: {', '.join(report.files)}.")


@app.command()
def thesis(
    items: Annotated[
        list[str],
        typer.Argument(
            metavar="ITEM...", help="fig5.1 ... table5.2, figB.1 ..., study-horizon ..., or all."
        ),
    ],
    runs: Annotated[
        int,
        typer.Option(
            "--runs",
            min=2,
            help="Seeds of tables; studies take a fifth, figures at most fifty starts.",
        ),
    ] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The first of them.")] = 1,
    out: Out = None,
) -> None:
    """Reproduce the thesis: its figures, tables and claims, and answers to its open questions."""
    from obsplan.report import free_folder
    from obsplan.thesis import ITEMS, write_thesis

    folder = free_folder(out, "thesis")
    with progress_bar("thesis") as advance:
        findings = write_thesis(items, folder, runs=runs, seed=seed, progress=advance)
    for name, finding in findings.items():
        say(f"{name}, {ITEMS[name].verdict(finding)}: {finding.sentence}")
    say(
        f"Written to {folder}{'' if folder.is_absolute() else '/'}: thesis.md, and a picture and the data of each item."
    )


@app.command()
def new(
    mission_file: Annotated[
        Path,
        typer.Argument(metavar="MISSION_FILE", help="A survey as your planning program saves it."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="Scenario file to write; default: the mission file's name with .toml."
        ),
    ] = None,
) -> None:
    """Write a commented scenario around your own survey, ready to run, and say what was understood of it."""
    from obsplan.scenario.account import write_new
    from obsplan.types import ObsplanError

    path = out or Path(f"{mission_file.stem}.toml")
    if path.suffix != ".toml":
        raise ObsplanError(f"--out {path}: a scenario file ends in .toml; write {path}.toml")
    if path.exists():
        raise ObsplanError(f"{path} exists and is not overwritten; give another name with --out")
    for line in write_new(mission_file, path):
        say(line)


@app.command()
def scenarios() -> None:
    """List the scenarios that come with obsplan."""
    from obsplan.scenario import load, shipped

    for name in shipped():
        loaded = load(name)
        auvs, minutes = len(loaded.table.auv), loaded.time[-1] / 60
        say(
            f"{name:20} {auvs} AUV{'s' if auvs > 1 else ' '}  {minutes:6.1f} min  {loaded.table.description}"
        )


@app.command()
def schema(
    json: Annotated[bool, typer.Option("--json", help="As JSON Schema, for editors.")] = False,
) -> None:
    """List every key a scenario file may have, with its type, default, unit and meaning."""
    from obsplan.scenario.schema import json_schema, sections

    if json:
        import json as writer

        print(writer.dumps(json_schema(), indent=2))  # noqa: T201 - for another program to read
        return
    for path, rows in sections():
        say(f"\n[{path}]" if path else "Top of the file")
        for key, kind, default, description in rows:
            say(
                f"  {key:18} {kind}{f', default {default}' if default not in ('', 'required') else ', required' if default else ''}"
            )
            say(f"  {'':18} {description}")


@contextmanager
def progress_bar(title: str) -> Iterator[Any]:
    """A bar on standard error while it is a terminal, nothing in a pipe; gives the function to call with (done, all) and a new title."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    bar = Progress(console=console, transient=True, disable=not console.is_terminal)
    with bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total, now=title: bar.update(
            task, completed=done, total=total, description=now
        )


@contextmanager
def campaign_bar(title: str) -> Iterator[Any]:
    """A `progress_bar` that also tells the rate and the failures; gives the function to call with (done, all, failed)."""
    from time import monotonic

    began = monotonic()
    with progress_bar(title) as advance:
        yield lambda done, total, failed: advance(
            done,
            total,
            f"{title}, {done / (monotonic() - began):.1f} missions/s"
            + (f", [red]{failed} failed[/red]" if failed else ""),
        )


def show(table: Any) -> None:
    """Print a table, never narrower than it needs in a pipe."""
    from rich.console import Console

    console = Console()
    Console(width=None if console.is_terminal else 160, soft_wrap=False).print(table)


def named(planners: str | None) -> list[str]:
    """Planners of a list on the command line."""
    return [name.strip() for name in (planners or "").split(",") if name.strip()]


def say(text: str) -> None:
    """Print a line."""
    typer.echo(text)


def main() -> None:
    """Run the command line: exit code 0 done, 2 what the user gave is wrong, 130 interrupted."""
    try:
        code = app(standalone_mode=False)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except Exception as error:
        message = fault(error)
        if message is None:
            raise  # ours: the traceback is what we need to mend it
        typer.echo(f"obsplan: {message}", err=True)
        code = 2
    if code == INTERRUPTED:  # which the command line's own parser may return, too
        typer.echo("obsplan: interrupted; nothing was written", err=True)
    sys.exit(code if isinstance(code, int) else 0)


def fault(error: Exception) -> str | None:
    """What the user gave that is wrong, or None if the fault is ours."""
    from obsplan.types import ObsplanError

    if isinstance(error, ObsplanError):
        return str(error)
    message = getattr(error, "format_message", None)  # of the command line's own parser
    return f"{message().rstrip('.')}; see obsplan --help" if message else None
