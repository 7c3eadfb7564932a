"""Surveys asked for their motion, and a motion as the table of a survey."""

from typing import Any

import numpy as np
from jaxtyping import Float

from obsplan.surveys import Reference


def asked(survey: Any, speed: float | None, current: Float[np.ndarray, " 2"]) -> Reference:
    """Motion of a survey; a user's class is checked."""
    reference = survey.reference(speed=speed, current=current)
    if not isinstance(reference, Reference):
        raise ValueError(
            f"reference must return an obsplan.Reference, got {type(reference).__name__}; "
            "correct the class"
        )
    return reference


def as_waypoints(reference: Reference) -> dict[str, Any]:
    """Table of the survey that has a reference's vertices and holds.

    It has speeds where they are the survey's own.
    """
    survey: dict[str, Any] = {"kind": "waypoints", "points": reference.polyline.tolist()}
    if isinstance(reference.speed, np.ndarray):
        survey["speeds"] = reference.speed.tolist()
    if reference.hold is not None:
        survey["holds"] = reference.hold.tolist()
    return survey
