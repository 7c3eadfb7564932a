"""Claims about the mission that is made of a run, what it costs, and what is said of it."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pymap3d
import pyogrio.raw
import pytest
import shapely
from mavlink_vehicle import ACCEPTED, assert_stored_as_in, upload
from missions import moos_behaviours, moos_points
from pymavlink.mavwp import MAVWPLoader

from obsplan.campaign import plan_cells
from obsplan.missions import write_waypoints
from obsplan.missions.export import simplify
from obsplan.missions.flown_path import Allowance
from obsplan.report import export_sentences, make_export, write_run
from obsplan.report.export import flown_track, leg_violation
from obsplan.scenario import load
from obsplan.simulation import simulate
from obsplan.types import Decision, ObsplanError

pytestmark = pytest.mark.xdist_group("run-export")  # they share runs and exports
LIMITS = [
    "constraints.keep_out=[{x=30.0,y=40.0,radius=12.0},{points=[[-60.0,20.0],[-40.0,20.0],[-50.0,40.0]]}]",
    "constraints.geofence=[[-90.0,-80.0],[120.0,-80.0],[120.0,120.0],[-90.0,120.0]]",
]


def flown(*settings, planner="random", seed=3):
    return simulate(load("harbor-survey", planner=planner, settings=settings), seed=seed)


@pytest.fixture(scope="module")
def run():
    return flown("duration=250.0")


@pytest.fixture(scope="module")
def export(run):
    return make_export(run)


def enu(latlon):
    return np.stack(
        pymap3d.geodetic2enu(latlon[:, 0], latlon[:, 1], 0.0, 47.629, -122.337, 0.0)[:2], axis=-1
    )


# --- what is made ------------------------------------------------------------------------------


@pytest.mark.slow
def test_mission_is_near_the_path_flown_and_counted_as_the_vehicle_does(run, export, tmp_path):
    write_run(run, tmp_path / "out", (export,))
    loader = MAVWPLoader()
    assert loader.load(str(tmp_path / "out" / "path.waypoints")) == export.simplified.items
    places = enu(np.array([(w.x, w.y) for w in loader.wpoints if w.command in (16, 17)]))[1:]
    assert np.hypot(*np.diff(places, axis=0).T).min() >= 2.0 - 2e-3
    away = shapely.distance(shapely.points(run.cna[:, :2]), shapely.LineString(places))
    assert away.max() <= export.simplified.deviation + 2e-3 <= 0.5 + 2e-3


@pytest.mark.slow
def test_summary_tells_the_mission_and_its_costs(run, export, tmp_path):
    write_run(run, tmp_path / "out", (export,))
    told = json.loads((tmp_path / "out" / "summary.json").read_text())["export"]
    track = export.simplified.track
    assert told["items"] == export.simplified.items
    assert told["waypoints"] == len(track.points)
    assert told["least_leg_m"] == pytest.approx(np.hypot(*np.diff(track.points, axis=0).T).min())
    assert told["deviation_m"] <= 0.5
    assert told["timing_s"] <= 1.0
    assert told["seeds"] == [4, 5, 6, 7]
    assert told["closed_loop_seeds"] == [3]  # random turns are drawn anew for each seed
    assert list(told["rms_error_m"]) == [
        *("closed_loop", "path_as_flown", "as_loaded", "60_s_late", "180_s_late")
    ]
    assert told["rms_error_m"]["closed_loop"] == pytest.approx(run.rms_error)
    assert "violation_max_m" not in told


@pytest.mark.slow
def test_the_path_as_flown_costs_what_a_planner_that_repeats_it_costs():
    class Repeats:
        def plan(self, _pose, _auvs, *, time=0.0):
            k = round(time / 0.5)
            return Decision(turn_rate=float(run.turn_rate[k]), speed=float(run.speed[k]))

    run = flown("duration=80.0", "planner.interval=0.5", "export.replays=3")
    costs = make_export(run).costs
    errors = [simulate(run.scenario, planner=Repeats(), seed=s).rms_error for s in (4, 5, 6)]
    assert costs.seeds == (4, 5, 6)
    assert costs.rms_error["path_as_flown"] == pytest.approx(np.median(errors), rel=1e-12)
    assert "180_s_late" not in costs.rms_error  # the mission is over by then


def test_a_planner_that_is_quick_is_flown_under_the_same_seeds():
    run = flown("duration=80.0", planner="error-ellipse")
    costs = make_export(run).costs
    assert costs.closed_loop_seeds == costs.seeds == (4, 5, 6, 7)
    errors = [simulate(run.scenario, seed=seed).rms_error for seed in costs.seeds]
    assert costs.rms_error["closed_loop"] == pytest.approx(np.median(errors))
    assert costs.rms_error["closed_loop"] != costs.rms_error["path_as_flown"]


def test_a_planner_from_code_keeps_its_own_run():
    run = replace(flown("duration=80.0", planner="error-ellipse"), planner="Mine")
    assert make_export(run).costs.closed_loop_seeds == (3,)


def test_progress_counts_every_flight(run):
    seen = []
    make_export(run, progress=lambda done, total: seen.append((done, total)))
    assert seen == [(n, 16) for n in range(1, 17)]  # as flown, as loaded, twice late; four seeds


def test_nothing_is_sailed_where_nothing_is_asked_for():
    export = make_export(flown("duration=80.0", "export.replays=0"))
    assert export.costs is None
    assert export.summary()["rms_error_m"] is None
    assert export_sentences(export)[-1] == (
        "What the path costs under other noise was not asked for (export.replays = 0)."
    )


def test_a_run_whose_filter_failed_is_exported(run):
    mean = run.mean.copy()
    mean[0, 100:] = np.nan
    told = make_export(replace(run, mean=mean)).summary()["rms_error_m"]
    assert told["closed_loop"] is None
    assert told["path_as_flown"] > 0


def test_samples_between_the_runs_own_are_on_its_arcs():
    run = flown("duration=60.0", "time_step=3.0", "planner.interval=3.0")
    track, near = flown_track(run, 0.01)
    assert near <= 0.01
    every = (len(track.points) - 1) // (run.time.size - 1)
    assert every > 1
    np.testing.assert_allclose(track.points[::every], run.cna[:, :2], atol=1e-9)
    np.testing.assert_allclose(track.time[::every], run.time)
    for k in np.flatnonzero(run.turn_rate[:-1]):
        radius = run.speed[k] / run.turn_rate[k]
        x, y, heading = run.cna[k]
        centre = np.array([x - radius * np.sin(heading), y + radius * np.cos(heading)])
        between = track.points[k * every : (k + 1) * every + 1]
        np.testing.assert_allclose(np.hypot(*(between - centre).T), abs(radius), rtol=1e-9)


def test_a_coarse_time_step_does_not_make_the_mission_coarse():
    run = flown("duration=200.0", "time_step=5.0", "planner.interval=5.0", "ranging.interval=15.0")
    export = make_export(run)
    fine, _ = flown_track(run, 1e-4)
    away = shapely.distance(
        shapely.points(fine.points), shapely.LineString(export.simplified.track.points)
    )
    assert away.max() <= export.simplified.deviation + 1e-3 <= 0.5 + 1e-3


# --- within limits -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def limited():
    run = flown("duration=250.0", *LIMITS, "constraints.min_separation=5.0")
    return run, make_export(run)


@pytest.mark.slow
def test_limits_are_in_the_files_that_hold_them(limited, tmp_path):
    run, export = limited
    write_run(run, tmp_path / "out", (export,))
    fence = np.array([(-90.0, -80.0), (120.0, -80.0), (120.0, 120.0), (-90.0, 120.0)])
    plan = json.loads((tmp_path / "out" / "path.plan").read_text())["geoFence"]
    assert [p["inclusion"] for p in plan["polygons"]] == [True, False]
    assert [c["inclusion"] for c in plan["circles"]] == [False]
    np.testing.assert_allclose(enu(np.array(plan["polygons"][0]["polygon"])), fence, atol=1e-2)
    for name in ("path.kml", "path.geojson"):
        meta, _, _, fields = pyogrio.raw.read(tmp_path / "out" / name)
        column = [field.lower() for field in meta["fields"]].index("name")
        assert fields[column].tolist()[-3:] == ["geofence", "keep-out-1", "keep-out-2"]
    _, region = moos_behaviours((tmp_path / "out" / "path.bhv").read_text())
    np.testing.assert_allclose(moos_points(region["polygon"]), fence, atol=1e-2)


def test_no_leg_breaks_a_fixed_limit(limited):
    run, export = limited
    line = shapely.LineString(export.simplified.track.points)
    disc = shapely.Point(30, 40).buffer(12.0, 512)
    fence = shapely.box(-90, -80, 120, 120)
    assert run.violation.max() <= 0
    assert not line.intersects(disc.buffer(-1e-3))
    assert fence.buffer(1e-3).covers(line)
    assert export.violation <= 0
    assert export.summary()["violation_m"] == export.violation


def test_how_far_legs_break_limits_is_the_deepest_place(limited):
    limits = limited[0].scenario.constraints
    through = np.array([[0.0, 40.0], [60.0, 40.0]])  # through the disc's centre
    assert leg_violation(through, limits) == pytest.approx(12.0, abs=0.05)
    assert leg_violation(np.array([[0.0, -90.0]]), limits) == pytest.approx(10.0)


def test_a_late_start_that_breaks_a_limit_is_told(limited):
    _, export = limited
    worst = export.summary()["violation_max_m"]
    assert set(worst) == {"path_as_flown", "as_loaded", "60_s_late", "180_s_late"}
    text = export_sentences(export)
    assert text[1] == (
        "Keep-outs and geofence are not in path.waypoints, path.gpx, path.csv; "
        "no file holds the separations from the AUVs, and no autopilot keeps them."
    )
    broken = replace(export.costs, violation=worst | {"60_s_late": 3.2})
    told = export_sentences(replace(export, costs=broken))[-1]
    assert ", 3.20 m beyond a limit, 180 s late" in told


# --- as the scenario says ----------------------------------------------------------------------


@pytest.mark.slow
def test_only_the_formats_asked_for_are_written(tmp_path):
    scenario = load(
        "harbor-survey",
        planner="random",
        settings=["duration=60.0", 'export.formats=["gpx","plan"]'],
    )
    write_run(simulate(scenario), tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out").glob("path.*")) == ["path.gpx", "path.plan"]


@pytest.mark.slow
def test_keys_of_export_change_the_mission():
    run = flown("duration=200.0")

    def mission(**keys):
        table = run.scenario.table
        changed = table.model_copy(update={"export": table.export.model_copy(update=keys)})
        scenario = replace(run.scenario, table=changed)
        return make_export(replace(run, scenario=scenario))

    plain = mission(replays=0)
    assert mission(replays=0, max_items=20).simplified.items <= 20 < plain.simplified.items
    assert mission(replays=0, min_spacing=9.0).summary()["least_leg_m"] >= 9.0
    assert mission(replays=0, tolerance=0.1).simplified.deviation <= 0.1
    assert mission(replays=0, timing=0.05).simplified.timing <= 0.05
    wide = mission(replays=0, min_turn_radius=20.0)
    assert wide.widening > 1.0
    assert wide.summary()["widening_m"] == wide.widening
    assert "turns of 20 m instead of 10 m had moved it by up to" in export_sentences(wide)[0]
    assert "widening_m" not in mission(replays=0, min_turn_radius=8.0).summary()
    ends = [mission(replays=0, end=end).simplified.items for end in ("loiter", "return", "stop")]
    assert ends == [plain.simplified.items, plain.simplified.items + 1, plain.simplified.items]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("export.max_items=7", r"export.max_items = 7 .*must be greater than or equal to 8"),
        ("export.min_spacing=-1.0", "export.min_spacing = -1.0"),
        ("export.tolerance=0.0", r"export.tolerance = 0.0 .*must be greater than 0"),
        ("export.timing=1e9", r"export.timing = 1000000000.0"),
        ('export.end="home"', r'export.end = "home" .*\'loiter\', \'return\' or \'stop\''),
        ('export.formats=["shp"]', r'export.formats.0 = "shp"'),
        ('export.start_time="2026-05-01T08:00:00"', "must be an instant .* with its offset"),
        ('export.start_time="noon"', "must be an instant"),
        ('export.start_time="9999-12-31T00:00:00Z"', "must be an instant"),
        ("export.replays=-1", "export.replays = -1"),
        ("export.speed=1.0", "export.speed"),
    ],
)
def test_wrong_keys_of_export_are_refused(setting, message):
    with pytest.raises(ObsplanError, match=message):
        load("harbor-survey", settings=[setting])


def test_the_start_is_an_instant_with_its_offset_as_toml_or_text_has_it():
    for text in ("2026-05-01T10:00:00+02:00", '"2026-05-01T08:00:00Z"'):
        start = load("harbor-survey", settings=[f"export.start_time={text}"]).table.export.start
        assert start == datetime(2026, 5, 1, 8, tzinfo=UTC)


@pytest.mark.slow
def test_times_of_files_count_from_the_start(tmp_path):
    run = flown("duration=60.0", "export.start_time=2026-05-01T10:00:00+02:00", "export.replays=0")
    write_run(run, tmp_path / "out")
    for name in ("path.gpx", "path.kml"):
        text = (tmp_path / "out" / name).read_text()
        assert "The mission starts at 2026-05-01T08:00:00Z." in text
        assert "2026-05-01T08:00:00.000Z" in text
        assert "2026-05-01T08:01:00.000Z" in text


# --- what campaigns do not pay for ------------------------------------------------------------


def test_export_is_no_part_of_what_a_campaign_flies():
    (plain,) = plan_cells(["harbor-survey"])
    assert "export" not in json.loads(plain.content)
    with pytest.raises(ObsplanError, match=r"export.max_items is not a setting to vary"):
        plan_cells(["harbor-survey"], vary=["export.max_items=100,500"])


# --- in words ----------------------------------------------------------------------------------


def test_sentences_tell_the_mission_and_that_a_path_is_not_a_policy(export):
    costs = replace(
        export.costs,
        rms_error={
            "closed_loop": 1.5,
            "path_as_flown": 2.0,
            "as_loaded": 2.02,
            "60_s_late": 2.3,
            "180_s_late": 1.9,
        },
    )
    mission, policy = export_sentences(replace(export, costs=costs))
    items, legs = export.simplified.items, export.summary()["least_leg_m"]
    assert mission.startswith(
        f"The mission to load has {items} items (500 fit) and no leg under {legs:.2f} m; "
    )
    assert f"at most {export.simplified.deviation:.2f} m from the path flown" in mission
    assert policy == (
        "A path is not a policy: sailed as loaded under the noise of seeds 4 to 7, this one gives 2.02 m RMS "
        "in the median (the path as flown 2.00 m), 60 s late 2.30 m (+15 %), 180 s late 1.90 m (-5 %); "
        "start it on time, or decide on board; --planner whole-mission plans a path that is meant for loading."
    )
    calm = replace(costs, rms_error=costs.rms_error | {"60_s_late": 2.1})
    assert "whole-mission" not in export_sentences(replace(export, costs=calm))[-1]
    whole = replace(export, costs=costs, planner="whole-mission")
    assert export_sentences(whole)[-1].endswith(
        "start it on time, or plan again from where and when it starts."
    )
    same = replace(costs, closed_loop_seeds=costs.seeds)
    assert "; random on board gives 1.50 m; " in export_sentences(replace(export, costs=same))[-1]


def test_a_tolerance_that_could_not_be_kept_is_said():
    export = make_export(flown("duration=200.0", "export.max_items=10", "export.replays=0"))
    assert export.simplified.deviation > 0.5
    assert export_sentences(export)[0].endswith(
        "; with at most 10 items and no leg under 2 m it cannot be within the 0.50 m and 1 s that [export] asks for."
    )


def test_a_vehicle_that_stays_put_is_exported():
    run = simulate("fixed-auv", planner="stationary")
    export = make_export(run)
    assert (export.simplified.items, export.summary()["least_leg_m"]) == (2, None)
    assert export_sentences(export)[0] == (
        "The mission to load has 2 items (500 fit); it is at most 0.00 m from the path flown."
    )


# --- the example -------------------------------------------------------------------------------


@pytest.mark.slow
def test_harbor_surveys_mission_fits_is_stored_and_costs_nothing(tmp_path):
    run = simulate("harbor-survey")
    export = make_export(run)
    write_waypoints(tmp_path / "path.waypoints", export.mission)
    answer, stored, _ = upload(tmp_path / "path.waypoints", room=500)
    assert answer == ACCEPTED
    assert len(stored) == export.simplified.items
    assert_stored_as_in(tmp_path / "path.waypoints", stored)
    told = export.summary()
    assert told["items"] <= 500
    assert told["least_leg_m"] >= 2.0
    assert told["deviation_m"] <= 0.5
    errors = told["rms_error_m"]
    assert errors["as_loaded"] == pytest.approx(errors["path_as_flown"], rel=0.03)
    assert errors["as_loaded"] < errors["60_s_late"] < errors["180_s_late"]  # measured before, too
    dense, _ = flown_track(run, 0.01)
    tight = simplify(dense, Allowance(tolerance=0.05))
    assert tight.items <= 500
