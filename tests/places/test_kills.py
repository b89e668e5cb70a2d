"""A process killed before any of its steps on files: the same command then does it.  All commands: tests/benchmarks/kills.py."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.parametrize(("job", "least"), [pytest.param("import", 20, marks=pytest.mark.examination), ("add", 15)])
def test_whenever_it_is_killed_it_can_be_done_again(tmp_path: Path, job: str, least: int) -> None:
    tests = Path(__file__).parents[1]
    environment = {**os.environ, "PYTHONPATH": str(tests), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, "-m", "places.dying", job, str(tmp_path)], capture_output=True, text=True, env=environment, cwd=tmp_path
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["steps"] >= least
    assert told["wrong"] == {}, done.stderr
