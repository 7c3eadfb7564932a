"""Fisher information of ranges, and the covariance recursion."""

import math

import control as ct
import numpy as np
import pytest
from pykalman import KalmanFilter

from formulations.cramer_rao import (
    path_information,
    position_rms,
    posterior_cramer_rao,
    range_information,
    squared_range_information,
)


def random_system(rng, *, steps=12, n=4, rank_Q=4, rank_P=4, every=1):
    """Random F, Q, one-row H and variance R per step; H is zero except at every ``every``-th step."""
    F = np.eye(n) + 0.3 * rng.normal(size=(steps, n, n))
    LQ, LP = rng.normal(size=(steps, n, rank_Q)), rng.normal(size=(n, rank_P))
    H = rng.normal(size=(steps, 1, n)) * (np.arange(steps) % every == every - 1)[:, None, None]
    R = rng.uniform(0.1, 2.0, size=(steps, 1, 1))
    return LP @ LP.T, F, LQ @ LQ.swapaxes(1, 2), H, R


def covariance_by_conditioning(P0, F, Q, H, R):
    """Condition the last state on all measurements at once, in their joint Gaussian: no recursion, nothing but R + H Σ Hᵀ inverted."""
    steps, n = F.shape[:2]
    sources = [P0, *Q]
    to_state = [np.eye(n)] + [np.zeros((n, n))] * steps
    rows = []
    for k in range(steps):
        to_state = [F[k] @ T for T in to_state]
        to_state[k + 1] = np.eye(n)
        rows.append(H[k] @ np.hstack(to_state))
    prior = np.zeros((n * (steps + 1),) * 2)
    for k, S in enumerate(sources):
        prior[k * n : (k + 1) * n, k * n : (k + 1) * n] = S
    G, T = np.vstack(rows), np.hstack(to_state)
    innovation = G @ prior @ G.T + np.diag(R.ravel())
    cross = T @ prior @ G.T
    return T @ prior @ T.T - cross @ np.linalg.solve(innovation, cross.T)


