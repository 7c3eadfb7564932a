"""The certified information bound: state (east, north, heading, speed), a compass at every step."""

import math

import cvxpy as cp
import numpy as np
import pytest

from formulations import certified_bound
from formulations.allocation import Allocation
from formulations.certified_bound import FINEST, information_bound
from formulations.cramer_rao import (
    position_rms,
    posterior_cramer_rao,
    range_information,
    squared_range_information,
)


def survey_model(rng, steps, *, every=3):
    """Dead reckoning over a random course, with a random anisotropic prior, process noise (absent in one of three) and compass."""
    dt, speed = rng.uniform(0.2, 2.0), rng.uniform(0.1, 2.0)
    heading = rng.uniform(0, 2 * np.pi) + np.cumsum(rng.normal(size=steps) * rng.choice([0.0, 0.3]))
    F = np.tile(np.eye(4), (steps, 1, 1))
    F[:, 0, 2], F[:, 0, 3] = -speed * np.sin(heading) * dt, np.cos(heading) * dt
    F[:, 1, 2], F[:, 1, 3] = speed * np.cos(heading) * dt, np.sin(heading) * dt
    turn = np.eye(4)
    turn[:2, :2] = np.linalg.qr(rng.normal(size=(2, 2)))[0]
    P0 = turn @ np.diag(rng.uniform(0, [5.0, 1.0, 0.3, 0.5]) ** 2) @ turn.T
    Q = np.diag(rng.uniform(0, [0.1, 0.1, 0.05, 0.02]) ** 2) * dt * rng.choice([0.0, 1.0, 1.0])
    J = np.zeros((steps, 4, 4))
    J[:, 2, 2] = rng.choice([0.0, 1 / rng.uniform(0.01, 0.2) ** 2])
    course = np.cumsum(speed * dt * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)
    return {"P0": P0, "F": F, "Q": Q, "J_other": J}, np.arange(every - 1, steps, every), course


def rms_of_bearings(model, pings, bearing, sigma):
    """Cramér-Rao RMS with the beacon seen at these bearings (paths, pings), the information written out."""
    u = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
    J = np.broadcast_to(model["J_other"], (len(bearing), *model["J_other"].shape)).copy()
    J[:, pings, :2, :2] += u[..., :, None] * u[..., None, :] / sigma**2
    return position_rms(posterior_cramer_rao(model["P0"], model["F"], model["Q"], J))


@pytest.mark.parametrize(
    ("finest", "models"), [pytest.param(FINEST, 50, marks=pytest.mark.slow), (10, 10)]
)
def test_bound_is_below_a_thousand_random_paths_and_models_and_its_gap_closes(
    finest, models, monkeypatch
):
    monkeypatch.setattr(certified_bound, "FINEST", finest)
    rng = np.random.default_rng(11)
    for _ in range(models):
        model, pings, course = survey_model(rng, 45)
        sigma = rng.uniform(0.05, 2.0)
        bound = information_bound(**model, pings=pings, sigma=sigma)
        assert bound.gap < 0.01 * bound.value
        assert np.linalg.eigvalsh(bound.allocation).min() > -1e-12
        np.testing.assert_allclose(np.trace(bound.allocation, axis1=1, axis2=2), 1.0, rtol=1e-12)
        turns = np.cumsum(
            rng.normal(size=(20, 45)) * rng.choice([0.02, 0.3, 2.0], size=(20, 1)), axis=1
        )
        beacon = rng.normal(size=(20, 1, 2)) * 10 + np.cumsum(
            np.stack([np.cos(turns), np.sin(turns)], axis=-1), axis=1
        )
        east, north = np.moveaxis((beacon - course)[:, pings], -1, 0)
        achieved = rms_of_bearings(model, pings, np.arctan2(north, east), sigma)
        assert (achieved >= bound.bound_rms_m).all()


