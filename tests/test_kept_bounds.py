"""Certified bounds are found once for all planners, and again for whatever they depend on."""

import dataclasses

import numpy as np
import pytest
from oracles import scenario

import obsplan as op
from obsplan import bounds, kept_bounds
from obsplan.kept_bounds import KeptBounds, size


@pytest.fixture
def kept(monkeypatch):
    """Nothing kept yet, and a list of what is computed."""
    found = []

    def counted(*arguments, **options):
        found.append(arguments)
        return information_bound(*arguments, **options)

    information_bound = kept_bounds.information_bound
    monkeypatch.setattr(kept_bounds, "information_bound", counted)
    monkeypatch.setattr(bounds, "KEPT", KeptBounds())
    return found


def question():
    """Six steps of a point that drifts, ranged at two of them."""
    return {
        "P0": np.eye(2),
        "F": np.tile(np.eye(2), (6, 1, 1)),
        "Q": 0.1 * np.eye(2),
        "J": np.zeros((6, 2, 2)),
        "pings": np.array([2, 4]),
        "sigma": np.array([1.0, 2.0]),
        "progress": lambda _share: None,
    }


@pytest.mark.parametrize("kind", ["range", "squared-range"])
def test_planners_share_the_bounds_of_a_seed_and_seeds_do_not(kept, kind):
    mission = scenario(ranging__kind=kind, ranging__sigma=20.0)
    bounds = {
        (planner, seed): op.simulate(mission, planner=planner, seed=seed).information_bounds
        for planner in ("random", "stationary", "path-inertia")
        for seed in (1, 2)
    }
    assert len(kept) == 4  # two AUVs, two seeds
    for seed in (1, 2):
        assert bounds["random", seed] == bounds["stationary", seed] == bounds["path-inertia", seed]
    assert bounds["random", 1][0].bound != bounds["random", 2][0].bound


def test_squared_ranges_are_bounded_anew_from_another_start(kept):
    for x in (80.0, 81.0):
        mission = scenario(ranging__kind="squared-range", ranging__sigma=20.0, cna__start__x=x)
        _ = op.simulate(mission, planner="stationary").information_bounds
    assert len(kept) == 4
    _ = op.simulate(mission, planner="stationary", seed=1).information_bounds
    assert len(kept) == 4


def test_the_least_change_of_anything_it_depends_on_is_another_bound(kept):
    bounds, first = KeptBounds(), question()
    assert bounds.bound(**first) is bounds.bound(**first)
    assert len(kept) == 1
    for count, name in enumerate(("P0", "F", "Q", "J", "sigma"), start=2):
        changed = first[name].copy()
        changed.flat[0] = np.nextafter(changed.flat[0], 2.0)
        bounds.bound(**first | {name: changed})
        assert len(kept) == count, name
    bounds.bound(**first | {"pings": np.array([2, 5])})
    assert len(kept) == 7


def test_no_more_is_kept_than_there_is_room_for_and_the_oldest_goes_first(kept):
    questions = [question() | {"sigma": np.array([1.0, 2.0 + k])} for k in range(3)]
    room = size(KeptBounds().bound(**questions[0]))
    bounds = KeptBounds(2 * room)
    kept.clear()
    for k in (0, 1, 0, 2, 0, 2):  # the third drops the second
        bounds.bound(**questions[k])
    assert len(kept) == 3
    bounds.bound(**questions[1])
    assert len(kept) == 4
    KeptBounds(0).bound(**questions[0])  # keeps nothing, and answers
    assert len(kept) == 5


def test_a_bound_that_was_not_asked_for_is_not_computed_and_nothing_stands_in_for_it(kept):
    run = dataclasses.replace(op.simulate(scenario()), bounded=False)
    summary = run.summary()
    for figures in (summary["all"], *summary["auv"].values()):
        assert figures["bound_rms_m"] is figures["efficiency"] is None
    assert summary["unbounded"] == "no bound over all paths was asked for"
    certain = dataclasses.replace(run)
    certain.__dict__["cramer_rao"] = np.zeros_like(run.cramer_rao)
    assert certain.summary()["all"]["efficiency"] is None
    with pytest.raises(op.ObsplanError, match="no bound over all paths was asked for"):
        run.certify()
    assert kept == []


def test_progress_of_the_bounds_rises_to_all_auvs(kept):
    run, told = op.simulate(scenario()), []
    bounds = run.certify(lambda done, total: told.append((done, total)))
    done = [at for at, _ in told]
    assert done == sorted(done)
    assert done[-1] == 2
    assert {total for _, total in told} == {2}
    assert run.information_bounds is bounds
    assert len(kept) == 2