@pytest.mark.parametrize("seed", range(5))
def test_cramer_rao_of_a_linear_system_is_the_kalman_covariance_of_pykalman(seed):
    P0, F, Q, H, R = random_system(np.random.default_rng(seed), every=3)
    seen = np.ma.zeros((len(F), 1))
    seen[[not h.any() for h in H]] = np.ma.masked
    kalman = KalmanFilter(
        transition_matrices=F[1:],
        transition_covariance=Q[1:],
        observation_matrices=H,
        observation_covariance=R[0],
        initial_state_mean=np.zeros(4),
        initial_state_covariance=F[0] @ P0 @ F[0].T + Q[0],
    )
    P = posterior_cramer_rao(P0, F, Q, H.swapaxes(1, 2) @ H / R[0])
    np.testing.assert_array_equal(P[0], P0)
    np.testing.assert_allclose(P[1:], kalman.filter(seen)[1], rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize(("rank_P", "rank_Q"), [(0, 0), (0, 1), (1, 0), (4, 0), (2, 1)])
def test_singular_prior_and_noise_give_the_conditional_covariance(rank_P, rank_Q):
    rng = np.random.default_rng(rank_P + 10 * rank_Q)
    P0, F, Q, H, R = random_system(rng, rank_P=rank_P, rank_Q=rank_Q)
    P = posterior_cramer_rao(P0, F, Q, H.swapaxes(1, 2) @ H / R)
    np.testing.assert_allclose(
        P[-1], covariance_by_conditioning(P0, F, Q, H, R), rtol=1e-7, atol=1e-9
    )
    if rank_P == rank_Q == 0:
        np.testing.assert_array_equal(P, 0.0)


@pytest.mark.parametrize("rank", [1, 2, 4])
def test_information_of_any_rank_enters_whole(rank):
    rng = np.random.default_rng(rank)
    A, L = rng.normal(size=(4, 4)), rng.normal(size=(4, rank))
    M, J = A @ A.T, L @ L.T
    P = posterior_cramer_rao(M, np.eye(4)[None], np.zeros((4, 4)), J[None])[-1]
    np.testing.assert_allclose(P, np.linalg.inv(np.linalg.inv(M) + J), rtol=1e-9, atol=1e-11)


def test_information_far_greater_than_the_prior_leaves_a_positive_covariance():
    u = np.array([[0.6], [0.8]])
    P = posterior_cramer_rao(
        100.0 * np.eye(2), np.eye(2)[None], np.zeros((2, 2)), 1e10 * (u @ u.T)[None]
    )[-1]
    assert u.T @ P @ u == pytest.approx(
        1e-10, rel=1e-2, abs=1e-12
    )  # rounding: 100 eps, against the 1e-10 that is right
    assert np.linalg.eigvalsh(P)[0] > -1e-13


def test_leading_axes_are_vehicles_and_noise_is_one_matrix_or_one_per_step():
    rng = np.random.default_rng(3)
    _, F, _, H, R = random_system(rng, steps=9)
    Q = 0.1 * np.eye(4)
    P0 = np.array([np.eye(4), 3.0 * np.eye(4)])
    J = H.swapaxes(1, 2) @ H / R
    both = posterior_cramer_rao(P0, F, Q, J)
    assert both.shape == (2, 10, 4, 4)
    for i in range(2):
        np.testing.assert_array_equal(
            both[i], posterior_cramer_rao(P0[i], F, np.broadcast_to(Q, (9, 4, 4)), J)
        )
    np.testing.assert_allclose(
        position_rms(both)[1],
        math.sqrt(np.mean([np.trace(p[:2, :2]) for p in both[1]])),
        rtol=1e-14,
    )


def test_steps_without_information_must_still_be_given():
    with pytest.raises(ValueError, match="as many steps, got 3 and 2"):
        posterior_cramer_rao(np.eye(2), np.zeros((3, 2, 2)), np.eye(2), np.zeros((2, 2, 2)))


def test_path_information_over_a_long_horizon_solves_the_lyapunov_equation():
    A, C = np.array([[0.9, 0.2], [0.0, 0.7]]), np.array([[1.0, 0.5]])
    steps = 400  # 0.9^800 = 2e-37
    W = path_information(np.broadcast_to(A, (steps, 2, 2)), np.broadcast_to(C.T @ C, (steps, 2, 2)))
    np.testing.assert_allclose(
        W, ct.dlyap(A.T, A.T @ C.T @ C @ A), rtol=1e-11
    )  # python-control; the first measurement comes after a step


def test_path_information_without_process_noise_is_what_the_prior_gains():
    P0, F, _, H, R = random_system(np.random.default_rng(5))
    J = H.swapaxes(1, 2) @ H / R
    smoothed = np.linalg.inv(np.linalg.inv(P0) + path_information(F, J))
    Phi = np.linalg.multi_dot(F[::-1])
    expected = Phi @ smoothed @ Phi.T
    np.testing.assert_allclose(
        posterior_cramer_rao(P0, F, np.zeros((4, 4)), J)[-1],
        expected,
        rtol=1e-7,
        atol=1e-9 * np.abs(expected).max(),
    )


ARC_CONDITION = {30: 43.4, 90: 4.50, 180: 1.0, 270: 1.54, 360: 1.0}


@pytest.mark.parametrize(("degrees", "condition"), ARC_CONDITION.items())
def test_ranges_from_an_arc_have_the_closed_form_eigenvalues(degrees, condition):
    N, sigma, phi = 40_000, 0.7, math.radians(degrees)
    bearing = 0.3 + phi * (np.arange(N) + 0.5) / N  # midpoint rule: error (phi / N)² / 24
    target = np.array([5.0, -2.0])
    beacon = target + 30.0 * np.column_stack([np.cos(bearing), np.sin(bearing)])
    eigenvalues = np.linalg.eigvalsh(range_information(beacon, target, sigma).sum(axis=0))
    share = abs(math.sin(phi)) / (2 * phi)
    np.testing.assert_allclose(
        eigenvalues, N / sigma**2 * np.array([0.5 - share, 0.5 + share]), rtol=1e-8
    )
    assert eigenvalues[1] / eigenvalues[0] == pytest.approx(
        condition, abs=0.05 if degrees == 30 else 0.005
    )


def surface_circle(radius, depth, N=360):
    bearing = 2 * np.pi * np.arange(N) / N
    return np.column_stack([radius * np.cos(bearing), radius * np.sin(bearing), np.full(N, depth)])


def slant_information(radius, depth, *, proportional=False):
    beacon = surface_circle(radius, depth)
    sigma = 0.01 * np.linalg.norm(beacon, axis=1) if proportional else 1.0
    return range_information(beacon, np.zeros(3), sigma).sum(axis=0) / len(beacon)


def test_slant_ranges_from_a_circle_have_the_closed_form_information():
    r, d = 12.0, 20.0
    expected = np.diag([r**2 / 2, r**2 / 2, d**2]) / (r**2 + d**2)
    np.testing.assert_allclose(slant_information(r, d), expected, rtol=1e-12, atol=1e-15)


D = ("D", lambda J: np.log(np.linalg.det(J)))
A = ("A", lambda J: -np.trace(np.linalg.inv(J)))
E = ("E", lambda J: np.linalg.eigvalsh(J)[0])
HORIZONTAL = ("horizontal", lambda J: J[0, 0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("criterion", "proportional", "best"),
    [
        (D, False, math.sqrt(2)),
        (A, False, math.sqrt(2)),
        (E, False, math.sqrt(2)),
        (D, True, 0.7071),
        (A, True, 0.8556),
        (HORIZONTAL, True, 1.0),
    ],
    ids=lambda value: value[0] if isinstance(value, tuple) else str(value),
)
def test_the_best_circle_over_a_submerged_target_has_the_radius_of_the_closed_form(
    criterion, proportional, best
):
    depth, step = 20.0, 1e-3
    ratios = np.arange(0.5, 2.0, step)
    scores = [
        criterion[1](slant_information(ratio * depth, depth, proportional=proportional))
        for ratio in ratios
    ]
    assert ratios[np.argmax(scores)] == pytest.approx(best, abs=step)


def test_known_depth_leaves_no_finite_best_radius():
    fraction = [2 * slant_information(ratio * 20.0, 20.0)[0, 0] for ratio in (1.0, 3.0, 10.0)]
    np.testing.assert_allclose(fraction, [0.5, 0.9, 100 / 101], rtol=1e-12)


def test_a_radial_run_is_singular_and_coincidence_tells_nothing():
    beacon = np.linspace(0.0, 9.0, 10)[:, None] * [0.6, 0.8]
    J = range_information(beacon, np.zeros(2), 1.0)
    np.testing.assert_array_equal(J[0], 0.0)
    np.testing.assert_allclose(np.linalg.eigvalsh(J.sum(axis=0)), [0.0, 9.0], atol=1e-14)
    np.testing.assert_array_equal(squared_range_information(beacon, np.zeros(2), 1.0)[0], 0.0)


def test_information_is_the_curvature_of_the_expected_log_likelihood():
    """Finite differences of the mean measurement: J = (∂h/∂p)ᵀ (∂h/∂p) / σ²."""
    rng = np.random.default_rng(0)
    beacon, target, h = rng.normal(size=(6, 2)) * 20, rng.normal(size=2), 1e-4
    for measure, information in (
        (lambda p: np.hypot(*(beacon - p).T), range_information),
        (lambda p: np.sum((beacon - p) ** 2, axis=1), squared_range_information),
    ):
        slope = np.column_stack(
            [(measure(target + e) - measure(target - e)) / (2 * h) for e in h * np.eye(2)]
        )
        np.testing.assert_allclose(
            information(beacon, target, 0.3),
            slope[:, :, None] * slope[:, None, :] / 0.09,
            rtol=1e-6,
            atol=1e-6,
        )


def test_a_squared_range_is_worth_a_range_of_sigma_over_twice_the_distance():
    beacon, target = np.array([[30.0, 40.0], [0.0, -7.0]]), np.zeros(2)
    np.testing.assert_allclose(
        squared_range_information(beacon, target, 3.0),
        range_information(beacon, target, 3.0 / (2 * np.array([50.0, 7.0]))),
        rtol=1e-13,
    )


@pytest.mark.parametrize("sigma", [0.0, -1.0, math.nan])
@pytest.mark.parametrize("information", [range_information, squared_range_information])
def test_a_range_needs_a_positive_sigma(information, sigma):
    with pytest.raises(ValueError, match=f"sigma must be positive, got {sigma}"):
        information(np.ones((3, 2)), np.zeros(2), sigma)
