"""Commands on one survey: fly it, compare planners on it, make it; and lists of what there is."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from obsplan.cli.arguments import (
    NoBound,
    Out,
    PlannerName,
    Planners,
    Runs,
    ScenarioName,
    Seed,
    Settings,
    named,
)
from obsplan.cli.campaigns import compare_suite
from obsplan.cli.progress import Advance, progress
from obsplan.cli.stopping import WRITTEN, is_stop, keeping
from obsplan.cli.terminal import put, say, say_next, say_written, show
from obsplan.quantities import RUNS, SEED

if TYPE_CHECKING:
    from obsplan.report.export import Export
    from obsplan.report.page.comparison import Side
    from obsplan.run import Run
    from obsplan.scenario import Scenario


def run(
    scenario: ScenarioName,
    planner: PlannerName = None,
    seed: Seed = None,
    settings: Settings = None,
    out: Out = None,
    no_bound: NoBound = False,
) -> None:
    """Simulate a survey: plan the aid vehicle's path, estimate, report, write files to load."""
    from obsplan.report import (
        exports_sentences,
        free_folder,
        path_names,
        run_notes,
        run_table,
        write_free,
        write_run,
    )
    from obsplan.scenario import load
    from obsplan.simulation import simulate
    from obsplan.simulation.afterwards import with_smoothed

    loaded = load(scenario, planner=planner, settings=settings or ())
    name = loaded.table.name
    free_folder(out, name)  # a folder that cannot be made is refused before anything is flown
    with progress(f"{name}, {loaded.table.planner.kind}") as advance:
        flown = simulate(loaded, seed=seed, progress=advance)
    flown = replace(flown, bounded=not no_bound)
    if not flown.unbounded:
        with progress(f"{name}, certified bound") as advance:
            flown = certified(flown, advance)
    with progress(f"{name}, smoother"):
        flown, smoother_notes = with_smoothed(flown)
    with progress(f"{name}, path as loaded") as advance:
        exports, fault = exported(flown, advance)
    said = (*run_notes(flown, smoother_notes), *exports_sentences(exports))
    folder = write_free(out, name, lambda folder: write_run(flown, folder, exports, notes=said))
    with keeping(folder, WRITTEN):
        show(run_table(flown))
        for sentence in said:
            say(sentence)
        paths = [name for export in exports for name in path_names(export).values()]
        say_written(
            folder,
            ", ".join(["report.html", "map.png", "errors.png", *paths, "tracks.csv and more"]),
        )
    if fault is not None:
        raise without_paths(fault, folder)


def compare(
    scenario: ScenarioName,
    planners: Planners = None,
    runs: Runs = 1,
    seed: Seed = None,
    settings: Settings = None,
    out: Out = None,
    no_bound: NoBound = False,
) -> None:
    """Compare planners on one scenario under the same noise, or on a whole `suite` of them.

    `suite` is a world without losses; `field` is the sea as it is.
    """
    from obsplan.planners import PLANNERS, SLOW
    from obsplan.report import (
        compare_table,
        comparison_sentences,
        free_folder,
        write_comparison,
        write_free,
    )
    from obsplan.report.words import NO_BOUND, title
    from obsplan.scenario import SUITES, load

    names = named(planners) or [name for name in PLANNERS if name not in SLOW]
    if scenario in SUITES:
        compare_suite(
            scenario,
            names,
            runs=runs,
            seed=seed,
            settings=settings or [],
            out=out or Path(scenario),
            bounded=not no_bound,
        )
        return
    loaded = {
        name: load(scenario, planner=name, settings=settings or ()) for name in dict.fromkeys(names)
    }
    table = next(iter(loaded.values())).table
    name = f"{table.name}-compare"
    free_folder(out, name)  # a folder that cannot be made is refused before anything is flown
    first = table.seed if seed is None else seed
    with progress(f"{table.name}, {len(loaded)} planners") as advance:
        rows, sides = compared(loaded, range(first, first + runs), advance, bounded=not no_bound)
    heading = f"{title(table.name)}, {runs} run{'s' * (runs > 1)} each"
    said = [*comparison_sentences(rows), *([NO_BOUND] if no_bound else [])]
    if runs > 1:
        said.append(f"report.html plays the missions of seed {first}.")

    def write(folder: Path) -> None:
        write_comparison(rows, folder, heading, sides=sides, notes=said)

    folder = write_free(out, name, write)
    with keeping(folder, WRITTEN):
        show(compare_table(rows))
        for sentence in said:
            say(sentence)
        say_written(folder, "report.html, compare.csv, compare.png")


def compared(
    scenarios: dict[str, "Scenario"], seeds: range, advance: Advance, *, bounded: bool
) -> "tuple[list[dict[str, Any]], list[Side]]":
    """Figures of merit of each planner's scenario under each seed, and what plays the first one.

    Missions of one seed follow each other, so that they share its certified bound.
    """
    from obsplan.report.page.comparison import side_of
    from obsplan.simulation import simulate

    rows: dict[str, list[dict[str, Any]]] = {name: [] for name in scenarios}
    total, sides = len(seeds) * len(scenarios), []
    missions = product(seeds, scenarios.items())
    for before, (number, (name, scenario)) in enumerate(missions):
        half = partial(tell_half, advance, before, total)
        flown = replace(simulate(scenario, seed=number, progress=half), bounded=bounded)
        if not flown.unbounded:
            flown = certified(flown, partial(tell_half, advance, before + 0.5, total))
        rows[name].append({"planner": name, "seed": number, **flown.summary()["all"]})
        if number == seeds[0]:
            sides.append(side_of(flown, name, runs=len(scenarios)))
        advance(before + 1, total)
    return [row for of_planner in rows.values() for row in of_planner], sides


