"""The closed loop: truth, noise, estimate, plan. The only place where they meet."""

from obsplan.simulation.loop import ClosedLoop, simulate

__all__ = ["ClosedLoop", "simulate"]
