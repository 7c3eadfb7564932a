"""The closed loop: truth, noise, estimate, plan. The only place where they meet."""

from obsplan.simulation.loop import ClosedLoop, simulate
from obsplan.simulation.taped import to_tape

__all__ = ["ClosedLoop", "simulate", "to_tape"]
