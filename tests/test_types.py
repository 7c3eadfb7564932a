import numpy as np
import pytest

import obsplan as op
from formulations.solution import Status


def decision(turn_rate, speed):
    return op.Decision(
        turn_rate=turn_rate,
        speed=speed,
        predict=lambda: np.zeros((1, 3)),
        score=0.0,
        status=Status.OPTIMAL,
    )


def test_belief_at_a_place_is_certain_of_it_unless_told_otherwise():
    belief = op.Belief.at(1.0, 2.0, heading=0.5, speed=3.0)
    np.testing.assert_array_equal(belief.mean, [1.0, 2.0, 0.5, 3.0])
    np.testing.assert_array_equal(belief.covariance, np.zeros((4, 4)))
    assert belief.weight == 1.0
    np.testing.assert_array_equal(
        op.Belief.at(0.0, 0.0, covariance=np.eye(4)).covariance, np.eye(4)
    )


def test_belief_predicts_a_straight_line_carried_by_the_current():
    belief = op.Belief(
        mean=np.array([1.0, 2.0, np.pi / 6, 2.0]), covariance=np.zeros((4, 4)), current=(0.1, -0.2)
    )
    ahead = belief.ahead(np.array([0.0, 10.0]))
    np.testing.assert_allclose(
        ahead, [[1.0, 2.0], [1.0 + 10 * (np.sqrt(3) + 0.1), 2.0 + 10 * (1.0 - 0.2)]], rtol=1e-14
    )


def test_belief_predicts_along_its_course_where_it_is_known():
    belief = op.Belief(
        mean=np.zeros(4),
        covariance=np.zeros((4, 4)),
        route=lambda t: np.stack([t**2, -t], axis=-1),
    )
    np.testing.assert_array_equal(belief.ahead(np.array([0.0, 3.0])), [[0.0, 0.0], [9.0, -3.0]])


@pytest.mark.parametrize("weight", [-1.0, float("nan")])
def test_weight_of_an_auv_is_at_least_zero(weight):
    with pytest.raises(ValueError, match=r"weight of an AUV must be at least 0, got (-1\.0|nan)"):
        op.Belief.at(0.0, 0.0, weight=weight)


def test_radius_is_signed_as_the_turn_and_infinite_when_straight_or_stopped():
    assert decision(0.5, 2.0).radius == 4.0
    assert decision(-0.5, 2.0).radius == -4.0
    assert (
        decision(0.0, 2.0).radius
        == decision(0.0, 0.0).radius
        == decision(1.0, 0.0).radius
        == float("inf")
    )


def test_what_passes_to_a_planner_cannot_be_changed_by_it():
    for thing in (op.Pose(0.0, 0.0, 0.0), op.Belief.at(0.0, 0.0), decision(0.0, 1.0)):
        with pytest.raises(AttributeError):
            setattr(thing, type(thing).__slots__[0], None)


def test_public_names_load_and_others_are_refused_by_name():
    for name in op.__all__:
        assert getattr(op, name) is not None
    with pytest.raises(AttributeError, match="no public name 'Nonsense'"):
        _ = op.Nonsense
