"""Classes from outside the package, those of docs/your-own.md, fly by every road; and whatever is wrong with one is said in a sentence."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

import obsplan as op
from obsplan.campaign.plan import plan_cells
from obsplan.campaign.table import load_campaign
from obsplan.estimators.jacobian import informations
from obsplan.report.verdict import planner_notes
from obsplan.simulation.inputs import mission_inputs

ROOT = Path(__file__).parents[1]
BLOCKS = re.findall(
    r"```(?:python|toml)\n# (mine\.\w+)\n(.*?)```",
    (ROOT / "docs" / "your-own.md").read_text(encoding="utf-8"),
    flags=re.DOTALL,
)
CURRENT = (0.1, -0.05)


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The module of the documentation, in the current folder and nowhere else."""
    for name, text in BLOCKS:  # a class each
        with (tmp_path / name).open("a") as file:
            file.write(f"{text}\n\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "mine", raising=False)
    yield tmp_path
    sys.modules.pop("mine", None)


def scenario(**changes):
    return op.load("./mine.toml", planner="circle").replace(**changes)


@pytest.mark.usefixtures("mine")
def test_a_filter_of_ones_own_estimates_what_the_vehicles_model_does_not_have():
    run = op.simulate(scenario(duration=300.0, ranging={"sigma": 0.5, "interval": 2.0}))
    names, end = [*run.scenario.filter_states], run.mean[0, -1]
    assert names[4:] == ["current_east", "current_north"]
    sigma = np.sqrt(np.diagonal(run.covariance[0, -1]))
    assert (sigma[4:] < 0.2 / 5).all()  # ranges tell the current
    assert (np.abs(end[4:] - CURRENT) < 4 * sigma[4:]).all()
    assert run.truth.shape[-1] == 4


@pytest.mark.usefixtures("mine")
def test_the_true_state_may_have_more_components_and_the_filter_estimates_them():
    own = {"kind": "mine:SlowLog", "error": 0.2}
    still = {"position": 0.0, "heading_deg": 0.0, "speed": 0.0}
    sailed = scenario(
        estimator=None,
        auv__0__vehicle=own,
        auv__0__process_noise=still,
        auv__0__first_estimate={"sigma_speed": 0.0},  # which ranges could not tell from the error
    )
    run = op.simulate(
        sailed.replace(auv__0__survey={"kind": "waypoints", "points": [[0.0, 0.0], [200.0, 0.0]]})
    )
    assert [*run.scenario.truth_states] == [*op.STATES, "error"] == [*run.scenario.filter_states]
    ahead = run.truth[0, :, :2] - run.scenario.motions[0].position  # along the heading
    np.testing.assert_allclose(np.hypot(*ahead.T), 0.2 * run.time, atol=1e-9)
    np.testing.assert_array_equal(run.truth[0, :, 4], 0.2)
    inputs = [mission_inputs(run.scenario, run.scenario.starts, seed) for seed in range(100)]
    first = [carry.mean[0, 4] for carry, _ in inputs]
    assert np.std(first) == pytest.approx(0.1, rel=4 / np.sqrt(2 * 100))  # four standard errors
    assert np.mean(first) == pytest.approx(0.2, abs=4 * 0.1 / np.sqrt(100))
    assert abs(run.mean[0, -1, 4] - 0.2) < 4 * np.sqrt(run.covariance[0, -1, 4, 4]) < 0.2


@pytest.mark.usefixtures("mine")
def test_errors_of_ranges_grow_with_distance_as_the_sensor_says_and_the_filter_knows():
    shipped = {"kind": "range", "sigma": 0.5, "interval": 2.0}
    ours, theirs = op.simulate(scenario(ranging=shipped)), op.simulate(scenario())
    pings = ours.scenario.pings
    error = [run.range[0, pings] - run.separation[0, pings] for run in (ours, theirs)]
    growth = (0.5 + 0.02 * ours.separation[0, pings]) / 0.5
    np.testing.assert_allclose(error[1], error[0] * growth, atol=1e-9)
    assert growth.max() > 1.2
    ratio = theirs.covariance[0, -1, :2, :2].trace() / ours.covariance[0, -1, :2, :2].trace()
    assert ratio > 1.2, ratio


@pytest.mark.usefixtures("mine")
def test_information_of_a_sensor_of_ones_own_is_kays_where_the_deviation_depends_on_the_state():
    sensor = scenario().range_sensor
    x, beacon = np.array([3.0, 4.0, 0.1, 1.0]), np.zeros(10)
    sigma, sight = 0.5 + 0.02 * 5.0, np.array([0.6, 0.8, 0.0, 0.0])
    expected = np.outer(sight, sight) * (1 + 2 * 0.02**2) / sigma**2
    np.testing.assert_allclose(informations(sensor, x, beacon), expected, rtol=1e-12, atol=1e-15)


@pytest.mark.usefixtures("mine")
def test_a_survey_of_ones_own_is_followed():
    run = op.simulate(scenario(auv__0__survey={"kind": "mine:Zigzag", "length": 30.0, "legs": 2}))
    corner = run.scenario.references[0].arrival[1]
    k = int(np.searchsorted(run.time, corner))
    np.testing.assert_allclose(run.scenario.motions[0].position[k], [30 / 2**0.5] * 2, atol=0.6)


@pytest.mark.usefixtures("mine")
def test_an_object_from_python_stands_for_its_table_and_a_file_of_it_gives_the_same_run():
    given = scenario()
    import mine as module  # pyright: ignore[reportMissingImports]

    made = given.replace(
        estimator=module.CurrentEkf(sigma=0.2),
        ranging=module.GrowingRange(sigma=0.5, growth=0.02),
        auv__0__survey=op.Lawnmower(legs=2, length=30.0, spacing=9.0, heading=0.5),
    )
    table = made.resolved()
    own = {key: table["estimator"][key] for key in ("kind", "sigma", "walk")}
    assert own == {"kind": "mine:CurrentEkf", "sigma": 0.2, "walk": 0.0}
    assert table["auv"][0]["survey"]["heading_deg"] == pytest.approx(np.rad2deg(0.5))
    assert table["ranging"]["interval"] == 2.0  # as it was
    again = op.from_dict(table)
    np.testing.assert_array_equal(op.simulate(again).mean, op.simulate(made).mean)


@pytest.mark.usefixtures("mine")
def test_what_is_taken_for_granted_of_ones_own_is_said():
    run = op.simulate(scenario())
    summary = run.summary()
    assert summary["all"]["bound_rms_m"] is None
    assert "mine:GrowingRange" in summary["unbounded"]
    said = " ".join(planner_notes(run))
    assert "err by 0.5 m everywhere" in said
    assert "know nothing of current_east, current_north" in said
    with pytest.raises(op.ObsplanError, match="no bound over all paths"):
        _ = run.information_bounds


@pytest.mark.usefixtures("mine")
def test_own_states_are_recorded_under_their_names_and_units():
    run = op.simulate(scenario())
    data = op.to_dataset(run)
    np.testing.assert_array_equal(data["est_current_north"], run.mean[..., 5])
    assert data["est_current_east"].attrs["units"] == "m s-1"
    assert data["state"].values.tolist()[4:] == ["current_east", "current_north"]
    op.write_netcdf(run, "t.nc")
    import xarray as xr

    with xr.open_dataset("t.nc") as written:
        assert written["cov_current_north_east"].attrs["units"] == "m s-1 m"


BROKEN = """
from dataclasses import dataclass
import casadi as ca
import obsplan as op
class Plain:
    states = predict = innovation = update = None
@dataclass(frozen=True)
class Half:
    def states(self, model): return model.states
@dataclass(frozen=True)
class Wrong(op.Ekf):
    def update(self, x, P, z, sensor, beacon): return x, P[:2, :2]
@dataclass(frozen=True)
class Lopsided(op.Ekf):
    def states(self, model): return {"north": op.State("m"), **model.states}
@dataclass(frozen=True)
class Raises(op.Ekf):
    def predict(self, x, P, u, process): return process.modle
@dataclass
class Loose:
    def states(self, model): return model.states
    def predict(self, x, P, u, process): return x, P
    def innovation(self, x, P, z, sensor, beacon): return z, z, x.T
    def update(self, x, P, z, sensor, beacon): return x, P
@dataclass(frozen=True)
class Tall(op.Ekf):
    def innovation(self, x, P, z, sensor, beacon): return z, z, x
@dataclass(frozen=True)
class Clash(op.Ekf):
    process_noise: float = 1.0
@dataclass(frozen=True)
class Picky(op.Ekf):
    gain: float = 1.0
    def __post_init__(self):
        if self.gain > 2: raise ValueError(f"gain must be at most 2, got {self.gain}")
@dataclass(frozen=True)
class Listed(op.Ekf):
    gains: list[float] = ()
@dataclass(frozen=True)
class Odd(op.Ekf):
    model: ca.SX = None
number = 3
"""


@pytest.mark.parametrize(
    ("table", "sentence"),
    [
        ({"kind": "kalman"}, r'estimator.*"kalman"'),
        (
            {"kind": "mien:CurrentEkf"},
            r'estimator\.kind = "mien:CurrentEkf".*no module mien here; install it',
        ),
        ({"kind": "mine:CurentEkf"}, r'mine has no class CurentEkf; did you mean "CurrentEkf"\?'),
        ({"kind": "mine:"}, r"must be a module and a class at its top"),
        ({"kind": "broken:number"}, r"number is no class but a int"),
        ({"kind": "broken:Plain"}, r"is no dataclass; write @dataclass"),
        ({"kind": "broken:Half"}, r"lacks predict and innovation and update"),
        (
            {"kind": "broken:Wrong"},
            r"estimator: update must return 4 x 1 and 4 x 4, got 4 x 1 and 2 x 2",
        ),
        (
            {"kind": "broken:Tall"},
            r"innovation must return 1 x 1 and 1 x 1 and 1 x 4, got 1 x 1 and 1 x 1 and 4 x 1",
        ),
        (
            {"kind": "broken:Lopsided"},
            r"states must begin with east, north, heading, speed, got north, east",
        ),
        ({"kind": "broken:Raises"}, r"predict fails: AttributeError: .*modle"),
        ({"kind": "broken:Loose"}, r"write @dataclass\(frozen=True\)"),
        ({"kind": "broken:Clash"}, r"has a field process_noise, which is a key of every estimator"),
        ({"kind": "broken:Picky", "gain": 3.0}, r"estimator: gain must be at most 2, got 3.0"),
        ({"kind": "broken:Listed"}, r"has a list as field gains; write tuple"),
        ({"kind": "broken:Odd"}, r"has a field that no file can hold: .*SX.*; use numbers"),
        ({"kind": "ruined:Ekf"}, r"ruined cannot be imported: NameError: .*nothing"),
        ({"kind": "leaving:Ekf"}, r"leaving cannot be imported: SystemExit: 1"),
        ({"kind": "poor:Ekf"}, r"poor imports no_such_package, which is not installed"),
        (
            {"kind": "mine:CurrentEkf", "sgima": 1.0},
            r'unknown key estimator\.sgima; did you mean "sigma"\?',
        ),
        (
            {"kind": "mine:CurrentEkf", "sigma": "x"},
            r"estimator\.sigma = \"x\" \(standard deviation of each component.*must be a number",
        ),
    ],
)
def test_whatever_is_wrong_with_a_class_of_ones_own_is_one_sentence(mine, table, sentence):
    (mine / "broken.py").write_text(BROKEN)
    (mine / "ruined.py").write_text("nothing\n")
    (mine / "poor.py").write_text("import no_such_package\n")
    (mine / "leaving.py").write_text("import sys\nsys.exit(1)\n")
    data = tomllib.loads((mine / "mine.toml").read_text()) | {"estimator": table}
    with pytest.raises(op.ObsplanError, match=sentence) as error:
        op.from_dict(data, source="mine.toml")
    assert str(error.value).startswith("mine.toml: ")
    assert "\n" not in str(error.value)
    sys.modules.pop("broken", None)


def test_a_module_beside_the_scenario_is_not_run_from_elsewhere(mine, monkeypatch):
    (mine / "elsewhere").mkdir()
    monkeypatch.chdir(mine / "elsewhere")
    with pytest.raises(op.ObsplanError, match="no module mine here"):
        op.load("../mine.toml")


@pytest.mark.usefixtures("mine")
def test_a_class_that_no_file_can_name_is_refused():
    from dataclasses import dataclass

    @dataclass(frozen=True)
    class Inside(op.Ekf):
        pass

    with pytest.raises(op.ObsplanError, match="made inside a function"):
        scenario(estimator=Inside())
    with pytest.raises(op.ObsplanError, match="is a class; give an object of it"):
        scenario(estimator=op.Ekf)


def test_a_changed_class_is_another_mission(mine):
    (before,) = plan_cells(["./mine.toml"])
    text = (mine / "mine.py").read_text()
    (mine / "mine.py").write_text(text.replace("0.3", "0.4"))
    (after,) = plan_cells(["./mine.toml"])
    assert before.content == after.content
    assert before.key != after.key


def command(folder, *words):
    """`obsplan ...` in a folder that is on nobody's path."""
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    line = [sys.executable, "-P", "-m", "obsplan", *words]
    done = subprocess.run(line, cwd=folder, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_one_of_each_kind_flies_in_run_compare_and_campaign(mine):
    quick = ["--set", "duration=40.0"]
    command(mine, "run", "mine.toml", *quick, "--set", "export.replays=0")
    (folder,) = [path for path in mine.iterdir() if (path / "scenario.toml").exists()]
    assert "mine:CurrentEkf" in (folder / "scenario.toml").read_text()
    command(mine, "compare", "mine.toml", "--planners", "circle,mine:Chase", *quick)
    assert "mine:Chase" in (mine / "scenario-compare" / "compare.csv").read_text()
    planners = ["--planners", "circle,mine:Chase"]
    command(mine, "campaign", "mine.toml", *planners, "--runs", "2", "--out", "flown")
    table = load_campaign("flown")
    assert sorted(table["planner"]) == ["circle"] * 2 + ["mine:Chase"] * 2
    assert np.isfinite(table["rms_error_m"]).all()


@pytest.mark.slow
def test_a_survey_that_ends_the_program_does_not_end_it_as_if_all_went_well(mine):
    (mine / "quits.py").write_text(
        "from dataclasses import dataclass\n\n\n@dataclass(frozen=True)\nclass Quits:\n"
        "    x: float = 0.0\n    y: float = 0.0\n\n"
        "    def reference(self, *, speed, current):\n        raise SystemExit(1)\n"
    )
    own = ["--set", "auv.0.survey.kind=quits:Quits"]
    line = [sys.executable, "-P", "-m", "obsplan", "run", "fixed-auv", *own]
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(line, cwd=mine, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 1, done.stderr
