"""What is understood of a mission file: AUVs, limits, a start; and what was passed over."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from obsplan.constraints import Constraints
from obsplan.missions import Area, Mission, Track, read_mission, to_local
from obsplan.missions.mission import FARTHEST, Point
from obsplan.next_move import loiter_violation
from obsplan.scenario.areas import Shape, common, shape_of
from obsplan.scenario.plausible import (
    check_duration,
    check_extent,
    check_metres_are_metres,
    distance_between,
    extent,
    known_speeds,
)
from obsplan.scenario.size import MOST_AUVS
from obsplan.surveys.reference import FASTEST, SLOWEST
from obsplan.types import ObsplanError, Pose

LARGEST_TANK = 20.0  # [m]; of a survey that is taken to be in a test tank
DECIMALS = 2  # of limits [m]
LONGEST_NAME = 40  # letters of an AUV's name
RINGS = (1.0, 0.5, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0)  # where a start is looked for
BEARINGS, HEADINGS = 16, 8
SPARE = 0.1  # of the turning radius, by which a start is within the limits


class Numbers(NamedTuple):
    """What a new scenario says where the mission file says nothing, in metres and seconds."""

    time_step: float
    cna_speed: float
    min_turn_radius: float
    start: float  # from the first waypoint
    auv_speed: float
    sigma_position: float
    sigma_speed: float
    noise_position: float
    noise_speed: float
    interval: float  # between ranges
    sigma: float  # of a range


FIELD = Numbers(0.5, 2.0, 10.0, 50.0, 1.2, 5.0, 0.3, 0.03, 0.01, 15.0, 1.0)
TANK = Numbers(0.1, 0.5, 0.3, 1.0, 0.3, 0.5, 0.1, 0.01, 0.005, 1.0, 0.1)


@dataclass(frozen=True, kw_only=True)
class Surveyor:
    """An AUV on a track; ``speed`` is None where each leg has one, ``pace`` says its origin."""

    name: str
    track: str
    speed: float | None  # [m/s]
    pace: str
    length: float  # [m], on the ellipsoid
    duration: float  # [s], holds included


@dataclass(frozen=True, kw_only=True)
class Understood:
    """A mission file as a scenario takes it; ``remarks`` say what it does not take, or changes."""

    file: str
    mission: Mission
    origin: Point
    origin_reason: str
    numbers: Numbers
    auvs: tuple[Surveyor, ...]
    constraints: Constraints
    start: Pose
    remarks: tuple[str, ...]


def understand(path: Path) -> Understood:
    """Read a mission file and check that it can be a survey.

    Raises
    ------
    ObsplanError
        A file that cannot be read, or that is no survey: degrees read as metres, millimetres, a
        continent, seconds or days.
    """
    mission = read_mission(path)
    check_metres_are_metres(path.name, mission)
    check_extent(path.name, mission)
    if len(mission.tracks) > MOST_AUVS:
        raise ObsplanError(
            f"{path.name} has {len(mission.tracks)} tracks, and one aid vehicle ranges to at most "
            f"{MOST_AUVS} AUVs in turns: export those that are yours"
        )
    try:
        local = to_local(mission)
    except ObsplanError as error:
        raise ObsplanError(f"{path.name}: {error}") from error
    numbers = TANK if extent(mission) < LARGEST_TANK else FIELD
    remarks = list(mission.remarks)
    auvs = _surveyors(mission, numbers, remarks)
    check_duration(path.name, max(auv.duration for auv in auvs))
    constraints = Constraints(
        keep_out=tuple(_shapes(local.keep_outs, "keep-out", remarks)),
        geofence=_fence(local.geofences, remarks),
    )
    origin, reason = _origin(mission)
    return Understood(
        file=path.name,
        mission=mission,
        origin=origin,
        origin_reason=reason,
        numbers=numbers,
        auvs=auvs,
        constraints=constraints,
        start=_start(next(iter(local.tracks.values())), constraints, numbers, remarks),
        remarks=tuple(plain(remark) for remark in remarks),
    )


def plain(text: str) -> str:
    """A text in one line, and without what a terminal would act on."""
    return "".join(c if c.isprintable() else "?" for c in " ".join(text.split()))


def _origin(mission: Mission) -> tuple[Point, str]:
    """The origin and why it is there."""
    origin = mission.origin
    if origin is None:
        return (0.0, 0.0), "a placeholder, since the file is in metres: say where it is"
    if mission.home is None:
        return origin, "the first waypoint, for want of a planned home"
    if origin == mission.home:
        return origin, "the planned home"
    lat, lon = mission.home
    return (
        origin,
        (
            f"the first waypoint, since the planned home at {lat}, {lon} is over "
            f"{FARTHEST / 1e3:.0f} km away, a placeholder"
        ),
    )


def _surveyors(mission: Mission, numbers: Numbers, remarks: list[str]) -> tuple[Surveyor, ...]:
    """An AUV for each track."""
    auvs: list[Surveyor] = []
    for name, track in mission.tracks.items():
        fit = _fit_name(name, [auv.name for auv in auvs])
        if fit != name:
            remarks.append(f'the AUV on track "{name}" is called "{fit}", as tables can show it')
        speed, pace = _pace(name, track, numbers, remarks)
        legs = distance_between(mission, track.points[:-1], track.points[1:])
        speeds = known_speeds(track) if speed is None else np.full(len(legs), speed)
        held = 0.0 if track.hold is None else float(track.hold.sum())
        auvs.append(
            Surveyor(
                name=fit,
                track=name,
                speed=speed,
                pace=pace,
                length=float(legs.sum()),
                duration=float((legs / speeds).sum()) + held,
            )
        )
    return tuple(auvs)


def _fit_name(name: str, taken: Sequence[str]) -> str:
    """A track's name as an AUV's: letters, digits, blanks, dots, hyphens, not long, and its own."""
    base = re.sub(r"[^\w .-]+", "-", name).strip(" .-_")[:LONGEST_NAME].strip(" .-_") or "auv"
    fit, count = base, 1
    while fit in taken:
        count += 1
        fit = f"{base}-{count}"
    return fit


def _pace(
    name: str, track: Track, numbers: Numbers, remarks: list[str]
) -> tuple[float | None, str]:
    """The speed on all legs, or None where each has its own, and where it comes from."""
    speeds = known_speeds(track)
    default = numbers.auv_speed
    if speeds is None or track.speed is None:
        return default, "the file does not say: change it"
    low, high = float(speeds.min()), float(speeds.max())
    if low < SLOWEST or high > FASTEST:
        remarks.append(
            f'track "{name}" has speeds from {low:.4g} to {high:.4g} m/s, '
            f"and AUVs go {SLOWEST} to {FASTEST} m/s: {default} m/s is written instead"
        )
        return default, "not as in the file: change it"
    unsaid = int(np.isnan(track.speed).sum())
    if unsaid:
        remarks.append(
            f'track "{name}" has no speed on {unsaid} of its {len(speeds)} legs: '
            "each takes that of the leg before it, or else after it"
        )
    if high - low < 1e-6:
        return round(low, 6), "from the file"
    return None, f"{low:.4g} to {high:.4g} m/s, leg by leg from the file"


def _shapes(areas: Sequence[Area], what: str, remarks: list[str]) -> list[Shape]:
    """Areas as they are written, those that are none left out with a remark."""
    shapes: list[Shape] = []
    for number, area in enumerate(areas, start=1):
        radius = None if area.radius is None else round(area.radius, DECIMALS)
        try:
            shapes.append(shape_of(Area(points=area.points.round(DECIMALS), radius=radius)))
        except ValueError as error:
            remarks.append(f"{what} {number} is left out: {error}")
    return shapes


def _fence(areas: Sequence[Area], remarks: list[str]) -> Shape | None:
    """The one geofence; None where there is none, or no common one, which a remark says."""
    fences = _shapes(areas, "geofence", remarks)
    if not fences:
        return None
    if len(fences) > 1:
        remarks.append(
            f"the {len(fences)} geofences, all of which hold, are written as the one area they "
            "have in common"
        )
    try:
        return common(fences)
    except ValueError as error:
        remarks[-1] = f"no geofence is written: {error}"
        return None


def _start(track: Track, limits: Constraints, numbers: Numbers, remarks: list[str]) -> Pose:
    """A pose near the first waypoint, within the limits and with space to turn.

    It is west of the waypoint and heads north, if that will do.
    """
    first = track.points[0]
    rings = numbers.start * np.array(RINGS)
    bearings = np.pi + 2 * np.pi * np.arange(BEARINGS) / BEARINGS
    headings = np.pi / 2 + 2 * np.pi * np.arange(HEADINGS) / HEADINGS
    ring, bearing, heading = (
        a.ravel() for a in np.meshgrid(rings, bearings, headings, indexing="ij")
    )
    east, north = first[0] + ring * np.cos(bearing), first[1] + ring * np.sin(bearing)
    poses = np.column_stack([east.round(1), north.round(1), heading])
    outside = np.maximum(
        limits.fixed_violation(np.ascontiguousarray(poses[:, :2])),
        loiter_violation(limits, poses, numbers.min_turn_radius).min(axis=-1),
    )
    free = np.flatnonzero(outside <= -SPARE * numbers.min_turn_radius)
    if not free.size:
        remarks.append(
            "the aid vehicle's start is outside the limits, for none with space to turn was found "
            f"within {rings.max():.0f} m of the first waypoint: move cna.start"
        )
    x, y, heading = poses[free[0] if free.size else 0].tolist()
    return Pose(x, y, heading)
