"""Claims about mission files that are written."""

import math
import os
from itertools import pairwise

import numpy as np
import pyogrio
import pytest
import shapely
from pymavlink.mavwp import MAVWPLoader

from obsplan import geo
from obsplan.files import write_atomically
from obsplan.missions import Mission, Track, read_mission, write_geojson, write_waypoints
from obsplan.types import ObsplanError

ORIGIN = (47.629, -122.337)
TRACK = [(47.629, -122.337), (47.631, -122.337), (47.631, -122.336)]
SPIRAL = np.array(
    [((10 + t) * math.cos(t), (10 + t) * math.sin(t)) for t in np.linspace(0, 30, 3000)]
)


def one(latlon, name="cna"):
    """A mission of one geographic track."""
    return Mission(tracks={name: Track(points=latlon)}, geographic=True)


def test_gdal_reads_our_geojson_back(tmp_path):
    path = tmp_path / "path.geojson"
    spiral = geo.to_geographic(SPIRAL, ORIGIN)
    write_geojson(
        path,
        Mission(
            tracks={
                "cna": Track(points=spiral),
                "alpha": Track(points=np.array(TRACK)),
                "still": Track(points=np.array(TRACK[:1])),
            },
            geographic=True,
        ),
    )
    meta, _, geometry, fields = pyogrio.raw.read(path)
    assert meta["crs"] == "EPSG:4326"
    assert fields[list(meta["fields"]).index("name")].tolist() == ["cna", "alpha", "still"]
    lines = [shapely.get_coordinates(shapely.from_wkb(wkb))[:, ::-1] for wkb in geometry]
    np.testing.assert_allclose(geo.to_local(lines[0], ORIGIN), SPIRAL, rtol=0, atol=1e-3)
    np.testing.assert_allclose(lines[1], TRACK, rtol=0, atol=1e-9)
    np.testing.assert_allclose(lines[2], TRACK[:1], rtol=0, atol=1e-9)


def test_what_geojson_writes_it_reads(tmp_path):
    mission = Mission(
        tracks={
            "cna": Track(points=geo.to_geographic(SPIRAL, ORIGIN)),
            "älpha": Track(points=np.array(TRACK)),
        },
        geographic=True,
    )
    write_geojson(tmp_path / "a.geojson", mission)
    back = read_mission(tmp_path / "a.geojson").tracks
    assert list(back) == ["cna", "älpha"]
    np.testing.assert_allclose(back["cna"].points, mission.tracks["cna"].points, rtol=0, atol=1e-9)


def load_waypoints(path):
    """Home and waypoints [degrees], as pymavlink reads them."""
    loader = MAVWPLoader()
    items = [loader.wp(i) for i in range(loader.load(str(path)))]
    assert [item.seq for item in items] == list(range(len(items)))
    assert [item.frame for item in items] == [0] + [3] * (len(items) - 1)
    assert [item.current for item in items] == [1] + [0] * (len(items) - 1)
    assert {(item.command, item.z, item.autocontinue) for item in items} == {(16, 0.0, 1)}
    return np.array([(item.x, item.y) for item in items])


@pytest.mark.parametrize("tolerance", [0.0, 0.05, 0.5])
def test_pymavlink_reads_our_waypoints_back_within_the_tolerance(tmp_path, tolerance):
    path = tmp_path / "path.waypoints"
    count = write_waypoints(path, one(geo.to_geographic(SPIRAL, ORIGIN)), tolerance=tolerance)
    home, *back = geo.to_local(load_waypoints(path), ORIGIN)
    assert count == len(back)
    np.testing.assert_allclose(home, SPIRAL[0], atol=1e-3)
    np.testing.assert_allclose([back[0], back[-1]], SPIRAL[[0, -1]], atol=1e-3)
    distance = shapely.distance(shapely.points(SPIRAL), shapely.LineString(back))
    assert distance.max() <= tolerance + 1e-3
    assert count == 3000 if tolerance == 0 else count < 400


def test_straight_legs_need_only_their_corners(tmp_path):
    legs = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]])
    dense = np.vstack([np.linspace(a, b, 200) for a, b in pairwise(legs)])
    assert write_waypoints(tmp_path / "a.waypoints", one(geo.to_geographic(dense, ORIGIN))) == 3
    np.testing.assert_allclose(
        geo.to_local(load_waypoints(tmp_path / "a.waypoints"), ORIGIN)[1:], legs, atol=1e-3
    )


def test_a_vehicle_that_stays_put_has_one_waypoint(tmp_path):
    assert write_waypoints(tmp_path / "a.waypoints", one(np.tile(ORIGIN, (50, 1)))) == 1
    np.testing.assert_allclose(
        load_waypoints(tmp_path / "a.waypoints"), [ORIGIN, ORIGIN], atol=1e-9
    )


@pytest.mark.parametrize(
    ("write", "mission", "message"),
    [
        (
            write_geojson,
            Mission(tracks={"a": Track(points=SPIRAL)}, geographic=False),
            "got local tracks: convert them",
        ),
        (
            write_waypoints,
            Mission(tracks={"a": Track(points=SPIRAL)}, geographic=False),
            "one geographic track, got 1 local",
        ),
        (
            write_waypoints,
            Mission(tracks={"a": Track(points=SPIRAL), "b": Track(points=SPIRAL)}, geographic=True),
            "one geographic track, got 2 geographic",
        ),
    ],
)
def test_writers_refuse_what_their_format_cannot_hold(tmp_path, write, mission, message):
    with pytest.raises(ValueError, match=message):
        write(tmp_path / "a", mission)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("tolerance", [-1.0, math.nan, math.inf])
def test_waypoints_refuse_a_tolerance_that_is_not_one(tmp_path, tolerance):
    with pytest.raises(ValueError, match=r"tolerance must be at least 0 \[m\] and finite, got"):
        write_waypoints(tmp_path / "a.waypoints", one(np.array(TRACK)), tolerance=tolerance)


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    write_atomically(path, "one\r\n")
    with (
        open(path, "rb") as earlier
    ):  # a reader who came before keeps what it opened: the file was replaced, not overwritten
        write_atomically(path, b"two\n")
        assert earlier.read() == b"one\r\n"
    assert path.read_bytes() == b"two\n"

    def full(self, content):
        with open(self, "wb") as file:
            file.write(content[:2])
        raise OSError(28, os.strerror(28))

    monkeypatch.setattr("pathlib.Path.write_bytes", full)
    with pytest.raises(
        ObsplanError,
        match=r"a.txt cannot be written \(No space left on device\): choose another folder",
    ):
        write_atomically(path, "three")
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_bytes() == b"two\n"


def test_a_folder_that_is_not_there_or_is_a_file_is_our_error(tmp_path):
    (tmp_path / "file").write_text("")
    for folder in ("nowhere", "file"):
        with pytest.raises(ObsplanError, match="cannot be written"):
            write_atomically(tmp_path / folder / "a.txt", "x")
