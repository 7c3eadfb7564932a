import casadi as ca
import numpy as np
import pytest
from gramian_oracles import arc
from scipy.integrate import solve_ivp

from formulations.gramian.range import (
    displacement_moments,
    gramian_entries,
    range_gramian_function,
    range_gramians,
    range_score_expression,
)
from formulations.metrics import (
    METRICS,
    condition_number,
    position_schur_complement,
    score,
    smallest_eigenvalue,
)

HORIZON = 2 * np.pi / 3  # two thirds of the smallest circle at 1 m/s, 0.5 m
RATES = np.linspace(-2.0, 2.0, 21)


def by_integration(x, heading, turn_rate, speed, horizon, v=(0.0, 0.0), variances=(1.0, 1.0)):
    """Variational equations and Gramian of d/dt (p, ψ) = (V cos ψ - v1, V sin ψ - v2, u), y = (ψ, |p|²), by DOP853."""

    def rate(_, s):
        p1, p2, psi = s[:3]
        Phi = s[3:12].reshape(3, 3)
        A = np.array([[0, 0, -speed * np.sin(psi)], [0, 0, speed * np.cos(psi)], [0, 0, 0]])
        J = (
            np.array(
                [
                    [0, 0, 1 / np.sqrt(variances[0])],
                    np.array([2 * p1, 2 * p2, 0]) / np.sqrt(variances[1]),
                ]
            )
            @ Phi
        )
        velocity = [speed * np.cos(psi) - v[0], speed * np.sin(psi) - v[1], turn_rate]
        return np.concatenate([velocity, (A @ Phi).ravel(), (J.T @ J).ravel()])

    start = np.concatenate([x, [heading], np.eye(3).ravel(), np.zeros(9)])
    end = solve_ivp(rate, (0, horizon), start, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    return end[12:].reshape(3, 3)


def factor(x, heading, turn_rate, speed, horizon, v=(0.0, 0.0)):
    """Square-root factor: weighted output Jacobians at 80 Gauss points along the arc, exact to rounding for |uT| below 30."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    t, w = 0.5 * horizon * (nodes + 1), 0.5 * horizon * weights
    half = 0.5 * turn_rate * t
    chord = speed * t * np.sinc(half / np.pi)
    dx, dy = chord * np.cos(heading + half), chord * np.sin(heading + half)
    p1, p2 = x[0] + dx - v[0] * t, x[1] + dy - v[1] * t
    root = np.sqrt(w)
    seen = np.stack([0 * t, 0 * t, root], axis=-1)
    ranged = np.stack([2 * p1 * root, 2 * p2 * root, 2 * (p2 * dx - p1 * dy) * root], axis=-1)
    return np.concatenate([seen, ranged])


def cases(moving):
    rng = np.random.default_rng(7)
    for uT in [
        0.0,
        1e-8,
        -1e-6,
        1e-4,
        1e-2,
        -0.1,
        0.3,
        0.35,
        0.5,
        1.9,
        2.1,
        *rng.uniform(-8, 8, 14),
    ]:
        horizon, speed = rng.uniform(0.2, 12), rng.uniform(0.2, 3)
        v = rng.normal(size=2) if moving else np.zeros(2)
        yield (
            rng.normal(size=2) * 10 ** rng.uniform(-1, 2),
            rng.uniform(-7, 7),
            uT / horizon,
            speed,
            horizon,
            v,
        )


@pytest.mark.parametrize("moving", [False, True])
def test_closed_form_is_the_variational_integral(moving):
    for x, heading, u, speed, horizon, v in cases(moving):
        W = range_gramians(
            x[None],
            heading,
            turn_rates=np.array([u]),
            speed=speed,
            horizon=horizon,
            velocities=v[None] if moving else None,
        )[0, 0]
        expected = by_integration(x, heading, u, speed, horizon, v)
        assert np.abs(W - expected).max() <= 1e-12 * np.linalg.norm(expected), (
            x,
            heading,
            u,
            speed,
            horizon,
            v,
        )


def test_moments_keep_every_digit_through_straight_ahead_and_the_change_of_branch():
    nodes, weights = np.polynomial.legendre.leggauss(60)
    speed, horizon = 1.7, 2.5
    t = 0.5 * horizon * (nodes + 1)
    for uT in [0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, 0.34, 0.36, 1.0, 1.999, 2.001, 4.19, 9.0]:
        u = uT / horizon
        chord = speed * t * np.sinc(u * t / 2 / np.pi)
        d1, d2 = chord * np.cos(u * t / 2), chord * np.sin(u * t / 2)
        for sign in (1, -1):
            moments = displacement_moments(speed, np.array([sign * u]), horizon)
            integrands = [np.ones_like(t), d1, sign * d2, d1 * d1, sign * d1 * d2, d2 * d2]
            for moment, integrand in zip(moments, integrands, strict=True):
                expected, size = (
                    0.5 * horizon * (t ** np.arange(3)[:, None] * f) @ weights
                    for f in (integrand, np.abs(integrand))
                )
                assert (np.abs(moment[:, 0] - expected) <= 2e-14 * size).all()


def test_reference_circle_about_the_auv():
    """x = (1, 0), ψ = π/2, V = u = 1: p = (cos t, sin t), so W11 = ∫ 4 cos² = 2T + sin 2T, W12 = 2 sin² T."""
    T = HORIZON
    W = range_gramians(
        np.array([[1.0, 0.0]]), np.pi / 2, turn_rates=np.array([1.0]), speed=1.0, horizon=T
    )[0, 0]
    assert W[0, 0] == pytest.approx(2 * T + np.sin(2 * T), rel=1e-15)
    np.testing.assert_allclose(W[0], [3.3227648, 1.5, -1.5], atol=5e-8)
    np.testing.assert_allclose(W[1], [1.5, 5.0548156, -5.0548156], atol=5e-8)
    assert W[2, 2] == pytest.approx(7.1492107, abs=5e-8)
    assert condition_number(W) == pytest.approx(12.868868623, abs=5e-10)


def test_reference_matrix_by_the_trapezoid_rule_is_approached_to_the_second_order():
    """21 intervals over 2.1 s by trapezoid give [[3.331331, 1.485290, ...]]; Euler-Maclaurin: the error is h²/12 of the end slopes."""
    T, h = 2.1, 2.1 / 21
    W = range_gramians(
        np.array([[1.0, 0.0]]), np.pi / 2, turn_rates=np.array([1.0]), speed=1.0, horizon=T
    )[0, 0]
    published = [3.331331, 1.485290, 5.068669, 7.168669]
    slopes = np.array(
        [-4 * np.sin(2 * T), 4 * np.cos(2 * T) - 4, 4 * np.sin(2 * T), 4 * np.sin(2 * T)]
    )  # of 4c², 4cs, 4s², 1 + 4s²
    trapezoid = np.array([W[0, 0], W[0, 1], W[1, 1], W[2, 2]]) + h * h / 12 * slopes
    np.testing.assert_allclose(trapezoid, published, atol=1e-5)


def test_reference_decision_depends_on_the_metric():
    W = range_gramians(
        np.array([[1.0, 0.0]]), np.pi / 2, turn_rates=RATES, speed=1.0, horizon=HORIZON
    )[:, 0]
    assert RATES[np.argmin(condition_number(W))] == pytest.approx(1.4)
    assert condition_number(W).min() == pytest.approx(8.879, abs=5e-4)
    assert RATES[np.argmax(smallest_eigenvalue(W))] == pytest.approx(0.6)


def test_fixed_aid_vehicle_and_fixed_auv_have_the_same_gramian_up_to_signs():
    """With r = -x the outputs are the same, so W_rel = D W D, D = diag(-1, -1, 1): integrate r' = (-V cos ψ, -V sin ψ, u) by itself."""
    x, heading, u, speed, horizon = np.array([2.0, -1.0]), 0.4, 0.8, 1.3, 2.0

    def rate(_, s):
        d = np.array([s[2], s[3]])  # the partial derivatives of r to ψ
        g = np.array([2 * s[0], 2 * s[1], 2 * s[:2] @ d])
        return np.concatenate(
            [
                [-speed * np.cos(heading + u * s[4]), -speed * np.sin(heading + u * s[4])],
                [speed * np.sin(heading + u * s[4]), -speed * np.cos(heading + u * s[4]), 1.0],
                (np.outer(g, g) + np.diag([0, 0, 1.0])).ravel(),
            ]
        )

    W_rel = (
        solve_ivp(
            rate, (0, horizon), np.r_[-x, np.zeros(12)], method="DOP853", rtol=1e-13, atol=1e-15
        )
        .y[5:, -1]
        .reshape(3, 3)
    )
    W = range_gramians(x[None], heading, turn_rates=np.array([u]), speed=speed, horizon=horizon)[
        0, 0
    ]
    D = np.diag([-1.0, -1.0, 1.0])
    np.testing.assert_allclose(D @ W @ D, W_rel, atol=1e-12 * np.linalg.norm(W))


def test_range_alone_never_sees_rotation_about_the_auv():
    x = np.array([[3.0, -2.0], [0.5, 8.0]])
    W = range_gramians(x, 0.3, turn_rates=RATES, speed=1.0, horizon=HORIZON, variances=(1e300, 1.0))
    for m, (x1, x2) in enumerate(x):
        residual = np.abs(W[:, m] @ np.array([-x2, x1, 1.0])).max(axis=-1)
        assert (residual <= 1e-14 * np.linalg.norm(W[:, m], axis=(-2, -1)) * np.hypot(x1, x2)).all()
    assert (condition_number(W) > 1e13).all()
    measured = range_gramians(x, 0.3, turn_rates=RATES, speed=1.0, horizon=HORIZON)
    assert (condition_number(measured) < 1e9).all()  # and the heading's own measurement cures it


def test_run_straight_at_the_auv_is_unobservable():
    for heading in (0.0, 0.3, 2.0):
        toward = np.array([[np.cos(heading), np.sin(heading)]])
        W = range_gramians(
            -5.0 * toward, heading, turn_rates=np.array([0.0]), speed=1.0, horizon=2.0
        )
        assert condition_number(W)[0, 0] == np.inf
        scores = range_score_expression(
            ca.DM([0, 0, heading]),
            ca.DM(5.0 * toward),
            moments=displacement_moments(1.0, np.array([0.0]), 2.0),
            heading_is_nuisance=True,
        )
        assert float(scores) == np.inf


def test_thesis_variant_leaves_the_range_out_of_the_heading_entries():
    x = np.array([[3.0, -2.0], [0.5, 1.0]])
    options = {
        "turn_rates": RATES,
        "speed": 1.0,
        "horizon": HORIZON,
        "velocities": np.array([[0.1, 0.2], [0.0, -0.3]]),
    }
    thesis, exact = (
        range_gramians(x, 0.3, variant=variant, **options) for variant in ("thesis", "exact")
    )
    np.testing.assert_array_equal(thesis[..., :2, :2], exact[..., :2, :2])
    np.testing.assert_array_equal(thesis[..., :2, 2], 0.0)
    np.testing.assert_allclose(thesis[..., 2, 2], HORIZON, rtol=1e-15)
    assert np.abs(exact[..., :2, 2]).min() > 1e-3


def test_degrees_are_central_differences_of_outputs_in_degrees():
    x, heading, u, eps = np.array([1.3, -0.7]), 35.0, 0.8, 1e-3

    def outputs(east, north, degrees):
        pose = arc(np.array([east, north, np.radians(degrees)]), u, nodes)
        return np.stack([np.degrees(pose[:, 2]), pose[:, 0] ** 2 + pose[:, 1] ** 2], axis=-1)

    nodes, weights = np.polynomial.legendre.leggauss(40)
    nodes, weights = 0.5 * HORIZON * (nodes + 1), 0.5 * HORIZON * weights
    start = np.array([*x, heading])
    d = [outputs(*(start + e)) - outputs(*(start - e)) for e in eps * np.eye(3)]
    expected = np.einsum("t,ita,jta->ij", weights, d, d) / (4 * eps**2)
    W = range_gramians(
        x[None],
        np.radians(heading),
        turn_rates=np.array([u]),
        speed=1.0,
        horizon=HORIZON,
        variant="degrees",
    )[0, 0]
    # rounding of headings near 100 degrees over eps; the range is nearly linear in a degree
    np.testing.assert_allclose(W, expected, rtol=1e-9, atol=1e-9)


def test_variances_scale_it_to_the_information_of_the_outputs():
    for x, heading, u, speed, horizon, v in list(cases(moving=True))[::5]:
        options = {
            "turn_rates": np.array([u]),
            "speed": speed,
            "horizon": horizon,
            "velocities": v[None],
        }
        expected = by_integration(x, heading, u, speed, horizon, v, variances=(0.02, 9.0))
        W = range_gramians(x[None], heading, variances=(0.02, 9.0), **options)[0, 0]
        assert np.abs(W - expected).max() <= 1e-12 * np.linalg.norm(expected)


def test_central_differences_converge_to_it_at_second_order():
    """Empirical Gramian (2.9) of the outputs along the arc, written apart; for position perturbations alone it is exact at any size."""
    x, heading, u, v = np.array([2.0, -1.5]), 0.7, 0.9, np.array([0.2, -0.4])
    nodes, weights = np.polynomial.legendre.leggauss(60)
    t, w = 0.5 * HORIZON * (nodes + 1), 0.5 * HORIZON * weights

    def outputs(state):
        psi = state[2] + u * t
        p1 = state[0] + (np.sin(psi) - np.sin(state[2])) / u - v[0] * t
        p2 = state[1] - (np.cos(psi) - np.cos(state[2])) / u - v[1] * t
        return np.stack([psi, p1**2 + p2**2])

    def empirical(eps):
        start = np.array([*x, heading])
        d = np.stack([outputs(start + eps * e) - outputs(start - eps * e) for e in np.eye(3)]) / (
            2 * eps
        )
        return np.einsum("iyt,jyt,t->ij", d, d, w)

    W = range_gramians(
        x[None], heading, turn_rates=np.array([u]), speed=1.0, horizon=HORIZON, velocities=v[None]
    )[0, 0]
    coarse, fine = (np.abs(empirical(eps) - W) for eps in (1e-2, 5e-3))
    assert coarse.max() / fine.max() == pytest.approx(4.0, abs=0.01)
    np.testing.assert_allclose(empirical(0.3)[:2, :2], W[:2, :2], rtol=1e-12)
    np.testing.assert_allclose(empirical(1e-5), W, rtol=1e-8)


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("variant", ["exact", "thesis", "degrees"])
@pytest.mark.parametrize("nuisance", [False, True])
def test_compiled_function_scores_all_candidates_and_auvs_as_numpy_does(moving, variant, nuisance):
    rng = np.random.default_rng(3)
    auvs, velocities, pose = (
        rng.normal(size=(5, 2)) * 4,
        rng.normal(size=(5, 2)),
        np.array([1.0, -2.0, 0.8]),
    )
    model = {"variant": variant, "variances": (0.5, 2.0)}
    W = range_gramians(
        pose[:2] - auvs,
        pose[2],
        turn_rates=RATES,
        speed=1.2,
        horizon=2.0,
        velocities=velocities if moving else None,
        **model,
    )
    W = position_schur_complement(W) if nuisance else W
    moments = displacement_moments(1.2, RATES, 2.0)
    for metric in METRICS:
        evaluate = range_gramian_function(
            5, moving=moving, moments=moments, metric=metric, heading_is_nuisance=nuisance, **model
        )
        scores = evaluate(pose, auvs, *([velocities] if moving else [])).full()
        assert scores.shape == (21, 5)
        np.testing.assert_allclose(
            scores, score(metric, W), rtol=3e-8, atol=3e-8
        )  # of the trigonometric eigenvalues


def test_condition_number_of_a_far_auv_keeps_six_digits():
    """κ grows as d⁴, to 6e8 at 100 m: oracle, the singular values of the square-root factor."""
    for distance in (1.0, 5.0, 20.0, 100.0):
        kappa = np.linalg.cond(factor((distance, 0.0), np.pi / 2, 1.0, 1.0, HORIZON)) ** 2
        moments = displacement_moments(1.0, np.array([1.0]), HORIZON)
        scores = range_score_expression(
            ca.DM([0, 0, np.pi / 2]), ca.DM([[-distance, 0.0]]), moments=moments
        )
        assert float(scores) == pytest.approx(kappa, rel=1e-6)
    assert kappa == pytest.approx(6e8, rel=0.05)


def test_entries_do_not_care_whether_numpy_or_casadi_evaluates_them():
    moments = displacement_moments(1.0, RATES, HORIZON)
    x, v = np.random.default_rng(0).normal(size=(2, 2, 1, 4))
    symbols = ca.SX.sym("xv", 4, 4)
    rows = [symbols[i, :] for i in range(4)]
    compiled = ca.Function(
        "entries", [symbols], list(gramian_entries(moments, (rows[0], rows[1]), (rows[2], rows[3])))
    )
    for got, expected in zip(
        compiled(np.concatenate([*x, *v])),
        gramian_entries(moments, (x[0], x[1]), (v[0], v[1])),
        strict=True,
    ):
        np.testing.assert_allclose(got.full(), expected, rtol=1e-14, atol=1e-14)


def test_bad_input_is_refused_with_its_value():
    for speed, rates, horizon, message in [
        (-1.0, RATES, 1.0, r"speed must be finite and at least 0 \[m/s\], got -1"),
        (1.0, RATES, 0.0, r"horizon must be finite and positive \[s\], got 0"),
        (1.0, RATES, np.nan, r"horizon must be finite and positive \[s\], got nan"),
        (1.0, np.array([np.inf]), 1.0, r"turn rates must be finite \[rad/s\], got \[inf\]"),
    ]:
        with pytest.raises(ValueError, match=message):
            displacement_moments(speed, rates, horizon)
    with pytest.raises(
        ValueError, match="variant 'thesys' is not known; choose one of exact, thesis, degrees"
    ):
        range_gramians(
            np.ones((1, 2)), 0.0, turn_rates=RATES, speed=1.0, horizon=1.0, variant="thesys"
        )
    with pytest.raises(
        ValueError, match=r"variances .* must be finite and positive, got \(0.0, 1.0\)"
    ):
        range_gramians(
            np.ones((1, 2)), 0.0, turn_rates=RATES, speed=1.0, horizon=1.0, variances=(0.0, 1.0)
        )
