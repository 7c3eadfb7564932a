"""Claims about surveys and the motion that follows them."""

import math
from typing import get_type_hints

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from obsplan.surveys import SURVEYS, Formation, Lawnmower, Motion, Reference, Static, Waypoints

STILL = np.zeros(2)
coordinate = st.floats(-500, 500)


@st.composite
def polylines(draw):
    """Random polylines with legs of at least 1 m."""
    start = np.array([draw(coordinate), draw(coordinate)])
    legs = draw(
        st.lists(st.tuples(st.floats(1, 200), st.floats(-math.pi, math.pi)), min_size=1, max_size=6)
    )
    return np.vstack(
        [start, start + np.cumsum([(d * math.cos(a), d * math.sin(a)) for d, a in legs], axis=0)]
    )


@st.composite
def currents(draw):
    """Currents up to 0.9 of a speed of 1 m/s, in any direction: never too strong."""
    size, angle = draw(st.floats(0, 0.9)), draw(st.floats(-math.pi, math.pi))
    return np.array([size * math.cos(angle), size * math.sin(angle)])


# --- lawnmower -------------------------------------------------------------------------------------------------------------------


def test_lawnmower_of_three_legs_is_the_one_drawn_by_hand():
    #   1 ── 2   5        heading north from (10, 20), 100 m legs, 30 m apart, laid to the right (east)
    #   │    │   │
    #   0    3 ─ 4
    survey = Lawnmower(
        legs=3, length=100.0, spacing=30.0, heading=math.pi / 2, x=10.0, y=20.0, side="right"
    )
    by_hand = [[10, 20], [10, 120], [40, 120], [40, 20], [70, 20], [70, 120]]
    np.testing.assert_allclose(survey.vertices(), by_hand, atol=1e-12)


def test_lawnmower_sides_mirror_each_other_in_the_first_leg():
    left, right = (
        Lawnmower(legs=4, length=50.0, spacing=8.0, heading=0.0, side=side).vertices()
        for side in ("left", "right")
    )
    np.testing.assert_allclose(left, right * [1, -1], atol=1e-12)
    assert left[:, 1].max() == pytest.approx(24.0)


@given(
    legs=st.integers(1, 9),
    length=st.floats(1, 500),
    spacing=st.floats(1, 50),
    heading=st.floats(-7, 7),
)
def test_lawnmower_is_as_long_as_its_legs_and_links_whatever_its_heading(
    legs, length, spacing, heading
):
    vertices = Lawnmower(
        legs=legs, length=length, spacing=spacing, heading=heading, x=3.0, y=-4.0
    ).vertices()
    sides = np.linalg.norm(np.diff(vertices, axis=0), axis=1)
    np.testing.assert_allclose(sides[::2], length, rtol=1e-9)
    np.testing.assert_allclose(sides[1::2], spacing, rtol=1e-9)
    assert len(vertices) == 2 * legs


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"legs": 0}, r"legs must be from 1 to 10000 .*, got 0"),
        ({"length": 0.0}, r"length must be from 0.001 to 100000 m .*, got 0.0"),
        ({"length": math.nan}, r"length must be from 0.001 to 100000 m .*, got nan"),
        ({"spacing": -2.0}, r"spacing must be from 0.001 to 100000 m .*, got -2.0"),
        ({"spacing": math.inf}, r"spacing must be from 0.001 to 100000 m .*, got inf"),
        ({"heading": math.nan}, r"heading must be finite \[rad\], got nan"),
        ({"x": math.inf}, r"x must be from -100000 to 100000 m .*, got inf"),
    ],
)
def test_lawnmower_refuses_by_name_and_value(change, message):
    with pytest.raises(ValueError, match=message):
        Lawnmower(**{"legs": 2, "length": 10.0, "spacing": 1.0, **change})


# --- the other kinds ----------------------------------------------------------------------------------------------------------------


