"""A commented scenario around the user's own survey, ready to run."""

import math
import os
import re
import shlex
import textwrap
from pathlib import Path
from typing import Any

import tomlkit

from obsplan.planners import PLANNERS
from obsplan.scenario.areas import as_entry, as_fence
from obsplan.scenario.understood import Surveyor, Understood, plain

WIDTH = 100  # letters of a comment

HEAD = """\
name = {name}
seed = 1                                      # of all random numbers
time_step = {time_step}                               # s
origin = {{ lat = {lat:.8f}, lon = {lon:.8f} }}  # of local east/north [deg]

[cna]                                         # the aid vehicle
speed = {cna_speed}                                   # m/s
min_turn_radius = {min_turn_radius}                        # m
# m, m, degrees counter-clockwise from east; or lat, lon
start = {{ x = {x:.1f}, y = {y:.1f}, heading_deg = {heading:.1f} }}

"""

AUV = """\
[[auv]]
name = {name}
{speed}
survey = {{ kind = "mission", file = {file}, track = {track} }}
# the filter's first guess, drawn about the truth: m, degrees, m/s
first_estimate = {{ sigma_position = {sigma_position}, \
sigma_heading_deg = 2.0, sigma_speed = {sigma_speed} }}
# m, degrees, m/s, each per sqrt(s)
process_noise = {{ position = {noise_position}, heading_deg = 0.1, speed = {noise_speed} }}

"""

TAIL = """\
[environment]
current = [0.0, 0.0]                          # east, north, m/s

[ranging]
kind = "range"
interval = {interval}                               # s between ranges to each AUV
sigma = {sigma}                                   # m
heading_sigma_deg = 1.0                       # degrees

[constraints]                                 # of the aid vehicle's position
{limits}
[planner]
{planners}
kind = "default"
interval = 1.0                                # s between decisions
# or estimate-and-survey (the turns filed, too), survey, truth
knowledge = "estimate"
"""

NO_LIMITS = """\
# keep_out = [{ lat = .., lon = .., radius = 30.0 }, { file = "wreck.geojson" }]
# geofence = [[east, north], ...]             # m; or { file = "area.kml" }
"""


def scenario_text(understood: Understood, mission_file: Path, scenario_file: Path) -> str:
    """Contents of a scenario file with one AUV per track of a mission file."""
    lat, lon = understood.origin
    start = understood.start
    numbers = understood.numbers._asdict()
    head = HEAD.format(
        **numbers,
        name=quoted(_scenario_name(scenario_file)),
        lat=lat,
        lon=lon,
        x=start.x,
        y=start.y,
        heading=math.degrees(start.heading) % 360.0,
    )
    relative = os.path.relpath(mission_file.resolve(), scenario_file.resolve().parent)
    file = quoted(Path(relative).as_posix())
    auvs = [
        AUV.format(
            **numbers,
            name=quoted(auv.name),
            speed=_speed(auv),
            file=file,
            track=quoted(auv.track),
        )
        for auv in understood.auvs
    ]
    tail = TAIL.format(
        **numbers,
        limits=_limits(understood) or NO_LIMITS,
        planners=comment(f"or {', '.join(PLANNERS)}"),
    )
    return _opening(understood, scenario_file) + head + "".join(auvs) + tail


def quoted(text: str) -> str:
    """A string as TOML has it."""
    return tomlkit.item(text).as_string()


def as_argument(path: Path | str) -> str:
    """A path as a command takes it: none is an option."""
    text = str(path)
    return f"./{text}" if text.startswith("-") else text


def comment(text: str) -> str:
    """A comment of one line or several."""
    return textwrap.fill(
        plain(text),
        WIDTH,
        initial_indent="# ",
        subsequent_indent="#   ",
        break_on_hyphens=False,
        break_long_words=False,
    )


def _opening(understood: Understood, scenario_file: Path) -> str:
    """What the file is, and what it does not hold."""
    lines = [
        comment(f"Survey {understood.file}, ranged by one aid vehicle."),
        comment(
            "Change what is not true of yours, then: obsplan run "
            f"{shlex.quote(as_argument(scenario_file.name))}"
        ),
        comment("Every key that may stand here: obsplan schema"),
        comment(f"Origin: {understood.origin_reason}."),
    ]
    if understood.remarks:
        lines.append(comment(f"Not as in {understood.file}:"))
        lines += [comment(f"- {remark}") for remark in understood.remarks]
    return "\n".join(lines) + "\n"


def _scenario_name(scenario_file: Path) -> str:
    """The file's name, as a scenario may be named."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", scenario_file.stem).strip("-._") or "survey"


def _speed(auv: Surveyor) -> str:
    """The line of an AUV's speed; a comment where the file has one for each leg."""
    if auv.speed is None:
        return comment(f"no speed: {auv.pace}; one given here holds on every leg")
    return f"speed = {auv.speed:<37} # through the water, m/s; {auv.pace}"


def _limits(understood: Understood) -> str:
    """Keys of the limits that the mission file has."""
    limits = understood.constraints
    text = ""
    if limits.keep_out:
        entries = "".join(f"    {_inline(as_entry(shape))},\n" for shape in limits.keep_out)
        text += f"keep_out = [                                  # m\n{entries}]\n"
    if limits.geofence is not None:
        text += f"geofence = {_inline(as_fence(limits.geofence))}\n"
    return text


def _inline(value: Any) -> str:
    """A table or list of numbers in one line of TOML."""
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {_inline(item)}' for key, item in value.items())} }}"
    if isinstance(value, list):
        return f"[{', '.join(_inline(item) for item in value)}]"
    return repr(float(value))
