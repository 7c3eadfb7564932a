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
from typing import NamedTuple

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

    @property
    def noisy(self) -> tuple[int, ...]:
        """Components to which any step adds noise."""
        return tuple(np.flatnonzero(self.noise[1:].any(axis=0)).tolist())

    def until(self, count: int) -> "Motion":
        """That of the first samples."""
        steps = slice(count - 1)
        return Motion(
            first=self.first,
            controls=self.controls[steps],
            dt=self.dt[steps],
            noise=self.noise[:count],
        )

    def after(self, sample: int) -> "Motion":
        """That from a sample on."""
        steps = slice(sample, None)
        return Motion(
            first=self.first,
            controls=self.controls[steps],
            dt=self.dt[steps],
            noise=self.noise[steps],
        )


class Policy(NamedTuple):
    """Noise that is best where the model says a state; of each component that has noise."""

    gain: Float[np.ndarray, "*steps noisy n"]
    offset: Float[np.ndarray, "*steps noisy"]
    # how many times what is known of it exceeds what was known before: its variance is the inverse
    certainty: Float[np.ndarray, "*steps noisy"]


class Policies(NamedTuple):
    """Those of the first estimate's errors, and of each step's noise."""

    first: Policy
    steps: Policy


@dataclass(frozen=True)
class Elimination:
    """The recursions of a `Model`, compiled once for each number of samples."""

    model: Model
    noisy: tuple[int, ...]  # components to which steps add noise

    def policies(
        self,
        x: Float[np.ndarray, "samples n"],
        motion: Motion,
        information: Float[np.ndarray, "samples n n"],
        vector: Float[np.ndarray, "samples n"],
    ) -> Policies:
        """Eliminate backward what was linearised about a trajectory: Hᵀ R⁻¹ H and Hᵀ R⁻¹ r."""
        n, steps = self.model.size, len(x) - 1
        packed = pack_array(information)
        begin = np.concatenate([packed[-1], vector[-1]])
        forward = [
            x[:-1],
            x[1:],
            motion.controls,
            motion.dt,
            motion.noise[1:, self.noisy],
            packed[:-1],
            vector[:-1],
        ]
        given = [begin, *(a[::-1] for a in forward)]
        left, found = np.empty((steps, begin.size)), np.empty((steps, len(self.noisy), n + 2))
        _run(self._backward, steps, given, [left, found])
        last, at_first = left[-1] if steps else begin, np.empty((n, n + 2))
        evaluate(
            self._first, [last.copy(), motion.noise[0].copy()], [np.empty_like(last), at_first]
        )
        return Policies(_split(at_first), _split(found[::-1]))

    def trajectory(
        self, x: Float[np.ndarray, "samples n"], motion: Motion, policies: Policies
    ) -> tuple[Float[np.ndarray, "samples n"], float]:
        """The trajectory that follows policies about x, and half the square of its noise."""
        n, steps, first = self.model.size, len(x) - 1, policies.first
        begin, noise = np.empty(n), np.empty(n)
        given = [motion.first, x[0], motion.noise[0], first.gain, first.offset]
        evaluate(self._chosen, [a.copy() for a in given], [begin, noise])
        given = [
            begin,
            x[1:],
            motion.controls,
            motion.dt,
            motion.noise[1:, self.noisy],
            policies.steps.gain,
            policies.steps.offset,
        ]
        found, noises = np.empty((steps, n)), np.empty((steps, len(self.noisy)))
        _run(self._forward, steps, given, [found, noises])
        return np.vstack([begin, found]), 0.5 * float(np.sum(noise**2) + np.sum(noises**2))

    def reckoned(
        self, begin: Float[np.ndarray, " n"], motion: Motion
    ) -> Float[np.ndarray, "samples n"]:
        """The trajectory from a first state without noise."""
        steps, n = motion.dt.size, self.model.size
        nothing = np.zeros((steps, len(self.noisy)))
        gain = np.zeros((steps, len(self.noisy), n))
        about = np.zeros((steps, n))
        given = [begin, about, motion.controls, motion.dt, nothing, gain, nothing]
        found = np.empty((steps, n))
        _run(self._forward, steps, given, [found, np.empty_like(nothing)])
        return np.vstack([begin, found])

    def covariances(
        self, x: Float[np.ndarray, "samples n"], motion: Motion, policies: Policies
    ) -> Float[np.ndarray, "samples n n"]:
        """Covariance of each sample's state, given all measurements."""
        n, steps, first = self.model.size, len(x) - 1, policies.first
        begin = np.empty(n * (n + 1) // 2)
        given = [np.zeros_like(begin), motion.noise[0], first.gain, first.certainty]
        evaluate(self._spread_first, [a.copy() for a in given], [begin])
        given = [
            begin,
            x[:-1],
            motion.controls,
            motion.dt,
            motion.noise[1:, self.noisy],
            policies.steps.gain,
            policies.steps.certainty,
        ]
        found = np.empty((steps, begin.size))
        _run(self._spread, steps, given, [found])
        return unpack_array(np.vstack([begin, found]))

    @property
    def _all(self) -> tuple[int, ...]:
        return tuple(range(self.model.size))

    @cached_property
    def _first(self) -> ca.Function:
        n = self.model.size
        left, noise = symbol("left", n * (n + 1) // 2 + n), symbol("noise", n)
        found = _eliminated(left, noise, self._all, n)
        return ca.Function("first", [left, noise], [*found])

    @cached_property
    def _backward(self) -> ca.Function:
        """Information after sample k, states, controls -> information after sample k - 1."""
        n = self.model.size
        half = n * (n + 1) // 2
        x, u, dt = self.model.symbols
        left, after = symbol("left", half + n), symbol("after", n)
        noise, told, vector = symbol("noise", len(self.noisy)), symbol("told", half), symbol("v", n)
        moved = self.model.step(x, u, dt)
        F = ca.jacobian(moved, x)
        reduced, policy = _eliminated(left, noise, self.noisy, n)
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
        policy = _Symbols(self._all, noise, gain, offset)
        chosen, v = policy.chosen(expected - about)
        given = [expected, about, noise, gain, offset]
        return ca.Function("chosen", given, [ca.densify(about + chosen), ca.densify(v)])

    @cached_property
    def _forward(self) -> ca.Function:
        n, noisy = self.model.size, len(self.noisy)
        x, u, dt = self.model.symbols
        about, noise = symbol("about", n), symbol("noise", noisy)
        gain, offset = symbol("gain", n, noisy), symbol("offset", noisy)
        policy = _Symbols(self.noisy, noise, gain, offset)
        chosen, v = policy.chosen(self.model.step(x, u, dt) - about)
        given = [x, about, u, dt, noise, gain, offset]
        return ca.Function("forward", given, [ca.densify(about + chosen), ca.densify(v)])

    @cached_property
    def _spread_first(self) -> ca.Function:
        n = self.model.size
        P, noise = symbol("P", n * (n + 1) // 2), symbol("noise", n)
        gain, certainty = symbol("gain", n, n), symbol("certainty", n)
        policy = _Symbols(self._all, noise, gain, certainty)
        found = pack(policy.spread(unpack(P, n)))
        return ca.Function("spread_first", [P, noise, gain, certainty], [found])

    @cached_property
    def _spread(self) -> ca.Function:
        n, noisy = self.model.size, len(self.noisy)
        x, u, dt = self.model.symbols
        P, noise = symbol("P", n * (n + 1) // 2), symbol("noise", noisy)
        gain, certainty = symbol("gain", n, noisy), symbol("certainty", noisy)
        policy = _Symbols(self.noisy, noise, gain, certainty)
        F = ca.jacobian(self.model.step(x, u, dt), x)
        found = pack(policy.spread(symmetric(F @ unpack(P, n) @ F.T)))
        return ca.Function("spread", [P, x, u, dt, noise, gain, certainty], [ca.densify(found)])


@lru_cache(maxsize=8)
def elimination_of(model: Model, noisy: tuple[int, ...]) -> Elimination:
    """The recursions of a model, kept: building them takes longer than running them."""
    return Elimination(model, noisy)


def _split(found: np.ndarray) -> Policy:
    """Gain, offset and certainty that stand after each other."""
    return Policy(gain=found[..., :-2], offset=found[..., -2], certainty=found[..., -1])


def _run(
    function: ca.Function, steps: int, given: list[np.ndarray], found: list[np.ndarray]
) -> None:
    """Apply a Function step after step."""
    if steps:
        arrays = [np.ascontiguousarray(a, dtype=float) for a in given]
        evaluate(in_sequence(function, steps, 1), arrays, found)


def _eliminated(left: ca.SX, noise: ca.SX, noisy: tuple[int, ...], n: int) -> tuple[ca.SX, ca.SX]:
    """Information once the noise of some components is eliminated; gain, offset and certainty.

    The information is reduced in Joseph's form: it stays positive semidefinite.
    """
    half = n * (n + 1) // 2
    J, j = unpack(left[:half], n), left[half:]
    columns: list[ca.SX] = []
    for k, i in enumerate(noisy):
        sigma = noise[k]
        certainty = 1 + sigma**2 * J[i, i]
        gain = sigma * J[:, i] / certainty
        columns.append(ca.vertcat(gain, sigma * j[i] / certainty, certainty))
        j = j - gain * sigma * j[i]
        A = ca.SX.eye(n)
        A[:, i] -= gain * sigma
        J = symmetric(A @ J @ A.T + gain @ gain.T)
    policy = ca.horzcat(ca.SX(n + 2, 0), *columns)
    return ca.densify(ca.vertcat(pack(J), j)), ca.densify(policy)


class _Symbols(NamedTuple):
    """A policy of one step as symbols."""

    noisy: tuple[int, ...]
    noise: ca.SX
    gain: ca.SX
    other: ca.SX  # offset or certainty

    def chosen(self, y: ca.SX) -> tuple[ca.SX, ca.SX]:
        """The state where the model alone says y, both less the old one; and the noise."""
        v: list[ca.SX] = []
        for k, i in reversed([*enumerate(self.noisy)]):
            best = self.other[k] - self.gain[:, k].T @ y
            added = ca.SX.zeros(y.numel())
            added[i] = self.noise[k] * best
            y = y + added
            v.append(best)
        return y, ca.vertcat(ca.SX(0, 1), *reversed(v))

    def spread(self, P: ca.SX) -> ca.SX:
        """Covariance after the noise was chosen, each component as uncertain as it is."""
        for k, i in reversed([*enumerate(self.noisy)]):
            A = ca.SX.eye(P.shape[0])
            A[i, :] -= self.noise[k] * self.gain[:, k].T
            P = A @ P @ A.T
            P[i, i] += self.noise[k] ** 2 / self.other[k]
            P = symmetric(P)
        return P
