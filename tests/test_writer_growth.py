"""What is written of a mission takes a time that grows no faster than the mission, and less memory.

Memory is what Python and numpy allocate, as tracemalloc counts it.
"""

import tracemalloc
from functools import cache, partial
from time import process_time

import numpy as np
import pytest
from oracles import scenario

import obsplan as op
from obsplan.missions import Mission, Track, writers
from obsplan.missions.export import simplify
from obsplan.missions.flown_path import Allowance
from obsplan.recording import write_netcdf
from obsplan.report.errors import errors_figure
from obsplan.report.export import make_export
from obsplan.report.files import BLOCK, scenario_toml, tracks_csv
from obsplan.report.map import map_figure
from obsplan.report.path_files import map_mission
from obsplan.report.style import png
from obsplan.report.verdict import verdicts

FEW, TIMES = 1000, 64  # and as many times more: in a square the time would grow 4096-fold
NOISE = 5.0  # of times measured where others are at work, and of memory that is looked through
REPEATS = 3  # of the short ones, of which the shortest counts
ORIGIN = (47.6, -122.3)


def track(count):
    """Places some metres apart, in degrees, and when they are passed."""
    places = np.random.default_rng(1).uniform(-1e-5, 1e-5, (count, 2)).cumsum(axis=0)
    return Track(
        points=np.array(ORIGIN) + places,
        time=10.0 * np.arange(count),
        speed=np.ones(count - 1),
    )


def took(write, what):
    """Processor time [s] of writing something once."""
    begun = process_time()
    write(what)
    return process_time() - begun


def growth(write, few, many):
    """How many times longer it takes to write more."""
    write(few)  # what is loaded and built at first use
    least = min(took(write, few) for _ in range(REPEATS))
    return took(write, many) / least


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


@cache
def sampled(count):
    """A run of so many time steps."""
    return flown(duration=0.5 * count)


@pytest.mark.slow
def test_scenario_takes_a_time_in_proportion_to_its_waypoints():
    def run(count):
        points = 10.0 * np.random.default_rng(1).uniform(size=(count, 2))
        return flown(auv__0__survey__points=points.tolist(), duration=1.0)

    assert growth(scenario_toml, run(FEW), run(TIMES * FEW)) < NOISE * TIMES


def written_netcdf(folder, run):
    write_netcdf(run, folder / "tracks.nc")


def written_map(folder, run):
    """The tracks of all, as a map has them."""
    nothing = Mission(tracks={"cna": track(2)}, geographic=True)
    writers.write_geojson(folder / "path.geojson", map_mission(run, nothing))


def summed_up(_folder, run):
    """Figures of merit without what other tests hold: the certified bound."""
    op.Run(**{name: getattr(run, name) for name in run.__dataclass_fields__}).summary(bounds=False)


WRITTEN = {
    "tracks.csv": lambda _folder, run: "".join(tracks_csv(run)),
    "tracks.nc": written_netcdf,
    "path.geojson": written_map,
    "map.png": lambda _folder, run: png(partial(map_figure, run)),
    "errors.png": lambda _folder, run: png(partial(errors_figure, run)),
    "summary.json": summed_up,
}


@pytest.mark.slow
@pytest.mark.xdist_group("writer growth")
@pytest.mark.parametrize("name", WRITTEN)
def test_file_of_a_run_takes_a_time_in_proportion_to_its_samples(name, tmp_path):
    few, many = sampled(FEW), sampled(TIMES * FEW)
    assert growth(partial(WRITTEN[name], tmp_path), few, many) < NOISE * TIMES


@pytest.mark.slow
def test_path_is_simplified_in_a_time_in_proportion_to_its_samples():
    """A lawnmower at a metre a sample, and ever more legs of it."""

    def path(count):
        side = 100
        k = np.arange(count)
        leg, along = k // side, k % side
        x = np.where(leg % 2 == 0, along, side - 1 - along)
        return Track(points=np.column_stack([x, leg]).astype(float), time=k.astype(float))

    times = TIMES // 4  # it takes longer than all of the writing
    shorten = partial(simplify, allowance=Allowance(items=times * FEW))
    assert growth(shorten, path(FEW), path(times * FEW)) < NOISE * times


def peak(work):
    """How much memory [bytes] something takes meanwhile."""
    tracemalloc.start()
    work()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most


def recorded(run):
    """How much memory [bytes] a run's recording takes."""
    arrays = [value for value in vars(run).values() if isinstance(value, np.ndarray)]
    return sum(array.nbytes for array in arrays)


@pytest.mark.slow
def test_flight_takes_less_than_twice_the_memory_of_its_recording():
    flown(duration=1.0)  # what is loaded at first use
    few, many = (partial(flown, duration=duration) for duration in (200.0, 1000.0))
    assert peak(many) - peak(few) < 2.0 * (recorded(many()) - recorded(few()))


@pytest.mark.slow
def test_verdict_keeps_no_covariances_of_its_own():
    flight = partial(flown, duration=1000.0)
    verdicts(flight())  # what is loaded at first use
    run = flight()
    tracemalloc.start()
    verdicts(run)
    kept = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    # some arrays of a number for each AUV and sample, and not one of a matrix
    assert kept < 0.75 * run.covariance.nbytes


@pytest.mark.slow
def test_tracks_take_no_more_memory_for_a_longer_mission():
    def consume(run):
        return sum(map(len, tracks_csv(run)))

    few, many = (sampled(count * BLOCK) for count in (1, 5))
    for run in (few, many):
        assert run.error.size  # derived once and kept
    assert peak(lambda: consume(many)) < 1.2 * peak(lambda: consume(few))


@pytest.mark.slow
def test_recording_is_written_in_less_memory_than_its_file_has(tmp_path):
    run = sampled(5 * BLOCK)
    run.summary(bounds=False)  # what is derived once and kept
    written_netcdf(tmp_path, run)  # what is loaded at first use
    most = peak(lambda: written_netcdf(tmp_path, run))
    assert most < (tmp_path / "tracks.nc").stat().st_size


@pytest.mark.slow
def test_flights_under_other_noise_are_not_kept():
    one, many = (flown(duration=200.0, export__replays=count) for count in (1, 8))
    make_export(one)  # what is loaded and built at first use
    assert peak(lambda: make_export(many)) < 1.2 * peak(lambda: make_export(one))


def test_time_that_grows_with_the_square_is_noticed():
    """Negative control."""
    square = lambda count: np.subtract.outer(np.arange(count), np.arange(count)).sum()  # noqa: E731
    assert growth(square, 100, TIMES * 100) > NOISE * TIMES
