"""Refuse options out of their range, by name, value and unit."""

from typing import Any

import numpy as np

from obsplan.quantities import check_quantities


def check_positive(planner: object, **units: str) -> None:
    """Refuse a field that is not positive and finite; None passes.

    ``units`` names each field with its unit.

    Raises
    ------
    ValueError
        Naming the field, its unit and the value.
    """
    for name, unit in units.items():
        value = getattr(planner, name)
        if value is not None and not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive and finite [{unit}], got {value}")


def check_situation(planner: Any) -> None:
    """Refuse what is given in place of the situation, such as the vehicle alone.

    Refuse also options out of their ranges, and names that are no choice.

    Raises
    ------
    TypeError
        Naming the planner, what it needs and what it got.
    ValueError
        Naming the field, its range and the value.
    """
    given = planner.situation
    if not hasattr(given, "cna"):
        raise TypeError(
            f"{type(planner).__name__} needs a situation, obsplan.Situation(cna), "
            f"got {type(given).__name__}"
        )
    check_quantities(planner)
