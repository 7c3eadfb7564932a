"""Recorded logs are read as what they say: motion, ranges, places, times, and what was left out."""

import csv
import datetime
import sys

import numpy as np
import pymap3d
import pytest

import obsplan as op
from obsplan.fates import Fate
from obsplan.replay import read, write_recording
from obsplan.sensors import BEACON

RADIUS, RATE, STEP = 30.0, 0.05, 0.5  # a circle [m], [rad/s], an odometry row each [s]
BEACONS = {"A": (50.0, 0.0), "B": (-40.0, 30.0)}
FIRST = "[[auv]]\nfirst_estimate = {{ x = {}, y = {}, heading_deg = {} }}\n"


def circle(time):
    """On the circle about the origin from its lowest point on, counter-clockwise."""
    turned = RATE * np.asarray(time) - np.pi / 2
    return np.column_stack([RADIUS * np.cos(turned), RADIUS * np.sin(turned), turned + np.pi / 2])


def write(folder, name, header, rows, *, comma=",", point=".", end="\n", mark=""):
    text = [header.replace(",", comma)]
    for row in rows:
        text.append(comma.join(str(cell).replace(".", point) for cell in row))
    (folder / name).write_bytes((mark + end.join(text) + end).encode())


def circling(folder, *, duration=120.0, toml=None, truth=True):
    """A vehicle on the circle that measures the distance to one of two beacons every 5 s."""
    time = np.arange(0.0, duration + STEP / 2, STEP)
    chord = 2 * RADIUS * np.sin(RATE * STEP / 2)
    rows = [(t, chord if t else 0.0, RATE * STEP if t else 0.0) for t in time]
    write(folder, "odometry.csv", "time_s,forward_m,turn_rad", rows)
    write(folder, "beacons.csv", "name,east_m,north_m", [(n, *p) for n, p in BEACONS.items()])
    received = np.arange(5.123, duration, 5.0)
    ranges = []
    for k, at in enumerate(received):
        name = "AB"[k % 2]
        ranges.append((at, name, np.hypot(*(circle([at])[0, :2] - BEACONS[name]))))
    write(folder, "ranges.csv", "received_s,sender,range_m", ranges)
    if truth:
        rows = [(t, *place) for t, place in zip(time, circle(time)[:, :2], strict=True)]
        write(folder, "truth.csv", "time_s,east_m,north_m", rows)
    told = FIRST.format(0.0, -RADIUS, 0.0) if toml is None else toml
    (folder / "recording.toml").write_text(told)
    return received


def reckoned(recording, auv=0):
    """Dead reckoning over the tape from the first estimate: east, north, heading, speed."""
    tape, first = recording.tape, recording.scenario.table.auv[auv].first_estimate
    east, north, speed = first.x, first.y, first.speed
    heading = np.deg2rad(first.heading_deg)
    states = [(east, north, heading, speed)]
    for k, dt in enumerate(np.diff(tape.time)):
        ahead, left = speed * dt, tape.sway[auv, k]
        east += ahead * np.cos(heading) - left * np.sin(heading)
        north += ahead * np.sin(heading) + left * np.cos(heading)
        heading, speed = heading + tape.turn[auv, k], speed + tape.change_of_speed[auv, k]
        states.append((east, north, heading, speed))
    return np.array(states)


def test_dead_reckoning_over_the_tape_follows_odometry_through_a_curve(tmp_path):
    received = circling(tmp_path)
    recording = read(tmp_path)
    tape = recording.tape
    whole = np.isin(tape.time, np.arange(0.0, 120.1, STEP))
    assert tape.time.size > whole.sum()  # measurements lie between
    np.testing.assert_allclose(
        reckoned(recording)[whole, :2], circle(tape.time[whole])[:, :2], atol=1e-9
    )
    np.testing.assert_allclose(tape.measurements.received, received)
    assert np.isin(tape.measurements.received, tape.time).all()
    assert np.abs(tape.sway).max() < 1e-12
    assert recording.scenario.time[-1] == tape.time[-1] == 120.0
    assert set(recording.scenario.time) <= set(tape.time)


def test_a_table_says_the_same_however_it_is_written(tmp_path):
    one, other = tmp_path / "one", tmp_path / "other"
    for folder in (one, other):
        folder.mkdir()
        circling(folder)
    for path in other.glob("*.csv"):
        with path.open() as file:
            header, *rows = csv.reader(file)
        if header[0] != "name":  # beacons keep their order
            rows = rows[::-1]
        header = [name.replace("_s", " [s]").replace("_m", " (m)").upper() for name in header]
        write(
            other,
            path.name,
            ",".join(header),
            [[""] * len(header), *rows],
            comma=";",
            point=",",
            end="\r\n",
            mark="\ufeff",
        )
    first, second = read(one), read(other)
    for name in ("time", "turn", "change_of_speed", "sway", "pose", "truth"):
        np.testing.assert_array_equal(getattr(first.tape, name), getattr(second.tape, name))
    np.testing.assert_array_equal(first.tape.measurements.value, second.tape.measurements.value)
    assert any("order" in note for note in second.notes)


