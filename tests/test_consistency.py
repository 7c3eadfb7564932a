"""Claims about the judgement of a filter from one run."""

from itertools import pairwise, product

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2, norm

from formulations.consistency import INSTANTS, effective_samples, mean_interval, runs_of_signs

STEPS, MISSIONS = 240, 1500


def filtered(steps, rng=None, *, missions=1, claimed=1.0):
    """A position and velocity in the plane, its x and y seen in turns: covariances, and mean NEES of each mission.

    Written with gains and information, not as the library does; ``claimed`` is the true process noise over the one assumed.
    """
    F = np.kron([[1.0, 0.5], [0.0, 1.0]], np.eye(2))
    Q = block_diag(0.02 * np.eye(2), 0.01 * np.eye(2))
    P, covariances = 25.0 * np.eye(4), [25.0 * np.eye(4)]
    error = 5.0 * rng.standard_normal((missions, 4)) if rng else np.zeros((missions, 4))
    nees = [np.sum(error[:, :2] ** 2, axis=1) / 25.0]
    for k in range(steps):
        noise = rng.standard_normal((missions, 4)) if rng else np.zeros((missions, 4))
        error = error @ F.T + noise * np.sqrt(claimed * np.diag(Q))
        P = F @ P @ F.T + Q
        if k % 10 == 9:
            H = np.eye(4)[[k // 10 % 2]]
            R = 1.0
            K = P @ H.T / (H @ P @ H.T + R)
            seen = rng.standard_normal((missions, 1)) if rng else np.zeros((missions, 1))
            error = error - (error @ H.T + seen) @ K.T
            P = np.linalg.inv(np.linalg.inv(P) + H.T @ H / R)
        covariances.append(P)
        nees.append(np.einsum("mi,ij,mj->m", error[:, :2], np.linalg.inv(P[:2, :2]), error[:, :2]))
    transitions = np.broadcast_to(F, (steps, 4, 4))
    return np.array(covariances), transitions, Q, np.mean(nees, axis=0)


def test_mean_nees_of_a_run_scatters_like_that_of_as_many_independent_errors():
    """Of a consistent filter: its variance is 4 / N; that of a sample of 1500 is known to 3.7 %, heavy tails to 8 %."""
    P, F, Q, mean = filtered(STEPS, np.random.default_rng(1), missions=MISSIONS)
    N = effective_samples(P, F, Q)
    assert N < STEPS / 5  # errors do depend on each other: else the claim is empty
    assert np.var(mean) == pytest.approx(4 / N, rel=0.25)
    assert np.var(mean) > 2 * 4 / (STEPS + 1)


def test_a_consistent_filter_is_found_out_of_its_interval_once_in_twenty_runs():
    """Four standard errors of that share are 0.023; as much again because a chi-square law is an approximation here."""
    P, F, Q, mean = filtered(STEPS, np.random.default_rng(2), missions=MISSIONS)
    low, high = mean_interval(effective_samples(P, F, Q), degrees=2)
    outside = np.mean((mean < low) | (mean > high))
    assert outside == pytest.approx(0.05, abs=0.045)
    naive = mean_interval(STEPS + 1.0, degrees=2)
    assert np.mean((mean < naive[0]) | (mean > naive[1])) > 0.3


def test_a_filter_that_assumes_a_ninth_of_the_process_noise_is_found_overconfident():
    P, F, Q, mean = filtered(STEPS, np.random.default_rng(3), missions=MISSIONS, claimed=9.0)
    _, high = mean_interval(effective_samples(P, F, Q), degrees=2)
    assert np.mean(mean > high) > 0.8


def test_errors_forgotten_from_step_to_step_are_each_independent():
    n = 50
    P = np.broadcast_to(4.0 * np.eye(3), (n + 1, 3, 3))
    forgotten = np.zeros((n, 3, 3))
    assert effective_samples(P, forgotten, 9.0 * np.eye(3)) == pytest.approx(n + 1, rel=1e-12)


def test_an_error_that_stays_is_one_error():
    n = 50
    P = np.broadcast_to(np.diag([4.0, 9.0, 1.0]), (n + 1, 3, 3))
    stays = np.broadcast_to(np.eye(3), (n, 3, 3))
    assert effective_samples(P, stays, np.zeros((3, 3))) == pytest.approx(1.0, rel=1e-9)


def test_long_runs_are_thinned_to_about_the_same_number():
    """A filter in its steady state: three times as long is three times as many errors, within what its start is worth."""
    short, long = (effective_samples(*filtered(steps)[:3]) for steps in (INSTANTS, 3 * INSTANTS))
    assert long / short == pytest.approx(3.0, rel=0.15)


def test_certain_positions_give_no_number():
    P = np.zeros((5, 4, 4))
    assert np.isnan(effective_samples(P, np.broadcast_to(np.eye(4), (4, 4, 4)), np.zeros((4, 4))))


@pytest.mark.parametrize(("samples", "low", "high"), [(50, 1.48, 2.59), (1, 0.0506, 7.378)])
def test_interval_is_that_of_the_book(samples, low, high):
    """Bar-Shalom, Li & Kirubarajan (2001), 5.4.2: of 50 runs and two coordinates [1.5, 2.6]; of one, 5.4.1: [0.05, 7.38]."""
    assert mean_interval(float(samples), degrees=2) == pytest.approx((low, high), abs=0.01)
    assert chi2.cdf(high * samples, 2 * samples) == pytest.approx(0.975, abs=2e-3)


@pytest.mark.parametrize("samples", [1, 7.5, 400])
@pytest.mark.parametrize("degrees", [1, 2, 4])
@pytest.mark.parametrize("probability", [0.5, 0.95, 0.999])
def test_interval_leaves_equal_tails_of_the_chi_square_distribution(samples, degrees, probability):
    interval = mean_interval(samples, degrees=degrees, probability=probability)
    tail = (1 - probability) / 2
    quantiles = chi2.ppf([tail, 1 - tail], degrees * samples) / samples
    assert interval == pytest.approx(quantiles, rel=1e-9)


@pytest.mark.parametrize("samples", [0, float("nan")])
def test_nothing_is_outside_of_the_interval_of_no_values(samples):
    low, high = mean_interval(samples, degrees=1)
    assert not (low > 5.0)
    assert not (high < 5.0)


@pytest.mark.parametrize(
    ("samples", "degrees", "probability"), [(-1, 1, 0.9), (3, 0, 0.9), (3, 1, 1.0), (3, 1, 0.0)]
)
def test_intervals_that_make_no_sense_are_refused(samples, degrees, probability):
    with pytest.raises(ValueError, match="probability between 0 and 1, got"):
        mean_interval(samples, degrees=degrees, probability=probability)


@pytest.mark.parametrize("positive", [1, 4, 6])
def test_number_of_runs_is_standard_over_every_order_of_the_signs(positive):
    """Its mean is 0 and its variance 1 over all that are equally probable, of ten signs."""
    orders = np.array(
        [order for order in product([-1.0, 1.0], repeat=10) if order.count(1.0) == positive]
    )
    found = [runs_of_signs(order) for order in orders]
    z = np.array([each.z for each in found])
    assert np.mean(z) == pytest.approx(0, abs=1e-12)
    assert np.var(z) == pytest.approx(1, rel=1e-12)
    assert {(each.positive, each.negative) for each in found} == {(positive, 10 - positive)}
    runs = [1 + sum(a != b for a, b in pairwise(order)) for order in orders]
    assert [each.runs for each in found] == runs


def test_chance_is_found_odd_once_in_twenty_series_and_a_lasting_error_nearly_always():
    """Four standard errors of the share are 0.02; runs are whole numbers, which cost as much."""
    rng = np.random.default_rng(5)
    white = rng.standard_normal((2000, 200))
    odd = np.array([runs_of_signs(series).p < 0.05 for series in white])
    assert np.mean(odd) == pytest.approx(0.05, abs=0.03)
    lasting = np.array([runs_of_signs(series[1:] + series[:-1]).z for series in white[:200]])
    assert np.mean(lasting < -1.96) > 0.95
    turning = np.array([runs_of_signs(series[1:] - series[:-1]).z for series in white[:200]])
    assert np.mean(turning > 1.96) > 0.95


def test_odds_of_runs_are_those_of_a_normal_variable_in_both_directions():
    few, many = runs_of_signs(np.repeat([1.0, -1.0], 8)), runs_of_signs(np.tile([1.0, -1.0], 8))
    assert (few.runs, many.runs) == (2, 16)
    assert few.z == pytest.approx(-many.z)
    assert few.p == pytest.approx(2 * norm.sf(-few.z), rel=1e-12)


def test_values_without_a_sign_are_left_out_of_runs():
    signs = np.array([1.0, -2.0, -1.0, 0.5, 3.0, -1.0])
    among = np.insert(signs, [0, 2, 2, 6], [np.nan, np.nan, 0.0, np.nan])
    assert runs_of_signs(among) == runs_of_signs(signs)
    assert runs_of_signs(signs)[:3] == (3, 3, 4)


def test_signs_that_are_all_the_same_are_judged_by_how_many_they_are():
    all_up = runs_of_signs(np.ones(11))
    assert all_up[:3] == (11, 0, 1)
    assert np.isnan(all_up.z)
    assert all_up.p == pytest.approx(2 * 0.5**11)
    assert runs_of_signs(np.array([-3.0])).p == 1.0
    assert runs_of_signs(np.array([-3.0, 2.0])).p == 1.0
    assert runs_of_signs(-np.ones(3000)).p == 0.0


@pytest.mark.parametrize("values", [[], [np.nan, 0.0]])
def test_no_signs_say_nothing(values):
    none = runs_of_signs(np.array(values, dtype=float))
    assert none[:3] == (0, 0, 0)
    assert np.isnan([none.z, none.p]).all()


def test_a_constant_bias_is_left_to_the_mean_nis():
    """It makes one sign frequent, in an order by chance all the same."""
    rng = np.random.default_rng(6)
    biased = 1.0 + rng.standard_normal((1000, 200))
    odd = np.array([runs_of_signs(series).p < 0.05 for series in biased])
    assert np.mean(odd) == pytest.approx(0.05, abs=0.035)
    _, high = mean_interval(200, degrees=1)
    assert (np.mean(biased**2, axis=1) > high).all()
