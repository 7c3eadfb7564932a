"""The mathematics of range-only observability: arrays and CasADi expressions in, solutions out.

Names below load on first use, so that importing the package costs nothing. They are listed twice:
for Python, and for editors and type checkers, which do not run it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

_HOME = {
    "ExactGramian": "gramian",
    "METRICS": "metrics",
    "SimulatedGramian": "gramian",
    "PathInertiaProblem": "path_inertia",
    "Solution": "solution",
    "Status": "solution",
    "blend": "metrics",
    "choose_input": "gramian",
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
    "Ranging": "model.ranging",
    "best_distance": "model.worth",
    "least_sigma": "model.worth",
    "position_schur_complement": "metrics",
    "relative_motion_index": "metrics",
    "position_schur_expression": "metrics",
    "quadrature_weights": "gramian",
    "radius_threshold": "path_inertia",
    "range_gramian_function": "gramian.range",
    "range_gramians": "gramian.range",
    "range_score_expression": "gramian.range",
    "score": "metrics",
    "score_expression": "metrics",
    "smallest_eigenvalue": "metrics",
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
_HOME |= {  # bounds
    "AidVehicle": "fleet",
    "InformationBound": "certified_bound",
    "JointBound": "joint_paths",
    "OptimalBound": "branch_and_bound",
    "RangedAuv": "fleet",
    "information_bound": "certified_bound",
    "joint_bound": "joint_paths",
    "optimal_bound": "branch_and_bound",
    "path_information": "cramer_rao",
    "position_rms": "cramer_rao",
    "posterior_cramer_rao": "cramer_rao",
    "range_information": "cramer_rao",
    "ranging_information": "cramer_rao",
    "squared_range_information": "cramer_rao",
}

if TYPE_CHECKING:
    from formulations.branch_and_bound import OptimalBound as OptimalBound
    from formulations.branch_and_bound import optimal_bound as optimal_bound
    from formulations.certified_bound import InformationBound as InformationBound
    from formulations.certified_bound import information_bound as information_bound
    from formulations.cramer_rao import path_information as path_information
    from formulations.cramer_rao import position_rms as position_rms
    from formulations.cramer_rao import posterior_cramer_rao as posterior_cramer_rao
    from formulations.cramer_rao import range_information as range_information
    from formulations.cramer_rao import ranging_information as ranging_information
    from formulations.cramer_rao import squared_range_information as squared_range_information
    from formulations.fleet import AidVehicle as AidVehicle
    from formulations.fleet import RangedAuv as RangedAuv
    from formulations.gramian import ExactGramian as ExactGramian
    from formulations.gramian import SimulatedGramian as SimulatedGramian
    from formulations.gramian import choose_input as choose_input
    from formulations.gramian import empirical_gramian as empirical_gramian
    from formulations.gramian import exact_gramian as exact_gramian
    from formulations.gramian import quadrature_weights as quadrature_weights
    from formulations.gramian.range import displacement_moments as displacement_moments
    from formulations.gramian.range import gramian_entries as gramian_entries
    from formulations.gramian.range import range_gramian_function as range_gramian_function
    from formulations.gramian.range import range_gramians as range_gramians
    from formulations.gramian.range import range_score_expression as range_score_expression
    from formulations.joint_paths import JointBound as JointBound
    from formulations.joint_paths import joint_bound as joint_bound
    from formulations.ltv import CircleVerdict as CircleVerdict
    from formulations.ltv import circle_gramian as circle_gramian
    from formulations.ltv import fixed_auv_rate as fixed_auv_rate
    from formulations.ltv import fixed_cna_rate as fixed_cna_rate
    from formulations.ltv import ltv_gramian as ltv_gramian
    from formulations.ltv import output_map as output_map
    from formulations.ltv import recover_initial_state as recover_initial_state
    from formulations.ltv import transition_matrix as transition_matrix
    from formulations.ltv import unobservable_subspace as unobservable_subspace
    from formulations.ltv import validate_circle as validate_circle
    from formulations.metrics import METRICS as METRICS
    from formulations.metrics import blend as blend
    from formulations.metrics import condition_number as condition_number
    from formulations.metrics import log_det as log_det
    from formulations.metrics import position_schur_complement as position_schur_complement
    from formulations.metrics import position_schur_expression as position_schur_expression
    from formulations.metrics import relative_motion_index as relative_motion_index
    from formulations.metrics import score as score
    from formulations.metrics import score_expression as score_expression
    from formulations.metrics import smallest_eigenvalue as smallest_eigenvalue
    from formulations.metrics import trace_inverse as trace_inverse
    from formulations.metrics import unobservability_index as unobservability_index
    from formulations.metrics import unobservable_direction as unobservable_direction
    from formulations.model.ranging import Ranging as Ranging
    from formulations.model.worth import best_distance as best_distance
    from formulations.model.worth import least_sigma as least_sigma
    from formulations.path_inertia import PathInertiaProblem as PathInertiaProblem
    from formulations.path_inertia import circle_center as circle_center
    from formulations.path_inertia import curvature_condition_number as curvature_condition_number
    from formulations.path_inertia import inertia_condition_number as inertia_condition_number
    from formulations.path_inertia import lateral_offset as lateral_offset
    from formulations.path_inertia import longitudinal_offset as longitudinal_offset
    from formulations.path_inertia import path_inertia_curvature as path_inertia_curvature
    from formulations.path_inertia import path_inertia_radius as path_inertia_radius
    from formulations.path_inertia import radius_threshold as radius_threshold
    from formulations.solution import Solution as Solution
    from formulations.solution import Status as Status

else:  # hidden from type checkers, which would take any misspelt name for one that loads
    __all__ = sorted(_HOME)

    def __getattr__(name: str) -> Any:
        """Load a public name from the module that defines it."""
        if name not in _HOME:
            raise AttributeError(f"module 'formulations' has no public name {name!r}")
        return getattr(import_module(f"formulations.{_HOME[name]}"), name)

    def __dir__() -> list[str]:
        return [*__all__]
