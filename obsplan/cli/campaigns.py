"""Commands that fly missions by the thousand, and those that read what came of it."""

from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated

import typer

from obsplan.cli.arguments import named, planner_names, scenario_names
from obsplan.cli.progress import progress
from obsplan.cli.stopping import keeping
from obsplan.cli.terminal import SOME_FAILED, complain, say, say_next, say_written, show
from obsplan.quantities import RUNS, SEED

if TYPE_CHECKING:
    from obsplan.campaign.plan import Cell


CampaignFolder = Annotated[
    Path, typer.Argument(metavar="DIR", help="Folder of a campaign, finished or not.")
]


def campaign(
    scenarios: Annotated[
        list[str],
        typer.Argument(
            metavar="SCENARIO...",
            help="Scenario files, or names of shipped ones.",
            autocompletion=scenario_names,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option("--out", help="Folder of the results; one that has a campaign is resumed."),
    ],
    planners: Annotated[
        str | None,
        typer.Option(
            "--planners",
            metavar="A,B,...",
            help="Default: each scenario's own.",
            autocompletion=planner_names,
        ),
    ] = None,
    runs: Annotated[
        int,
        typer.Option(
            "--runs",
            min=RUNS.least,
            max=RUNS.greatest,
            help="Seeds per combination; the same for each planner and setting.",
        ),
    ] = 1,
    seed: Annotated[
        int | None,
        typer.Option(
            "--seed",
            min=SEED.least,
            max=SEED.greatest,
            help="The first of them; default: the scenario's.",
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option("--vary", metavar="KEY=A,B,...", help="Values of one key; may be repeated."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option("--workers", min=1, max=1024, help="Local processes; default: one per core."),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option("--scheduler", metavar="ADDRESS", help="Of a Dask cluster to fly on."),
    ] = None,
) -> None:
    """Fly scenarios x planners x seeds x settings into one table.

    What was flown is never lost, and never flown again.
    """
    from obsplan.campaign import plan_cells

    cells = plan_cells(scenarios, planners=named(planners), vary=vary or (), runs=runs, seed=seed)
    failed = fly(cells, out, workers=workers, scheduler=scheduler)
    say_written(out, "campaign.parquet, campaign.csv")
    say_next("campaign-report", str(out))
    if failed:
        raise typer.Exit(SOME_FAILED)


def fly(
    cells: tuple["Cell", ...],
    out: Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
) -> int:
    """Fly a campaign and say what became of it; returns how many missions failed."""
    from obsplan.campaign import fly_campaign

    title = "1 combination" if len(cells) == 1 else f"{len(cells)} combinations"
    began = monotonic()
    with keeping(out), progress(title) as advance:

        def tell(done: int, total: int, failed: int) -> None:
            rate = done / (monotonic() - began)
            mishaps = f", {failed} failed" if failed else ""
            advance(done, total, f"{title}, {rate:.1f} missions/s{mishaps}")

        report = fly_campaign(cells, out, workers=workers, scheduler=scheduler, progress=tell)
    say(
        f"{report.missions} missions: {report.flown} flown now, "
        f"{report.missions - report.flown} were there, {report.failed} failed."
    )
    if report.set_aside:
        say(
            f"{report.set_aside} earlier ones are kept but not in the table: other code or another "
            "version flew them, or the scenario was another."
        )
    if report.damage:
        say(
            f"The results kept in {out} were {report.damage.sentence}. What is planned here of "
            "these was flown again."
        )
    for cell, number, reason in report.failures:
        complain(f"{cell.label}, seed {number}: {reason}")
    if report.failed > len(report.failures):
        complain(f"and {report.failed - len(report.failures)} more; see campaign.csv")
    return report.failed


def campaign_report(
    folder: CampaignFolder,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder of the report; default: DIR/report.")
    ] = None,
) -> None:
    """Read a campaign: medians with intervals, planners compared, errors against varied keys."""
    from obsplan.report import campaign_table, write_campaign_report

    report = write_campaign_report(folder, out)
    show(campaign_table(report.medians))
    for sentence in report.sentences:
        say(sentence)
    say_written(report.folder, ", ".join(report.files))
    say_next("report", str(folder), "--open")


def campaign_check(
    folder: CampaignFolder,
    mend: Annotated[
        bool, typer.Option("--mend", help="Leave out what is damaged, so that the rest is read.")
    ] = False,
) -> None:
    """Read all results that a campaign keeps, and say whether they are as they were written."""
    from obsplan.campaign.lock import held
    from obsplan.campaign.table import existing_store

    with existing_store(folder) as store:
        if mend:
            with held(folder):
                damage = store.mend()
            if damage:
                say(f"The results kept in {folder} were {damage.sentence}. That is left out now.")
        store.check()
        missions, cells = store.size()
    say(f"Missions: {missions}, of combinations: {cells}; each is as it was written.")


def compare_suite(
    name: str,
    planners: list[str],
    *,
    runs: int,
    seed: int | None,
    settings: list[str],
    out: Path,
    bounded: bool,
) -> None:
    """Fly a campaign of planners over one of the suites, and say who wins where.

    No two scenarios share a seed: what is luck in one is not luck in all.

    The folder is resumed if it is there.
    """
    from obsplan.campaign import load_campaign, plan_cells
    from obsplan.campaign.suite import missions_of, read_suite, weighted, yardsticks
    from obsplan.report import scenario_table, suite_sentences, suite_table, write_suite
    from obsplan.report.words import NO_BOUND
    from obsplan.scenario import SUITES, suite

    scenarios = suite(name)
    cells = plan_cells(
        scenarios, planners=planners, vary=settings, runs=runs, seed=seed, independent=True
    )
    failed = fly(cells, out)
    table = weighted(cells, missions_of(cells, load_campaign(out), out))
    settings = [*settings, *([] if seed is None else [f"seed={seed}"])]
    with keeping(out), progress("bounds and decision times") as advance:
        bounds, times = yardsticks(scenarios, planners, settings, advance, bounded=bounded)
    result = read_suite(table, bounds, times)
    files = write_suite(result, out)
    show(suite_table(result))
    show(scenario_table(result))
    world = f"In `{name}` {SUITES[name]}."
    for sentence in (*suite_sentences(result), *([] if bounded else [NO_BOUND]), world):
        say(sentence)
    say_written(out, f"{', '.join(files)}, campaign.csv")
    if failed:
        raise typer.Exit(SOME_FAILED)
