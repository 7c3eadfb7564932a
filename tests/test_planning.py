"""What a planner is told and may offer, what is refused in place of one, and what a call costs."""

import math
import subprocess
import sys

import numpy as np
import pytest
from oracles import Spy, scenario

import obsplan as op
from formulations.model.ranging import Ranging
from obsplan.constraints import Constraints, Disc
from obsplan.planners import PLANNERS, planner_class
from obsplan.planning.interface import CAPABILITIES, check_planner
from obsplan.simulation.loop import ClosedLoop

CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)


class Straight:
    """A user's planner."""

    def plan(self, pose, auvs, *, time=0.0):
        return op.Decision(turn_rate=0.0, speed=2.0)


def with_attribute(name):
    planner = Straight()
    setattr(planner, name, None)
    return planner


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("inital_pose", "initial_pose"),
        ("for_misson", "for_mission"),
        ("prepair", "prepare"),
        ("constrains", "constraints"),
        ("expresion", "expression"),
        ("comands", "commands"),
        ("situtation", "situation"),
        ("condition_lable", "condition_label"),
    ],
)
def test_misspelt_capability_is_refused_with_the_name_that_was_meant(name, meant):
    assert meant in CAPABILITIES
    with pytest.raises(op.ObsplanError, match=rf'Straight has "{name}": did you mean "{meant}"\?'):
        op.simulate(scenario(), planner=with_attribute(name))


@pytest.mark.parametrize("name", ["initial_speed", "mission", "preparation", "gain", "limits"])
def test_name_of_ones_own_is_no_misspelling(name):
    check_planner(with_attribute(name))


def test_class_in_place_of_a_planner_is_refused():
    with pytest.raises(op.ObsplanError, match=r"Straight is a class: give Straight\(\.\.\.\)"):
        op.simulate(scenario(), planner=Straight)


def test_object_without_plan_is_refused():
    with pytest.raises(op.ObsplanError, match=r"must have a method plan\(.*\), and dict has none"):
        check_planner({"kind": "circle"})


def test_plan_without_time_is_refused_before_the_mission():
    class Timeless:
        def plan(self, pose, auvs):
            raise AssertionError("it is not called")

    with pytest.raises(op.ObsplanError, match=r"Timeless has plan\(pose, auvs\): give it these"):
        op.simulate(scenario(), planner=Timeless())


def test_scenario_tells_each_planner_all_of_the_situation_once():
    mission = scenario(
        time_step=0.5,
        ranging={"interval": 3.0, "kind": "squared-range", "sigma": 4.0, "heading_sigma_deg": 2.0},
        planner={"kind": "gramian", "interval": 1.5},
        constraints={"min_separation": 7.0},
    )
    known = mission.planner().situation
    assert known is mission.situation
    assert (known.cna, known.ranging) == (mission.cna, Ranging(4.0, squared=True))
    assert (known.ping_interval, known.decision_interval) == (3.0, 1.5)  # not the time step
    assert known.heading_sigma == pytest.approx(math.radians(2.0))
    assert known.constraints == Constraints(min_separation=7.0)
    assert known.filed.time_step == 0.5


def test_situations_alike_are_one_key_and_others_are_not():
    situation = op.Situation(CNA, ping_interval=3.0)
    alike = op.Situation(op.Unicycle(speed=2.0, min_turn_radius=5.0), ping_interval=3.0)
    assert (situation, hash(situation)) == (alike, hash(alike))
    for other in (
        op.Situation(CNA, ping_interval=4.0),
        op.Situation(CNA, ping_interval=3.0, survey_circle=Disc(x=0.0, y=0.0, radius=9.0)),
        op.Situation(CNA, ping_interval=3.0, ranging=Ranging(2.0)),
    ):
        assert situation != other


def test_predicted_path_is_made_only_when_asked_for():
    asked = []

    def predict():
        asked.append("path")
        return np.zeros((1, 3))

    class Predicting:
        def plan(self, pose, auvs, *, time=0.0):
            return op.Decision(turn_rate=0.0, speed=2.0, predict=predict)

    flight = ClosedLoop(scenario=scenario(), planner=Predicting())
    flight.fly(1)  # as campaigns do
    assert not asked
    decisions = np.isfinite(flight.fly(1, paths=True).status).sum()  # as `simulate` does
    assert asked == ["path"] * decisions
    asked.clear()
    decision = Predicting().plan(op.Pose(0.0, 0.0, 0.0), [])
    assert decision.path.shape == (1, 3)
    assert asked == ["path"]


def test_planner_called_from_two_threads_answers_each_as_if_alone():
    from concurrent.futures import ThreadPoolExecutor

    planner = op.PathInertia(op.Situation(CNA), gamma=0.1)
    auvs = [[op.Belief.at(float(k), 3.0)] for k in range(40)]
    pose = op.Pose(30.0, 0.0, 1.0)
    alone = [planner.plan(pose, auv) for auv in auvs]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda auv: planner.plan(pose, auv), auvs * 25))
    turns = [decision.turn_rate for decision in alone]
    assert [decision.turn_rate for decision in together] == turns * 25
    assert len(set(turns)) > 10


def test_vehicle_in_place_of_a_situation_is_refused_with_what_to_give():
    """In a process of its own: here, types are checked before that."""
    code = """
import obsplan as op
from obsplan.planners import PLANNERS, planner_class
for name in PLANNERS:
    if name != "stationary":
        try:
            planner_class(name)(op.Unicycle(speed=2.0, min_turn_radius=5.0))
        except TypeError as error:
            print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    needs = "needs a situation, obsplan.Situation(cna), got Unicycle"
    classes = [planner_class(name).__name__ for name in PLANNERS if name != "stationary"]
    assert done.stdout.splitlines() == [f"{cls} {needs}" for cls in classes]


@pytest.mark.parametrize("commands", [None, np.zeros((39, 2)), np.full((40, 2), np.nan)])
def test_commands_that_are_not_one_for_each_step_are_refused(commands):
    class Fixed(Straight):
        @property
        def commands(self):
            return commands

    words = r"commands of Fixed must be finite, .* for each of the 40 time steps"
    with pytest.raises(op.ObsplanError, match=words):
        op.simulate(scenario(), planner=Fixed())


def test_decision_keeps_its_condition_numbers_when_the_planner_is_asked_again():
    planner, pose = op.PathInertia(op.Situation(CNA)), op.Pose(30.0, 0.0, 1.0)
    first = planner.plan(pose, [op.Belief.at(0.0, 3.0)])
    before = first.condition.copy()
    planner.plan(pose, [op.Belief.at(20.0, -7.0)])
    np.testing.assert_array_equal(first.condition, before)


def test_filed_beliefs_are_those_of_the_first_decision_from_the_survey():
    noise = {"position": 0.05, "heading_deg": 0.5, "speed": 0.02}
    mission = scenario(planner__knowledge="survey", auv__1__weight=2.0, auv__0__process_noise=noise)
    spy = Spy(Straight())
    op.simulate(mission, planner=spy)
    _, _, told, _ = spy.said[0]
    for filed, believed in zip(mission.situation.filed.beliefs, told, strict=True):
        np.testing.assert_array_equal(filed.mean, believed.mean)
        np.testing.assert_allclose(filed.covariance, believed.covariance, rtol=1e-12)
        assert (filed.process_noise, filed.weight) == (believed.process_noise, believed.weight)
