"""Arguments that several commands take, and what a shell completes them to."""

from pathlib import Path
from typing import Annotated

import typer

from obsplan.quantities import RUNS, SEED


def scenario_names(incomplete: str) -> list[str]:
    """Shipped scenarios that begin so, for the shell to complete."""
    from obsplan.scenario import all_shipped

    return [name for name in all_shipped() if name.startswith(incomplete)]


def planner_names(incomplete: str) -> list[str]:
    """Planners that begin so, or whose name after the last comma does, for shell completion."""
    from obsplan.planners import PLANNERS

    before, comma, last = incomplete.rpartition(",")
    return [f"{before}{comma}{name}" for name in PLANNERS if name.startswith(last)]


ScenarioName = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="Name of a shipped scenario, or a scenario file (./NAME for a file of that name).",
        autocompletion=scenario_names,
    ),
]
PlannerName = Annotated[
    str | None,
    typer.Option("--planner", help="Replace the scenario's planner.", autocompletion=planner_names),
]
Planners = Annotated[
    str | None,
    typer.Option(
        "--planners",
        metavar="A,B,...",
        help="Default: all that are quick.",
        autocompletion=planner_names,
    ),
]
Seed = Annotated[
    int | None,
    typer.Option(
        "--seed",
        min=SEED.least,
        max=SEED.greatest,
        help="Of all random numbers; default: the scenario's.",
    ),
]
Runs = Annotated[
    int,
    typer.Option(
        "--runs",
        min=RUNS.least,
        max=RUNS.greatest,
        help="Seeds per planner; the same for each of them.",
    ),
]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Change one key; may be repeated."),
]
Out = Annotated[
    Path | None, typer.Option("--out", help="Folder to make; default: ./NAME, then ./NAME-2, ...")
]
NoBound = Annotated[
    bool,
    typer.Option(
        "--no-bound", help="Leave out the certified bound over all paths, costly in long missions."
    ),
]


def named(planners: str | None) -> list[str]:
    """Planners of a list on the command line."""
    return [name.strip() for name in (planners or "").split(",") if name.strip()]