def test_waypoints_are_passed_in_order():
    points = ((0.0, 0.0), (30.0, 40.0), (30.0, 0.0))
    reference = Waypoints(points=points).reference(speed=2.0, current=STILL)
    np.testing.assert_allclose(
        reference.position(np.array([0.0, 25.0, 45.0])), points, atol=1e-12
    )  # legs of 50 m and 40 m at 2 m/s


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ((), "needs at least two points, got none: add one"),
        (((1.0, 2.0),), r"needs at least two points, got only \[\(1.0, 2.0\)\]: add one"),
        (
            ((0.0, 0.0), (1.0, 1.0), (1.0, 1.0)),
            r"waypoints 1 and 2 are identical, at \(1.000, 1.000\) m: remove one",
        ),
        (
            ((0.0, 0.0), (1.0, math.nan)),
            r"waypoint 1 must be two finite numbers \[m\], got \(1.0, nan\)",
        ),
    ],
)
def test_waypoints_refuse_what_cannot_be_followed(points, message):
    with pytest.raises(ValueError, match=message):
        Waypoints(points=points)


def test_coming_back_to_an_earlier_waypoint_is_allowed():
    assert Waypoints(points=((0.0, 0.0), (1.0, 0.0), (0.0, 0.0))).reference(
        speed=1.0, current=STILL
    ).duration == pytest.approx(2.0)


def test_static_without_current_rests_with_its_own_heading():
    motion = (
        Static(x=3.0, y=4.0, heading=1.2).reference(speed=0.0, current=STILL).sample(np.arange(5.0))
    )
    np.testing.assert_array_equal(motion.position, np.tile([3.0, 4.0], (5, 1)))
    np.testing.assert_array_equal(motion.speed, 0.0)
    np.testing.assert_array_equal(motion.heading, 1.2)


def test_static_in_a_current_heads_into_it_at_its_speed():
    motion = (
        Static(x=3.0, y=4.0)
        .reference(speed=0.0, current=np.array([-0.3, -0.4]))
        .sample(np.arange(5.0))
    )
    np.testing.assert_allclose(motion.position, np.tile([3.0, 4.0], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(motion.speed, 0.5, atol=1e-12)
    np.testing.assert_allclose(motion.heading, math.atan2(0.4, 0.3), atol=1e-12)


@pytest.mark.parametrize("name", ["x", "y", "heading"])
def test_static_refuses_what_is_not_finite(name):
    with pytest.raises(ValueError, match=f"{name} must be (finite|from -100000) .*, got nan"):
        Static(**{name: math.nan})


def test_formation_keeps_its_offset_and_its_leaders_velocity():
    leader = Lawnmower(legs=3, length=40.0, spacing=10.0, heading=0.3).reference(
        speed=1.2, current=np.array([0.2, -0.1])
    )
    time = np.linspace(0.0, leader.duration + 10, 200)
    own, led = (
        reference.sample(time)
        for reference in (Formation(leader="alpha", east=5.0, north=-7.0).follow(leader), leader)
    )
    np.testing.assert_allclose(
        own.position - led.position, np.tile([5.0, -7.0], (200, 1)), atol=1e-9
    )
    np.testing.assert_allclose(own.speed, led.speed, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"leader": ""}, "leader is empty: give the name"),
        ({"east": math.nan}, r"east must be from -100000 to 100000 m .*, got nan"),
    ],
)
def test_formation_refuses_by_name_and_value(change, message):
    with pytest.raises(ValueError, match=message):
        Formation(**{"leader": "alpha", **change})


@pytest.mark.parametrize("kind", SURVEYS)
def test_every_field_of_every_survey_explains_itself(kind):
    for name, hint in get_type_hints(SURVEYS[kind], include_extras=True).items():
        assert isinstance(hint.__metadata__[0], str), name


# --- motion -------------------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("current", "ground_speed"),
    [
        ((0.0, 3.0), 4.0),
        ((0.0, -3.0), 4.0),
        ((3.0, 0.0), 8.0),
        ((-3.0, 0.0), 2.0),
        ((1.0, 3.0), 5.0),
    ],
)
def test_ground_speed_is_that_of_the_3_4_5_triangle(current, ground_speed):
    reference = Reference(
        polyline=np.array([[0.0, 0.0], [100.0, 0.0]]), speed=5.0, current=np.array(current)
    )
    assert reference.duration == pytest.approx(100 / ground_speed)
    np.testing.assert_allclose(reference.position(1.0), [ground_speed, 0.0], atol=1e-12)


@given(polyline=polylines(), current=currents())
def test_crab_angle_and_speed_are_those_of_navigation_books(polyline, current):
    # heading to steer = track − arcsin(cross set / speed through the water): the wind triangle
    reference = Reference(polyline=polyline, speed=1.0, current=current)
    for a, b, begin, end in zip(
        polyline, polyline[1:], reference.arrival, reference.arrival[1:], strict=False
    ):
        track = math.atan2(*(b - a)[::-1])
        set_left = current @ [-math.sin(track), math.cos(track)]
        motion = reference.sample(np.linspace(begin, end, 4))
        np.testing.assert_allclose(motion.speed, 1.0, rtol=1e-7)
        np.testing.assert_allclose(
            np.exp(1j * motion.heading), np.exp(1j * (track - math.asin(set_left))), atol=1e-7
        )