def test_bound_is_nearly_reached_by_looking_along_the_optimal_allocation():
    """Rounding each optimal matrix to its main direction gives a path of bearings; it loses little where many pings share the work."""
    rng = np.random.default_rng(4)
    worst = 1.0
    for _ in range(10):
        model, pings, _ = survey_model(rng, 120, every=1)
        bound = information_bound(**model, pings=pings, sigma=1.0)
        u = np.linalg.eigh(bound.allocation)[1][:, :, 1]
        bearing = np.arctan2(u[:, 1], u[:, 0])
        spread = (
            0.5
            * np.arccos(np.clip(2 * np.linalg.eigvalsh(bound.allocation)[:, 1] - 1, 0, 1))
            * (-1) ** np.arange(len(pings))
        )
        worst = min(
            worst,
            bound.bound_rms_m / rms_of_bearings(model, pings, (bearing + spread)[None], 1.0)[0],
        )
    assert 0.95 < worst <= 1.0


def static_model(steps, sigma_prior=10.0):
    return {
        "P0": sigma_prior**2 * np.eye(2),
        "F": np.tile(np.eye(2), (steps, 1, 1)),
        "Q": np.zeros((2, 2)),
        "J_other": np.zeros((steps, 2, 2)),
    }


def test_a_circle_about_a_static_target_of_isotropic_prior_reaches_the_bound():
    """In closed form: after N pings the best trace is 2 / (1/p + N / (2σ²)), which whole circles reach."""
    steps, sigma = 48, 0.5
    model, last = static_model(steps), np.eye(steps + 1)[-1]
    bound = information_bound(**model, pings=np.arange(steps), sigma=sigma, weights=last)
    assert bound.bound == pytest.approx(2 / (1 / 100 + steps / (2 * sigma**2)), rel=1e-12)
    assert bound.iterations == 1
    bearing = 2 * np.pi * np.arange(steps) / 12
    target = np.array([3.0, -4.0])
    circle = target + 20.0 * np.column_stack([np.cos(bearing), np.sin(bearing)])
    P = posterior_cramer_rao(
        model["P0"], model["F"], model["Q"], range_information(circle, target, sigma)
    )
    assert bound.efficiency(P) == pytest.approx(1.0, rel=1e-12)
    straight = target + np.column_stack([np.linspace(-50, 50, steps), np.full(steps, 5.0)])
    P = posterior_cramer_rao(
        model["P0"], model["F"], model["Q"], range_information(straight, target, sigma)
    )
    assert bound.efficiency(P) < 0.8


def test_squared_ranges_are_bounded_by_their_worth_at_the_largest_distance():
    """At the stated distance the circle reaches the bound; nearer it falls short; and farther it would beat it, so the distance matters."""
    steps, sigma, d_max = 24, 4.0, 20.0
    model, last = static_model(steps), np.eye(steps + 1)[-1]
    bound = information_bound(
        **model, pings=np.arange(steps), sigma=sigma / (2 * d_max), weights=last
    )
    bearing = 2 * np.pi * np.arange(steps) / 12
    unit_circle = np.column_stack([np.cos(bearing), np.sin(bearing)])
    efficiency = []
    for distance in (10.0, 20.0, 40.0):
        J = squared_range_information(distance * unit_circle, np.zeros(2), sigma)
        efficiency.append(
            bound.efficiency(posterior_cramer_rao(model["P0"], model["F"], model["Q"], J))
        )
    np.testing.assert_allclose(
        efficiency, [0.5, 1.0, 2.0], rtol=1e-3
    )  # the prior of 10 m adds some 1e-6


