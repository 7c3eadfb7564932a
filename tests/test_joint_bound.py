"""The joint bound against paths that share no code with it, and against the bound of one AUV by itself."""

import math

import numpy as np
import pytest
from fleets import best_path, mean_squares, random_paths, small_fleet

from formulations import joint_paths as module
from formulations.certified_bound import information_bound
from formulations.fleet import AidVehicle
from formulations.joint_paths import joint_bound
from formulations.model.ranging import Ranging
from formulations.sight import Boxes, cheapest, sight_of

SIGMA = 1.0


def bound_of(fleet, **options):
    auvs, aid, time = fleet
    return joint_bound(auvs, [aid], ranging=Ranging(SIGMA), time=time, **options)


def beaten(seeds, *, slow=False, **options):
    """How far random and optimised paths are below the joint bounds of fleets, relative, at most.

    Of a slow vehicle all paths are alike, and the bound is near them.
    """
    most = -math.inf
    for seed in seeds:
        rng = np.random.default_rng(seed)
        auvs, aid, time = small_fleet(rng, auvs=1 + seed % 3)
        speed = 0.02 if slow else aid.speed
        fleet = auvs, AidVehicle(start=aid.start, speed=speed), time
        bound = bound_of(fleet, **options)
        random = mean_squares(fleet, random_paths(fleet, rng, 1000), SIGMA).min()
        best = best_path(fleet, rng, SIGMA, starts=1)
        most = max(most, 1 - min(random, best) / bound.bound)
    return most


def test_no_random_or_optimised_path_is_below_the_joint_bound():
    assert beaten(range(3)) <= 0
    assert beaten(range(3, 6), slow=True) <= 0


def test_that_adversary_finds_a_wrong_bound(monkeypatch):
    """With cells as seen by their middles alone, and with too short a reach, paths are below."""

    def middles(place, boxes, ranging, height):
        middle = (boxes.low + boxes.high) / 2
        return sight_of(place, Boxes(middle, middle), ranging, height)

    with monkeypatch.context() as patch:
        patch.setattr(module, "sight_of", middles)
        assert beaten(range(3, 6), slow=True, cells=1) > 1e-3
    with monkeypatch.context() as patch:
        patch.setattr(AidVehicle, "reach", lambda self, duration: 0.1 * self.speed * duration)
        assert beaten(range(3)) > 1e-3


def test_joint_bound_is_at_least_the_bound_of_each_auv_by_itself_and_finer_cells_tighten_it():
    fleet = small_fleet(np.random.default_rng(5), auvs=3, pings=8)
    auvs, _, _ = fleet
    alone = 0.0
    for auv in auvs:
        own = information_bound(
            auv.P0, auv.F, auv.Q, auv.J_other, pings=auv.pings, sigma=SIGMA, relative_gap=1e-4
        )
        alone += auv.weight / sum(a.weight for a in auvs) * own.bound
    coarse = bound_of(fleet, cells=2)
    fine = bound_of(fleet, cells=40)
    assert alone <= coarse.value
    assert coarse.bound <= fine.value
    assert fine.bound > 1.01 * alone


def test_a_vehicle_that_cannot_move_is_bounded_by_its_only_path():
    auvs, aid, time = small_fleet(np.random.default_rng(2))
    fleet = auvs, AidVehicle(start=aid.start, speed=0.0), time
    stays = np.tile(aid.start, (1, len(time), 1))
    only = mean_squares(fleet, stays, SIGMA)[0]
    assert bound_of(fleet, cells=200, relative_gap=1e-5).bound == pytest.approx(only, rel=1e-4)


