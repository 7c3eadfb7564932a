"""What aid vehicles know of an AUV over a time step, as expressions: its reports, or its survey."""

from functools import partial
from typing import NamedTuple

import casadi as ca

from formulations.model.casadi import SX
from formulations.model.covariance import pack, unpack
from formulations.model.ranging import arrival, law_of
from obsplan.scenario import Scenario
from obsplan.scenario.beacons import law_told
from obsplan.scenario.communication import SILENT
from obsplan.scenario.states import BASIC
from obsplan.sensors import BEACON, Sensor
from obsplan.simulation.features import Features
from obsplan.simulation.own import Kind, Own


def apart2(x: SX, beacon: SX, *, deep: bool) -> SX:
    """Squared distance [m^2] from state x to a beacon, over their depths if these count."""
    r2 = ca.sumsqr(x[:2] - beacon[:2])
    if deep:
        r2 += (beacon[BEACON.index("auv_depth")] - beacon[BEACON.index("depth")]) ** 2
    return r2


class Listening(NamedTuple):
    """The aid vehicles, as one, that listen to an AUV among the beacons at the step's end."""

    scenario: Scenario
    kind: Kind
    beacons: list[SX]

    def step(self, own: Own, report: SX, heard: SX) -> dict[str, SX]:
        """Last report and reports on their way at the step's end.

        ``heard`` says whether a report is made: the filter's mean, packed covariance and excess.
        """
        if self.scenario.communication.reports == SILENT:
            return self._rehearsed(own)
        last = ca.vertcat(own.reported, own.reported_covariance, own.reported_excess)
        known, in_flight = self._reckoned(last, own), ca.SX(0, 1)
        if not own.in_flight.numel():
            known = ca.if_else(heard, report, known)
        else:
            known, in_flight = self._delivered(own, known)
            made = ca.vertcat(report, self.scenario.late)
            pushed = ca.vertcat(made, in_flight[: -made.numel()])
            in_flight = ca.if_else(heard, pushed, in_flight)
        mean, covariance, excess = self._parts(known)
        found = {"reported": mean, "reported_covariance": covariance, "reported_excess": excess}
        return found | {"in_flight": in_flight}

    def _parts(self, report: SX) -> list[SX]:
        """Mean, packed covariance and excess of a report."""
        m = len(self.scenario.filter_states)
        return ca.vertsplit(report, [0, m, m + m * (m + 1) // 2, report.numel()])

    def _delivered(self, own: Own, known: SX) -> tuple[SX, SX]:
        """What is known after reports that are due have arrived, and all that were on their way.

        They are dead-reckoned meanwhile, the newest first.
        """
        moved = []
        for report in ca.vertsplit(own.in_flight, known.numel() + 1):
            reckoned = self._reckoned(report[:-1], own)
            wait = report[-1] - 1
            known = ca.if_else(wait == 0, reckoned, known)
            moved.append(ca.vertcat(reckoned, wait))
        return known, ca.vertcat(*moved)

    def _reckoned(self, report: SX, own: Own) -> SX:
        """A report dead-reckoned over the step: straight on, or as surveyed."""
        mean, packed, excess = self._parts(report)
        along = self.scenario.table.planner.knowledge == "estimate-and-survey"
        turns = own.steer - mean[2:BASIC] if along else ca.SX.zeros(2)
        P = unpack(packed, mean.numel())
        mean, P = self.scenario.estimator.predict(mean, P, turns, self.kind.process)
        return ca.vertcat(mean, pack(P), excess)

    def _rehearsed(self, own: Own) -> dict[str, SX]:
        """The AUV's filter on its survey, with the measurements to be expected and no error.

        That is what an aid vehicle can know which hears nothing: how sure the AUV is. A range that
        may be lost counts by its probability.
        """
        filtering = self.scenario.estimator
        start = ca.vertcat(own.survey[:BASIC], own.reported[BASIC:])
        P = unpack(own.reported_covariance, start.numel())
        turns = own.steer - start[2:BASIC]
        x, P = filtering.predict(start, P, turns, self.kind.process)
        for sensor, beacon, share in self._expected(x, own):
            expected = sensor.measure(x, beacon)
            _, told = filtering.update(x, P, expected, sensor, beacon)
            P = P + share * (told - P)
        return {"reported": x, "reported_covariance": pack(P)} | {
            "in_flight": ca.SX(0, 1),
            "reported_excess": own.reported_excess,
        }

    def _expected(self, x: SX, own: Own) -> list[tuple[Sensor, SX, SX]]:
        """Compass, log, range and bearing sensors, their beacons, and whether they measure.

        That is 1, or 0, or the probability of it.
        """
        scenario, has = self.scenario, Features.of(self.scenario)
        law = law_of(law_told(scenario.planner_sensor, scenario.planner_ranging))
        depth = own.depth if has.deep else ca.SX(0.0)
        seen = [ca.vertcat(b, depth, *self.kind.current) for b in self.beacons]
        found = [(scenario.heading_sensor, seen[0], ca.SX(1.0))]
        found += [(assumed, seen[0], own.log) for _, assumed in self.kind.logs]
        comes = partial(arrival, law)
        for b, beacon in enumerate(seen):
            share = own.ping[b] * comes(apart2(x, beacon, deep=has.deep))
            found.append((scenario.planner_sensor, beacon, share))
            if scenario.bearing_sensor is not None:
                found.append((scenario.bearing_sensor, beacon, share))
        return found