def moving(folder, header, rows, toml=""):
    """A vehicle at rest at the origin, and a beacon that sails east at 2 m/s."""
    write(folder, "odometry.csv", "time_s,forward_m,turn_deg", [(t, 0, 0) for t in range(101)])
    track = [("boat", t, 2.0 * t, 100.0, 7.0) for t in range(0, 101, 10)]
    write(folder, "beacons.csv", "name,time_s,east_m,north_m,depth_m", track)
    write(folder, "ranges.csv", header, rows)
    (folder / "recording.toml").write_text(toml + FIRST.format(0, 0, 0))
    return read(folder)


@pytest.mark.parametrize(
    ("column", "told"),
    [
        ("range_m", lambda away: 1480.0 * away),
        ("one_way_s", lambda away: away),
        ("two_way_s", lambda away: 2 * away + 0.5),
    ],
)
def test_travel_times_are_distances_and_beacons_are_where_they_were_when_they_sent(
    tmp_path, column, told
):
    away = np.array([0.1, 0.2, 3.0])  # [s]
    rows = [(50.0 + k, "boat", told(a)) for k, a in enumerate(away)]
    toml = "sound_speed = 1480.0\nturn_around = 0.5\n"
    measured = moving(tmp_path, f"received_s,sender,{column}", rows, toml).tape.measurements
    sent = 50.0 + np.arange(3) - away
    np.testing.assert_allclose(measured.value, 1480.0 * away)
    np.testing.assert_allclose(measured.sent, sent)
    np.testing.assert_allclose(measured.told[:, 0], 2.0 * sent)
    np.testing.assert_allclose(measured.told[:, 1], 100.0)
    np.testing.assert_allclose(measured.told[:, BEACON.index("depth")], 7.0)
    velocities = [BEACON.index(name) for name in ("east_velocity", "north_velocity")]
    assert not measured.told[:, velocities].any()


def test_times_of_sending_that_are_told_are_taken(tmp_path):
    rows = [(50.0, 31.0, "boat", 10.0)]
    measured = moving(tmp_path, "received_s,sent_s,sender,range_m", rows).tape.measurements
    assert measured.told[0, 0] == 62.0


def test_a_beacon_that_moves_is_an_aid_vehicle_and_comes_before_those_that_do_not(tmp_path):
    moving(tmp_path, "received_s,sender,range_m", [(50.0, "boat", 10.0)])
    rows = [("moored", "", 5, 6, 0), *(("boat", t, 2 * t, 100, 0) for t in (0, 100))]
    write(tmp_path, "beacons.csv", "name,time_s,east_m,north_m,depth_m", rows)
    recording = read(tmp_path)
    assert recording.tape.beacons == ("boat", "moored")
    carriers = [beacon.carrier for beacon in recording.scenario.beacons]
    assert carriers == [0, None]
    assert [beacon.name for beacon in recording.scenario.beacons] == ["boat", "moored"]
    assert recording.scenario.situation.ranged
    assert recording.scenario.cna.speed == pytest.approx(2.0)
    np.testing.assert_allclose(recording.tape.pose[0, -1], [200.0, 100.0, 0.0])


def test_where_no_beacon_moves_nobody_ranges_to_the_aid_vehicle(tmp_path):
    circling(tmp_path)
    recording = read(tmp_path)
    assert [beacon.name for beacon in recording.scenario.beacons] == ["A", "B"]
    assert recording.tape.beacons == ("A", "B")
    assert any("nobody ranges to" in note for note in recording.notes)


def test_places_in_degrees_are_local_about_the_origin(tmp_path):
    circling(tmp_path)
    rows = [("A", 47.6001, -122.3), ("B", 47.6, -122.3002)]
    write(tmp_path, "beacons.csv", "name,lat_deg,lon_deg", rows)
    toml = "origin = { lat = 47.6, lon = -122.3 }\n" + FIRST.format(0, -RADIUS, 0)
    (tmp_path / "recording.toml").write_text(toml)
    found = read(tmp_path).tape.pose[:, 0, :2]
    east, north, _ = pymap3d.geodetic2enu(
        [47.6001, 47.6], [-122.3, -122.3002], 0.0, 47.6, -122.3, 0.0
    )
    np.testing.assert_allclose(found, np.column_stack([east, north]), atol=1e-9)


