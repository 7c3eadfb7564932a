"""One AUV over a time step, as expressions: its truth, what it measures, its filter, its report."""

from typing import NamedTuple

import casadi as ca
import numpy as np

from formulations.model.casadi import SX
from formulations.model.covariance import pack
from formulations.model.ranging import Ranging, arrival, law_of
from obsplan.estimators.filtering import Filtering, Memory, Seen, Taken, chosen, is_taken
from obsplan.scenario import Scenario
from obsplan.scenario.beacons import law_told
from obsplan.scenario.communication import SILENT
from obsplan.scenario.states import BASIC
from obsplan.sensors import Range
from obsplan.simulation.doubt import NEWEST, unexplained
from obsplan.simulation.features import Features
from obsplan.simulation.listening import Listening, apart2
from obsplan.simulation.own import Kind, Own

# what becomes of a range, as the loop's log names it
LOGGED = {"fate": "fate", "innovation": "innovation", "variance": "innovation_variance"}


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
    filtering: Filtering

    def step(self, own: Own) -> dict[str, SX]:
        """State, filter, report, ranges and bearings at the step's end."""
        scenario, filtering = self.scenario, self.filtering
        process = self.kind.process
        # the autopilot brings heading and speed back to the survey's, and measures what it did
        u = own.steer - own.truth[2:BASIC]
        vehicle = self.kind.vehicle
        after = vehicle.step(own.truth, u, scenario.table.time_step) + own.disturbance
        held = filtering.memory(own.mean, own.covariance, own.bank, own.misses)
        commanded = scenario.table.estimator.motion == "commanded"
        told = own.steer - own.survey[2:BASIC] if commanded else u
        held = filtering.predicted(held, told, process)
        nowhere = self._told(0, own)
        heading = scenario.heading_sensor.measure(after, nowhere) + own.heading_error
        compass = scenario.as_filtered(scenario.heading_sensor)
        held = filtering.observed(held, Seen(heading, compass, nowhere))
        if (gauge := scenario.depth_gauge) is not None:
            depth = own.depth + own.depth_error
            held = filtering.observed(held, Seen(depth, gauge, nowhere))
        if self.kind.logs:
            held = self._logged(after, held, own)
        held, excess, heard, measured = self._ranged(after, held, own)
        x, P = filtering.moments(held)
        packed = pack(P)
        known = Listening(scenario, self.kind, self.fleet.beacons).step(
            own, ca.vertcat(x, packed, excess), heard
        )
        found = {"truth": after, "mean": x, "covariance": packed, "excess": excess}
        found |= {"bank": filtering.bank(held), "misses": held.misses, "report": heard}
        return measured | known | found

    def _logged(self, truth: SX, held: Memory, own: Own) -> Memory:
        """What the filter holds after its speed was measured, where it was."""
        seen, told = self._true(0, own), self._told(0, own)
        after = held
        for k, (true, assumed) in enumerate(self.kind.logs):
            z = true.measure(truth, seen) + true.deviation(truth, seen) * own.log_error[k]
            after = self.filtering.observed(after, Seen(z, assumed, told))
        return chosen(own.log, after, held)

    def _ranged(self, truth: SX, held: Memory, own: Own) -> tuple[Memory, SX, SX, dict[str, SX]]:
        """What the filter holds after the ranges of all beacons, and what came.

        Between them the excess of innovations, and whether an aid vehicle heard the AUV.
        """
        scenario, filtering, has = self.scenario, self.filtering, Features.of(self.scenario)
        ranges, bearings, fates, heard, excess = [], [], [], ca.SX(0.0), own.excess
        for b, beacon in enumerate(scenario.beacons):
            seen = self._true(b, own)
            came = self._came(b, truth, seen, own)
            ranged = self._seen(b, truth, own)
            if has.doubted:
                newest = unexplained(filtering.estimator, *filtering.moments(held), *ranged)
                excess = ca.if_else(came, excess + NEWEST * (newest - excess), excess)
            held, taken = filtering.ranged(held, ranged, b, came)
            if has.repeated and not filtering.gate:
                again, _ = filtering.ranged(held, ranged, b, came)
                held = chosen(own.repeated[b], again, held)
            for bearing in self._bearing(b, truth, own):
                believed = ca.logic_and(came, is_taken(taken.fate))
                held = chosen(believed, filtering.observed(held, bearing), held)
                bearings.append(ca.if_else(came, bearing.z, np.nan))
            ranges.append(ca.if_else(came, ranged.z, np.nan))
            fates.append([ca.if_else(came, one, np.nan) for one in taken])
            if beacon.carrier is not None:
                reported = self._reported(b, came, truth, seen, own)
                heard = reported if len(scenario.beacons) == 1 else ca.fmax(heard, reported)
        measured = {"range": ca.vertcat(*ranges), "bearing": ca.vertcat(ca.SX(0, 1), *bearings)}
        for name, column in zip(Taken._fields, zip(*fates, strict=True), strict=True):
            measured[LOGGED[name]] = ca.vertcat(*column)
        return held, excess, heard, measured

    def _seen(self, b: int, truth: SX, own: Own) -> Seen:
        """The range of a beacon as the filter takes it."""
        z = self._range(b, truth, self._true(b, own), own)
        return Seen(
            z, self.scenario.as_filtered(self.scenario.filter_sensor, b), self._told(b, own)
        )

    def _bearing(self, b: int, truth: SX, own: Own) -> tuple[Seen, ...]:
        """The bearing that comes with it, if one does."""
        sensor = self.scenario.bearing_sensor
        if sensor is None:
            return ()
        z = sensor.measure(truth, self._true(b, own)) + sensor.sigma * own.bearing_error[b]
        return (Seen(z, self.scenario.as_filtered(sensor, b), self._told(b, own)),)

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
