"""Choosing one of a few turns by an expression."""

from collections.abc import Sequence

import casadi as ca

# Scores this close, relative, are equal: the order of candidates, not rounding, decides a
# mirror-symmetric choice.
TIE = 1e-9


def first_of_the_best(
    totals: ca.SX, choices: Sequence[ca.SX], otherwise: Sequence[ca.SX]
) -> tuple[ca.SX, list[ca.SX]]:
    """Least total and, of each of the choices, the row that goes with it.

    Of equal totals the first is taken; ``otherwise`` where no total is finite.
    """
    best, taken = ca.SX(ca.inf), list(otherwise)
    for k in range(totals.shape[0]):
        better = totals[k] + TIE * ca.fabs(totals[k]) < best
        best = ca.if_else(better, totals[k], best)
        taken = [
            ca.if_else(better, rows[k, :], row) for rows, row in zip(choices, taken, strict=True)
        ]
    return best, taken
