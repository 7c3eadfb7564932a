"""Whatever a planner raises or returns, the mission is flown to its end within what the vehicle can do, and a status blames the planner."""

import logging
from contextlib import suppress
from dataclasses import dataclass

import casadi as ca
import numpy as np
import pytest

import obsplan as op
from formulations.solution import Status
from obsplan.planning.answers import fitted
from obsplan.planning.expressions import Command
from obsplan.planning.expressions import fitted as fitted_expression
from obsplan.planning.interface import check_planner
from obsplan.planning.team import Team
from obsplan.report import planner_notes
from obsplan.simulation import ClosedLoop

SPEED, RADIUS = 1.0, 0.5  # of the vehicle in fixed-auv [m/s], [m]
MISSION = op.load("fixed-auv", settings=["duration=4.0", "planner.interval=0.5"])
IN_THE_WAY = {"x": 0.5, "y": 0.6, "radius": 0.25}  # of a circle to the left
UNDER_LIMITS = MISSION.replace(constraints={"keep_out": [IN_THE_WAY]})
DECISIONS = 8
ONE_AUV = np.ones(1)


@dataclass
class Faulty:
    """A user's planner that does one thing wrong."""

    answer: object  # called with pose, AUVs and time

    def plan(self, pose, auvs, *, time=0.0):
        return self.answer(pose, auvs, time)


def returning(value):
    return Faulty(lambda *_: value)


def deciding(**wrong):
    """Return a sound decision but for what is given, which no check of types is to see."""
    decision = op.Decision(turn_rate=0.1, speed=1.0, condition=ONE_AUV)
    for name, value in wrong.items():
        object.__setattr__(decision, name, value)
    return returning(decision)


def raising(error):
    def answer(*_):
        raise error

    return Faulty(answer)


class SpeechlessError(Exception):
    def __str__(self):
        raise ValueError


class Torn(op.Decision):
    def __getattribute__(self, name):
        raise KeyError(name)


class Unfit:
    """A number that is none when it is asked for."""

    def __float__(self):
        raise OSError


def endless(pose, auvs, time):
    return endless(pose, auvs, time)


def into_casadi(*_):
    return ca.DM.zeros(2) + ca.DM.zeros(3)


def move_mean(_pose, auvs, _time):
    auvs[0].mean[:2] = 1e3
    return op.Decision(turn_rate=0.1, speed=1.0)


def trust_covariance(_pose, auvs, _time):
    auvs[0].covariance[:] = 0.0
    return op.Decision(turn_rate=0.1, speed=1.0)


RAISED = {
    "arithmetic": raising(ZeroDivisionError("division by zero")),
    "memory": raising(MemoryError()),
    "recursion": Faulty(endless),
    "exit": raising(SystemExit(3)),
    "stop": raising(StopIteration()),
    "system": raising(OSError(28, "No space left on device")),
    "algebra": raising(np.linalg.LinAlgError("Singular matrix")),
    "warning": raising(RuntimeWarning("overflow encountered")),
    "ours": raising(op.ObsplanError("no such file")),
    "speechless": raising(SpeechlessError()),
    "control characters": raising(ValueError("\x1b[31mred\r\n\tnext line\0")),
    "long": raising(ValueError("x" * 100_000)),
    "casadi": Faulty(into_casadi),
    "writes to a mean": Faulty(move_mean),
    "writes to a covariance": Faulty(trust_covariance),
    "no such attribute": Faulty(lambda pose, *_: pose.z),
    "unpacks": Faulty(lambda pose, auvs, time: auvs[7]),
}
NO_DECISION = {
    "nothing": returning(None),
    "pair": returning((0.1, 1.0)),
    "number": returning(0.1),
    "text": returning("left"),
    "class": returning(op.Decision),
    "array": returning(np.zeros(2)),
    "pose": returning(op.Pose(0.0, 0.0, 0.0)),
    "half-made": returning(object.__new__(op.Decision)),
    "torn": Faulty(lambda *_: Torn(turn_rate=0.1, speed=1.0)),
}
NO_NUMBER = {
    "none": None,
    "nan": np.nan,
    "inf": np.inf,
    "-inf": -np.inf,
    "text": "0.1",
    "list": [0.1],
    "array": np.array([0.1, 0.2]),
    "complex": 0.1 + 0.2j,
    "truth": True,
    "huge": 10**400,
    "unfit": Unfit(),
    "symbol": ca.SX.sym("x"),
}
NO_COMMAND = {
    **{f"turn {name}": deciding(turn_rate=value) for name, value in NO_NUMBER.items()},
    **{f"speed {name}": deciding(speed=value) for name, value in NO_NUMBER.items()},
    "backwards": deciding(speed=-1.0),
}
NO_FIGURE = {
    **{f"status {value}": deciding(status=value) for value in (99, -1, 0, None, "optimal", 0.5)},
    "status array": deciding(status=np.zeros(2)),
    **{
        f"score {name}": deciding(score=NO_NUMBER[name])
        for name in ("none", "text", "list", "array", "complex", "huge", "unfit")
    },
    "condition of three": deciding(condition=np.ones(3)),
    "condition of two axes": deciding(condition=np.ones((1, 1))),
    "condition of none": deciding(condition=np.array(1.0)),
    "condition list": deciding(condition=[1.0]),
    "condition None": deciding(condition=None),
    "condition text": deciding(condition=np.array(["a"])),
    "condition object": deciding(condition=np.array([None])),
    "condition complex": deciding(condition=np.array([1j])),
    "predict None": deciding(predict=None),
}
TOO_FAST = {
    "thousand": deciding(speed=1000.0),
    "overflow": deciding(speed=1e308),
    "integer": deciding(speed=2),
    "and turning": deciding(speed=2.0, turn_rate=-99.0),
}
STATUSES = {
    "planner-failed": RAISED,
    "invalid-decision": NO_DECISION | NO_COMMAND | NO_FIGURE,
    "too-fast": TOO_FAST,
}
CASES = [
    pytest.param(planner, status, id=f"{status}: {name}")
    for status, planners in STATUSES.items()
    for name, planner in planners.items()
]
HEALTHY = op.simulate(MISSION, planner=deciding())


