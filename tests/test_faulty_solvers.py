"""Whatever a solver raises or claims, the answer is an optimum by its residuals or a fallback whose status names the solver."""

from types import SimpleNamespace

import casadi as ca
import cvxpy as cp
import numpy as np
import osqp
import pytest
import scipy.optimize
from oracles import told

import obsplan as op
from formulations.path_inertia import PathInertiaProblem
from formulations.solution import Status
from formulations.trajectory.program import Program

pytestmark = pytest.mark.slow  # two hundred faults

NAN = float("nan")
RAISED = {
    "runtime": RuntimeError("solver stumbled"),
    "memory": MemoryError(),
    "value": ValueError("bad data"),
    "arithmetic": ZeroDivisionError("division by zero"),
    "system": OSError("no licence"),
    "algebra": np.linalg.LinAlgError("singular"),
    "cvxpy": cp.error.SolverError("no luck"),
}


def raiser(error):
    def fail(*_, **__):
        raise error

    return fail


# --- path inertia -------------------------------------------------------------------------------

# of OSQP as of Clarabel: (x, y, z) of the quadratic program, three primal and five dual numbers
CLAIMED = {
    "start": (np.zeros(3), np.zeros(5)),
    "nan": (np.full(3, NAN), np.zeros(5)),
    "nan multipliers": (np.zeros(3), np.full(5, NAN)),
    "infinite": (np.full(3, np.inf), np.zeros(5)),
    "-infinite": (np.full(3, -np.inf), np.full(5, np.inf)),
    "beyond the limits": (np.full(3, -1e6), np.full(5, 1e6)),
    "no numbers": (np.empty(0), np.empty(0)),
    "too few": (np.zeros(1), np.zeros(1)),
    "nothing": (None, None),
    "text": ("optimal", "optimal"),
}
AUV = np.array([[4.0, 30.0]])  # where the aid vehicle is relative to it, and heads north
LIMITS = {
    "free": {},
    "to the right of a gap": {"max_radius": 9.0, "last_radius": -40.0, "change_weight": 3.0},
    "against the tightest": {"max_radius": 1.5},
}


def least(limits):
    """Radius of the least objective of thesis (3.26) with a change's penalty, on a fine grid."""
    rho, last = limits.get("change_weight", 0.0), limits.get("last_radius", 0.0)
    radius = np.linspace(1.0, limits.get("max_radius", 40.0), 390_001)
    radius = np.concatenate([-radius[::-1], radius])
    offset = AUV[0, 0]  # the AUV is that far to the left
    value = radius**2 - 2 * radius * offset + (radius - offset) ** 2 + abs(radius)
    return radius[np.argmin(value + rho * (radius - last) ** 2)]


def solved(problem, limits):
    return problem.solve(AUV, np.pi / 2, last_radius=limits.get("last_radius"))


def problem_of(solver, limits):
    options = {name: value for name, value in limits.items() if name != "last_radius"}
    return PathInertiaProblem(min_radius=1.0, gamma=1.0, solver=solver, **options)


def assert_the_solver_is_not_believed(problem, limits, name):
    solution = solved(problem, limits)
    assert solution.x[0] == pytest.approx(least(limits), abs=2e-4)
    if name in RAISED or solution.status not in (Status.OPTIMAL, Status.CLIPPED):
        assert solution.status == Status.SOLVER_FAILED
        assert "solver failed" in solution.advice


@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
def test_every_solver_finds_the_least_of_a_grid(limits):
    for solver in ("closed-form", "osqp", "clarabel", "cvxpy-osqp", "cvxpy-clarabel"):
        solution = solved(problem_of(solver, limits), limits)
        assert solution.status in (Status.OPTIMAL, Status.CLIPPED)
        assert solution.x[0] == pytest.approx(least(limits), abs=2e-4)


@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
@pytest.mark.parametrize("fault", [*RAISED, *CLAIMED])
@pytest.mark.parametrize("solver", ["osqp", "clarabel", "cvxpy-osqp"])
def test_turn_is_the_optimum_whatever_the_solver_does(solver, fault, limits, monkeypatch):
    problem = problem_of(solver, limits)
    if fault in RAISED:
        solve = raiser(RAISED[fault])
    else:
        x, z = CLAIMED[fault]
        result = SimpleNamespace(x=x, y=z, z=z)
        solve = lambda *_, **__: result  # noqa: E731
    if solver == "cvxpy-osqp":

        def claim(self, **options):
            solve(**options)
            for variable in self.variables():
                variable.save_value(np.asarray(result.x).flat[0])

        monkeypatch.setattr(cp.Problem, "solve", claim)
    else:
        fake = SimpleNamespace(solve=solve, update=lambda **_: None)
        monkeypatch.setattr(problem.compiled, "_solver", fake)
    assert_the_solver_is_not_believed(problem, limits, fault)


@pytest.mark.parametrize("step", ["setup", "update", "solve"])
def test_each_step_of_a_solver_may_fail(step, monkeypatch):
    monkeypatch.setattr(osqp.OSQP, step, raiser(MemoryError()))
    assert_the_solver_is_not_believed(problem_of("osqp", {}), {}, "memory")


def test_the_end_of_the_wrong_side_is_no_optimum():
    limits = LIMITS["to the right of a gap"]
    problem = problem_of("closed-form", limits)
    object.__setattr__(problem, "compiled", lambda program: program.with_multipliers(1.0))
    assert least(limits) < 0.0
    assert_the_solver_is_not_believed(problem, limits, "value")


