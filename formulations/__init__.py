"""The mathematics of range-only observability: arrays and CasADi expressions in, solutions out.

Names below load on first use, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "Solution": "solution",
    "Status": "solution",
    "circle_center": "path_inertia",
    "curvature_condition_number": "path_inertia",
    "inertia_condition_number": "path_inertia",
    "lateral_offset": "path_inertia",
    "longitudinal_offset": "path_inertia",
    "path_inertia_curvature": "path_inertia",
    "path_inertia_radius": "path_inertia",
    "radius_threshold": "path_inertia",
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module 'formulations' has no public name {name!r}")
    return getattr(import_module(f"formulations.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__]
