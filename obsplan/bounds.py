"""What ranges told of a mission's AUVs, and what no path of the aid vehicles could beat."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import casadi as ca
import numpy as np
from jaxtyping import Bool, Float, Integer

from formulations.branch_and_bound import OptimalBound, optimal_bound
from formulations.certified_bound import InformationBound
from formulations.cramer_rao import (
    posterior_cramer_rao,
    range_information,
    squared_range_information,
)
from formulations.fleet import AidVehicle, RangedAuv
from formulations.joint_paths import JointBound, joint_bound
from formulations.model.casadi import of_each, symbol
from formulations.model.ranging import Law, Ranging, arrival, law_of
from formulations.model.worth import least_sigma
from obsplan.estimators.jacobian import informations, transitions
from obsplan.kept_bounds import KEPT
from obsplan.scenario import Scenario
from obsplan.scenario.beacons import law_told
from obsplan.scenario.states import first_covariance, noise
from obsplan.scenario.tables import aids_of
from obsplan.sensors import BEACON, Range, SquaredRange

Progress = Callable[[float, int], None]  # done, in all

NEAR_ENOUGH = 0.01  # of the mean square: half a percent of the error

GAINS = {Range: range_information, SquaredRange: squared_range_information}


@dataclass(frozen=True, kw_only=True)
class Bounds:
    """Lower bounds on the errors of a mission's AUVs, along their true paths."""

    scenario: Scenario
    time: Float[np.ndarray, " samples"]
    truth: Float[np.ndarray, "auvs samples n"]
    came: Bool[np.ndarray, "beacons auvs samples"]  # which ranges came
    beacon_places: Float[np.ndarray, "beacons samples 2"]  # [m]
    aids: Sequence[Any]  # tracks of the aid vehicles: pose, turn rate, speed
    # whether a heading came with a sample; None: with each
    compass: Bool[np.ndarray, "auvs samples"] | None = None

    def posterior(self, *, aided: bool = True) -> Iterator[Float[np.ndarray, "samples n n"]]:
        """Posterior Cramér-Rao bound of each AUV, of compass and, if aided, ranges."""
        for i, (P0, Q) in enumerate(zip(*self._covariances, strict=True)):
            J = self._own_information(i)
            if aided:
                for b in range(len(self.came)):
                    pings = np.flatnonzero(self.came[b, i])
                    J[pings - 1] += self._information(b, i, pings)
            yield posterior_cramer_rao(P0, self._transitions(i), Q, J)

    def forecast(self) -> Iterator[Float[np.ndarray, "samples n n"]]:
        """The same for ranges as they are expected before the mission, without jitter.

        What each due range would tell counts by the probability that it comes. That is about the
        mean of the bound over what may come, a little below it.
        """
        due, law = self.scenario.ranged(None), self._law
        for i, (P0, Q) in enumerate(zip(*self._covariances, strict=True)):
            J = self._own_information(i)
            for b in range(len(self.came)):
                pings = np.flatnonzero(due[:, b, i]) + 1
                away = self.truth[i, pings, :2] - self.beacon_places[b, pings]
                height = self.scenario.depths[pings, i] - self.scenario.beacons[b].depth
                r2 = (away**2).sum(axis=-1) + self.scenario.depths_count * height**2
                comes = share_that_comes(law, r2)
                J[pings - 1] += comes[:, None, None] * self._information(b, i, pings)
            yield posterior_cramer_rao(P0, self._transitions(i), Q, J)

    @property
    def _law(self) -> Law:
        """The true law of ranges."""
        return law_of(self._ranging)

    @property
    def _ranging(self) -> Ranging:
        """The same in numbers."""
        return law_told(self.scenario.range_sensor, self.scenario.table.ranging)

    def _information(
        self, b: int, i: int, pings: Integer[np.ndarray, " pings"]
    ) -> Float[np.ndarray, "pings n n"]:
        """What an AUV's ranges to a beacon tell of its true state, and bearings with them."""
        sensor, truth = self.scenario.range_sensor, self.truth[i, pings]
        gain = GAINS.get(type(sensor))
        if isinstance(sensor, Range) and not sensor.is_plain:
            sensor, gain = sensor.at_rest, None
        beacon = self._beacon(b, i, pings)
        if gain is None:
            J = informations(sensor, truth, beacon)
        else:
            J = np.zeros((*truth.shape, truth.shape[-1]))
            J[..., :2, :2] = gain(beacon[:, :2], truth[:, :2], sensor.sigma)
        bearing = self.scenario.bearing_sensor
        return J if bearing is None else J + informations(bearing, truth, beacon)

    def _beacon(
        self, b: int, i: int, samples: Integer[np.ndarray, " some"]
    ) -> Float[np.ndarray, "some 10"]:
        """A beacon as an AUV's sensor sees it at samples (`obsplan.sensors.BEACON`)."""
        beacon, some = self.scenario.beacons[b], samples.size
        found = np.zeros((some, len(BEACON)))
        found[:, :2] = self.beacon_places[b, samples]
        if beacon.carrier is not None:
            aid = self.aids[beacon.carrier]
            before = samples - 1  # what is held until the sample
            heading, speed = aid.pose[samples, 2], aid.speed[before]
            found[:, 2] = heading
            found[:, 3], found[:, 4] = speed * np.cos(heading), speed * np.sin(heading)
            found[:, 5] = aid.turn_rate[before]
        found[:, 6] = beacon.depth
        found[:, 7] = self.scenario.depths[samples, i]
        found[:, 8:] = self.scenario.currents[samples, i]
        return found

    def certified(self, progress: Progress) -> tuple[InformationBound, ...]:
        """What no path of the aid vehicles can beat, for each AUV; see `Run.information_bounds`."""
        auvs, bounds = len(self.truth), []
        for i, (P0, Q) in enumerate(zip(*self._covariances, strict=True)):
            tell = partial(_tell, progress, i, auvs)
            J, pings, sigmas = self._own_information(i), [], []
            for b, beacon in enumerate(self.scenario.beacons):
                at = np.flatnonzero(self.came[b, i])
                if beacon.carrier is None:
                    J[at - 1] += self._information(b, i, at)
                    continue
                pings.append(at)
                sigmas.append(self._least_sigma(b, i, at, self._fastest(beacon.carrier)))
            steps, sigma = _joined(pings).astype(int) - 1, _joined(sigmas)
            F = self._transitions(i)
            bounds.append(KEPT.bound(P0, F, Q, J, pings=steps, sigma=sigma, progress=tell))
        return tuple(bounds)

    def joint(self, progress: Callable[[float], None]) -> JointBound:
        """What no paths of the aid vehicles can beat, of all AUVs together."""
        auvs, aids = self.fleet()
        return joint_bound(auvs, aids, ranging=self._ranging, time=self.time, progress=progress)

    def optimal(self, max_nodes: int, progress: Callable[[float], None]) -> OptimalBound:
        """How far the paths that were flown are from the best ones, at most."""
        auvs, aids = self.fleet()
        achieved = np.mean([np.mean(P[:, 0, 0] + P[:, 1, 1]) for P in self.posterior()])
        return optimal_bound(
            auvs,
            aids,
            ranging=self._ranging,
            time=self.time,
            achieved=float(achieved),
            relative_gap=NEAR_ENOUGH,
            max_nodes=max_nodes,
            progress=progress,
        )

    def fleet(self) -> tuple[list[RangedAuv], list[AidVehicle]]:
        """AUVs and aid vehicles as `formulations.joint_bound` takes them.

        Each transducer counts as a vehicle, also where two are on one: a larger set of paths.
        """
        beacons = enumerate(self.scenario.beacons)
        carriers = {b: beacon.carrier for b, beacon in beacons if beacon.carrier is not None}
        carried = [*carriers]
        covariances = zip(*self._covariances, strict=True)
        auvs = [self._auv(i, P0, Q, carried) for i, (P0, Q) in enumerate(covariances)]
        return auvs, [self._aid_vehicle(b, carrier) for b, carrier in carriers.items()]

    def _auv(self, i: int, P0: np.ndarray, Q: np.ndarray, carried: list[int]) -> RangedAuv:
        """An AUV with its ranges to carried beacons; those to moored ones are as they are."""
        J = self._own_information(i)
        samples, aids, heights = [], [], []
        for b, beacon in enumerate(self.scenario.beacons):
            at = np.flatnonzero(self.came[b, i])
            if b not in carried:
                J[at - 1] += self._information(b, i, at)
                continue
            samples.append(at)
            aids.append(np.full(at.shape, carried.index(b)))
            heights.append(self.scenario.depths[at, i] - beacon.depth)
        pings = _joined(samples).astype(int)
        return RangedAuv(
            P0=P0,
            F=self._transitions(i),
            Q=Q,
            J_other=J,
            pings=pings - 1,
            places=self.truth[i, pings, :2],
            aids=_joined(aids).astype(int),
            heights=_joined(heights),
        )

    def _aid_vehicle(self, b: int, carrier: int) -> AidVehicle:
        """What carries a beacon; one ahead of the vehicle's middle swings round with it."""
        beacon = self.scenario.beacons[b]
        return AidVehicle(
            start=self.beacon_places[b, 0],
            speed=self._fastest(carrier),
            swing=2 * float(np.hypot(*beacon.place)),
        )

    def _fastest(self, aid: int) -> float:
        """Greatest speed of an aid vehicle over ground [m/s]."""
        scenario = self.scenario
        carried = aids_of(scenario.table)[aid].carried
        return scenario.aids[aid].speed + carried * float(scenario.water.strongest(0.0))

    def _least_sigma(
        self, b: int, i: int, pings: Integer[np.ndarray, " pings"], speed: float
    ) -> Float[np.ndarray, " pings"]:
        """Smallest standard deviation [m] of a range to a beacon carried at up to a speed."""
        scenario, beacon = self.scenario, self.scenario.beacons[b]
        away = self.truth[i, pings, :2] - self.beacon_places[b, 0]
        start = np.hypot(away[:, 0], away[:, 1])
        # a beacon ahead of the vehicle's middle swings round with it
        travelled = speed * self.time[pings] + 2 * np.hypot(*beacon.place)
        nearest = np.maximum(start - travelled, 0.0)
        height = scenario.depths[pings, i] - beacon.depth
        return least_sigma(self._ranging, nearest, start + travelled, height)

    @property
    def _covariances(self) -> tuple[np.ndarray, np.ndarray]:
        """First covariance and process noise over a step of each AUV, both (auvs x n x n)."""
        scenario = self.scenario
        rows = noise(scenario, scenario.truth_states, assumed=True)
        process = [np.diag(row**2 * scenario.table.time_step) for row in rows]
        return first_covariance(scenario, scenario.truth_states), np.stack(process)

    def _transitions(self, i: int) -> Float[np.ndarray, "steps n n"]:
        """Jacobians of an AUV's steps; not kept, as those of a long mission are large."""
        dt, vehicle = self.scenario.table.time_step, self.scenario.vehicles[i]
        return transitions(vehicle, self.truth[i, :-1], dt)

    def _own_information(self, i: int) -> Float[np.ndarray, "steps n n"]:
        """What an AUV's compass and log tell of its state on arrival at each sample."""
        n, every = self.truth.shape[-1], self.scenario.log_every[i]
        J = np.zeros((self.time.size - 1, n, n))
        came = slice(None) if self.compass is None else self.compass[i, 1:]
        J[came, 2, 2] = self.scenario.heading_sensor.sigma**-2
        due = np.arange(every, self.time.size, every) if every else np.empty(0, dtype=int)
        for sensor in self.scenario.true_logs[i]:
            J[due - 1] += informations(sensor, self.truth[i, due], self._beacon(0, i, due))
        return J


def share_that_comes(law: Law, r2: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Probability that ranges over squared distances [m^2] come."""
    (share,) = of_each(_comes(law), r2)
    return share


@lru_cache(maxsize=16)
def _comes(law: Law) -> ca.Function:
    r2 = symbol("r2")
    return ca.Function("comes", [r2], [ca.densify(ca.SX(arrival(law, r2)))])


def _joined(arrays: list[np.ndarray]) -> np.ndarray:
    """Arrays one after the other, or none."""
    return np.concatenate([np.empty(0), *arrays])


def _tell(progress: Progress, done: int, auvs: int, share: float) -> None:
    """Say that this share is done of one more AUV."""
    progress(done + share, auvs)
