"""Vehicle models, one file each, written once as CasADi expressions ``step(x, u, dt)``."""

from obsplan.vehicles.dead_reckoning import DeadReckoning
from obsplan.vehicles.unicycle import Unicycle

VEHICLES = {"unicycle": Unicycle, "dead-reckoning": DeadReckoning}

__all__ = ["VEHICLES", "DeadReckoning", "Unicycle"]
