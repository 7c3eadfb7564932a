"""Write how far from the best path the default planner's is, at most, on short missions.

    python scripts/optimality.py [--nodes 3000] [CASE ...]

The table of `docs/bounds.md` is its output. Each case is a shipped scenario, cut short. Of every
path the Cramér-Rao error counts, along the same true tracks of the AUVs.
"""

import argparse
import sys
import time
from importlib.resources import files

import numpy as np

import obsplan as op

CASES = {
    "one AUV, moored": ("suite/one-moored.toml", {"duration": 241.0}),
    "one AUV, few ranges": ("suite/one-sparse.toml", {"duration": 181.0}),
    "two AUVs": ("harbor-survey.toml", {"duration": 31.0, "ranging__interval": 10.0}),
    "tank, equal speed": ("suite/tank-slow.toml", {"duration": 8.0, "ranging__interval": 1.0}),
    "tank, precise": ("suite/tank-precise.toml", {"duration": 6.0}),
}
PLANNERS = ("information", "whole-mission")
SEED = 3001
COLUMNS = (
    "case",
    "ranges",
    "planner",
    "Cramér-Rao RMS",
    "bound, each alone",
    "joint",
    "of each path",
    "at most above the best",
    "nodes",
    "CPU",
)


def mission(case: str) -> op.Scenario:
    """The scenario of a case."""
    name, change = CASES[case]
    return op.load(str(files("obsplan") / "scenarios" / name)).replace(**change)


def row(case: str, planner: str, nodes: int) -> str:
    """What is certified of a planner's path."""
    run = op.simulate(mission(case), planner=planner, seed=SEED)
    alone = np.sqrt(np.mean([bound.bound for bound in run.information_bounds]))
    joint = run.joint_bound().bound_rms_m
    began = time.process_time()
    optimal = run.optimal_bound(max_nodes=nodes)
    took = time.process_time() - began
    errors = " | ".join(
        f"{error:.3f} m" for error in (np.sqrt(optimal.achieved), alone, joint, optimal.bound_rms_m)
    )
    ranges = str(int(run.came.sum()))
    excess = f"{100 * optimal.excess:.1f} %"
    return line(case, ranges, f"`{planner}`", errors, excess, str(optimal.nodes), f"{took:.0f} s")


def line(*cells: str) -> str:
    """A line of the table."""
    return "| " + " | ".join(cells) + " |\n"


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", default=[*CASES], metavar="CASE")
    parser.add_argument("--nodes", type=int, default=3000)
    given = parser.parse_args()
    write = sys.stdout.write
    write(line(*COLUMNS) + line(*["---"] * len(COLUMNS)))
    for case in given.cases:
        for planner in PLANNERS:
            write(row(case, planner, given.nodes))
            sys.stdout.flush()


if __name__ == "__main__":
    main()
