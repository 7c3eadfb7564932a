"""Surveys: what an AUV is asked to follow over ground. One file each, and one line in `SURVEYS`.

Each kind has `vertices()` and `reference(speed=, current=)`, except `Formation`, whose motion is
`follow(leader)`.
"""

from obsplan.surveys.formation import Formation
from obsplan.surveys.lawnmower import Lawnmower
from obsplan.surveys.reference import Motion, Reference
from obsplan.surveys.static import Static
from obsplan.surveys.waypoints import Waypoints

SURVEYS = {
    "lawnmower": Lawnmower,
    "waypoints": Waypoints,
    "static": Static,
    "formation": Formation,
}

__all__ = ["SURVEYS", "Formation", "Lawnmower", "Motion", "Reference", "Static", "Waypoints"]
