"""Claims about uploading a waypoint file, item by item, to a vehicle that stores so many and no more."""

import numpy as np
import pytest
from mavlink_vehicle import ACCEPTED, NO_SPACE, assert_stored_as_in, figures, upload
from missions import POINTS, degrees, full_mission

from obsplan.missions import Track, write_waypoints
from obsplan.missions.export import simplify
from obsplan.missions.flown_path import Allowance


def test_a_vehicle_stores_the_file_item_by_item(tmp_path):
    write_waypoints(tmp_path / "a.waypoints", full_mission())
    answer, stored, sent = upload(tmp_path / "a.waypoints", room=500)
    assert answer == ACCEPTED
    assert len(stored) == len(sent) == 8
    np.testing.assert_allclose(figures(stored), figures(sent), rtol=1e-6)  # floats of four bytes
    assert_stored_as_in(tmp_path / "a.waypoints", stored)


def test_a_vehicle_without_room_refuses_and_stores_nothing(tmp_path):
    write_waypoints(tmp_path / "a.waypoints", full_mission())
    answer, stored, _ = upload(tmp_path / "a.waypoints", room=7)
    assert answer == NO_SPACE
    assert stored == []


@pytest.mark.slow
@pytest.mark.parametrize("room", [500, 40])
def test_what_is_simplified_to_a_vehicles_room_fits_it(tmp_path, room):
    turns = np.linspace(0.0, 40.0, 1601)
    spiral = 4.0 * (5.0 + turns[:, None]) * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    time = np.append(0.0, np.cumsum(np.hypot(*np.diff(spiral, axis=0).T))) / 2.0
    mission = simplify(Track(points=spiral, time=time), Allowance(items=room, tolerance=0.1))
    geographic = Track(
        points=degrees(mission.track.points), speed=mission.track.speed, time=mission.track.time
    )
    write_waypoints(tmp_path / "a.waypoints", full_mission(tracks={"cna": geographic}))
    answer, stored, _ = upload(tmp_path / "a.waypoints", room=room)
    assert answer == ACCEPTED
    assert len(stored) == mission.items <= room
    assert upload(tmp_path / "a.waypoints", room=mission.items - 1)[0] == NO_SPACE
    assert len(POINTS) < mission.items
