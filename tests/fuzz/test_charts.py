"""Damaged charts by seed: a picture or a sentence, never a crash."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from fuzz.trying import SEED, share, told

pytest.importorskip("rasterio")


@pytest.mark.slow
def test_a_damaged_chart_is_drawn_or_refused_in_a_sentence(tmp_path):
    given = [str(tmp_path), str(SEED), str(share(300))]
    line = [sys.executable, "-m", "fuzz.chart_trials", *given]
    ran = subprocess.run(line, cwd=Path(__file__).parents[1], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""  # no library says anything of its own
    known = {"drawn", "refused", "not near"}
    assert told("charts", Counter(json.loads(ran.stdout)), known) == []
