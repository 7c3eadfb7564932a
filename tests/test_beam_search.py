"""The search for informative manoeuvres: covariances against integrated differential equations, the beam against every sequence."""

import ctypes
import itertools
import math

import casadi as ca
import numpy as np
import pytest
from jaxtyping import config
from oracles import arc
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from formulations.beam_search import (
    Link,
    ToGo,
    cost_to_go,
    search,
    search_manoeuvres,
    selection,
    turn_candidates,
)
from formulations.beam_search.branching import Kind, branching
from formulations.beam_search.compiled import Compiled, machine_code
from formulations.beam_search.interpreted import Interpreted
from formulations.beam_search.search import beam_of
from formulations.beam_search.selection import LOOKS
from formulations.model import covariance
from formulations.model.compiler import compiled_library
from formulations.model.covariance import Tracks, conditioned, motions, pack_array
from formulations.model.lanes import in_lanes, vectors
from formulations.model.ranging import Form, Ranging
from formulations.model.schedule import Stages, ping_stages
from formulations.solution import Status


def positive_definite(rng, scale):
    """Covariance of (east, north, heading, speed), everything correlated."""
    half = rng.normal(size=(4, 4)) * scale
    return half @ half.T


def drift_of(heading, speed):
    """Jacobian of the AUV's velocity: (speed cos heading, speed sin heading, 0, 0)."""
    A = np.zeros((4, 4))
    A[:2, 2] = speed * math.cos(heading + math.pi / 2), speed * math.sin(heading + math.pi / 2)
    A[:2, 3] = math.cos(heading), math.sin(heading)
    return A


# Prediction


def predicted(P, heading, speed, noise, duration):
    course = motions(np.array(heading), np.array(speed))
    return covariance.predicted(P, course, noise, duration)


def test_prediction_solves_the_lyapunov_equation_without_noise_on_the_heading():
    rng = np.random.default_rng(1)
    for _ in range(10):
        P, noise = positive_definite(rng, 0.5), rng.uniform(0.01, 0.3, 4)
        heading, speed, duration = rng.uniform(-3, 3), rng.uniform(0, 2), rng.uniform(0.1, 20)
        A, Q = drift_of(heading, speed), np.diag(noise**2 * [1, 1, 0, 1])

        def rate(_t, p, A=A, Q=Q):
            return (A @ p.reshape(4, 4) + p.reshape(4, 4) @ A.T + Q).ravel()

        integrated = (
            solve_ivp(rate, (0, duration), P.ravel(), method="DOP853", rtol=1e-12, atol=1e-12)
            .y[:, -1]
            .reshape(4, 4)
        )
        answer = predicted(P, heading, speed, noise, duration)
        np.testing.assert_allclose(answer, integrated, rtol=1e-9, atol=1e-10)
        assert answer[2, 2] == P[2, 2]


def test_prediction_is_van_loans_matrix_exponential():
    rng = np.random.default_rng(2)
    P, noise, duration = positive_definite(rng, 0.5), np.array([0.1, 0.1, 0.2, 0.05]), 7.0
    A, Q = drift_of(0.7, 1.3), np.diag(noise**2 * [1, 1, 0, 1])
    block = expm(np.block([[-A, Q], [np.zeros((4, 4)), A.T]]) * duration)  # Van Loan 1978, eq. 1.3
    F = block[4:, 4:].T
    np.testing.assert_allclose(
        predicted(P, 0.7, 1.3, noise, duration), F @ P @ F.T + F @ block[:4, 4:], rtol=1e-12
    )


# Ranges


def updated(P, x, sigma=1.0, pings=1.0, squared=False):
    return conditioned(P, np.asarray(x, dtype=float), Ranging(sigma, squared), pings)


