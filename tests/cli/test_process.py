"""The process of a command: what it leaves to the end, and what not."""

from __future__ import annotations

import gc
import os
import pty
import subprocess
import sys

import pytest

from beltcomm.cli import main


@pytest.mark.parametrize(("verb", "collecting"), [("report", False), ("compare", True)])
def test_a_process_that_ends_does_not_look_through_what_it_leaves(monkeypatch: pytest.MonkeyPatch, verb: str, collecting: bool) -> None:
    """And a report, which drops little, does not look for what it dropped either."""
    seen: list[object] = []
    monkeypatch.setattr(sys, "argv", ["beltcomm", verb, "run"])
    monkeypatch.setattr(main, "prepare", lambda: None)  # the streams are those of the tests
    monkeypatch.setattr(main, "cli", lambda: seen.append(gc.isenabled()) or sys.exit(3))
    monkeypatch.setattr(gc, "freeze", lambda: seen.append("frozen"))
    try:
        with pytest.raises(SystemExit) as ended:
            main.main()
    finally:
        gc.enable()
    assert seen == [collecting, "frozen"]
    assert ended.value.code == 3


def test_a_terminal_reads_at_once_that_a_plan_is_computed() -> None:
    """What can be wrong is found after that: an axis that is not there."""
    mine, theirs = pty.openpty()
    words = [sys.executable, "-m", "beltcomm", "commission", "--drive", "virtual", "--axis", "no_such.yaml"]
    done = subprocess.run(words, stderr=theirs, stdout=subprocess.PIPE, env={**os.environ, "BELTCOMM_LANG": "en"}, check=False)
    said = os.read(mine, 4096).decode()
    assert done.returncode == 2
    assert said.startswith("Planning on virtual: ")
    assert "no_such.yaml" in said
