"""The ground floor: arcs against complex numbers and differences, frames and schedules against themselves turned round."""

import math
from fractions import Fraction

import casadi as ca
import mpmath as mp
import numpy as np
import pytest
from oracles import arc as complex_arc

from formulations.model import arcs as exact
from formulations.model.arcs import arcs, compose, one_arc, path, sinc
from formulations.model.casadi import symbol
from formulations.model.covariance import (
    NEAREST,
    Ranging,
    conditioned,
    pack,
    pack_array,
    unpack,
    unpack_array,
)
from formulations.model.frames import Frame, to_body
from formulations.model.quadrature import simpson
from formulations.model.schedule import intervals, is_multiple, time_to_next

# Arcs


def test_sinc_and_its_slopes_keep_their_digits_near_zero():
    z = symbol("z")
    slope = ca.jacobian(sinc(z), z)
    function = ca.Function("sinc", [z], [sinc(z), slope, ca.jacobian(slope, z)])
    with mp.workdps(40):
        for x in (0.0, 1e-9, 1e-3, 0.3, 0.999, 1.001, 3.0, -7.0):
            exactly = [mp.diff(mp.sinc, mp.mpf(x), n) for n in range(3)]
            found = [float(value) for value in function(x)]
            np.testing.assert_allclose(found, [float(e) for e in exactly], rtol=1e-13, atol=1e-15)


def test_arcs_are_those_of_complex_numbers():
    rng = np.random.default_rng(0)
    pose, rates, times = rng.normal(size=(4, 1, 3)), rng.normal(size=(4, 5)), np.array([0.1, 2, 30])
    rates[0, 0] = 0.0
    found = arcs(pose, rates, 1.7, times)
    for i, j, k in np.ndindex(4, 5, 3):
        expected = complex_arc(pose[i, 0], rates[i, j], 1.7, times[k])
        np.testing.assert_allclose(found[i, j, k], expected, atol=1e-12)


@pytest.mark.parametrize("turn_rate", [0.0, 1e-2, -0.2, 3.0])
def test_one_arc_is_that_of_complex_numbers(turn_rate):
    pose = (3.0, -2.0, 0.7)
    end = one_arc(pose, turn_rate, 1.5, 0.8)
    np.testing.assert_allclose(end, complex_arc(pose, turn_rate, 1.5, 0.8), rtol=0, atol=1e-13)


def test_path_is_one_arc_after_the_other():
    rng = np.random.default_rng(1)
    pose, rates = rng.normal(size=3), rng.normal(size=(2, 6))
    speeds, durations = rng.uniform(0.5, 2, (2, 6)), rng.uniform(0.1, 3, 6)
    found = path(pose, rates, speeds, durations)
    for k in range(2):
        now = pose
        for j in range(6):
            np.testing.assert_allclose(found[k, j], now, atol=1e-12)
            now = complex_arc(now, rates[k, j], speeds[k, j], durations[j])
        np.testing.assert_allclose(found[k, 6], now, atol=1e-12)


def test_arc_from_a_pose_is_the_pose_and_then_the_arc_from_the_origin():
    pose, rates = np.array([3.0, -2.0, 0.7]), np.array([[-0.4, 0.0, 1.1]])
    moves = exact.arc(ca.DM.zeros(3, 3), ca.DM(rates), 1.5, 2.0)
    composed = compose(ca.DM(pose), moves)
    expected = exact.arc(ca.repmat(ca.DM(pose), 1, 3), ca.DM(rates), 1.5, 2.0)
    np.testing.assert_allclose(composed.full(), expected.full(), atol=1e-14)


# Covariances


def test_covariances_are_packed_by_columns_of_the_lower_triangle_as_casadi_does():
    half = np.random.default_rng(3).normal(size=(5, 4, 4))
    P = half @ half.swapaxes(-1, -2)
    packed = pack_array(P)
    np.testing.assert_allclose(unpack_array(packed), P, rtol=1e-15)
    symbolic = [pack(ca.SX(ca.DM(P[0]))), unpack(ca.SX(ca.DM(packed[0])))]
    found = [ca.evalf(expression).full() for expression in symbolic]
    np.testing.assert_array_equal(found[0][:, 0], packed[0])
    np.testing.assert_array_equal(found[1], unpack_array(packed[0]))
    np.testing.assert_array_equal(
        packed[0], P[0][[0, 1, 2, 3, 1, 2, 3, 2, 3, 3], [0] * 4 + [1] * 3 + [2, 2, 3]]
    )