@pytest.mark.parametrize("squared", [False, True])
def test_ranges_add_information_along_the_line_of_sight(squared):
    rng = np.random.default_rng(3)
    for _ in range(20):
        P, x = positive_definite(rng, 1.0), rng.uniform(-30, 30, 2)
        sigma, pings = rng.uniform(0.1, 5), rng.uniform(0.5, 9)
        d, axis = math.hypot(*x), np.array([*x, 0, 0])
        C = P[:2, :2]
        if squared:  # E (e'e)^2 of a Gaussian e = (tr C)^2 + 2 tr C^2, against the gradient 2x
            H, R = 2 * axis, sigma**2 / pings + np.trace(C) ** 2 + 2 * np.trace(C @ C)
        else:
            across = np.array([-x[1], x[0]]) / d
            H, R = axis / d, sigma**2 / pings + 0.75 * (across @ C @ across / d) ** 2
        expected = np.linalg.inv(np.linalg.inv(P) + np.outer(H, H) / R)
        np.testing.assert_allclose(
            updated(P, x, sigma, pings, squared), expected, rtol=1e-7, atol=1e-9
        )


@pytest.mark.parametrize("squared", [False, True])
def test_second_order_error_is_that_of_sampled_ranges(squared):
    rng = np.random.default_rng(4)
    x, samples = np.array([10.0, 0.0]), 1_000_000
    half = np.array([[0.30, 0.0], [0.22, 0.15]])
    P = np.diag([0.0, 0.0, 0.01, 0.01])
    P[:2, :2] = half @ half.T
    e = rng.standard_normal((samples, 2)) @ half.T
    away, d = x + e, 10.0
    left_out = (
        np.sum(away**2, axis=1) - 100 - 2 * e @ x if squared else np.hypot(*away.T) - d - e @ x / d
    )
    H = np.array([*(2 * x if squared else x / d), 0.0, 0.0])
    gained = P - updated(P, x, sigma=1e-9, squared=squared)
    along = H @ P @ H
    variance = (
        along**2 / (H @ gained @ H) - along
    )  # what the update took for the variance of its range
    # the fourth moment's standard error is at most sqrt(96/9 / samples) = 0.33 %; terms left out are (0.3 / 10)^2 = 0.1 % of it
    assert variance == pytest.approx(np.mean(left_out**2), rel=4 * 0.0033 + 0.002)


@pytest.mark.parametrize("squared", [False, True])
def test_range_from_on_top_of_an_auv_tells_nothing(squared):
    P = positive_definite(np.random.default_rng(5), 1.0)
    np.testing.assert_array_equal(updated(P, (0.0, 0.0), squared=squared), P)


def test_close_to_an_uncertain_auv_a_range_is_worth_less():
    P = np.diag([4.0, 4.0, 0.01, 0.01])
    remaining = [np.trace(updated(P, (d, 0.0), sigma=0.1)[:2, :2]) for d in (0.5, 1, 2, 4, 8, 16)]
    assert (np.diff(remaining) < 0).all()
    assert remaining[-1] == pytest.approx(4.0, abs=0.1)
    assert remaining[0] > 7.0


# Stages and candidates


@pytest.mark.parametrize(
    ("time", "first"),
    [(0.0, 15.0), (1.0, 14.0), (14.5, 0.5), (15.0, 15.0), (44.0, 1.0), (45.0, 15.0)],
)
def test_stages_end_at_pings_where_these_are_rare(time, first):
    stages = ping_stages(time, 15.0, 20.0, 6)
    np.testing.assert_allclose(stages.duration, [first, *[15.0] * 5], rtol=1e-12)
    np.testing.assert_array_equal(stages.pings, np.ones(6))


def test_time_of_a_ping_is_known_however_it_is_rounded():
    for k in range(2000):
        assert ping_stages(k * 0.7, 0.7, 1.0, 4).duration[0] == pytest.approx(0.7, rel=1e-5)


def test_frequent_pings_share_a_stage():
    stages = ping_stages(3.21, 0.1, 20.0, 6)
    np.testing.assert_allclose(stages.duration, np.full(6, 20 / 6))
    assert stages.pings.sum() == pytest.approx(200)