def assert_flown_within_what_the_vehicle_can_do(run):
    assert np.isfinite(run.cna).all()
    assert run.time[-1] == 4.0
    assert (run.speed <= SPEED).all()
    assert (np.abs(run.turn_rate) <= run.speed / RADIUS * (1 + 1e-9)).all()
    np.testing.assert_array_equal(run.truth, HEALTHY.truth)


def test_there_are_more_kinds_than_were_tried_by_hand():
    assert len(CASES) >= 59
    assert HEALTHY.status_counts == {"optimal": DECISIONS}
    assert not HEALTHY.faults


@pytest.mark.parametrize(("planner", "status"), CASES)
def test_faulty_planner_is_flown_to_the_end_and_blamed(planner, status, caplog):
    with caplog.at_level(logging.WARNING, "obsplan"):
        run = op.simulate(MISSION, planner=planner)
    assert run.status_counts == {status: DECISIONS}
    assert_flown_within_what_the_vehicle_can_do(run)
    (fault,) = run.faults.values()
    assert fault.startswith("first after 0 s: ")
    assert fault.isprintable()
    assert len(fault) < 300
    assert caplog.messages == [f"Faulty: {status}, {fault}"]
    note, nothing_own = planner_notes(run)
    assert note.startswith(f"Faulty: 8 of 8 decisions {status}: ")
    assert note.endswith(f"First{fault[5:]}.")
    assert nothing_own.startswith("Not one of its 8 decisions is what Faulty was asked for")


@pytest.mark.parametrize("planner", [RAISED["arithmetic"], NO_DECISION["nothing"]])
def test_where_no_command_is_had_the_vehicle_circles(planner):
    run = op.simulate(MISSION, planner=planner)
    np.testing.assert_array_equal(run.turn_rate, SPEED / RADIUS)
    np.testing.assert_array_equal(run.speed, SPEED)


@pytest.mark.parametrize("planner", NO_FIGURE.values(), ids=NO_FIGURE)
def test_a_command_is_flown_though_a_figure_beside_it_is_wrong(planner):
    run = op.simulate(MISSION, planner=planner)
    np.testing.assert_array_equal(run.turn_rate, 0.1)
    assert np.isnan(run.condition).all()


@pytest.mark.parametrize(("turn_rate", "held"), [(0.4, 0.4), (-0.4, -0.4), (0.1, 2.0), (0.0, 2.0)])
def test_a_single_failure_holds_the_turn_unless_it_leads_away(turn_rate, held):
    def answer(_pose, _auvs, time):
        return op.Decision(turn_rate=turn_rate, speed=1.0) if time != 2.0 else 1 / 0

    run = op.simulate(MISSION, planner=Faulty(answer))
    assert run.status_counts == {"optimal": DECISIONS - 1, "planner-failed": 1}
    np.testing.assert_array_equal(run.turn_rate[(run.time >= 2.0) & (run.time < 2.5)], held)
    (fault,) = run.faults.values()
    assert fault == (
        "first after 2 s: ZeroDivisionError: division by zero "
        f"(test_faulty_planners.py, line {answer.__code__.co_firstlineno + 1})"
    )


