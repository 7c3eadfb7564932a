"""Claims about a run as a CF dataset and NetCDF file."""

from dataclasses import replace
from itertools import combinations_with_replacement

import numpy as np
import pymap3d
import pytest
import xarray as xr
from scipy.io import netcdf_file

import obsplan as op
from formulations.solution import Status
from obsplan.scenario import from_dict, load
from obsplan.simulation import simulate
from obsplan.types import ObsplanError

LAT, LON = 47.629, -122.337  # of harbor-survey's origin


@pytest.fixture(scope="module")
def run():
    return simulate(
        load("harbor-survey", planner="path-inertia", settings=["duration=60.0"]), seed=3
    )


@pytest.fixture(scope="module")
def variables(run, tmp_path_factory):
    """The file's variables as a reader of the bare format sees them."""
    path = tmp_path_factory.mktemp("nc") / "tracks.nc"
    op.write_netcdf(run, str(path))
    with netcdf_file(path, mmap=False) as file:
        return {
            name: (v.dimensions, v[:].copy(), dict(v._attributes))
            for name, v in file.variables.items()
        }, dict(file._attributes)


def test_dataset_holds_what_was_recorded_by_auv_and_time(run):
    dataset = op.to_dataset(run)
    assert dict(dataset.sizes) == {"time": 121, "auv": 2, "state": 4, "state_2": 4}
    bravo = dataset.sel(auv="bravo", time=30.0)
    np.testing.assert_array_equal(
        [bravo.auv_x, bravo.auv_y, bravo.auv_heading, bravo.auv_speed], run.truth[1, 60]
    )
    np.testing.assert_array_equal(
        [bravo.est_x, bravo.est_y, bravo.est_heading, bravo.est_speed], run.mean[1, 60]
    )
    np.testing.assert_array_equal([bravo.cna_x, bravo.cna_y, bravo.cna_heading], run.cna[60])
    np.testing.assert_array_equal(bravo.covariance, run.covariance[1, 60])
    assert bravo["range"] == run.range[1, 60] > 0
    assert dataset["range"].sel(time=30.5).isnull().all()
    assert bravo.error == pytest.approx(np.hypot(*(run.mean - run.truth)[1, 60, :2]))


def test_file_has_every_time_and_auv_of_the_run(run, variables):
    found, _ = variables
    for name, recorded in {
        "cna_x": run.cna[:, 0],
        "cna_turn_rate": run.turn_rate,
        "time": run.time,
    }.items():
        dimensions, values, _ = found[name]
        assert dimensions == ("auv", "obs")
        np.testing.assert_array_equal(values, [recorded, recorded])
    for name, recorded in {
        "auv_y": run.truth[..., 1],
        "est_speed": run.mean[..., 3],
        "range": run.range,
    }.items():
        np.testing.assert_array_equal(found[name][1], recorded)
    states = ("east", "north", "heading", "speed")
    for (i, one), (j, other) in combinations_with_replacement(enumerate(states), 2):
        np.testing.assert_array_equal(found[f"cov_{other}_{one}"][1], run.covariance[..., i, j])


@pytest.mark.parametrize(
    ("lat", "lon", "x", "y"),
    [("lat", "lon", "auv_x", "auv_y"), ("est_lat", "est_lon", "est_x", "est_y")],
)
def test_latitudes_and_longitudes_are_those_of_the_local_positions(variables, lat, lon, x, y):
    found, _ = variables
    east, north, _ = pymap3d.geodetic2enu(found[lat][1], found[lon][1], 0.0, LAT, LON, 0.0)
    np.testing.assert_allclose(
        east, found[x][1], atol=1e-6
    )  # degrees in double precision are 1e-9 m
    np.testing.assert_allclose(north, found[y][1], atol=1e-6)