@pytest.mark.parametrize("count", [3, 5, 7])
def test_candidates_are_straight_on_and_pairs_from_left_to_right(count):
    candidates = turn_candidates(0.9, count)
    assert candidates.size == count
    assert (np.diff(candidates) < 0).all()
    np.testing.assert_array_equal(candidates, -candidates[::-1])
    assert candidates[0] == 0.9
    positive = candidates[candidates > 0]
    np.testing.assert_allclose(positive[:-1] / positive[1:], 3.0)


# Search


def problem(rng, auvs=2, stages=3):
    """A search small enough to go through every sequence."""
    duration = rng.uniform(1, 6, stages)
    return {
        "pose": np.array([*rng.uniform(-15, 15, 2), rng.uniform(-3, 3)]),
        "covariance": np.array([positive_definite(rng, 0.8) for _ in range(auvs)]),
        "tracks": Tracks(
            rng.uniform(-15, 15, (stages, auvs, 2)),
            rng.uniform(-3, 3, (stages, auvs)),
            rng.uniform(0, 2, (stages, auvs)),
        ),
        "process_noise": rng.uniform(0.01, 0.2, (auvs, 4)),
        "weights": rng.uniform(0.5, 2, auvs),
        "stages": Stages(duration, rng.uniform(1, 5, stages)),
        "turn_rates": turn_candidates(0.4, 5),
        "speed": 2.0,
        "ranging": Ranging(0.7),
    }


def flown(given, turns):
    """Positions at the stages' ends after a sequence of turns, on arcs in complex numbers."""
    pose, places = given["pose"], []
    for turn, duration in zip(turns, given["stages"].duration, strict=True):
        pose = arc(pose, turn, given["speed"], duration)
        places.append(pose[:2])
    return places


def cost_of(given, turns, criterion="trace"):
    """Mean criterion of a sequence."""
    return sum(costs_of(given, turns, criterion))


def costs_of(given, turns, criterion="trace"):
    """What each stage adds to it, one AUV after the other by integrated equations and information matrices."""
    added, share = np.zeros(len(turns)), given["weights"] / given["weights"].sum()
    duration, pings = given["stages"]
    places = flown(given, turns)
    for i, weight in enumerate(share):
        P, q = given["covariance"][i], np.diag(given["process_noise"][i] ** 2 * [1, 1, 0, 1])
        for s, place in enumerate(places):
            A = drift_of(given["tracks"].heading[s, i], given["tracks"].speed[s, i])
            block = expm(np.block([[-A, q], [np.zeros((4, 4)), A.T]]) * duration[s])
            F = block[4:, 4:].T
            P = F @ P @ F.T + F @ block[:4, 4:]
            x = place - given["tracks"].position[s, i]
            d = math.hypot(*x)
            across = np.array([-x[1], x[0]]) / d
            R = (
                given["ranging"].sigma ** 2 / pings[s]
                + 0.75 * (across @ P[:2, :2] @ across / d) ** 2
            )
            H = np.array([*x, 0, 0]) / d
            P = np.linalg.inv(np.linalg.inv(P) + np.outer(H, H) / R)
            value = np.trace(P[:2, :2]) if criterion == "trace" else np.linalg.slogdet(P[:2, :2])[1]
            added[s] += weight * value * duration[s] / duration.sum()
    return added


@pytest.mark.parametrize("criterion", ["trace", "log-det"])
def test_full_beam_finds_the_best_of_all_sequences(criterion):
    rng = np.random.default_rng(6)
    for _ in range(3):
        given = problem(rng)
        costs = {
            turns: cost_of(given, turns, criterion)
            for turns in itertools.product(given["turn_rates"], repeat=3)
        }
        best = min(costs, key=costs.get)
        found = search_manoeuvres(**given, criterion=criterion, beam_width=5**3)
        assert tuple(found.x) == best
        assert found.objective == pytest.approx(costs[best], rel=1e-8)
        assert (found.status, found.primal_residual) == (Status.OPTIMAL, 0.0)


