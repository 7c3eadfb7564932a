"""Attributes of variables by the CF conventions."""

from typing import Any

import numpy as np

Variables = dict[str, tuple[tuple[str, ...], np.ndarray, dict[str, Any]]]


def quantity(units: str, long_name: str, standard_name: str | None = None) -> dict[str, Any]:
    """What a variable is, in which unit, and its standard name if it has one."""
    return {"long_name": long_name, "units": units} | (
        {"standard_name": standard_name} if standard_name else {}
    )


def latitude(long_name: str) -> dict[str, Any]:
    """What a latitude is."""
    return quantity("degrees_north", long_name, "latitude")


def longitude(long_name: str) -> dict[str, Any]:
    """What a longitude is."""
    return quantity("degrees_east", long_name, "longitude")
