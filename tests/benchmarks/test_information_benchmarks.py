"""How long a decision of the default planner takes, beside the same beam search written plainly in numpy.

Times are recorded, never asserted; all decide the same. Run alone:
``pytest tests/benchmarks/test_information_benchmarks.py --benchmark-group-by=group --benchmark-sort=mean -n 0``.
Measured in turns on a busy core, in CPU time, for 1, 2, 8 and 64 AUVs: machine code 0.13, 0.16, 0.31 and 1.7 ms; branchings as scalar
machine code and selection in numpy 2.6 to 3.3 times as long, the virtual machine 8 to 18 times, numpy 15 to 23 times.
Among three polygons, far and near: 1.4 and 1.9 ms; looked at in numpy 2.2 and 4.8 times as long.
"""

import numpy as np
import pytest

import obsplan as op
from formulations.beam_search import search, selection
from formulations.beam_search.branching import branching
from formulations.beam_search.compiled import machine_code
from formulations.beam_search.interpreted import Interpreted
from formulations.model import compiler
from formulations.solution import Solution, Status
from obsplan.planners import information

CNA = op.Unicycle(speed=1.5, min_turn_radius=5.0)
POSE = op.Pose(0.0, 0.0, 0.1)


def known(auvs):
    rng = np.random.default_rng(auvs)
    return [
        op.Belief(
            mean=np.array([*rng.normal(scale=50.0, size=2), rng.uniform(-3, 3), 1.0]),
            covariance=np.diag([4.0, 9.0, 0.01, 0.01]),
            process_noise=(0.05, 0.01, 0.01),
        )
        for _ in range(auvs)
    ]


def in_numpy(
    pose,
    covariance,
    *,
    tracks,
    process_noise,
    weights,
    stages,
    turn_rates,
    speed,
    ranging,
    **options,
):
    """The search for the least trace, stage by stage, on whole arrays."""
    M, K = len(weights), len(turn_rates)
    weights = weights / weights.sum()
    poses, P, cost, turns = pose[None], covariance[None], np.zeros(1), np.empty((1, 0))
    for s in range(len(stages.duration)):
        h, pings = stages.duration[s], stages.pings[s]
        A = np.zeros((M, 4, 4))
        cos, sin = np.cos(tracks.heading[s]), np.sin(tracks.heading[s])
        A[:, 0, 2], A[:, 1, 2] = -tracks.speed[s] * sin, tracks.speed[s] * cos
        A[:, 0, 3], A[:, 1, 3] = cos, sin
        Q = (process_noise**2 * [1.0, 1.0, 0.0, 1.0])[:, :, None] * np.eye(4)
        At, F = A.swapaxes(-1, -2), np.eye(4) + A * h
        grown = Q * h + (A @ Q + Q @ At) * (h**2 / 2) + A @ Q @ At * (h**3 / 3)
        P = F @ P @ F.swapaxes(-1, -2) + grown
        half = 0.5 * turn_rates * h
        chord, heading = speed * h * np.sinc(half / np.pi), poses[:, None, 2] + half
        steps = np.stack([chord * np.cos(heading), chord * np.sin(heading)], axis=-1)
        ends = np.concatenate([poses[:, None, :2] + steps, (heading + half)[..., None]], axis=-1)
        x = ends[..., None, :2] - tracks.position[s]
        after = ranged(P[:, None, :, :2, :2], x, ranging.sigma, pings)
        trace = after[..., 0, 0] + after[..., 1, 1]
        total = (cost[:, None] + trace @ weights * (h / stages.duration.sum())).ravel()
        beyond = np.maximum(np.linalg.norm(x, axis=-1) - options["to_go"].near, 0.0)
        rank = total + (beyond @ (weights * options["to_go"].per_metre)).ravel()
        keep = np.argsort(rank, kind="stable")[: options["beam_width"]]
        parent, turn = np.divmod(keep, K)
        P = ranged(P[parent], x[parent, turn], ranging.sigma, pings)
        poses, cost = ends[parent, turn], total[keep]
        turns = np.column_stack([turns[parent], turn_rates[turn]])
    return Solution(x=turns[0], objective=float(cost[0]), status=Status.OPTIMAL, poses=poses[:1])


def ranged(P, x, sigma, pings):
    """Covariances after ranges from relative positions."""
    d2 = np.sum(x**2, axis=-1)
    u1, u2 = x[..., 0] / np.sqrt(d2), x[..., 1] / np.sqrt(d2)
    Pu = P[..., 0] * u1[..., None] + P[..., 1] * u2[..., None]
    along = u1 * Pu[..., 0] + u2 * Pu[..., 1]
    across = P[..., 0, 0] + P[..., 1, 1] - along
    R = sigma**2 / pings + 0.75 * across**2 / d2
    return P - (Pu / (R + along)[..., None])[..., :, None] * Pu[..., None, :]


def selected_in_numpy(kind, _stages, width):
    """Branchings as machine code, one sequence after the other; the rest on arrays."""
    return Interpreted(branching(kind), kind.turns, width)


@pytest.fixture
def road(request, monkeypatch):
    """How the search is run."""
    for kept in (search.beam_of, machine_code, branching):
        kept.cache_clear()
    if request.param == "numpy":
        monkeypatch.setattr(information, "search_manoeuvres", in_numpy)
    if request.param == "selected-in-numpy":
        monkeypatch.setattr(search, "beam_of", selected_in_numpy)
    if request.param == "looked-at-in-numpy":
        monkeypatch.setattr(selection, "look_function", lambda: None)
    if request.param == "virtual-machine":
        monkeypatch.setattr(compiler, "find_compiler", lambda: None)
        monkeypatch.setattr(selection, "look_function", lambda: None)
    yield request.param
    monkeypatch.undo()
    for kept in (search.beam_of, machine_code, branching):
        kept.cache_clear()


@pytest.mark.parametrize("auvs", [1, 2, 8, 64])
@pytest.mark.parametrize(
    "road", ["machine-code", "selected-in-numpy", "virtual-machine", "numpy"], indirect=True
)
def test_decision_of_the_default_planner(benchmark, road, auvs):  # noqa: ARG001
    benchmark.group = f"one decision of `information`, {auvs} AUVs"
    planner = op.InformationHorizon(op.Situation(CNA, ping_interval=15.0))
    beliefs = known(auvs)
    decision = benchmark(planner.plan, POSE, beliefs, time=3.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(information, "search_manoeuvres", in_numpy)
        plain = planner.plan(POSE, beliefs, time=3.0)
    assert decision.turn_rate == plain.turn_rate
    assert decision.score == pytest.approx(plain.score, rel=1e-12)


@pytest.mark.parametrize(
    "road", ["machine-code", "looked-at-in-numpy", "virtual-machine"], indirect=True
)
@pytest.mark.parametrize("near", [False, True])
def test_decision_of_the_default_planner_among_three_polygons(benchmark, road, near):  # noqa: ARG001
    benchmark.group = f"one decision of `information` among three polygons, {near=}"
    corners = np.array([[0.0, -12.0], [40.0, -8.0], [35.0, 30.0], [-4.0, 25.0]])
    places = [[8.0, 0.0], [-60.0, 5.0], [-10.0, 20.0]] if near else 60.0 * np.eye(3, 2) + 20.0
    limits = op.Constraints(keep_out=tuple(op.Polygon(points=corners + at) for at in places))
    planner = op.InformationHorizon(op.Situation(CNA, ping_interval=15.0, constraints=limits))
    decision = benchmark(planner.plan, POSE, known(2), time=3.0)
    assert np.isfinite(decision.score)