def test_lost_throughput_costs_its_share_at_the_stages_ends():
    given, weight, half = problem(np.random.default_rng(16)), 40.0, 12.0
    share = given["weights"] / given["weights"].sum()
    costs = {}
    for turns in itertools.product(given["turn_rates"], repeat=3):
        lost = 0.0
        for s, place in enumerate(flown(given, turns)):
            d = np.hypot(*(place - given["tracks"].position[s]).T)
            left = 0.5 ** ((d / half) ** 2)
            left += 0.01 * (1 - left) / (1 + d / half)  # from afar nearer is better, too
            lost += share @ (1 - left) * given["stages"].duration[s]
        costs[turns] = cost_of(given, turns) + weight * lost / given["stages"].duration.sum()
    best = min(costs, key=costs.get)
    found = search_manoeuvres(**given, link=Link(weight, half), beam_width=5**3)
    assert tuple(found.x) == best
    assert found.objective == pytest.approx(costs[best], rel=1e-8)
    assert tuple(search_manoeuvres(**given, beam_width=5**3).x) != best


def ranked_by_hand(given, per_metre, near, width):
    """The sequence that a beam of a width ends with, each of its nodes ranked by cost and by what its own distance will cost."""
    rates, share = given["turn_rates"], given["weights"] / given["weights"].sum()
    whole = list(itertools.product(rates, repeat=len(given["stages"].duration)))
    costs = {turns: np.cumsum(costs_of(given, turns)) for turns in whole}
    places = {turns: flown(given, turns) for turns in whole}
    kept = [()]
    for s in range(len(whole[0])):
        rank = {}
        for turns in whole:
            if turns[:s] in kept:
                away = np.linalg.norm(places[turns][s] - given["tracks"].position[s], axis=1)
                rank[turns[: s + 1]] = costs[turns][s] + share * per_metre @ np.maximum(
                    away - near, 0
                )
        kept = sorted(rank, key=rank.get)[: width if s + 1 < len(whole[0]) else 1]
    return kept[0], costs[kept[0]][-1]


def test_nodes_at_every_level_are_ranked_by_cost_and_what_their_own_distance_will_cost():
    rng, others = np.random.default_rng(17), 0
    for near in (0.0, 0.0, 30.0, 30.0):
        given, per_metre = problem(rng), rng.uniform(0.01, 0.2, 2)
        turns, cost = ranked_by_hand(given, per_metre, near, 4)
        found = search_manoeuvres(**given, to_go=ToGo(per_metre, near), beam_width=4)
        assert tuple(found.x) == turns
        assert found.objective == pytest.approx(cost, rel=1e-8)  # without what is to come
        others += tuple(search_manoeuvres(**given, beam_width=4).x) != turns
    assert others > 0


def test_nothing_is_to_come_within_twenty_errors_of_a_range_or_where_errors_grow():
    told = {"speed": 2.0, "horizon": 30.0, "criterion": "trace"}
    P = np.diag([4.0, 9.0, 1.0, 1.0])[None]
    plain = cost_to_go(P, ranging=Ranging(1.5), **told)
    assert plain.per_metre == pytest.approx(0.1 * 13.0 / 60.0)
    assert plain.near == 30.0
    squared = cost_to_go(P, ranging=Ranging(10.0, squared=True), **told)
    assert 10.0 / (2 * squared.near) == pytest.approx(squared.near / 20)  # of the range itself
    assert cost_to_go(P, ranging=Ranging(1.5, growth=0.01), **told) == ToGo()


def test_narrow_beam_says_what_its_sequence_costs_and_loses_little():
    rng = np.random.default_rng(7)
    lost = []
    for _ in range(10):
        given = problem(rng, stages=4)
        best, narrow = (search_manoeuvres(**given, beam_width=width) for width in (5**4, 8))
        assert narrow.objective == pytest.approx(cost_of(given, narrow.x), rel=1e-8)
        assert narrow.objective >= best.objective
        lost.append(narrow.objective / best.objective - 1)
    assert np.median(lost) < 0.02


