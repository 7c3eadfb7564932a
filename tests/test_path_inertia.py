"""The closed forms: optimal by brute force, in every arithmetic, and driving a vehicle as the theory says."""

import math

import casadi as ca
import numpy as np
import pytest
from scipy.optimize import minimize_scalar

import formulations as fm

ROTATION = 0.7  # an angle at which no two coordinates can be mistaken for each other


def thesis_center(x, heading, radius):
    """Centre by (3.17), as printed."""
    return np.asarray(x) - radius * np.array([[0, 1], [-1, 0]]) @ [
        math.cos(heading),
        math.sin(heading),
    ]


def thesis_inertia(x, heading, radius):
    """Inertia about the AUV by (3.15) and (3.18)."""
    c = thesis_center(x, heading, radius)
    return radius**2 / 2 * np.eye(2) + c @ c * np.eye(2) - np.outer(c, c)


def thesis_cost(positions, weights, heading, radius, gamma):
    """(3.26) with its sum over every term."""
    total = 0.0
    for x, w in zip(positions, weights, strict=True):
        b = math.sin(heading) * x[0] - math.cos(heading) * x[1]
        c = thesis_center(x, heading, radius)
        total += w * (radius**2 - 2 * radius * b + gamma * (c @ c + abs(radius)))
    return total


def random_decisions(seed, n):
    rng = np.random.default_rng(seed)
    for _ in range(n):
        m = rng.integers(1, 5)
        weights = rng.uniform(0, 1, m)
        yield (
            rng.normal(size=(m, 2)) * rng.choice([0.3, 3.0, 30.0]),
            weights / weights.sum(),
            rng.uniform(-4, 4),
            rng.uniform(0.1, 2),
        )


def offsets(positions, heading):
    x1, x2 = positions.T
    return fm.lateral_offset(x1, x2, heading), fm.longitudinal_offset(x1, x2, heading)


def test_auv_to_the_left_has_positive_offset_and_one_ahead_negative_longitudinal():
    heading = math.radians(30)
    ahead, left = (
        np.array([math.cos(heading), math.sin(heading)]),
        np.array([-math.sin(heading), math.cos(heading)]),
    )
    relative = -(4 * ahead + 3 * left)  # aid vehicle minus AUV
    assert fm.lateral_offset(*relative, heading) == pytest.approx(3, abs=1e-15 * 10)
    assert fm.longitudinal_offset(*relative, heading) == pytest.approx(-4, abs=1e-15 * 10)


def test_condition_number_is_that_of_the_inertia_of_the_circle_ahead():
    for positions, _, heading, size in random_decisions(1, 50):
        for radius in (size, -size):
            x = positions[0]
            expected = np.linalg.cond(thesis_inertia(x, heading, radius))
            b, s = fm.lateral_offset(*x, heading), fm.longitudinal_offset(*x, heading)
            assert fm.inertia_condition_number(radius, b, s) == pytest.approx(expected, rel=1e-10)
            assert fm.curvature_condition_number(1 / radius, b, x @ x) == pytest.approx(
                expected, rel=1e-10
            )
            np.testing.assert_allclose(
                fm.circle_center(*x, heading, radius), thesis_center(x, heading, radius), atol=1e-12
            )


def test_inertia_of_a_circle_is_that_of_its_points():
    """(3.15) to (3.18) against the second moments of a circle walked in 400 even steps, exact for trigonometric polynomials."""
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    points = thesis_center([2, -1], 0.4, 1.7)[:, None] + 1.7 * np.array(
        [np.cos(angle), np.sin(angle)]
    )
    moments = points @ points.T / 400
    np.testing.assert_allclose(
        np.trace(moments) * np.eye(2) - moments, thesis_inertia([2, -1], 0.4, 1.7), atol=1e-12
    )


def test_straight_ahead_has_condition_number_three_for_every_auv():
    assert fm.curvature_condition_number(0.0, 5.0, 100.0) == 3
    assert fm.inertia_condition_number(1e9, 5.0, 3.0) == pytest.approx(3, abs=1e-7)


@pytest.mark.parametrize("gamma", [0, 0.3, 1, 100])
def test_radius_is_the_best_of_all_turnable_radii(gamma):
    for positions, weights, heading, min_radius in random_decisions(2, 60):
        b, _ = offsets(positions, heading)
        radius, clipped = fm.path_inertia_radius(float(weights @ b), gamma, min_radius)

        def cost(r, decision=(positions, weights, heading)):
            return thesis_cost(*decision, r, gamma)

        reach = 2 * np.abs(b).max() + 2 * min_radius
        best = [
            minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 1e-10})
            for bounds in _both_sides(min_radius, reach)
        ]
        best = min(best, key=lambda result: result.fun)
        assert radius == pytest.approx(
            best.x, abs=1e-6 * reach
        )  # a minimum is flat: its place is known to the root of rounding
        assert clipped == (abs(radius) == min_radius)


