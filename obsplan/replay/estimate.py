"""The filters of AUVs on a tape, event by event."""

from dataclasses import replace

import numpy as np

from obsplan.estimators.filter import Filter, Outcome
from obsplan.fates import Fate
from obsplan.replay.estimates import Estimates
from obsplan.scenario import Scenario
from obsplan.scenario.states import first_covariance, first_mean
from obsplan.sensors import BEACON, Sensor
from obsplan.tape import Tape

BEARING = "bearing"  # name of the sensor of bearings on a tape


def estimate(tape: Tape, scenario: Scenario, *, first: np.ndarray | None = None) -> Estimates:
    """Filter what AUVs moved and measured, as the scenario's filter does.

    A range between two AUVs is taken from where the other's filter is then, with its covariance;
    that what both know is not independent is neglected.

    Parameters
    ----------
    first
        First means, auvs x m; default: the scenario's, which then must be given and not drawn.
    """
    return _Replay(tape, scenario, first).estimates()


class _Replay:
    """Filters on their way through a tape."""

    def __init__(self, tape: Tape, scenario: Scenario, first: np.ndarray | None) -> None:
        self.tape, self.scenario = tape, scenario
        self.filters = self._filters(first)
        count, samples = tape.measurements.value.size, tape.time.size
        auvs, m = len(tape.auvs), len(scenario.filter_states)
        self.fate = np.full(count, int(Fate.ACCEPTED))
        self.innovation, self.variance = np.full((2, count), np.nan)
        self.mean = np.empty((auvs, samples, m))
        self.covariance = np.empty((auvs, samples, m, m))
        self.fitting = np.ones((auvs, samples))
        self.seen: dict[tuple[int, int], tuple[float, float]] = {}
        self.taken: dict[tuple[int, int], bool] = {}
        self.sensors = [self._sensor(name, one) for name, one in tape.sensors.items()]

    def _filters(self, first: np.ndarray | None) -> list[Filter]:
        scenario, auvs = self.scenario, len(self.tape.auvs)
        nothing = np.zeros((auvs, len(scenario.truth_states)))
        means = first_mean(scenario, nothing, nothing) if first is None else first
        covariances = first_covariance(scenario, scenario.filter_states)
        filtering = scenario.filtering(scenario.hypotheses)
        filtering = replace(filtering, beacons=len(self.tape.beacons) + auvs)
        return [
            Filter(
                filtering=filtering,
                process=lambda dt, i=i: scenario.filter_process(i, dt),
                mean=means[i].copy(),
                covariance=covariances[i],
            )
            for i in range(auvs)
        ]

    def _sensor(self, name: str, sensor: Sensor) -> Sensor:
        """What the filter takes a sensor of the tape for; of ranges, without its beacon."""
        if name == BEARING:
            return self.scenario.bearing_sensor or sensor
        if name == next(iter(self.tape.sensors)):
            return self.scenario.filter_sensor
        logs = zip(self.scenario.true_logs, self.scenario.filter_logs, strict=True)
        for true, assumed in logs:
            if sensor in true:
                return assumed[true.index(sensor)]
        return sensor

    def estimates(self) -> Estimates:
        """All of them."""
        tape, rows = self.tape, self.tape.measurements
        ends = np.searchsorted(rows.received, tape.time, side="right")
        begin = 0
        for k, end in enumerate(ends.tolist()):
            if k:
                self._move(k)
            for row in range(begin, end):
                self._take(row, k)
            ranged = {*rows.auv[begin:end][rows.beacon[begin:end] >= 0].tolist()}
            for i in ranged:
                self.filters[i].tidy()
            begin = end
            for i, one in enumerate(self.filters):
                self.mean[i, k], self.covariance[i, k] = one.mean, one.covariance
                self.fitting[i, k] = self.fitting[i, k - 1] if k else 1
                if i in ranged:
                    self.fitting[i, k] = one.fitting
        return Estimates(
            time=tape.time,
            mean=self.mean,
            covariance=self.covariance,
            fate=self.fate,
            innovation=self.innovation,
            innovation_variance=self.variance,
            hypotheses=self.fitting,
        )

    def _move(self, k: int) -> None:
        """Dead reckoning to sample k, and what the vehicles measure of themselves there."""
        tape, scenario = self.tape, self.scenario
        dt = float(tape.time[k] - tape.time[k - 1])
        compass = scenario.as_filtered(scenario.heading_sensor)
        for i, one in enumerate(self.filters):
            u = (tape.turn[i, k - 1], tape.change_of_speed[i, k - 1], tape.sway[i, k - 1])
            one.predict(np.array(u), dt)
            told = self._about(i, k)
            if np.isfinite(heading := tape.heading[i, k - 1]):
                one.update(heading, compass, told)
            if (gauge := scenario.depth_gauge) is not None and np.isfinite(tape.depth[i, k]):
                one.update(tape.depth[i, k], gauge, told)

    def _about(self, i: int, k: int) -> np.ndarray:
        """`BEACON` of a measurement that concerns no other: depth and current."""
        told = np.zeros(len(BEACON))
        told[BEACON.index("auv_depth")] = self.tape.depth[i, k]
        told[BEACON.index("east_current") :] = self.scenario.assumed_currents[i]
        return told

    def _take(self, row: int, k: int) -> None:
        """A measurement at sample k."""
        rows = self.tape.measurements
        i, beacon, number = int(rows.auv[row]), int(rows.beacon[row]), int(rows.sensor[row])
        z, one = float(rows.value[row]), self.filters[i]
        if beacon < 0:
            one.update(z, self.sensors[number], rows.told[row])
            return
        sensor = self.scenario.as_filtered(self.sensors[number], beacon)
        name = [*self.tape.sensors][number]
        if name == BEARING:
            if self.taken.get((i, beacon), True):
                one.update(z, sensor, rows.told[row])
            return
        outcome = self._ranged(row, k, sensor)
        self.fate[row] = outcome.fate
        self.innovation[row], self.variance[row] = outcome.innovation, outcome.variance
        if outcome.fate != Fate.DUPLICATE:
            self.taken[i, beacon] = Fate(outcome.fate).taken

    def _ranged(self, row: int, k: int, sensor: Sensor) -> Outcome:
        """A range, which is none if it came before."""
        rows = self.tape.measurements
        i, beacon, z = int(rows.auv[row]), int(rows.beacon[row]), float(rows.value[row])
        came = float(rows.received[row]), z
        if self.scenario.table.estimator.gate and self.seen.get((i, beacon)) == came:
            return Outcome(int(Fate.DUPLICATE), np.nan, np.nan)
        self.seen[i, beacon] = came
        told, more = rows.told[row], 0.0
        if beacon >= len(self.tape.beacons):
            told, more = self._other(i, beacon - len(self.tape.beacons), k)
        sigma = float(rows.sigma[row])
        return self.filters[i].range(z, sensor, told, beacon, sigma=sigma, more=more)

    def _other(self, i: int, j: int, k: int) -> tuple[np.ndarray, float]:
        """Another AUV as the beacon of AUV i, and the variance of its place along the line."""
        own, other = self.filters[i], self.filters[j]
        told = self._about(i, k)
        told[:3] = other.mean[:3]
        told[BEACON.index("depth")] = self.tape.depth[j, k]
        line = other.mean[:2] - own.mean[:2]
        length = max(float(np.hypot(*line)), 1e-6)
        line = line / length
        P = other.covariance
        along = P[0, 0] * line[0] ** 2 + 2 * P[0, 1] * line[0] * line[1] + P[1, 1] * line[1] ** 2
        return told, float(along)
