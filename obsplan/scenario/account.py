"""What was understood of a mission file and what was passed over, in words; and its scenario."""

import tomllib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from obsplan.constraints import Disc
from obsplan.files import write_atomically
from obsplan.scenario.areas import Shape
from obsplan.scenario.scenario import from_dict
from obsplan.scenario.template import scenario_text
from obsplan.scenario.understood import TANK, Surveyor, Understood, plain, understand
from obsplan.types import ObsplanError

MOST_LINES = 20  # of tracks, and of keep-outs


def write_new(mission_file: Path, scenario_file: Path) -> list[str]:
    """Write a scenario around the survey of a mission file; give the lines that account for it.

    Raises
    ------
    ObsplanError
        A mission file that cannot be read or is no survey, or a scenario file that cannot be
        written; nothing is written then.
    """
    understood = understand(mission_file)
    text = scenario_text(understood, mission_file, scenario_file)
    data = tomllib.loads(text)
    try:
        from_dict(data, source=scenario_file.name, folder=scenario_file.parent)
    except ObsplanError as error:
        raise ObsplanError(f"{mission_file.name} makes no scenario: {error}") from error
    write_atomically(scenario_file, text)
    minutes = in_words(max(auv.duration for auv in understood.auvs))
    return [*account(understood), f"Wrote {scenario_file}: a mission of {minutes}."]


def account(understood: Understood) -> Iterator[str]:
    """Say what was understood, a line for each thing, and then what was passed over."""
    lat, lon = understood.origin
    file, reason = plain(understood.file), understood.origin_reason
    yield f"{file}: origin at latitude {lat}, longitude {lon}, {reason}."
    if len(understood.auvs) > 1:
        count = len(understood.auvs)
        yield f"  {count} tracks, an AUV for each: remove the [[auv]] tables that are not yours."
    yield from _first([_track(understood, auv) for auv in understood.auvs], "tracks")
    limits = understood.constraints
    if limits.geofence is not None:
        yield f"  geofence: {_shape(limits.geofence)}, not to be left by the aid vehicle"
    yield from _first([f"keep-out: {_shape(shape)}" for shape in limits.keep_out], "keep-outs")
    start = understood.start
    yield f"  the aid vehicle starts at ({start.x:.1f}, {start.y:.1f}) m"
    if understood.numbers is TANK:
        yield (
            "  so small a survey is taken to be in a test tank: "
            "check speeds, turning radius and ranging"
        )
    if understood.remarks:
        yield "Passed over, or not as in the file:"
        yield from (f"  {remark}" for remark in understood.remarks)


def _first(lines: list[str], what: str) -> Iterator[str]:
    """The first lines of many."""
    yield from (f"  {line}" for line in lines[:MOST_LINES])
    if len(lines) > MOST_LINES:
        yield f"  and {len(lines) - MOST_LINES} more {what}"


def _track(understood: Understood, auv: Surveyor) -> str:
    """A track: its size, its pace, and what else the file says of it."""
    track = understood.mission.tracks[auv.track]
    pace = auv.pace if auv.speed is None else f"{auv.speed} m/s ({auv.pace})"
    parts = [
        f'track "{auv.track}": {len(track.points)} points, {metres(auv.length)}, '
        f"{in_words(auv.duration)} at {pace}"
    ]
    if track.hold is not None:
        held = track.hold[track.hold > 0]
        parts.append(f"holds {in_words(float(held.sum()))} in all, at {held.size} of its points")
    if track.altitude is not None and track.altitude.any():
        low, high = float(track.altitude.min()), float(track.altitude.max())
        levels = f"{low:g} m" if low == high else f"{low:g} to {high:g} m"
        parts.append(f"altitude {levels}, not used: ranges are taken as horizontal")
    return "; ".join(parts)


def _shape(shape: Shape) -> str:
    """Size and place of an area."""
    if isinstance(shape, Disc):
        return f"disc of radius {metres(shape.radius)} about ({shape.x:.1f}, {shape.y:.1f}) m"
    corners = np.array(shape.points)
    width, height = np.ptp(corners, axis=0)
    east, north = (corners.min(axis=0) + corners.max(axis=0)) / 2
    size = f"{metres(width)} by {metres(height)}"
    return f"{size} about ({east:.1f}, {north:.1f}) m, {len(corners)} corners"


def metres(length: float) -> str:
    """A length in words."""
    if length >= 10e3:
        return f"{length / 1e3:.1f} km"
    return f"{length:.0f} m" if length >= 10 else f"{length:.2f} m"


def in_words(seconds: float) -> str:
    """A duration in words."""
    if seconds >= 3 * 3600:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 60:.1f} min" if seconds >= 120 else f"{seconds:.3g} s"
