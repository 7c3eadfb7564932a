"""What a user meets first: names that editors know, arguments that are checked, objects that say what they are."""

import ast
import importlib
import json
import os
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import jaxtyping
import matplotlib as mpl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from matplotlib.figure import Figure

import formulations
import obsplan as op
from obsplan.planners import PLANNERS
from obsplan.scenario import from_dict
from obsplan.simulation import beliefs

PACKAGES = (op, formulations)
HERE = Path(op.__file__).parents[1]

RIGHT = """
from collections.abc import Sequence
import numpy as np
import formulations as fo
import obsplan as op

class Straight:
    def plan(self, pose: op.Pose, auvs: Sequence[op.Belief], *, time: float = 0.0) -> op.Decision:
        return op.Decision(turn_rate=0.0, speed=1.0)

cna = op.Unicycle(speed=1.0, min_turn_radius=0.5)
pond = op.Polygon(points=np.array([[0.0, 0.0], [9.0, 0.0], [9.0, 9.0]]))
limits = op.Constraints(keep_out=(op.Disc(x=3.0, y=1.0, radius=0.5), pond), min_separation=2.0)
horizon: op.Planner = op.InformationHorizon(op.Situation(cna, ping_interval=15.0, constraints=limits))
circle: op.Planner = op.Circle(op.Situation(cna), center=np.zeros(2), radius=5.0)
line = op.Waypoints(points=[[0.0, 0.0], [10.0, 0.0]]).reference(speed=1.0, current=np.zeros(2))
belief = op.Belief(mean=np.zeros(4), covariance=np.eye(4), route=line.position)
decision = horizon.plan(op.Pose(0.0, 0.0, 0.0), [belief, op.Belief.at(1.0, 2.0)], time=3.0)
turn: float = decision.turn_rate
fine: bool = decision.status is op.Status.OPTIMAL

scenario = op.load("harbor-survey", planner="circle").replace(cna__speed=2.0, planner="trail")
run: op.Run = op.simulate(scenario, planner=Straight(), seed=3)
again: op.Run = op.ClosedLoop(scenario=scenario, planner=circle).fly(4)
error: float = run.rms_error
run.plot().savefig("map.png")
op.write_run(run, "out")
speeds: list[float] = [op.from_dict(scenario.resolved()).cna.speed]
kappa = float(fo.condition_number(np.eye(3)))
"""

WRONG = """
import formulations as fo
import obsplan as op
cna = op.Unicycle(speed=1.0, min_turn_radius=0.5)
op.Unicycle(sped=1.0, min_turn_radius=0.5)  # wrong
op.Belif.at(0.0, 0.0)  # wrong
op.Belief.at(0.0, 0.0, heading_deg=3.0)  # wrong
op.Trail(op.Situation(cna), lag=3.0)  # wrong
op.load("harbor-survey", planer="circle")  # wrong
op.load("harbor-survey").replace(planner=cna)  # wrong
run = op.simulate("harbor-survey", seed=7)
run.rms_eror  # wrong
run.plot().savefigure("map.png")  # wrong
op.simulate("harbor-survey", seed="seven")  # wrong
op.simulate("harbor-survey", planner=cna)  # wrong
op.ClosedLoop(run.scenario, cna)  # wrong
op.Decision(0.0, 1.0)  # wrong
op.Polygon(points=3.0)  # wrong
op.write_runs(run, "out")  # wrong
fo.condition_numbr  # wrong
from obsplan import Gramian  # wrong
"""


@pytest.fixture
def as_shipped():
    """Without the shapes and types that only the tests check at every call."""
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_type_checkers_are_told_the_names_that_load(package):
    """The one list is read by Python, the other by type checkers, and only if each name is imported as itself."""
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    told = {
        alias.asname: f"{line.module}.{alias.name}"
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
    loaded = {name: f"{package.__name__}.{home}.{name}" for name, home in package._HOME.items()}
    assert told == loaded
    assert (
        set(loaded) == set(package.__all__) - {"__version__"} == set(dir(package)) - {"__version__"}
    )


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.__name__)
def test_every_name_loads_and_the_package_says_that_it_is_typed(package):
    for name in package.__all__:
        assert getattr(package, name) is not None
    assert (Path(package.__file__).parent / "py.typed").is_file()


def test_every_planner_is_public():
    for home in PLANNERS.values():
        module, _, name = home.partition(":")
        assert getattr(op, name) is getattr(importlib.import_module(module), name)


@pytest.mark.slow
def test_public_names_and_runs_load_neither_matplotlib_nor_pandas():
    code = "import obsplan, obsplan.run, sys; print(*{'matplotlib', 'pandas', 'rich', 'xarray'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.slow