# --- trajectories -------------------------------------------------------------------------------

CNA = op.Unicycle(speed=2.0, min_turn_radius=5.0)
POSE, BELIEFS = (
    op.Pose(0.0, -20.0, 0.3),
    [op.Belief.at(0.0, 0.0, covariance=np.diag([9.0, 25.0, 0.01, 0.01]))],
)


def full(like, value):
    return ca.DM(np.full(like.shape, value))


CHANGES = {
    "start": lambda found, x0: found | {"x": ca.DM(x0)},
    "start without multipliers": lambda found, x0: {"x": ca.DM(x0)},
    "start with zero multipliers": lambda found, x0: {
        "x": ca.DM(x0),
        "lam_g": full(found["lam_g"], 0.0),
        "lam_x": full(found["lam_x"], 0.0),
    },
    "nan": lambda found, _: found | {"x": full(found["x"], NAN)},
    "infinite": lambda found, _: found | {"x": full(found["x"], np.inf)},
    "zeros": lambda found, _: found | {"x": full(found["x"], 0.0)},
    "nan multipliers": lambda found, _: found | {"lam_g": full(found["lam_g"], NAN)},
    "infinite multipliers": lambda found, _: found | {"lam_x": full(found["lam_x"], np.inf)},
    "no numbers": lambda found, _: found | {"x": ca.DM()},
    "too many": lambda found, _: found | {"x": ca.vertcat(found["x"], found["x"])},
    "text": lambda found, _: found | {"x": "optimal"},
    "nothing": lambda *_: None,
}


class FaultySolver:
    """A solver that raises, or changes its answer and claims success."""

    def __init__(self, solver, fault):
        self.solver, self.fault = solver, fault

    def __call__(self, **given):
        if self.fault in RAISED:
            raise RAISED[self.fault]
        return CHANGES[self.fault](self.solver(**given), given["x0"])

    def stats(self):
        return self.solver.stats() | {"success": True}

    def __getattr__(self, name):
        return getattr(self.solver, name)


def trajectory():
    return told(op.Trajectory, CNA, ping_interval=2.0, sigma=1.0, stages=4, objective="log-det")


def with_solvers(monkeypatch, fault, names=("fatrop", "ipopt")):
    true = Program._solver

    def solver(self, name, *rest):
        made = true(self, name, *rest)
        return FaultySolver(made, fault) if name in names else made

    monkeypatch.setattr(Program, "_solver", solver)


@pytest.fixture(scope="module")
def optimum():
    decision = trajectory().plan(POSE, BELIEFS)
    assert decision.status == Status.OPTIMAL
    return decision


@pytest.mark.parametrize("fault", [*RAISED, *CHANGES])
def test_a_trajectory_is_no_optimum_because_solvers_say_so(fault, optimum, monkeypatch):
    with_solvers(monkeypatch, fault)
    decision = trajectory().plan(POSE, BELIEFS)
    assert decision.status == Status.BEST_MANOEUVRE
    assert "no solver improved" in decision.status.advice
    assert abs(decision.turn_rate) <= CNA.max_turn_rate
    assert decision.score > optimum.score


@pytest.mark.parametrize("fault", ["memory", "start"])
def test_the_second_solver_is_asked_where_the_first_lies(fault, optimum, monkeypatch):
    with_solvers(monkeypatch, fault, names=["fatrop"])
    decision = trajectory().plan(POSE, BELIEFS)
    assert decision.status == Status.SECOND_SOLVER
    assert decision.turn_rate == pytest.approx(optimum.turn_rate, abs=1e-6)


@pytest.mark.parametrize("error", RAISED.values(), ids=RAISED)
def test_a_solver_that_cannot_be_built_is_a_failed_attempt(error, monkeypatch):
    monkeypatch.setattr(Program, "_solver", raiser(error))
    assert trajectory().plan(POSE, BELIEFS).status == Status.BEST_MANOEUVRE


# --- whole missions -----------------------------------------------------------------------------

TURNS = {
    "start": lambda start: start,
    "nan": lambda start: np.full(start.shape, NAN),
    "infinite": lambda start: np.full(start.shape, np.inf),
    "no numbers": lambda _: np.empty(0),
    "too many": lambda start: np.append(start, start),
    "text": lambda _: "optimal",
    "nothing": lambda _: None,
}


@pytest.mark.parametrize("fault", [*RAISED, *TURNS])
def test_a_mission_is_no_optimum_because_the_minimiser_says_so(fault, monkeypatch):
    another = [*RAISED, *TURNS].index(fault)  # plans are kept, by the planner's options
    settings = ["duration=40.0", "planner.starts=2", f"planner.search_seed={another}"]
    mission = op.load("harbor-survey", planner="whole-mission", settings=settings)

    def claimed(_, start, **__):
        return SimpleNamespace(x=TURNS[fault](start), success=True)

    fake = raiser(RAISED[fault]) if fault in RAISED else claimed
    monkeypatch.setattr(scipy.optimize, "minimize", fake)
    run = op.simulate(mission)
    expected = "inaccurate" if fault == "start" else "best-manoeuvre"
    assert set(run.status_counts) == {expected}
    assert not run.faults
