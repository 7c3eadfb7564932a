"""A scenario made of a mission file: everything in the file is written, or said; what can be no survey is refused."""

import shlex
import tomllib

import numpy as np
import pytest

from obsplan.constraints import Disc
from obsplan.missions import READERS, Area, Mission, Track
from obsplan.planners import PLANNERS
from obsplan.scenario import from_dict, load
from obsplan.scenario.account import write_new
from obsplan.scenario.plausible import known_speeds
from obsplan.simulation import simulate
from obsplan.types import ObsplanError

LAT, LON = 63.44, 10.40
LAWN = np.array([[0, 0], [0, 240], [40, 240], [40, 0], [80, 0], [80, 240]], dtype=float)
LAWN_DEGREES = np.column_stack(  # at the parallel's and the meridian's radius of curvature
    [LAT + LAWN[:, 1] / 111_489.0, LON + LAWN[:, 0] / 49_892.0]
)


@pytest.fixture
def new(monkeypatch, tmp_path):
    """Make a scenario of what a reader finds in `mission.fake`; give what is said and the file's contents."""
    monkeypatch.chdir(tmp_path)

    def make(mission, out="s.toml", name="mission.fake"):
        monkeypatch.setitem(READERS, ".fake", lambda path: mission)
        (tmp_path / name).write_text("")
        path = tmp_path / out
        lines = write_new(tmp_path / name, path)
        return "\n".join(lines), path.read_text(encoding="utf-8")

    return make


def geographic(**parts):
    """A mission that surveys LAWN in degrees."""
    track = parts.pop("track", {})
    tracks = {"LAWN": Track(points=LAWN_DEGREES, **track)}
    return Mission(**({"tracks": tracks, "geographic": True} | parts))


def local(points, **track):
    """A mission in metres."""
    points = np.array(points, dtype=float)
    return Mission(tracks={"t": Track(points=points, **track)}, geographic=False)


def at(east, north):
    """The place so many metres from the first waypoint."""
    return [LAT + north / 111_489.0, LON + east / 49_892.0]


SQUARE = Area(points=np.array([at(-100, -50), at(150, -50), at(150, 300), at(-100, 300)]))
ROCK = Area(points=np.array([at(60, 120)]), radius=15.0)


# --- what is written ----------------------------------------------------------------------------------------------------------------


def test_a_mission_comes_out_in_metres_about_its_first_waypoint(new):
    _, text = new(geographic())
    data = tomllib.loads(text)
    assert data["origin"] == {"lat": LAT, "lon": LON}
    points = load("s.toml").resolved()["auv"][0]["survey"]["points"]
    np.testing.assert_allclose(points, LAWN, atol=0.1)  # the ellipsoid's curvature over 240 m


def test_one_speed_in_the_file_is_the_auvs(new):
    said, text = new(geographic(track={"speed": np.full(5, 0.8)}))
    assert tomllib.loads(text)["auv"][0]["speed"] == 0.8
    assert "6 points, 800 m, 16.7 min at 0.8 m/s (from the file)" in said  # 800 m / 0.8 m/s
    assert "a mission of 16.7 min" in said


def test_speeds_that_vary_are_left_to_the_file_and_flown(new):
    speeds = np.array([1.0, 0.5, 1.0, 0.5, 1.0])
    said, text = new(geographic(track={"speed": speeds}))
    assert "speed" not in tomllib.loads(text)["auv"][0]
    assert "# no speed: 0.5 to 1 m/s, leg by leg from the file" in text
    assert "14.7 min at 0.5 to 1 m/s, leg by leg from the file" in said  # 720 s + 160 s
    assert load("s.toml").references[0].duration == pytest.approx(880.0, rel=1e-3)


def test_legs_without_a_speed_take_their_neighbours_and_that_is_said(new):
    speeds = np.array([np.nan, np.nan, 0.5, np.nan, 1.0])
    said, _ = new(geographic(track={"speed": speeds}))
    assert 'track "LAWN" has no speed on 3 of its 5 legs: each takes that of the leg before' in said
    np.testing.assert_allclose(load("s.toml").references[0].speed, [0.5, 0.5, 0.5, 0.5, 1.0])