def test_type_checker_accepts_what_is_right_and_marks_every_line_that_is_wrong(tmp_path):
    (tmp_path / "right.py").write_text(RIGHT)
    (tmp_path / "wrong.py").write_text(WRONG)
    (tmp_path / "pyrightconfig.json").write_text('{"typeCheckingMode": "standard"}')
    found = json.loads(type_check(tmp_path))["generalDiagnostics"]
    lines = {
        (Path(fault["file"]).name, fault["range"]["start"]["line"])
        for fault in found
        if fault["rule"] != "reportUnusedExpression"
    }
    marked = {i for i, line in enumerate(WRONG.splitlines()) if line.endswith("# wrong")}
    assert lines == {("wrong.py", i) for i in marked}


def type_check(folder):
    """What basedpyright says of a folder whose files import the copies of the packages that are tested."""
    command = ["-m", "basedpyright", "--outputjson", "--pythonpath", sys.executable, "-p", folder]
    env = {**os.environ, "PYTHONPATH": str(HERE)}
    done = subprocess.run(
        [sys.executable, *command], env=env, capture_output=True, text=True, check=False
    )
    return done.stdout


def test_replaced_keys_are_set_and_the_others_and_the_original_stay():
    original = op.load("harbor-survey", settings=["planner.interval=3.0"])
    changed = original.replace(cna__speed=2.5, auv__1__weight=np.float64(3.0), seed=np.int64(8))
    assert (changed.cna.speed, changed.table.auv[1].weight, changed.table.seed) == (2.5, 3.0, 8)
    assert original.cna.speed != 2.5
    assert changed.table.auv[0] == original.table.auv[0]
    assert changed.table.planner == original.table.planner
    assert (changed.source, changed.folder) == (original.source, original.folder)
    back = {"cna__speed": original.cna.speed, "auv__1__weight": 1.0, "seed": original.table.seed}
    assert changed.replace(**back).resolved() == original.resolved()


def test_planner_is_replaced_before_its_options_and_keeps_its_interval():
    original = op.load("harbor-survey", settings=["planner.interval=3.0"])
    table = original.replace(planner__gamma=0.5, planner="path-inertia").table.planner
    assert (table.kind, table.gamma, table.interval) == ("path-inertia", 0.5, 3.0)
    whole = original.replace(planner={"kind": "path-inertia"}).table.planner
    assert (whole.kind, whole.interval) == ("path-inertia", None)


def test_none_is_the_default():
    scenario = op.load("harbor-survey", settings=["duration=60.0"])
    assert scenario.time[-1] == 60.0
    assert scenario.replace(duration=None).time[-1] == op.load("harbor-survey").time[-1]


MISTAKES = {
    "unknown": ({"cna__sped": 2.0}, 'toml: unknown key cna__sped; did you mean "speed"?'),
    "range": (
        {"seed": 2, "cna__speed": -1.0},
        "toml: cna__speed = -1.0 (cruising speed [m/s]): must",
    ),
    "list": ({"auv__7__speed": 1.0}, "auv__7__speed = 1.0: 7 is not one of the 2 entries"),
    "deep": ({"cna__speed__x": 1.0}, "cna__speed__x = 1.0: x is not a key"),
    "inside": (
        {"auv__0__survey": {"kind": "static", "z": 1}},
        "toml: unknown key auv__0__survey.z;",
    ),
    "shared": (
        {"ranging__interval": 0.7},
        "toml: ranging__interval: 0.7 s is not a whole multiple",
    ),
    "other": ({"time_step": 0.7}, "toml: ranging.interval: 15.0 s is not a whole multiple"),
    "planner": ({"planner": "circl"}, 'no planner "circl"; did you mean "circle"?'),
    "option": ({"planner": "trail", "planner__lag": 1.0}, "toml: unknown key planner__lag;"),
}


@pytest.mark.parametrize(("changes", "message"), MISTAKES.values(), ids=MISTAKES)
def test_wrong_replacement_is_one_sentence_with_the_key_as_written(changes, message):
    with pytest.raises(op.ObsplanError) as caught:
        op.load("harbor-survey").replace(**changes)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


CORNERS = ((0.0, 0.0), (40.0, 0.0), (40.0, 30.0))
GIVEN = (CORNERS, [list(corner) for corner in CORNERS], np.array(CORNERS), np.array(CORNERS, int))


@pytest.mark.parametrize("points", GIVEN, ids=["tuples", "lists", "floats", "integers"])
def test_points_may_be_given_as_tuples_lists_or_arrays(points):
    for kind in (op.Polygon, op.Waypoints):
        given = kind(points=points)
        assert given.points == CORNERS
        assert {type(number) for point in given.points for number in point} == {float}
        assert (given, hash(given)) == (kind(points=CORNERS), hash(kind(points=CORNERS)))


