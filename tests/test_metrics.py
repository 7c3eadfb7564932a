import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formulations import metrics
from formulations.metrics import (
    METRICS,
    position_schur_complement,
    position_schur_expression,
    score,
    score_expression,
    unobservable_direction,
)

EPS = np.finfo(float).eps
every_metric = pytest.mark.parametrize("name", list(METRICS))


def rotation(n, seed):
    return np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))[0]


def matrix(eigenvalues, seed=0):
    """Symmetric matrix of the given spectrum, computed in extended precision before rounding."""
    Q = rotation(len(eigenvalues), seed).astype(np.longdouble)
    for _ in range(2):  # Newton steps to orthogonality in extended precision
        Q = Q @ (3 * np.eye(len(Q), dtype=np.longdouble) - Q.T @ Q) / 2
    return ((Q * np.asarray(eigenvalues, np.longdouble)) @ Q.T).astype(float)


def by_definition(name, eigenvalues, blend_weight=1.0):
    """Score of a spectrum, lower is better."""
    low, high = min(eigenvalues), max(eigenvalues)
    return {
        "condition-number": high / low,
        "unobservability-index": 1 / low,
        "smallest-eigenvalue": -low,
        "log-det": -sum(np.log(eigenvalues)),
        "trace-inverse": sum(1 / np.asarray(eigenvalues)),
        "blend": np.log(high / low) + blend_weight * np.log(1 / low),
    }[name]


def entries(W):
    """Upper triangles of a batch of one axis as CasADi columns."""
    n = W.shape[-1]
    return tuple(ca.DM(np.ascontiguousarray(W[:, i, j])) for i in range(n) for j in range(i, n))


def symbolic_score(name, W, **options):
    W = np.atleast_3d(W) if W.ndim == 3 else W[None]
    return score_expression(name, entries(W), **options).full().ravel()


@every_metric
@pytest.mark.parametrize(
    "spectrum", [(4.0,), (3.0, 2.0), (5.0, 0.25, 2.0), (1.0, 1.0, 1.0), (7.0, 3.0, 2.0, 1e-3)]
)
def test_score_is_the_definition_on_a_known_spectrum(name, spectrum):
    assert score(name, matrix(spectrum)) == pytest.approx(by_definition(name, spectrum), rel=1e-11)


def test_metrics_carry_the_sense_that_score_removes():
    W = matrix((5.0, 2.0, 0.5))
    assert metrics.smallest_eigenvalue(W) == pytest.approx(0.5)
    assert metrics.log_det(W) == pytest.approx(np.log(5.0))
    for name, metric in METRICS.items():
        assert score(name, W) == pytest.approx(
            metric.function(W) if metric.larger_is_worse else -metric.function(W)
        )


@every_metric
def test_leading_axes_are_batches(name):
    W = np.stack([matrix((3.0, 2.0, 1 + k), seed=k) for k in range(6)]).reshape(2, 3, 3, 3)
    expected = [[float(score(name, W[i, j])) for j in range(3)] for i in range(2)]
    np.testing.assert_allclose(score(name, W), expected, rtol=1e-14)
    assert score(name, W).shape == (2, 3)
    assert score(name, W[:0]).shape == (0, 3)


SINGULAR = {
    "zero": np.zeros((3, 3)),
    "rank one": np.outer([1.0, 2.0, 3.0], [1.0, 2.0, 3.0]),
    "rank two": matrix((1.0, 2.0, 0.0), seed=4),
    "far rank two": 1e12 * matrix((1.0, 2.0, 0.0), seed=5),
    "tiny rank two": 1e-200 * matrix((1.0, 2.0, 0.0), seed=6),
    "indefinite": np.diag([1.0, -1.0, 2.0]),
    "negative": -np.eye(3),
    "nan": np.full((3, 3), np.nan),
    "one nan": np.eye(3) + np.diag([0.0, np.nan, 0.0]),
    "infinite": np.diag([1.0, np.inf, 1.0]),
    "beyond precision": np.diag([1.0, 1.0, 2 * EPS]),
}


@every_metric
@pytest.mark.parametrize("case", list(SINGULAR))
def test_singular_or_not_finite_scores_infinite_by_numpy_and_by_expression(name, case):
    W = SINGULAR[case]
    assert score(name, W) == np.inf
    assert symbolic_score(name, W) == np.inf
    worst = {"smallest-eigenvalue": 0.0, "log-det": -np.inf}.get(name, np.inf)
    assert METRICS[name].function(np.stack([np.eye(3), W]))[1] == worst
    assert np.isfinite(METRICS[name].function(np.stack([np.eye(3), W]))[0])


