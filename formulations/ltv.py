"""Observability of the linear time-varying systems of single-beacon navigation.

At the end: what python-control says of it on a circle.

State (east, north [m], east and north velocity [m/s]): a position relative to the other vehicle and
a current that must be estimated too. The output is the squared range, linearised about a nominal
path p(t) (thesis 3.1, 3.2, 3.8, 3.9).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.polynomial.legendre import leggauss
from scipy.integrate import simpson

EPS = float(np.finfo(float).eps)  # spacing of doubles at 1
# (3.2), (3.9): a position and its constant velocity
A = np.kron([[0.0, 1.0], [0.0, 0.0]], np.eye(2))
INTERVALS_PER_TURN = 1000  # of Simpson's rule: error below 1e-10 of the Gramian; even
NODES_PER_TURN = 12  # of Gauss and Legendre's rule: t² cos 2ωt to rounding
# Of python-control's one-sided differences. The mean of both sides is the slope of a square for any
# displacement, and a large one rounds least.
EPSILON = 1e-3
TOLERANCES = {"rtol": 1e-13, "atol": 1e-12}  # of python-control's simulation by DOP853


def fixed_cna_rate(
    x: Float[np.ndarray, "4"], heading: float, speed: float
) -> Float[np.ndarray, "4"]:
    """Return dx/dt of the AUV about a CNA at the origin (3.1).

    x = (position, current); the AUV swims at speed V on heading ψ.
    """
    return A @ x + np.array([speed * np.cos(heading), speed * np.sin(heading), 0.0, 0.0])


def fixed_auv_rate(
    r: Float[np.ndarray, "4"], heading: float, speed: float
) -> Float[np.ndarray, "4"]:
    """Return dr/dt of a still AUV relative to the CNA as the CNA moves (3.8).

    r = (position, difference of the two currents).

    The thesis prints ṙ = −ẋ + r3, which counts the current of the CNA twice; with (3.1) and (3.7)
    it is ṙ = −u + ΔW.
    """
    return A @ r - np.array([speed * np.cos(heading), speed * np.sin(heading), 0.0, 0.0])


def transition_matrix(time: Float[np.ndarray, "*batch"]) -> Float[np.ndarray, "*batch 4 4"]:
    """Return Φ(t) = exp(A t) = I + A t (3.3), (3.10)."""
    return np.eye(4) + A * np.asarray(time)[..., None, None]


def output_matrix(position: Float[np.ndarray, "*batch 2"]) -> Float[np.ndarray, "*batch 1 4"]:
    """Return C(t) = [2p1 2p2 0 0] (3.2), (3.9).

    It is the derivative of the squared range at the nominal position.
    """
    return np.concatenate([2 * position, np.zeros_like(position)], axis=-1)[..., None, :]


def output_map(
    time: Float[np.ndarray, " samples"], position: Float[np.ndarray, "samples 2"]
) -> Float[np.ndarray, "samples 4"]:
    """Return C(t) Φ(t) per sample: the output of an initial state, with no input (2.3).

    Raises ValueError unless there are two samples or more, at increasing times.
    """
    if len(time) < 2 or not (np.diff(time) > 0).all():
        raise ValueError(
            f"time must hold at least 2 increasing instants [s], got {len(time)}: "
            f"{np.array2string(np.asarray(time), threshold=6)}"
        )
    return (output_matrix(position) @ transition_matrix(time - time[0]))[..., 0, :]


def ltv_gramian(
    time: Float[np.ndarray, " samples"], position: Float[np.ndarray, "samples 2"]
) -> Float[np.ndarray, "4 4"]:
    r"""Return the local observability Gramian along any sampled path.

    .. math:: P(T) = \int_0^T \Phi^\top C^\top C \Phi \, dt = 4 \int_0^T
              \begin{bmatrix} p p^\top & t\,p p^\top \\ t\,p p^\top & t^2 p p^\top \end{bmatrix} dt

    Thesis (3.4) with p = x, the AUV about a fixed CNA, and (3.11) with p = r = −x, a CNA about a
    still AUV: the same matrix. By Simpson's rule: error O(h⁴) on smooth paths.
    """
    rows = output_map(time, position)
    return np.asarray(simpson(rows[:, :, None] * rows[:, None, :], x=time, axis=0))


def recover_initial_state(
    time: Float[np.ndarray, " samples"],
    position: Float[np.ndarray, "samples 2"],
    output: Float[np.ndarray, " samples"],
) -> Float[np.ndarray, "4"]:
    r"""Return the initial state of the zero-input response (2.6).

    .. math:: x(0) = P^{-1} \int \Phi^\top C^\top y \, dt

    Raises ValueError where the Gramian is singular: by Theorem 1 the output does not tell.
    """
    hidden = unobservable_subspace(time, position)
    if hidden.size:
        raise ValueError(
            f"the path leaves {hidden.shape[1]} of 4 directions unobservable; "
            "curve the path before recovering a state"
        )
    correlation = simpson(output_map(time, position) * output[:, None], x=time, axis=0)
    return np.linalg.solve(ltv_gramian(time, position), correlation)


def unobservable_subspace(
    time: Float[np.ndarray, " samples"], position: Float[np.ndarray, "samples 2"]
) -> Float[np.ndarray, "4 hidden"]:
    """Return a basis of the initial states v with C(t) Φ(t) v = 0 at every sample (2.8).

    The basis is columns; there are none where the state is observable.

    Adding any of them to an initial state leaves the linear output as it was (Theorem 1). Rank by
    singular values of CΦ itself, not of its square the Gramian, with time in units of the duration
    so that seconds and metres weigh alike.
    """
    rows = output_map(time, position)
    duration = time[-1] - time[0]
    scale = np.array([1.0, 1.0, 1 / duration, 1 / duration])
    rows = rows * scale
    _, singular, vectors = np.linalg.svd(rows, full_matrices=len(rows) < 4)
    rank = int(np.sum(singular > max(rows.shape) * EPS * singular[0])) if singular[0] > 0 else 0
    return scale[:, None] * vectors[rank:].T


def circle_gramian(radius: float, rate: float, duration: float) -> Float[np.ndarray, "4 4"]:
    r"""Return the Gramian on p(t) = R (cos ωt, sin ωt) in closed form.

    .. math:: \int_0^T t^k p p^\top dt = \tfrac{R^2}{2} \Bigl( \tfrac{T^{k+1}}{k+1} I +
              \begin{bmatrix} \Re E_k & \Im E_k \\ \Im E_k & -\Re E_k \end{bmatrix} \Bigr), \quad
              E_k = \int_0^T t^k e^{2i\omega t} dt

    Over half and whole turns the position block is 2R²T·I. Digits are lost as (ωT)⁻³ on arcs much
    shorter than a radian. Raises ValueError unless radius and duration are positive and the rate
    [rad/s] is not zero.
    """
    if not (radius > 0 and duration > 0 and abs(rate) > 0):
        raise ValueError(
            f"radius and duration must be positive and rate not zero, got {radius} m, "
            f"{duration} s, {rate} rad/s"
        )
    turning, end = 2j * rate, np.exp(2j * rate * duration)
    E = (end - 1) / turning
    blocks = []
    for k in range(3):
        if k:
            E = (duration**k * end - k * E) / turning  # by parts
        steady = duration ** (k + 1) / (k + 1) * np.eye(2)
        turned = np.array([[E.real, E.imag], [E.imag, -E.real]])
        blocks.append(2 * radius**2 * (steady + turned))
    return np.block([[blocks[0], blocks[1]], [blocks[1], blocks[2]]])


@dataclass(frozen=True, slots=True, kw_only=True)
class CircleVerdict:
    """Gramians of the circle by every route, and the ranks python-control finds.

    Gramians are of the state (position, velocity).

    ``closed_form`` and ``ours`` (Simpson) are this module's. The others are python-control's, and
    what they share with this module is:

    - ``linearised``: the circle and its closed form to compare with, nothing else. A and C are
      python-control's own linearisation of a nonlinear system, range and motion, along the path
      that it simulates; Φ is by ``c2d``.
    - ``rotating_frame`` (Van Loan by ``c2d``), ``response`` (``initial_response`` and Simpson) and
      ``simulation`` (a time-varying ``nlsys``): A and C themselves, too. They judge Φ and the
      integral. So do the ranks.
    """

    duration: float  # [s]
    closed_form: Float[np.ndarray, "4 4"]
    ours: Float[np.ndarray, "4 4"]
    linearised: Float[np.ndarray, "4 4"]
    rotating_frame: Float[np.ndarray, "4 4"]
    response: Float[np.ndarray, "4 4"]
    simulation: Float[np.ndarray, "4 4"]
    rotating_frame_rank: int  # of ``obsv``: 4, observable
    frozen_time_rank: int  # of ``obsv`` with C(0): 2, the wrong verdict

    @property
    def errors(self) -> dict[str, float]:
        """Largest deviation of each route from the closed form.

        It is relative to each entry's natural size √(Wii Wjj).
        """
        size = np.sqrt(np.outer(np.diag(self.closed_form), np.diag(self.closed_form)))
        routes = ("ours", "linearised", "rotating_frame", "response", "simulation")
        return {
            route: float(np.max(np.abs(getattr(self, route) - self.closed_form) / size))
            for route in routes
        }


def validate_circle(radius: float, rate: float, turns: float) -> CircleVerdict:
    """Ask python-control whether the circle is observable; `CircleVerdict` says what it is told.

    It has no time-varying linear systems. Three ways lead to the right answer: linearising a
    nonlinear system at many instants; the frame turning with the beacon, in which the system is
    exactly time-invariant; and a nonlinear system that carries Φ and W. Testing the rank at a
    frozen time gives 2 of 4 although the system is observable: C changes, and what is hidden now is
    seen later.

    Raises ValueError unless radius [m] and turns are positive and the rate [rad/s] is not zero.
    """
    duration = 2 * np.pi * turns / abs(rate) if rate else 0.0
    closed_form = circle_gramian(radius, rate, duration)
    intervals = 2 * int(np.ceil(INTERVALS_PER_TURN / 2 * max(turns, 1.0)))
    time = np.linspace(0.0, duration, intervals + 1)
    dynamics, output = _rotating_frame(np.sign(rate))
    unit_time = abs(rate) * time
    rotating_frame = _van_loan(dynamics, output, unit_time[-1])
    response = _response_gramian(dynamics, output, unit_time)
    simulation = _simulated_gramian(np.sign(rate), unit_time[-1])
    return CircleVerdict(
        duration=duration,
        closed_form=closed_form,
        ours=ltv_gramian(time, _circle(radius, rate, time)),
        linearised=_in_units(_linearised_gramian(np.sign(rate), unit_time[-1]), radius, rate),
        rotating_frame=_in_units(rotating_frame, radius, rate),
        response=_in_units(response, radius, rate),
        simulation=_in_units(simulation, radius, rate),
        rotating_frame_rank=_observability_rank(dynamics, output),
        frozen_time_rank=_observability_rank(A, output),
    )


def _circle(radius: float, rate: float, time: np.ndarray) -> np.ndarray:
    return radius * np.stack([np.cos(rate * time), np.sin(rate * time)], axis=-1)


def _in_units(W: np.ndarray, radius: float, rate: float) -> np.ndarray:
    """Carry a Gramian of the unit circle at unit rate over to this circle.

    The tools of python-control lose digits in other units.
    """
    scale = np.array([1.0, 1.0, 1 / abs(rate), 1 / abs(rate)])
    return radius**2 / abs(rate) * W * np.outer(scale, scale)


def _control() -> Any:
    """python-control, loaded only when asked: it takes seconds."""
    import control

    return control


def _rotating_frame(rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Return (A + Ω, C) for z = Rot(−ωt) x blockwise, on the unit circle.

    There ż = (A + Ω) z and y = 2 z1, the path being still at (1, 0).
    """
    turning_back = rate * np.array([[0.0, 1.0], [-1.0, 0.0]])
    return A + np.kron(np.eye(2), turning_back), output_matrix(np.array([1.0, 0.0]))


