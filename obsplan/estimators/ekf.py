"""Extended Kalman filter, as CasADi expressions; Jacobians by differentiation."""

from dataclasses import dataclass

import casadi as ca

from obsplan.estimators.gaussian import Function, GaussianFilter, Linear, tangent


@dataclass(frozen=True, kw_only=True)
class Ekf(GaussianFilter):
    """Extended Kalman filter: functions are their tangents at the mean."""

    def linearize(self, f: Function, x: ca.SX, P: ca.SX) -> Linear:  # noqa: ARG002 - tangents
        """Tangent at the mean."""
        return tangent(f, x)