@pytest.mark.slow
@given(polyline=polylines(), current=currents(), dt=st.floats(0.05, 30))
def test_heading_and_speed_of_each_interval_lead_to_the_next_sample(polyline, current, dt):
    reference = Reference(polyline=polyline, speed=1.0, current=current)
    time = dt * np.arange(-2, min(400, int(reference.duration / dt) + 4))
    motion = reference.sample(time)
    assert isinstance(motion, Motion)
    p = motion.position[0]
    for k in range(time.size - 1):
        p = (
            p
            + motion.speed[k]
            * dt
            * np.array([math.cos(motion.heading[k]), math.sin(motion.heading[k])])
            + current * dt
        )
        np.testing.assert_allclose(p, motion.position[k + 1], rtol=0, atol=1e-9)
    assert motion.speed[-1] == motion.speed[-2]
    assert motion.heading[-1] == motion.heading[-2]


@given(polyline=polylines(), current=currents())
def test_heading_never_jumps_by_more_than_half_a_turn(polyline, current):
    reference = Reference(polyline=polyline, speed=1.0, current=current)
    heading = reference.sample(np.linspace(0, reference.duration, 50)).heading
    assert np.abs(np.diff(heading)).max() <= math.pi + 1e-9


def test_heading_counts_the_turns_of_a_square_walked_three_times():
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    reference = Reference(polyline=np.vstack([square, square, square, [[0.0, 0.0]]]), speed=1.0)
    heading = reference.sample(np.linspace(0.0, 12.0, 121)).heading
    assert heading[-1] == pytest.approx(
        2.75 * 2 * math.pi
    )  # the last leg points south of a third turn


def test_motion_waits_before_the_start_and_holds_its_last_heading_after_the_end():
    motion = Reference(
        polyline=np.array([[0.0, 0.0], [0.0, 4.0]]), speed=1.0, initial_heading=0.5
    ).sample(np.arange(-2.0, 8.0))
    np.testing.assert_allclose(motion.position[:, 1], [0, 0, 0, 1, 2, 3, 4, 4, 4, 4])
    np.testing.assert_allclose(motion.heading, [0.5, 0.5, *[math.pi / 2] * 8])
    np.testing.assert_allclose(motion.speed, [0, 0, 1, 1, 1, 1, 0, 0, 0, 0])


def test_position_takes_times_of_any_shape():
    reference = Reference(polyline=np.array([[0.0, 0.0], [10.0, 0.0]]), speed=1.0)
    assert reference.position(np.arange(6.0).reshape(2, 3)).shape == (2, 3, 2)
    np.testing.assert_allclose(reference.position(2.5), [2.5, 0.0])


@pytest.mark.parametrize(
    ("speed", "current", "message"),
    [
        (1.0, (0.0, 1.0), r"too strong for leg 0, heading 0.0 degrees .*1 m/s across and"),
        (1.0, (-1.0, 0.0), r"too strong for leg 0, .*-1 m/s along\): give a higher speed"),
        (
            1.0,
            (0.5, 1.2),
            r"too strong for leg 0, .*1.2 m/s across",
        ),  # though it carries the vehicle forward
        (1.0, (0.9, 0.9), None),  # 0.9 m/s across and 0.9 along both legs: held
        (1.0, (0.9, -0.9), r"too strong for leg 1, heading 90.0 degrees"),  # against the second leg
        (1.0, (math.nan, 0.0), "current must be two finite numbers"),
        (
            0.0,
            (0.0, 0.0),
            r"speed of a survey that moves must be from 0.001 m/s, .*, got 0.0",
        ),
        (-1.0, (0.0, 0.0), "got -1.0"),
        (math.nan, (0.0, 0.0), "got nan"),
    ],
)
def test_what_the_vehicle_cannot_hold_is_refused_with_the_remedy(speed, current, message):
    polyline = np.array([[0.0, 0.0], [100.0, 0.0], [100.0, 50.0]])
    if message is None:
        assert Reference(polyline=polyline, speed=speed, current=np.array(current)).duration > 0
    else:
        with pytest.raises(ValueError, match=message):
            Reference(polyline=polyline, speed=speed, current=np.array(current))


