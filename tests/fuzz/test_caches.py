"""Faults of generated code by seed: never a wrong result and never a crash."""

import json
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from fuzz.trying import SEED, share, told

from formulations.model.compiler import find_compiler

pytestmark = pytest.mark.skipif(find_compiler() is None, reason="needs a C compiler")


@pytest.mark.slow
def test_no_fault_of_generated_code_changes_a_result_or_crashes(tmp_path):
    given = [str(tmp_path), str(SEED), str(share(32))]
    line = [sys.executable, "-m", "fuzz.cache_trials", *given]
    ran = subprocess.run(line, cwd=Path(__file__).parents[1], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    assert told("caches", Counter(json.loads(ran.stdout)), {"same bits"}) == []