@pytest.mark.parametrize("iso", [True, False])
def test_absolute_times_give_the_time_of_time_zero(tmp_path, iso):
    circling(tmp_path)
    begin = datetime.datetime(2024, 5, 1, 12, tzinfo=datetime.UTC)
    for path in tmp_path.glob("*.csv"):
        with path.open() as file:
            header, *rows = csv.reader(file)
        if header[0] == "name":
            continue
        for row in rows:
            at = begin + datetime.timedelta(seconds=float(row[0]))
            row[0] = at.isoformat() if iso else f"{at.timestamp():.6f}"
        write(tmp_path, path.name, ",".join(header), rows)
    recording = read(tmp_path)
    assert recording.start == begin
    assert recording.tape.time[-1] == 120.0
    assert recording.tape.measurements.received[0] == pytest.approx(5.123, abs=1e-6)


def test_ranges_between_vehicles_are_to_the_others_estimate(tmp_path):
    rows = [(t, name, 0.5, 0.0) for t in range(60) for name in ("one", "two")]
    write(tmp_path, "odometry.csv", "time_s,vehicle,forward_m,turn_rad", rows)
    write(tmp_path, "beacons.csv", "name,east_m,north_m", [("A", 50, 0)])
    rows = [(10, "one", "A", 50), (20, "two", "one", 30), (30, "two", "two", 1)]
    write(tmp_path, "ranges.csv", "received_s,vehicle,sender,range_m", rows)
    recording = read(tmp_path)
    measured = recording.tape.measurements
    assert recording.tape.auvs == ("one", "two")
    assert measured.auv.tolist() == [0, 1]
    assert measured.beacon.tolist() == [0, 1]  # one beacon, then AUVs
    assert np.isfinite(measured.told[0]).all()
    assert np.isnan(measured.told[1]).all()
    assert [one.fate for one in recording.discarded] == [Fate.UNKNOWN_BEACON]


def test_what_no_filter_can_take_is_kept_apart_with_its_reason(tmp_path):
    rows = [
        *((50.0, "boat", 10.0), (50.0, "boat", 10.0)),  # twice: for the filter to tell
        *((60.0, "ghost", 10.0), (61.0, "boat", -3.0), (62.0, "boat", "nan")),
        *((0.001, "boat", 15.0), (500.0, "boat", 15.0), ("", "boat", 15.0)),
    ]
    recording = moving(tmp_path, "received_s,sender,range_m", rows)
    assert recording.tape.measurements.value.tolist() == [10.0, 10.0]
    found = sorted((one.sender, int(one.fate), one.value) for one in recording.discarded)
    expected = [
        ("boat", Fate.NO_ESTIMATE, 15.0),
        ("boat", Fate.OUT_OF_ORDER, 15.0),
        ("boat", Fate.UNKNOWN_BEACON, 15.0),  # sent before its track begins
        ("boat", Fate.NO_DISTANCE, -3.0),
        ("boat", Fate.NO_DISTANCE, np.nan),
        ("ghost", Fate.UNKNOWN_BEACON, 10.0),
    ]
    assert str(found) == str(sorted((name, int(fate), value) for name, fate, value in expected))
    said = " ".join(recording.notes)
    assert '1 of 8 ranges left out: from a sender whose place is not recorded ("ghost" 1)' in said


def test_speed_and_compass_are_motion_and_readings(tmp_path):
    circling(tmp_path, truth=False, toml="declination_deg = 5.0\n" + FIRST.format(0, -30, 0))
    (tmp_path / "odometry.csv").unlink()
    time = np.arange(0.0, 120.1, STEP)
    compass = (90.0 - np.rad2deg(RATE * time) - 5.0) % 360.0
    rows = [(t, RADIUS * RATE, c) for t, c in zip(time, compass, strict=True)]
    write(tmp_path, "speed.csv", "time_s,speed_m_s,compass_deg", rows)
    recording = read(tmp_path)
    states = reckoned(recording)
    # arcs as chords of the same length: off by a 24th of the turn's square
    np.testing.assert_allclose(
        states[:, :2], circle(recording.tape.time)[:, :2], atol=60 * (RATE * STEP) ** 2 / 24 + 0.01
    )
    read_at = np.isfinite(recording.tape.heading[0])
    off = recording.tape.heading[0, read_at] - states[1:, 2][read_at]
    np.testing.assert_allclose(np.angle(np.exp(1j * off)), 0.0, atol=1e-9)
    assert read_at.sum() == time.size - 1  # each reading once; the first is the first estimate's


