"""Choosing one of a few turns by an expression."""

from functools import lru_cache

import casadi as ca

from formulations.model.casadi import symbol

# Scores this close, relative, are equal: the order of candidates, not rounding, decides a
# mirror-symmetric choice.
TIE = 1e-9


@lru_cache(maxsize=64)
def first_of_the_best(count: int) -> ca.Function:
    """Least of ``count`` totals and what goes with it.

    (totals, values, otherwise) -> (least total, its value). Of equal totals the first is taken;
    ``otherwise`` where no total is finite.
    """
    totals, values = symbol("totals", count), symbol("values", count)
    otherwise = symbol("otherwise")
    best, taken = ca.SX(ca.inf), otherwise
    for k in range(count):
        better = totals[k] + TIE * ca.fabs(totals[k]) < best
        best = ca.if_else(better, totals[k], best)
        taken = ca.if_else(better, values[k], taken)
    return ca.Function("first_of_the_best", [totals, values, otherwise], [best, taken])