def test_file_follows_the_conventions_for_trajectories(variables):
    found, attributes = variables
    assert attributes["Conventions"] == b"CF-1.11"
    assert attributes["featureType"] == b"trajectory"
    assert [name for name, (_, _, a) in found.items() if a.get("cf_role") == b"trajectory_id"] == [
        "auv"
    ]
    assert [bytes(name).decode().strip("\0") for name in found["auv"][1]] == ["alpha", "bravo"]
    standard = {name: found[name][2]["standard_name"] for name in ("time", "lat", "lon")}
    assert standard == {"time": b"time", "lat": b"latitude", "lon": b"longitude"}
    assert found["time"][2]["units"] == b"seconds since 1970-01-01T00:00:00Z"
    for name in ("time", "lat", "lon", "auv"):
        assert "_FillValue" not in found[name][2]  # coordinates are never missing
    for name, (dimensions, _, a) in found.items():
        assert "long_name" in a, name
        if dimensions == ("auv", "obs") and name not in ("status", "score"):
            assert a["units"], name
            assert name in ("time", "lat", "lon") or set(a["coordinates"].split()) == {
                b"time",
                b"lat",
                b"lon",
            }
    assert {"scenario", "planner", "seed", "version", "title", "condition_label"} <= set(attributes)
    assert not {"date_created", "date"} & set(attributes)
    origin = [float(attributes[f"origin_{name}"]) for name in ("latitude", "longitude")]
    assert origin == [LAT, LON]  # to all digits


def test_decisions_carry_their_status_as_a_flag(run, variables):
    found, _ = variables
    _, values, attributes = found["status"]
    meaning = dict(
        zip(
            attributes["flag_values"].tolist(),
            attributes["flag_meanings"].decode().split(),
            strict=True,
        )
    )
    assert meaning == {status.value: status.label for status in Status}
    missing = np.isnan(run.status)
    np.testing.assert_array_equal(values[0] == attributes["_FillValue"], missing)
    np.testing.assert_array_equal(values[0][~missing], run.status[~missing])


def test_xarray_reads_the_file_back(run, tmp_path):
    op.write_netcdf(run, tmp_path / "tracks.nc")
    with xr.open_dataset(tmp_path / "tracks.nc") as dataset:
        assert dataset.auv.values.tolist() == ["alpha", "bravo"]
        seconds = (dataset.time - np.datetime64("1970-01-01")) / np.timedelta64(1, "s")
        np.testing.assert_allclose(seconds, [run.time, run.time], rtol=1e-12)
        assert dataset.attrs["condition_label"] == "κ(J)"
        labelled = op.to_dataset(run)
        for name in ("error", "separation", "nees", "range"):
            np.testing.assert_array_equal(dataset[name], labelled[name])
            assert dataset[name].attrs["long_name"] == labelled[name].attrs["long_name"]


def test_same_run_gives_the_same_bytes_and_another_seed_others(tmp_path):
    scenario = load("harbor-survey", settings=["duration=60.0"])
    for name, seed in (("a", 3), ("b", 3), ("c", 4)):
        op.write_netcdf(simulate(scenario, seed=seed), tmp_path / name)
    same, again, other = ((tmp_path / name).read_bytes() for name in "abc")
    assert same == again != other


def test_run_without_condition_or_regular_covariance_with_any_name_and_seed_is_written(tmp_path):
    auv = {
        "name": "Żółw 1",
        "survey": {"kind": "static", "x": 5.0, "y": 1.0},
        "first_estimate": {"sigma_position": 0.0},
    }
    data = {
        "origin": {"lat": 0.0, "lon": 0.0},
        "cna": {"speed": 1.0, "min_turn_radius": 1.0},
        "auv": [auv],
        "planner": {"kind": "stationary"},
        "duration": 2.0,
        "ranging": {"interval": 1.0},
        "seed": 2**40,
    }
    op.write_netcdf(simulate(from_dict(data)), tmp_path / "tracks.nc")
    with xr.open_dataset(tmp_path / "tracks.nc") as dataset:
        assert dataset.auv.values.tolist() == ["Żółw 1"]
        assert dataset.attrs["seed"] == str(2**40)
        assert dataset.attrs["condition_label"] == "none"
        assert dataset.condition.isnull().all()


def test_squared_ranges_are_in_square_metres(run):
    table = run.scenario.table
    squared = replace(
        run.scenario,
        table=table.model_copy(
            update={"ranging": table.ranging.model_copy(update={"kind": "squared-range"})}
        ),
    )
    assert op.to_dataset(replace(run, scenario=squared))["range"].attrs["units"] == "m2"
    assert op.to_dataset(run)["range"].attrs["units"] == "m"


def test_file_that_cannot_be_written_is_one_sentence_and_leaves_nothing(run, tmp_path):
    with pytest.raises(ObsplanError, match=r"nowhere.tracks\.nc cannot be written"):
        op.write_netcdf(run, tmp_path / "nowhere" / "tracks.nc")
    assert not list(tmp_path.iterdir())
