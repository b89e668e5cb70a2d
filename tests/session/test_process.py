"""The console command in a process of its own: ended from outside, and with a drive that does not answer."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from beltcomm.runfolder import RunFolder
from marks import quick


@pytest.mark.parametrize(("number", "deaf"), quick([(signal.SIGINT, False), (signal.SIGINT, True), (signal.SIGTERM, False)], 1))
def test_ended_from_outside(tmp_path: Path, number: signal.Signals, deaf: bool) -> None:
    """The console command itself, in its own process, interrupted while it records.   deaf : as a script's job in the background begins."""
    run = tmp_path / "run"
    words = ["identify", "--drive", "virtual", "--yes", "--realtime", "--json", "--run", str(run)]
    command = [sys.executable, "-c", "from beltcomm.cli.main import main; main()", *words]
    # Tests that run under nohup hand on a SIGHUP that is ignored; a terminal's is not.
    heard = partial(signal.signal, signal.SIGINT, signal.SIG_IGN) if deaf else partial(signal.signal, signal.SIGHUP, signal.SIG_DFL)
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path, preexec_fn=heard) as process:
        give_up = time.monotonic() + 60.0
        while not (run / "recordings" / "amplitude_1.csv.part").exists():
            assert process.poll() is None, process.communicate()[1]
            assert time.monotonic() < give_up
            time.sleep(0.02)
        time.sleep(0.5)
        os.kill(process.pid, number)
        if number != signal.SIGINT:  # closing a terminal sends several
            time.sleep(0.02)
            os.kill(process.pid, number)
        stdout, stderr = process.communicate(timeout=30.0)
    assert process.returncode == 4
    assert json.loads(stdout)["exit_code"] == 4
    said = f"beltcomm: interrupted; the axis is stopped and the drive's own gains are restored; what was recorded is kept in {run}"
    assert said in stderr.splitlines()
    assert "Traceback" not in stderr
    assert RunFolder.open(run).unfinished() == ["amplitude_1"]
    assert (run / "journal.txt").read_text(encoding="utf-8").splitlines()[-1].endswith(" s  all parameters restored")


def test_stderr_holds_sentences_and_no_library_chatter(tmp_path: Path) -> None:
    """A drive that does not answer, in a process of its own: what the CAN library logs is not for the user."""
    script = (
        "import functools, beltcomm.api as api, beltcomm.drive as drive\n"
        "from beltcomm.virtual.faults import Faults\n"
        "api.open_drive = lambda name, options: drive.open_drive(name, {**options, 'faults': Faults(silent_from_s=0.0)})\n"
        "from beltcomm.cli.main import main\n"
        "main()\n"
    )
    words = ["identify", "--drive", "virtual", "--yes", "--run", str(tmp_path / "run")]
    outcome = subprocess.run(
        [sys.executable, "-c", script, *words], capture_output=True, text=True, cwd=tmp_path, timeout=60.0, check=False
    )
    assert (outcome.returncode, outcome.stdout) == (5, "")
    assert len(outcome.stderr.splitlines()) == 1
    assert outcome.stderr.startswith("beltcomm: no drive answers on ")


def test_the_package_runs_as_the_command_does(tmp_path: Path) -> None:
    outcome = subprocess.run(
        [sys.executable, "-m", "beltcomm", "design"], capture_output=True, text=True, cwd=tmp_path, timeout=60.0, check=False
    )
    assert (outcome.returncode, outcome.stdout) == (2, "")
    assert outcome.stderr.startswith("beltcomm: ") or "beltcomm design" in outcome.stderr