def test_of_equals_the_left_turn_is_taken():
    given = problem(np.random.default_rng(8), auvs=1) | {
        "pose": np.zeros(3),
        "covariance": np.diag([4.0, 4.0, 0.0, 0.0])[None],
    }
    ahead = np.broadcast_to(np.array([20.0, 0.0]), (3, 1, 2))
    found = search_manoeuvres(
        **given | {"tracks": Tracks(ahead, np.zeros((3, 1)), np.zeros((3, 1)))}, beam_width=125
    )
    turning = found.x[found.x != 0]
    assert turning[0] > 0


def test_weights_count_relative_to_each_other_and_zero_not_at_all():
    rng = np.random.default_rng(9)
    given = problem(rng)
    plain, scaled = (
        search_manoeuvres(**given | {"weights": given["weights"] * factor}) for factor in (1.0, 8.0)
    )
    assert scaled.objective == pytest.approx(plain.objective, rel=1e-12)
    np.testing.assert_array_equal(scaled.x, plain.x)
    alone = {key: given[key][:1] for key in ("covariance", "process_noise", "weights")}
    alone["tracks"] = Tracks(*(part[:, :1] for part in given["tracks"][:3]))
    one = search_manoeuvres(**given | alone)
    muted = search_manoeuvres(**given | {"weights": np.array([3.0, 0.0])})
    np.testing.assert_array_equal(muted.x, one.x)
    assert muted.objective == pytest.approx(one.objective, rel=1e-12)


def test_auv_on_the_way_makes_nothing_that_is_no_number():
    given = problem(np.random.default_rng(10), auvs=1) | {
        "pose": np.zeros(3),
        "stages": Stages(np.full(3, 2.0), np.ones(3)),
    }
    under = np.array([[[4.0, 0.0]], [[8.0, 0.0]], [[12.0, 0.0]]])
    found = search_manoeuvres(
        **given | {"tracks": Tracks(under, np.zeros((3, 1)), np.zeros((3, 1)))}, beam_width=125
    )
    assert np.isfinite(found.objective)


@pytest.mark.parametrize("name", ["covariance", "weights"])
def test_numbers_of_auvs_that_differ_are_refused_before_machine_code_reads_them(name):
    given = problem(np.random.default_rng(7))
    config.update("jaxtyping_disable", True)  # as it is outside of tests
    try:
        with pytest.raises(ValueError, match="give covariances and tracks of"):
            search_manoeuvres(**given | {name: given[name][:1]})
    finally:
        config.update("jaxtyping_disable", False)


def test_known_position_has_a_finite_log_determinant():
    given = problem(np.random.default_rng(11)) | {
        "covariance": np.zeros((2, 4, 4)),
        "process_noise": np.zeros((2, 4)),
    }
    assert np.isfinite(search_manoeuvres(**given, criterion="log-det").objective)


# Machine code

PLAIN = Form()
EVERYTHING = Ranging(0.7, growth=0.05, slant=True, loss=0.2, half_distance=20.0, reach=25.0)


def deep(given, states):
    """What of a problem is different where the AUVs are 9 m deep, and that is one of 5 states."""
    P = np.tile(np.eye(states), (len(given["covariance"]), 1, 1))
    P[:, :4, :4] = given["covariance"]
    noise = np.full(P.shape[:2], 0.1)
    return {
        "covariance": P,
        "process_noise": noise,
        "tracks": given["tracks"]._replace(height=9.0),
    }


def beams(auvs, stages, width, *, form=PLAIN, criterion="trace", states=4, linked=False):
    """What a search works with, as machine code and as arrays."""
    kind = Kind(auvs, 5, form, criterion, states, linked=linked)
    library = machine_code(kind)
    if library is None:
        pytest.skip("there is no C compiler")
    compiled = Compiled(library, kind, stages, width)
    return compiled, Interpreted(branching(kind), 5, width)