@pytest.mark.parametrize("squared", [False, True])
def test_no_ranges_and_ranges_from_on_top_tell_nothing(squared):
    P, ranging = np.diag([4.0, 9.0, 0.1, 0.1]), Ranging(0.1, squared)
    np.testing.assert_array_equal(conditioned(P, np.zeros(2), ranging, 1.0), P)
    np.testing.assert_array_equal(conditioned(P, np.array([5.0, 1.0]), ranging, 0.0), P)
    near = conditioned(P, np.array([NEAREST, 0.0]), ranging, 1.0)
    np.testing.assert_allclose(near, P, rtol=1e-9)  # its second-order error is (9 m^2 / 1e-6 m)^2


# Frames


def test_frame_and_world_undo_each_other_and_lengths_scale():
    rng = np.random.default_rng(4)
    points = rng.normal(size=(6, 2))
    for mirror in (1.0, -1.0):
        frame = Frame(np.array([2.0, -1.0]), 0.8, length=3.0, mirror=mirror)
        seen = frame.positions(points)
        np.testing.assert_allclose(frame.world(seen), points, atol=1e-14)
        ahead = np.array([2.0, -1.0]) + 3.0 * np.array([math.cos(0.8), math.sin(0.8)])
        np.testing.assert_allclose(frame.positions(ahead[None]), [[1.0, 0.0]], atol=1e-15)
        left = np.array([[-math.sin(0.8), math.cos(0.8)]])
        np.testing.assert_allclose(frame.directions(left), [[0.0, mirror]], atol=1e-15)


def test_body_axes_are_ahead_and_to_the_left():
    assert to_body(0.0, 1.0, 0.0, 2.0) == (2.0, 0.0)  # heading north, two to the north
    assert to_body(0.0, 1.0, -3.0, 0.0) == (0.0, 3.0)  # three to the west


def test_covariance_in_a_frame_is_that_of_samples_seen_in_it():
    rng = np.random.default_rng(5)
    frame = Frame(np.zeros(2), 0.6, length=2.0, mirror=-1.0)
    x = rng.normal(size=(50, 4)) @ rng.normal(size=(4, 4))
    seen = np.column_stack([frame.positions(x[:, :2]), -x[:, 2], x[:, 3] * 5.0 / 2.0])
    P = np.cov(x.T)[None]
    np.testing.assert_allclose(frame.covariances(P, time=5.0)[0], np.cov(seen.T), rtol=1e-12)


# Schedules


@pytest.mark.parametrize("interval", [0.1, 0.7, 15.0])
def test_time_to_the_next_multiple_is_positive_however_multiples_are_rounded(interval):
    for k in range(1000):
        time = k * interval
        assert float(time_to_next(time, interval)) == pytest.approx(interval, rel=1e-5)
        assert intervals(time, interval) == k
        half = float(time_to_next(time + interval / 2, interval))
        assert half == pytest.approx(interval / 2, rel=1e-9)


def test_multiples_are_whole_but_for_rounding():
    assert is_multiple(0.3, 0.1)
    assert is_multiple(15.0, 0.1)
    assert not is_multiple(0.25, 0.1)
    assert not is_multiple(0.0, 0.1)
    assert not is_multiple(math.inf, 0.1)


# Quadrature


@pytest.mark.parametrize(("before", "after"), [(1, 1), (1, 2), (3, 5), (7, 2)])
def test_simpsons_weights_integrate_parabolas_on_any_cut(before, after):
    weights = simpson(np.array(before), np.array(after))
    T = before + after
    for power in range(3):
        exactly = Fraction(1, power + 1)
        found = weights @ np.array([0.0, before / T, 1.0]) ** power
        assert found == pytest.approx(float(exactly), rel=1e-14)
    np.testing.assert_array_equal(simpson(np.array(0), np.array(3)), [0.5, 0.0, 0.5])
