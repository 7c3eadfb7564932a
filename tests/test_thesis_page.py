"""The thesis as a folder: picture, data and page of each item, kept as they are finished."""

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import obsplan as op
from obsplan.thesis import ITEMS, free_or_begun, write_thesis


@pytest.mark.slow
def test_folder_holds_picture_data_and_page_the_same_on_every_run(tmp_path):
    done = []
    for name in ("a", "b"):
        write_thesis(
            ["fig5.2", "fig5.1"], tmp_path / name, runs=2, progress=lambda k, n: done.append((k, n))
        )
    first, second = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        for name in ("a", "b")
    )
    assert first == second
    assert set(first) == {
        "findings.json",
        "thesis.md",
        *(f"{item}.{kind}" for item in ("fig5.1", "fig5.2") for kind in ("png", "nc")),
    }
    assert done == [(1, 2), (2, 2)] * 2
    page = first["thesis.md"].decode()
    assert page.index("| [fig5.1](#fig51) |") < page.index("| [fig5.2](#fig52) |")
    assert ITEMS["fig5.2"].claim in page
    with xr.open_dataset(tmp_path / "a" / "fig5.1.nc", engine="scipy") as data:
        np.testing.assert_allclose(data.distance, 1.0)


def test_unknown_item_and_existing_folder_are_refused_and_nothing_is_left(tmp_path):
    with pytest.raises(op.ObsplanError, match=r'no "fig9.9"; give all, or some of fig2.1'):
        write_thesis(["fig9.9"], tmp_path / "out")
    (tmp_path / "there").mkdir()
    with pytest.raises(op.ObsplanError, match="exists and is not overwritten"):
        write_thesis(["fig5.1"], tmp_path / "there")
    assert [path.name for path in tmp_path.iterdir()] == ["there"]


@pytest.mark.slow
def test_work_that_was_interrupted_goes_on_and_ends_with_the_same_bytes(tmp_path, monkeypatch):
    names = ["fig5.1", "fig5.2", "fig5.3"]
    write_thesis(names, tmp_path / "whole", runs=2)

    def interrupt(done, _):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_thesis(names, tmp_path / "cut", runs=2, progress=interrupt)
    kept = {path.name for path in (tmp_path / "cut").iterdir()}
    assert {"fig5.1.png", "fig5.2.nc", "findings.json"} <= kept
    assert not kept & {"fig5.3.nc", "thesis.md"}

    computed = []
    for name in names:
        item = ITEMS[name]
        count = lambda item=item, **options: computed.append(item.name) or item.compute(**options)  # noqa: E731
        monkeypatch.setitem(ITEMS, name, replace(item, compute=count))
    findings = write_thesis(names, tmp_path / "cut", runs=2)
    assert computed == ["fig5.3"]
    assert list(findings) == names
    whole, cut = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()}
        for name in ("whole", "cut")
    )
    assert whole == cut


@pytest.mark.slow
def test_only_the_same_request_goes_on_in_a_folder_and_only_until_it_is_complete(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    asked = {"names": ["fig5.1", "fig5.2"], "runs": 2, "seed": 1}
    assert free_or_begun(None, **asked) == Path("thesis")
    with pytest.raises(KeyboardInterrupt):
        write_thesis(
            asked["names"], "thesis", runs=2, progress=lambda *_: (_ for _ in ()).throw(KeyboardInterrupt)
        )  # fmt: skip
    assert free_or_begun(None, **asked) == Path("thesis")
    assert free_or_begun(Path("thesis"), **asked) == Path("thesis")
    for other in ({"names": ["fig5.1"]}, {"runs": 3}, {"seed": 2}):
        assert free_or_begun(None, **(asked | other)) == Path("thesis-2")
        with pytest.raises(op.ObsplanError, match="thesis exists and is not overwritten"):
            free_or_begun(Path("thesis"), **(asked | other))
    with monkeypatch.context() as changed:
        changed.setattr("obsplan.__version__", "999.0")
        assert free_or_begun(None, **asked) == Path("thesis-2")
    with monkeypatch.context() as changed:
        changed.setattr("obsplan.thesis.page.code_hash", lambda *_: "of another planner")
        assert free_or_begun(None, **asked) == Path("thesis-2")
    write_thesis(asked["names"], "thesis", runs=2)
    assert free_or_begun(None, **asked) == Path("thesis-2")
    with pytest.raises(op.ObsplanError, match="thesis exists and is not overwritten"):
        write_thesis(asked["names"], "thesis", runs=2)
    Path("thesis-2").mkdir()
    Path("thesis-2/findings.json").write_text("{broken")
    assert free_or_begun(None, **asked) == Path("thesis-3")


@pytest.mark.slow
def test_ctrl_c_says_what_is_kept_and_the_same_command_goes_on(tmp_path):
    command = [sys.executable, "-m", "obsplan", "thesis", "fig5.1", "fig5.2", "table5.2", "--runs", "400"]  # fmt: skip
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    record = tmp_path / "thesis" / "findings.json"
    end = time.monotonic() + 300
    while not (record.exists() and "fig5.1" in json.loads(record.read_text())["found"]):
        assert time.monotonic() < end
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert (  # above it there may be lines of progress
        error.splitlines()[-1]
        == "obsplan: interrupted; what is finished is kept in thesis, and the same command goes on from there"
    )
    command[-1] = "2"  # the seeds that the test has time for: another request, another folder
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert "Written to thesis-2/: thesis.md" in done.stdout
    assert not (tmp_path / "thesis" / "thesis.md").exists()


@pytest.mark.slow
def test_command_makes_the_folder_and_refuses_what_it_does_not_know(tmp_path):
    command = [sys.executable, "-c", "from obsplan.cli import main; main()"]
    made = subprocess.run(
        [*command, "thesis", "fig5.1", "--out", "here"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert made.returncode == 0, made.stderr
    assert "agrees" in made.stdout
    assert (tmp_path / "here" / "thesis.md").exists()
    refused = subprocess.run(
        [*command, "thesis", "fig5.13"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert refused.returncode == 2
    assert "fig5.13" in refused.stderr