def test_each_kind_of_fault_is_told_once_with_the_first_of_its_kind():
    answers = iter(["a", "b", None, op.Decision(turn_rate=0.0, speed=9.0)] * 2)
    run = op.simulate(MISSION, planner=Faulty(lambda *_: next(answers)))
    assert run.status_counts == {"invalid-decision": 6, "too-fast": 2}
    assert run.faults["invalid-decision"].endswith("and returned str")
    assert run.faults["too-fast"].startswith("first after 1.5 s: speed is 9 m/s")
    assert run.summary(bounds=False)["faults"] == run.faults


@pytest.mark.parametrize("knowledge", ["truth", "survey", "estimate"])
def test_nothing_that_a_planner_is_given_moves_truth_or_filter(knowledge):
    mission = MISSION.replace(planner__knowledge=knowledge)
    kept = []

    def answer(_pose, auvs, _time):
        for auv in (*auvs, *kept):
            for array in (auv.mean, auv.covariance):
                with pytest.raises(ValueError, match="read-only"):
                    array[:] = 1e3
                with suppress(ValueError):  # of numpy, which allows it of some views
                    array.setflags(write=True)
                    array[:] = 1e3
                array.setflags(write=False)
        kept.extend(auvs)
        auvs.clear()
        return op.Decision(turn_rate=0.1, speed=1.0, condition=ONE_AUV)

    run = op.simulate(mission, planner=Faulty(answer))
    assert run.status_counts == {"optimal": DECISIONS}
    for name in ("truth", "mean", "covariance", "time"):
        np.testing.assert_array_equal(getattr(run, name), getattr(HEALTHY, name))
    filed = mission.situation.filed
    for name in ("time", "position", "heading", "speed", "covariance", "process_noise", "weights"):
        assert not getattr(filed, name).flags.writeable


def test_a_substitute_keeps_the_limits_and_still_blames_the_planner():
    class Claims(Faulty):
        constraints = UNDER_LIMITS.constraints  # which it does not keep

    for planner in (raising(ValueError()), Claims(raising(ValueError()).answer)):
        run = op.simulate(UNDER_LIMITS, planner=planner)
        assert run.status_counts == {"planner-failed": DECISIONS}
        assert (run.violation <= 0).all()
        assert (run.turn_rate < SPEED / RADIUS).any()


def test_a_planner_that_fails_over_a_lost_filter_is_not_blamed():
    def answer(_pose, auvs, _time):
        return op.Decision(turn_rate=float(auvs[0].mean[0]), speed=1.0)

    loop = ClosedLoop(scenario=MISSION, planner=Faulty(answer))
    lost = op.Belief(mean=np.full(4, np.nan), covariance=np.eye(4))
    pose = op.Pose(0.0, 0.0, 0.0)
    team = Team((loop.planner,))
    decision, fault = loop._ask(0, (), poses=[pose], auvs=[lost], team=team, time=0.0, free=[True])
    assert (decision.status.label, decision.turn_rate) == ("invalid-input", 0.0)
    assert "turn_rate" in fault


# --- planners that are one expression, or have fixed every command ------------------------------


@dataclass(frozen=True)
class Expressed:
    """A user's planner that is one expression, and wrong in one of its parts."""

    part: str
    value: object

    def plan(self, pose, auvs, *, time=0.0):
        raise AssertionError("it is folded")

    def expression(self, time, pose, targets):
        auvs = targets.mean.shape[1]
        right = Command(ca.SX(0.1), ca.SX(1.0), ca.SX(0.0), ca.SX.ones(auvs), ca.SX(0.0))
        return right._replace(**{self.part: ca.SX(self.value)})


@pytest.mark.parametrize(
    ("part", "value", "status"),
    [
        ("turn_rate", np.nan, "invalid-decision"),
        ("turn_rate", np.inf, "invalid-decision"),
        ("turn_rate", 99.0, "clipped"),
        ("speed", np.nan, "invalid-decision"),
        ("speed", -1.0, "invalid-decision"),
        ("speed", np.inf, "invalid-decision"),
        ("speed", 1000.0, "too-fast"),
        ("speed", 1e308, "too-fast"),
        ("status", 99.0, "invalid-decision"),
        ("status", 0.5, "invalid-decision"),
        ("status", -1.0, "invalid-decision"),
        ("status", np.nan, "invalid-decision"),
        ("status", np.inf, "invalid-decision"),
    ],
)
def test_faulty_expression_is_flown_within_what_the_vehicle_can_do_and_blamed(part, value, status):
    run = op.simulate(MISSION, planner=Expressed(part, value))
    assert run.status_counts == {status: DECISIONS}
    assert_flown_within_what_the_vehicle_can_do(run)


