"""The mathematics of range-only observability: arrays and CasADi expressions in, solutions out.

Names below load on first use, so that importing the package costs nothing.
"""

from importlib import import_module
from typing import Any

_HOME = {
    "ExactGramian": "gramian",
    "METRICS": "metrics",
    "PathInertiaProblem": "path_inertia",
    "Solution": "solution",
    "Status": "solution",
    "blend": "metrics",
    "circle_center": "path_inertia",
    "condition_number": "metrics",
    "curvature_condition_number": "path_inertia",
    "displacement_moments": "gramian.range",
    "empirical_gramian": "gramian",
    "exact_gramian": "gramian",
    "gramian_entries": "gramian.range",
    "inertia_condition_number": "path_inertia",
    "lateral_offset": "path_inertia",
    "log_det": "metrics",
    "longitudinal_offset": "path_inertia",
    "path_inertia_curvature": "path_inertia",
    "path_inertia_radius": "path_inertia",
    "InformationBound": "cramer_rao",
    "information_bound": "cramer_rao",
    "path_information": "cramer_rao",
    "position_rms": "cramer_rao",
    "position_schur_complement": "metrics",
    "position_schur_expression": "metrics",
    "posterior_cramer_rao": "cramer_rao",
    "quadrature_weights": "gramian",
    "radius_threshold": "path_inertia",
    "range_gramian_function": "gramian.range",
    "range_gramians": "gramian.range",
    "range_information": "cramer_rao",
    "range_score_expression": "gramian.range",
    "score": "metrics",
    "score_expression": "metrics",
    "smallest_eigenvalue": "metrics",
    "squared_range_information": "cramer_rao",
    "trace_inverse": "metrics",
    "unobservability_index": "metrics",
    "unobservable_direction": "metrics",
    "CircleVerdict": "ltv",
    "circle_gramian": "ltv",
    "fixed_auv_rate": "ltv",
    "fixed_cna_rate": "ltv",
    "ltv_gramian": "ltv",
    "output_map": "ltv",
    "recover_initial_state": "ltv",
    "transition_matrix": "ltv",
    "unobservable_subspace": "ltv",
    "validate_circle": "ltv",
}

__all__ = sorted(_HOME)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    """Load a public name from the module that defines it."""
    if name not in _HOME:
        raise AttributeError(f"module 'formulations' has no public name {name!r}")
    return getattr(import_module(f"formulations.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return [*__all__]
