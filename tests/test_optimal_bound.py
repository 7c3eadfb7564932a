"""Branch and bound over paths, against paths that share no code with it."""

import numpy as np
import pytest
from fleets import best_path, mean_squares, random_paths, small_fleet

from formulations import branch_and_bound, regions
from formulations.branch_and_bound import optimal_bound
from formulations.fleet import AidVehicle
from formulations.joint_paths import joint_bound
from formulations.model.ranging import Ranging
from formulations.regions import Stages

SIGMA = 1.0


def bound_of(fleet, achieved, **options):
    auvs, aid, time = fleet
    return optimal_bound(
        auvs, [aid], ranging=Ranging(SIGMA), time=time, achieved=achieved, **options
    )


@pytest.fixture(scope="module")
def fleets():
    """Fleets of one, two and three AUVs, and the least mean square that paths were found to have."""
    made = []
    for seed in range(3):
        rng = np.random.default_rng(200 + seed)
        fleet = small_fleet(rng, auvs=1 + seed % 3, pings=5)
        random = mean_squares(fleet, random_paths(fleet, rng, 2000), SIGMA).min()
        made.append((fleet, min(random, best_path(fleet, rng, SIGMA, starts=1))))
    return made


def ratios(fleets, **options):
    """Bounds over the least that was found, when asked to go far above it."""
    return [bound_of(fleet, 3 * best, **options).bound / best for fleet, best in fleets]


def test_no_random_or_optimised_path_is_below_the_bound_and_it_is_tighter_than_the_joint_one(
    fleets,
):
    found = ratios(fleets, max_nodes=40)
    assert max(found) <= 1.0
    for (fleet, best), ratio in zip(fleets, found, strict=True):
        auvs, aid, time = fleet
        joint = joint_bound(auvs, [aid], ranging=Ranging(SIGMA), time=time, max_iterations=25)
        assert ratio > joint.value / best


def test_more_nodes_never_loosen_it(fleets):
    few, more = (ratios(fleets[:1], max_nodes=n)[0] for n in (4, 24))
    assert few < more


@pytest.mark.parametrize("wrong", ["reach", "boxes", "sight"])
def test_that_adversary_finds_a_wrong_bound(fleets, wrong, monkeypatch):
    if wrong == "reach":
        monkeypatch.setattr(AidVehicle, "reach", lambda self, time: 0.2 * self.speed * time)
    elif wrong == "boxes":  # half of each
        tightened = Stages.tightened

        def halved(self, region):
            tight = tightened(self, region)
            if tight is None:
                return None
            middle = (tight.boxes.low + tight.boxes.high) / 2
            return tight._replace(boxes=tight.boxes._replace(low=middle))

        monkeypatch.setattr(Stages, "tightened", halved)
    else:  # a tenth of the lines of sight
        seen = regions.within

        def narrow(sight, middle, half):
            within = seen(sight, middle, half)
            return within and within._replace(half=0.1 * within.half)

        monkeypatch.setattr(branch_and_bound, "within", narrow)
    assert max(ratios(fleets[:2], max_nodes=20)) > 1.001


def test_a_path_near_the_best_is_certified_as_that():
    rng = np.random.default_rng(201)
    fleet = small_fleet(rng, auvs=2, pings=6)
    best = best_path(fleet, rng, SIGMA)
    bound = bound_of(fleet, best, relative_gap=0.2, max_nodes=200)
    assert bound.closed
    assert bound.bound == pytest.approx(0.8 * best, rel=1e-12)
    assert bound.excess == pytest.approx(0.8**-0.5 - 1, rel=1e-12)
    assert bound.bound_rms_m == pytest.approx(np.sqrt(bound.bound))
    left = bound_of(fleet, best, relative_gap=0.2, max_nodes=2)
    assert not left.closed
    assert left.bound < bound.bound


def test_a_vehicle_that_cannot_move_is_bounded_by_its_only_path():
    auvs, aid, time = small_fleet(np.random.default_rng(2))
    fleet = auvs, AidVehicle(start=aid.start, speed=0.0), time
    only = mean_squares(fleet, np.tile(aid.start, (1, len(time), 1)), SIGMA)[0]
    assert bound_of(fleet, 2 * only, max_nodes=1).bound == pytest.approx(only, rel=1e-6)
    assert bound_of(fleet, only, relative_gap=0.005, max_nodes=9).nodes == 1


def test_without_ranges_all_paths_are_alike():
    auvs, aid, time = small_fleet(np.random.default_rng(2), pings=2, every=3)
    fleet = [one_silent(auv) for auv in auvs], aid, time
    unaided = mean_squares(fleet, np.zeros((1, len(time), 2)), SIGMA)[0]
    bound = bound_of(fleet, unaided, relative_gap=1e-9, max_nodes=9)
    assert bound.closed
    assert bound.nodes == 1
    assert bound_of(fleet, 2 * unaided, max_nodes=9).bound == pytest.approx(unaided, rel=1e-9)


def one_silent(auv):
    fields = {name: getattr(auv, name) for name in auv.__dataclass_fields__}
    nothing = {name: fields[name][:0] for name in ("pings", "places", "aids")}
    return type(auv)(**fields | nothing)


@pytest.mark.parametrize(
    "change",
    [{"achieved": 0.0}, {"achieved": np.nan}, {"relative_gap": 0.0}, {"max_nodes": 0}],
)
def test_optimal_bound_refuses_what_makes_no_sense(change):
    fleet = small_fleet(np.random.default_rng(0))
    with pytest.raises(ValueError, match="achieved must be finite"):
        bound_of(fleet, **{"achieved": 1.0} | change)