def test_several_ranges_at_a_step_are_bounded_together_and_one_of_them_alone_is_no_bound():
    """Two aid vehicles on random paths, the second deaf at half of the pings; and which of them is named first does not matter."""
    rng = np.random.default_rng(12)
    beaten = 0
    for _ in range(6):
        model, pings, _ = survey_model(rng, 45)
        steps = np.concatenate([pings, pings[::2]])
        sigma = rng.uniform(0.1, 1.0, len(steps))
        bound = information_bound(**model, pings=steps, sigma=sigma)
        assert bound.allocation.shape == (len(steps), 2, 2)
        shuffled = rng.permutation(len(steps))
        again = information_bound(**model, pings=steps[shuffled], sigma=sigma[shuffled])
        assert again.value == pytest.approx(bound.value, rel=1e-9)
        np.testing.assert_allclose(again.allocation, bound.allocation[shuffled], atol=1e-6)
        one = information_bound(**model, pings=pings, sigma=sigma[: len(pings)])
        bearing = np.cumsum(rng.normal(size=(30, len(steps))) * 0.7, axis=1)
        u = np.stack([np.cos(bearing), np.sin(bearing)], axis=-1)
        J = np.broadcast_to(model["J_other"], (30, *model["J_other"].shape)).copy()
        for j, step in enumerate(steps):
            J[:, step, :2, :2] += u[:, j, :, None] * u[:, j, None, :] / sigma[j] ** 2
        achieved = position_rms(posterior_cramer_rao(model["P0"], model["F"], model["Q"], J))
        assert (achieved >= bound.bound_rms_m).all()
        beaten += (achieved < one.bound_rms_m).any()
    assert beaten


def test_splitting_information_evenly_is_no_bound_under_heading_uncertainty():
    steps, speed = 60, 1.0
    F = np.tile(np.eye(4), (steps, 1, 1))
    F[:, 1, 2], F[:, 0, 3] = speed, 1.0  # due east: an error of heading moves it north
    J = np.zeros((steps, 4, 4))
    model = {"P0": np.diag([1.0, 1.0, 0.25, 1e-6]), "F": F, "Q": np.zeros((4, 4)), "J_other": J}
    pings = np.arange(0, steps, 5)
    J_even = J.copy()
    J_even[pings, 0, 0] = J_even[pings, 1, 1] = 0.5
    even = position_rms(posterior_cramer_rao(model["P0"], F, model["Q"], J_even))
    bearing = np.where(np.arange(len(pings)) % 4, np.pi / 2, 0.0)[
        None
    ]  # one look east, three north
    path = rms_of_bearings(model, pings, bearing, 1.0)[0]
    assert path < 0.94 * even
    assert information_bound(**model, pings=pings, sigma=1.0).bound_rms_m <= path


def test_gradient_and_first_duality_gap_are_those_of_finite_differences():
    rng = np.random.default_rng(8)
    model, pings, _ = survey_model(rng, 15, every=2)
    weights = rng.dirichlet(np.ones(16))
    sigma = rng.uniform(0.5, 2.0, len(pings))
    problem = Allocation(**model, pings=pings, precision=1 / sigma**2, weights=weights)
    M = np.tile(np.eye(2) / 2, (len(pings), 1, 1))
    slopes, h = np.empty_like(M), 1e-5
    for j, r, c in np.ndindex(M.shape):
        step = np.zeros_like(M)
        step[j, r, c] += h / 2
        step[j, c, r] += h / 2
        slopes[j, r, c] = (problem.evaluate(M + step)[0] - problem.evaluate(M - step)[0]) / (2 * h)
    _, J, P = problem.evaluate(M)
    np.testing.assert_allclose(problem.gradient(J, P), slopes, rtol=1e-6, atol=1e-9)
    least = np.linalg.eigvalsh(slopes)[:, 0]  # of the linear model over matrices of trace one
    first = information_bound(
        **model, pings=pings, sigma=sigma, weights=weights, max_iterations=1, relative_gap=1e-9
    )
    assert first.gap == pytest.approx(
        np.sum(np.trace(slopes, axis1=1, axis2=2) / 2 - least), rel=1e-6
    )
    assert 0 < first.gap < first.value