def test_known_speeds_hold_until_the_next_and_from_the_first():
    track = Track(points=LAWN, speed=np.array([np.nan, 2.0, np.nan, np.nan, 3.0]))
    np.testing.assert_array_equal(known_speeds(track), [2.0, 2.0, 2.0, 2.0, 3.0])
    assert known_speeds(Track(points=LAWN, speed=np.full(5, np.nan))) is None
    assert known_speeds(Track(points=LAWN)) is None


def test_a_speed_no_auv_has_is_not_written_and_said(new):
    said, text = new(geographic(track={"speed": np.full(5, 15.0)}))
    assert tomllib.loads(text)["auv"][0]["speed"] == 1.2
    assert 'track "LAWN" has speeds from 15 to 15 m/s, and AUVs go 0.001 to 10.0 m/s' in said
    assert "instead" in text


def test_holds_and_altitude_are_said_and_holds_flown(new):
    hold = np.array([0.0, 30.0, 0.0, 60.0, 0.0, 0.0])
    altitude = np.array([0.0, -5.0, -5.0, -12.5, -5.0, 0.0])
    said, _ = new(geographic(track={"hold": hold, "altitude": altitude}))
    assert "holds 90 s in all, at 2 of its points" in said
    assert "altitude -12.5 to 0 m, not used: ranges are taken as horizontal" in said
    scenario = load("s.toml")
    assert scenario.references[0].duration == pytest.approx(800 / 1.2 + 90, rel=1e-3)


def test_limits_are_written_to_the_centimetre_and_the_start_keeps_them(new):
    said, text = new(geographic(geofences=(SQUARE,), keep_outs=(ROCK,)))
    limits = load("s.toml").constraints
    np.testing.assert_allclose(
        limits.geofence.points, [[-100, -50], [150, -50], [150, 300], [-100, 300]], atol=0.1
    )
    (rock,) = limits.keep_out
    assert (rock.x, rock.y, rock.radius) == pytest.approx((60.0, 120.0, 15.0), abs=0.05)
    digits = [abs(number * 100 - round(number * 100)) for number in (rock.x, rock.y)]
    assert max(digits) < 1e-6
    assert "geofence: 250 m by 350 m about (25.0, 125.0) m, 4 corners" in said
    assert "keep-out: disc of radius 15 m about (60.0, 120.0) m" in said
    assert tomllib.loads(text)["cna"]["start"] == {"x": -50.0, "y": 0.0, "heading_deg": 90.0}


def test_a_round_fence_is_written_round(new):
    _, text = new(geographic(geofences=(Area(points=np.array([at(0, 100)]), radius=300.0),)))
    fence = tomllib.loads(text)["constraints"]["geofence"]
    assert fence["radius"] == 300.0
    assert isinstance(load("s.toml").constraints.geofence, Disc)


@pytest.mark.parametrize(
    ("east", "north", "rock"),
    [
        ((-20, 60), (-15, 260), (-50, 20, 20)),
        ((-90, -20), (-50, 300), (-50, 20, 20)),
        ((30, 200), (-200, -20), (-50, 20, 20)),
        ((-58, 200), (-200, 200), (-35, 0, 8)),  # 50 m west is free, and no circle there is
    ],
)
def test_the_start_is_inside_the_fence_with_room_to_turn(new, east, north, rock):
    corners = [at(e, n) for e in east for n in north]
    fence = Area(points=np.array([corners[0], corners[1], corners[3], corners[2]]))
    disc = Area(points=np.array([at(*rock[:2])]), radius=float(rock[2]))
    said, _ = new(geographic(geofences=(fence,), keep_outs=(disc,)))
    scenario = load("s.toml")
    start = scenario.start
    position = np.array([start.x, start.y])
    left = 10.0 * np.array([-np.sin(start.heading), np.cos(start.heading)])
    circle = np.linspace(0, 2 * np.pi, 100)
    around = 10.0 * np.column_stack([np.cos(circle), np.sin(circle)])

    def free(points):
        inside = np.logical_and(points > [east[0], north[0]], points < [east[1], north[1]])
        clear = np.hypot(*(points - rock[:2]).T) > rock[2]
        return (inside.all(axis=1) & clear).all()

    assert free(position[None])
    assert free(position + left + around) or free(position - left + around)
    assert "outside the limits" not in said