def test_turn_rates_are_added_up(tmp_path):
    circling(tmp_path, truth=False)
    (tmp_path / "odometry.csv").unlink()
    rows = [(t, RADIUS * RATE, RATE) for t in np.arange(0.0, 120.1, STEP)]
    write(tmp_path, "speed.csv", "time_s,speed_m_s,turn_rate_rad_s", rows)
    recording = read(tmp_path)
    expected = circle(recording.tape.time)[:, :2]
    np.testing.assert_allclose(reckoned(recording)[:, :2], expected, atol=0.02)
    assert np.isnan(recording.tape.heading).all()


def test_a_slow_compass_is_carried_to_the_heading_that_the_model_holds(tmp_path):
    circling(tmp_path)
    at = np.arange(0.37, 120.0, 3.1)
    rows = [(t, heading) for t, heading in zip(at, circle(at)[:, 2], strict=True)]
    write(tmp_path, "heading.csv", "time_s,heading_rad", rows)
    recording = read(tmp_path)
    heading, model = recording.tape.heading[0], reckoned(recording)[1:, 2]
    assert np.isfinite(heading).sum() == at.size
    off = np.angle(np.exp(1j * (heading - model)))
    np.testing.assert_allclose(off[np.isfinite(heading)], 0.0, atol=1e-9)


def test_what_odometry_lacks_is_moved_as_before_and_said(tmp_path):
    circling(tmp_path)
    with (tmp_path / "odometry.csv").open() as file:
        header, *rows = csv.reader(file)
    rows[50][1] = rows[51][2] = "nan"
    rows = [*rows[:100], rows[99], *rows[100:]]
    write(tmp_path, "odometry.csv", ",".join(header), rows)
    recording = read(tmp_path)
    tape = recording.tape
    np.testing.assert_allclose(
        reckoned(recording)[:, :2], circle(tape.time)[:, :2], atol=RADIUS * (RATE * STEP) ** 2
    )
    said = " ".join(recording.notes)
    assert "2 rows without numbers" in said
    assert "1 row that repeat another" in said


@pytest.mark.parametrize("truth", [True, False])
@pytest.mark.parametrize(
    ("heading", "turn", "words"),
    [
        (0.0, 1.0, ""),
        (180.0, 1.0, "half a turn off"),
        (0.0, -1.0, "mirrored"),
        (90.0, 1.0, "a quarter turn off, to the left"),
    ],
)
def test_headings_that_look_wrong_are_said(tmp_path, truth, heading, turn, words):
    circling(tmp_path, truth=truth, toml=FIRST.format(0, -RADIUS, heading))
    with (tmp_path / "odometry.csv").open() as file:
        header, *rows = csv.reader(file)
    rows = [(t, forward, turn * float(by)) for t, forward, by in rows]
    write(tmp_path, "odometry.csv", ",".join(header), rows)
    said = [note for note in read(tmp_path).notes if note.startswith("headings of")]
    assert len(said) == bool(words)
    assert words in "".join(said)


@pytest.mark.parametrize("truth", [True, False])
def test_the_survey_is_the_track_at_its_speeds(tmp_path, truth):
    circling(tmp_path, duration=400.0, truth=truth)  # three times round
    recording = read(tmp_path)
    reference = recording.scenario.references[0]
    # chords that are 0.42 m off turn by 0.34 rad each; the thinning may take twice as many
    assert len(reference.polyline) <= 2 * 20.0 / 0.34
    assert reference.duration == pytest.approx(400.0, abs=1e-6)
    at = np.arange(0.0, 400.0)
    off = reference.position(at) - circle(at)[:, :2]
    # half a percent of the extent beside the track, and chords are slower than arcs by little
    assert np.hypot(*off.T).max() < 0.02 * 2 * RADIUS


def test_without_a_first_estimate_the_ranges_say_where_to_begin(tmp_path):
    circling(tmp_path, toml="")
    recording = read(tmp_path)
    first = recording.scenario.table.auv[0].first_estimate
    assert np.hypot(first.x, first.y + RADIUS) < 2 * np.sqrt(2) * first.sigma_position
    assert first.sigma_heading_deg > 90
    assert any("no first position" in note for note in recording.notes)
    assert any("no first heading" in note for note in recording.notes)


def test_the_truth_is_where_to_begin_if_that_is_asked_for(tmp_path):
    circling(tmp_path, toml='first_estimate = "truth"\n')
    first = read(tmp_path).scenario.table.auv[0].first_estimate
    assert (first.x, first.y) == pytest.approx((0.0, -RADIUS))


