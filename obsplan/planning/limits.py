"""Keep planners that know no limits within the scenario's, and say where AUVs are expected."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float

from formulations.beam_search.limits import Limits
from formulations.solution import Status
from obsplan.constraints import ROUNDING
from obsplan.next_move import first_move_violation
from obsplan.planning.companion import Companion
from obsplan.planning.fallback import predict_path
from obsplan.planning.situation import Situation
from obsplan.types import Belief, Decision, Pose

SURE = 3.0  # standard deviations of an AUV's position, added to separations
CANDIDATES = 21  # turns tried in place of one that breaks a limit


class LimitsAhead:
    """The limits from now on, AUVs and other aid vehicles being where they are expected.

    What is asked about is in the water that carries the vehicle, as planners have it; limits are
    held against where that is over ground.
    """

    def __init__(
        self, situation: Situation, auvs: Sequence[Belief], companions: Sequence[Companion] = ()
    ) -> None:
        self.situation = situation
        self.auvs = auvs
        apart = situation.constraints.min_separation_cna > 0
        self.aids = [one.route for one in companions if one.steered and apart]
        self.margin = np.append(margins(auvs), np.zeros(len(self.aids)))
        self._times = np.empty(0)
        self._positions = np.empty((0, self.margin.size, 2))

    def expected(self, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T N 2"]:
        """Where AUVs, and then aid vehicles, are expected over ground [m] at times from now [s]."""
        tracks = positions_ahead(self.auvs, times).swapaxes(0, 1)
        auvs = self.situation.stream.over_ground(tracks, times).swapaxes(0, 1)
        return np.concatenate([auvs, self.aids_ahead(times)], axis=1) if self.aids else auvs

    def aids_ahead(self, times: Float[np.ndarray, " T"]) -> Float[np.ndarray, "T N 2"]:
        """Where other aid vehicles are expected over ground [m] at times from now [s]."""
        return np.stack([route(times) for route in self.aids], axis=1)

    def along(
        self, positions: Float[np.ndarray, "*batch T 2"], times: Float[np.ndarray, " T"]
    ) -> Float[np.ndarray, "*batch T"]:
        """How far [m] positions at times from now [s] break a limit, 0 where they keep all."""
        limits = self.situation.constraints
        if not np.array_equal(times, self._times):  # a search asks again and again for the same
            self._times, self._positions = times, self.expected(times)
        there = self.situation.stream.over_ground(positions, times)
        return limits.violation(there, self._positions, self.margin, aids=len(self.aids))

    def numbers(self) -> Limits | None:
        """`along` as machine code asks it, which has one least distance; None where two hold."""
        limits = self.situation.constraints
        if self.aids:
            return None if limits.separates else self._apart_from_aids()
        return Limits(
            areas=self.situation.areas,
            min_separation=limits.min_separation,
            max_separation=limits.max_separation,
            rounding=ROUNDING,
            margin=self.margin,
            expected=self.expected,
            drift=self.situation.stream.drift,
        )

    def _apart_from_aids(self) -> Limits:
        """Distances to AUVs are not limited, and only aid vehicles are looked at."""
        return Limits(
            areas=self.situation.areas,
            min_separation=self.situation.constraints.min_separation_cna,
            max_separation=np.inf,
            rounding=ROUNDING,
            margin=np.zeros(len(self.aids)),
            expected=self.aids_ahead,
            drift=self.situation.stream.drift,
        )

    def first_move(
        self,
        state: Float[np.ndarray, "3"],
        turn_rates: Float[np.ndarray, " K"],
        speed: float,
    ) -> Float[np.ndarray, " K"]:
        """How far [m] turns break a limit before the next decision, or without fail after it."""
        return first_move_violation(
            self.situation.constraints,
            state,
            turn_rates,
            speed=speed,
            radius=self.situation.cna.min_turn_radius,
            interval=self.situation.decision_interval,
            auvs=self.expected,
            margin=self.margin,
            stream=self.situation.stream,
            aids=len(self.aids),
        )


def positions_ahead(
    auvs: Sequence[Belief], times: Float[np.ndarray, " T"]
) -> Float[np.ndarray, "T M 2"]:
    """Where AUVs are expected [m] at times from now [s]: `Belief.ahead` of all at once."""
    means = np.array([auv.mean for auv in auvs]).reshape(-1, 4)
    heading, speed = means[:, 2], means[:, 3]
    velocity = np.array([auv.current for auv in auvs], dtype=float).reshape(-1, 2)
    velocity[:, 0] += speed * np.cos(heading)
    velocity[:, 1] += speed * np.sin(heading)
    positions = means[:, :2] + times[:, None, None] * velocity
    for k, auv in enumerate(auvs):
        if auv.route is not None:
            positions[:, k] = auv.route(times)
    return positions


def margins(auvs: Sequence[Belief]) -> Float[np.ndarray, " M"]:
    """Distance [m] kept from each AUV for not knowing where it is; 0 if that is unknown, too."""
    blocks = np.array([auv.covariance[:2, :2] for auv in auvs]).reshape(-1, 2, 2)
    var_east, covariance, var_north = blocks[:, 0, 0], blocks[:, 0, 1], blocks[:, 1, 1]
    mean = (var_east + var_north) / 2
    half_difference = (var_east - var_north) / 2
    largest = mean + np.hypot(half_difference, covariance)  # eigenvalue
    largest[~np.isfinite(largest)] = 0.0
    return SURE * np.sqrt(np.maximum(largest, 0.0))


def within_limits(
    wanted: Decision,
    pose: Pose,
    auvs: Sequence[Belief],
    situation: Situation,
    companions: Sequence[Companion] = (),
) -> Decision:
    """Replace a manoeuvre that breaks a limit by the nearest turn that breaks none.

    A manoeuvre breaks one before the next decision, or by leaving no circle to turn on, or no way
    to keep separations, after it. If every turn does, the least violating one is taken. The status
    says which. Beliefs that are not finite count for nothing.
    """
    state = np.array([pose.x, pose.y, pose.heading])
    if not np.isfinite(state).all():
        return wanted
    cna = situation.cna
    limit = wanted.speed / cna.min_turn_radius
    turn_rates = np.concatenate([[wanted.turn_rate], np.linspace(limit, -limit, CANDIDATES)])
    known = [auv for auv in auvs if np.isfinite(auv.mean).all()]
    limits = LimitsAhead(situation, known, companions)
    broken = np.maximum(limits.first_move(state, turn_rates, wanted.speed), 0.0)
    if broken[0] == 0:
        return wanted
    k = np.lexsort((abs(turn_rates - wanted.turn_rate), broken))[0]
    turn_rate, status = float(turn_rates[k]), Status.VIOLATED if broken[k] > 0 else Status.LIMITED
    return replace(
        wanted,
        turn_rate=turn_rate,
        predict=partial(predict_path, cna, pose, turn_rate, wanted.speed),
        status=status,
        route=None,
    )