def test_lines_of_sight_into_a_box_are_those_to_its_points():
    rng = np.random.default_rng(1)
    for _ in range(50):
        low = rng.uniform(-3, 3, (1, 2))
        boxes = Boxes(low, low + rng.uniform(0, 3, (1, 2)))
        place, ranging = rng.uniform(-3, 3, 2), Ranging(0.5, growth=0.3)
        root = rng.normal(size=(2, 2))
        cost = -(root @ root.T)[None]
        least, _ = cheapest(cost, sight_of(place, boxes, ranging))
        points = rng.uniform(boxes.low, boxes.high, (4000, 2)) - place
        r2 = np.sum(points**2, axis=1)
        variance = 0.25 + 0.09 * r2
        worth = 1 / (r2 * variance) + 2 * 0.3**4 / variance**2
        costs = worth * np.einsum("ki,ij,kj->k", points, cost[0], points)
        assert least <= costs.min() * (1 - 1e-12)
        plain = cheapest(cost, sight_of(place, boxes, Ranging(0.5)))[0]
        nearly = np.min(4 * np.einsum("ki,ij,kj->k", points, cost[0], points) / r2)
        assert plain == pytest.approx(nearly, rel=0.05)


def test_no_aid_vehicle_or_no_range_leaves_what_auvs_know_by_themselves():
    fleet = small_fleet(np.random.default_rng(3), pings=0, every=2)
    auvs, _, time = small_fleet(np.random.default_rng(3))
    silent = [
        type(a)(
            P0=a.P0,
            F=a.F,
            Q=a.Q,
            J_other=a.J_other,
            pings=a.pings[:0],
            places=a.places[:0],
            aids=a.aids[:0],
            weight=a.weight,
        )
        for a in auvs
    ]
    none = joint_bound(silent, [], ranging=Ranging(1.0), time=time)
    unaided = mean_squares((silent, None, time), np.zeros((1, len(time), 2)), 1.0)[0]
    assert none.bound == pytest.approx(unaided, rel=1e-12)
    assert (none.gap, none.cells) == (0.0, 0)
    assert bound_of(fleet).gap == 0.0


def changed(auv, **change):
    fields = {name: getattr(auv, name) for name in auv.__dataclass_fields__}
    return type(auv)(**fields | change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pings": np.array([-1, 2, 3])}, "pings must be steps 0 to 11, got -1 to 3"),
        ({"aids": np.array([0, 0, 1])}, "aid vehicles of AUV 0 must be 0 to 0, got 0 to 1"),
        ({"aids": np.array([0])}, "must have a place and an aid vehicle for each of 3 pings"),
        ({"places": np.full((3, 2), np.nan)}, "places and heights of AUV 0 must be finite"),
        ({"P0": np.full((4, 4), np.nan)}, "must be finite and not overflow"),
        ({"weight": -1.0}, "weights must be at least 0"),
    ],
)
def test_joint_bound_refuses_what_makes_no_sense(change, message):
    auvs, aid, time = small_fleet(np.random.default_rng(0))
    wrong = [changed(auvs[0], **change), auvs[1]]
    with pytest.raises(ValueError, match=message):
        joint_bound(wrong, [aid], ranging=Ranging(1.0), time=time)


def test_joint_bound_refuses_no_auvs_and_numbers_that_make_no_sense():
    auvs, aid, time = small_fleet(np.random.default_rng(0))
    with pytest.raises(ValueError, match="give at least one AUV"):
        joint_bound([], [aid], ranging=Ranging(1.0), time=time)
    with pytest.raises(ValueError, match="must be positive, got 0"):
        joint_bound(auvs, [aid], ranging=Ranging(1.0), time=time, cells=0)
    with pytest.raises(ValueError, match="times must be finite and not fall"):
        joint_bound(auvs, [aid], ranging=Ranging(1.0), time=time[::-1])
    with pytest.raises(ValueError, match="one weight per sample"):
        joint_bound(auvs, [aid], ranging=Ranging(1.0), time=time, weights=np.ones(2))
    with pytest.raises(ValueError, match="12 samples, got 12 steps"):
        joint_bound(auvs, [aid], ranging=Ranging(1.0), time=time[:-1])
    with pytest.raises(ValueError, match="speed and swing finite and at least 0"):
        AidVehicle(start=np.zeros(2), speed=math.nan)


def test_a_prior_that_is_singular_is_bounded():
    auvs, aid, time = small_fleet(np.random.default_rng(4))
    known = [changed(auv, P0=np.zeros((4, 4))) for auv in auvs]
    bound = joint_bound(known, [aid], ranging=Ranging(1.0), time=time)
    straight = mean_squares((known, aid, time), np.tile(aid.start, (1, len(time), 1)), 1.0)[0]
    assert 0 < bound.bound < straight
