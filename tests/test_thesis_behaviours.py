"""What the mathematics says of whole flights: path inertia's recurrence, circles, involutes and spirals, and the Gramian's choices."""

import math

import numpy as np
import pytest
from oracles import inertia_recurrence, offsets

import obsplan as op
from obsplan.scenario import load


def fixed_auv(
    start, *, dt=0.1, duration=20.0, r_min=0.5, speed=1.0, planner="path-inertia", **options
):
    """Fly `fixed-auv`, one AUV at rest at the origin, from another start (x, y, heading [rad])."""
    x, y, heading = start
    settings = [
        f"cna.start = {{ x = {x!r}, y = {y!r}, heading_deg = {math.degrees(heading)!r} }}",
        f"cna.speed = {speed!r}",
    ]
    settings += [
        f"cna.min_turn_radius = {r_min!r}",
        f"time_step = {dt!r}",
        f"duration = {duration!r}",
    ]
    settings += [f"planner.interval = {dt!r}", f"ranging.interval = {dt!r}"]
    settings += [
        f"planner.{key} = {value if not isinstance(value, str) else repr(value)}"
        for key, value in options.items()
    ]
    return op.simulate(
        load("fixed-auv", planner=planner, settings=[s.replace("'", '"') for s in settings])
    )


def seen(run):
    """(s, b) at every sample."""
    return offsets(run.cna, run.truth[0, 0, :2])


@pytest.mark.parametrize("seed", range(30))
def test_path_inertia_follows_the_exact_recurrence(seed):
    rng = np.random.default_rng(seed)
    gamma = [0.0, float(10 ** rng.uniform(-3, 3))][seed % 2]
    dt, r_min, speed = (
        float(rng.choice([0.02, 0.1, 0.25])),
        float(rng.uniform(0.2, 2.0)),
        float(rng.uniform(0.3, 3.0)),
    )
    start = tuple(map(float, (*rng.uniform(-6, 6, 2), rng.uniform(-3, 3))))
    run = fixed_auv(start, dt=dt, duration=200 * dt, r_min=r_min, speed=speed, gamma=gamma)
    expected = inertia_recurrence(
        *offsets([start], (0.0, 0.0))[0], gamma=gamma, r_min=r_min, speed=speed, dt=dt, steps=200
    )
    np.testing.assert_allclose(seen(run), expected, atol=1e-9)


def test_path_inertia_without_penalty_stays_on_the_circle_about_the_auv_with_condition_number_one():
    run = op.simulate("fixed-auv")
    np.testing.assert_array_equal(run.cna[0], [1.0, 0.0, np.pi / 2])
    np.testing.assert_allclose(run.separation, 1.0, atol=1e-9)
    np.testing.assert_allclose(run.condition[0, :-1], 1.0, atol=1e-9)
    np.testing.assert_allclose(
        np.diff(run.cna[:, 2]), 0.1, atol=1e-9
    )  # counter-clockwise at 1 rad/s
    assert run.condition_label == "κ(J)"


def halving_ratios(error_at, steps=(0.1, 0.05, 0.025)):
    """Ratios of the errors at steps each half the one before; 2 at first order."""
    errors = [error_at(dt) for dt in steps]
    return np.array(errors[:-1]) / errors[1:]


def off(law, start, **options):
    """Greatest departure from a continuous law of (time, s, b), as a function of the time step."""

    def error(dt):
        run = fixed_auv(start, dt=dt, **options)
        return float(np.abs(law(run.time, *seen(run).T)).max())

    return error


@pytest.mark.parametrize("start", [(2.0, -1.0, 0.6), (-3.0, 2.0, 0.4), (0.0, -4.0, 0.2)])
def test_without_penalty_the_flight_tends_to_an_involute_to_first_order(start):
    s0, b0 = offsets([start], (0.0, 0.0))[0]
    law = lambda t, s, b: s**2 + b**2 - (s0**2 + b0**2 + 2 * s0 * t)  # noqa: E731
    np.testing.assert_allclose(
        halving_ratios(off(law, start, duration=2.0, gamma=0.0)), 2.0, rtol=0.05
    )