def test_keys_of_the_scenario_have_the_last_word(tmp_path):
    more = "\n[ranging]\nsigma = 0.3\n[cna]\nspeed = 3.0\n"
    extra = 'licence = "BSD"\nattribution = "someone"\ntime_step = 0.25\n'
    circling(tmp_path, toml=extra + FIRST.format(1.0, 2.0, 0.0) + "depth = 3.0\n" + more)
    recording = read(tmp_path)
    table = recording.scenario.table
    assert (table.ranging.sigma, table.cna.speed, table.time_step) == (0.3, 3.0, 0.25)
    assert (table.auv[0].depth, table.auv[0].first_estimate.x) == (3.0, 1.0)
    assert (recording.licence, recording.attribution) == ("BSD", "someone")


GRAPH = """\
VERTEX_SE2 0.0 A0 0.0 0.0 0.0
VERTEX_SE2 1.0 A1 1.0 0.0 1.5707963
VERTEX_SE2 2.0 A2 1.0 2.0 1.5707963
VERTEX_SE2 0.0 B0 9.0 9.0 0.0
VERTEX_SE2 1.0 B1 10.0 9.0 0.0
VERTEX_SE2 2.0 B2 11.0 9.0 0.0
VERTEX_XY L0 5.0 5.0
VERTEX_SE2:PRIOR 0.0 A0 0.5 0.0 0.0 0.04 0.0 0.0 0.04 0.0 0.0001
EDGE_SE2 1.0 A0 A1 1.0 0.0 1.5707963 0.01 0 0 0.01 0 0.001
EDGE_SE2 2.0 A1 A2 2.0 0.0 0.0 0.01 0 0 0.01 0 0.001
EDGE_SE2 1.0 B0 B1 1.0 0.0 0.0 0.01 0 0 0.01 0 0.001
EDGE_SE2 2.0 B1 B2 1.0 0.0 0.0 0.01 0 0 0.01 0 0.001
EDGE_SE2 2.0 A2 A0 0.0 0.0 0.0 0.01 0 0 0.01 0 0.001
EDGE_RANGE 1.0 A1 L0 6.5 0.25
EDGE_RANGE 2.0 B2 A2 12.0 0.09
"""


def test_a_factor_graph_is_read(tmp_path):
    path = tmp_path / "graph.pyfg"
    path.write_text(GRAPH)
    recording = read(path)
    tape, measured = recording.tape, recording.tape.measurements
    states = reckoned(recording)
    np.testing.assert_allclose(states[-1, :2], [1.5, 2.0], atol=1e-6)  # the prior is 0.5 m off
    np.testing.assert_allclose(tape.truth[0, -1, :2], [1.0, 2.0])
    np.testing.assert_allclose(measured.value, [6.5, 12.0])
    np.testing.assert_allclose(measured.sigma, [0.5, 0.3])
    assert (measured.auv.tolist(), measured.beacon.tolist()) == ([0, 1], [0, 1])
    first = recording.scenario.table.auv[0].first_estimate
    assert (first.sigma_position, first.sigma_heading_deg) == pytest.approx((0.2, np.rad2deg(0.01)))
    noise = recording.scenario.table.auv[0].process_noise
    assert (noise.position, noise.heading_deg) == pytest.approx((0.1, np.rad2deg(0.001**0.5)))
    assert any("1 loop closure" in note for note in recording.notes)


def test_poses_in_another_frame_than_the_landmarks_are_no_truth(tmp_path):
    path = tmp_path / "graph.pyfg"
    path.write_text(GRAPH.replace("L0 5.0 5.0", "L0 905.0 5.0"))
    recording = read(path)
    assert recording.tape.truth is None
    assert any("not in the landmarks' frame" in note for note in recording.notes)


def test_a_list_of_one_way_travel_times_is_read_as_the_ranges_of_its_folder(tmp_path):
    circling(tmp_path)
    (tmp_path / "ranges.csv").unlink()
    path = tmp_path / "owtt.csv"
    rows = [(20.0, "A", "auv", 0.02, 30.0), (30.0, "auv", "B", 0.03, 45.0)]
    write(tmp_path, "owtt.csv", "timestamp,src,dest,owtt,measured_range", rows)
    recording = read(path)
    measured = recording.tape.measurements
    np.testing.assert_allclose(measured.value, [30.0, 45.0])
    np.testing.assert_allclose(measured.sent, [19.98, 29.97])
    assert measured.beacon.tolist() == [0, 1]
    assert any("received by beacons" in note for note in recording.notes)


