"""Gramians written apart from the library: exact arcs and their Jacobians in numpy, and the variational equations by DOP853.

The unicycle that observes heading and squared range is given twice: as the model a user would hand over, and solved.
"""

import casadi as ca
import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.integrate import solve_ivp


def unicycle(t, x, u, p):  # noqa: ARG001
    return ca.vertcat(ca.cos(x[2]), ca.sin(x[2]), u[0])


def squared_range(t, x, u, p):  # noqa: ARG001
    return ca.vertcat(x[2], x[0] ** 2 + x[1] ** 2)


def arc(x0, u, t):
    """Poses after times t on the exact arc of a unicycle at 1 m/s: (..., times, 3) for states and turn rates (...)."""
    x0, u = x0[..., None, :], np.asarray(u)[..., None]
    half = 0.5 * u * t
    chord, bearing = t * np.sinc(half / np.pi), x0[..., 2] + half
    return np.stack(
        [
            x0[..., 0] + chord * np.cos(bearing),
            x0[..., 1] + chord * np.sin(bearing),
            x0[..., 2] + 2 * half,
        ],
        axis=-1,
    )


def arc_outputs(x0, u, t):
    """Heading and squared range."""
    x = arc(x0, u, t)
    return np.stack([x[..., 2], x[..., 0] ** 2 + x[..., 1] ** 2], axis=-1)


def arc_jacobian(x0, u, t):
    """Derivative of ``arc_outputs`` by x0: (0, 0, 1) and 2 (x1, x2, x2 Δ1 - x1 Δ2)."""
    x = arc(x0, u, t)
    x1, x2 = x[..., 0], x[..., 1]
    d1, d2 = x1 - x0[..., None, 0], x2 - x0[..., None, 1]
    heading = np.broadcast_to(np.eye(3)[2], (*x1.shape, 3))
    return np.stack([heading, 2 * np.stack([x1, x2, x2 * d1 - x1 * d2], axis=-1)], axis=-2)


def integral(jacobian, horizon, weight=None):
    """∫ J' R^(-1) J dt by 40 Gauss-Legendre points: J analytic, so exact to rounding."""
    nodes, weights = leggauss(40)
    J = jacobian(horizon * (nodes + 1) / 2)
    return np.einsum(
        "t,tai,ab,tbj->ij",
        weights * horizon / 2,
        J,
        np.eye(J.shape[1]) if weight is None else weight,
        J,
    )


def variational_gramian(f, f_x, h_x, x0, horizon, *, t0=0.0, weight=None):
    """Integrate state, sensitivities and W together: f(t, x), f_x(t, x), h_x(t, x) in numpy; weight = R^(-1)."""
    n = len(x0)

    def rate(t, z):
        x, Phi = z[:n], z[n : n + n * n].reshape(n, n)
        J = h_x(t, x) @ Phi
        return np.concatenate(
            [
                f(t, x),
                (f_x(t, x) @ Phi).ravel(),
                (J.T @ J if weight is None else J.T @ weight @ J).ravel(),
            ]
        )

    z0 = np.concatenate([x0, np.eye(n).ravel(), np.zeros(n * n)])
    return (
        solve_ivp(rate, (t0, t0 + horizon), z0, method="DOP853", rtol=1e-12, atol=1e-13)
        .y[-n * n :, -1]
        .reshape(n, n)
    )


def slope(sizes, errors):
    """Order of convergence: the least-squares slope of log error against log size."""
    return np.polyfit(np.log(sizes), np.log(errors), 1)[0]
