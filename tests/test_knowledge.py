"""What a planner is told of the AUVs: the estimate as reported, with or without the survey's turns, the survey, the truth."""

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest
from oracles import NumpyEkf, Spy, scenario

import obsplan as op
from formulations.solution import Status
from obsplan.planning.expressions import Command

CURRENT = (0.4, -0.3)


def spied(knowledge, **change):
    """A run, and what its planner was told at each decision."""
    mission = scenario(
        planner={"kind": "path-inertia", "interval": 0.5, "knowledge": knowledge},
        environment__current=CURRENT,
        **change,
    )
    spy = Spy(mission.planner())
    run = op.simulate(mission, planner=spy)
    assert [time for time, *_ in spy.said] == run.time[:-1].tolist()
    return run, [auvs for _, _, auvs, _ in spy.said]


AHEAD = np.array([0.0, 1.0, 9.0])


def last_report(run, i, k):
    """What an AUV reported at its last ping, dead-reckoned to sample k by the filter in plain numpy."""
    Q = 0.5 * np.diag([0.05, 0.05, np.deg2rad(0.5), 0.02]) ** 2
    ping = k - k % 4
    reckoning = NumpyEkf(run.mean[i, ping], run.covariance[i, ping], Q, 0.5, CURRENT)
    for _ in range(k - ping):
        reckoning.predict(0.0, 0.0)
    return reckoning


def test_estimate_is_the_last_report_dead_reckoned_since():
    run, told = spied("estimate", auv__1__weight=3.0)
    for k, auvs in enumerate(told):
        for i, auv in enumerate(auvs):
            np.testing.assert_allclose(auv.mean, last_report(run, i, k).x, atol=1e-12)
            _, _, heading, speed = auv.mean
            velocity = speed * np.array([np.cos(heading), np.sin(heading)]) + CURRENT
            np.testing.assert_allclose(
                auv.ahead(AHEAD), auv.mean[:2] + AHEAD[:, None] * velocity, atol=1e-12
            )
            assert auv.process_noise == pytest.approx((0.05, np.deg2rad(0.5), 0.02))
            assert auv.weight == (1.0, 3.0)[i]
            assert auv.current == CURRENT


def test_estimate_and_survey_is_the_last_report_dead_reckoned_with_the_turns_filed():
    run, told = spied("estimate-and-survey")
    straight = 0.0
    for k, auvs in enumerate(told):
        for i, (auv, reference) in enumerate(zip(auvs, run.scenario.references, strict=True)):
            ping = k - k % 4
            x, y, heading, speed = run.mean[i, ping]
            for step in range(ping, k):
                x, y = (
                    x + 0.5 * (speed * math.cos(heading) + CURRENT[0]),
                    y + 0.5 * (speed * math.sin(heading) + CURRENT[1]),
                )
                water = (
                    np.diff(reference.position(run.time[step] + np.array([0.5, 1.0])), axis=0)[0]
                    / 0.5
                    - CURRENT
                )
                heading, speed = math.atan2(*water[::-1]), math.hypot(*water)
            np.testing.assert_allclose(auv.mean[:2], [x, y], atol=1e-9)
            straight = max(straight, math.dist(auv.mean[:2], last_report(run, i, k).x[:2]))
            ahead = reference.position(run.time[k] + AHEAD)
            np.testing.assert_allclose(
                auv.ahead(AHEAD), auv.mean[:2] + ahead - ahead[0], atol=1e-12
            )
    assert straight > 0.5  # by which dead reckoning straight on misses a turn filed


@pytest.mark.parametrize("knowledge", ["estimate", "survey", "truth"])
def test_whatever_is_known_the_uncertainty_told_is_that_reported(knowledge):
    run, told = spied(knowledge)
    for k, auvs in enumerate(told):
        for i, auv in enumerate(auvs):
            np.testing.assert_allclose(auv.covariance, last_report(run, i, k).P, atol=1e-12)


def test_survey_is_the_plan_filed_before_the_dive():
    run, told = spied("survey")
    for k, auvs in enumerate(told):
        for auv, reference in zip(auvs, run.scenario.references, strict=True):
            np.testing.assert_allclose(
                auv.ahead(AHEAD), reference.position(run.time[k] + AHEAD), atol=1e-12
            )
            np.testing.assert_allclose(auv.mean[:2], auv.ahead(AHEAD)[0], atol=1e-12)
    assert not np.allclose(
        told[-1][0].mean[:2], run.truth[0, -2, :2], atol=1e-3
    )  # which process noise has left


def test_truth_is_the_truth_now_and_the_rest_of_the_survey_from_there():
    run, told = spied("truth")
    for k, auvs in enumerate(told):
        for auv, reference, truth in zip(auvs, run.scenario.references, run.truth, strict=True):
            np.testing.assert_array_equal(auv.mean, truth[k])
            np.testing.assert_allclose(auv.ahead(AHEAD)[0], truth[k, :2], atol=1e-12)
            ahead = reference.position(run.time[k] + AHEAD)
            np.testing.assert_allclose(
                np.diff(auv.ahead(AHEAD), axis=0), np.diff(ahead, axis=0), atol=1e-12
            )


@dataclass(frozen=True)
class Echo:
    """A user's planner that is an expression: its figures are three things it was told, so that a run records them."""

    first: int

    def plan(self, pose, auvs, *, time=0.0):
        told = [time, pose.x, pose.y, pose.heading, pose.turn_rate]
        for auv in auvs:
            told += [
                *auv.mean,
                *auv.current,
                auv.covariance[0, 0],
                auv.covariance[0, 1],
                auv.covariance[1, 1],
                auv.weight,
            ]
        path = np.array([[pose.x, pose.y, pose.heading]])
        return op.Decision(
            turn_rate=0.1,
            speed=1.0,
            predict=lambda: path,
            score=float(told[self.first]),
            status=Status.OPTIMAL,
            condition=np.array(told[self.first + 1 : self.first + 3]),
        )

    def expression(self, time, pose, targets):
        auvs = ca.vertcat(
            targets.mean, targets.current, targets.position_covariance, targets.weight.T
        )
        told = ca.vertcat(time, pose, ca.vec(auvs))
        return Command(
            turn_rate=ca.SX(0.1),
            speed=ca.SX(1.0),
            score=told[self.first],
            condition=told[self.first + 1 : self.first + 3].T,
            status=ca.SX(float(Status.OPTIMAL)),
        )


@pytest.mark.slow
@pytest.mark.parametrize("knowledge", ["estimate", "estimate-and-survey", "survey", "truth"])
def test_planner_inside_the_step_is_told_what_one_outside_is(knowledge):
    mission = scenario(
        planner__knowledge=knowledge, environment__current=CURRENT, auv__1__weight=3.0, duration=5.0
    )
    for first in (*range(0, 22, 3), 22):  # of 25 things
        inside = op.simulate(mission, planner=Echo(first))
        outside = op.simulate(mission, planner=Spy(Echo(first)))
        assert inside.timing.decision_seconds == []
        np.testing.assert_array_equal(inside.condition, outside.condition)
        np.testing.assert_array_equal(inside.score, outside.score)


def test_planner_that_knows_less_does_not_do_the_same():
    runs = {
        knowledge: op.simulate(scenario(planner__knowledge=knowledge))
        for knowledge in ("truth", "survey", "estimate-and-survey", "estimate")
    }
    assert len({run.cna.tobytes() for run in runs.values()}) == 4