def test_a_fence_without_room_for_a_start_is_said(new):
    fence = Area(points=np.array([at(0, 0), at(12, 0), at(12, 12), at(0, 12)]))  # 10 m to turn
    said, text = new(geographic(geofences=(fence,)))
    assert "the aid vehicle's start is outside the limits" in said
    assert "move cna.start" in text


def test_fences_that_have_an_area_in_common_become_it_and_others_are_left_out(new):
    disc = Area(points=np.array([at(150, 120)]), radius=200.0)
    said, _ = new(geographic(geofences=(SQUARE, disc)), out="a.toml")
    assert "the 2 geofences, all of which hold, are written as the one area they have" in said
    fence = load("a.toml").constraints.geofence
    corners = np.array(fence.points)
    assert (np.hypot(*(corners - [150, 120]).T) < 200.5).all()
    assert corners[:, 0].max() == pytest.approx(150.0, abs=0.2)
    apart = Area(points=np.array([at(900, 0)]), radius=50.0)
    said, text = new(geographic(geofences=(SQUARE, apart)), out="b.toml")
    assert "no geofence is written: the 2 geofences, all of which hold, have no one area" in said
    assert "geofence" not in tomllib.loads(text)["constraints"]


def test_an_area_that_is_none_is_left_out_with_its_reason(new):
    line = Area(points=np.array([at(0, 0), at(50, 0)]))
    said, text = new(geographic(keep_outs=(ROCK, line)))
    assert "keep-out 2 is left out: a polygon needs at least three corners, got 2" in said
    assert len(tomllib.loads(text)["constraints"]["keep_out"]) == 1


def test_every_remark_is_said_and_stands_in_the_file(new):
    remarks = ("rally points, passed over: 1", 'camera "x" \x1b[31m\nred = 1')
    said, text = new(geographic(remarks=remarks))
    assert "Passed over, or not as in the file:\n  rally points, passed over: 1\n" in said
    assert "# - rally points, passed over: 1" in text
    assert "\x1b" not in said + text
    assert "red" not in tomllib.loads(text)  # a line break in a remark ends no comment


def test_the_origin_is_said_with_its_reason(new):
    home = (LAT, LON - 0.01)
    said, text = new(geographic(home=home), out="a.toml")
    assert "origin at latitude 63.44, longitude 10.39, the planned home" in said
    assert tomllib.loads(text)["origin"]["lon"] == pytest.approx(LON - 0.01)
    said, text = new(geographic(home=(0.0, 0.0)), out="b.toml")
    assert "the first waypoint, since the planned home at 0.0, 0.0 is over 100 km away" in said
    assert tomllib.loads(text)["origin"]["lat"] == LAT
    said, text = new(geographic(), out="c.toml")
    assert "the first waypoint, for want of a planned home" in said
    said, text = new(local(LAWN), out="d.toml")
    assert "a placeholder, since the file is in metres: say where it is" in said
    assert "# Origin: a placeholder" in text


def test_each_track_has_an_auv_and_a_name_fit_for_tables(new):
    names = ["=1+1", "-1-1", "lane \u00fc 3", "/", "x" * 90]
    tracks = {name: Track(points=LAWN_DEGREES) for name in names}
    said, text = new(geographic(tracks=tracks))
    auvs = tomllib.loads(text)["auv"]
    assert [auv["survey"]["track"] for auv in auvs] == names
    assert [auv["name"] for auv in auvs] == ["1-1", "1-1-2", "lane \u00fc 3", "auv", "x" * 40]
    assert "5 tracks, an AUV for each" in said
    assert 'the AUV on track "=1+1" is called "1-1"' in said
    assert 'is called "lane' not in said


def test_names_are_quoted_where_they_are_pasted_and_where_they_are_toml(new):
    name = 'my "survey" \\ 1.fake'
    said, text = new(local(LAWN), name=name, out="my 'own'.toml")
    assert "my 'own'.toml" in said.splitlines()[-1]
    command = next(line for line in text.splitlines() if "then: " in line).split("then: ")[1]
    assert shlex.split(command) == ["obsplan", "run", "my 'own'.toml"]
    assert tomllib.loads(text)["auv"][0]["survey"]["file"] == name


