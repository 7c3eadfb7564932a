import casadi as ca
import numpy as np
import pytest
from oracles import arc

import obsplan as op
from obsplan.estimators.jacobian import jacobian, transitions
from obsplan.sensors import SENSORS, Heading, Range, SquaredRange
from obsplan.vehicles import VEHICLES, DeadReckoning, Unicycle

CURRENT = (0.3, -0.2)
MODELS = {
    "unicycle": Unicycle(speed=1.5, min_turn_radius=2.0),
    "dead-reckoning": DeadReckoning(current=CURRENT),
}
STATES = {"unicycle": 3, "dead-reckoning": 4}


def evaluate(expression_of, *arguments):
    """Value of an expression at numbers, through a Function as the simulator does."""
    symbols = [ca.SX.sym("s", len(a)) for a in arguments]
    return ca.Function("f", symbols, [expression_of(*symbols)])(*arguments).full()


def central_difference(f, x, step=1e-6):
    """Jacobian of f at x; error about step², plus rounding of f over step."""
    return np.stack([(f(x + d) - f(x - d)) / (2 * step) for d in step * np.eye(len(x))], axis=-1)


@pytest.mark.parametrize("turn_rate", [0.7, -0.7, 0.01, 0.0, -3.0])
def test_unicycle_moves_on_the_arc_of_complex_numbers(turn_rate):
    pose = np.array([3.0, -2.0, 0.7])
    for dt in (0.1, 1.0, 9.0):
        moved = evaluate(
            lambda x, u, dt=dt: MODELS["unicycle"].step(x, u, dt), pose, np.array([turn_rate, 2.5])
        )
        np.testing.assert_allclose(moved[:, 0], arc(pose, turn_rate, 2.5, dt), atol=1e-12)


@pytest.mark.parametrize("turn_rate", [1e-9, -1e-160, 5e-324])
def test_unicycle_barely_turning_goes_straight(turn_rate):
    moved = evaluate(
        lambda x, u: MODELS["unicycle"].step(x, u, 2.0), np.zeros(3), np.array([turn_rate, 1.0])
    )
    np.testing.assert_allclose(moved[:, 0], [2.0, 0.0, 0.0], atol=1e-8)


def test_unicycle_turns_no_tighter_than_its_radius():
    assert MODELS["unicycle"].max_turn_rate == 1.5 / 2.0


@pytest.mark.parametrize("field", ["speed", "min_turn_radius"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_unicycle_refuses_what_no_vehicle_has(field, value):
    with pytest.raises(
        ValueError, match=rf"{field} must be positive and finite \[m.*\], got {value}"
    ):
        op.Unicycle(**({"speed": 1.0, "min_turn_radius": 1.0} | {field: value}))


def test_dead_reckoning_holds_its_velocity_over_the_sample_and_turns_at_its_end():
    moved = evaluate(
        lambda x, u: MODELS["dead-reckoning"].step(x, u, 2.0),
        np.array([1.0, 2.0, np.pi / 3, 0.8]),
        np.array([0.25, -0.1]),
    )
    east, north = 1.0 + 2 * (0.8 * 0.5 + 0.3), 2.0 + 2 * (0.8 * np.sqrt(0.75) - 0.2)
    np.testing.assert_allclose(moved[:, 0], [east, north, np.pi / 3 + 0.25, 0.7], rtol=1e-14)


@pytest.mark.parametrize("name", ["unicycle", *VEHICLES])
def test_jacobian_of_every_vehicle_is_the_limit_of_differences(name):
    rng = np.random.default_rng(1)
    model, n = MODELS[name], STATES[name]
    for _ in range(20):
        x, u = rng.normal(size=n) * 3, rng.normal(size=2)
        step = lambda x, u=u: evaluate(lambda x, u: model.step(x, u, 0.4), x, u)[:, 0]  # noqa: E731
        F = evaluate(lambda x, u: jacobian(lambda s: model.step(s, u, 0.4), x), x, u)
        np.testing.assert_allclose(F, central_difference(step, x), atol=1e-8)


def test_jacobian_at_an_expression_is_the_jacobian_at_its_value():
    doubled = evaluate(lambda x: jacobian(lambda s: s[0] * s[1], 2 * x), np.array([3.0, 5.0]))
    np.testing.assert_array_equal(doubled, [[10.0, 6.0]])


def test_transitions_are_the_jacobians_at_each_state_without_control():
    states = np.random.default_rng(2).normal(size=(7, 4))

    def step(x):
        return evaluate(lambda x: MODELS["dead-reckoning"].step(x, ca.SX.zeros(4), 0.4), x)[:, 0]

    for F, x in zip(transitions(MODELS["dead-reckoning"], states, 0.4), states, strict=True):
        np.testing.assert_allclose(F, central_difference(step, x), atol=1e-8)


TRUTH = {
    "range": lambda x, beacon: abs(complex(*x[:2]) - complex(*beacon[:2])),
    "squared-range": lambda x, beacon: abs(complex(*x[:2]) - complex(*beacon[:2])) ** 2,
    "heading": lambda x, beacon: x[2],
}


@pytest.mark.parametrize("name", ["heading", *SENSORS])
def test_every_sensor_measures_what_it_says_and_its_jacobian_is_the_limit_of_differences(name):
    rng = np.random.default_rng(3)
    sensor = (SENSORS | {"heading": Heading})[name](sigma=1.0)
    for _ in range(20):
        x, beacon = rng.normal(size=4) * 3, rng.normal(size=3)
        measure = lambda x, beacon=beacon: np.array([TRUTH[name](x, beacon)])  # noqa: E731
        assert evaluate(sensor.measure, x, beacon)[0, 0] == pytest.approx(measure(x)[0], rel=1e-14)
        H = evaluate(lambda x, b: jacobian(lambda s: sensor.measure(s, b), x), x, beacon)
        np.testing.assert_allclose(H, central_difference(measure, x), atol=1e-7)


@pytest.mark.parametrize("sensor", [Range(sigma=1.0), SquaredRange(sigma=1.0)])
def test_at_coincidence_the_range_is_zero_and_tells_no_direction(sensor):
    x = np.array([3.0, -1.0, 0.2, 1.0])
    assert evaluate(sensor.measure, x, x[:2])[0, 0] == 0.0
    np.testing.assert_array_equal(
        evaluate(lambda x, b: jacobian(lambda s: sensor.measure(s, b), x), x, x[:2]),
        np.zeros((1, 4)),
    )


def test_only_the_heading_is_an_angle():
    assert Heading(sigma=1.0).periodic
    assert not Range(sigma=1.0).periodic
    assert not SquaredRange(sigma=1.0).periodic
