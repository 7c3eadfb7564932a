"""How long covariances along a mission and the certified bound take, beside plain numpy.

Times are recorded, never asserted; results are checked once. Run alone:
``pytest tests/benchmarks/test_bound_benchmarks.py --benchmark-group-by=group
--benchmark-sort=mean -n 0``.
"""

import numpy as np
import pytest

from formulations import allocation, certified_bound, cramer_rao
from formulations.certified_bound import information_bound
from formulations.cramer_rao import posterior_cramer_rao
from formulations.model import compiler, recursion

STEPS = 8400  # 14 minutes at 10 Hz
EVERY = 10  # a range a second


def mission():
    """An AUV that turns at random, with a compass at every step."""
    dt, speed = 0.1, 1.5
    heading = np.cumsum(np.random.default_rng(0).normal(scale=0.01, size=STEPS))
    F = np.tile(np.eye(4), (STEPS, 1, 1))
    F[:, 0, 2], F[:, 0, 3] = -speed * np.sin(heading) * dt, np.cos(heading) * dt
    F[:, 1, 2], F[:, 1, 3] = speed * np.cos(heading) * dt, np.sin(heading) * dt
    J = np.zeros((STEPS, 4, 4))
    J[:, 2, 2] = 0.02**-2
    P0, Q = np.diag([4.0, 4.0, 0.01, 0.01]), np.diag([1e-4, 1e-4, 1e-6, 1e-6])
    return P0, F, Q, J


def in_numpy(P0, F, Q, J):
    """The posterior Cramér-Rao bound with an inverse of I + M J at each step."""
    P = np.empty((len(F) + 1, *P0.shape))
    P[0] = P0
    for k in range(len(F)):
        M = F[k] @ P[k] @ F[k].T + Q
        P[k + 1] = M @ np.linalg.inv(np.eye(len(P0)) + J[k] @ M)
    return P


@pytest.fixture
def road(request, monkeypatch):
    """How sweeps are run: as machine code, by CasADi's virtual machine, or in numpy."""
    sweeps = (cramer_rao._riccati_sweep, allocation._adjoint_sweep)
    for sweep in sweeps:
        sweep.cache_clear()
    monkeypatch.setattr(recursion, "BREAK_EVEN", 0)
    if request.param == "virtual-machine":
        monkeypatch.setattr(compiler, "find_compiler", lambda: None)
    yield request.param
    for sweep in sweeps:
        sweep.cache_clear()


@pytest.mark.benchmark(group=f"posterior Cramér-Rao bound, {STEPS} steps", max_time=2.0)
@pytest.mark.parametrize("road", ["machine-code", "virtual-machine", "numpy"], indirect=True)
def test_covariances_along_a_mission(benchmark, road):
    P0, F, Q, J = mission()
    sweep = in_numpy if road == "numpy" else posterior_cramer_rao
    P = benchmark(sweep, P0, F, Q, J)
    np.testing.assert_allclose(P[-1], in_numpy(P0, F, Q, J)[-1], rtol=1e-9, atol=1e-15)


@pytest.mark.benchmark(group=f"certified bound, {STEPS} steps", max_time=2.0)
@pytest.mark.parametrize("finest", [STEPS, certified_bound.FINEST], ids=["at-once", "from-coarse"])
@pytest.mark.parametrize("road", ["machine-code", "virtual-machine"], indirect=True)
def test_certified_bound(benchmark, road, finest, monkeypatch):  # noqa: ARG001
    monkeypatch.setattr(certified_bound, "FINEST", finest)
    P0, F, Q, J = mission()
    pings = np.arange(EVERY - 1, STEPS, EVERY)
    bound = benchmark(information_bound, P0, F, Q, J, pings=pings, sigma=1.0)
    assert 0 < bound.gap <= certified_bound.RELATIVE_GAP * bound.value
