"""The reference decision by public ``plan()`` and by what else one might write it in.

21 turn rates held for two thirds of the smallest circle, an output at each of 21 instants, the
Gramian over position and heading, its condition number. Times are recorded, never asserted; every
result is checked. jax and numba are optional: ``pip install -e '.[test,bench]'``. Compare within
one run only:
``pytest tests/benchmarks/test_reference_decision_benchmarks.py -o addopts= --benchmark-sort=mean``.
"""

import ctypes
import math
import subprocess

import numpy as np
import pytest

import obsplan as op
from formulations.model.compiler import FLAGS, find_compiler

SPEED, HORIZON, LIMIT = 1.0, 2 * math.pi / 3, 2.0
POSE = np.array([1.0, 0.0, math.pi / 2])
RATES = np.linspace(-LIMIT, LIMIT, 21)
TIMES = np.linspace(0.0, HORIZON, 21)
BEST_RATE, BEST_CONDITION = 1.4, 8.879  # by the continuous integral
# The trapezoidal rule's error is h^2 (b - a) / 12 times the integrand's second derivative: some
# per cent of the condition number over 20 intervals.
RULE = 0.05
decision = pytest.mark.benchmark(group="reference decision, 21 turn rates at 21 instants")


def check(scores):
    scores = np.asarray(scores)
    assert RATES[np.argmin(scores)] == pytest.approx(BEST_RATE)
    assert scores.min() == pytest.approx(BEST_CONDITION, rel=RULE)


@decision
def test_public_plan(benchmark):
    situation = op.Situation(op.Unicycle(speed=SPEED, min_turn_radius=SPEED / LIMIT))
    planner = op.GramianHorizon(situation, metric="condition-number")
    pose, auvs = op.Pose(*map(float, POSE)), [op.Belief.at(0.0, 0.0)]
    found = benchmark(planner.plan, pose, auvs)
    assert found.turn_rate == pytest.approx(BEST_RATE)
    assert found.score == pytest.approx(BEST_CONDITION, abs=5e-4)


def in_numpy():
    """Condition numbers of all turn rates at once."""
    half = RATES[:, None] * TIMES / 2
    chord = SPEED * TIMES * np.sinc(half / np.pi)
    east, north = chord * np.cos(POSE[2] + half), chord * np.sin(POSE[2] + half)
    x, y = POSE[0] + east, POSE[1] + north
    C = 2 * np.stack([x, y, y * east - x * north], axis=-1)
    weight = np.full(TIMES.size, TIMES[1])
    weight[[0, -1]] /= 2
    W = np.einsum("t,kti,ktj->kij", weight, C, C)
    W[:, 2, 2] += HORIZON
    found = np.linalg.eigvalsh(W)
    return found[:, -1] / found[:, 0]


@decision
def test_numpy_on_whole_arrays(benchmark):
    check(benchmark(in_numpy))


@decision
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_jax(benchmark):
    jax = pytest.importorskip("jax")
    jnp = jax.numpy
    jax.config.update("jax_enable_x64", True)

    def outputs(pose, rate, time):
        half = rate * time / 2
        chord = SPEED * time * jnp.sinc(half / jnp.pi)
        x = pose[0] + chord * jnp.cos(pose[2] + half)
        y = pose[1] + chord * jnp.sin(pose[2] + half)
        return jnp.array([pose[2] + rate * time, x**2 + y**2])

    def score(pose, rate):
        of_time = jax.vmap(jax.jacfwd(outputs), in_axes=(None, None, 0))
        C = of_time(pose, rate, TIMES)
        W = jnp.trapezoid(jnp.einsum("tij,tik->tjk", C, C), TIMES, axis=0)
        found = jnp.linalg.eigvalsh(W)
        return found[-1] / found[0]

    scores = jax.jit(jax.vmap(score, in_axes=(None, 0)))
    check(benchmark(lambda: scores(POSE, RATES).block_until_ready()))