def semidefinite_program(model, pings, sigma, weights):
    """Solve the same relaxation by Clarabel on information matrices of the whole trajectory up to each sample."""
    n, steps = 4, len(model["F"])
    M = {int(k): cp.Variable((2, 2), PSD=True) for k in pings}
    size = n * (steps + 1)
    embed = np.eye(size)
    Y = np.zeros((size, size))
    Y[:n, :n] = np.linalg.inv(model["P0"])
    cost = weights[0] * np.trace(model["P0"][:2, :2])
    for k in range(steps):
        link = embed[:, n * (k + 1) : n * (k + 2)] - embed[:, n * k : n * (k + 1)] @ model["F"][k].T
        at = embed[:, n * (k + 1) : n * (k + 2)]
        Y = Y + link @ np.linalg.inv(model["Q"]) @ link.T + at @ model["J_other"][k] @ at.T
        if k in M:
            Y = Y + at[:, :2] @ M[k] @ at[:, :2].T / sigma**2
        used = n * (k + 2)
        position, Y_used = at[:used, :2], (Y[:used, :used] + Y[:used, :used].T) / 2
        trace = (
            cp.trace(position.T @ np.linalg.solve(Y_used, position))
            if isinstance(Y, np.ndarray)
            else cp.matrix_frac(position, Y_used)
        )
        cost = cost + weights[k + 1] * trace
    problem = cp.Problem(cp.Minimize(cost), [cp.trace(m) == 1 for m in M.values()])
    return problem.solve(solver=cp.CLARABEL)


@pytest.mark.parametrize("seed", range(3))
def test_semidefinite_programming_finds_the_same_optimum(seed):
    rng = np.random.default_rng(seed)
    model, pings, _ = survey_model(rng, 6, every=2)
    model |= {"Q": np.diag([0.1, 0.2, 0.05, 0.05]), "P0": np.diag([4.0, 1.0, 0.1, 0.2])}
    weights = np.full(7, 1 / 7)
    bound = information_bound(**model, pings=pings, sigma=0.5, relative_gap=1e-4)
    optimum = semidefinite_program(model, pings, 0.5, weights)
    accuracy = (
        1e-6 * optimum
    )  # Clarabel's default is 1e-8; the matrices are conditioned to some 1e3
    assert bound.bound - accuracy <= optimum <= bound.value + accuracy
    assert bound.gap <= 1e-4 * bound.value


def test_stopping_early_leaves_a_looser_bound_that_still_holds():
    model, pings, _ = survey_model(np.random.default_rng(2), 60)
    sharp = information_bound(**model, pings=pings, sigma=0.3, relative_gap=1e-4)
    early = information_bound(**model, pings=pings, sigma=0.3, relative_gap=1e-4, max_iterations=2)
    assert early.iterations == 2
    assert 0 <= early.bound < sharp.bound
    assert early.value > sharp.value


def test_weights_choose_the_samples_of_the_mean():
    model, pings, _ = survey_model(np.random.default_rng(3), 30)
    weights = np.r_[0.0, np.full(30, 7.0)]
    bound = information_bound(**model, pings=pings, sigma=1.0, weights=weights)
    J = model["J_other"].copy()
    J[pings, :2, :2] += bound.allocation
    P = posterior_cramer_rao(model["P0"], model["F"], model["Q"], J)
    assert math.sqrt(bound.value) == pytest.approx(position_rms(P[1:]), rel=1e-12)
    assert bound.efficiency(P) == pytest.approx(math.sqrt(bound.bound / bound.value), rel=1e-12)