def test_reference_refuses_an_empty_survey_and_a_heading_that_is_not_finite():
    with pytest.raises(ValueError, match="the survey is empty"):
        Reference(polyline=np.empty((0, 2)), speed=1.0)
    with pytest.raises(ValueError, match="initial_heading must be finite"):
        Reference(polyline=np.zeros((1, 2)), speed=1.0, initial_heading=math.inf)


@pytest.mark.parametrize("time", [[0.0], [0.0, 0.0], [1.0, 0.5]])
def test_sampling_needs_increasing_instants(time):
    with pytest.raises(ValueError, match="time must be at least two increasing instants"):
        Static().reference(speed=0.0, current=STILL).sample(np.array(time))


# --- a speed per leg, a hold per vertex -------------------------------------------------------------------------------------------------

THREE = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 40.0], [0.0, 40.0]])  # legs of 30, 40 and 30 m
PACED = {"speed": np.array([3.0, 2.0, 1.0]), "hold": np.array([5.0, 0.0, 7.0, 4.0])}


def test_legs_take_their_length_over_their_own_speed_and_holds_come_on_top():
    reference = Reference(polyline=THREE, **PACED)
    np.testing.assert_allclose(reference.arrival, [0, 15, 35, 72], rtol=1e-12)
    np.testing.assert_allclose(reference.departure, [5, 15, 42, 76], rtol=1e-12)
    assert reference.duration == pytest.approx(76.0, rel=1e-12)


def test_position_stands_while_a_vertex_is_held_and_moves_at_each_legs_speed():
    reference = Reference(polyline=THREE, **PACED)
    instants = np.array([-1.0, 0.0, 5.0, 6.0, 15.0, 16.0, 35.0, 38.5, 42.0, 43.0, 72.0, 75.0, 99.0])
    by_hand = [
        [0, 0],  # before the start
        [0, 0],
        [0, 0],  # held for 5 s
        [3, 0],
        [30, 0],  # passed without a stop
        [30, 2],
        [30, 40],
        [30, 40],  # in the middle of a hold
        [30, 40],
        [29, 40],
        [0, 40],
        [0, 40],  # held at the end
        [0, 40],  # and kept after it
    ]
    np.testing.assert_allclose(reference.position(instants), by_hand, atol=1e-9)


def test_each_leg_in_a_current_is_the_wind_triangle_at_its_own_speed():
    current = np.array([3.0, 0.0])
    polyline = np.array([[0.0, 0.0], [0.0, 80.0], [40.0, 80.0]])
    reference = Reference(polyline=polyline, speed=np.array([5.0, 1.0]), current=current)
    # 5 m/s through the water, 3 across: 4 over ground; then 1 m/s along 3: 4 over ground
    np.testing.assert_allclose(reference.ground_speed, [4.0, 4.0], rtol=1e-12)
    np.testing.assert_allclose(reference.arrival, [0.0, 20.0, 30.0], rtol=1e-12)


def test_one_speed_on_every_leg_is_the_same_motion_as_that_speed_and_no_hold_as_none():
    time = np.linspace(-3.0, 200.0, 700)
    current = np.array([0.3, -0.2])
    plain = Reference(polyline=THREE, speed=0.8, current=current)
    paced = Reference(
        polyline=THREE, speed=np.full(3, 0.8), hold=np.zeros(4), current=current
    )  # to the bit: results of scenarios without holds do not change
    for name in ("position", "heading", "speed"):
        np.testing.assert_array_equal(
            getattr(plain.sample(time), name), getattr(paced.sample(time), name)
        )


def test_while_held_the_vehicle_rests_or_heads_into_the_current_at_its_speed():
    time = np.arange(0.0, 60.0)
    resting = Reference(
        polyline=THREE, speed=np.array([3.0, 2.0, 1.0]), hold=np.array([0, 9.0, 0, 0])
    )
    motion = resting.sample(time)
    held = (time >= resting.arrival[1]) & (time + 1 <= resting.departure[1])
    assert held.sum() == 9
    np.testing.assert_array_equal(motion.speed[held], 0.0)
    np.testing.assert_allclose(motion.heading[held], 0.0, atol=1e-12)  # that of the leg before
    drifting = Reference(
        polyline=THREE,
        speed=np.array([3.0, 2.0, 1.0]),
        hold=np.array([5.0, 0, 0, 0]),
        current=np.array([0.0, 0.6]),
    ).sample(time)
    np.testing.assert_allclose(drifting.speed[:5], 0.6, atol=1e-12)
    np.testing.assert_allclose(drifting.heading[:5], -math.pi / 2, atol=1e-12)