@pytest.mark.parametrize("condition", [1e4, 1e8, 1e12, 1e15])
def test_a_barely_observable_system_never_scores_better_than_its_condition(condition):
    """A null-space tolerance that drops small singular values would: here κ stays within rounding of the truth, or is infinite."""
    for seed in range(20):
        W = matrix((1.0, 0.7, 1 / condition), seed)
        assert metrics.condition_number(W) >= condition / (1 + 8 * EPS * condition)
        assert symbolic_score("condition-number", W)[0] >= condition / (1 + 8 * EPS * condition)


def test_zero_weight_leaves_the_log_condition_number_even_where_singular():
    W = np.stack([matrix((4.0, 2.0, 1.0)), np.zeros((3, 3))])
    np.testing.assert_allclose(score("blend", W, blend_weight=0.0), [np.log(4.0), np.inf])
    np.testing.assert_allclose(symbolic_score("blend", W, blend_weight=0.0), [np.log(4.0), np.inf])


@every_metric
@given(exponents=st.lists(st.floats(-4, 4), min_size=2, max_size=3), seed=st.integers(0, 1000))
def test_expression_keeps_the_digits_of_the_square_root_factor(name, exponents, seed):
    """Oracle: singular values of the factor, which see κ with sqrt(κ)'s loss only. Tolerance: formula 1e-8 plus n·eps·κ."""
    roots = 10.0 ** (np.array(exponents) / 2)
    factor = roots[:, None] * rotation(len(roots), seed)
    W = factor.T @ factor
    spectrum = np.linalg.svd(factor, compute_uv=False) ** 2
    tolerance = 3e-8 + 10 * len(roots) * EPS * spectrum[0] / spectrum[-1]
    expected = by_definition(name, spectrum, 0.5)
    logarithmic = name in ("log-det", "blend")
    got = symbolic_score(name, W, blend_weight=0.5)[0]
    assert got == pytest.approx(
        expected, rel=0 if logarithmic else tolerance, abs=3 * tolerance if logarithmic else 0
    )


def test_expression_sees_a_condition_number_of_1e8_to_one_in_a_million():
    got = [
        symbolic_score("condition-number", matrix((1.0, middle, 1e-8), seed))[0]
        for seed in range(50)
        for middle in (0.99, 1e-4, 1e-8)
    ]
    np.testing.assert_allclose(got, 1e8, rtol=1e-6)


@every_metric
@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_expression_is_elementwise_over_matrices_of_symbols(name, kind):
    W = np.stack([matrix((3.0, 2.0, 1 + k), seed=k) for k in range(6)]).reshape(2, 3, 3, 3)
    symbols = [kind.sym(f"w{k}", 2, 3) for k in range(6)]
    evaluate = ca.Function("score", symbols, [score_expression(name, tuple(symbols))])
    values = evaluate(*(W[:, :, i, j] for i in range(3) for j in range(i, 3))).full()
    np.testing.assert_allclose(values, score(name, W), rtol=3e-8, atol=3e-8)


