"""The files of a run's path: a mission for autopilots in many formats, and all tracks for a map."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from obsplan import geo
from obsplan.missions import (
    Mission,
    Track,
    write_csv,
    write_geojson,
    write_gpx,
    write_kml,
    write_moos,
    write_plan,
    write_waypoints,
)
from obsplan.report.export import Export
from obsplan.run import Run


def write_paths(run: Run, export: Export, folder: Path) -> list[str]:
    """Write the mission in every format of ``export.formats``; returns the names of the files.

    They are ``path.waypoints`` and so on; of several aid vehicles ``path-cna-1.waypoints``.

    ``path.geojson`` is for maps: it holds the paths as flown and every AUV's tracks, too.

    Raises
    ------
    ObsplanError
        A file cannot be written.
    """
    table, origin = run.scenario.table.export, run.scenario.table.origin
    mission, place = export.mission, (origin.lat, origin.lon)
    writers: dict[str, Callable[[Path], None]] = {
        "waypoints": partial(write_waypoints, mission=mission, end=table.end),
        "plan": partial(write_plan, mission=mission, end=table.end),
        "gpx": partial(write_gpx, mission=mission, start=table.start),
        "kml": partial(write_kml, mission=mission, start=table.start),
        "geojson": partial(write_geojson, mission=map_mission(run, mission)),
        "csv": partial(write_csv, mission=mission, origin=place),
        "bhv": partial(write_moos, mission=mission, origin=place, capture=table.min_spacing),
    }
    names = path_names(export)
    for name, path in names.items():
        writers[name](folder / path)
    return [*names.values()]


def path_names(export: Export) -> dict[str, str]:
    """Names of the files by their formats."""
    formats = dict.fromkeys(export.scenario.table.export.formats)
    return {name: f"{export.stem}.{name}" for name in formats}


def map_mission(run: Run, mission: Mission) -> Mission:
    """The aid vehicles' paths as flown, each AUV's tracks, and the mission's limits.

    They are named "cna", or "cna-1" and so on, "NAME-truth" and "NAME-estimate". A
    vehicle that never moves has one point; an estimate that is no number has none.
    """
    aids = dict(zip(run.aid_names, run.aids, strict=True))
    places = {name: aid.pose[:, :2] for name, aid in aids.items()}
    for i, name in enumerate(run.names):
        places |= {f"{name}-truth": run.true[i, :, :2], f"{name}-estimate": run.mean[i, :, :2]}
    tracks = {name: _track(run, xy) for name, xy in places.items()}
    for name, aid in aids.items():
        track = tracks[name]
        if len(track.points) > 1:
            tracks[name] = Track(points=track.points, time=track.time, speed=aid.speed[:-1])
    return Mission(
        tracks=tracks,
        geographic=True,
        keep_outs=mission.keep_outs,
        geofences=mission.geofences,
    )


def _track(run: Run, xy: np.ndarray) -> Track:
    """A track with its times, where it is known."""
    known = np.flatnonzero(np.isfinite(xy).all(axis=1))
    if not np.ptp(xy[known], axis=0).any():
        known = known[:1]
    origin = run.scenario.table.origin
    return Track(
        points=geo.to_geographic(xy[known], (origin.lat, origin.lon)), time=run.time[known]
    )
