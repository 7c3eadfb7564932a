"""Choosing one of a few turns by an expression."""

from functools import lru_cache

import casadi as ca

from formulations.model.casadi import symbol
from formulations.model.ties import TIE


@lru_cache(maxsize=64)
def first_of_the_best(count: int) -> ca.Function:
    """Least of ``count`` totals and what goes with it.

    (totals, values, otherwise, doubt) -> (least total, its value). Of equal totals the first is
    taken: the order of candidates, not rounding, decides a mirror-symmetric choice. Equal is what
    differs by a `TIE` of itself, or by its ``doubt``, the rounding that a total may have beside.
    ``otherwise`` where no total is finite.
    """
    totals, values, doubt = (symbol(name, count) for name in ("totals", "values", "doubt"))
    otherwise = symbol("otherwise")
    best, taken = ca.SX(ca.inf), otherwise
    for k in range(count):
        better = totals[k] + TIE * ca.fabs(totals[k]) + doubt[k] < best
        best = ca.if_else(better, totals[k], best)
        taken = ca.if_else(better, values[k], taken)
    given = [totals, values, otherwise, doubt]
    return ca.Function("first_of_the_best", given, [best, taken])
