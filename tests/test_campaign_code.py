"""The code that flies is part of a campaign's key: what can change a mission, and nothing else."""

import shutil
import sys
from pathlib import Path

import pytest
from campaigns import write_scenario

import formulations
import obsplan
from obsplan.campaign import plan_cells
from obsplan.campaign.code import code_hash, hash_of, sources
from obsplan.campaign.execute import Report, check_same_copy
from obsplan.campaign.store import Store
from obsplan.campaign.worker import Batch, Flown, Outcome, fly_mission
from obsplan.cli.campaigns import fly
from obsplan.types import ObsplanError

PACKAGES = {
    name: Path(module.__file__).parent
    for name, module in (("obsplan", obsplan), ("formulations", formulations))
}
FLOWN = Outcome(1, None, {}, "{}", "{}")


@pytest.fixture
def copy(tmp_path):
    """The sources in another place."""
    folders = {name: tmp_path / "elsewhere" / name for name in PACKAGES}
    for name, folder in folders.items():
        shutil.copytree(PACKAGES[name], folder, ignore=shutil.ignore_patterns("*.pyc"))
    return folders


def test_hash_is_of_sources_only_wherever_they_lie_and_however_their_lines_end(copy):
    assert hash_of(copy) == code_hash()
    (copy["obsplan"] / "__pycache__").mkdir(exist_ok=True)
    (copy["obsplan"] / "__pycache__" / "circle.cpython-311.pyc").write_bytes(b"machine code")
    for path in copy["formulations"].rglob("*.py"):
        path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert hash_of(dict(reversed(copy.items()))) == code_hash()


@pytest.mark.parametrize(
    "name",
    [
        "obsplan/planners/circle.py",
        "obsplan/campaign/worker.py",
        "formulations/metrics.py",
        "formulations/beam_search/beam.c",
    ],
)
def test_changed_code_that_flies_changes_the_hash(copy, name):
    package, _, below = name.partition("/")
    with (copy[package] / below).open("a") as file:
        file.write("# another\n")
    assert hash_of(copy) != code_hash()


def test_moved_code_and_a_new_planner_change_the_hash(copy):
    planners = copy["obsplan"] / "planners"
    (planners / "circle.py").rename(planners / "circles.py")
    moved = hash_of(copy)
    (planners / "mine.py").touch()
    assert len({code_hash(), moved, hash_of(copy)}) == 3


def test_changed_drawing_and_telling_leave_the_hash(copy):
    for below in ("report/map.py", "cli/campaigns.py", "campaign/table.py", "recording.py"):
        with (copy["obsplan"] / below).open("a") as file:
            file.write("# another\n")
    assert hash_of(copy) == code_hash()


@pytest.mark.parametrize(
    ("scenario", "planner"), [("suite/keep-outs", "path-inertia"), ("harbor-survey", "gramian")]
)
def test_whatever_runs_while_a_mission_flies_is_in_the_hash(scenario, planner):
    """The oracle is Python's own: the files of all functions called."""
    (cell,) = plan_cells([scenario], planners=[planner], vary=["duration=30.0"])
    ran = set()
    sys.setprofile(lambda frame, *_: ran.add(frame.f_code.co_filename))
    try:
        outcome = fly_mission(Batch(1, cell.content, (1,), False), 1)
    finally:
        sys.setprofile(None)
    assert outcome.error is None
    counted = {str(path) for name, root in PACKAGES.items() for _, path in sources(name, root)}
    ours = {name for name in ran if any(name.startswith(f"{root}/") for root in PACKAGES.values())}
    assert len(ours) > 20
    assert ours <= counted


def test_results_of_other_code_leave_the_table_and_come_back_with_it(tmp_path, monkeypatch):
    pond = write_scenario(tmp_path, duration=10.0)
    before = plan_cells([pond])
    with Store(tmp_path) as store:
        (number,) = store.enter(before)
        store.add([(number, FLOWN)])
        assert (len(store.current_cells()), store.set_aside()) == (1, 0)
        with monkeypatch.context() as changed:
            changed.setattr("obsplan.campaign.plan.code_hash", lambda: "of another planner")
            (other,) = store.enter(plan_cells([pond]))
        assert [*store.missing(other, before[0].seeds)] == [1]
        assert store.set_aside() == 1
        assert [cell for cell, *_ in store.current_cells()] == [other]
        assert store.enter(before) == [number]
        assert (store.count(number, before[0].seeds), store.set_aside()) == (1, 0)


def test_missions_that_are_not_in_the_table_are_told_of(tmp_path, monkeypatch, capsys):
    report = Report(missions=5, flown=5, failed=0, failures=[], set_aside=40)
    monkeypatch.setattr("obsplan.campaign.fly_campaign", lambda *_, **__: report)
    fly((), tmp_path)
    told = " ".join(capsys.readouterr().out.split())
    assert "40 earlier ones are kept but not in the table: other code or another version" in told


@pytest.mark.parametrize(
    ("version", "code", "sentence"),
    [
        ("0.0.1", "0", r"a worker has obsplan 0\.0\.1 and this is .*; install"),
        (obsplan.__version__, "0", "the same version as here but other code; give both the same"),
    ],
)  # fmt: skip
def test_worker_of_another_version_or_other_code_is_refused_by_what_differs(
    version, code, sentence
):
    with pytest.raises(ObsplanError, match=sentence):
        check_same_copy(Flown([FLOWN], 0.0, version, code))
    check_same_copy(Flown([FLOWN], 0.0, obsplan.__version__, code_hash()))
