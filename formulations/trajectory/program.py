"""The program of a shape, compiled once: direct multiple shooting, solved by fatrop, by IPOPT if it fails.

The limits are softened by one slack a stage at a linear cost: an exact penalty, so that the slacks are 0 wherever the limits can be kept.
No bound then is infeasible, which fatrop could not recover from.
"""

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
FIRST_BARRIER = 1e-4  # of fatrop: a larger one leaves the neighbourhood of a good start, whose turns are often at their limit
MOST_INFEASIBLE, MOST_OF_MOMENTS = (
    1.0,
    100.0,
)  # sum of gaps: past it covariances turn indefinite, and fatrop may restore for ever
SLACK_START = 1e-2  # above what the guess needs: interior


class Controls(NamedTuple):
    """A sequence of turns and speeds."""

    turn_rates: Float[np.ndarray, " N"]
    speeds: Float[np.ndarray, " N"]


class Program:
    """Compiled program of one shape; parameters are the columns of the whole task and then of the stages one after the other."""

    def __init__(self, shape: Shape, max_iterations: int) -> None:
        self.shape, self.max_iterations = shape, max_iterations
        self.nx, self.nu = 3 + shape.slew + shape.accumulated, 1 + shape.free_speed + shape.limited
        self._g, self._task = symbols(task_blocks(shape), "g")
        self._stages = [symbols(stage_blocks(shape), f"s{k}") for k in range(shape.stages)]
        self._p = ca.vertcat(self._g, *(column for column, _ in self._stages))

    @property
    def _start(self) -> SX:
        held = [self._task["last_rate"]] if self.shape.slew else []
        return ca.vertcat(ca.SX.zeros(3), *held, self._task["start"])

    @cached_property
    def _nlp(self) -> dict[str, SX]:
        """Variables u0, x1, u1, x2, ...; rows: after each gap x1 - F(x0, u0) the stage's limits.

        The first state is no variable. So there is no equality beside the dynamics, whose rank is full: fatrop 1.1 adds the same dual
        correction again and again, and never returns, where its restoration finds others deficient.
        """
        X = [self._start, *(symbol(f"x{k}", self.nx) for k in range(1, self.shape.stages + 1))]
        U = [symbol(f"u{k}", self.nu) for k in range(self.shape.stages)]
        cost, rows = final_cost(X[-1], self._task, self.shape), []
        total = sum(s["duration"] for _, s in self._stages)
        for k, (_, s) in enumerate(self._stages):
            cost += running_cost(X[k + 1], s["duration"] / total, self._task, self.shape)
            cost += (
                self._task["slack_weight"] * U[k][-1] * s["duration"] if self.shape.limited else 0.0
            )
            rows += [
                X[k + 1] - dynamics(X[k], U[k], s, self._task, self.shape),
                *self._limits(X[k], U[k], k),
            ]
        variables = ca.vertcat(*(v for pair in zip(U, X[1:], strict=True) for v in pair))
        cost, limited = ca.cse(
            [cost, ca.vertcat(*rows)]
        )  # arcs shared by dynamics and limits: halves the Hessian
        return {"x": variables, "p": self._p, "f": cost, "g": limited}

    def _limits(self, x: SX, u: SX, k: int) -> list[SX]:
        soft, hard = limits(
            x, u, self._stages[k][1], self._task, self.shape, last=k == self.shape.stages - 1
        )
        return [*(row + u[-1] for row in soft), *hard]

    @cached_property
    def _rows(self) -> tuple[list[int], Float[np.ndarray, " rows"]]:
        """Number of rows of each stage beside its gap, and the upper bounds of all; the lower ones are 0."""
        x, u = ca.SX.zeros(self.nx), ca.SX.zeros(self.nu)
        limited = [len(self._limits(x, u, k)) for k in range(self.shape.stages)]
        upper = [[0.0] * self.nx + [np.inf] * n for n in limited]
        return [*limited, 0], np.concatenate(upper)

    @cached_property
    def _follow(self) -> ca.Function:
        """(controls without slack, parameters) -> variables: the states that follow, and the slacks they need; what these cost."""
        given = symbol("u", 1 + self.shape.free_speed, self.shape.stages)
        x, variables, cost = self._start, [], ca.SX(0.0)
        for k, (_, s) in enumerate(self._stages):
            soft, _ = limits(
                x, given[:, k], s, self._task, self.shape, last=k == self.shape.stages - 1
            )
            x, slack = dynamics(x, given[:, k], s, self._task, self.shape), []
            if self.shape.limited:
                broken = ca.fmax(0.0, -ca.mmin(ca.vertcat(*soft)))
                cost, slack = (
                    cost + self._task["slack_weight"] * s["duration"] * broken,
                    [broken + SLACK_START],
                )
            variables += [given[:, k], *slack, x]
        return ca.Function("follow", [given, self._p], [ca.vertcat(*variables), cost])

    @cached_property
    def _solvers(self) -> dict[str, ca.Function]:
        return {}

    def _solver(self, name: str) -> ca.Function:
        """Compile a solver when it is first needed."""
        if name not in self._solvers:
            plain = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
            most = MOST_INFEASIBLE if self.shape.objective == "covariance" else MOST_OF_MOMENTS
            own: dict[str, Any] = {
                "print_level": 0,
                "tol": TOLERANCE,
                "max_iter": self.max_iterations,
                "theta_max_fact": most,
            }
            if name == "ipopt":
                options = {**plain, "ipopt": {**own, "sb": "yes"}}
            else:
                N = self.shape.stages
                structure = {
                    "N": N,
                    "nx": [0] + [self.nx] * N,
                    "nu": [self.nu] * N + [0],
                    "ng": self._rows[0],
                }
                options = {
                    **plain,
                    "structure_detection": "manual",
                    **structure,
                    "fatrop": {**own, "mu_init": FIRST_BARRIER},
                }
            self._solvers[name] = ca.nlpsol("trajectory", name, self._nlp, options)
        return self._solvers[name]

    def solve(
        self,
        name: str,
        start: Controls,
        parameters: Float[np.ndarray, " n"],
        bounds: Float[np.ndarray, "2 2"],
    ) -> Controls | None:
        """Improve on a sequence; None where the solver says it failed. ``bounds``: least and greatest turn rate, and speed."""
        free = self.shape.free_speed
        given = np.stack([start.turn_rates, start.speeds][: 1 + free])
        lower, upper = self._bounds(bounds)
        solver = self._solver(name)
        try:
            guess = self._follow(given, parameters)[0].full()
            if not (
                np.isfinite(parameters).all() and np.isfinite(guess).all()
            ):  # which fatrop does not return from either
                return None
            found = solver(x0=guess, p=parameters, lbx=lower, ubx=upper, lbg=0.0, ubg=self._rows[1])
        except RuntimeError:  # whatever a solver stumbles over is a reason to try the next
            return None
        if not solver.stats()["success"]:
            return None
        u = np.clip(
            found["x"].full().reshape(self.shape.stages, -1)[:, : 1 + free], *bounds[:, : 1 + free]
        )
        return (
            Controls(u[:, 0], u[:, 1] if free else start.speeds) if np.isfinite(u).all() else None
        )

    def penalty(self, controls: Controls, parameters: Float[np.ndarray, " n"]) -> float:
        """What breaking the limits, margins included, costs a sequence in the program's objective."""
        given = np.stack([controls.turn_rates, controls.speeds][: 1 + self.shape.free_speed])
        return float(self._follow(given, parameters)[1])

    def _bounds(self, bounds: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "2 n"]:
        limit = np.full((2, self.shape.stages, self.nu + self.nx), [[[-np.inf]], [[np.inf]]])
        limit[:, :, : 1 + self.shape.free_speed] = bounds[:, None, : 1 + self.shape.free_speed]
        if self.shape.limited:
            limit[0, :, self.nu - 1] = 0.0
        return limit.reshape(2, -1)


@lru_cache(maxsize=32)
def program(shape: Shape, max_iterations: int) -> Program:
    """The program of a shape, compiled when first asked for."""
    return Program(shape, max_iterations)
