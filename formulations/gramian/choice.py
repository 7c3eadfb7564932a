"""Choosing among inputs of any vehicle by the observability of any measurement.

It is the thesis's Algorithm 2 with the Gramian of a model in place of the unicycle and its range.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from ..metrics import BLEND_WEIGHT, condition_number, score
from ..model.ties import TIE
from ..solution import Solution, Status
from .exact import ExactGramian
from .simulated import SimulatedGramian

LOGARITHMS = ("log-det", "blend")  # metrics of which a relative error of W is an absolute one
REMEDIES = {
    Status.INVALID_INPUT: "a state or a parameter is not finite; check the estimator",
    Status.UNOBSERVABLE: (
        "no candidate makes every case observable over the horizon; lengthen the horizon, "
        "offer other candidates, or measure more"
    ),
}


def choose_input(
    gramian: ExactGramian | SimulatedGramian,
    x0: Float[np.ndarray, "... n"] | Sequence[Any],
    candidates: Float[np.ndarray, "..."] | Sequence[Any],
    *,
    horizon: float,
    p: Float[np.ndarray, "... q"] | Sequence[Any] | None = None,
    t0: float = 0.0,
    R: Float[np.ndarray, "y y"] | Sequence[Any] | None = None,
    metric: str = "condition-number",
    blend_weight: float = BLEND_WEIGHT,
    weights: Float[np.ndarray, " cases"] | Sequence[float] | None = None,
) -> Solution:
    r"""Choose the candidate input under which states are most observable (thesis, Algorithm 2).

    .. math:: u^* = \arg\min_k \sum_i w_i\, m(W(x_i, p_i, u_k)), \quad \sum_i w_i = 1

    Of totals that the rounding of the Gramian cannot tell apart the first is taken. On the unicycle
    with heading and squared range it decides as ``obsplan.GramianHorizon``: to 1e-9 with 400 steps
    at 160 times its cost, to 1e-6 with 50 at 40
    (tests/benchmarks/test_general_gramian_benchmarks.py).

    Parameters
    ----------
    gramian
        Of the vehicle and the sensor: made by :func:`exact_gramian`, or a
        :class:`SimulatedGramian`.
    x0
        State now: one, or one per case. A case is what one AUV's range, say, tells of the state.
    candidates
        Inputs, one each, held over the horizon: (K,) numbers or (K, m); or (K, L, m), L inputs in
        turn, each for horizon/L.
    horizon
        T [s].
    p
        Parameters of the model: one set, or one per case, as the places of several AUVs.
    t0, R
        Time now [s] and covariance of the noise, as the Gramian takes them.
    metric
        A key of ``METRICS``, lower is better (:func:`score`). Most depend on the units of the
        states.
    blend_weight
        Of the metric ``blend`` (:func:`blend`).
    weights
        Of the cases; default: all alike. A case of weight 0 has no say.

    Returns
    -------
    Solution whose ``x`` is the candidate chosen, (m,) or (L, m), ``objective`` the total,
    ``condition`` the condition number of each case. Where no candidate makes every case observable,
    or a state or parameter is not finite, there is none, and ``status`` says which.

    Raises
    ------
    ValueError
        For candidates that are not finite or do not divide the Gramian's steps, weights that are
        not one number of at least 0 per case, an unknown metric, or where the Gramian raises it.
    """
    inputs = _inputs(candidates)
    x0, p = _cases(x0), None if p is None else _cases(p)
    controls = _held(inputs, gramian.steps)
    given = [x0] if p is None else [x0, p]
    cases, *_ = np.broadcast_shapes(*((len(values),) for values in given))
    shares = _shares(weights, cases)
    if not all(np.isfinite(values).all() for values in (*given, np.asarray(t0))):
        return Solution.missing(Status.INVALID_INPUT, inputs[0].size, REMEDIES)
    each_p = None if p is None else p[:, None]
    W = gramian(x0[:, None], controls, horizon=horizon, p=each_p, t0=t0, R=R)
    counts = shares > 0
    scores, condition = score(metric, W[counts], blend_weight=blend_weight), condition_number(W)
    totals = shares[counts] @ scores
    least = int(np.argmin(totals))
    if not totals[least] < np.inf:
        return Solution.missing(Status.UNOBSERVABLE, inputs[0].size, REMEDIES)
    size = np.abs(scores[:, least])
    if metric in LOGARITHMS:
        size = max(1.0, blend_weight) if metric == "blend" else 1.0
    doubt = shares[counts] @ ((TIE + gramian.rounding * condition[counts, least]) * size)
    best = int(np.argmax(totals <= totals[least] + doubt))
    return Solution(
        x=inputs[best],
        objective=float(totals[best]),
        status=Status.OPTIMAL,
        condition=condition[:, best],
    )


def _inputs(candidates: Any) -> Float[np.ndarray, "K ..."]:
    """Candidates as an array of inputs (K, m) or of sequences (K, L, m)."""
    inputs = np.asarray(candidates, dtype=float)
    inputs = inputs[:, None] if inputs.ndim == 1 else inputs
    if inputs.ndim not in (2, 3) or not inputs.size or not np.isfinite(inputs).all():
        raise ValueError(
            "candidates must be finite, (K,), (K, m) or (K, L, m) with at least one, "
            f"got shape {np.shape(candidates)}"
        )
    return inputs


def _held(inputs: np.ndarray, steps: int) -> Float[np.ndarray, "K steps m"]:
    """Controls of each step, or one for all of them."""
    if inputs.ndim == 2:
        return inputs[:, None]
    in_turn = inputs.shape[1]
    if steps % in_turn:
        raise ValueError(
            f"{in_turn} inputs in turn must divide the {steps} steps of the Gramian; "
            f"compile it with {in_turn * (steps // in_turn + 1)} steps"
        )
    return np.repeat(inputs, steps // in_turn, axis=1)


def _cases(values: Any) -> Float[np.ndarray, "cases entries"]:
    """One row per case."""
    return np.atleast_2d(np.asarray(values, dtype=float))


def _shares(weights: Any, cases: int) -> Float[np.ndarray, " cases"]:
    """What each case counts; the sum is 1."""
    weights = np.ones(cases) if weights is None else np.asarray(weights, dtype=float)
    usable = np.isfinite(weights).all() and (weights >= 0).all() and weights.sum() > 0
    if weights.shape != (cases,) or not usable:
        raise ValueError(
            f"weights must be {cases} finite numbers of at least 0, one per case and not all 0, "
            f"got {weights.tolist()}"
        )
    return weights / weights.sum()
