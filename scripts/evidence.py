"""Write the evidence: the default planner beside all others, over suites and over drawn scenarios.

    python scripts/evidence.py --seed 90001 --runs 40 --out evidence --docs docs

Flies what is missing in the folder ``--out`` (as `obsplan campaign`: interrupted, the same command
goes on from there), and writes ``evidence.md``, ``evidence.csv``, ``evidence-drawn.csv`` and
``evidence-*.png`` to ``--docs``. The same seeds give the same bytes. Parts are ``suite``,
``field``, ``first`` (the first table again, as it was flown) and ``drawn``.
"""

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from obsplan.campaign import Cell, drawn, fly_campaign, load_campaign, plan_cells
from obsplan.campaign.evidence import BEST, BROKE, LEVEL_WITH, evidence, lowest_in
from obsplan.campaign.suite import missions_of, weighted
from obsplan.files import write_atomically
from obsplan.planners import PLANNERS
from obsplan.report.campaign import made
from obsplan.report.evidence import (
    evidence_figure,
    markdown,
    median_table,
    number,
    summary,
    tail_summary,
    tail_table,
)
from obsplan.report.files import toml_lines
from obsplan.report.style import png
from obsplan.scenario import load, suite
from obsplan.scenario.files import find

if TYPE_CHECKING:
    import pandas as pd

DEFAULT = "information"
RIVALS = ("error-ellipse", "trail", "centroid-orbit", "circle", "gramian", "path-inertia")
STATIONARY = "stationary"
REFERENCES = tuple(name for name in ("whole-mission", "rolling") if name in PLANNERS)
FLOWN = ",".join((DEFAULT, *RIVALS, STATIONARY, *REFERENCES))
PARTS = ("suite", "field", "first", "drawn")
WIDE_PRIOR, WIDE_RUNS = "suite/wide-prior", 60
FIRST_SEED, FIRST_RUNS = 1, 20
FIRST_PLANNERS = (DEFAULT, "error-ellipse", "trail")  # the two nearest on the whole
HELD_OUT = (  # of the suite: not in the first table
    "current-keep-outs",
    "far-start",
    "long-transects",
    "six-in-line",
    "slow-slots",
    "standoff-weights",
    "wide-prior",
)
TANKS = ("tank-fast", "tank-precise", "tank-slow")
DRAWN, DRAWN_RUNS = 100, 8
LISTED = 12  # of the drawn scenarios


def main() -> None:
    """Fly, and write."""
    given = arguments()
    names = tuple(given.planners.split(","))
    made(Path(given.docs))  # what cannot be written is said before anything is flown
    parts: dict[str, list[str]] = {}
    found: dict[str, pd.DataFrame] = {}
    frames = []
    for part in given.parts.split(","):
        cells = planned(part, given, names)
        say(f"{part}: {sum(len(cell.seeds) for cell in cells)} missions")
        folder = Path(given.out) / part
        fly_campaign(cells, folder, workers=given.workers, progress=tell)
        table = weighted(cells, missions_of(cells, load_campaign(folder), folder))
        found[part], all_cells = evidence(table, DEFAULT, corrected=part != "drawn")
        parts[part] = WRITERS[part](found[part], given)
        frames.append(all_cells.assign(part=part))
        if part in ("suite", "field"):
            draw_to(Path(given.docs) / f"evidence-{part}.png", found[part])
    if {"suite", "first"} <= set(found):
        parts["first"] += difference(found["first"], found["suite"])
    write(given, parts, frames)


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=90001, help="the first of each scenario")
    parser.add_argument("--runs", type=int, default=40, help="seeds per scenario")
    parser.add_argument("--planners", default=FLOWN, help=f"default: {FLOWN}")
    parser.add_argument("--parts", default=",".join(PARTS), help="default: all")
    parser.add_argument("--drawn", type=int, default=DRAWN, help="scenarios drawn")
    parser.add_argument("--drawn-runs", type=int, default=DRAWN_RUNS, help="seeds of each")
    parser.add_argument("--workers", type=int, default=None, help="default: one per core")
    parser.add_argument("--out", default="evidence", help="folder of the missions")
    parser.add_argument("--docs", default="docs", help="folder of what is written")
    parser.add_argument("--note", default="", help="to stand on top: what no program knows")
    return parser.parse_args()


def say(sentence: str) -> None:
    """Say something beside what is written."""
    sys.stderr.write(f"{sentence}\n")
    sys.stderr.flush()


