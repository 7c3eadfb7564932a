"""Vehicle models, one file each, written once as CasADi expressions ``step(x, u, dt)``.

`VEHICLES` are those an AUV may be; the aid vehicle is a `Unicycle`.
"""

from obsplan.vehicles.dead_reckoning import DeadReckoning
from obsplan.vehicles.state import STATES, State, States, Vehicle, check_states
from obsplan.vehicles.unicycle import Unicycle

VEHICLES = {"dead-reckoning": DeadReckoning}

__all__ = [
    "STATES",
    "VEHICLES",
    "DeadReckoning",
    "State",
    "States",
    "Unicycle",
    "Vehicle",
    "check_states",
]
