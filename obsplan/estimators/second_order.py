"""Second-order extended Kalman filter: curvature counts in means and covariances."""

from dataclasses import dataclass

import casadi as ca

from obsplan.estimators.gaussian import Function, GaussianFilter, Linear, hessians
from obsplan.estimators.jacobian import jacobian


@dataclass(frozen=True, kw_only=True)
class SecondOrderEkf(GaussianFilter):
    r"""Modified Gaussian second-order filter.

    Of a function with Jacobian H and Hessians :math:`B_i` of its components, a Gaussian state of
    covariance P has, to the second order of the function,

    .. math:: \mathrm{E}[f_i] = f_i(\hat x) + \tfrac{1}{2} \operatorname{tr}(B_i P), \quad
              \operatorname{cov}[f]_{ij} = (H P H^\top)_{ij}
                                           + \tfrac{1}{2} \operatorname{tr}(B_i P B_j P)

    (Jazwinski 1970, section 9.3; Gelb 1974, section 6.1; Bar-Shalom, Li & Kirubarajan 2001, section
    10.3.2). So a range to a beacon that is closer than the position is sure tells little, and is
    expected to be longer than to the mean. A measurement's own error is that at the mean.
    """

    def linearize(self, f: Function, x: ca.SX, P: ca.SX) -> Linear:
        """Tangent at the mean, moved by half the curvature, whose scatter is an error."""
        bent = [B @ P for B in hessians(f, x)]
        half = ca.vertcat(*(ca.trace(BP) / 2 for BP in bent))
        error = ca.SX(len(bent), len(bent))
        for i, one in enumerate(bent):
            for j, other in enumerate(bent):
                error[i, j] = ca.trace(one @ other) / 2
        return Linear(f(x) + half, jacobian(f, x), error)