def _observability_rank(dynamics: np.ndarray, output: np.ndarray) -> int:
    return int(np.linalg.matrix_rank(_control().obsv(dynamics, output)))


def _van_loan(dynamics: np.ndarray, output: np.ndarray, duration: float) -> np.ndarray:
    """Gramian by the exponential of [[−Aᵀ, CᵀC], [0, A]] (Van Loan 1978).

    Discretisation of that system computes it.
    """
    n = len(dynamics)
    block = np.block([[-dynamics.T, output.T @ output], [np.zeros((n, n)), dynamics]])
    system = _control().ss(block, np.zeros((2 * n, 1)), np.eye(2 * n), 0)
    exponential = _control().c2d(system, duration).A
    return exponential[n:, n:].T @ exponential[:n, n:]


def _response_gramian(dynamics: np.ndarray, output: np.ndarray, time: np.ndarray) -> np.ndarray:
    """Gramian from the responses to unit initial states."""
    system = _control().ss(dynamics, np.zeros((len(dynamics), 1)), output, 0)
    responses = np.array(
        [_control().initial_response(system, time, x0).outputs for x0 in np.eye(len(dynamics))]
    )
    return np.asarray(simpson(responses[:, None] * responses[None, :], x=time, axis=-1))


def _simulated_gramian(rate: float, duration: float) -> np.ndarray:
    """Gramian as a state of a nonlinear, time-varying system, simulated on the unit circle.

    dΦ/dt = A Φ, dW/dt = (C Φ)ᵀ C Φ
    """

    def rates(t, state, _input, _parameters):
        Phi = state[:16].reshape(4, 4)
        y = output_matrix(_circle(1.0, rate, np.asarray(t))) @ Phi
        return np.concatenate([(A @ Phi).ravel(), (y.T @ y).ravel()])

    system = _control().nlsys(rates, None, states=32, inputs=1)
    start = np.concatenate([np.eye(4).ravel(), np.zeros(16)])
    states = _simulated(system, np.array([0.0, duration]), start)
    return states[16:, -1].reshape(4, 4)


