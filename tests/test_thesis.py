"""What the thesis claims of paths, on small sizes: each claim against exact statements, and broken on purpose."""

import math
from functools import partial

import numpy as np
import pytest
from thesis_oracles import recurrence, turned

import formulations.path_inertia.closed_form as closed_form
import obsplan.planners.path_inertia as path_inertia
from obsplan.thesis import ITEMS, claims
from obsplan.thesis.equalities import gramian_equalities
from obsplan.thesis.flights import fly, pose, poses, random_starts, scenario
from obsplan.thesis.inertia import first_distance, first_offsets
from obsplan.thesis.penalty import LEG_START

FEW = {"runs": 8, "seed": 3}


def data_of(name, **size):
    return ITEMS[name].compute(**(FEW | size))


def finding(name, **size):
    item = ITEMS[name]
    return item.found(item.compute(**(FEW | size)))


@pytest.fixture
def broken(monkeypatch):
    """Break the decision of path inertia, for planners that have not been compiled yet."""

    def with_radius(function):
        monkeypatch.setattr(path_inertia, "path_inertia_radius", function)

    return with_radius


def wrong_side(mean_offset, gamma, min_radius, *_):
    radius, clipped = closed_form.path_inertia_radius(mean_offset, gamma, min_radius)
    return -radius, clipped


def sign_of_the_shrunk(mean_offset, gamma, min_radius, *_):
    """The clip by the sign of r*, which is 0 where the penalty shrinks it to nothing: there always to the left."""
    free = abs(mean_offset) - gamma / (2 + 2 * gamma)
    positive = (free > 0) * ((mean_offset >= 0) * 2 - 1) + (free <= 0)
    return positive * (
        free * (free >= min_radius) + min_radius * (free < min_radius)
    ), free < min_radius


def flown(start, *, gamma, steps=300, dt=0.1):
    setup = scenario(
        "fixed-auv",
        "path-inertia",
        f"planner.gamma={gamma}",
        f"duration={steps * dt}",
        time_step=dt,
    )
    return fly(setup, [start])


@pytest.mark.parametrize("gamma", [0.0, 0.3, 1.0, 10.0])
def test_flights_follow_the_exact_recurrence(gamma):
    for start in random_starts(3, seed=5, half_width=3.0):
        d = first_distance(flown(start, gamma=gamma))[0]
        exact = recurrence(
            start.x,
            start.y,
            start.heading,
            gamma=gamma,
            min_radius=0.5,
            speed=1.0,
            dt=0.1,
            steps=300,
        )
        np.testing.assert_allclose(
            d, exact, atol=1e-9
        )  # rounding of 300 steps, amplified where the path turns sharply


@pytest.mark.parametrize("wrong", [wrong_side, sign_of_the_shrunk])
def test_flights_of_a_wrong_rule_do_not_follow_the_recurrence(broken, wrong):
    broken(wrong)
    off = []
    for start in random_starts(3, seed=5, half_width=3.0):
        exact = recurrence(
            start.x, start.y, start.heading, gamma=1.0, min_radius=0.5, speed=1.0, dt=0.1, steps=300
        )
        off.append(np.abs(first_distance(flown(start, gamma=1.0))[0] - exact).max())
    assert max(off) > 0.1


def test_figure_5_1_is_the_analytic_circle_with_condition_number_one():
    data = data_of("fig5.1")
    np.testing.assert_allclose(np.hypot(data.x, data.y), 1.0, atol=1e-12)
    np.testing.assert_allclose(data.condition.values[..., :-1], 1.0, atol=1e-12)
    assert finding("fig5.1").agrees


@pytest.mark.parametrize("name", ["fig5.1", "fig5.2", "fig5.3"])
def test_figures_5_1_to_5_3_fail_with_the_sign_of_b_turned(broken, name):
    assert finding(name).agrees is not False
    broken(wrong_side)
    assert finding(name).agrees is False