def test_schur_complement_is_the_position_block_of_the_covariance_inverted():
    for n in (3, 4, 5):
        W = np.stack([matrix(1.0 + np.arange(n), seed) for seed in range(4)])
        expected = np.linalg.inv(np.linalg.inv(W)[:, :2, :2])
        np.testing.assert_allclose(position_schur_complement(W), expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(position_schur_complement(W, keep=5), W, atol=1e-14)


def test_schur_complement_by_expression_equals_numpy():
    W = np.stack([matrix((3.0, 1.0, 0.1 * (k + 1)), seed=k) for k in range(6)])
    s11, s12, s22 = (s.full().ravel() for s in position_schur_expression(entries(W)))
    S = position_schur_complement(W)
    np.testing.assert_allclose(
        np.stack([s11, s12, s22]), [S[:, 0, 0], S[:, 0, 1], S[:, 1, 1]], rtol=1e-12, atol=1e-14
    )


def test_nuisance_that_no_output_sees_costs_nothing():
    W = np.diag([2.0, 3.0, 0.0, 5.0])
    W[0, 3] = W[3, 0] = 1.0
    np.testing.assert_allclose(
        position_schur_complement(W), np.diag([2.0 - 1.0 / 5.0, 3.0]), atol=1e-15
    )
    s11, s12, s22 = position_schur_expression(entries(np.diag([2.0, 3.0, 0.0])[None]))
    assert (float(s11), float(s12), float(s22)) == (2.0, 0.0, 3.0)


def test_two_nuisances_seen_only_together_are_projected_out():
    """Outputs x1 + (n1 + n2) and x1, x2: the singular nuisance block costs x1 half of its information."""
    J = np.array([[1.0, 0, 1, 1], [1.0, 0, 0, 0], [0, 1.0, 0, 0]])
    np.testing.assert_allclose(position_schur_complement(J.T @ J), np.eye(2), atol=1e-14)


def test_weak_nuisance_beside_a_strong_one_is_not_taken_for_rounding():
    """x1 is seen only through x1 + 1e-10·n1, so not at all; n2 is seen well."""
    J = np.array([[1.0, 0, 1e-10, 0], [0, 1.0, 0, 0], [0, 0, 0, 1.0]])
    S = position_schur_complement(J.T @ J)
    np.testing.assert_allclose(S, np.diag([0.0, 1.0]), atol=1e-14)
    assert score("condition-number", S) == np.inf


def test_nuisance_seen_at_the_edge_of_rounding_is_not_dropped():
    """x1 is seen only beside 1.5e-8·(n1 - n2), a direction that two other outputs leave 4.5e-16 of: at least part of it must be lost."""
    J = np.array([[1.0, 0, 1.5e-8, -1.5e-8], [0, 1.0, 0, 0], [0, 0, 1.0, 1.0]])
    assert position_schur_complement(J.T @ J)[0, 0] < 0.8


@pytest.mark.parametrize("weak", [0, 1])
def test_what_a_large_nuisance_leaves_is_judged_against_what_it_took(weak):
    """One position is seen weakly by itself, the other only with the heading, strongly: rounding of the strong must not pass for weak."""
    for seed in range(200):
        strong = 1e5 * np.random.default_rng(seed).uniform(0.5, 1.0, size=2)
        J = np.zeros((2, 3))
        J[0, weak], J[1, 1 - weak], J[1, 2] = 0.03, *strong
        W = J.T @ J
        assert score("condition-number", position_schur_complement(W)) == np.inf
        assert (
            score_expression("condition-number", position_schur_expression(entries(W[None])))
            == np.inf
        )


def test_position_without_information_of_its_own_has_a_singular_complement_not_noise():
    """Rank-one W: the complement is zero, and what cancellation leaves must not pass for a well-conditioned matrix."""
    for seed in range(200):
        v = np.random.default_rng(seed).normal(size=3)
        W = np.outer(v, v)
        assert score("condition-number", position_schur_complement(W)) == np.inf
        assert (
            score_expression("condition-number", position_schur_expression(entries(W[None])))
            == np.inf
        )


def test_complement_of_a_singular_gramian_is_singular():
    """A null vector with a position part must survive; so must the line of a rank-two W that sees the nuisance."""
    for seed in range(200):
        J = np.random.default_rng(seed).normal(size=(2, 3))
        W = J.T @ J
        assert score("condition-number", position_schur_complement(W)) > 1e13
        assert (
            score_expression("condition-number", position_schur_expression(entries(W[None]))) > 1e13
        )


def test_not_finite_gramian_has_no_position_information():
    W = np.stack([np.eye(3), np.full((3, 3), np.nan)])
    np.testing.assert_array_equal(position_schur_complement(W)[1], np.zeros((2, 2)))
    np.testing.assert_allclose(position_schur_complement(W)[0], np.eye(2))


def test_weakest_direction_is_named():
    """Range without heading: rotation about the AUV, (-y, x, 1), is not seen."""
    null = np.array([-2.0, 1.0, 1.0])
    W = np.eye(3) - np.outer(null, null) / (null @ null)
    direction = unobservable_direction(W, ["x", "y", "heading"])
    assert list(direction) == ["x", "y", "heading"]
    np.testing.assert_allclose(list(direction.values()), -null / np.linalg.norm(null), atol=1e-15)


def test_bad_input_is_refused_with_its_value():
    W = np.eye(3)
    with pytest.raises(
        ValueError, match="metric 'kappa' is not known; choose one of condition-number"
    ):
        score("kappa", W)
    with pytest.raises(ValueError, match="blend weight must be finite and at least 0, got -1"):
        score("blend", W, blend_weight=-1.0)
    with pytest.raises(ValueError, match="blend weight must be finite and at least 0, got nan"):
        score_expression("blend", entries(W[None]), blend_weight=float("nan"))
    with pytest.raises(ValueError, match="one name per state: W has 3 states, got 2"):
        unobservable_direction(W, ["x", "y"])
    with pytest.raises(ValueError, match="W must be finite"):
        unobservable_direction(np.full((1, 1), np.nan), ["x"])
    with pytest.raises(ValueError, match="keep must be between 1 and the 3 states of W, got 4"):
        position_schur_complement(W, keep=4)
    with pytest.raises(ValueError, match="3 or 6 entries of the upper triangle of W, got 1"):
        score_expression("log-det", (ca.DM(1.0),))
