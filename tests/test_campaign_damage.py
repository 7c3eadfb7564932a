"""A campaign's store whose bytes change at rest: told in a sentence, and flown again."""

import json
import os
import re
import socket
import struct
import subprocess
import sys
from concurrent.futures import Future
from contextlib import contextmanager

import numpy as np
import pytest
from campaigns import tables, without_rights, write_scenario

import obsplan
from obsplan import ObsplanError, load_campaign
from obsplan.campaign import execute, fly_campaign, plan_cells
from obsplan.campaign.code import code_hash
from obsplan.campaign.faults import FILE
from obsplan.campaign.layout import FIGURES
from obsplan.campaign.lock import held
from obsplan.campaign.worker import Batch, Flown, Outcome
from obsplan.cli import app
from obsplan.cli.campaigns import fly

RUNS = 60  # of each of two cells: some sixty pages


def figures_of(batch, seed):
    """Figures like a mission's, at once."""
    rng = np.random.default_rng([len(batch.content), seed])
    return dict(zip(FIGURES, rng.lognormal(size=len(FIGURES)).tolist(), strict=True))


class Instant:
    """A crew that flies at once, and counts."""

    def __init__(self):
        self.flown = 0

    def threads(self):
        return 1

    def send(self, batch):
        self.flown += len(batch.seeds)
        outcomes = []
        for seed in batch.seeds:
            figures = figures_of(batch, seed)
            auv = json.dumps({"alpha": figures})
            outcomes.append(Outcome(seed, None, figures, auv, '{"optimal":12}'))
        future = Future()
        future.set_result(Flown(outcomes, 1e-3, obsplan.__version__, code_hash()))
        return future


@pytest.fixture
def crew(monkeypatch):
    crew = Instant()
    aboard = contextmanager(lambda **_: (yield crew))
    monkeypatch.setattr(execute, "crew_of", aboard)
    return crew


@pytest.fixture
def complete(tmp_path, crew):
    """Cells and the folder of their complete campaign."""
    cells = plan_cells([write_scenario(tmp_path)], vary=["cna.speed=1.5,3.0"], runs=RUNS)
    fly_campaign(cells, tmp_path / "out")
    crew.flown = 0
    return cells, tmp_path / "out"


def flipped(content, rng):
    """The content with one bit changed, in a third of cases in the page that describes the file."""
    place = rng.integers(4096 if rng.random() < 1 / 3 else len(content))
    changed = bytearray(content)
    changed[place] ^= 1 << rng.integers(8)
    return bytes(changed)


@pytest.mark.slow
def test_no_flipped_bit_changes_a_figure_unseen(complete):
    """The oracle is the table before; digests are checked by what they must prevent."""
    cells, out = complete
    whole, exported, content = load_campaign(out), tables(out), (out / FILE).read_bytes()
    rng = np.random.default_rng(0)
    told = mended = 0
    for _ in range(120):
        (out / FILE).write_bytes(flipped(content, rng))
        try:
            assert load_campaign(out).equals(whole)
            continue
        except ObsplanError:
            told += 1
        try:
            report = fly_campaign(cells, out)
        except ObsplanError:  # beyond mending
            continue
        mended += report.damage is not None
        assert report.damage is None or report.flown == report.damage.lost
        assert tables(out) == exported
    assert told >= mended > 20  # a flip in free space harms nobody


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