def test_ranging_beacons_of_px4_are_ranges_and_places(tmp_path):
    circling(tmp_path)
    for name in ("ranges.csv", "beacons.csv", "truth.csv"):
        (tmp_path / name).unlink()
    header = "timestamp,timestamp_sample,beacon_id,range,lat,lon,alt,alt_type,range_accuracy"
    rows = [
        (int(1e6 * t), int(1e6 * t), k % 2, 30.0, 47.0 + 1e-3 * (k % 2), 8.0, 400.0, 1, 0.5)
        for k, t in enumerate((20.0, 30.0, 40.0))
    ]
    write(tmp_path, "log_ranging_beacon_0.csv", header, rows)
    recording = read(tmp_path)
    measured = recording.tape.measurements
    assert recording.tape.beacons == ("0", "1")
    assert measured.received.tolist() == [20.0, 30.0, 40.0]
    assert measured.sigma.tolist() == [0.5] * 3
    apart = np.hypot(*(recording.tape.pose[1, 0, :2] - recording.tape.pose[0, 0, :2]))
    assert apart == pytest.approx(111.2, abs=0.1)  # a thousandth of a degree of latitude


TOPICS = """\
[topics]
odometry = { auv = "/auv/odom" }
beacons = { asv = "/asv/fix" }
ranges = { asv = "/range" }
"""


