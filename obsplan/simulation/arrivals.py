"""How many ranges were due in a mission, how many came, and how many of these twice."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Integer

from obsplan.run import Run
from obsplan.simulation.features import Features
from obsplan.simulation.inputs import due, faults, streams


class Arrivals(NamedTuple):
    """Ranges in a run, counted."""

    due: Integer[np.ndarray, "beacons auvs"]
    came: Integer[np.ndarray, "beacons auvs"]
    twice: Integer[np.ndarray, "beacons auvs"]  # of those that came

    @classmethod
    def of(cls, run: Run) -> "Arrivals":
        """Those of a run that was flown; its seed says what was due."""
        random = streams(run.seed)
        asked = due(run.scenario, random.schedule).sum(axis=0)
        twice = np.zeros_like(asked)
        if Features.of(run.scenario).repeated:
            _, again = faults(run.scenario, random.faults)
            # steps, AUVs, beacons; a range comes at its step's end
            twice = (again & np.moveaxis(run.came[..., 1:], -1, 0).swapaxes(1, 2)).sum(axis=0).T
        return cls(asked, run.came.sum(axis=-1), twice)

    @staticmethod
    def matter(run: Run) -> bool:
        """Whether some ranges may not come that are due, or come twice."""
        return run.scenario.ranges_may_be_lost or Features.of(run.scenario).repeated

    @staticmethod
    def lost(run: Run) -> Bool[np.ndarray, "beacons auvs samples"]:
        """Which ranges of a run that was flown were due and did not come; at 0 none is due."""
        asked = due(run.scenario, streams(run.seed).schedule)
        found = np.zeros_like(run.came)
        found[..., 1:] = np.moveaxis(asked, 0, -1) & ~run.came[..., 1:]
        return found

    def figures(self, auvs: slice) -> dict[str, int]:
        """Counts of some AUVs, over all beacons."""
        lost = self.due[:, auvs].sum() - self.came[:, auvs].sum()
        return {
            "ranges_due": int(self.due[:, auvs].sum()),
            "ranges_lost": int(lost),
            "ranges_twice": int(self.twice[:, auvs].sum()),
        }
