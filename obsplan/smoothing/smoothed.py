"""The whole track given all that was measured: batch least squares over a tape."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from obsplan.scenario import Scenario
from obsplan.scenario.states import first_covariance
from obsplan.smoothing.constants import (
    BIAS,
    PRIORS,
    SCALE,
    Constants,
    constants_of,
    kinds_asked,
    kinds_of_filter,
)
from obsplan.smoothing.elimination import Motion
from obsplan.smoothing.loss import GEMAN_MCCLURE, Loss, loss_of
from obsplan.smoothing.mirror import both_sides
from obsplan.smoothing.model import Model, apart, joined
from obsplan.smoothing.rows import Problem, problem_of, usable
from obsplan.smoothing.solver import UNITS, Solved, Solver
from obsplan.tape import Tape
from obsplan.types import ObsplanError

NEXT_TO_NOTHING = 0.1  # a weight
MOST_SAMPLES = 20_000  # of a tape on which the search is begun a second time
WORTH = 1e-3  # of the cost, by which it has to end lower
ALARM = 0.2  # share of measurements of such weights


class Hidden(NamedTuple):
    """Hidden constants as they were found."""

    names: tuple[str, ...]
    values: Float[np.ndarray, " constants"]
    covariance: Float[np.ndarray, "constants constants"]

    @property
    def sigma(self) -> Float[np.ndarray, " constants"]:
        """Standard deviation of each."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def correlation(self) -> Float[np.ndarray, "constants constants"]:
        """Of each with each."""
        return self.covariance / np.outer(self.sigma, self.sigma)


@dataclass(frozen=True, kw_only=True, eq=False)
class Smoothed:
    """A track given everything that was measured, before and after.

    Frames and states as in `obsplan.Tape`.
    """

    time: Float[np.ndarray, " samples"]  # [s]
    mean: Float[np.ndarray, "auvs samples n"]
    covariance: Float[np.ndarray, "auvs samples 2 2"]  # of positions [m^2]
    hidden: Hidden
    # of the tape's measurements, between 0, not used, and 1; and what is left of each, measured
    # less expected, in standard deviations, nan where it could not be used
    weights: Float[np.ndarray, " rows"]
    residuals: Float[np.ndarray, " rows"]
    cost: float  # half the sum of squares, or the sum of losses
    converged: bool
    iterations: int
    words: tuple[str, ...]  # what is to be known of it

    def at(self, time: Float[np.ndarray, " times"]) -> "Smoothed":
        """The same at other times, between samples on the straight line.

        Raises
        ------
        ObsplanError
            A time before the first sample, or after the last.
        """
        outside = (time < self.time[0]) | (time > self.time[-1])
        if outside.any():
            raise ObsplanError(
                f"time: {time[outside][0]} s is outside of the tape, {self.time[0]} to "
                f"{self.time[-1]} s: ask within"
            )
        after = np.searchsorted(self.time, time).clip(1, max(1, self.time.size - 1))
        before = after - 1
        share = (time - self.time[before]) / (self.time[after] - self.time[before])
        mean = _between(self.mean, before, after, share[:, None])
        # that of a mean of two is at most the mean of both
        covariance = _between(self.covariance, before, after, share[:, None, None])
        values = {**vars(self), "time": time, "mean": mean, "covariance": covariance}
        return Smoothed(**values)


def _between(a: np.ndarray, before: np.ndarray, after: np.ndarray, share: np.ndarray) -> np.ndarray:
    return a[:, before] + share * (a[:, after] - a[:, before])


