"""Tracks on both sides: a straight pass by a beacon looks the same from either."""

import numpy as np
from jaxtyping import Float

from obsplan.smoothing.solver import Solved, Solver
from obsplan.tape import Tape

# root mean square of what is left of the ranges, in standard deviations, by which a mirror image
# is worth a search of its own
FITS = 5.0
SAME = 1e-3  # [m] between tracks that are one


def both_sides(solver: Solver, solved: Solved, tape: Tape) -> tuple[Solved, list[str]]:
    """The better of the track and its mirror images, with the difference in words."""
    words: list[str] = []
    for auv, name in enumerate(tape.auvs):
        image = mirrored(solver, solved, auv)
        if image is None:
            continue
        r = solver.ranges_left(image, auv)
        if not r.size or float(np.sqrt(np.mean(r**2))) > FITS:
            continue
        other = solver.solve(image)
        here = solver.problem.model.of(auv)
        apart = float(np.abs(other.x[:, here][:, :2] - solved.x[:, here][:, :2]).max())
        if apart < SAME or not other.converged:
            continue
        better, worse = (other, solved) if other.cost < solved.cost else (solved, other)
        words.append(
            f"two tracks of {name} fit, up to {apart:.1f} m apart: the other one's cost is "
            f"{worse.cost - better.cost:.2f} more, so it is e^{worse.cost - better.cost:.2f} times "
            "less likely"
        )
        solved = better
    return solved, words


def mirrored(solver: Solver, solved: Solved, auv: int) -> Float[np.ndarray, "samples n"] | None:
    """An AUV's track moved to the other side of what it ranged to; None where it ranged to none.

    It is moved across the line along which the AUV passed, so that its headings stay.
    """
    rows, model = solver.problem.rows, solver.problem.model
    mine = (rows.auv == auv) & (rows.sensor == 0) & (rows.between == 0)
    if not mine.any():
        return None
    here = solved.x[:, model.of(auv)]
    away = here[rows.sample[mine], :2] - rows.told[mine, :2]
    center = away.mean(axis=0)
    spread = (away - center).T @ (away - center)
    across = np.linalg.eigh(spread)[1][:, 0]
    image = solved.x.copy()
    at = model.of(auv).start
    image[:, at : at + 2] -= 2 * (center @ across) * across
    return image