def _both_sides(least, most):
    return (least, most), (-most, -least)


def test_curvature_has_the_least_mean_condition_number_within_the_turning_limit():
    for positions, weights, heading, min_radius in random_decisions(3, 60):
        b, s = offsets(positions, heading)
        curvature, clipped = fm.path_inertia_curvature(
            float(weights @ b), float(weights @ (b**2 + s**2)), min_radius
        )

        def mean_condition(k, decision=(positions, weights, heading)):
            positions, weights, heading = decision
            return weights @ [np.linalg.cond(thesis_inertia(x, heading, 1 / k)) for x in positions]

        least = 1e-6 / min_radius
        best = [
            minimize_scalar(mean_condition, bounds=side, method="bounded")
            for side in _both_sides(least, 1 / min_radius)
        ]
        best = min(best, key=lambda result: result.fun)
        assert curvature == pytest.approx(best.x, abs=2e-5 / min_radius)  # xatol 1e-5
        assert clipped == (abs(curvature) == 1 / min_radius)


def test_threshold_is_half_a_metre_at_most():
    assert fm.radius_threshold(0) == 0
    assert fm.radius_threshold(1) == 0.25
    assert 0.49999 < fm.radius_threshold(1e6) < 0.5


def test_limit_is_applied_by_the_sign_of_the_offset_and_left_where_it_is_zero():
    assert fm.path_inertia_radius(0.0, 1.0, 0.5) == (0.5, True)
    assert fm.path_inertia_radius(-0.0, 1.0, 0.5) == (0.5, True)
    assert fm.path_inertia_radius(-0.2, 1.0, 0.5) == (
        -0.5,
        True,
    )  # in the dead zone the free optimum is 0, whose sign says nothing
    assert fm.path_inertia_radius(0.75, 1.0, 0.5) == (
        0.5,
        False,
    )  # exactly reached: nothing was cut off
    assert fm.path_inertia_radius(-3.0, 1.0, 0.5) == (-2.75, False)


def test_on_top_of_every_auv_the_curvature_form_goes_straight_on():
    assert fm.path_inertia_curvature(0.0, 0.0, 0.5) == (0, False)


def test_floats_arrays_and_expressions_take_the_same_decisions():
    rng = np.random.default_rng(4)
    x, heading = rng.normal(size=(300, 2)) * 2, rng.uniform(-4, 4, 300)
    x[0] = 0
    symbol, angle = ca.SX.sym("x", 2), ca.SX.sym("heading")

    def decide(x1, x2, psi, square):
        b = fm.lateral_offset(x1, x2, psi)
        return [*fm.path_inertia_radius(b, 0.5, 0.5), *fm.path_inertia_curvature(b, square, 0.5)]

    expressions = decide(symbol[0], symbol[1], angle, ca.sumsqr(symbol))
    assert all(isinstance(expression, ca.SX) for expression in expressions)
    compiled = ca.Function("decide", [symbol, angle], expressions).map(300)(x.T, heading)
    arrays = decide(x[:, 0], x[:, 1], heading, (x**2).sum(axis=1))
    floats = [
        decide(float(p[0]), float(p[1]), float(h), float(p @ p))
        for p, h in zip(x, heading, strict=True)
    ]
    for column, (expression, array) in enumerate(zip(compiled, arrays, strict=True)):
        np.testing.assert_allclose(np.ravel(expression.full()), array, rtol=1e-12)
        np.testing.assert_allclose([row[column] for row in floats], array, rtol=1e-12)


# One AUV at rest at the origin, the aid vehicle on exact arcs: the theory of the method as an oracle.


def fly(decide, start, heading, dt, steps, speed=1.0):
    """Return positions, headings and turn rates; the arc is walked by the complex exponential's own integral."""
    z, psi, track = complex(*start), heading, []
    for _ in range(steps):
        rate = decide(z.real, z.imag, psi)
        track.append((z.real, z.imag, psi, rate))
        swept = rate * dt
        chord = dt if swept == 0 else (np.exp(1j * swept) - 1) / (1j * rate)
        z, psi = z + speed * np.exp(1j * psi) * chord, psi + swept
    return np.array([*track, (z.real, z.imag, psi, np.nan)])


def by_radius(gamma, min_radius, speed=1.0):
    return lambda x1, x2, psi: (
        speed / fm.path_inertia_radius(fm.lateral_offset(x1, x2, psi), gamma, min_radius)[0]
    )