def smooth(
    tape: Tape,
    scenario: Scenario,
    *,
    start: Float[np.ndarray, "auvs samples m"] | None = None,
    hidden: Sequence[str] | None = None,
    per_beacon: bool = False,
    priors: Mapping[str, float] = PRIORS,
    loss: str = GEMAN_MCCLURE,
    scale: float | None = None,
) -> Smoothed:
    """Find the most probable track of all AUVs, and hidden constants, by all measurements.

    Model, first estimate, process noise and sensors are those that the scenario's filter assumes.

    Parameters
    ----------
    start
        Where to begin: the filter's means, say. Its first sample is the mean of the first estimate
        where the scenario does not say it. Default: dead reckoning from the first estimate.
    hidden
        Constants to find besides: ``scale`` of ranges and their ``bias`` [m], how late each AUV's
        ``clock`` is [s], an unknown ``current`` [m/s] besides the one that is counted on, the
        ``compass_bias`` [rad] of each AUV. Default: those that the filter estimates, with its
        priors and random walks.
    per_beacon
        Whether each beacon has a scale and a bias of its own, of those asked for.
    priors
        Standard deviations of constants that are asked for, by name; their means are 0.
    loss
        Of all measurements but headings: ``geman-mcclure``, ``huber`` or ``squares``.
    scale
        Where it departs from the squares [standard deviations]; default: 4, 1.345.

    Raises
    ------
    ObsplanError
        A name that is unknown, or no first estimate.
    """
    good, words = usable(tape)
    asked = kinds_asked(hidden or (), per_beacon=per_beacon, priors=priors)
    kinds = kinds_of_filter(scenario) if hidden is None else asked
    built = partial(_solver, tape, scenario, start, good, loss_of(loss, scale))
    # with constants common to all beacons first, or each explains what it is not
    common = [one._replace(per_beacon=False) for one in kinds]
    solver = built(constants_of(tape, common))
    x = solver.reckoned() if start is None else _guess(solver, start)
    if common != [*kinds]:
        found, model = solver.search(x)[0].x, solver.problem.model
        solver = built(constants_of(tape, kinds))
        x = _spread(found, model, solver.problem.model)
    solved = solver.solve(x)
    if start is not None and _lost(solver, solved):
        again = solver.solve(solver.reckoned())
        solved = again if again.cost < solved.cost else solved
    if start is not None and tape.time.size <= MOST_SAMPLES:
        back = solver.solve(_from_the_end(solver, start))
        solved = back if back.cost < solved.cost - WORTH else solved
    solved, sides = both_sides(solver, solved, tape)
    if scenario.table.estimator.states.depth is not None:
        words.append("depths are taken as they are measured")
    words += [*sides, *_said(solved, solver.problem)]
    return _smoothed(tape, solver.problem, solved, good, words)


def _from_the_end(
    solver: Solver, start: Float[np.ndarray, "auvs samples m"]
) -> Float[np.ndarray, "samples n"]:
    """Dead reckoning back from where a filter ended, which knows more then than when it began."""
    x = solver.reckoned()
    for auv, last in enumerate(start[:, -1]):
        at = solver.problem.model.of(auv).start
        turn = last[2] - x[-1, at + 2]
        place = x[:, at] + 1j * x[:, at + 1]
        moved = complex(*last[:2]) + (place - place[-1]) * np.exp(1j * turn)
        x[:, at], x[:, at + 1] = moved.real, moved.imag
        x[:, at + 2] += turn
    return x


def _lost(solver: Solver, solved: Solved) -> bool:
    """Whether so many measurements do not count that the search may have begun too far off."""
    rejected = solver.robust & (solved.weights < NEXT_TO_NOTHING)
    return int(rejected.sum()) > ALARM * int(solver.robust.sum())


def _solver(
    tape: Tape,
    scenario: Scenario,
    start: Float[np.ndarray, "auvs samples m"] | None,
    good: Bool[np.ndarray, " rows"],
    loss: Loss,
    constants: Constants,
) -> Solver:
    """The problem of a tape's good measurements."""
    model = Model(vehicles=scenario.vehicles, constants=constants)
    motion = _motion(tape, scenario, model, start)
    own = [*UNITS, *np.ones(model.own - len(UNITS))]
    return Solver(
        problem=problem_of(tape, scenario, model, good),
        motion=motion,
        loss=loss,
        unit=np.array([*own * len(tape.auvs), *constants.sigma]),
        noisy=motion.noisy,
    )


def _motion(
    tape: Tape,
    scenario: Scenario,
    model: Model,
    start: Float[np.ndarray, "auvs samples m"] | None,
) -> Motion:
    """What moves the AUVs."""
    n, dt = model.own, np.diff(tape.time)
    first = _first_mean(tape, scenario, start, n)
    controls = np.stack([tape.turn, tape.change_of_speed, tape.sway], axis=-1)
    walk = _walks(tape, scenario, first[:, 3] if start is None else start[:, :-1, 3], n)
    deviations = np.sqrt(np.diagonal(first_covariance(scenario, scenario.truth_states), 0, 1, 2))
    noises = np.concatenate([deviations[:, None], walk], axis=1)
    still = np.zeros(len(model.constants))
    joint = joined(noises, still)
    joint[0, model.of_auvs :] = model.constants.sigma
    joint[1:, model.of_auvs :] = np.outer(np.sqrt(dt), model.constants.walk)
    return Motion(
        first=joined(first[:, None], still)[0],
        controls=controls.swapaxes(0, 1).reshape(dt.size, -1),
        dt=dt,
        noise=joint,
    )