def condition(xx, yy, tt, xy, xt, yt):
    """Condition number of a symmetric matrix of 3 x 3, by the cubic's trigonometric roots."""
    mean = (xx + yy + tt) / 3
    a, b, c = xx - mean, yy - mean, tt - mean
    p = math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xt * xt + yt * yt)) / 6)
    det = a * (b * c - yt * yt) - xy * (xy * c - yt * xt) + xt * (xy * yt - b * xt)
    r = min(1.0, max(-1.0, det / (2 * p * p * p)))
    angle = math.acos(r) / 3
    largest = mean + 2 * p * math.cos(angle)
    return largest / (mean + 2 * p * math.cos(angle + 2 * math.pi / 3))


@decision
def test_numba(benchmark):
    numba = pytest.importorskip("numba")
    conditioned = numba.njit(condition)

    @numba.njit
    def scored(pose, rates, times, scores):
        for k in range(rates.size):
            xx = yy = tt = xy = xt = yt = 0.0
            for i in range(times.size):
                half = rates[k] * times[i] / 2
                sinc = math.sin(half) / half if half != 0.0 else 1.0
                chord = SPEED * times[i] * sinc
                east, north = chord * math.cos(pose[2] + half), chord * math.sin(pose[2] + half)
                x, y = 2 * (pose[0] + east), 2 * (pose[1] + north)
                t = y * east - x * north
                w = times[1] / 2 if i in (0, times.size - 1) else times[1]
                xx, yy, tt = xx + w * x * x, yy + w * y * y, tt + w * t * t
                xy, xt, yt = xy + w * x * y, xt + w * x * t, yt + w * y * t
            scores[k] = conditioned(xx, yy, tt + times[-1], xy, xt, yt)
        return scores

    check(benchmark(scored, POSE, RATES, TIMES, np.empty(RATES.size)))


LOOP = """
#include <math.h>
static double condition(double xx, double yy, double tt, double xy, double xt, double yt) {
  double mean = (xx + yy + tt) / 3, a = xx - mean, b = yy - mean, c = tt - mean;
  double p = sqrt((a*a + b*b + c*c + 2 * (xy*xy + xt*xt + yt*yt)) / 6);
  double det = a * (b*c - yt*yt) - xy * (xy*c - yt*xt) + xt * (xy*yt - b*xt);
  double angle = acos(fmin(1.0, fmax(-1.0, det / (2*p*p*p)))) / 3;
  return (mean + 2*p*cos(angle)) / (mean + 2*p*cos(angle + 2.0943951023931953));
}
void scored(const double* pose, const double* rates, const double* times, double* scores) {
  for (int k = 0; k < 21; ++k) {
    double xx = 0, yy = 0, tt = times[20], xy = 0, xt = 0, yt = 0;
    /* from one instant to the next the direction turns by the same angle */
    double c = cos(rates[k] * times[1] / 2), s = sin(rates[k] * times[1] / 2);
    double cc = cos(pose[2]), ss = sin(pose[2]), sine = 0, cosine = 1;
    for (int i = 0; i < 21; ++i) {
      double half = rates[k] * times[i] / 2, chord = times[i];
      if (half != 0) chord *= sine / half;
      double east = chord * cc, north = chord * ss;
      double x = 2 * (pose[0] + east), y = 2 * (pose[1] + north), t = y*east - x*north;
      double w = i % 20 ? times[1] : times[1] / 2;
      xx += w*x*x; yy += w*y*y; tt += w*t*t; xy += w*x*y; xt += w*x*t; yt += w*y*t;
      double next = cc*c - ss*s; ss = ss*c + cc*s; cc = next;
      next = cosine*c - sine*s; sine = sine*c + cosine*s; cosine = next;
    }
    scores[k] = condition(xx, yy, tt, xy, xt, yt);
  }
}
"""


def loop_in_c(folder):
    source, library = folder / "loop.c", folder / "loop.so"
    source.write_text(LOOP)
    command = [find_compiler(), *FLAGS, str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    return ctypes.CDLL(str(library)).scored


@decision
@pytest.mark.skipif(find_compiler() is None, reason="no C compiler")
def test_loop_in_c(benchmark, tmp_path):
    scored, scores = loop_in_c(tmp_path), np.empty(RATES.size)
    given = [ctypes.c_void_p(a.ctypes.data) for a in (POSE, RATES, TIMES, scores)]
    benchmark(scored, *given)
    check(scores)
