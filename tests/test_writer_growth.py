"""What is written of a mission takes a time that grows no faster than the mission."""

from time import process_time

import numpy as np
import pytest
from oracles import scenario

import obsplan as op
from obsplan.missions import Mission, Track, writers
from obsplan.report.files import scenario_toml, tracks_csv

FEW, TIMES = 1000, 16  # and as many times more: in a square the time would grow 256-fold
NOISE = 3.0  # of times measured where others are at work
ORIGIN = (47.6, -122.3)


def track(count):
    """Places some metres apart, in degrees, and when they are passed."""
    places = np.random.default_rng(1).uniform(-1e-5, 1e-5, (count, 2)).cumsum(axis=0)
    return Track(
        points=np.array(ORIGIN) + places,
        time=10.0 * np.arange(count),
        speed=np.ones(count - 1),
    )


def growth(write, few, many):
    """How many times longer it takes to write more."""
    write(few)  # what is loaded and built at first use
    begun = process_time()
    write(few)
    between = process_time()
    write(many)
    return (process_time() - between) / (between - begun)


@pytest.mark.slow
@pytest.mark.parametrize("name", writers.__all__)
def test_path_file_takes_a_time_in_proportion_to_its_points(name, tmp_path):
    write = getattr(writers, name)
    few, many = (
        Mission(tracks={"cna": track(count)}, geographic=True) for count in (FEW, TIMES * FEW)
    )
    place = {"origin": ORIGIN} if name in ("write_csv", "write_moos") else {}
    assert growth(lambda mission: write(tmp_path / "path", mission, **place), few, many) < (
        NOISE * TIMES
    )


def flown(**change):
    """A short mission's run."""
    return op.simulate(scenario(planner__kind="stationary", **change))


@pytest.mark.slow
def test_scenario_takes_a_time_in_proportion_to_its_waypoints():
    def run(count):
        points = 10.0 * np.random.default_rng(1).uniform(size=(count, 2))
        return flown(auv__0__survey__points=points.tolist(), duration=1.0)

    assert growth(scenario_toml, run(FEW), run(TIMES * FEW)) < NOISE * TIMES


def test_tracks_take_a_time_in_proportion_to_their_samples():
    few, many = (flown(duration=0.5 * count) for count in (FEW, TIMES * FEW))
    assert growth(tracks_csv, few, many) < NOISE * TIMES


def test_time_that_grows_with_the_square_is_noticed():
    """Negative control."""
    square = lambda count: np.subtract.outer(np.arange(count), np.arange(count)).sum()  # noqa: E731
    assert growth(square, 200, TIMES * 200) > NOISE * TIMES