@pytest.mark.parametrize(
    ("degrees", "expected"),
    [
        (0, "outward"),
        (60, "outward"),
        (90, "right"),
        (-90, "right"),
        (91, "inward"),
        (180, "inward"),
    ],
)
def test_class_is_the_angle_between_heading_and_the_ray_to_the_auv(degrees, expected):
    start = pose(2.0, 0.0, float(degrees))
    (s,), (_,) = claims.offsets(np.array([[start.x, start.y, start.heading]]))
    assert claims.initial_class(float(s)) == expected


def test_distance_is_monotone_as_figure_5_3_claims_for_every_start():
    data = data_of("fig5.3", runs=50)
    d = first_distance(data)
    for distance, (s, b) in zip(d, first_offsets(data), strict=True):
        assert claims.is_monotone(distance, s, slack=0.0)
        assert math.isclose(distance[0], math.hypot(s, b))


def test_distance_goes_to_the_involute_with_the_time_step():
    start, errors = pose(2.0, 0.0, 50.0), []
    for dt in (0.1, 0.05, 0.025):
        data = flown(start, gamma=0.0, dt=dt, steps=round(20 / dt))
        (s, b), time = first_offsets(data)[0], data.time.values
        exact = np.sqrt(
            4.0 + 2.0 * 2.0 * math.cos(math.radians(50.0)) * time
        )  # d0² + 2 V s t, s = d0 cos 50°
        np.testing.assert_allclose(claims.involute_distance(time, s, b, 1.0), exact)
        errors.append(np.abs(first_distance(data)[0] - exact).max())
    ratios = np.divide(errors[:-1], errors[1:])
    np.testing.assert_allclose(ratios, 2.0, rtol=0.05)  # first order in the time step


@pytest.mark.parametrize(("degrees", "x"), [(100.0, 1.0), (93.0, 2.0), (150.0, 2.0), (110.0, 0.7)])
def test_inward_starts_pass_where_the_closed_form_says(degrees, x):
    start = pose(x, 0.0, degrees)
    d = recurrence(
        start.x,
        start.y,
        start.heading,
        gamma=0.0,
        min_radius=0.5,
        speed=1.0,
        dt=0.001,
        steps=60_000,
    )
    (s,), (b,) = claims.offsets(np.array([[start.x, start.y, start.heading]]))
    assert math.isclose(
        claims.nearest_pass(float(s), float(b), 0.5), d.min(), abs_tol=0.01
    )  # some steps of 1 mm, and O(dt)


def test_penalty_keeps_closer_than_the_circle_and_settles_by_two_kinds_of_path():
    assert finding("fig5.4").agrees
    assert finding("fig5.5").agrees


def test_penalty_fails_with_the_sign_of_b_turned(broken):
    broken(wrong_side)
    assert not finding("fig5.4").agrees
    assert not finding("fig5.5").agrees


@pytest.mark.parametrize("gamma", [0.1, 0.3, 1.0, 10.0])
def test_leg_outward_is_that_of_continuous_steering(gamma):
    b, s = LEG_START
    assert np.allclose(
        claims.outward_leg(s, b, gamma=gamma, speed=1.0),
        turned(b, s, math.pi / 2, gamma=gamma, min_radius=0.5, speed=1.0),
        rtol=1e-6,
    )


def test_leg_outward_has_the_limits_of_small_and_large_gamma():
    leg = partial(claims.outward_leg, 0.5, 1.5, speed=1.0)
    assert math.isclose(
        leg(gamma=1e-4)[0], 4 * 0.5**3 / (3 * 1e-8), rel_tol=1e-2
    )  # grows without bound
    assert math.isclose(
        leg(gamma=1e8)[0], 2 * (1.5 - 0.5) * 0.5 + 4 * 0.5**3 / 3, rel_tol=1e-6
    )  # does not vanish
    durations = [leg(gamma=gamma)[0] for gamma in np.geomspace(0.01, 10, 30)]
    assert (np.diff(durations) < 0).all()