@pytest.mark.parametrize("status", [Status.VIOLATED, Status.INFEASIBLE, Status.TOO_FAST])
def test_a_turn_that_is_clipped_hides_nothing_that_the_planner_says(status):
    cna = HEALTHY.scenario.cna
    called = fitted(op.Decision(turn_rate=9.0, speed=1.0, status=status), cna, n_auvs=1)
    assert called.decision.status == status
    folded = Command(*map(ca.DM, (9.0, 1.0, 0.0, 1.0, float(status))))
    assert float(fitted_expression(folded, cna).status) == status


@pytest.mark.parametrize(
    ("command", "status", "flown"),
    [((0.0, 9.0), "too-fast", (0.0, 1.0)), ((-3.0, 0.5), "clipped", (-1.0, 0.5))],
)
def test_commands_fixed_beforehand_are_flown_no_faster_and_no_tighter(command, status, flown):
    class Fixed(Faulty):
        commands = np.array([[0.1, 1.0], command] * (HEALTHY.time.size // 2))

    run = op.simulate(MISSION, planner=Fixed(None))
    assert run.status_counts == {status: HEALTHY.time.size // 2}
    np.testing.assert_allclose([run.turn_rate[1], run.speed[1]], flown)
    assert_flown_within_what_the_vehicle_can_do(run)


# --- before the mission -------------------------------------------------------------------------


def with_capability(name, value):
    """A planner whose capability is a value, or raises it."""

    def capability(*_):
        if isinstance(value, Exception):
            raise value
        return value

    return type("Offers", (Faulty,), {name: capability})(deciding().answer)


def with_property(name, value):
    whole = with_capability(name, value)
    return type("Offers", (Faulty,), {name: property(getattr(type(whole), name))})(whole.answer)


ERROR = RuntimeError("no licence")
NOT_A_NUMBER = op.Pose(np.nan, 0.0, 0.0)
BEFORE = {
    "prepare": (with_capability("prepare", ERROR), "RuntimeError: no licence"),
    "memory": (with_capability("prepare", MemoryError()), "MemoryError"),
    "start": (with_capability("initial_pose", ERROR), "RuntimeError: no licence"),
    "no start": (with_capability("initial_pose", None), "returned NoneType"),
    "start nowhere": (with_capability("initial_pose", NOT_A_NUMBER), "finite numbers"),
    "draws": (with_capability("for_mission", ERROR), "RuntimeError: no licence"),
    "draws nothing": (with_capability("for_mission", None), "NoneType has none"),
    "commands": (with_property("commands", ERROR), "RuntimeError: no licence"),
    "text commands": (with_property("commands", "left"), "Offers"),
    "limits": (with_property("constraints", ERROR), "RuntimeError: no licence"),
    "label": (with_property("condition_label", ERROR), "RuntimeError: no licence"),
    "label number": (with_property("condition_label", 3), "must be text"),
    "expression": (with_capability("expression", ERROR), "RuntimeError: no licence"),
    "no expression": (with_capability("expression", None), "Offers"),
    "sizes": (Expressed("condition", [1.0, 2.0]), "condition of a Command must have 1"),
    "free symbol": (Expressed("turn_rate", ca.SX.sym("x")), "build its expression"),
}


@pytest.mark.parametrize(("planner", "words"), BEFORE.values(), ids=BEFORE)
def test_failure_before_the_mission_is_a_sentence_that_names_the_planner(planner, words):
    mission = (
        UNDER_LIMITS if isinstance(type(planner).__dict__.get("constraints"), property) else MISSION
    )
    with pytest.raises(op.ObsplanError) as caught:
        op.simulate(mission, planner=planner)
    assert words in str(caught.value)
    assert type(planner).__name__ in str(caught.value) or "NoneType" in words
    assert "\n" not in str(caught.value)


def test_a_plan_that_is_awaited_is_refused():
    class Later:
        async def plan(self, pose, auvs, *, time=0.0):
            return None

    with pytest.raises(op.ObsplanError, match="plan of Later must return a Decision at once"):
        check_planner(Later())


def test_what_a_planner_asks_of_numpy_is_its_own():
    def answer(*_):
        np.seterr(all="raise")
        return op.Decision(turn_rate=0.1, speed=1.0)

    before = np.geterr()
    op.simulate(MISSION, planner=Faulty(answer))
    assert np.geterr() == before


def test_an_interruption_is_no_fault_of_the_planner():
    with pytest.raises(KeyboardInterrupt):
        op.simulate(MISSION, planner=raising(KeyboardInterrupt()))
