"""One AUV over a time step, as expressions: its truth, what it measures, its filter, its report."""

from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import SX
from formulations.model.covariance import pack, unpack
from formulations.model.ranging import arrival, law_of
from obsplan.estimators import Process
from obsplan.scenario import Scenario
from obsplan.scenario.beacons import law_told
from obsplan.scenario.states import BASIC
from obsplan.sensors import Range, Sensor
from obsplan.simulation.features import Features


class Own(NamedTuple):
    """What an AUV's step is told; see `Carry` and `Inputs`."""

    truth: SX
    mean: SX
    covariance: SX
    reported: SX
    reported_covariance: SX
    steer: SX
    disturbance: SX
    ping: SX
    heading_error: SX
    range_error: SX
    chance: SX
    false: SX
    repeated: SX
    depth: SX
    depth_error: SX
    bearing_error: SX
    log: SX
    log_error: SX
    water: SX


class Kind(NamedTuple):
    """What AUVs may have in common."""

    process: Process  # what their filters assume
    current: tuple[float, float]  # they count on [m/s]
    logs: tuple[tuple[Sensor, Sensor], ...]  # that measure speed: of the true state, the filter's


class Fleet(NamedTuple):
    """The beacons at a step's end: position, heading, velocity [m/s], turn rate and depth."""

    beacons: list[SX]

    @classmethod
    def of(cls, scenario: Scenario, cna: SX, command: SX, stream: SX) -> "Fleet":
        """The beacons on the aid vehicles, and moored."""
        found = []
        for beacon in scenario.beacons:
            if beacon.carrier is None:
                still = ca.SX.zeros(4)
                found.append(ca.vertcat(*beacon.place, still, beacon.depth))
                continue
            pose = cna[:, beacon.carrier]
            turn_rate, speed = ca.vertsplit(command[:, beacon.carrier])
            cos, sin = ca.cos(pose[2]), ca.sin(pose[2])
            ahead, left = beacon.place
            east, north = pose[0], pose[1]
            if ahead or left:
                east += ahead * cos - left * sin
                north += ahead * sin + left * cos
            velocity = speed * ca.vertcat(cos, sin)
            if stream.numel():
                velocity += stream[:, beacon.carrier]
            found.append(ca.vertcat(east, north, pose[2], velocity, turn_rate, beacon.depth))
        return cls(found)


