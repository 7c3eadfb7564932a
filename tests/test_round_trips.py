"""Claims about missions that are written and read again: what a format holds comes back."""

import numpy as np
import pytest
import shapely
from missions import (
    BUOY,
    BUOY_RADIUS,
    FENCE,
    HOLD,
    ORIGIN,
    POINTS,
    SPEED,
    TIME,
    WRECK,
    full_mission,
    metres,
)

from obsplan.missions import WRITERS, read_mission
from obsplan.report import make_export, write_run
from obsplan.scenario import load
from obsplan.simulation import simulate

NEAR = 0.1  # [m]
TIMED = (".gpx", ".kml", ".geojson", ".csv")
WITH_HOLDS = (".waypoints", ".plan", *TIMED)
WITH_KEEP_OUTS = (".plan", ".kml", ".geojson")
WITH_FENCE = (*WITH_KEEP_OUTS, ".bhv")


def local(mission, points):
    """East and north [m], by another library where they are in degrees."""
    return metres(points) if mission.geographic else points


def shape_of(mission, area):
    points = local(mission, area.points)
    if area.radius is not None:
        return shapely.Point(*points[0]).buffer(area.radius, 64)
    return shapely.Polygon(points)


@pytest.fixture(params=WRITERS)
def back(request, tmp_path):
    """A format, and a full mission as it comes back from it."""
    suffix = request.param
    options = {"origin": ORIGIN} if suffix in (".csv", ".bhv") else {}
    WRITERS[suffix](tmp_path / f"cna{suffix}", full_mission(), **options)
    return suffix, read_mission(tmp_path / f"cna{suffix}")


def test_places_come_back(back):
    _, mission = back
    assert list(mission.tracks) == ["cna"]
    np.testing.assert_allclose(local(mission, mission.tracks["cna"].points), POINTS, atol=NEAR)


def test_speeds_come_back(back):
    suffix, mission = back
    speed = mission.tracks["cna"].speed
    if suffix == ".bhv":  # a behaviour has one, that which is at the end in time
        one = np.hypot(*np.diff(POINTS, axis=0).T).sum() / TIME[-1]
        np.testing.assert_allclose(speed, one, rtol=1e-3)
    else:
        np.testing.assert_allclose(speed, SPEED, rtol=1e-5)


def test_holds_and_times_come_back_where_there_is_room_for_them(back):
    suffix, mission = back
    track = mission.tracks["cna"]
    assert (track.hold is not None) == (suffix in WITH_HOLDS)
    if suffix in WITH_HOLDS:
        np.testing.assert_allclose(track.hold, HOLD)
    assert (track.time is not None) == (suffix in TIMED)
    if suffix in TIMED:
        np.testing.assert_allclose(track.time, TIME)


def test_limits_come_back_where_there_is_room_for_them(back):
    suffix, mission = back
    expected = {
        "geofences": [shapely.Polygon(FENCE)] if suffix in WITH_FENCE else [],
        "keep_outs": [shapely.Polygon(WRECK), shapely.Point(*BUOY[0]).buffer(BUOY_RADIUS, 64)]
        if suffix in WITH_KEEP_OUTS
        else [],
    }
    for kind, shapes in expected.items():
        got = [shape_of(mission, area) for area in getattr(mission, kind)]
        assert len(got) == len(shapes)
        for one, other in zip(got, shapes, strict=True):
            assert shapely.hausdorff_distance(one.exterior, other.exterior) < NEAR


@pytest.mark.slow
def test_every_file_of_a_run_is_read_as_the_mission_that_was_made(tmp_path):
    run = simulate(load("harbor-survey", planner="random", settings=["duration=300.0"]))
    export = make_export(run)
    write_run(run, tmp_path / "out", (export,))
    track = export.simplified.track
    for suffix in WRITERS:
        mission = read_mission(tmp_path / "out" / f"path{suffix}")
        name = next(iter(mission.tracks))
        back = mission.tracks[name]
        if suffix == ".geojson":  # for maps: the path as flown, and everybody else's
            assert name == "cna"
            flown = local(mission, back.points)
            np.testing.assert_allclose(flown, run.cna[:, :2], atol=NEAR)
            continue
        np.testing.assert_allclose(local(mission, back.points), track.points, atol=NEAR)
        # a leg's chord over its time is slower than the vehicle by the sagitta's share, (8/3)(s/L)^2
        lengths = np.hypot(*np.diff(track.points, axis=0).T)
        arcs = 8 / 3 * (export.simplified.deviation / lengths) ** 2
        np.testing.assert_array_less(abs(back.speed / track.speed - 1), 0.02 + arcs)
