"""The program of a shape, compiled once: direct multiple shooting, solved by fatrop or by IPOPT.

The limits are softened by one slack a stage at a linear cost: an exact penalty, so that the slacks
are 0 wherever the limits can be kept. No bound then is infeasible, which fatrop could not recover
from.
"""

from contextlib import suppress
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from jaxtyping import Float

from ..model.casadi import SX, symbol
from .expressions import (
    Shape,
    dynamics,
    final_cost,
    limits,
    running_cost,
    stage_blocks,
    symbols,
    task_blocks,
)

TOLERANCE = 1e-8  # of the optimality conditions, in units of the task
# Largest residual of these conditions, computed anew, of an answer that is believed: each solver
# scales its own, and true answers had 2e-8 at most, such as had failed 1e-5 at least.
CERTIFIED = 1e-6
LARGE = 100.0  # mean multiplier, past which these conditions are relative
# Of fatrop: a larger one leaves the neighbourhood of a good start, whose turns are often at their
# limit.
FIRST_BARRIER = 1e-4
# Sum of gaps: past it covariances turn indefinite, and fatrop may restore for ever.
MOST_INFEASIBLE = 1.0
MOST_OF_MOMENTS = 100.0
SLACK_START = 1e-2  # above what the guess needs: interior
SOLVERS = ("fatrop", "ipopt")  # the one that knows the stages; the one that is slower, fails less
FIRST_PACE = 1e-2  # [s]; what an iteration may take before one was timed
HALVINGS = 3  # of the iterations allowed, so that less time is enough


class Controls(NamedTuple):
    """A sequence of turns and speeds."""

    turn_rates: Float[np.ndarray, " N"]
    speeds: Float[np.ndarray, " N"]


class Answer(NamedTuple):
    """What a solver came to; no controls where it failed."""

    controls: Controls | None
    iterations: int = 0