class Surveyor(NamedTuple):
    """An AUV of a kind, among the beacons at the step's end."""

    scenario: Scenario
    kind: Kind
    fleet: Fleet

    def step(self, own: Own) -> dict[str, SX]:
        """State, filter, report, ranges and bearings at the step's end."""
        scenario, filtering = self.scenario, self.scenario.estimator
        compass, process = scenario.heading_sensor, self.kind.process
        m = len(scenario.filter_states)
        # the autopilot brings heading and speed back to the survey's, and measures what it did
        u = own.steer - own.truth[2:BASIC]
        moved = process.model.step(own.truth, u, scenario.table.time_step)
        after = moved + own.disturbance
        x, P = filtering.predict(own.mean, unpack(own.covariance, m), u, process)
        nowhere = self._told(0, own)
        heading = compass.measure(after, nowhere) + own.heading_error
        x, P = filtering.update(x, P, heading, compass, nowhere)
        if self.kind.logs:
            x, P = self._logged(after, x, P, own)
        x, P, heard, measured = self._ranged(after, x, P, own)
        pinged = partial(ca.if_else, heard)
        along = scenario.table.planner.knowledge == "estimate-and-survey"
        turns = own.steer - own.reported[2:BASIC] if along else ca.SX.zeros(2)
        reckoned, reckoned_P = filtering.predict(
            own.reported, unpack(own.reported_covariance, m), turns, process
        )
        return measured | {
            "truth": after,
            "mean": x,
            "covariance": P,
            "reported": pinged(x, reckoned),
            "reported_covariance": pinged(P, pack(reckoned_P)),
        }

    def _logged(self, truth: SX, x: SX, P: SX, own: Own) -> tuple[SX, SX]:
        """Filter after its speed was measured, where it was."""
        seen, told = self._true(0, own), self._told(0, own)
        before, before_P = x, P
        for k, (true, assumed) in enumerate(self.kind.logs):
            z = true.measure(truth, seen) + true.deviation(truth, seen) * own.log_error[k]
            x, P = self.scenario.estimator.update(x, P, z, assumed, told)
        return ca.if_else(own.log, x, before), ca.if_else(own.log, P, before_P)

    def _ranged(self, truth: SX, x: SX, P: SX, own: Own) -> tuple[SX, SX, SX, dict[str, SX]]:
        """Filter after the ranges of all beacons, whether an aid vehicle heard it, and what came.

        The covariance is packed.
        """
        scenario, filtering = self.scenario, self.scenario.estimator
        has, m = Features.of(scenario), len(scenario.filter_states)
        P = pack(P)
        ranges, bearings, heard = [], [], ca.SX(0.0)
        for b, beacon in enumerate(scenario.beacons):
            seen, told = self._true(b, own), self._told(b, own)
            came = self._came(b, truth, seen, own)
            z = self._range(b, truth, seen, own)
            update = partial(filtering.update, sensor=scenario.filter_sensor, beacon=told)
            ranged, ranged_P = update(x, unpack(P, m), z)
            if has.repeated:
                again = partial(ca.if_else, own.repeated[b])
                twice, twice_P = update(ranged, ranged_P, z)
                ranged, ranged_P = again(twice, ranged), again(twice_P, ranged_P)
            if has.bearing:
                sensor = scenario.bearing_sensor
                bearing = sensor.measure(truth, seen) + sensor.sigma * own.bearing_error[b]
                ranged, ranged_P = filtering.update(ranged, ranged_P, bearing, sensor, told)
                bearings.append(ca.if_else(came, bearing, np.nan))
            pinged = partial(ca.if_else, came)
            x, P = pinged(ranged, x), pinged(pack(ranged_P), P)
            ranges.append(pinged(z, np.nan))
            if beacon.carrier is not None:
                heard = came if len(scenario.beacons) == 1 else ca.fmax(heard, came)
        found = {"range": ca.vertcat(*ranges), "bearing": ca.vertcat(ca.SX(0, 1), *bearings)}
        return x, P, heard, found

    def _range(self, b: int, truth: SX, beacon: SX, own: Own) -> SX:
        """The range that an instrument gives, never negative; a squared range as the thesis has it.

        A squared range is below zero where its Gaussian error makes it so.
        """
        sensor, count = self.scenario.range_sensor, len(self.scenario.beacons)
        error = sensor.deviation(truth, beacon) * own.range_error[b]
        z = sensor.measure(truth, beacon) + error
        if Features.of(self.scenario).false:
            z = z * (1 + own.false[count + b]) + own.false[b]
        return ca.fabs(z) if isinstance(sensor, Range) else z

    def _came(self, b: int, truth: SX, beacon: SX, own: Own) -> SX:
        """Whether a range was due, and was not lost."""
        has = Features.of(self.scenario)
        if not has.lossy:
            return own.ping[b]
        law = law_of(law_told(self.scenario.range_sensor, self.scenario.table.ranging))
        r2 = ca.sumsqr(truth[:2] - beacon[:2])
        if has.deep:
            r2 += (beacon[7] - beacon[6]) ** 2
        return ca.logic_and(own.ping[b], own.chance[b] < arrival(law, r2))

    def _true(self, b: int, own: Own) -> SX:
        """A beacon as it is, of the AUV's true depth and water (`BEACON`)."""
        depth = own.depth if Features.of(self.scenario).deep else ca.SX(0.0)
        varying = Features.of(self.scenario).varying
        current = own.water if varying else ca.DM(self.scenario.water.current)
        return ca.vertcat(self.fleet.beacons[b], depth, current)

    def _told(self, b: int, own: Own) -> SX:
        """A beacon as the AUV takes it, of the depth it measures and the water it counts on."""
        deep = Features.of(self.scenario).deep
        depth = own.depth + own.depth_error if deep else ca.SX(0.0)
        return ca.vertcat(self.fleet.beacons[b], depth, *self.kind.current)
