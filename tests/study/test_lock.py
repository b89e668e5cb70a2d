"""Two studies on one folder: the second is refused; a killed one leaves nothing that is in the way."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from beltcomm import api, locks
from beltcomm.errors import UsageError
from beltcomm.talk import Silence

#: Another process that holds the folder until it is killed, as a study does.
HOLDING = """
import sys, time
from pathlib import Path
from beltcomm.locks import occupied
from beltcomm.talk import Silence
with occupied(Path(sys.argv[1]), Silence()):
    print(flush=True)
    time.sleep(60)
"""


def test_a_second_study_is_refused_reading_is_not_and_a_killed_one_leaves_no_lock(written: Callable[..., Path], tmp_path: Path) -> None:
    study = written(members=2)
    with subprocess.Popen([sys.executable, "-c", HOLDING, str(tmp_path)], stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        other.stdout.readline()
        try:
            with pytest.raises(UsageError, match=rf"is being computed by process {other.pid} on .*; wait for its end, or end it"):
                api.study(study, tmp_path, workers=1, report=False)
            assert not (tmp_path / "members.jsonl").exists()
            assert api.study(study, tmp_path, limit=0, report=False).data["done"] == 0
        finally:
            other.kill()
    assert "process" in (tmp_path / locks.NAME).read_text(encoding="utf-8"), "the file stays and does not matter"
    assert api.study(study, tmp_path, workers=1, report=False).data["done"] == 2
    assert api.study(study, tmp_path, workers=1, report=False).data["done"] == 2, "whoever came to its end lets go"


@pytest.mark.skipif(os.name != "posix", reason="looks for orphans")
def test_the_processes_that_a_killed_study_leaves_behind_do_not_hold_its_lock(written: Callable[..., Path], tmp_path: Path) -> None:
    study = written(members=400)
    words = [sys.executable, "-m", "beltcomm", "study", str(study), "--out", str(tmp_path), "--workers", "2", "--no-report"]
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        until = time.monotonic() + 60.0
        while not (tmp_path / "members.jsonl").is_file() or not (tmp_path / "members.jsonl").stat().st_size:
            assert process.poll() is None
            assert time.monotonic() < until
            time.sleep(0.02)
        process.kill()
    assert 2 <= api.study(study, tmp_path, workers=1, limit=1, report=False).data["done"] < 400


def test_a_folder_without_locks_is_computed_in_and_that_is_said(
    written: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(*_: object) -> None:
        raise OSError(errno.ENOLCK, "No locks available")

    class Told(Silence):
        def say(self, *lines: str) -> None:
            said.extend(lines)

    said: list[str] = []
    monkeypatch.setattr("fcntl.flock", none)
    assert api.study(written(members=2), tmp_path, workers=1, report=False, talk=Told()).data["done"] == 2
    assert "knows no locks (No locks available): let no other command change it meanwhile" in said[0]


def test_a_folder_where_nothing_can_be_written_is_refused(written: Callable[..., Path], tmp_path: Path) -> None:
    (tmp_path / locks.NAME).mkdir()
    with pytest.raises(UsageError, match=r"/\.lock is a folder, a pipe or a device, no file"):
        api.study(written(members=2), tmp_path, workers=1)
