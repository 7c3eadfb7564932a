"""A campaign's store whose bytes change at rest: told in a sentence, and flown again."""

import os
import re
import socket
import struct
import subprocess
import sys

import pytest
from campaigns import (
    complete_campaign,
    figures_of,
    instant_crew,
    tables,
    without_rights,
    write_scenario,
)

from obsplan import ObsplanError, load_campaign
from obsplan.campaign import fly_campaign, lock, plan_cells
from obsplan.campaign.faults import FILE
from obsplan.campaign.lock import held
from obsplan.campaign.worker import Batch
from obsplan.cli import app
from obsplan.cli.campaigns import fly


@pytest.fixture
def crew(monkeypatch):
    return instant_crew(monkeypatch)


@pytest.fixture
def complete(tmp_path, crew):
    """Cells and the folder of their complete campaign."""
    cells = complete_campaign(tmp_path)
    crew.flown = 0
    return cells, tmp_path / "out"


@pytest.mark.slow
def test_what_is_damaged_is_flown_again_and_counted(complete, crew, capsys):
    cells, out = complete
    exported, content = tables(out), (out / FILE).read_bytes()
    figure = figures_of(Batch(0, cells[1].content, (7,), False), 7)["max_error_m"]
    place = content.index(struct.pack(">d", figure))
    (out / FILE).write_bytes(content[:place] + b"\x41" + content[place + 1 :])
    for command in ("campaign-check", "campaign-report"):
        complaint = refused(capsys, command, out)
        assert "campaign.sqlite is damaged: 1 of 120 missions; the campaign's command" in complaint
    fly(cells, out)
    said = capsys.readouterr().out
    assert "120 missions: 1 flown now, 119 were there, 0 failed." in said
    assert f"The results kept in {out} were damaged: 1 of 120 missions." in said
    assert crew.flown == 1
    assert tables(out) == exported
    app(["campaign-check", str(out)], standalone_mode=False)
    assert "Missions: 120" in capsys.readouterr().out


def refused(capsys, *line):
    """What the command line complains of."""
    with pytest.raises(ObsplanError) as caught:
        app([str(word) for word in line], standalone_mode=False)
    assert capsys.readouterr().out == ""
    return str(caught.value)


def test_damage_can_be_left_out_so_that_the_rest_is_read(complete, capsys):
    _, out = complete
    whole, content = load_campaign(out), (out / FILE).read_bytes()
    (out / FILE).write_bytes(content[: len(content) - 4096])
    app(["campaign-check", str(out), "--mend"], standalone_mode=False)
    said = re.search(r"were damaged: (\d+) of 120 missions", capsys.readouterr().out)
    rest = load_campaign(out)
    assert len(rest) == 120 - int(said[1]) >= 60
    of_rest = whole.merge(rest[["cna.speed", "seed"]])
    assert rest.equals(of_rest)


@pytest.mark.parametrize("size", [0, 50, 1000, 4096, 30_000])
def test_store_that_was_cut_is_never_begun_anew_in_silence(complete, size):
    cells, out = complete
    exported = tables(out)
    with (out / FILE).open("r+b") as file:
        file.truncate(size)
    with pytest.raises(ObsplanError, match=r"campaign\.sqlite"):
        load_campaign(out)
    if size < 4096:  # the page that says what it is is gone
        with pytest.raises(ObsplanError, match="put a copy"):
            fly_campaign(cells, out)
        assert (out / FILE).stat().st_size == size
        return
    report = fly_campaign(cells, out)
    assert report.damage.kept + report.flown == 120
    assert tables(out) == exported


def test_second_campaign_in_a_folder_is_told_who_has_it(complete):
    cells, out = complete
    here = (
        rf"another campaign is at work in {out} \(process {os.getpid()} on {socket.gethostname()}\)"
    )
    with held(out), pytest.raises(ObsplanError, match=here):
        fly_campaign(cells, out)
    fly_campaign(cells, out)


def test_lock_of_a_file_that_another_campaign_removes_meanwhile_is_taken_anew(
    tmp_path, monkeypatch
):
    taken = []

    def take(file, folder):
        taken.append(file)
        if len(taken) == 1:  # it was opened before the other campaign ended
            (folder / lock.LOCK).unlink()

    monkeypatch.setattr(lock, "take", take)
    with held(tmp_path):
        assert str(os.getpid()) in (tmp_path / lock.LOCK).read_text()
    assert not (tmp_path / lock.LOCK).exists()


@pytest.mark.usefixtures("crew")
def test_store_that_was_being_made_when_its_campaign_was_killed_is_made_again(tmp_path):
    cells = plan_cells([write_scenario(tmp_path)], runs=3)
    out = tmp_path / "out"
    out.mkdir()
    (out / f".{FILE}.1.part").touch()
    assert fly_campaign(cells, out).flown == 3


@pytest.mark.slow
def test_complete_campaign_is_read_where_nothing_may_be_written(complete):
    _, out = complete
    before = {path.name for path in out.iterdir()}
    for path in (*out.iterdir(), out):
        path.chmod(0o555 if path.is_dir() else 0o444)
    try:
        for line in (["campaign-check", out], ["campaign-report", out, "--out", out.parent / "r"]):
            command = [sys.executable, "-m", "obsplan", *line]
            subprocess.run(without_rights(command), check=True, capture_output=True)
        assert {path.name for path in out.iterdir()} == before
    finally:
        out.chmod(0o755)
    assert (out.parent / "r" / "medians.csv").exists()