def tell(done: int, todo: int, failed: int) -> None:
    """Say how far a campaign is, now and then."""
    if done == todo or done % 200 == 0:
        say(f"  {done} of {todo}, {failed} failed")


def planned(part: str, given: argparse.Namespace, names: tuple[str, ...]) -> tuple[Cell, ...]:
    """The missions of a part."""
    if part == "drawn":
        quick = (DEFAULT, *(name for name in names if name in RIVALS))
        seeds = range(given.seed, given.seed + given.drawn)
        files = [drawn_file(Path(given.out) / "scenarios", seed) for seed in seeds]
        return independent(files, quick, given.seed, given.drawn_runs)
    if part == "first":
        quick = tuple(name for name in names if name in FIRST_PLANNERS)
        files = [first_file(Path(given.out) / "first-scenarios", name) for name in first_names()]
        return plan_cells(files, planners=quick, runs=FIRST_RUNS, seed=FIRST_SEED)
    if part == "field":  # of the references' plans, the suite's tell enough for what they cost
        names = tuple(name for name in names if name not in REFERENCES)
    runs = {name: given.runs for name in suite(part)}
    if WIDE_PRIOR in runs:
        runs[WIDE_PRIOR] = max(WIDE_RUNS, given.runs)
    cells = (independent([name], names, given.seed, many) for name, many in runs.items())
    return tuple(cell for some in cells for cell in some)


def independent(files: list[str], names: tuple[str, ...], seed: int, runs: int) -> tuple[Cell, ...]:
    """Missions of which no two scenarios share a seed."""
    return plan_cells(files, planners=names, seed=seed, runs=runs, independent=True)


