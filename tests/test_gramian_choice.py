"""Inputs of any vehicle chosen by the observability of any measurement."""

import casadi as ca
import numpy as np
import pytest
from gramian_oracles import arc, integral

import obsplan as op
from formulations import SimulatedGramian, Status, choose_input, exact_gramian

SITUATION = op.Situation(op.Unicycle(speed=1.0, min_turn_radius=0.5))
PLANNER = op.GramianHorizon(SITUATION)
HORIZON, RATES = PLANNER.look_ahead, PLANNER.candidates


def unicycle(x, u):
    return ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), u[0])


def range_to(t, x, u, p):  # noqa: ARG001
    return ca.vertcat(x[2], (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2)


GRAMIAN = exact_gramian(unicycle, range_to, n=3, m=1, q=2, steps=400)
COARSE = exact_gramian(unicycle, range_to, n=3, m=1, q=2, steps=20)


def numpy_unicycle(x, u):
    return np.array([np.cos(x[2]), np.sin(x[2]), u[0]])


def numpy_range_to(t, x, u, p):  # noqa: ARG001
    return [x[2], (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2]


def simulated(h=numpy_range_to, steps=20, **options):
    return SimulatedGramian(f=numpy_unicycle, h=h, steps=steps, **options)


@pytest.mark.parametrize("metric", ["condition-number", "unobservability-index", "trace-inverse"])
def test_on_the_unicycle_and_its_range_it_decides_as_the_planner_in_closed_form(metric):
    planner = op.GramianHorizon(SITUATION, metric=metric)
    rng = np.random.default_rng(4)
    for _ in range(10):
        pose, auvs, weights = rng.uniform(-4, 4, 3), rng.uniform(-4, 4, (2, 2)), rng.random(2)
        beliefs = [op.Belief.at(*auv, weight=w) for auv, w in zip(auvs, weights, strict=True)]
        decision = planner.plan(op.Pose(*pose), beliefs)
        choice = choose_input(
            GRAMIAN, pose, RATES, horizon=HORIZON, p=auvs, weights=weights, metric=metric
        )
        np.testing.assert_array_equal(choice.x, [decision.turn_rate])
        # Simpson and Runge-Kutta of order 4, at u dt = 0.01: (u dt)^4 / 180 = 7e-11 of W
        assert choice.objective == pytest.approx(decision.score, rel=1e-9)
        np.testing.assert_allclose(choice.condition, decision.condition, rtol=1e-9)


# --- a second vehicle: three dimensions, a depth that it keeps, a slant range ---

SETTLING = 2.0  # [s]
SIGMAS = np.array([0.05, 0.1, 0.5])  # heading [rad], depth [m], range [m]


def submarine(x, u):
    return ca.vertcat(ca.cos(x[3]), ca.sin(x[3]), (u[1] - x[2]) / SETTLING, u[0])


def slant_range(t, x, u, p):  # noqa: ARG001
    return ca.vertcat(x[3], x[2], ca.norm_2(x[:3] - p))


def submarine_jacobian(x0, u, auv, t):
    """Derivative of the outputs by the start, from the exact arc and the exact settling."""
    pose = arc(x0[[0, 1, 3]], u[0], t)
    settled = np.exp(-t / SETTLING)
    away = np.column_stack([pose[:, :2], u[1] + (x0[2] - u[1]) * settled]) - auv
    east, north = pose[:, 0] - x0[0], pose[:, 1] - x0[1]
    by_heading = away[:, 1] * east - away[:, 0] * north
    by_start = np.column_stack([away[:, :2], away[:, 2] * settled, by_heading])
    rows = np.zeros((len(t), 3, 4))
    rows[:, 0, 3], rows[:, 1, 2] = 1.0, settled
    rows[:, 2] = by_start / np.linalg.norm(away, axis=1)[:, None]
    return rows


def test_a_depth_keeping_vehicle_with_slant_ranges_takes_the_best_turn_and_depth():
    gramian = exact_gramian(submarine, slant_range, n=4, m=2, q=3, steps=200)
    x0, auvs = np.array([3.0, -1.0, 2.0, 0.3]), np.array([[0.0, 0.0, 8.0], [6.0, 5.0, 4.0]])
    candidates = [[turn, depth] for depth in (0.0, 3.0, 6.0) for turn in (-1.0, -0.3, 0.4, 1.0)]
    R = np.diag(SIGMAS**2)
    totals = []
    for u in candidates:
        of_each = [
            np.linalg.inv(
                integral(
                    lambda t, u=u, auv=auv: submarine_jacobian(x0, u, auv, t),
                    6.0,
                    np.linalg.inv(R),
                )
            ).trace()
            for auv in auvs
        ]
        totals.append(np.mean(of_each))
    choice = choose_input(gramian, x0, candidates, horizon=6.0, p=auvs, R=R, metric="trace-inverse")
    np.testing.assert_array_equal(choice.x, candidates[np.argmin(totals)])
    assert choice.objective == pytest.approx(min(totals), rel=1e-7)  # (0.03)^4 / 180, times κ
    assert choice.status is Status.OPTIMAL
    assert sorted(totals)[1] > 1.001 * min(totals)


# --- models in numpy ---


def test_a_model_in_numpy_gets_the_same_decision_by_simulation():
    pose, auvs = [1.0, 0.5, 2.9], [[0.0, 0.0], [3.0, -1.0]]
    exact = choose_input(COARSE, pose, RATES[::4], horizon=HORIZON, p=auvs)
    choice = choose_input(simulated(), pose, RATES[::4], horizon=HORIZON, p=auvs)
    np.testing.assert_array_equal(choice.x, exact.x)
    # rounding over epsilon, 2e-11 of an entry, and epsilon², times the condition number
    assert choice.objective == pytest.approx(exact.objective, rel=1e-8)


def compass(unit, period):
    def measure(t, x, u, p):  # noqa: ARG001
        heading = np.remainder(x[2] * unit + period / 2, period) - period / 2
        return np.array([heading, (x[0] - p[0]) ** 2 + (x[1] - p[1]) ** 2])

    return measure


WEST = np.array([1.0, 0.5, np.pi - 0.25])  # a turn of 0.5 rad/s passes west at a sample


GIVEN = {"u": [[0.5]], "horizon": 1.0, "p": [0.0, 0.0]}


@pytest.mark.parametrize("sense", [1.0, -1.0])  # a heading, and a bearing that counts clockwise
def test_a_wrapped_angle_is_declared_or_refused(sense):
    wrapped = compass(sense, 2 * np.pi)
    with pytest.raises(ValueError, match=r"output 0 jumps by 6\.28319 where state 2 is moved"):
        simulated(wrapped)(WEST, **GIVEN)
    W = simulated(wrapped, angles=(0,))(WEST, **GIVEN)
    np.testing.assert_allclose(W, simulated()(WEST, **GIVEN), rtol=1e-8)


def test_an_angle_must_be_an_output_in_radians():
    with pytest.raises(ValueError, match=r"output 0, declared an angle, moves by .* in radians"):
        simulated(compass(180 / np.pi, 360.0), angles=(0,))(WEST, **GIVEN)
    with pytest.raises(ValueError, match=r"angles must be numbers of outputs, 0 to 1, got \[2\]"):
        simulated(angles=(2,))(WEST, **GIVEN)


def test_an_exact_gramian_does_not_mind_an_angle_that_wraps():
    def wrapped(t, x, u, p):
        heading = ca.atan2(ca.sin(x[2]), ca.cos(x[2]))
        return ca.vertcat(heading, range_to(t, x, u, p)[1])

    gramian = exact_gramian(unicycle, wrapped, n=3, m=1, q=2, steps=20)
    np.testing.assert_allclose(gramian(WEST, **GIVEN), COARSE(WEST, **GIVEN), rtol=1e-12)


def test_a_model_in_numpy_given_to_an_exact_gramian_is_told_where_to_go():
    with pytest.raises(ValueError, match=r"f must return a CasADi expression .*SimulatedGramian"):
        exact_gramian(lambda x, u: [x[1], u[0], 0.0], range_to, n=3, m=1, q=2, steps=20)


@pytest.mark.parametrize("model", [lambda x: x, lambda t, x, u=None, p=None: x])
def test_a_model_of_other_arguments_is_refused(model):
    with pytest.raises(ValueError, match=r"h must take \(t, x, u, p\), or \(x, u\)"):
        exact_gramian(unicycle, model, n=3, m=1, steps=20)
    with pytest.raises(ValueError, match=r"h must take \(t, x, u, p\), or \(x, u\)"):
        simulated(model)


# --- the choice ---


@pytest.mark.parametrize("metric", ["condition-number", "log-det"])
@pytest.mark.parametrize(
    ("gramian", "distance"), [(COARSE, 3.0), (COARSE, 300.0), (simulated(steps=4), 30.0)]
)
def test_of_mirror_images_the_first_is_taken_however_the_world_is_turned(gramian, distance, metric):
    given = {"horizon": HORIZON, "p": [0.0, 0.0], "metric": metric}
    for angle in np.linspace(0.0, 6.2, 9):
        away = [distance * np.cos(angle), distance * np.sin(angle), angle]
        choices = [
            choose_input(gramian, away, rates, **given).x[0] for rates in ([0.7, -0.7], [-0.7, 0.7])
        ]
        assert choices == [0.7, -0.7]


def test_inputs_in_turn_are_held_for_equal_parts_of_the_horizon():
    sequences = np.array([[[1.5], [-1.5]], [[0.2], [0.9]]])
    pose, auv = [1.0, 0.5, 0.4], [0.0, 0.0]
    choice = choose_input(COARSE, pose, sequences, horizon=HORIZON, p=auv)
    conditions = [
        np.linalg.cond(COARSE(pose, np.repeat(u, 10, axis=0), horizon=HORIZON, p=auv))
        for u in sequences
    ]
    np.testing.assert_array_equal(choice.x, sequences[np.argmin(conditions)])
    assert choice.objective == pytest.approx(min(conditions), rel=1e-10)


def test_lists_are_as_good_as_arrays():
    given = {"horizon": HORIZON, "weights": [1.0, 2.0], "R": [[0.01, 0.0], [0.0, 0.25]]}
    pose, auvs = [1.0, 0.5, 0.4], [[0.0, 0.0], [3.0, 1.0]]
    of_lists = choose_input(COARSE, pose, RATES.tolist(), p=auvs, **given)
    of_arrays = choose_input(COARSE, np.array(pose), RATES[:, None], p=np.array(auvs), **given)
    assert of_lists.objective == of_arrays.objective
    np.testing.assert_array_equal(of_lists.x, of_arrays.x)


def test_a_case_of_weight_0_has_no_say():
    pose, auvs = [1.0, 0.5, 0.4], [[0.0, 0.0], [1e200, 0.0]]
    alone = choose_input(COARSE, pose, RATES, horizon=HORIZON, p=auvs[0])
    lost = choose_input(COARSE, pose, RATES, horizon=HORIZON, p=auvs)
    beside = choose_input(COARSE, pose, RATES, horizon=HORIZON, p=auvs, weights=[2.0, 0.0])
    assert beside.objective == alone.objective
    assert lost.status is Status.UNOBSERVABLE


def test_where_nothing_can_be_chosen_the_status_says_why():
    blind = exact_gramian(unicycle, lambda x, u: x[2], n=3, m=1, steps=20)
    choice = choose_input(blind, [1.0, 0.0, 0.0], RATES, horizon=HORIZON)
    assert choice.status is Status.UNOBSERVABLE
    assert "measure more" in choice.advice
    assert np.isnan(choice.x).all()
    choice = choose_input(COARSE, [np.nan, 0.0, 0.0], RATES, horizon=HORIZON, p=[0.0, 0.0])
    assert choice.status is Status.INVALID_INPUT
    assert "not finite" in choice.advice


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"candidates": []}, r"candidates must be finite.* got shape \(0,\)"),
        ({"candidates": [np.nan]}, "candidates must be finite"),
        ({"candidates": np.ones((2, 3, 1))}, "3 inputs in turn must divide the 20 steps"),
        ({"candidates": [[1.0, 2.0]]}, "u must have shape"),
        ({"weights": [1.0]}, "weights must be 2 finite numbers"),
        ({"weights": [-1.0, 2.0]}, "weights must be 2 finite numbers"),
        ({"weights": [0.0, 0.0]}, "not all 0"),
        ({"metric": "beauty"}, "metric 'beauty' is not known"),
        ({"horizon": 0.0}, "horizon must be positive"),
    ],
)
def test_what_does_not_fit_is_refused(changes, message):
    options = {"candidates": RATES, "horizon": HORIZON, "p": [[0.0, 0.0], [1.0, 1.0]]} | changes
    with pytest.raises(ValueError, match=message):
        choose_input(COARSE, [1.0, 0.5, 0.4], options.pop("candidates"), **options)
