"""One AUV over a time step, as expressions: its truth, what it measures, its filter, its report."""

from functools import partial
from typing import NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import SX
from formulations.model.covariance import pack, unpack
from formulations.model.ranging import Ranging, arrival, law_of
from obsplan.scenario import Scenario
from obsplan.scenario.beacons import law_told
from obsplan.scenario.communication import SILENT
from obsplan.scenario.states import BASIC
from obsplan.sensors import Range
from obsplan.simulation.doubt import NEWEST, unexplained
from obsplan.simulation.features import Features
from obsplan.simulation.listening import Listening, apart2
from obsplan.simulation.own import Kind, Own


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
        x, P, excess, heard, measured = self._ranged(after, x, P, own)
        known = Listening(scenario, self.kind, self.fleet.beacons).step(
            own, ca.vertcat(x, P, excess), heard
        )
        found = {"truth": after, "mean": x, "covariance": P, "excess": excess, "report": heard}
        return measured | known | found

    def _logged(self, truth: SX, x: SX, P: SX, own: Own) -> tuple[SX, SX]:
        """Filter after its speed was measured, where it was."""
        seen, told = self._true(0, own), self._told(0, own)
        before, before_P = x, P
        for k, (true, assumed) in enumerate(self.kind.logs):
            z = true.measure(truth, seen) + true.deviation(truth, seen) * own.log_error[k]
            x, P = self.scenario.estimator.update(x, P, z, assumed, told)
        return ca.if_else(own.log, x, before), ca.if_else(own.log, P, before_P)

    def _ranged(self, truth: SX, x: SX, P: SX, own: Own) -> tuple[SX, SX, SX, SX, dict[str, SX]]:
        """Filter after the ranges of all beacons, whether an aid vehicle heard it, and what came.

        The covariance is packed; after it comes the excess of innovations.
        """
        scenario, filtering = self.scenario, self.scenario.estimator
        has, m = Features.of(scenario), len(scenario.filter_states)
        P = pack(P)
        ranges, bearings, heard, excess = [], [], ca.SX(0.0), own.excess
        for b, beacon in enumerate(scenario.beacons):
            seen, told = self._true(b, own), self._told(b, own)
            came = self._came(b, truth, seen, own)
            z = self._range(b, truth, seen, own)
            update = partial(filtering.update, sensor=scenario.filter_sensor, beacon=told)
            if has.doubted:
                newest = unexplained(x, unpack(P, m), z, scenario.filter_sensor, told)
                excess = ca.if_else(came, excess + NEWEST * (newest - excess), excess)
            ranged, ranged_P = update(x, unpack(P, m), z)
            if has.repeated:
                again = partial(ca.if_else, own.repeated[b])
                twice, twice_P = update(ranged, ranged_P, z)
                ranged, ranged_P = again(twice, ranged), again(twice_P, ranged_P)
            if (sensor := scenario.bearing_sensor) is not None:
                bearing = sensor.measure(truth, seen) + sensor.sigma * own.bearing_error[b]
                ranged, ranged_P = filtering.update(ranged, ranged_P, bearing, sensor, told)
                bearings.append(ca.if_else(came, bearing, np.nan))
            pinged = partial(ca.if_else, came)
            x, P = pinged(ranged, x), pinged(pack(ranged_P), P)
            ranges.append(pinged(z, np.nan))
            if beacon.carrier is not None:
                reported = self._reported(b, came, truth, seen, own)
                heard = reported if len(scenario.beacons) == 1 else ca.fmax(heard, reported)
        found = {"range": ca.vertcat(*ranges), "bearing": ca.vertcat(ca.SX(0, 1), *bearings)}
        return x, P, excess, heard, found

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
        r2 = apart2(truth, beacon, deep=has.deep)
        return ca.logic_and(own.ping[b], own.chance[b] < arrival(law, r2))

    def _reported(self, b: int, came: SX, truth: SX, beacon: SX, own: Own) -> SX:
        """Whether an aid vehicle hears what the AUV reports with a range."""
        communication, has = self.scenario.communication, Features.of(self.scenario)
        if communication.reports == SILENT:
            return ca.SX(0.0)
        if not has.unheard:
            return came
        half_distance = communication.half_distance or np.inf
        law = law_of(Ranging(1.0, loss=communication.loss, half_distance=half_distance))
        arrives = own.report_chance[b] < arrival(law, apart2(truth, beacon, deep=has.deep))
        return ca.logic_and(came, arrives)

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