@pytest.mark.parametrize(
    ("ranging", "criterion", "states", "link"),
    [
        (Ranging(0.7), "trace", 4, Link()),
        (Ranging(0.7, squared=True), "log-det", 4, Link()),
        (EVERYTHING, "trace", 4, Link(3.0, 12.0)),
        (EVERYTHING, "log-det", 5, Link()),
    ],
)
@pytest.mark.parametrize("width", [1, 7, 60])
@pytest.mark.parametrize("spoilt", [False, True])
def test_machine_code_finds_what_arrays_find_to_the_last_bit(
    ranging, criterion, states, link, width, spoilt
):
    given = problem(np.random.default_rng(width), auvs=2, stages=4)
    given |= deep(given, states)
    told = search._told(
        *(given[name] for name in ("tracks", "process_noise", "weights", "stages", "turn_rates")),
        speed=2.0,
        ranging=ranging,
        link=link,
        to_go=ToGo(np.array([0.03, 0.2]), 10.0),
    )
    form, linked = ranging.form, link.weight > 0
    if spoilt:  # one turn of the second stage leads nowhere
        told[1, -2] = math.nan
    covariance = pack_array(given["covariance"])
    found = []
    for beam in beams(2, 4, width, form=form, criterion=criterion, states=states, linked=linked):
        beam.begin(given["pose"], covariance)
        beam.search(told)
        found.append(beam.first(told))
    for machine, arrays in zip(*found, strict=True):
        np.testing.assert_array_equal(machine, arrays)


def test_machine_code_goes_stage_by_stage_as_arrays_do():
    given = problem(np.random.default_rng(21), auvs=3, stages=3)
    names = ("tracks", "process_noise", "weights", "stages", "turn_rates", "speed", "ranging")
    told = search._told(*(given[name] for name in names), to_go=ToGo(0.1, 10.0))
    machine, arrays = beams(3, 3, 40)
    rng, covariance = np.random.default_rng(22), pack_array(given["covariance"])
    for beam in (machine, arrays):
        beam.begin(given["pose"], covariance)
    for of_stage in told:
        np.testing.assert_array_equal(machine.pose, arrays.pose)
        cost = arrays.branch(of_stage)
        np.testing.assert_array_equal(machine.branch(of_stage), cost)
        kept = rng.permutation(cost.size)[:40]
        machine.follow(kept)
        arrays.follow(kept)
    for part, other in zip(machine.first(told), arrays.first(told), strict=True):
        np.testing.assert_array_equal(part, other)


def test_what_is_to_come_counts_slant_distances_where_ranges_are_slant():
    given = problem(np.random.default_rng(23))
    given |= deep(given, 4)
    names = ("tracks", "process_noise", "weights", "stages", "turn_rates", "speed")
    ranks = []
    for per_metre in (0.0, 0.1):
        beam = Interpreted(branching(Kind(2, 5, EVERYTHING.form, "trace")), 5, 9)
        beam.begin(given["pose"], pack_array(given["covariance"]))
        told = search._told(
            *(given[name] for name in names), ranging=EVERYTHING, to_go=ToGo(per_metre)
        )
        ranks.append(beam.branch(told[0]).copy())
    share = given["weights"] / given["weights"].sum()
    for k, turn in enumerate(given["turn_rates"]):
        there = arc(given["pose"], turn, 2.0, given["stages"].duration[0])[:2]
        away = np.hypot(np.linalg.norm(there - given["tracks"].position[0], axis=1), 9.0)
        assert ranks[1][k] - ranks[0][k] == pytest.approx(0.1 * share @ away, rel=1e-9)


def by_machine_code(cost, count):
    library = machine_code(Kind(2, 5, Form(), "trace"))
    if library is None:
        pytest.skip("there is no C compiler")
    kept, key, among = (np.empty(cost.size, dtype=np.int64) for _ in range(3))
    addresses = [ctypes.c_void_p(a.ctypes.data) for a in (cost, kept, key, among)]
    sizes = ctypes.c_int64(cost.size), ctypes.c_int64(count)
    n = library.cheapest(sizes[0], addresses[0], sizes[1], *addresses[1:])
    return kept[:n]