def certified(flown: "Run", advance: Advance) -> "Run":
    """The run with its certified bound; without one, and why, where numbers make it impossible."""
    from obsplan.types import UNCOMPUTABLE, uncomputable

    try:
        flown.certify(advance)
    except UNCOMPUTABLE as error:
        say(f"The bound over all paths is left out: {uncomputable(error)}.")
        return replace(flown, bounded=False)
    return flown


def exported(flown: "Run", advance: Advance) -> "tuple[Sequence[Export], Exception | None]":
    """The missions to load; without them, and why, where making them fails."""
    from obsplan.report import make_exports

    try:
        return make_exports(flown, progress=advance), None
    except Exception as error:  # whatever it is, what was flown is written first
        if is_stop(error):
            raise
        return (), error


def without_paths(fault: Exception, folder: Path) -> Exception:
    """What to raise of a run without missions to load; a fault of ours as it is, to be mended."""
    from obsplan.types import UNCOMPUTABLE, ObsplanError, uncomputable

    if not isinstance(fault, (ObsplanError, *UNCOMPUTABLE)):
        return fault
    why = str(fault) if isinstance(fault, ObsplanError) else uncomputable(fault)
    return ObsplanError(
        f"no path to load can be made of the mission: {why}; all else was written to {folder}"
    )


def tell_half(advance: Advance, before: float, total: int, done: float, steps: int) -> None:
    """Say how far a mission is, whose flight is one half of the work and whose bound the other."""
    advance(before + 0.5 * done / steps, total)


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
            max=RUNS.greatest,
            help="Seeds of tables; studies take a fifth, figures at most fifty starts.",
        ),
    ] = 100,
    seed: Annotated[
        int, typer.Option("--seed", min=SEED.least, max=SEED.greatest, help="The first of them.")
    ] = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help=(
                "Folder to make; default: ./thesis, then ./thesis-2, ... One that the same "
                "command began is resumed."
            ),
        ),
    ] = None,
) -> None:
    """Reproduce the thesis: its figures, tables and claims, and answers to its open questions."""
    from obsplan.thesis import ITEMS, free_or_begun, write_thesis

    folder = free_or_begun(out, items, runs=runs, seed=seed)
    with keeping(folder), progress("thesis") as advance:
        findings = write_thesis(items, folder, runs=runs, seed=seed, progress=advance)
    for name, finding in findings.items():
        say(f"{name}, {ITEMS[name].verdict(finding)}: {finding.sentence}")
    say_written(folder, "thesis.md, and a picture and the data of each item")


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
    """Write a commented scenario around your survey, ready to run, and say what was understood."""
    from obsplan.scenario.account import write_new
    from obsplan.scenario.template import as_argument
    from obsplan.types import ObsplanError

    path = out or Path(f"{mission_file.stem}.toml")
    if path.suffix != ".toml":
        raise ObsplanError(f"--out {path}: a scenario file ends in .toml; write {path}.toml")
    if path.exists():
        raise ObsplanError(f"{path} exists and is not overwritten; give another name with --out")
    for line in write_new(mission_file, path):
        say(line, indent=4)
    say_next("run", as_argument(path))


def scenarios() -> None:
    """List obsplan's own scenarios, and those of the suites on which planners are compared."""
    from obsplan.scenario import all_shipped, load

    names = all_shipped()
    width = max(len(name) for name in names)
    for name in names:
        loaded = load(name)
        auvs, minutes = len(loaded.table.auv), loaded.time[-1] / 60
        size = f"{auvs} AUV{'s' if auvs > 1 else ' '}  {minutes:6.1f} min"
        say(f"{name:{width}}  {size}  {loaded.table.description}", indent=4)


def schema(
    json: Annotated[bool, typer.Option("--json", help="As JSON Schema, for editors.")] = False,
) -> None:
    """List every key a scenario file may have: type, default, unit, meaning and range."""
    from obsplan.scenario.schema import json_schema, sections

    if json:
        import json as writer

        put(writer.dumps(json_schema(), indent=2) + "\n")
        return
    for path, rows in sections():
        say("")
        say(f"[{path}]" if path else "Top of the file")
        for key, kind, default, description, allowed in rows:
            note = ", required" if default == "required" else f", default {default}"
            say(f"  {key:18} {kind}{note if default else ''}", indent=21)
            say(f"  {'':18} {description}", indent=21)
            if allowed:
                say(f"  {'':18} {allowed}", indent=21)
    say("")
    say(
        "A kind of survey, vehicle, ranging, estimator or planner may be a class of your own, "
        '"mypackage.module:Class", whose fields are then the keys; docs/your-own.md says what it '
        "needs."
    )
