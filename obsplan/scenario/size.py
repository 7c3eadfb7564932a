"""Whether a mission can be flown: in memory, as estimated before it is made, and in its current."""

from typing import Any

from obsplan.scenario.tables import ScenarioTable, aids_of
from obsplan.types import ObsplanError
from obsplan.water import Water

MOST_AUVS = 100  # AUVs that range to one aid vehicle in turns
# measured and rounded up: of each step, and of each AUV at each step, with the certified bound and
# all files of a run
STEP, RECORD = 1.8e3, 500.0  # [bytes]
# measured: of each candidate turn or stage of a planner for each AUV, as an expression, in a
# program, in a beam
CANDIDATE, STAGE, KEPT = 240e3, 1.3e6, 200.0  # [bytes]
MOST_RECORDED, MOST_PLANNED = 16e9, 2e9  # [bytes]


def check_auvs(count: int, source: str) -> None:
    """Refuse more AUVs than one aid vehicle can range to.

    Raises
    ------
    ObsplanError
        Names the key and the number.
    """
    if count > MOST_AUVS:
        raise ObsplanError(
            f"{source}: auv: {count} AUVs are more than the {MOST_AUVS} that one aid vehicle "
            "ranges to in turns: remove some"
        )


def check_steps(steps: int, auvs: int, *, duration: float, time_step: float, source: str) -> None:
    """Refuse fewer than one step, and more than there is memory to record for so many AUVs.

    Raises
    ------
    ObsplanError
        Names the key, the number of steps and what they would take.
    """
    if duration < time_step * (1 - 1e-9):
        raise ObsplanError(
            f"{source}: duration: {duration:g} s is shorter than a step of {time_step:g} s, and "
            "nothing would be measured: give a longer mission, or a shorter time_step"
        )
    of_step = STEP + auvs * RECORD
    size = steps * of_step
    if size > MOST_RECORDED:
        most = int(MOST_RECORDED / of_step)
        raise ObsplanError(
            f"{source}: time_step: {time_step} s makes {steps} steps of {duration:.0f} s, "
            f"about {size / 1e9:.0f} GB of records for {auvs} AUV{'s' * (auvs > 1)}; "
            f"give at most {most} steps"
        )


def check_planner_size(planner: Any, auvs: int, source: str) -> None:
    """Refuse a planner's table whose candidates for so many AUVs do not fit into memory.

    Raises
    ------
    ObsplanError
        Names the keys, their values and what they would take.
    """
    sizes = {"turn_rates": CANDIDATE, "stages": STAGE}
    if hasattr(planner, "beam_width"):
        sizes = {"turn_rates": KEPT, "beam_width": 1.0}
    found = {
        key: getattr(planner, key) for key in sizes if isinstance(getattr(planner, key, None), int)
    }
    size = float(auvs)
    for key, count in found.items():
        size *= count * sizes[key]
    if found and size > MOST_PLANNED:
        given = " and ".join(f"{key} = {count}" for key, count in found.items())
        raise ObsplanError(
            f"{source}: planner: {given} take about {size / 1e9:.0f} GB for {auvs} "
            f"AUV{'s' * (auvs > 1)}, and at most {MOST_PLANNED / 1e9:.0f} GB are planned with: "
            "give smaller numbers"
        )


def check_current(table: ScenarioTable, water: Water, source: str) -> None:
    """Refuse a current that the aid vehicle cannot stem.

    Its planner commands courses and speeds over ground, and it is taken to hold them.

    Raises
    ------
    ObsplanError
        Names the key, the current and the speed.
    """
    strongest = float(water.strongest(0.0))
    for aid in aids_of(table):
        if strongest >= aid.speed:
            current = list(table.environment.current)
            more = "" if water.is_uniform else f", up to {strongest:.3g} m/s at the surface,"
            raise ObsplanError(
                f"{source}: environment.current = {current} m/s{more} is too strong for the aid "
                f"vehicle, cna.speed = {aid.speed} m/s: it could not hold the track over ground "
                "that its planner commands; give a weaker current, or a faster vehicle"
            )
