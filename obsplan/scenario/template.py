"""A commented scenario around the user's own survey, ready to run."""

import os
import re
from pathlib import Path

import tomlkit

from obsplan.missions import Mission, read_mission, to_local

HEAD = """\
# Survey {file}, ranged by one aid vehicle. Change what is not true of yours, then: obsplan run {scenario}
# Every key that may stand here: obsplan schema
name = {name}
seed = 1                                      # of all random numbers
time_step = 0.5                               # s
origin = {{ lat = {lat:.8f}, lon = {lon:.8f} }}  # of local east/north [deg]{origin_note}

[cna]                                         # the aid vehicle
speed = 2.0                                   # m/s
min_turn_radius = 10.0                        # m
start = {{ x = {x:.1f}, y = {y:.1f}, heading_deg = 90.0 }}  # m, m, degrees counter-clockwise from east

"""

AUV = """\
[[auv]]
name = {name}
speed = 1.2                                   # through the water, m/s
survey = {{ kind = "mission", file = {file}, track = {track} }}
first_estimate = {{ sigma_position = 5.0, sigma_heading_deg = 2.0, sigma_speed = 0.3 }}  # m, degrees, m/s; drawn about the truth
process_noise = {{ position = 0.03, heading_deg = 0.1, speed = 0.01 }}  # m, degrees, m/s, each per sqrt(s)

"""

TAIL = """\
[environment]
current = [0.0, 0.0]                          # east, north, m/s

[ranging]
kind = "range"
interval = 15.0                               # s between ranges to each AUV
sigma = 1.0                                   # m
heading_sigma_deg = 1.0                       # degrees

[planner]
kind = "default"                              # or path-inertia, gramian, circle, stationary
interval = 1.0                                # s between decisions
knowledge = "estimate"                        # or estimate-and-survey (the turns filed, too), survey, truth
"""

START_WEST = 50.0  # [m] from the first waypoint to the aid vehicle's start


def scenario_text(mission_file: Path, scenario_file: Path) -> str:
    """Contents of a scenario file with one AUV per track of a mission file.

    A mission in local metres has no place on Earth: its origin is then latitude and longitude 0, and a comment says so.

    Raises
    ------
    ObsplanError
        The mission file cannot be used.
    """
    mission = read_mission(mission_file)
    lat, lon = mission.origin or (0.0, 0.0)
    local: Mission = to_local(mission)
    x, y = next(iter(local.tracks.values())).points[0]
    quoted = lambda text: tomlkit.item(str(text)).as_string()  # noqa: E731
    relative = Path(
        os.path.relpath(mission_file.resolve(), scenario_file.resolve().parent)
    ).as_posix()
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", scenario_file.stem).strip("-._") or "survey"
    head = HEAD.format(
        file=mission_file.name,
        scenario=scenario_file.name,
        name=quoted(name),
        lat=lat,
        lon=lon,
        origin_note="" if mission.geographic else "; the survey is in local metres: say where",
        x=x - START_WEST,
        y=y,
    )
    return (
        head
        + "".join(
            AUV.format(name=quoted(track), track=quoted(track), file=quoted(relative))
            for track in local.tracks
        )
        + TAIL
    )