def drawn_file(folder: Path, seed: int) -> str:
    """Write a drawn scenario, so that anybody may fly it; returns its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"drawn-{seed}.toml"
    write_atomically(path, "\n".join([*toml_lines(drawn.drawn_scenario(seed)), ""]))
    return str(path)


def first_names() -> list[str]:
    """The scenarios of the first table."""
    return [name for name in suite() if name.removeprefix("suite/") not in HELD_OUT]


def first_file(folder: Path, name: str) -> str:
    """A scenario as the first table had it: in the tanks planners knew the truth."""
    short = name.removeprefix("suite/")
    if short not in TANKS:
        return name
    folder.mkdir(parents=True, exist_ok=True)
    text = find(name).read_text(encoding="utf-8")
    path = folder / f"{short}.toml"
    write_atomically(path, text.replace('knowledge = "estimate"', 'knowledge = "truth"'))
    return str(path)


def told(names: list[str]) -> dict[str, str]:
    """What planners know of the AUVs, by scenario."""
    tables = [load(name).table for name in names]
    return {table.name: table.planner.knowledge for table in tables}


def suite_part(rows: "pd.DataFrame", given: argparse.Namespace, part: str = "suite") -> list[str]:
    """The section of a suite."""
    knowledge = told(suite(part))
    heading = f"## `{part}`: {len(rows)} scenarios, {given.runs} seeds each"
    said = [heading, *bullets([*summary(rows, DEFAULT), *tail_summary(rows)])]
    if part == "suite":
        held_out = rows[rows["scenario"].isin(HELD_OUT)]
        sentences = [*summary(held_out, DEFAULT), *tail_summary(held_out)]
        said += ["Of these, the held-out kinds:", *bullets(sentences)]
    picture = f"![Medians, intervals and 95 % quantiles by scenario.](evidence-{part}.png)"
    said += [picture, "### Medians", median_table(rows, DEFAULT, knowledge)]
    return [*said, "### Tails", tail_table(rows, DEFAULT, knowledge)]


def field_part(rows: "pd.DataFrame", given: argparse.Namespace) -> list[str]:
    """The section of the sea."""
    return suite_part(rows, given, "field")


def first_part(rows: "pd.DataFrame", given: argparse.Namespace) -> list[str]:
    """The section of the first table, flown again as it was."""
    del given  # its seeds are its own
    return [
        "## The first table again, as it was flown",
        f"Seeds {FIRST_SEED} to {FIRST_RUNS}, the same for all rows; in the three tanks planners "
        "know the truth. Planners and filters are those of today; of the others the two flew that "
        "are nearest on the whole.",
        *bullets(summary(rows, DEFAULT)),
    ]


def difference(first: "pd.DataFrame", now: "pd.DataFrame") -> list[str]:
    """What independent seeds and estimates change in the first table."""
    now = now[now["scenario"].isin(first["scenario"])]
    one, other = first.set_index("scenario"), now.set_index("scenario")
    change = other["median"] / one["median"]
    lowest = [sum(lowest_in(rows, "median", "rival")) for rows in (first, now)]
    said = bullets(
        [
            f"On independent seeds, and planned by estimates, medians of `{DEFAULT}` are "
            f"{number(change.median())} times as high in the middle, at least "
            f"{number(change.min())} (`{change.idxmin()}`) and at most {number(change.max())} "
            f"(`{change.idxmax()}`).",
            f"It has the lowest median in {lowest[0]} of {len(first)} as it was flown, and in "
            f"{lowest[1]} of the same now.",
        ]
    )
    headings = ["scenario", "as flown [m]", "best other", "ratio", "now [m]", "best other", "ratio"]
    lines = []
    for name in one.index:
        line = [f"`{name}`"]
        for row in (one.loc[name], other.loc[name]):
            line += [number(row["median"]), f"`{row['rival']}`", number(row["ratio"])]
        lines.append(line)
    return [*said, markdown(headings, lines)]


def drawn_part(rows: "pd.DataFrame", given: argparse.Namespace) -> list[str]:
    """The section of drawn scenarios: of each only whether, of the worst how."""
    good = int(rows["verdict"].isin([BEST, LEVEL_WITH]).sum())
    ranges = str(drawn.__doc__).partition("\n\n")[2]
    said = [
        f"## {len(rows)} scenarios drawn at random, {given.drawn_runs} seeds each",
        f"`{DEFAULT}` is best or level in {good} of {len(rows)}: level where the signed-rank test "
        "over paired seeds has p > 0.05, not corrected, which is the stricter way to be level.",
        *bullets(summary(rows, DEFAULT)),
        ranges,
        f"The {min(LISTED, len(rows))} in which it does worst:",
    ]
    worst = rows.sort_values("ratio", ascending=False).head(LISTED)
    headings = ["scenario", f"`{DEFAULT}` [m]", "best other", "its error [m]", "ratio", "p"]
    lines = [
        [
            f"`{row['scenario']}`",
            number(row["median"]),
            f"`{row['rival']}`",
            number(row["rival_median"]),
            number(row["ratio"]),
            f"{row['p']:.2g}" + (" †" if row["verdict"] == BROKE else ""),
        ]
        for row in worst.to_dict("records")
    ]
    write_atomically(
        Path(given.docs) / "evidence-drawn.csv", rows.to_csv(index=False, float_format="%.6g")
    )
    return [*said, markdown(headings, lines)]


WRITERS = {"suite": suite_part, "field": field_part, "first": first_part, "drawn": drawn_part}


def bullets(sentences: list[str]) -> list[str]:
    """Sentences as a list of Markdown."""
    return ["\n".join(f"- {sentence}" for sentence in sentences)]


def draw_to(path: Path, rows: "pd.DataFrame") -> None:
    """Write the figure of a suite."""
    write_atomically(path, png(lambda: evidence_figure(rows, DEFAULT)))


def write(
    given: argparse.Namespace, parts: dict[str, list[str]], frames: "list[pd.DataFrame]"
) -> None:
    """Write the page and all planners' figures."""
    import pandas as pd

    docs = Path(given.docs)
    method = Path(__file__).with_name("evidence_method.md").read_text(encoding="utf-8")
    first = [method.format(seed=given.seed, runs=given.runs, command=repeated(given)).rstrip()]
    noted = [given.note] if given.note else []
    text = "\n\n".join([*first, *noted, *(line for part in parts.values() for line in part)])
    write_atomically(docs / "evidence.md", text.rstrip() + "\n")
    everything = pd.concat(frames, ignore_index=True)
    columns = ["part", *(name for name in everything if name != "part")]
    write_atomically(
        docs / "evidence.csv", everything[columns].to_csv(index=False, float_format="%.6g")
    )


def repeated(given: argparse.Namespace) -> str:
    """The command that writes the same again."""
    words = [f"--seed {given.seed}", f"--runs {given.runs}"]
    defaults = {"--drawn": DRAWN, "--drawn-runs": DRAWN_RUNS, "--parts": ",".join(PARTS)}
    defaults["--planners"] = FLOWN
    chosen = {"--drawn": given.drawn, "--drawn-runs": given.drawn_runs, "--parts": given.parts}
    chosen["--planners"] = given.planners
    words += [f"{key} {chosen[key]}" for key, usual in defaults.items() if chosen[key] != usual]
    return " ".join(["python scripts/evidence.py", *words])


if __name__ == "__main__":
    main()