def test_nothing_to_gain_is_bounded_by_what_there_is():
    model = static_model(5)
    none = information_bound(**model, pings=np.arange(0), sigma=1.0)
    assert none.bound == pytest.approx(200.0, rel=1e-14)  # the trace of what is known at first
    assert (none.gap, none.iterations) == (0.0, 1)
    known = information_bound(**model | {"P0": np.zeros((2, 2))}, pings=np.arange(5), sigma=1.0)
    assert known.bound_rms_m == 0.0
    assert known.efficiency(np.zeros((6, 2, 2))) == 1.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pings": np.array([-1, 2])}, "pings must be steps 0 to 4, got -1 to 2"),
        ({"pings": np.array([5])}, "pings must be steps 0 to 4, got 5 to 5"),
        ({"sigma": 0.0}, "sigma must be positive, got 0.0"),
        ({"weights": np.ones(5)}, "6 samples, got 5 weights"),
        ({"weights": np.zeros(6)}, "weights must be at least 0 and not all 0"),
        ({"weights": np.array([1.0, 1, 1, 1, 1, -1])}, "got a least of -1"),
        (
            {"P0": np.full((2, 2), np.nan)},
            "must be finite and not overflow, got a mean square of nan",
        ),
        ({"relative_gap": 0.0}, "relative_gap must be positive"),
        ({"max_iterations": 0}, "max_iterations at least 1"),
    ],
)
def test_bound_refuses_what_makes_no_sense(change, message):
    with pytest.raises(ValueError, match=message):
        information_bound(**static_model(5) | {"pings": np.arange(5), "sigma": 1.0} | change)


# Long missions: from coarse to fine


@pytest.mark.parametrize("steps", [200, 201, 255])
def test_a_search_from_coarse_to_fine_certifies_the_same_optimum_in_fewer_iterations(
    steps, monkeypatch
):
    """Of two certified intervals of one optimum each reaches into the other."""
    rng = np.random.default_rng(steps)
    model, pings, _ = survey_model(rng, steps, every=4)
    sigma = rng.uniform(0.2, 2.0, len(pings))
    at_once = information_bound(**model, pings=pings, sigma=sigma)
    monkeypatch.setattr(certified_bound, "FINEST", 20)
    from_coarse = information_bound(**model, pings=pings, sigma=sigma)
    assert from_coarse.bound <= at_once.value
    assert at_once.bound <= from_coarse.value
    assert from_coarse.bound >= (1 - 0.005) ** 2 * at_once.bound  # a gap each, at most
    assert from_coarse.iterations < at_once.iterations


def test_value_and_gap_from_coarse_to_fine_are_of_every_step_and_ping(monkeypatch):
    """The value by a Kalman filter on information written out, the gap by finite differences."""
    monkeypatch.setattr(certified_bound, "FINEST", 5)
    rng = np.random.default_rng(6)
    model, pings, _ = survey_model(rng, 19, every=3)
    bound = information_bound(**model, pings=pings, sigma=0.7, relative_gap=0.02)

    def mean_square(M):
        P, squares = model["P0"], [np.trace(model["P0"][:2, :2])]
        for k, F in enumerate(model["F"]):
            J = model["J_other"][k].copy()
            if k in pings:
                J[:2, :2] += M[list(pings).index(k)] / 0.7**2
            P = F @ P @ F.T + model["Q"]
            P = P @ np.linalg.inv(np.eye(4) + J @ P)
            squares.append(np.trace(P[:2, :2]))
        return np.mean(squares)

    M, h = bound.allocation, 1e-5
    assert bound.value == pytest.approx(mean_square(M), rel=1e-9)
    most = 0.0  # of the linear model, over all directions of each ping
    for j in range(len(pings)):
        slopes = np.empty((2, 2))
        for r, c in np.ndindex(2, 2):
            step = np.zeros_like(M)
            step[j, r, c] += h / 2
            step[j, c, r] += h / 2
            slopes[r, c] = (mean_square(M + step) - mean_square(M - step)) / (2 * h)
        most += np.sum(slopes * M[j]) - np.linalg.eigvalsh(slopes)[0]
    assert bound.gap == pytest.approx(most, rel=1e-5, abs=1e-9)
    assert not np.allclose(M, np.eye(2) / 2)  # the coarser allocation was taken up


def test_progress_rises_to_the_whole(monkeypatch):
    monkeypatch.setattr(certified_bound, "FINEST", 50)
    model, pings, _ = survey_model(np.random.default_rng(4), 170)
    shares = []
    information_bound(**model, pings=pings, sigma=1.0, progress=shares.append)
    assert shares == sorted(shares)
    assert 0 < shares[0] < shares[-1] == 1.0
