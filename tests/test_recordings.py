"""The recordings that ship: as they were written, and what docs/recordings.md says of them."""

import hashlib
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import least_squares

SHIPPED = Path(str(files("obsplan") / "recordings"))
PLAZA = ("plaza1", "plaza2")
GOATS = ("goats15", "goats16")
ROWS = {"plaza1": (9658, 3529, 4), "plaza2": (4091, 1816, 4)}
ROWS |= {"goats15": (473, 786, 3), "goats16": (201, 572, 4)}

every_recording = pytest.mark.parametrize("name", ROWS)


def read(name, file):
    path = SHIPPED / name / f"{file}.csv"
    return np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")


def dead_reckoned(name, turn, heading):
    """Go on from where the truth begins, each step on its arc; east and north [m]."""
    odometry, truth = read(name, "odometry"), read(name, "truth")
    left = odometry["left_m"] if "left_m" in odometry.dtype.names else np.zeros(len(odometry))
    after = heading + np.cumsum(turn)
    middle = after - 0.5 * turn
    chord = np.sinc(0.5 * turn / np.pi) * np.exp(1j * middle)
    place = np.cumsum((odometry["forward_m"] + 1j * left) * chord)
    return truth["east_m"][0] + place.real, truth["north_m"][0] + place.imag


def rms_from_truth(name, turn, heading):
    truth = read(name, "truth")
    east, north = dead_reckoned(name, turn, heading)
    return float(np.sqrt(np.mean((east - truth["east_m"]) ** 2 + (north - truth["north_m"]) ** 2)))


def distances(name, east=None, north=None):
    """Give the true distance of each range's sender where it was received, and its number."""
    ranges, beacons, truth = (read(name, file) for file in ("ranges", "beacons", "truth"))
    east = truth["east_m"] if east is None else east
    north = truth["north_m"] if north is None else north
    at = np.interp(ranges["received_s"], truth["time_s"], np.arange(len(truth)))
    places = {row["name"]: complex(row["east_m"], row["north_m"]) for row in beacons}
    sender = np.array([places[one] for one in ranges["sender"]])
    step = np.arange(len(truth))
    return np.abs(np.interp(at, step, east) + 1j * np.interp(at, step, north) - sender)


def test_tables_are_as_the_script_wrote_them():
    listed = dict(line.split()[::-1] for line in (SHIPPED / "SHA256SUMS").read_text().splitlines())
    shipped = {path.relative_to(SHIPPED).as_posix(): path for path in SHIPPED.glob("*/*.csv")}
    assert {
        name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in shipped.items()
    } == listed
    assert sum(path.stat().st_size for path in shipped.values()) < 2_000_000


@every_recording
def test_nothing_of_the_source_is_left_out(name):
    tables = [read(name, file) for file in ("odometry", "ranges", "beacons", "truth")]
    assert [len(table) for table in tables[:3]] == list(ROWS[name])
    assert len(tables[3]) == len(tables[0])
    assert set(tables[1]["sender"]) == set(tables[2]["name"])


@every_recording
def test_recording_says_whose_it_is_and_begins_where_the_truth_does(name):
    table = tomllib.loads((SHIPPED / name / "recording.toml").read_text(encoding="utf-8"))
    truth = read(name, "truth")
    first = table["auv"][0]["first_estimate"]
    assert table["name"] == name
    assert all(table[key] for key in ("source", "attribution", "citation"))
    assert "LICENSE-GTSAM" in table["licence"]
    assert first["x"] == pytest.approx(truth["east_m"][0], abs=0.01)
    assert first["y"] == pytest.approx(truth["north_m"][0], abs=0.01)
    heading = np.degrees(truth["heading_rad"][0])
    assert first["heading_deg"] == pytest.approx(heading, abs=0.06)
    assert "Redistributions in binary form" in (SHIPPED / "LICENSE-GTSAM").read_text()


@pytest.mark.parametrize(("name", "most"), [("plaza1", 2.0), ("goats15", 0.02), ("goats16", 0.02)])
def test_odometry_leads_along_the_truth(name, most):
    turn, heading = read(name, "odometry")["turn_rad"], read(name, "truth")["heading_rad"][0]
    assert rms_from_truth(name, turn, heading) < most
    assert rms_from_truth(name, turn, heading + np.pi) > 10.0 * most
    assert rms_from_truth(name, -turn, heading) > 10.0 * most


def test_turns_of_plaza2_are_the_true_ones_short_by_a_scale_and_a_drift():
    turn, heading = read("plaza2", "odometry")["turn_rad"], read("plaza2", "truth")["heading_rad"]
    true = np.diff(np.unwrap(heading))
    scale, drift = np.polyfit(true, turn[1:], 1)
    assert scale == pytest.approx(0.985, abs=1e-4)
    assert drift == pytest.approx(-6.97e-4, abs=1e-6)
    assert np.abs(scale * true + drift - turn[1:]).max() < 2e-5
    assert rms_from_truth("plaza2", turn, heading[0]) > 25.0
    assert rms_from_truth("plaza2", np.r_[0.0, true], heading[0]) < 3.0


@pytest.mark.parametrize("name", PLAZA)
def test_ranges_of_plaza_are_seven_percent_too_long_from_every_beacon(name):
    ranges, distance = read(name, "ranges"), distances(name)
    error = ranges["range_m"] - distance
    slope, offset = np.polyfit(distance, error, 1)
    left = error - offset - slope * distance
    assert slope == pytest.approx(0.0695, abs=3e-4)
    assert abs(offset) < 0.05
    assert left.std() == pytest.approx(0.55, abs=0.02)
    assert np.abs(left).max() < 2.0
    for beacon in set(ranges["sender"]):
        own = ranges["sender"] == beacon
        slope, offset = np.polyfit(distance[own], error[own], 1)
        assert slope == pytest.approx(0.0695, abs=0.002)
        assert abs(offset) < 0.15


@pytest.mark.parametrize(("name", "spread", "far"), [("goats15", 3.6, 1), ("goats16", 7.0, 2)])
def test_reference_of_goats_lies_where_ranges_fit_best(name, spread, far):
    truth, measured = read(name, "truth"), read(name, "ranges")["range_m"]
    place = truth["east_m"] + 1j * truth["north_m"]

    def misfit(shift):
        moved = place[0] + complex(*shift[:2]) + (place - place[0]) * np.exp(1j * shift[2])
        return measured - distances(name, moved.real, moved.imag)

    best = least_squares(misfit, np.zeros(3), loss="soft_l1", f_scale=2.0, x_scale=[1, 1, 0.01])
    assert np.abs(best.x[:2]).max() < 0.2
    assert abs(best.x[2]) < 5e-4
    error = misfit(np.zeros(3))
    median = np.median(error)
    assert 1.4826 * np.median(np.abs(error - median)) == pytest.approx(spread, abs=0.15)
    assert np.sum(np.abs(error) > 20.0) == far