def test_without_penalty_s_is_constant_to_first_order():
    start = (2.0, -1.0, 0.6)
    s0, _ = offsets([start], (0.0, 0.0))[0]
    np.testing.assert_allclose(
        halving_ratios(off(lambda _, s, __: s - s0, start, duration=2.0, gamma=0.0)), 2.0, rtol=0.05
    )


def test_with_a_penalty_s_squared_and_the_radius_trade_at_first_order():
    start, gamma = (3.0, -2.0, 0.5), 1.0
    tau = gamma / (2 * (1 + gamma))
    s0, b0 = offsets([start], (0.0, 0.0))[0]
    held = s0**2 + 2 * tau * (abs(b0) - tau)
    law = lambda _, s, b: s**2 + 2 * tau * (np.abs(b) - tau) - held  # noqa: E731
    np.testing.assert_allclose(
        halving_ratios(off(law, start, duration=4.0, gamma=gamma)), 2.0, rtol=0.05
    )


def test_curvature_form_keeps_its_angle_to_first_order():
    start = (4.0, -1.0, 0.9)
    s0, b0 = offsets([start], (0.0, 0.0))[0]
    angle = math.atan2(b0, s0)
    options = {"duration": 5.0, "objective": "condition-number"}
    np.testing.assert_allclose(
        halving_ratios(off(lambda _, s, b: np.arctan2(b, s) - angle, start, **options)),
        2.0,
        rtol=0.05,
    )
    spiral = lambda t, s, b: np.hypot(s, b) - (math.hypot(s0, b0) + math.cos(angle) * t)  # noqa: E731
    np.testing.assert_allclose(halving_ratios(off(spiral, start, **options)), 2.0, rtol=0.05)


def test_outward_inward_and_abeam_starts_are_the_three_classes_of_the_thesis():
    away, inward = (
        fixed_auv((2.0, 0.0, heading), gamma=0.0, duration=30.0).separation[0]
        for heading in (1.0, 2.0)
    )
    assert (np.diff(away) > 0).all()
    least = inward.argmin()
    assert 0 < least < inward.size - 1
    assert inward[-1] > inward[0]
    slid = np.diff(inward[: least + 1])
    assert (slid < 1e-9).all()
    assert (np.diff(inward[least + 20 :]) > 0).all()  # once past, it recedes for good


@pytest.mark.parametrize("gamma", [0.3, 1.0, 100.0])
def test_penalty_turns_an_outward_start_round_where_and_when_predicted(gamma):
    start, tau = (3.0, 0.0, 1.0), gamma / (2 * (1 + gamma))
    s0, b0 = offsets([start], (0.0, 0.0))[0]
    rho0 = abs(b0) - tau
    when, farthest = (rho0 * s0 + s0**3 / (3 * tau)) / tau, rho0 + s0**2 / (2 * tau) + tau

    def error(dt):
        run = fixed_auv(start, dt=dt, gamma=gamma, duration=math.ceil(1.2 * when))
        s = seen(run)[:, 0]
        k = int(np.argmax(s < 0))  # from here on it comes back
        crossing = run.time[k] - dt * s[k] / (s[k] - s[k - 1])
        return np.array([crossing - when, run.separation.max() - farthest])

    errors = [error(dt) for dt in (0.08, 0.04, 0.02)]
    np.testing.assert_allclose(errors[0] / errors[1], 2.0, rtol=0.1)
    np.testing.assert_allclose(errors[1] / errors[2], 2.0, rtol=0.05)


def test_the_smaller_the_penalty_the_longer_the_outward_leg():
    farthest = [
        fixed_auv((3.0, 0.0, 1.0), gamma=gamma, duration=100.0).separation.max()
        for gamma in (0.5, 1.0, 5.0, 100.0)
    ]
    assert (np.diff(farthest) < 0).all()


def test_gramian_planner_spirals_in_by_the_thesis_variant_and_may_run_away_by_the_exact_one():
    flown = {
        g: fixed_auv((4.0, 3.0, np.pi / 6), planner="gramian", gramian=g, duration=30.0).separation[
            0
        ]
        for g in ("thesis", "exact")
    }
    assert flown["thesis"][-100:].max() < 1.0  # 0.7 m
    assert flown["exact"][-1] == pytest.approx(5.0 + 30.0, abs=0.1)  # straight away