def write_bag(folder):
    """A vehicle that sails north at 1 m/s, a fix and a range a second."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    made = store.types

    def message(kind, t, **fields):
        stamp = made["builtin_interfaces/msg/Time"](sec=1_700_000_000 + t, nanosec=0)
        header = made["std_msgs/msg/Header"](stamp=stamp, frame_id="")
        return kind, made[kind](header=header, **fields)

    def odometry(t):
        vector = made["geometry_msgs/msg/Vector3"]
        turn = made["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=np.sqrt(0.5), w=np.sqrt(0.5))
        place = made["geometry_msgs/msg/Point"](x=0.0, y=float(t), z=0.0)
        pose = made["geometry_msgs/msg/Pose"](position=place, orientation=turn)
        still = vector(x=0.0, y=0.0, z=0.0)
        twist = made["geometry_msgs/msg/Twist"](linear=still, angular=still)
        spread = np.zeros(36)
        return message(
            "nav_msgs/msg/Odometry",
            t,
            child_frame_id="",
            pose=made["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=spread),
            twist=made["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=spread),
        )

    def fix(t):
        status = made["sensor_msgs/msg/NavSatStatus"](status=0, service=1)
        return message(
            "sensor_msgs/msg/NavSatFix",
            t,
            status=status,
            latitude=47.0 + 1e-5 * t,
            longitude=8.0,
            altitude=0.0,
            position_covariance=np.zeros(9),
            position_covariance_type=0,
        )

    def ranged(t):
        limits = {"field_of_view": 0.0, "min_range": 0.0, "max_range": 1e3}
        return message("sensor_msgs/msg/Range", t, radiation_type=0, range=30.0 + t, **limits)

    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, build in (("/auv/odom", odometry), ("/asv/fix", fix), ("/range", ranged)):
            connection = writer.add_connection(topic, build(0)[0], typestore=store)
            for t in range(20):
                kind, content = build(t)
                writer.write(connection, t, store.serialize_cdr(content, kind))
    (folder / "recording.toml").write_text(TOPICS + FIRST.format(0, 0, 90))


def test_a_rosbag_is_read(tmp_path):
    pytest.importorskip("rosbags")
    folder = tmp_path / "bag"
    write_bag(folder)
    for path in (folder, next(folder.glob("*.mcap"))):
        recording = read(path)
        np.testing.assert_allclose(reckoned(recording)[-1, :2], [0.0, 19.0], atol=1e-6)
        assert recording.start == datetime.datetime.fromtimestamp(1.7e9, datetime.UTC)
        measured = recording.tape.measurements
        np.testing.assert_allclose(measured.value, 30.0 + np.arange(1, 20))
        # 1.11 m a second along the meridian, where it was 20 ms before and more
        assert np.polyfit(measured.sent, measured.told[:, 1], 1)[0] == pytest.approx(1.11, abs=0.01)


def test_without_rosbags_a_bag_is_refused_with_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    (tmp_path / "log.mcap").write_bytes(b"\x89MCAP0\r\n")
    (tmp_path / "recording.toml").write_text(TOPICS)
    with pytest.raises(op.ObsplanError, match=r"rosbags is not installed: install it by: pip"):
        read(tmp_path / "log.mcap")


def test_the_tape_of_a_run_is_read_as_it_was_written(tmp_path):
    scenario = op.load("harbor-survey").replace(duration=60.0)
    run = op.simulate(scenario, seed=3)
    tape = op.to_tape(run)
    settings = {"time_step": scenario.table.time_step}
    write_recording(tmp_path, tape, run.mean[:, 0], settings)
    recording = read(tmp_path)
    again = recording.tape
    np.testing.assert_array_equal(again.time, tape.time)
    np.testing.assert_allclose(again.turn, tape.turn, atol=1e-12)
    np.testing.assert_allclose(
        again.change_of_speed[:, :-1], tape.change_of_speed[:, :-1], atol=1e-9
    )
    np.testing.assert_allclose(again.sway, 0.0, atol=1e-9)
    off = again.heading - tape.heading
    np.testing.assert_allclose(np.angle(np.exp(1j * off)), 0.0, atol=1e-9)
    np.testing.assert_allclose(again.measurements.value, tape.measurements.value)
    np.testing.assert_allclose(again.measurements.told[:, :2], tape.measurements.told[:, :2])
    np.testing.assert_allclose(again.pose[..., :2], tape.pose[..., :2])
    np.testing.assert_allclose(again.truth[..., :2], tape.truth[..., :2])
    first = recording.scenario.table.auv[0].first_estimate
    given = [first.x, first.y, np.deg2rad(first.heading_deg), first.speed]
    np.testing.assert_allclose(given, run.mean[0, 0, :4], atol=1e-9)


REFUSED = {
    "a letter among numbers": (
        ("odometry.csv", "time_s,forward_m,turn_rad", [(0, 0, 0), (1, "x1", 0)]),
        r"odometry\.csv: line 3, column forward_m must be a number, got 'x1'",
    ),
    "a leap of a thousand kilometres": (
        ("odometry.csv", "time_s,forward_m,turn_rad", [(0, 0, 0), (1, 1e6, 0)]),
        r"line 3, column forward_m must be from -100000 to 100000 m .* got 1000000\.0: correct it",
    ),
    "no turn": (
        ("odometry.csv", "time_s,forward_m", [(0, 0)]),
        r"odometry\.csv has no column turn_rad or turn_deg, but time_s, forward_m: name it so",
    ),
    "no heading": (
        ("odometry.csv", "0,0,0", [(1, 2, 3)]),
        r"odometry\.csv has no column .*: name it so",
    ),
    "a row alone": (
        ("odometry.csv", "time_s,forward_m,turn_rad", [(0, 0, 0)]),
        r"is 0 s long, and must be more than 0 s .*: look for a time that is wrong",
    ),
    "a year": (
        ("odometry.csv", "time_s,forward_m,turn_rad", [(0, 0, 0), (3e7, 1, 0)]),
        r"is 3e\+07 s long, .* a month: look for a time",
    ),
    "two clocks": (
        ("ranges.csv", "received_s,sender,range_m", [(1.7e9, "A", 3)]),
        r"times of ranges count from 1970 and those of motion do not.*: give all on one clock",
    ),
    "a date that is none": (
        ("ranges.csv", "received_s,sender,range_m", [("2024-13-01T10:00:00", "A", 3)]),
        r"line 2, column received_s must be seconds or a time in ISO 8601",
    ),
    "no sender": (
        ("ranges.csv", "received_s,range_m", [(1, 3)]),
        r"ranges\.csv has no column sender or beacon",
    ),
    "a beacon at two places": (
        ("beacons.csv", "name,east_m,north_m", [("A", 1, 2), ("A", 3, 4)]),
        r'beacons\.csv, beacon "A" has 2 places and no times: give one row, or time_s',
    ),
    "latitude beyond the pole": (
        ("beacons.csv", "name,lat_deg,lon_deg", [("A", 95.0, 8.0)]),
        r"line 2, column lat_deg has latitude 95\.0.*look swapped",
    ),
    "degrees and metres": (
        ("beacons.csv", "name,lat_deg,lon_deg", [("A", 47.0, 8.0)]),
        r"has places in degrees and in metres, and no origin",
    ),
    "a name that is too long": (
        ("ranges.csv", "received_s,sender,range_m", [(1, "A" * 99, 3)]),
        r"line 2, column sender has 'A+', and names have at most 60 letters",
    ),
    "an empty table": (("ranges.csv", "", []), r"ranges\.csv is empty"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_table_that_cannot_be_is_refused_in_a_sentence(tmp_path, case):
    table, words = REFUSED[case]
    circling(tmp_path)
    write(tmp_path, *table)
    with pytest.raises(op.ObsplanError, match=words) as caught:
        read(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("toml", "words"),
    [
        ("sound_speed = 1.0", r"recording\.toml: sound_speed = 1\.0 .* from 1300 to 1700 m/s"),
        ("turn_arround = 1.0", r"recording\.toml: unknown key turn_arround"),
        ('increments = "end"', r"increments = \"end\""),
        ('[[beacon]]\nname = "C"', r'beacon\.0\.name = "C" is not recorded; known are A, B'),
        ("[[auv]]\n[[auv]]\n", r"auv\.1 is one more than the 1 that are recorded: remove it"),
        ("[ranging]\nsigma = -1.0", r"recording\.toml: ranging\.sigma = -1\.0"),
        ("[topics]\nodometry = 3", r"recording\.toml: topics\.odometry"),
    ],
)
def test_a_key_that_cannot_be_is_refused_in_a_sentence(tmp_path, toml, words):
    circling(tmp_path, toml=toml)
    with pytest.raises(op.ObsplanError, match=words) as caught:
        read(tmp_path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("EDGE_RANGE 1.0 A1 L0 6.5", r"line 16 has 4 words after EDGE_RANGE, and 5 are needed"),
        ("EDGE_RANGE 1.0 A1 L0 six 0.25", r"line 16 has the names"),
        ("EDGE_RANGE 1.0 A1 L0 nan 0.25", r"line 16 must be a finite number"),
        ("VERTEX_SE3:QUAT 0 A0 0 0 0 0 0 0 1", r"of a graph in space: project it"),
        ("EDGE_SE2 1.0 B0 B1 1e9 0 0 0 0 0 0 0 0", r"line 16 has 1e\+09, which is too large"),
    ],
)
def test_a_line_of_a_graph_that_cannot_be_is_refused(tmp_path, line, words):
    path = tmp_path / "graph.pyfg"
    path.write_text(GRAPH + line + "\n")
    with pytest.raises(op.ObsplanError, match=words):
        read(path)


def test_what_is_no_recording_is_refused_with_what_is(tmp_path):
    with pytest.raises(op.ObsplanError, match=r"does not exist: give a folder"):
        read(tmp_path / "nowhere")
    with pytest.raises(op.ObsplanError, match=r"has no ranges\.csv, but nothing: name the tables"):
        read(tmp_path)
    (tmp_path / "notes.txt").write_text("hello")
    with pytest.raises(op.ObsplanError, match=r"is no recording that can be read"):
        read(tmp_path / "notes.txt")


def test_several_vehicles_need_their_names_in_every_table(tmp_path):
    rows = [(t, name, 0.5, 0.0) for t in range(60) for name in ("one", "two")]
    circling(tmp_path)
    write(tmp_path, "odometry.csv", "time_s,vehicle,forward_m,turn_rad", rows)
    with pytest.raises(op.ObsplanError, match=r"2 vehicles, and a table without their names"):
        read(tmp_path)


def scaled_ranges(folder, factor):
    """The circling vehicle's ranges, so many times as long."""
    header, *rows = (folder / "ranges.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    write(folder, "ranges.csv", header, [(at, name, factor * float(r)) for at, name, r in cells])


@pytest.mark.parametrize("truth", [True, False])
def test_ranges_that_change_faster_than_vehicles_move_are_said(tmp_path, truth):
    circling(tmp_path, truth=truth)
    assert not any("look like no metres" in note for note in read(tmp_path).notes)
    scaled_ranges(tmp_path, 1000.0)
    assert any("look like no metres" in note for note in read(tmp_path).notes)


def test_ranges_too_long_by_the_truth_are_said(tmp_path):
    circling(tmp_path)
    assert not any("by the truth" in note for note in read(tmp_path).notes)
    scaled_ranges(tmp_path, 1.07)
    assert any("are 7.0 % too long by the truth" in note for note in read(tmp_path).notes)
    scaled_ranges(tmp_path, 0.001)
    assert any("0.00107 times as long" in note for note in read(tmp_path).notes)


def test_a_log_of_which_no_range_can_be_taken_is_refused(tmp_path):
    circling(tmp_path)
    text = (tmp_path / "ranges.csv").read_text()
    (tmp_path / "ranges.csv").write_text(text.replace(",A,", ",C,").replace(",B,", ",C,"))
    with pytest.raises(op.ObsplanError, match=r'none of 23 ranges .* from "C".*not recorded'):
        read(tmp_path)
    (tmp_path / "ranges.csv").write_text(text.splitlines()[0] + "\n")
    assert any("dead reckoning alone" in note for note in read(tmp_path).notes)


def test_a_misspelt_key_of_a_recording_is_told_the_one_that_was_meant(tmp_path):
    circling(tmp_path, toml="sond_speed = 1490.0")
    with pytest.raises(op.ObsplanError, match='did you mean "sound_speed"'):
        read(tmp_path)