@pytest.mark.parametrize("select", [selection.cheapest, by_machine_code])
@pytest.mark.parametrize("spread", [0.0, 1.0, 700.0])
def test_the_cheapest_are_kept_in_their_own_order_and_of_equals_the_first(select, spread):
    """Equal is what has the same 31 leading bits."""

    def leading(number):
        fraction, exponent = math.frexp(number)
        if abs(number) < 1e-310 or not math.isfinite(number):
            return number if abs(number) > 1.0 else 0.0
        return math.ldexp(round(fraction * 2**31), exponent - 31)

    rng = np.random.default_rng(int(spread))
    for _ in range(200):
        cost = rng.integers(-3, 9, rng.integers(1, 400)) * np.exp(
            spread * rng.uniform(-1, 1, 1 if rng.random() < 0.5 else None)
        )
        cost = cost * np.where(rng.random(cost.size) < 0.5, 1.0, rng.random(cost.size))
        for value in (np.nan, -np.nan, np.inf, -np.inf, -0.0, 5e-324):
            cost[rng.random(cost.size) < 0.1 * rng.integers(0, 3)] = value
        count = int(rng.integers(1, cost.size + 5))
        cost *= 1.0 + 1e-13 * rng.integers(-1, 2, cost.size)  # rounding
        numbers = [i for i in range(cost.size) if cost[i] == cost[i]]
        nothing = [i for i in range(cost.size) if cost[i] != cost[i]]
        ranked = sorted(numbers, key=lambda i, cost=cost: (leading(cost[i]), i)) + nothing
        np.testing.assert_array_equal(select(cost, count), sorted(ranked[:count]))