def test_centre_of_a_circle_may_be_an_array():
    cna = op.Unicycle(speed=1.0, min_turn_radius=0.5)
    circle = op.Circle(op.Situation(cna), center=np.array([1, 2]), radius=3.0)
    assert circle == op.Circle(op.Situation(cna), center=(1.0, 2.0), radius=3.0)
    assert circle.plan(op.Pose(4.0, 2.0, np.pi / 2), []).radius == pytest.approx(3.0)
    with pytest.raises(ValueError, match=r"a point must be two numbers.*got \[1\.0, 2\.0, 3\.0\]"):
        op.Circle(op.Situation(cna), center=np.array([1.0, 2.0, 3.0]), radius=3.0)


@pytest.mark.usefixtures("as_shipped")
@pytest.mark.parametrize(
    "points", [np.zeros((3, 3)), np.zeros(4), [(0.0, 1.0), (2.0,)], ["a", "b"], None]
)
def test_what_is_no_list_of_points_is_refused(points):
    for kind in (op.Polygon, op.Waypoints):
        with pytest.raises(ValueError, match="points must be pairs of numbers, east and north"):
            kind(points=points)


def test_scenario_may_hold_arrays():
    plain = op.load("harbor-survey").resolved()
    survey = plain["auv"][0]["survey"]
    arrays_too = {
        **plain,
        "auv": [
            {**plain["auv"][0], "survey": {**survey, "points": np.array(survey["points"])}},
            plain["auv"][1],
        ],
    }
    assert from_dict(arrays_too).resolved() == plain


units = arrays(float, 4, elements=st.sampled_from([1e-4, 1.0, 1e4]))
factors = arrays(float, (4, 2), elements=st.floats(-1.0, 1.0))


@pytest.mark.slow
def test_covariance_may_have_a_depth_which_is_checked_with_the_rest():
    half = np.random.default_rng(0).normal(size=(5, 5))
    given = half @ half.T
    belief = op.Belief(mean=np.zeros(4), covariance=given, depth=30.0)
    np.testing.assert_array_equal(belief.covariance, given)
    np.testing.assert_array_equal(belief.horizontal_covariance, given[:4, :4])
    given[4, 4] = -1.0
    with pytest.raises(ValueError, match="positive semidefinite"):
        op.Belief(mean=np.zeros(4), covariance=given)


@settings(max_examples=200, deadline=None)
@given(factors, units)
def test_covariance_of_any_rank_and_unit_is_accepted_and_copied(factor, unit):
    """A Gram matrix is positive semidefinite, here of rank 2 at most; rounding may take it a little below."""
    scaled = unit[:, None] * factor
    given = scaled @ scaled.T
    belief = op.Belief(mean=np.zeros(4), covariance=given)
    np.testing.assert_array_equal(belief.covariance, given)
    assert not np.shares_memory(belief.covariance, given)


@settings(max_examples=200, deadline=None)
@given(arrays(float, 4, elements=st.floats(-1.0, 1.0)), units)
def test_covariance_with_a_negative_variance_in_any_direction_is_refused(direction, unit):
    """Of I - 1.001 v v', v a unit vector, the variance along v is -0.001, in whatever units the rest is."""
    length = np.linalg.norm(direction)
    v = direction / length if length > 0.1 else np.full(4, 0.5)
    given = unit[:, None] * (np.eye(4) - 1.001 * np.outer(v, v)) * unit
    with pytest.raises(ValueError, match="covariance of an AUV must be positive semidefinite"):
        op.Belief.at(0.0, 0.0, covariance=0.5 * (given + given.T))


def test_lopsided_covariance_is_refused_however_small_its_unit():
    given = np.diag([1e4, 1e4, 1e-4, 1e-2])
    given[2, 3] = 5e-4
    with pytest.raises(
        ValueError, match=r"must be symmetric, got 0.0005 at \[2, 3\] and 0 at \[3, 2\]"
    ):
        op.Belief.at(0.0, 0.0, covariance=given)


@pytest.mark.usefixtures("as_shipped")
@pytest.mark.parametrize("shape", [(), (2, 2), (4,), (4, 5), (6, 6)])
def test_covariance_of_another_shape_is_refused(shape):
    with pytest.raises(ValueError, match=r"covariance of an AUV must be 4 x 4, .* or 5 x 5"):
        op.Belief.at(0.0, 0.0, covariance=np.ones(shape))


