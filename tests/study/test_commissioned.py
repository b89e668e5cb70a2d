"""Members that are really commissioned: the same bit for bit by processes and on a cluster, and by a study that was killed in between.

Two members with the shortest commissioning there is (``--quick``), each of them twice: 6 s of processor time every time.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from beltcomm.study.job import study_of
from beltcomm.study.members import Doing
from study.conftest import MORE_THREADS
from study.quick import commission

#: Another process that computes the study alone.
ALONE = """
import sys
sys.path.insert(0, sys.argv[3])
from pathlib import Path
from beltcomm.study.job import study_of
from beltcomm.study.members import Doing
from study.quick import commission
study_of(sys.argv[1], Path(sys.argv[2]), doing=Doing(commission), workers=1, report=False)
"""


@pytest.mark.examination
def test_commissioned_members_are_the_same_whoever_computes_them_and_after_a_kill(written: Callable[..., Path], tmp_path: Path) -> None:
    """One process alone is killed within the second member; the cluster computes that one again, and two processes both of them."""
    from distributed import LocalCluster

    population = {"cart.mass": {"tolerance": "2 %"}, "coulomb.level": {"tolerance": "5 %"}}
    base = {"plant": "g_a", "axis": "egc-70-600"}
    study = written(each="commission", base=base, members=2, population=population, ageing=None)
    killed, members = tmp_path / "killed", tmp_path / "killed" / "members.jsonl"
    words = [sys.executable, "-c", ALONE, str(study), str(killed), str(Path(__file__).parents[1])]
    with (
        subprocess.Popen(words, env=os.environ | MORE_THREADS) as process,
        LocalCluster(n_workers=1, threads_per_worker=1, processes=True, dashboard_address=":0", silence_logs=50) as cluster,
    ):
        until = time.monotonic() + 120.0
        while not (members.is_file() and members.read_bytes().count(b"\n")) and process.poll() is None and time.monotonic() < until:
            time.sleep(0.02)
        time.sleep(0.5)  # the second one is at work
        process.kill()
        process.wait()
        (before,) = members.read_bytes().splitlines()
        study_of(study, killed, doing=Doing(commission), scheduler=cluster.scheduler_address, report=False)
    assert members.read_bytes().startswith(before + b"\n")
    whole = study_of(study, tmp_path / "whole", doing=Doing(commission), workers=2, report=False)
    assert whole.data["done"] == 2
    assert whole.data["failed"] == {}
    for name in ("members.jsonl", "summary.json"):
        assert (killed / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
