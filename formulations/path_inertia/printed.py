"""Thesis (3.26) and the curvature form as they are printed, for cvxpy to read.

Nothing is reduced by hand: the sum over AUVs with its weights, |r| by its epigraph, the penalty on
change and the limits are handed over as they stand. That all of it is the soft threshold of one
number (`program.TurnProgram`) is a step beside it, which certifies what cvxpy's solver answers.
"""

import warnings
from importlib import import_module
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from formulations.path_inertia.program import Point, TurnProgram

FAILED = Point(np.nan, np.nan, np.nan, np.nan)


class Sum(NamedTuple):
    """What is summed in one decision, an entry for each AUV, and the turn before."""

    share: Float[np.ndarray, " auvs"]  # w, of the weights
    offset: Float[np.ndarray, " auvs"]  # b [m]
    square_distance: Float[np.ndarray, " auvs"]  # d² [m²]
    change_weight: float  # ρ; 0 where nothing was turned before
    last: float  # the turn before, a radius [m] or a curvature [1/m]
    bend: float  # half the second derivative of the sum


class PrintedProgram:
    """A printed program for a number of AUVs, canonicalised once (disciplined parametrised).

    ``difference`` is

        minimise Σ w [r² − 2rb + γ(‖ĉ‖² + size)] + ρ(r − last)²,  ‖ĉ‖² = r² − 2rb + d²
        subject to  r ≤ size,  −r ≤ size,  lower ≤ r ≤ upper

    and ``condition-number``, of the curvature k, is

        minimise Σ w [1 + 2(d²k² − 2bk + 1)] + ρ(k − last)²  subject to  lower ≤ k ≤ upper

    Turns are in a unit in which they are of the order of one, and sums in units of ``bend`` times
    that unit's square. A product of parameters would not be DPP, so each coefficient is one.
    """

    def __init__(self, auvs: int, objective: str, gamma: float):
        cp = import_module("cvxpy")
        self._turn, size = cp.Variable(name="turn"), cp.Variable(name="size")
        same = cp.Variable(name="same")  # as the turn: OSQP polishes nothing without an active row
        square, constant, metre = (
            cp.Parameter(auvs, name=name, nonneg=True) for name in ("square", "constant", "metre")
        )
        linear = cp.Parameter(auvs, name="linear")
        self._of_each = square, linear, constant, metre
        self._lower, self._upper = cp.Parameter(name="lower"), cp.Parameter(name="upper")
        self._root, self._kept = cp.Parameter(name="root of ρ"), cp.Parameter(name="kept")

        quadratic = square * cp.square(same) - 2 * linear * self._turn
        limits = [self._lower <= self._turn, self._turn <= self._upper, self._turn == same]
        self._radius, self._absolute = objective == "difference", False
        if not self._radius:
            cost = constant + 2 * (quadratic + constant)
        elif gamma == 0:
            cost = quadratic
        else:
            self._absolute = True
            cost = quadratic + gamma * (quadratic + constant + metre * size)
            limits += [self._turn <= size, -self._turn <= size]
        change = cp.square(self._root * same - self._kept)
        self.problem = cp.Problem(cp.Minimize(cp.sum(cost) + change), limits)
        if not self.problem.is_dcp(dpp=True):
            raise NotImplementedError(
                "the path-inertia program is not DPP in this version of cvxpy: "
                "it would be rebuilt at every decision"
            )

    def solve(self, told: Sum, hull: TurnProgram, options: dict[str, Any]) -> Point:
        """Solve one decision within the limits of its reduced program, and return its multipliers.

        They are those of the reduced program, which is half the sum in units of ``bend``.
        """
        unit = hull.scale
        self._tell(told, hull, unit)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of inaccuracy: the certificate tells
            self.problem.solve(**options)
        if self._turn.value is None:
            return FAILED
        lower, upper, _, *size = (
            0.5 * unit * float(limit.dual_value) for limit in self.problem.constraints
        )
        sign = size[0] - size[1] if self._absolute else 0.0
        return Point(unit * float(self._turn.value), sign, lower, upper)

    def _tell(self, told: Sum, hull: TurnProgram, unit: float) -> None:
        """Set the parameters."""
        bend = told.bend or 1.0  # on top of every AUV there is nothing to bend
        share = told.share / bend
        linear = share * told.offset / unit
        far = share * told.square_distance
        if self._radius:
            values = share, linear, far / unit**2, share / unit
        else:
            values = far, linear, share / unit**2, share / unit
        for parameter, value in zip(self._of_each, values, strict=True):
            parameter.value = value
        self._lower.value, self._upper.value = hull.lower / unit, hull.upper / unit
        self._root.value = np.sqrt(told.change_weight / bend)
        self._kept.value = self._root.value * told.last / unit


class Cvxpy:
    """The printed program and one of cvxpy's solvers; built once for each number of AUVs."""

    def __init__(self, objective: str, gamma: float, options: dict[str, Any]):
        self._objective, self._gamma, self._options = objective, gamma, options
        self._built = {1: PrintedProgram(1, objective, gamma)}

    def __call__(self, told: Sum, hull: TurnProgram) -> Point:
        """Solve one decision whose reduced program is bounded."""
        auvs = len(told.share)
        if auvs not in self._built:
            self._built[auvs] = PrintedProgram(auvs, self._objective, self._gamma)
        return self._built[auvs].solve(told, hull, self._options)
