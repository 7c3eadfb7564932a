"""The paths that planners had in mind: kept with a run, written, read back, and flown as long as nothing changes."""

import cmath
import csv
import math

import numpy as np
import pytest
from oracles import scenario

import obsplan as op
from obsplan.planned import AS_FLOWN, PATH
from obsplan.report import write_run
from obsplan.report.page.folder import read_run
from obsplan.report.page.run import run_page
from obsplan.simulation.ahead import Ahead
from obsplan.simulation.autopilot import FixedPath
from obsplan.simulation.loop import ClosedLoop

HALF_A_DIGIT = 0.5e-6  # tables have six decimals
CHORD = 0.051  # [m] between a path and the line through its places, as promised, and 1 mm


def decided(path, lasting=(), speed=2.0):
    return op.Decision(
        turn_rate=0.0,
        speed=speed,
        predict=lambda: np.array(path, dtype=float),
        lasting=np.array(lasting),
    )


def kept(*decisions, every=1.0, current=(0.0, 0.0)):
    ahead = Ahead(len(decisions))
    for k, decision in enumerate(decisions):
        ahead.keep(k * every, decision, {})
    return ahead.planned(current)


def paths(planned):
    """Each path's times and places."""
    begins = [0, *planned.ends[:-1]]
    return [
        (planned.time[begin:end], planned.place[begin:end])
        for begin, end in zip(begins, planned.ends, strict=True)
    ]


def turning(turn_rate, speed, lasting, pose=(0.0, 0.0, 0.0)):
    """Poses of turns one after the other, by integrating the velocity in the complex plane."""
    at, heading, poses = complex(*pose[:2]), pose[2], [pose]
    for u, t in zip(turn_rate, lasting, strict=True):
        end = heading + u * t
        at += (
            speed * t * cmath.exp(1j * heading)
            if u == 0
            else speed * (cmath.exp(1j * end) - cmath.exp(1j * heading)) / (1j * u)
        )
        heading = end
        poses.append((at.real, at.imag, heading))
    return poses


def test_places_of_turns_are_on_their_circles_at_their_times_and_drift_with_the_water():
    poses = turning([0.4, -0.2], 2.0, [5.0, 10.0], (3.0, -4.0, 1.0))
    ((time, place),) = paths(kept(decided(poses, [5.0, 10.0]), current=(0.3, -0.1)))
    assert time[-1] == pytest.approx(15.0)
    for t, found in zip(time, place, strict=True):
        lasting = [min(t, 5.0), max(t - 5.0, 0.0)]
        *_, (x, y, _) = turning([0.4, -0.2], 2.0, lasting, (3.0, -4.0, 1.0))
        np.testing.assert_allclose(found, [x + 0.3 * t, y - 0.1 * t], atol=1e-9)
    assert np.diff(time).max() * 0.4 <= 0.6  # [rad] between two places: half of that bulges by 5 cm


def test_whole_circles_which_no_chord_tells_are_gone_round_at_the_decided_speed():
    poses = turning([0.4], 2.0, [2 * math.pi / 0.4])
    ((_, place),) = paths(kept(decided(poses, [2 * math.pi / 0.4])))
    np.testing.assert_allclose(np.hypot(*(place - [0.0, 5.0]).T), 5.0, atol=1e-9)


def test_legs_whose_times_are_not_told_are_straight_and_gone_at_the_decided_speed():
    ((time, place),) = paths(kept(decided([[0, 0, 0], [0, 0, 0], [6, 8, 0], [6, 18, 0]])))
    np.testing.assert_allclose(place, [[6, 8], [6, 18]], atol=1e-12)
    np.testing.assert_allclose(time, [5.0, 10.0])


def test_path_that_goes_on_as_it_was_said_is_kept_once_and_a_changed_one_again():
    poses = turning([0.1] * 6, 2.0, [10.0] * 6)
    first, rest = decided(poses, [10.0] * 6), decided(poses[1:], [10.0] * 5)
    other = decided(turning([-0.1] * 5, 2.0, [10.0] * 5, poses[1]), [10.0] * 5)
    late = decided([np.add(pose, [0.0, 0.01, 0.0]) for pose in poses[1:]], [10.0] * 5)
    longer = decided(turning([0.1] * 40, 2.0, [10.0] * 40, poses[1]), [10.0] * 40)
    assert kept(first, rest, every=10.0).decided.tolist() == [0.0]
    for changed in (other, late, longer):
        assert kept(first, changed, every=10.0).decided.tolist() == [0.0, 10.0]


def test_of_a_long_path_five_minutes_are_kept_and_of_a_stopped_vehicle_nothing():
    ((time, _),) = paths(kept(decided([[x, 0, 0] for x in range(2000)])))
    assert 300.0 <= time[-1] <= 300.5  # legs of half a second
    assert kept(decided([[0, 0, 0], [1, 0, 0]], speed=0.0)) is None
    assert kept(op.Decision(turn_rate=0.1, speed=1.0)) is None


