"""Path inertia: closed forms, the same as convex programs, and their solvers."""

from formulations.path_inertia.closed_form import (
    circle_center,
    curvature_condition_number,
    inertia_condition_number,
    lateral_offset,
    longitudinal_offset,
    path_inertia_curvature,
    path_inertia_radius,
    radius_threshold,
)
from formulations.path_inertia.problem import PathInertiaProblem

__all__ = [
    "PathInertiaProblem",
    "circle_center",
    "curvature_condition_number",
    "inertia_condition_number",
    "lateral_offset",
    "longitudinal_offset",
    "path_inertia_curvature",
    "path_inertia_radius",
    "radius_threshold",
]