@pytest.mark.parametrize("gamma", [0.3, 1.0, 5.0])
def test_every_start_that_is_given_its_time_stays_within_the_bound(gamma):
    bound, dt = claims.orbit_bound(gamma, 0.5), 0.01
    for start in random_starts(12, seed=7, half_width=1.5):
        (s,), (b,) = claims.offsets(np.array([[start.x, start.y, start.heading]]))
        needed = claims.capture_time(float(s), float(b), gamma=gamma, min_radius=0.5, speed=1.0)
        steps = round((needed + 20.0) / dt)
        d = recurrence(
            start.x,
            start.y,
            start.heading,
            gamma=gamma,
            min_radius=0.5,
            speed=1.0,
            dt=dt,
            steps=steps,
        )
        assert d[round((needed + 1.0) / dt) :].max() < bound + 2 * dt


def test_bound_of_the_orbit_is_reached_by_what_passes_the_auv():
    dt = 1e-4
    d = recurrence(
        2.0, 0.0, math.radians(170.0), gamma=1.0, min_radius=0.5, speed=1.0, dt=dt, steps=100_000
    )
    after = d[d.argmin() :]
    assert math.isclose(
        after.max(), 9 / 8, abs_tol=0.01
    )  # (1/2 + 1/4)² / (2 · 1/4), and O(dt) of sliding at the AUV
    assert math.isclose(claims.orbit_bound(1.0, 0.5), 9 / 8)


def test_time_to_the_orbit_is_that_of_short_steps():
    for degrees in (30.0, 60.0, 80.0, 150.0):
        start = pose(1.5, 0.0, degrees)
        (s,), (b,) = claims.offsets(np.array([[start.x, start.y, start.heading]]))
        needed = claims.capture_time(float(s), float(b), gamma=1.0, min_radius=0.5, speed=1.0)
        d = recurrence(
            start.x,
            start.y,
            start.heading,
            gamma=1.0,
            min_radius=0.5,
            speed=1.0,
            dt=2e-4,
            steps=round((needed + 3) / 2e-4),
        )
        assert math.isclose(
            d.argmin() * 2e-4, needed, rel_tol=0.02
        )  # it settles as it passes the AUV


@pytest.mark.slow
def test_figure_5_6_settles_every_start_that_is_given_time_and_the_closed_form_names_the_others():
    assert finding("fig5.6", runs=25).agrees


def test_figure_5_6_fails_without_the_penalty(broken):
    broken(
        lambda offset, _, min_radius, *__: closed_form.path_inertia_radius(offset, 0.0, min_radius)
    )
    assert not finding("fig5.6", runs=25).agrees


@pytest.mark.slow
def test_gramians_of_fixed_cna_and_fixed_auv_are_equal_up_to_signs(monkeypatch):
    equality = gramian_equalities(20, seed=2)
    assert equality.current < 1e-12  # quadratic outputs: exact but for rounding
    assert equality.heading < 1e-8  # rounding of the output over ε
    monkeypatch.setattr("obsplan.thesis.equalities.SIGNS", np.eye(3))
    assert gramian_equalities(20, seed=2).heading > 0.1


def test_circle_is_fitted_exactly():
    angle = np.linspace(0.3, 2.0, 50)
    center, radius, misfit = claims.fit_circle(
        np.column_stack([3 + 2 * np.cos(angle), -1 + 2 * np.sin(angle)])
    )
    np.testing.assert_allclose([*center, radius, misfit], [3.0, -1.0, 2.0, 0.0], atol=1e-9)


def test_poses_are_those_flown():
    data = flown(pose(2.0, 1.0, 30.0), gamma=1.0, steps=20)
    step = np.diff(poses(data)[0, :, :2], axis=0)
    chord = 0.1 * np.sinc(data.turn_rate.values[0, :-1] * 0.05 / np.pi)
    np.testing.assert_allclose(np.hypot(*step.T), chord, rtol=1e-9)