def test_of_very_many_decisions_some_are_kept_evenly_apart():
    ahead = Ahead(40_001)
    for k in range(40_001):
        ahead.keep(float(k), decided([[k, 0, 0], [k + 1, 0, 0]]), {})
    assert np.unique(np.diff(ahead.planned((0.0, 0.0)).decided)).tolist() == [3.0]


SEARCHES = [
    ("information", {}),
    pytest.param("trajectory", {}, marks=pytest.mark.slow),
    pytest.param("rolling", {"starts": 2}, marks=pytest.mark.slow),
    pytest.param("whole-mission", {"starts": 2}, marks=pytest.mark.slow),
]


@pytest.mark.parametrize(
    "water",
    [{}, {"environment": {"current": [0.2, -0.3]}, "cna__carried": True}],
    ids=["still", "current"],
)
@pytest.mark.parametrize(("planner", "options"), SEARCHES)
def test_vehicle_is_on_its_planned_path_until_another_is_kept(planner, options, water):
    run = op.simulate(scenario(planner={"kind": planner, "interval": 1.0, **options}, **water))
    (planned,) = run.planned
    until = [*planned.decided[1:], run.time[-1]]
    flown = 0
    for (time, place), begin, end in zip(paths(planned), planned.decided, until, strict=True):
        now = (run.time >= begin) & (run.time <= end)
        k = np.searchsorted(run.time, begin)
        on_path = [
            np.interp(run.time[now], [begin, *time], [run.cna[k, axis], *place[:, axis]])
            for axis in (0, 1)
        ]
        away = np.hypot(*(np.transpose(on_path) - run.cna[now, :2]).T)
        assert away.max() < CHORD
        flown += now.sum()
    assert flown >= run.time.size


def test_planners_that_hold_a_turn_and_campaigns_keep_no_path_and_a_fixed_mission_what_it_flew():
    held = op.simulate(scenario())
    assert held.planned == (None,)
    fixed = FixedPath(commands=np.tile([0.1, 2.0], (40, 1)), time_step=0.5)
    assert op.simulate(scenario(), planner=fixed).planned == (AS_FLOWN,)
    searched = scenario(planner={"kind": "information"})
    assert ClosedLoop(scenario=searched, planner=searched.planner()).fly(1).planned == ()


def test_planned_paths_are_read_back_from_the_folder(tmp_path):
    run = op.simulate(scenario(planner={"kind": "information"}))
    write_run(run, tmp_path / "run", exports=())
    (read,), (planned,) = read_run(tmp_path / "run").planned, run.planned
    np.testing.assert_array_equal(read.ends, planned.ends)
    for name in ("decided", "time", "place"):
        np.testing.assert_allclose(getattr(read, name), getattr(planned, name), atol=HALF_A_DIGIT)
    with (tmp_path / "run" / "planned.csv").open() as file:
        rows = [*csv.DictReader(file)]
    assert {row["cna"] for row in rows} == {"cna"}
    assert [float(row["x_m"]) for row in rows] == pytest.approx(
        planned.place[:, 0], abs=HALF_A_DIGIT
    )


def test_mission_flown_as_it_was_given_says_so_in_its_table(tmp_path):
    fixed = FixedPath(commands=np.tile([0.1, 2.0], (40, 1)), time_step=0.5)
    write_run(op.simulate(scenario(), planner=fixed), tmp_path / "run", exports=())
    assert (tmp_path / "run" / "planned.csv").read_text().splitlines()[1:] == ["0.000000,cna,,,"]
    assert read_run(tmp_path / "run").planned == (AS_FLOWN,)


def explodes():
    raise RuntimeError("no idea")


WRONG = {
    "raises": (explodes, []),
    "nan": (lambda: np.full((3, 3), np.nan), []),
    "flat": (lambda: np.zeros(3), []),
    "words": (lambda: "straight on", []),
    "two numbers each": (lambda: np.zeros((4, 2)), []),
    "too few times": (lambda: np.zeros((4, 3)), [1.0, 2.0]),
    "no time": (lambda: np.zeros((3, 3)), [1.0, 0.0]),
    "for ever": (lambda: np.zeros((3, 3)), [1.0, np.inf]),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_path_that_cannot_be_read_does_no_harm_and_is_told(wrong, caplog):
    predict, lasting = WRONG[wrong]

    class Dreamer:
        def plan(self, pose, auvs, *, time=0.0):
            return op.Decision(turn_rate=0.1, speed=2.0, predict=predict, lasting=np.array(lasting))

    run = op.simulate(scenario(), planner=Dreamer())
    assert run.planned == (None,)
    assert run.faults[PATH].startswith("first after 0 s: ")
    assert np.nanmax(run.status) == 0  # its decisions were sound
    assert [message for message in caplog.messages if "Dreamer: path, first after 0 s" in message]
    assert "Not every path that Dreamer predicted is drawn" in run_page(run)
