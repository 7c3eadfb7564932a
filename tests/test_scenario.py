"""Scenario files: what is accepted, and the one sentence that answers everything else."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracles import scenario

from obsplan.missions import READERS, Mission, Track
from obsplan.scenario import from_dict, load, shipped
from obsplan.scenario.files import SHIPPED, read
from obsplan.scenario.schema import json_schema, sections
from obsplan.types import Belief, ObsplanError, Pose

ORIGIN = {"lat": 47.6, "lon": -122.3}
CNA = {"speed": 1.0, "min_turn_radius": 0.5}
LINE = {"kind": "waypoints", "points": [[0.0, 0.0], [100.0, 0.0]]}
SMALL = {"origin": ORIGIN, "cna": CNA, "auv": [{"speed": 1.0, "survey": LINE}]}

BAD_SETTINGS = {
    "cna.sped=1": 'unknown key cna.sped; did you mean "speed"',
    "plannr.kind=1": 'unknown key plannr; did you mean "planner"',
    "planner.foo=1": "unknown key planner.foo; known are beam_width, communication_weight",
    "auv.0.survey.foo=2": "unknown key auv.0.survey.foo; known are file",
    "planner.kind=gramain": 'planner.kind = "gramain" is not known; did you mean "gramian"',
    "auv.0.survey.kind=lawn": 'did you mean "lawnmower"',
    "auv.0.survey={}": "auv.0.survey.kind is missing; give one of lawnmower, waypoints",
    "cna.speed=true": r"cna.speed = true \(cruising speed \[m/s\]\): must be a number",
    "cna.speed=fast": 'cna.speed = "fast" .* must be a number',
    "cna.speed=-1": r"cna.speed = -1 \(cruising speed \[m/s\]\): must be from 0.001 to 50 m/s",
    "cna.min_turn_radius=nan": "cna.min_turn_radius = nan .* must be a finite number",
    "cna.min_turn_radius=inf": "must be a finite number",
    "seed=1.5": "seed = 1.5 .* must be a whole number",
    "seed=-1": "seed = -1 .* must be from 0 to 9007199254740991",
    "auv=[]": r"auv = \[\] .* has too few entries",
    "cna=3": r"cna = 3 \(the aid vehicle, or several as \[\[cna\]\]\): must be a table",
    "auv.7.speed=1": "7 is not one of the 2 entries, which count from 0",
    "auv.0.speed.x=1": "x is not a key, because the entry above it is a value",
    "auv.0.name=bravo": r"auv: the names \['bravo', 'bravo'\] are not all different; rename one",
    'auv.0.survey={kind="waypoints",points=[[0.0,0.0],[0.0,0.0]]}': r"auv.0.survey: waypoints 0 and 1 are identical",
    'auv.0.survey={kind="waypoints",points=[]}': r"auv.0.survey: ",
    'auv.1.survey={kind="formation",leader="x"}': r'leader "x" is not an AUV listed before "bravo"',
    "auv.0.survey.file=harbour.plan": 'did you mean "harbor.plan"',
    "auv.0.survey.track=nope": 'harbor.plan has no track "nope"; known are harbor',
    "ranging.interval=0.7": "ranging.interval: 0.7 s is not a whole multiple of time_step = 0.5 s",
    "planner.interval=0.2": "planner.interval: 0.2 s is not a whole multiple",
    'planner={kind="path-inertia",gamma=-1.0}': r"planner.gamma = -1.0 .* must be from 0 to 1000000 \(",
    "planner.horizon=-1": "planner.horizon = -1 .* must be from 0.001 to 86400 s",
    "environment.current=[3.0,0.0]": "current .* is too strong",
    "origin.lat=95": r"origin.lat = 95 \(latitude \[deg\], WGS84\): must be less than or equal to 90",
    'name="a/b"': r'name = "a/b" \(letters, digits, dots and hyphens\)',
    "time_step=1e-9": "time_step = 1e-09 .* must be from 0.001 to 60 s",
    "cna.speed": "has no value; write table.key=value",
    "=3": "has no value; write table.key=value",
}


@pytest.mark.parametrize("name", shipped())
def test_shipped_scenario_loads_and_says_what_it_is(name):
    scenario = load(name)
    assert scenario.table.name == name
    assert scenario.table.description
    assert scenario.time[-1] > 0


@pytest.mark.parametrize(("setting", "message"), BAD_SETTINGS.items(), ids=BAD_SETTINGS)
def test_wrong_setting_is_one_sentence_with_key_value_and_remedy(setting, message):
    with pytest.raises(ObsplanError, match=message) as caught:
        load("harbor-survey", settings=[setting])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("missing", ["origin", "cna", "auv"])
def test_missing_table_is_named(missing):
    data = {key: value for key, value in SMALL.items() if key != missing}
    with pytest.raises(ObsplanError, match=f"{missing} is missing"):
        from_dict(data)


def test_static_survey_needs_a_duration():
    data = {**SMALL, "auv": [{"survey": {"kind": "static"}}]}
    with pytest.raises(ObsplanError, match="duration: is missing, and no AUV moves"):
        from_dict(data)
    assert from_dict({**data, "duration": 2.0}).time[-1] == 2.0


def test_unknown_names_suggest_the_nearest(tmp_path):
    with pytest.raises(
        ObsplanError, match=r'no scenario "harbour-survey" .* did you mean "harbor-survey"'
    ):
        load("harbour-survey")
    with pytest.raises(ObsplanError, match='no planner "circl"; did you mean "circle"'):
        load("harbor-survey", planner="circl")
    with pytest.raises(ObsplanError, match="no such file"):
        load(tmp_path / "none.toml")
    with pytest.raises(ObsplanError, match="is a folder"):
        load(tmp_path)


def test_file_that_is_no_toml_is_refused(tmp_path):
    path = tmp_path / "a.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ObsplanError, match="is not text in UTF-8"):
        load(path)
    path.write_text("[cna\nspeed = 1")
    with pytest.raises(ObsplanError, match="is not valid TOML"):
        load(path)


@settings(max_examples=100, deadline=None)
@given(st.binary(max_size=60))
def test_rubbish_gives_nothing_but_our_error(tmp_path_factory, content):
    path = tmp_path_factory.mktemp("rubbish") / "a.toml"
    path.write_bytes(content)
    with pytest.raises(ObsplanError) as caught:
        from_dict(read(path))
    assert "\n" not in str(caught.value)


def test_planner_is_replaced_at_the_same_interval_and_knowledge():
    original = load("survey-slow")
    other = load("survey-slow", planner="path-inertia", settings=["planner.gamma=0.25"])
    assert (other.table.planner.interval, other.table.planner.knowledge) == (
        original.table.planner.interval,
        "truth",
    )
    assert other.planner().gamma == 0.25
    assert original.replace(planner="path-inertia").table.planner.gamma == 1.0


def test_settings_reach_into_lists_and_keep_their_types():
    scenario = load(
        "harbor-survey",
        settings=["auv.1.speed=0.9", "environment.current=[0.1, -0.1]", "name=other"],
    )
    assert scenario.table.auv[1].speed == 0.9
    assert scenario.table.environment.current == (0.1, -0.1)
    assert scenario.table.name == "other"


@pytest.mark.parametrize("name", shipped())
def test_resolved_scenario_is_the_same_scenario(name):
    scenario = load(name)
    again = from_dict(scenario.resolved())
    assert again.resolved() == scenario.resolved()
    for a, b in zip(scenario.references, again.references, strict=True):
        np.testing.assert_array_equal(a.polyline, b.polyline)


def test_circle_just_encloses_every_survey():
    circle = load("harbor-survey", planner="circle").planner().circle
    points = np.concatenate([reference.polyline for reference in load("harbor-survey").references])
    distance = np.hypot(*(points - [circle.x, circle.y]).T)
    assert distance.max() == pytest.approx(circle.radius, rel=1e-9)
    assert (
        np.isclose(distance, circle.radius, rtol=1e-6)
    ).sum() >= 2  # it touches, so none smaller has this centre


def test_first_estimate_is_drawn_where_it_is_not_given():
    scenario = from_dict(
        {
            **SMALL,
            "auv": [
                {
                    **SMALL["auv"][0],
                    "first_estimate": {"x": 3.0, "heading_deg": 45.0, "sigma_position": 2.0},
                }
            ],
        }
    )
    truth, error = np.array([[1.0, 2.0, 0.1, 1.0]]), np.array([[9.0, 0.5, 9.0, -1.0]])
    mean, covariance = scenario.first_estimates(truth, error)
    np.testing.assert_allclose(mean[0], [3.0, 2.0 + 2.0 * 0.5, math.pi / 4, 1.0 - 0.5])
    np.testing.assert_allclose(np.diag(covariance[0]), [4.0, 4.0, np.deg2rad(2.0) ** 2, 0.25])


def test_schema_lists_every_key_with_its_meaning():
    rows = {
        f"{path}.{key}": (kind, default, text, allowed)
        for path, keys in sections()
        for key, kind, default, text, allowed in keys
    }
    *said, allowed = rows["cna.speed"]
    assert said == ["number", "required", "cruising speed [m/s]"]
    assert allowed.startswith("from 0.001 to 50 m/s (")
    assert rows['auv[].survey, kind = "lawnmower".side'][0] == '"left" | "right"'
    assert all(text for _, _, text, _ in rows.values())
    assert "harbor" not in str(json_schema())
    assert json_schema()["properties"]["time_step"]["minimum"] == 1e-3


@pytest.mark.parametrize(("time_step", "steps"), [(0.1, 10), (0.3, 3), (0.5, 2), (2.0, 1)])
def test_decisions_are_about_a_second_apart_unless_the_scenario_says(time_step, steps):
    assert (
        from_dict({**SMALL, "time_step": time_step, "ranging": {"interval": 6.0}}).decide_every
        == steps
    )


# --- the pace of a survey ---------------------------------------------------------------------------------------------------------------

LEGS = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]])


@pytest.fixture
def paced(monkeypatch):
    """A scenario on a mission file that has speeds 3 and 2 m/s, and a hold of 5 s between."""
    track = Track(points=LEGS, speed=np.array([3.0, 2.0]), hold=np.array([0.0, 5.0, 0.0]))
    mission = Mission(tracks={"t": track}, geographic=False)
    monkeypatch.setitem(READERS, ".fake", lambda path: mission)

    def make(**auv):
        survey = {"kind": "mission", "file": "m.fake"}
        return from_dict({**SMALL, "time_step": 0.5, "auv": [{"survey": survey, **auv}]})

    return make


def test_a_mission_file_sets_the_pace_unless_the_auv_has_a_speed(paced):
    assert paced().references[0].duration == pytest.approx(10 + 5 + 20, rel=1e-12)
    assert paced(speed=1.0).references[0].duration == pytest.approx(30 + 5 + 40, rel=1e-12)


def test_a_resolved_scenario_keeps_the_pace_without_its_file(paced):
    for each in (paced(), paced(speed=1.0)):
        again = from_dict(each.resolved())
        assert again.resolved() == each.resolved()
        for name in ("position", "heading", "speed"):
            np.testing.assert_array_equal(
                getattr(each.motions[0], name), getattr(again.motions[0], name)
            )
    survey = paced().resolved()["auv"][0]["survey"]
    assert (survey["speeds"], survey["holds"]) == ([3.0, 2.0], [0.0, 5.0, 0.0])
    assert "speeds" not in paced(speed=1.0).resolved()["auv"][0]["survey"]


def test_speeds_and_holds_may_stand_in_the_scenario():
    survey = {**LINE, "speeds": [0.5], "holds": [10.0, 0.0]}
    assert from_dict({**SMALL, "auv": [{"survey": survey}]}).time[-1] == 210.0
    with_speed = from_dict({**SMALL, "auv": [{"survey": survey, "speed": 1.0}]})
    assert with_speed.time[-1] == 110.0


@pytest.mark.parametrize(
    ("auv", "message"),
    [
        ({"survey": LINE}, "auv.0.survey: the survey moves and has no speed: give the AUV a speed"),
        (
            {"survey": {**LINE, "speeds": [1.0, 1.0]}},
            "auv.0.survey: speeds must be one for each of the 1 legs, got 2",
        ),
        (
            {"survey": {**LINE, "holds": [0.0, -1.0]}},
            r"auv.0.survey.holds.1 = -1.0 .* must be from 0 to 86400 s",
        ),
        (
            {"survey": {**LINE, "speeds": [True]}},
            r"auv.0.survey.speeds.0 = true .* must be a number",
        ),
    ],
)
def test_a_pace_that_cannot_be_kept_is_refused_by_key(auv, message):
    with pytest.raises(ObsplanError, match=message):
        from_dict({**SMALL, "auv": [auv]})


def test_a_speed_in_the_file_that_no_auv_has_is_overridden_or_refused(monkeypatch):
    mission = Mission(
        tracks={"t": Track(points=LEGS, speed=np.array([1.0, 15.0]))}, geographic=False
    )
    monkeypatch.setitem(READERS, ".fake", lambda path: mission)
    survey = {"kind": "mission", "file": "m.fake"}
    with pytest.raises(
        ObsplanError, match=r"speeds\[1\] must be .*, got 15.0: correct it, or give"
    ):
        from_dict({**SMALL, "auv": [{"survey": survey}]})
    assert from_dict({**SMALL, "auv": [{"survey": survey, "speed": 1.0}]}).time[-1] == 70.0


def test_shipped_name_means_the_shipped_scenario_whatever_lies_in_the_folder(tmp_path, monkeypatch):
    expected = load("harbor-survey").table
    monkeypatch.chdir(tmp_path)
    (tmp_path / "harbor-survey").mkdir()  # as `obsplan run harbor-survey` makes it
    (tmp_path / "suite" / "keep-outs").mkdir(parents=True)
    assert load("harbor-survey").table == expected
    assert load("suite/keep-outs").table.name == "keep-outs"
    text = (SHIPPED / "fixed-auv.toml").read_text()
    (tmp_path / "survey-slow").write_text(text.replace('name = "fixed-auv"', 'name = "mine"'))
    assert load("survey-slow").table.name == "survey-slow"
    assert load("./survey-slow").table.name == "mine"
    assert load(tmp_path / "survey-slow").table.name == "mine"


def test_folder_is_refused_with_the_file_that_was_meant(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mission").mkdir()
    with pytest.raises(ObsplanError, match="mission: is a folder and no scenario file; known are"):
        load("mission")
    (tmp_path / "mission" / "scenario.toml").touch()
    with pytest.raises(ObsplanError, match=r'did you mean "mission/scenario.toml"'):
        load("mission")
    (tmp_path / "mission.toml").touch()
    with pytest.raises(ObsplanError, match=r'did you mean "mission.toml"'):
        load("mission")
    (tmp_path / "lake.toml").touch()
    with pytest.raises(ObsplanError, match=r'no scenario "lake" .* did you mean "lake.toml"'):
        load("lake")


@pytest.mark.parametrize(
    "name", ["gramian", "information", pytest.param("trajectory", marks=pytest.mark.slow)]
)
def test_planners_are_told_how_long_a_turn_is_held_and_not_the_time_step(name):
    """Close to a keep-out it matters; a mission that decides at every step is told rightly either way."""
    wreck = [{"x": 66.0, "y": -12.0, "radius": 9.0}]
    auvs = [
        Belief.at(0.0, 0.0, heading=0.4, speed=1.5, covariance=np.diag([4.0, 1.0, 0.01, 0.04])),
        Belief.at(5.0, -20.0, heading=3.0, speed=1.0, covariance=np.diag([4.0, 9.0, 0.01, 0.04])),
    ]
    poses = [
        Pose(66.0 + away, -12.0, heading)  # east of the wreck's centre, sailing past it
        for away in (15.0, 19.0)
        for heading in (1.6, -1.6, 2.4, -2.4, 2.8, -2.8)
    ]

    def turns(time_step, interval):
        planner = scenario(
            time_step=time_step,
            ranging__interval=6.0,
            planner={"kind": name, "interval": interval},
            constraints={"keep_out": wreck},
        ).planner()
        return [planner.plan(pose, auvs).turn_rate for pose in poses]

    every_twelfth_step = turns(0.5, 6.0)
    assert every_twelfth_step == turns(6.0, 6.0)
    assert every_twelfth_step != turns(0.5, 0.5)