@pytest.mark.slow
@given(
    polyline=polylines(),
    current=currents(),
    dt=st.floats(0.05, 30),
    random=st.randoms(use_true_random=False),
)
def test_paced_motion_leads_from_sample_to_sample(polyline, current, dt, random):
    n = len(polyline)
    reference = Reference(
        polyline=polyline,
        speed=np.array([random.uniform(1.0, 3.0) for _ in range(n - 1)]),
        hold=np.array([random.choice([0.0, random.uniform(0, 90)]) for _ in range(n)]),
        current=current,
    )
    time = dt * np.arange(-2, min(400, int(reference.duration / dt) + 4))
    motion = reference.sample(time)
    towards = np.column_stack([np.cos(motion.heading), np.sin(motion.heading)])
    steps = dt * (motion.speed[:, None] * towards + current)
    np.testing.assert_allclose(np.diff(motion.position, axis=0), steps[:-1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(reference.position(reference.departure), polyline, atol=1e-9)
    np.testing.assert_allclose(reference.position(reference.arrival), polyline, atol=1e-9)


def test_formation_keeps_its_leaders_pace():
    leader = Reference(polyline=THREE, **PACED)
    own = Formation(leader="alpha", east=5.0, north=-7.0).follow(leader)
    np.testing.assert_array_equal(own.arrival, leader.arrival)
    np.testing.assert_array_equal(own.departure, leader.departure)


def test_waypoints_keep_their_own_speeds_unless_the_auv_has_one():
    survey = Waypoints(
        points=((0.0, 0.0), (30.0, 0.0), (30.0, 40.0)), speeds=(3.0, 2.0), holds=(0.0, 5.0, 0.0)
    )
    own = survey.reference(speed=None, current=STILL)
    np.testing.assert_allclose(own.arrival, [0.0, 10.0, 35.0], rtol=1e-12)
    given_one = survey.reference(speed=1.0, current=STILL)
    np.testing.assert_allclose(given_one.arrival, [0.0, 30.0, 75.0], rtol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"speeds": (1.0,)}, "speeds must be one for each of the 2 legs, got 1"),
        ({"speeds": (1.0, 1.0, 1.0)}, "speeds must be one for each of the 2 legs, got 3"),
        ({"speeds": (1.0, 0.0)}, r"speeds\[1\] must be from 0.001 m/s.*, got 0.0: correct it"),
        ({"speeds": (300.0, 1.0)}, r"speeds\[0\] must be .* to 10.0 m/s, .* got 300.0"),
        ({"speeds": (1.0, math.nan)}, r"speeds\[1\] must be .* got nan"),
        ({"holds": (1.0, 1.0)}, "holds must be one for each of the 3 points, got 2"),
        ({"holds": (0.0, -1.0, 0.0)}, r"holds\[1\] must be from 0 s to 86400 s, a day, got -1.0"),
        ({"holds": (0.0, 0.0, 1e6)}, r"holds\[2\] must be .* got 1000000.0: correct it"),
        ({"holds": (math.nan, 0.0, 0.0)}, r"holds\[0\] must be .* got nan"),
    ],
)
def test_speeds_and_holds_out_of_their_bounds_are_refused_by_index_and_value(change, message):
    points = ((0.0, 0.0), (10.0, 0.0), (10.0, 10.0))
    with pytest.raises(ValueError, match=message):
        Waypoints(points=points, **change)


def test_a_survey_that_moves_needs_a_speed_from_somewhere_and_a_station_does_not():
    with pytest.raises(ValueError, match="the survey moves and has no speed: give the AUV a speed"):
        Lawnmower(legs=2, length=10.0, spacing=1.0).reference(speed=None, current=STILL)
    with pytest.raises(ValueError, match=r"too strong for leg 1, .* at 0.5 m/s"):
        Reference(
            polyline=THREE, speed=np.array([2.0, 0.5, 2.0]), current=np.array([0.0, -1.0])
        )  # the slow leg alone
    assert Static().reference(speed=None, current=STILL).duration == 0.0
