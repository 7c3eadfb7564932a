r"""One Gauss-Newton step over all samples at once, by elimination from the last to the first.

The unknowns are the states :math:`x_k` of all samples, of which

.. math:: x_0 = \bar x + L_0 v_0, \quad x_k = f(x_{k-1}, u_k) + L_k v_k

with diagonal :math:`L_k`, and the sum of :math:`|v_k|^2/2` and of the measurements' losses is
least. With measurements linearised about a trajectory the normal equations are block-tridiagonal.
Backward elimination gives what all later measurements say of a state, an information matrix Λ and
vector η, and each :math:`v_k` as a linear function of the state before; forward substitution goes
through the model f itself, so that a new trajectory always moves as the vehicle does. Elements of
:math:`v_k` are eliminated one by one, so that none needs noise, and nothing is inverted. This is
Mayne's differential dynamic programming for least squares (1966), and the smoother of Bell (1994)
run the other way round. The covariances follow by the same recursion, forward.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import casadi as ca
import numpy as np
from jaxtyping import Float

from formulations.model.casadi import evaluate, in_sequence, symbol
from formulations.model.covariance import pack, pack_array, symmetric, unpack, unpack_array
from obsplan.smoothing.model import Model


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What a trajectory is made of besides its noise."""

    first: Float[np.ndarray, " n"]  # prior mean
    controls: Float[np.ndarray, "steps controls"]
    dt: Float[np.ndarray, " steps"]  # [s]
    # standard deviations: of the first estimate, then of what each step adds
    noise: Float[np.ndarray, "samples n"]


@dataclass(frozen=True, kw_only=True)
class Policy:
    """Noise that is best, given what the model says of a sample; of each component in turn."""

    gain: Float[np.ndarray, "samples n n"]  # by component, then by state
    offset: Float[np.ndarray, "samples n"]
    # how much less certain each is without what comes later: its variance is the inverse
    certainty: Float[np.ndarray, "samples n"]