def test_the_template_names_every_planner(new):
    _, text = new(geographic())
    comment = text[text.index("[planner]") : text.index('kind = "default"')]
    assert set(PLANNERS) <= set(comment.replace("#", " ").replace(",", " ").split())


@pytest.mark.slow
def test_what_is_written_flies(new):
    new(geographic(geofences=(SQUARE,), keep_outs=(ROCK,), track={"speed": np.arange(1.0, 6.0)}))
    run = simulate(load("s.toml", settings=["duration=40.0"]), planner="information")
    assert run.violation.max() <= 0.0


# --- what is refused ----------------------------------------------------------------------------------------------------------------

TANK = [[0.25, 0.5], [0.25, 3.0], [1.0, 3.0], [1.0, 0.5]]


@pytest.mark.parametrize(
    ("mission", "message"),
    [
        (local(LAWN / 400), "spans 632 mm, less than any survey at the speed of an AUV"),
        (
            local(LAWN_DEGREES),
            "has all its 6 points within 0.0022 m of (63.44, 10.4), which look like degrees in columns of metres: "
            "head the columns lat and lon",
        ),
        (local(LAWN_DEGREES[:, ::-1]), "look like degrees"),
        (local([[59.9139, 10.7522], [60.3913, 5.3221], [58.97, 5.7331]]), "look like degrees"),
        (
            Mission(
                tracks={"t": Track(points=np.array([[60.0, 10.0], [60.1, 10.0], [40.0, 20.0]]))},
                geographic=True,
            ),
            "km, and the map ends at 100 km: correct the point (40.0, 20.0) if it is astray",
        ),
        (local([[-9e4, 0.0], [9e4, 0.0]]), "spans 180 km"),
        (
            local([[0.0, 0.0], [0.0, 5.0]], speed=np.array([9.0])),
            "is a mission of 0.56 s, over before anything can be measured",
        ),
        (
            local([[0.0, 0.0], [9e4, 0.0]], speed=np.array([0.5])),
            "is a mission of 50 h, and at most 48 h are planned",
        ),
    ],
)
def test_what_can_be_no_survey_is_refused_and_nothing_written(new, tmp_path, mission, message):
    with pytest.raises(ObsplanError) as caught:
        new(mission)
    assert str(caught.value).startswith("mission.fake")
    assert message in str(caught.value)
    assert not (tmp_path / "s.toml").exists()


@pytest.mark.parametrize(
    "points",
    [
        TANK,
        [[0.0, 0.0], [2.0, 0.0], [2.0, 1.4142135623]],
        [[12.5, 3.25], [12.5, 4.75], [14.25, 4.75]],
        [[63.44, 10.4], [63.44, 17.9], [66.0, 17.9]],  # a basin that is measured from its corner
    ],
)
def test_a_test_tank_passes_and_has_its_own_numbers(new, points):
    said, text = new(local(points))
    data = tomllib.loads(text)
    assert data["auv"][0]["speed"] == 0.3
    assert data["cna"]["min_turn_radius"] < 1.0
    assert "taken to be in a test tank" in said
    assert load("s.toml").pings.size > 0


def test_a_slow_vehicle_may_survey_less_than_a_metre(new):
    said, _ = new(local([[0.0, 0.0], [0.5, 0.0]], speed=np.array([0.02])))
    assert "0.50 m, 25 s at 0.02 m/s" in said


def test_a_scenario_whose_survey_is_degrees_in_metres_is_refused(monkeypatch):
    monkeypatch.setitem(READERS, ".fake", lambda path: local(LAWN_DEGREES))
    survey = {"kind": "mission", "file": "m.fake"}
    data = {
        "origin": {"lat": LAT, "lon": LON},
        "cna": {"speed": 2.0, "min_turn_radius": 10.0},
        "auv": [{"speed": 1.0, "survey": survey}],
    }
    with pytest.raises(ObsplanError, match=r"m\.fake has all its 6 points within .* look like deg"):
        from_dict(data)
