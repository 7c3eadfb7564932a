"""Choosing one of a few turns by an expression."""

from collections.abc import Sequence

import casadi as ca

TIE = 1e-9  # scores this close, relative, are equal: a mirror-symmetric choice is made by the order of candidates, not by rounding


def first_of_the_best(
    totals: ca.SX, choices: Sequence[ca.SX], otherwise: Sequence[ca.SX]
) -> tuple[ca.SX, list[ca.SX]]:
    """Least total and, of each of the choices, the row that goes with it; ``otherwise`` where no total is finite. Of equals the first."""
    best, taken = ca.SX(ca.inf), list(otherwise)
    for k in range(totals.shape[0]):
        better = totals[k] + TIE * ca.fabs(totals[k]) < best
        best = ca.if_else(better, totals[k], best)
        taken = [
            ca.if_else(better, rows[k, :], row) for rows, row in zip(choices, taken, strict=True)
        ]
    return best, taken