def test_each_lane_has_the_bits_of_the_function_itself():
    x, y, shared = ca.SX.sym("x"), ca.SX.sym("y"), ca.SX.sym("s")
    both = [ca.fmax(x, y), ca.fmin(x, shared), ca.power(x, y), ca.atan2(x, y), x / y - shared]
    alone = [ca.sqrt(x), ca.exp(x), ca.log(y), ca.sin(x), ca.fabs(y), x**2, 2 * x, 1 / y, x**5]
    choices = [x < y, y <= x, x < 7.0, x <= 7.0, ca.if_else(x < y, 1 / x, y), ca.logic_not(x)]
    results = ca.vertcat(
        *both, *alone, *choices, ca.power(x, ca.fmax(shared, 1.0)), ca.cos(shared) * 3.0
    )
    function = ca.Function("f", [x, y, shared], [results])
    wrapped = "void g(const lanes* x, const lanes* y, const double* s, lanes* r) { f(x, y, s, r); }"
    path = compiled_library(vectors() + in_lanes(function, shared=[2]) + wrapped, asked_for=False)
    if path is None:
        pytest.skip("there is no C compiler")
    arrays = [np.empty(size + 8) for size in (4, 4, 1, 4 * results.numel())]
    aligned = [a[-a.ctypes.data // 8 % 4 :] for a in arrays]
    aligned[0][:4], aligned[1][:4] = [0.3, 7.0, np.nan, 2.0], [1.7, -0.1, 1.0, np.nan]
    aligned[2][0] = 0.7
    ctypes.CDLL(str(path)).g(*(ctypes.c_void_p(a.ctypes.data) for a in aligned))
    for lane in range(4):
        expected = function(aligned[0][lane], aligned[1][lane], 0.7).full()[:, 0]
        np.testing.assert_array_equal(aligned[3][lane : 4 * results.numel() : 4], expected)


def test_an_operation_that_vectors_do_not_have_is_no_silent_other_one():
    x = ca.SX.sym("x")
    with pytest.raises(KeyError):
        in_lanes(ca.Function("f", [x], [ca.tanh(x)]))


# Limits


def test_sequences_that_break_limits_are_taken_last_and_the_first_turn_counts_most():
    given = problem(np.random.default_rng(12))
    K = given["turn_rates"].size
    free = search_manoeuvres(**given, beam_width=125)
    banned = (given["turn_rates"] == free.x[0]).astype(float)
    other = search_manoeuvres(**given, beam_width=125, first_violation=banned)
    costs = {
        turns: cost_of(given, turns) for turns in itertools.product(given["turn_rates"], repeat=3)
    }
    allowed = {turns: cost for turns, cost in costs.items() if turns[0] != free.x[0]}
    assert tuple(other.x) == min(allowed, key=allowed.get)
    assert (other.status, other.primal_residual) == (Status.OPTIMAL, 0.0)
    least = np.linspace(2.0, 1.0, K)
    forced = search_manoeuvres(**given, beam_width=125, first_violation=least)
    assert forced.x[0] == given["turn_rates"][-1]
    assert (forced.status, forced.primal_residual) == (Status.VIOLATED, 1.0)


def test_first_turn_counts_more_than_what_comes_of_it():
    given = problem(np.random.default_rng(14))
    heading, left = given["pose"][2], given["turn_rates"] > 0

    def right_at_first(
        positions, times
    ):  # forbidden: whatever is not to the left, during the first stage
        aside = (positions - given["pose"][:2]) @ [-math.sin(heading), math.cos(heading)]
        return np.where((aside < 1e-9) & (times <= given["stages"].duration[0]), 1.0, -1.0)

    found = search_manoeuvres(**given, beam_width=125, violation=right_at_first)
    assert found.x[0] > 0
    assert found.primal_residual == 0.0
    found = search_manoeuvres(
        **given, beam_width=125, violation=right_at_first, first_violation=0.1 * left
    )
    assert found.x[0] <= 0
    assert (found.status, found.primal_residual) == (Status.OPTIMAL, 1.0)


@pytest.mark.parametrize("count", [1, 5, 60, 200])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.95, 1.0])
def test_sequences_that_are_not_looked_at_are_not_among_the_best(count, share):
    rng, fewer = np.random.default_rng(int(100 * share) + count), 0
    for _ in range(50):
        first, inherited, broken = (
            np.where(rng.random(100) < share, rng.integers(0, 3, 100), 0.0) for _ in range(3)
        )
        cost, looked = rng.integers(0, 30, 100) / 30.0, []

        def look(these, looked=looked, broken=broken):
            looked.extend(these)
            return broken[these]

        found, worst = selection.best(first, inherited, cost, count, look)
        whole = np.maximum(inherited, broken)
        expected = np.lexsort((cost, whole, first))[:count]
        for part in (first, whole, cost):
            np.testing.assert_array_equal(part[found], part[expected])
        np.testing.assert_array_equal(worst[found], whole[found])
        fewer += len(looked) < 100
    assert fewer == 50 or count > 60 or share > 0


def test_violation_of_a_sequence_is_the_worst_along_its_arcs():
    given = problem(np.random.default_rng(13))
    looked = []

    def wall(positions, times):
        looked.extend(times)
        return positions[..., 0] - given["pose"][0]  # everything east of the start is forbidden

    found = search_manoeuvres(**given, beam_width=125, violation=wall)
    ends = np.cumsum(given["stages"].duration)
    expected = np.concatenate(
        [start + LOOKS * (end - start) for start, end in itertools.pairwise([0, *ends])]
    )
    np.testing.assert_allclose(looked, expected)

    def worst(turns):
        pose, east = given["pose"], []
        for turn, duration in zip(turns, given["stages"].duration, strict=True):
            east += [arc(pose, turn, 2.0, duration * part)[0] for part in LOOKS]
            pose = arc(pose, turn, 2.0, duration)
        return max(*east, given["pose"][0]) - given["pose"][0]

    broken = {turns: worst(turns) for turns in itertools.product(given["turn_rates"], repeat=3)}
    assert found.primal_residual == pytest.approx(min(broken.values()), abs=1e-9)
    assert found.primal_residual == pytest.approx(worst(found.x), abs=1e-9)


def test_criterion_that_is_not_known_is_refused_with_those_that_are():
    with pytest.raises(ValueError, match='criterion must be one of trace, log-det, got "logdet"'):
        beam_of(Kind(1, 3, Form(), "logdet"), 2, 9)