@dataclass(frozen=True)
class Elimination:
    """The recursions of a `Model`, compiled once for each number of samples."""

    model: Model

    def policy(
        self,
        x: Float[np.ndarray, "samples n"],
        motion: Motion,
        information: Float[np.ndarray, "samples n n"],
        vector: Float[np.ndarray, "samples n"],
    ) -> Policy:
        """Eliminate backward what was linearised about a trajectory: Hᵀ R⁻¹ H and Hᵀ R⁻¹ r."""
        n, steps = self.model.size, len(x) - 1
        packed = pack_array(information)
        begin = np.concatenate([packed[-1], vector[-1]])
        backward = slice(None, None, -1)
        given = [
            begin,
            x[:-1][backward],
            x[1:][backward],
            motion.controls[backward],
            motion.dt[backward],
            motion.noise[1:][backward],
            packed[:-1][backward],
            vector[:-1][backward],
        ]
        left, found = np.empty((steps, begin.size)), np.empty((steps, n, n + 2))
        _run(self._backward, steps, given, [left, found])
        last = left[-1] if steps else begin
        _, at_first = self._eliminate(last, motion.noise[0])
        found = np.concatenate([at_first[None], found[backward]])
        return Policy(gain=found[..., :n], offset=found[..., n], certainty=found[..., n + 1])

    def _eliminate(self, last: np.ndarray, noise: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same of the first estimate's errors."""
        n = self.model.size
        left, found = np.empty(last.size), np.empty((n, n + 2))
        evaluate(self._first, [last, noise.copy()], [left, found])
        return left, found

    def trajectory(
        self, x: Float[np.ndarray, "samples n"], motion: Motion, policy: Policy
    ) -> tuple[Float[np.ndarray, "samples n"], Float[np.ndarray, "samples n"]]:
        """The trajectory that follows a policy about the trajectory x, and its noise v."""
        n, steps = self.model.size, len(x) - 1
        begin, noise = np.empty(n), np.empty(n)
        given = [motion.first, x[0], motion.noise[0], policy.gain[0], policy.offset[0]]
        evaluate(self._chosen, [a.copy() for a in given], [begin, noise])
        given = [
            begin,
            x[1:],
            motion.controls,
            motion.dt,
            motion.noise[1:],
            policy.gain[1:],
            policy.offset[1:],
        ]
        found, noises = np.empty((steps, n)), np.empty((steps, n))
        _run(self._forward, steps, given, [found, noises])
        return np.vstack([begin, found]), np.vstack([noise, noises])

    def reckoned(self, motion: Motion) -> Float[np.ndarray, "samples n"]:
        """The trajectory without noise."""
        samples, n = motion.noise.shape
        nothing = np.zeros((samples, n))
        policy = Policy(gain=np.zeros((samples, n, n)), offset=nothing, certainty=nothing + 1)
        about = np.zeros((samples, n))
        return self.trajectory(about, motion, policy)[0]

    def covariances(
        self, x: Float[np.ndarray, "samples n"], motion: Motion, policy: Policy
    ) -> Float[np.ndarray, "samples n n"]:
        """Covariance of each sample's state, given all measurements."""
        n, steps = self.model.size, len(x) - 1
        begin = np.empty(n * (n + 1) // 2)
        given = [motion.noise[0], policy.gain[0], policy.certainty[0]]
        evaluate(self._spread_first, [np.zeros_like(begin), *(a.copy() for a in given)], [begin])
        given = [
            begin,
            x[:-1],
            motion.controls,
            motion.dt,
            motion.noise[1:],
            policy.gain[1:],
            policy.certainty[1:],
        ]
        found = np.empty((steps, begin.size))
        _run(self._spread, steps, given, [found])
        return unpack_array(np.vstack([begin, found]))

    @cached_property
    def _first(self) -> ca.Function:
        n = self.model.size
        left, noise = symbol("left", n * (n + 1) // 2 + n), symbol("noise", n)
        return ca.Function("first", [left, noise], [*_eliminated(left, noise)])

    @cached_property
    def _backward(self) -> ca.Function:
        """Information after sample k, states, controls -> information after sample k - 1."""
        n = self.model.size
        half = n * (n + 1) // 2
        x, u, dt = self.model.symbols
        left, after, noise = symbol("left", half + n), symbol("after", n), symbol("noise", n)
        told, vector = symbol("told", half), symbol("vector", n)
        moved = self.model.step(x, u, dt)
        F = ca.jacobian(moved, x)
        reduced, policy = _eliminated(left, noise)
        J, j = unpack(reduced[:half], n), reduced[half:]
        before = pack(symmetric(F.T @ J @ F)) + told
        vector_before = F.T @ (j - J @ (moved - after)) + vector
        results = [ca.densify(ca.vertcat(before, vector_before)), policy]
        given = [left, x, after, u, dt, noise, told, vector]
        return ca.Function("backward", given, results)

    @cached_property
    def _chosen(self) -> ca.Function:
        n = self.model.size
        expected, about, noise = symbol("expected", n), symbol("about", n), symbol("noise", n)
        gain, offset = symbol("gain", n, n), symbol("offset", n)
        chosen, v = _chosen(expected - about, noise, gain, offset)
        given = [expected, about, noise, gain, offset]
        return ca.Function("chosen", given, [ca.densify(about + chosen), ca.densify(v)])

    @cached_property
    def _forward(self) -> ca.Function:
        n = self.model.size
        x, u, dt = self.model.symbols
        about, noise = symbol("about", n), symbol("noise", n)
        gain, offset = symbol("gain", n, n), symbol("offset", n)
        chosen, v = _chosen(self.model.step(x, u, dt) - about, noise, gain, offset)
        given = [x, about, u, dt, noise, gain, offset]
        return ca.Function("forward", given, [ca.densify(about + chosen), ca.densify(v)])

    @cached_property
    def _spread_first(self) -> ca.Function:
        n = self.model.size
        P, noise = symbol("P", n * (n + 1) // 2), symbol("noise", n)
        gain, certainty = symbol("gain", n, n), symbol("certainty", n)
        spread = _spread(unpack(P, n), noise, gain, certainty)
        return ca.Function("spread_first", [P, noise, gain, certainty], [pack(spread)])

    @cached_property
    def _spread(self) -> ca.Function:
        n = self.model.size
        x, u, dt = self.model.symbols
        P, noise = symbol("P", n * (n + 1) // 2), symbol("noise", n)
        gain, certainty = symbol("gain", n, n), symbol("certainty", n)
        F = ca.jacobian(self.model.step(x, u, dt), x)
        spread = _spread(symmetric(F @ unpack(P, n) @ F.T), noise, gain, certainty)
        given = [P, x, u, dt, noise, gain, certainty]
        return ca.Function("spread", given, [pack(spread)])


@lru_cache(maxsize=8)
def elimination_of(model: Model) -> Elimination:
    """The recursions of a model, kept: compiling takes longer than running them."""
    return Elimination(model)


def _run(
    function: ca.Function, steps: int, given: list[np.ndarray], found: list[np.ndarray]
) -> None:
    """Apply a Function step after step."""
    if steps:
        arrays = [np.ascontiguousarray(a, dtype=float) for a in given]
        evaluate(in_sequence(function, steps, 1), arrays, found)


def _eliminated(left: ca.SX, noise: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Information once the noise of each component is eliminated; gain, offset and certainty.

    The information is reduced in Joseph's form: it stays positive semidefinite.
    """
    n = noise.numel()
    half = n * (n + 1) // 2
    J, j = unpack(left[:half], n), left[half:]
    columns: list[ca.SX] = []
    for i in range(n):
        sigma = noise[i]
        certainty = 1 + sigma**2 * J[i, i]
        gain = sigma * J[:, i] / certainty
        offset = sigma * j[i] / certainty
        columns.append(ca.vertcat(gain, offset, certainty))
        j = j - gain * sigma * j[i]
        A = ca.SX.eye(n)
        A[:, i] -= gain * sigma
        J = symmetric(A @ J @ A.T + gain @ gain.T)
    policy = ca.horzcat(*columns)
    return ca.densify(ca.vertcat(pack(J), j)), ca.densify(policy)


def _chosen(y: ca.SX, noise: ca.SX, gain: ca.SX, offset: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The state where the model alone says y, both from the old trajectory; and the noise."""
    n = noise.numel()
    v: list[ca.SX] = []
    for i in reversed(range(n)):
        best = offset[i] - gain[:, i].T @ y
        y = y + ca.vertcat(*(noise[i] * best if row == i else 0.0 for row in range(n)))
        v.append(best)
    return y, ca.vertcat(*reversed(v))


def _spread(P: ca.SX, noise: ca.SX, gain: ca.SX, certainty: ca.SX) -> ca.SX:
    """Covariance after the noise of each component was chosen, each as uncertain as it is."""
    n = noise.numel()
    for i in reversed(range(n)):
        A = ca.SX.eye(n)
        A[i, :] -= noise[i] * gain[:, i].T
        P = A @ P @ A.T
        P[i, i] += noise[i] ** 2 / certainty[i]
        P = symmetric(P)
    return P
