"""Bounds of runs whose ranges are slant, grow, are lost and come from several beacons."""

from importlib.resources import files

import numpy as np
import pytest
from oracles import scenario

import obsplan as op

LAW = {
    **{"interval": 2.0, "sigma": 0.5, "heading_sigma_deg": 1.0, "growth": 0.02, "slot": 0.3},
    **{"geometry": "slant", "loss": 0.2, "half_distance": 150.0},
}
MOORED = {"name": "moored", "x": 30.0, "y": -40.0, "depth": 5.0}
STERN = {"name": "stern", "on": 0, "x": -2.0, "depth": 1.0}


def flown(planner, **change):
    given = {"auv__0__depth": 30.0, "auv__1__depth": 45.0, "duration": 90.0} | change
    mission = scenario(
        planner={"kind": planner, "interval": 1.0, "knowledge": "estimate"}, ranging=LAW, **given
    )
    return op.simulate(mission, seed=4)


@pytest.mark.parametrize("beacons", [[], [MOORED, STERN]], ids=["alone", "moored-and-stern"])
def test_no_planner_beats_the_bound_under_a_law_of_ranges(beacons):
    for planner in ("error-ellipse", "random"):
        run = flown(planner, beacon=beacons)
        for P, bound in zip(run.cramer_rao, run.information_bounds, strict=True):
            assert 0.2 < bound.efficiency(P) <= 1.0


def test_what_moored_beacons_tell_is_known_to_the_bound():
    """Deaf to the aid vehicle, every path is as good as any: the bound is the covariance itself."""
    run = flown("random", beacon=[MOORED])
    ranges = run.ranges.copy()
    ranges[0] = np.nan
    fields = {name: getattr(run, name) for name in run.__dataclass_fields__}
    deaf = op.Run(**fields | {"ranges": ranges})
    for P, bound in zip(deaf.cramer_rao, deaf.information_bounds, strict=True):
        assert bound.efficiency(P) == pytest.approx(1.0, rel=1e-12)


def test_ranges_of_a_run_tell_what_their_geometry_says_written_out():
    run = flown("centroid-orbit")
    pings = np.flatnonzero(run.came[0, 1])
    assert 0 < pings.size < 44  # some of 44 are lost
    x = run.cna[pings, :2] - run.truth[1, pings, :2]
    r2 = np.sum(x**2, axis=1) + 45.0**2
    sigma2 = 0.5**2 + 0.02**2 * r2
    worth = 1 / (r2 * sigma2) + 2 * 0.02**4 / sigma2**2
    expected = worth[:, None, None] * x[:, :, None] * x[:, None, :]
    told = run._bounds._information(0, 1, pings)
    np.testing.assert_allclose(told[:, :2, :2], expected, rtol=1e-9, atol=1e-15)
    assert not told[:, 2:].any()


def test_bearings_have_no_bound_over_all_paths_and_it_is_said_why():
    run = op.simulate(scenario(ranging={**LAW, "bearing_sigma_deg": 2.0}))
    with pytest.raises(op.ObsplanError, match="no bound over all paths is known for bearings"):
        _ = run.information_bounds


@pytest.mark.parametrize("kind", ["centroid-orbit", "error-ellipse"])
def test_planner_inside_the_step_is_told_depths_that_change_as_one_outside_is(kind, monkeypatch):
    planner = {"kind": kind, "interval": 1.0, "knowledge": "truth"}
    depths = {"auv__0__depth": [10.0, 60.0, 20.0], "auv__1__depth": 35.0}
    mission = scenario(planner=planner, ranging=LAW, duration=20.0, **depths)
    inside = op.simulate(mission, seed=2)
    monkeypatch.setattr("obsplan.simulation.step.expression_of", lambda _planner: None)
    outside = op.simulate(mission, seed=2)
    np.testing.assert_allclose(inside.cna, outside.cna, rtol=1e-9)


def test_how_far_a_short_mission_is_from_the_best_path_is_certified():
    """In a tank, eight ranges: no planner's path is below, and the default's is near the best."""
    folder = files("obsplan") / "scenarios" / "suite"
    tank = op.load(str(folder / "tank-slow.toml")).replace(duration=8.0, ranging__interval=1.0)
    run = op.simulate(tank, planner="information", seed=3001)
    joint, optimal = run.joint_bound(), run.optimal_bound(max_nodes=60)
    for bound in (joint.bound, optimal.bound):
        assert run.information_bounds[0].bound < bound < optimal.achieved
    assert optimal.achieved == pytest.approx(np.mean(run.cramer_rao_variance), rel=1e-9)
    assert 0 < optimal.excess < 0.1
    for planner in ("error-ellipse", "centroid-orbit", "random"):
        other = op.simulate(tank, planner=planner, seed=3001)
        assert np.mean(other.cramer_rao_variance) > max(joint.bound, optimal.bound)


def test_joint_bound_holds_over_heights_losses_and_several_transducers():
    run = flown("error-ellipse", beacon=[MOORED, STERN], duration=40.0)
    bound = run.joint_bound()
    assert 0.2 < bound.bound / np.mean(run.cramer_rao_variance) <= 1.0
    alone = np.mean([own.bound for own in run.information_bounds])
    assert bound.value > alone
    fleet, aids = run._bounds.fleet()
    assert [len(aid_of.pings) for aid_of in fleet] == [*run.came[[0, 2]].sum(axis=(0, 2))]
    assert [aid.swing for aid in aids] == [0.0, 4.0]