def _guess(
    solver: Solver, start: Float[np.ndarray, "auvs samples m"]
) -> Float[np.ndarray, "samples n"]:
    """A trajectory to begin from, whose headings do not jump by a whole turn."""
    model = solver.problem.model
    guess = start[:, :, : model.own].copy()
    guess[:, :, 2] = np.unwrap(start[:, :, 2], axis=1)
    x = joined(guess, np.zeros(len(model.constants)))
    x[0] = solver.motion.first
    return x


def _spread(
    x: Float[np.ndarray, "samples n"], common: Model, model: Model
) -> Float[np.ndarray, "samples m"]:
    """A trajectory with each beacon's constant where the one common to all was."""
    states, found = apart(x, len(model.vehicles), model.own), x[-1, model.of_auvs :]
    kinds, seen = common.constants.kinds, model.constants
    # those that no beacon has are the same, in the same order
    values = [
        found[kinds.index(kind) + (0 if kind in (SCALE, BIAS) else of)]
        for kind, of in zip(seen.kinds, seen.of, strict=True)
    ]
    return joined(states, np.array(values, dtype=float))


def _walks(
    tape: Tape, scenario: Scenario, speed: Float[np.ndarray, "..."], n: int
) -> Float[np.ndarray, "auvs steps n"]:
    """Standard deviations of what each step adds, at its speed in the track to begin from."""
    dt = np.diff(tape.time)
    found = np.empty((len(tape.auvs), dt.size, n))
    for i, walk in enumerate(found):
        if speed.ndim == 1:  # the first one, and what was measured since
            measured = np.concatenate([[0.0], np.cumsum(tape.change_of_speed[i])[:-1]])
            way = np.abs(speed[i] + measured) * dt
        else:
            way = np.abs(speed[i]) * dt
        process = scenario.filter_process(i, 1.0)
        by_time, by_way = np.array(process.noise[:n]), np.array(process.walk_per_meter[:n])
        walk[:] = np.sqrt(np.outer(dt, by_time**2) + np.outer(way, by_way**2))
    return found


def _first_mean(
    tape: Tape, scenario: Scenario, start: Float[np.ndarray, "auvs samples m"] | None, n: int
) -> Float[np.ndarray, "auvs n"]:
    """Means of the first estimates: the scenario's, or those that the start begins with.

    Raises
    ------
    ObsplanError
        There is neither.
    """
    auvs = len(tape.auvs)
    begun = np.full((auvs, n), np.nan) if start is None else start[:, 0, :n].copy()
    begun[:, :4] = scenario.first_estimates(begun[:, :4], np.zeros((auvs, 4)))[0]
    extra = [state.start for state in [*scenario.truth_states.values()][4:]]
    if start is None:
        begun[:, 4:] = extra
    missing = np.isnan(begun).any(axis=1)
    if missing.any():
        name = tape.auvs[int(missing.argmax())]
        raise ObsplanError(
            f"{scenario.source}: auv.{int(missing.argmax())}.first_estimate: of {name} there is no "
            "whole first estimate: give x, y, heading_deg and speed, or a track to start from"
        )
    return begun


def _said(solved: Solved, problem: Problem) -> list[str]:
    """What is to be known of a solution."""
    words: list[str] = []
    ranged = problem.rows.sensor < len(problem.sensors) - 1
    if not ranged.any():
        words.append("nothing was measured but headings: the track is dead reckoning")
    if not solved.converged:
        words.append(
            f"the search has not come to rest after {solved.iterations} steps: the track is not "
            "the best one"
        )
    rejected = int((ranged & (solved.weights < NEXT_TO_NOTHING)).sum())
    if rejected:
        words.append(f"{rejected} of {int(ranged.sum())} measurements count for next to nothing")
    return words


def _smoothed(
    tape: Tape,
    problem: Problem,
    solved: Solved,
    good: np.ndarray,
    words: Sequence[str],
) -> Smoothed:
    """The result on the tape's samples."""
    model, auvs = problem.model, len(tape.auvs)
    weights, residuals = np.zeros(good.size), np.full(good.size, np.nan)
    count = int(good.sum())
    weights[good], residuals[good] = solved.weights[:count], solved.residual[:count]
    places = [slice(i * model.own, i * model.own + 2) for i in range(auvs)]
    hidden = slice(model.of_auvs, model.size)
    return Smoothed(
        time=tape.time,
        mean=apart(solved.x, auvs, model.own),
        covariance=np.stack([solved.covariance[:, at, at] for at in places]),
        hidden=Hidden(
            model.constants.names, solved.x[-1, hidden], solved.covariance[-1, hidden, hidden]
        ),
        weights=weights,
        residuals=residuals,
        cost=solved.cost,
        converged=solved.converged,
        iterations=solved.iterations,
        words=tuple(words),
    )