class Program:
    """Compiled program of one shape.

    Parameters are the columns of the whole task and then of the stages one after the other.
    """

    def __init__(self, shape: Shape, max_iterations: int) -> None:
        self.shape = shape
        self.max_iterations = max_iterations
        self.free = 1 + shape.free_speed  # controls without slack
        self.nx = 3 + shape.slew + shape.accumulated
        self.nu = self.free + shape.limited
        self._g, self._task = symbols(task_blocks(shape), "g")
        self._stages = [symbols(stage_blocks(shape), f"s{k}") for k in range(shape.stages)]
        self._p = ca.vertcat(self._g, *(column for column, _ in self._stages))
        self._solvers: dict[tuple[str, int], ca.Function] = {}
        self._pace: dict[str, float] = {}  # time of an iteration [s], as the last answer took

    @property
    def _start(self) -> SX:
        held = [self._task["last_rate"]] if self.shape.slew else []
        return ca.vertcat(ca.SX.zeros(3), *held, self._task["start"])

    @cached_property
    def _nlp(self) -> dict[str, SX]:
        """Variables u0, x1, u1, x2, ...; rows: after each gap x1 - F(x0, u0) the stage's limits.

        The first state is no variable. So there is no equality beside the dynamics, whose rank is
        full: fatrop 1.1 adds the same dual correction again and again, and never returns, where its
        restoration finds others deficient.
        """
        task, shape = self._task, self.shape
        total = sum(s["duration"] for _, s in self._stages)
        states = [symbol(f"x{k}", self.nx) for k in range(1, shape.stages + 1)]
        controls = [symbol(f"u{k}", self.nu) for k in range(shape.stages)]
        cost = final_cost(states[-1], task, shape)
        variables, rows, x = [], [], self._start
        for k, (_, s) in enumerate(self._stages):
            u, after = controls[k], states[k]
            cost += running_cost(after, s["duration"] / total, task, shape)
            if shape.limited:
                cost += task["slack_weight"] * u[-1] * s["duration"]
            rows += [after - dynamics(x, u, s, task, shape), *self._limits(x, u, k)]
            variables += [u, after]
            x = after
        # dynamics and limits share arcs: halves the Hessian
        cost, limited = ca.cse([cost, ca.vertcat(*rows)])
        return {"x": ca.vertcat(*variables), "p": self._p, "f": cost, "g": limited}

    def _limits(self, x: SX, u: SX, k: int) -> list[SX]:
        """Rows of a stage's limits, those softened that can be."""
        soft, hard = self._soft_and_hard(x, u, k)
        return [*(row + u[-1] for row in soft), *hard]

    def _soft_and_hard(self, x: SX, u: SX, k: int) -> tuple[list[SX], list[SX]]:
        _, s = self._stages[k]
        return limits(x, u, s, self._task, self.shape, last=k == self.shape.stages - 1)

    @cached_property
    def _rows(self) -> tuple[list[int], Float[np.ndarray, " rows"]]:
        """Number of rows of each stage beside its gap, and the upper bounds of all.

        The lower bounds are 0.
        """
        x, u = ca.SX.zeros(self.nx), ca.SX.zeros(self.nu)
        limited = [len(self._limits(x, u, k)) for k in range(self.shape.stages)]
        upper = [[0.0] * self.nx + [np.inf] * n for n in limited]
        return [*limited, 0], np.concatenate(upper)

    @cached_property
    def _rollout(self) -> ca.Function:
        """(controls without slack, parameters) -> variables, cost.

        The variables are the states that follow, and the slacks they need, which the cost is of.
        """
        task, shape = self._task, self.shape
        given = symbol("u", self.free, shape.stages)
        x, variables, cost = self._start, [], ca.SX(0.0)
        for k, (_, s) in enumerate(self._stages):
            u = given[:, k]
            variables.append(u)
            if shape.limited:
                soft, _ = self._soft_and_hard(x, u, k)
                broken = ca.fmax(0.0, -ca.mmin(ca.vertcat(*soft)))
                cost += task["slack_weight"] * s["duration"] * broken
                variables.append(broken + SLACK_START)
            x = dynamics(x, u, s, task, shape)
            variables.append(x)
        return ca.Function("rollout", [given, self._p], [ca.vertcat(*variables), cost])

    def build(self, *, timed: bool) -> None:
        """Compile all that `solve` may need; ``timed``: also what it needs where time is short.

        A solver that cannot be compiled is passed over: `solve` then says that it failed.
        """
        _ = self._rollout, self._lagrangian
        for name in SOLVERS:
            for iterations in self._allowed if timed else self._allowed[:1]:
                with suppress(Exception):
                    self._solver(name, iterations)

    @property
    def _allowed(self) -> list[int]:
        """Iterations that solvers are compiled for, the most first."""
        halves = {self.max_iterations >> k for k in range(HALVINGS + 1)}
        return sorted(halves - {0}, reverse=True)

    def _affordable(self, name: str, seconds: float) -> int:
        """The most iterations that a solver can do in a time; 0: none.

        An iteration takes as long as those of its last answer.
        """
        pace = self._pace.get(name, FIRST_PACE)
        fitting = [n for n in self._allowed if n * pace <= seconds]
        return max(fitting, default=0)

    def _solver(self, name: str, iterations: int) -> ca.Function:
        """A solver that ends after so many iterations, compiled when it is first needed."""
        key = name, iterations
        if key not in self._solvers:
            options = self._options(name, iterations)
            if iterations < self.max_iterations:  # the derivatives are the same
                whole = self._solver(name, self.max_iterations)
                options["cache"] = {each: whole.get_function(each) for each in whole.get_function()}
            self._solvers[key] = ca.nlpsol("trajectory", name, self._nlp, options)
        return self._solvers[key]

    def _options(self, name: str, iterations: int) -> dict[str, Any]:
        """Options of CasADi's, and the solver's own."""
        covariance = self.shape.objective == "covariance"
        own = {
            "print_level": 0,
            "tol": TOLERANCE,
            "max_iter": iterations,
            "theta_max_fact": MOST_INFEASIBLE if covariance else MOST_OF_MOMENTS,
        }
        options = {
            "print_time": False,
            "record_time": True,
            "show_eval_warnings": False,
            "error_on_fail": False,
            name: own,
        }
        if name == "ipopt":
            own["sb"] = "yes"
            return options
        own["mu_init"] = FIRST_BARRIER
        N = self.shape.stages
        options["structure_detection"] = "manual"
        options["N"] = N
        options["nx"] = [0] + [self.nx] * N
        options["nu"] = [self.nu] * N + [0]
        options["ng"] = self._rows[0]
        return options

    def solve(
        self,
        name: str,
        start: Controls,
        parameters: Float[np.ndarray, " n"],
        bounds: Float[np.ndarray, "2 2"],
        *,
        seconds: float = np.inf,
    ) -> Answer:
        """Improve on a sequence; no controls where the solver failed.

        It failed if it raises or says so, or if its answer does not satisfy the optimality
        conditions to `CERTIFIED`.
        ``bounds``: least and greatest turn rate, and speed. ``seconds``: that it may take, about.
        """
        iterations = self._affordable(name, seconds)
        if iterations == 0:
            return Answer(None)
        lower, upper = self._bounds(bounds)
        try:
            guess = self._rollout(self._given(start), parameters)[0].full()
            # fatrop does not return from numbers that are not finite
            if not (np.isfinite(parameters).all() and np.isfinite(guess).all()):
                return Answer(None)
            solver = self._solver(name, iterations)
            found = solver(x0=guess, p=parameters, lbx=lower, ubx=upper, lbg=0.0, ubg=self._rows[1])
            said = solver.stats()
            taken = max(1, said["iter_count"])
            self._pace[name] = said["t_wall_total"] / taken
            if not said["success"]:
                return Answer(None, taken)
            certified = self._residual(found, parameters, lower, upper) <= CERTIFIED
            variables = found["x"].full()
        except Exception:  # whatever a solver stumbles over is a reason to try the next
            return Answer(None)
        return Answer(self._controls(variables, start, bounds) if certified else None, taken)

    def _controls(
        self,
        variables: Float[np.ndarray, "n 1"],
        start: Controls,
        bounds: Float[np.ndarray, "2 2"],
    ) -> Controls | None:
        """The controls among the variables, within their bounds; None where one is no number."""
        by_stage = variables.reshape(self.shape.stages, -1)
        least, greatest = bounds[:, : self.free]
        u = np.clip(by_stage[:, : self.free], least, greatest)
        if not np.isfinite(u).all():
            return None
        return Controls(u[:, 0], u[:, 1] if self.shape.free_speed else start.speeds)

    @cached_property
    def _lagrangian(self) -> ca.Function:
        """(variables, parameters, multipliers of the rows) -> gradient of the Lagrangian, rows."""
        x, rows = self._nlp["x"], self._nlp["g"]
        multipliers = symbol("multipliers", rows.numel())
        lagrangian = self._nlp["f"] + ca.dot(multipliers, rows)
        gradient = ca.gradient(lagrangian, x)
        return ca.Function("lagrangian", [x, self._p, multipliers], [gradient, rows])

    def _residual(
        self,
        found: dict[str, ca.DM],
        parameters: Float[np.ndarray, " n"],
        lower: Float[np.ndarray, " x"],
        upper: Float[np.ndarray, " x"],
    ) -> float:
        """Largest residual of the optimality conditions of Karush, Kuhn and Tucker.

        These are violated bounds and rows, the gradient of the Lagrangian, and products of
        multipliers, negative at lower bounds, and slacks that are left (1 where there is no bound);
        nan where one is. The last two are relative to the mean multiplier where that is above
        `LARGE` (Wächter and Biegler 2006, (6)).
        """
        gradient, rows = self._lagrangian(found["x"], parameters, found["lam_g"])
        dual = gradient.full() + found["lam_x"].full()
        value = np.concatenate([found["x"].full(), rows.full()]).ravel()
        multiplier = np.concatenate([found["lam_x"].full(), found["lam_g"].full()]).ravel()
        least = np.concatenate([lower, np.zeros(rows.numel())])
        most = np.concatenate([upper, self._rows[1]])
        primal = np.maximum(least - value, value - most)
        slack = np.where(multiplier < 0, value - least, most - value)
        left = np.where(np.isinf(slack), 1.0, np.maximum(slack, 0.0))
        gap = multiplier * left
        scale = max(1.0, float(np.abs(multiplier).mean()) / LARGE)
        scaled = np.abs(np.concatenate([dual.ravel(), gap])) / scale
        return float(np.concatenate([primal, scaled]).max())

    def penalty(self, controls: Controls, parameters: Float[np.ndarray, " n"]) -> float:
        """Cost of breaking the limits, margins included, in the program's objective."""
        return float(self._rollout(self._given(controls), parameters)[1])

    def _given(self, controls: Controls) -> Float[np.ndarray, "free N"]:
        """A sequence as `_rollout` takes it."""
        return np.stack([controls.turn_rates, controls.speeds])[: self.free]

    def _bounds(self, bounds: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "2 n"]:
        """Least and greatest values of all variables."""
        limit = np.empty((2, self.shape.stages, self.nu + self.nx))
        limit[0], limit[1] = -np.inf, np.inf
        limit[:, :, : self.free] = bounds[:, None, : self.free]
        if self.shape.limited:
            limit[0, :, self.nu - 1] = 0.0
        return limit.reshape(2, -1)


@lru_cache(maxsize=32)
def program(shape: Shape, max_iterations: int) -> Program:
    """The program of a shape, compiled when first asked for."""
    return Program(shape, max_iterations)