def _linearised_gramian(rate: float, duration: float) -> np.ndarray:
    """Gramian by python-control's linearisation along the path that it simulates."""
    system = _swimmer(rate)
    nodes, weights = leggauss(int(np.ceil(NODES_PER_TURN * (1 + duration / (2 * np.pi)))))
    times = duration * (nodes + 1) / 2
    instants = np.concatenate([[0.0], times, [duration]])
    path = _simulated(system, instants, np.array([1.0, 0.0, 0.0, 0.0]))
    W, Phi = np.zeros((4, 4)), np.eye(4)
    for k, weight in enumerate(weights * duration / 2, start=1):
        ahead, behind = (
            system.linearize(path[:, k], 0.0, t=instants[k], eps=eps) for eps in (EPSILON, -EPSILON)
        )
        dynamics, output = (ahead.A + behind.A) / 2, (ahead.C + behind.C) / 2
        linear = _control().ss(dynamics, np.zeros((4, 1)), output, 0)
        Phi = _control().c2d(linear, instants[k] - instants[k - 1]).A @ Phi
        row = output @ Phi
        W += weight * row.T @ row
    return W


def _swimmer(rate: float) -> Any:
    """Nonlinear system of the unit circle: a swimmer in a current, and its squared range.

    It is written in numbers, apart from (3.1) above, so that python-control has to find A and C.
    """

    def swim(t, state, _input, _parameters):
        east, north = -rate * np.sin(rate * t), rate * np.cos(rate * t)
        return [east + state[2], north + state[3], 0.0, 0.0]

    def squared_range(_t, state, _input, _parameters):
        return state[0] ** 2 + state[1] ** 2

    return _control().nlsys(swim, squared_range, states=4, inputs=1, outputs=1)


def _simulated(system: Any, instants: np.ndarray, start: np.ndarray) -> np.ndarray:
    """States of a system that takes no heed of its input, one column per instant."""
    run = _control().input_output_response(
        system,
        instants[[0, -1]],
        0.0,
        start,
        t_eval=instants,
        solve_ivp_method="DOP853",
        solve_ivp_kwargs=TOLERANCES,
    )
    return run.states