@pytest.mark.usefixtures("as_shipped")
@pytest.mark.parametrize("mean", [np.zeros(2), np.zeros((4, 1)), np.zeros((1, 4)), "east"])
def test_mean_of_another_shape_is_refused(mean):
    with pytest.raises(ValueError, match="mean of an AUV must be 4 numbers"):
        op.Belief(mean=mean, covariance=np.eye(4))


@pytest.mark.parametrize("odd", [np.nan, np.inf])
def test_belief_that_is_not_finite_is_answered_by_planners_not_refused(odd):
    belief = op.Belief.at(odd, 0.0, covariance=np.full((4, 4), odd))
    planner = op.InformationHorizon(op.Situation(op.Unicycle(speed=1.0, min_turn_radius=0.5)))
    assert planner.plan(op.Pose(0.0, 0.0, 0.0), [belief]).status is op.Status.INVALID_INPUT


class Straight:
    def __init__(self):
        self.told = []

    def plan(self, pose, auvs, *, time=0.0):
        self.told += auvs
        return op.Decision(turn_rate=0.0, speed=1.0)


def test_filter_that_fails_does_not_end_the_mission(monkeypatch):
    """Its covariance need not be one: here it is -1 times what it was."""
    unpack_array = beliefs.unpack_array
    monkeypatch.setattr(beliefs, "unpack_array", lambda lower: -unpack_array(lower))
    planner = Straight()
    run = op.simulate(op.load("harbor-survey", settings=["duration=30.0"]), planner=planner)
    assert np.isfinite(run.cna).all()
    assert all(np.linalg.eigvalsh(auv.covariance).min() < 0 for auv in planner.told)


HOSTILE = "<img src=x onerror=alert(1)>&amp;"


@pytest.fixture(scope="module")
def flown():
    scenario = op.load("harbor-survey", planner="circle", settings=["duration=120.0"])
    return op.simulate(scenario.replace(auv__1__name=HOSTILE), seed=5)


def test_scenario_says_in_one_line_what_it_is():
    scenario = op.load("harbor-survey", settings=["duration=120.0", "cna.speed=1.5"])
    said = "2 AUVs, 120 s, range every 15 s, aid vehicle at 1.5 m/s, planner information"
    assert repr(scenario) == f"<Scenario harbor-survey: {said}>"
    alone = scenario.replace(planner="trail", auv=scenario.resolved()["auv"][:1])
    said = "1 AUV, 120 s, range every 15 s, aid vehicle at 1.5 m/s, planner trail"
    assert repr(alone) == f"<Scenario harbor-survey: {said}>"


def test_scenario_that_is_not_checked_still_says_what_it_is():
    table = op.load("harbor-survey").table
    assert repr(op.Scenario(table=table)).startswith("<Scenario harbor-survey: 2 AUVs, range every")


def test_run_says_in_one_line_what_it_is(flown):
    error = np.linalg.norm(flown.mean[..., :2] - flown.truth[..., :2], axis=-1)
    rms, worst = np.sqrt((error**2).mean()), error.max()
    said = f"planner circle, seed 5, 2 AUVs, 120 s, RMS error {rms:.2f} m, worst {worst:.2f} m"
    assert repr(flown) == f"<Run of harbor-survey: {said}>"


class Cells(HTMLParser):
    """The tags of a page, and the text in its cells as a browser shows it."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.rows = [], []
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("th", "td"):
            self.rows[-1].append("")

    def handle_data(self, data):
        if self.rows and self.rows[-1] and data.strip():
            self.rows[-1][-1] += data


def test_notebook_shows_a_run_as_a_table_in_which_names_are_text(flown):
    page = Cells(flown._repr_html_())
    assert set(page.tags) == {"table", "caption", "thead", "tbody", "tr", "th", "td"}
    head, *rows = page.rows
    assert [row[0] for row in rows] == ["alpha", HOSTILE, "all"]
    error = np.linalg.norm(flown.mean[..., :2] - flown.truth[..., :2], axis=-1)
    expected = [f"{error[0].max():.2f}", f"{error[1].max():.2f}", f"{error.max():.2f}"]
    assert [row[head.index("Worst error [m]")] for row in rows] == expected


def test_run_draws_its_map_and_leaves_the_users_style_alone(flown):
    before = dict(mpl.rcParams)
    figure = flown.plot()
    assert isinstance(figure, Figure)
    assert dict(mpl.rcParams) == before
    (axes,) = figure.axes
    drawn = [line.get_xydata() for line in axes.lines]
    assert any(np.array_equal(line, flown.cna[:, :2]) for line in drawn)
    assert axes.get_xlabel().startswith("East")
