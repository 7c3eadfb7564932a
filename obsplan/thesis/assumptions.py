"""What section 5.3 of the thesis leaves open: assumptions like its own, ours, and one put back.

The thesis states speeds, turning radius, and the AUV's start and first estimate. It states no
noise, no filter noise, no survey, and no start of the aid vehicle.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from obsplan.scenario import Scenario, load

FAST, SLOW = "survey-fast", "survey-slow"
LIKE = {FAST: "thesis/fast-cna", SLOW: "thesis/slow-cna"}  # as the thesis seems to have assumed

GRAMIAN, INERTIA, CIRCLE, STATIONARY = (
    "Empirical Gramian",
    "Path Inertia",
    "Circular",
    "Stationary",
)
POLICIES = {
    GRAMIAN: ("gramian", 'planner.gramian="exact"'),
    INERTIA: ("path-inertia", "planner.gamma=1.0"),
    CIRCLE: ("circle",),
    STATIONARY: ("stationary",),
}
LIKE_POLICIES = POLICIES | {
    GRAMIAN: ("gramian", 'planner.gramian="thesis"', "planner.turn_rates=11"),
    STATIONARY: ("stationary", "cna.start.x=1.0", "cna.start.y=40.0"),
}
# (4.6) without the heading's effect on the ranges
PRINTED = {"Gramian as printed": ("gramian", 'planner.gramian="thesis"')}
THESIS = {  # distance error, RMS and maximum [m]
    FAST: {
        GRAMIAN: (0.1, 2.3),
        INERTIA: (0.2, 3.1),
        CIRCLE: (29.3, 117.8),
        STATIONARY: (71.0, 118.0),
    },
    SLOW: {
        GRAMIAN: (5.6, 16.3),
        INERTIA: (0.3, 3.1),
        CIRCLE: (24.1, 48.6),
        STATIONARY: (2.5, 12.6),
    },
}
FIRST, TRUTH, FILTER = "auv.0.first_estimate", "auv.0.process_noise", "estimator.process_noise"


@dataclass(frozen=True, kw_only=True)
class Change:
    """What is assumed otherwise: for every policy, and for one of them besides."""

    everywhere: tuple[str, ...] = ()
    of: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    why: str = ""  # it matters


AS_ASSUMED = "as assumed"
LOOSE = "speed walk of the filter 0.005, as ours"
EXACT = "exact Gramian, as ours"
START = "aid vehicle from (1, 0), as ours"
BEACON = "stationary beacon at (1, 0), as ours"
SIGMA = "σ = 2 m², as ours"
VAGUE = "first estimate 2 m, 1 m/s, as ours"
WALK = "process noise of the truth, as ours"
TURNS = "21 turn rates, as ours"
ITERATED = "iterated EKF"
# To assumptions like the thesis's: nothing, then ours one at a time, then others.
CHANGES: dict[str, Change] = {
    AS_ASSUMED: Change(),
    LOOSE: Change(
        everywhere=(f"{FILTER}.speed=0.005",),
        why="a loose walk of the speed lets each correction inflate it, and about a far beacon "
        "the position runs along the circle of equal range",
    ),
    EXACT: Change(
        of={GRAMIAN: ('planner.gramian="exact"',)},
        why="the printed Gramian loses an AUV of equal speed, the exact one follows it",
    ),
    TURNS: Change(
        of={GRAMIAN: ("planner.turn_rates=21",)},
        why="whether the printed Gramian loses the AUV hangs on its candidate turns",
    ),
    START: Change(
        everywhere=("cna.start.x=1.0", "cna.start.y=0.0"),
        why="whether the printed Gramian loses the AUV hangs on the start",
    ),
    BEACON: Change(
        of={STATIONARY: ("cna.start.x=1.0", "cna.start.y=0.0")},
        why="from a beacon beside the start the AUV's image is as likely as the AUV",
    ),
    SIGMA: Change(everywhere=("ranging.sigma=2.0",)),
    VAGUE: Change(
        everywhere=(f"{FIRST}.sigma_position=2.0", f"{FIRST}.sigma_speed=1.0"),
        why="a filter too sure of its first speed, 0, is wrong by many deviations at once, and "
        "drifts from there",
    ),
    WALK: Change(
        everywhere=(
            f"{TRUTH}.position=0.02",
            f"{TRUTH}.heading_deg=0.1",
            f"{TRUTH}.speed=0.005",
        ),
        why="an AUV that strays is met by the printed Gramian by chance",
    ),
    "lanes 8 m apart, as ours": Change(everywhere=("auv.0.survey.spacing=8.0",)),
    "speed walk of the filter 0.05": Change(everywhere=(f"{FILTER}.speed=0.05",)),
    "speed walk of the filter 0.1": Change(everywhere=(f"{FILTER}.speed=0.1",)),
    "speed walk of the filter 0.35": Change(everywhere=(f"{FILTER}.speed=0.35",)),
    "aid vehicle from (4, 3)": Change(everywhere=("cna.start.x=4.0", "cna.start.y=3.0")),
    "aid vehicle from (-6, -4)": Change(everywhere=("cna.start.x=-6.0", "cna.start.y=-4.0")),
    "stationary beacon at (-2, 60)": Change(
        of={STATIONARY: ("cna.start.x=-2.0", "cna.start.y=60.0")}
    ),
    ITERATED: Change(everywhere=('estimator.kind="iterated-ekf"',)),
}
# To ours: nothing, then one at a time.
OURS: dict[str, Change] = {
    "ours": Change(),
    "ours, σ = 0.5 m²": Change(everywhere=("ranging.sigma=0.5",)),
    "ours, σ = 8 m²": Change(everywhere=("ranging.sigma=8.0",)),
    "ours, the range itself, σ = 0.5 m": Change(
        everywhere=('ranging.kind="range"', "ranging.sigma=0.5")
    ),
    "ours, a range every 1 s": Change(everywhere=("ranging.interval=1.0",)),
    "ours, a range every 10 s": Change(everywhere=("ranging.interval=10.0",)),
    "ours, no process noise": Change(
        everywhere=(f"{TRUTH}.position=0.0", f"{TRUTH}.heading_deg=0.0", f"{TRUTH}.speed=0.0")
    ),
    "ours, 5 times the process noise": Change(
        everywhere=(f"{TRUTH}.position=0.1", f"{TRUTH}.heading_deg=0.5", f"{TRUTH}.speed=0.025")
    ),
    "ours, first estimate vague, 10 m, 10 m/s": Change(
        everywhere=(f"{FIRST}.sigma_position=10.0", f"{FIRST}.sigma_speed=10.0")
    ),
    "ours, first estimate too sure, 0.1 m": Change(everywhere=(f"{FIRST}.sigma_position=0.1",)),
}


def policies(name: str, *settings: str, printed: bool = True) -> dict[str, Scenario]:
    """A survey under every policy, with our noise; ``printed`` adds the Gramian of (4.6)."""
    listed = POLICIES | (PRINTED if printed else {})
    return flown(name, listed, Change(everywhere=settings))


def like(name: str, change: Change = CHANGES[AS_ASSUMED]) -> dict[str, Scenario]:
    """A survey under every policy, as the thesis seems to have assumed but for a change."""
    return flown(LIKE[name], LIKE_POLICIES, change)


def ours(name: str, change: Change) -> dict[str, Scenario]:
    """A survey under every policy, with our noise but for a change."""
    return flown(name, POLICIES, change)


def flown(
    scenario: str, listed: Mapping[str, tuple[str, ...]], change: Change
) -> dict[str, Scenario]:
    """A scenario under policies: what is their own comes after the change for all."""
    return {
        label: load(
            scenario,
            planner=planner,
            settings=(*change.everywhere, *own, *change.of.get(label, ())),
        )
        for label, (planner, *own) in listed.items()
    }
