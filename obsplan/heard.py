"""What aid vehicles hear of the AUVs in a mission: reach, age of the newest report, throughput."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from formulations.model.casadi import SX, Elementwise
from formulations.model.ranging import throughput
from obsplan.scenario import Scenario
from obsplan.scenario.communication import SILENT


class Heard(NamedTuple):
    """Of each AUV at each sample; None where there is nothing to say."""

    in_reach: Bool[np.ndarray, "auvs samples"] | None  # within ranging.reach
    age: Float[np.ndarray, "auvs samples"] | None  # of the newest report [s]
    throughput: Float[np.ndarray, "auvs samples"] | None  # [bit/s]

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        truth: Float[np.ndarray, "auvs samples n"],
        beacons: Float[np.ndarray, "beacons samples 2"],
        reports: Bool[np.ndarray, "auvs samples"],
    ) -> "Heard":
        """What is heard where AUVs and beacons are, of reports by when they were made.

        The nearest beacon that an aid vehicle carries is the one that hears.
        """
        communication, reach = scenario.communication, scenario.table.ranging.reach
        r2 = nearest2(scenario, truth, beacons)
        silent = communication.reports == SILENT
        age = None if silent else ages(reports, scenario.time, scenario.late)
        rate = None
        if communication.throughput is not None:
            per_half = 1 / (communication.throughput_half_distance or np.inf)
            (share,) = _SHARE(r2, per_half, 1 / (reach or np.inf))
            rate = communication.throughput * share
        return cls(None if reach is None else r2 <= reach**2, age, rate)

    def figures(self, auvs: slice) -> dict[str, float]:
        """Figures of merit of some AUVs, over time: a share, ages [s] and a throughput [bit/s]."""
        found = {}
        if self.in_reach is not None:
            found["in_reach"] = self.in_reach[auvs].mean()
        if self.age is not None:
            age = self.age[auvs]
            found["report_age_mean_s"] = age.mean()
            found["report_age_p95_s"] = np.percentile(age, 95)
            found["report_age_max_s"] = age.max()
        if self.throughput is not None:
            found["throughput_mean_bit_s"] = self.throughput[auvs].mean()
        return found


def nearest2(
    scenario: Scenario,
    truth: Float[np.ndarray, "auvs samples n"],
    beacons: Float[np.ndarray, "beacons samples 2"],
) -> Float[np.ndarray, "auvs samples"]:
    """Squared distance [m^2] to the nearest beacon on an aid vehicle; over depths if they count."""
    nearest = np.full(truth.shape[:2], np.inf)
    for beacon, place in zip(scenario.beacons, beacons, strict=True):
        if beacon.carrier is None:
            continue
        r2 = ((truth[..., :2] - place) ** 2).sum(axis=-1)
        if scenario.depths_count:
            r2 += (scenario.depths.T - beacon.depth) ** 2
        np.minimum(nearest, r2, out=nearest)
    return nearest


def ages(
    reports: Bool[np.ndarray, "auvs samples"], time: Float[np.ndarray, " samples"], late: int
) -> Float[np.ndarray, "auvs samples"]:
    """How long ago [s] the newest report that has arrived was made, each ``late`` by some samples.

    The first estimate is known from time 0 on, as if reported then.
    """
    samples = time.size
    made = np.where(reports, np.arange(samples), 0)
    newest = np.zeros_like(made)
    newest[:, late:] = np.maximum.accumulate(made, axis=1)[:, : max(samples - late, 0)]
    return time - time[newest]


def _share(r2: SX, per_half_distance: SX, per_reach: SX) -> list[SX]:
    return [throughput(r2, per_half_distance, per_reach)]


_SHARE = Elementwise(_share)