def by_curvature(x1, x2, psi):
    return fm.path_inertia_curvature(fm.lateral_offset(x1, x2, psi), x1**2 + x2**2, 1e-3)[0]


def test_any_run_follows_the_exact_recurrence():
    rng = np.random.default_rng(5)
    for _ in range(40):
        gamma, dt, speed = rng.choice([0, 0.1, 1, 10]), rng.uniform(0.01, 1), rng.uniform(0.3, 3)
        track = fly(
            by_radius(gamma, 0.5, speed), rng.normal(size=2) * 3, rng.uniform(-4, 4), dt, 60, speed
        )
        b, s = (
            offset(track[:, 0], track[:, 1], track[:, 2])
            for offset in (fm.lateral_offset, fm.longitudinal_offset)
        )
        r = speed / track[:-1, 3]
        angle, t = speed * dt / r, b[:-1] - r
        scale = 1 + np.abs(track[:, :2]).max()
        np.testing.assert_allclose(
            s[1:], s[:-1] * np.cos(angle) - t * np.sin(angle), atol=1e-12 * scale
        )
        np.testing.assert_allclose(
            b[1:], r + s[:-1] * np.sin(angle) + t * np.cos(angle), atol=1e-12 * scale
        )


def test_abeam_without_penalty_the_aid_vehicle_stays_on_its_circle():
    track = fly(by_radius(0.0, 0.5), (1, 0), np.pi / 2, 0.1, 500)
    np.testing.assert_allclose(np.hypot(track[:, 0], track[:, 1]), 1, atol=1e-12)


def assert_first_order(error):
    """Halving the time step halves the error, to 5 %: first order, with nothing left at dt = 0."""
    errors = np.array([error(dt) for dt in (4e-3, 2e-3, 1e-3)])
    np.testing.assert_allclose(errors[:-1] / errors[1:], 2, rtol=0.05)


@pytest.mark.parametrize("start", [(2.0, 1.0), (2.0, -0.5)], ids=["outward", "inward"])
def test_without_penalty_the_path_tends_to_an_involute(start):
    speed_along = start[1]  # heading north: s = x2, b = x1

    def error(dt):
        track = fly(by_radius(0.0, 0.01), start, np.pi / 2, dt, round(2 / dt))
        time = dt * np.arange(len(track))
        return np.abs(
            (track[:, :2] ** 2).sum(axis=1)
            - (start[0] ** 2 + start[1] ** 2 + 2 * speed_along * time)
        ).max()

    assert_first_order(error)


def test_with_penalty_s_squared_and_the_shrunk_offset_trade_at_a_constant_rate():
    tau = fm.radius_threshold(1.0)

    def error(dt):
        track = fly(by_radius(1.0, 0.01), (2, 0.5), np.pi / 2, dt, round(2 / dt))
        b, s = (
            offset(track[:, 0], track[:, 1], track[:, 2])
            for offset in (fm.lateral_offset, fm.longitudinal_offset)
        )
        constant = s**2 + 2 * tau * (np.abs(b) - tau)
        return np.abs(constant - constant[0]).max()

    assert_first_order(error)


def test_with_penalty_an_outward_start_turns_round_where_and_when_predicted():
    tau, b0, s0, dt = fm.radius_threshold(1.0), 2.0, 0.5, 1e-3
    rho0 = b0 - tau
    track = fly(by_radius(1.0, 0.01), (b0, s0), np.pi / 2, dt, 8000)
    distance = np.hypot(track[:, 0], track[:, 1])
    furthest = int(distance.argmax())
    assert dt * furthest == pytest.approx(
        (rho0 * s0 + s0**3 / (3 * tau)) / tau, rel=5e-3
    )  # dt over the time constant, first order
    assert distance[furthest] == pytest.approx(rho0 + s0**2 / (2 * tau) + tau, rel=1e-3)


def test_curvature_form_tends_to_a_logarithmic_spiral():
    start = np.array([2.0, 0.5])

    def error(dt):
        track = fly(by_curvature, start, np.pi / 2, dt, round(2 / dt))
        time, distance = dt * np.arange(len(track)), np.hypot(track[:, 0], track[:, 1])
        return np.abs(distance - (distance[0] + start[1] / distance[0] * time)).max()

    assert_first_order(error)


def test_decision_does_not_depend_on_where_north_is():
    turn = np.array(
        [[math.cos(ROTATION), -math.sin(ROTATION)], [math.sin(ROTATION), math.cos(ROTATION)]]
    )
    for positions, _, heading, _ in random_decisions(6, 30):
        turned = positions @ turn.T
        np.testing.assert_allclose(
            offsets(turned, heading + ROTATION),
            offsets(positions, heading),
            atol=1e-13 * np.abs(positions).max(),
        )
