"""How a command ends: signals end it like Ctrl-C, and what it says to type next can be typed."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from beltcomm.cli.frame import _typed
from beltcomm.cli.main import like_ctrl_c


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_the_first_interrupts_and_the_second_disturbs_nothing(number: signal.Signals) -> None:
    noted, restored = [], False
    found = signal.signal(number, signal.SIG_DFL)  # under nohup the tests themselves begin with SIGHUP ignored
    try:
        with like_ctrl_c(lambda: noted.append(True)):
            with pytest.raises(KeyboardInterrupt):
                signal.raise_signal(number)
            signal.raise_signal(signal.SIGTERM)
            signal.raise_signal(signal.SIGHUP)
            restored = True
        assert signal.getsignal(number) is signal.SIG_DFL
    finally:
        signal.signal(number, found)
    assert restored
    assert noted == [True]


def test_nohup_stays_nohup() -> None:
    before, noted = signal.signal(signal.SIGHUP, signal.SIG_IGN), list[bool]()
    try:
        with like_ctrl_c(lambda: noted.append(True)):
            signal.raise_signal(signal.SIGHUP)
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_IGN
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert noted == []


@pytest.mark.parametrize(("found", "shown"), [(None, "bin/beltcomm fit R"), ("/usr/bin/beltcomm", "beltcomm fit R")])
def test_what_to_type_next_is_what_the_terminal_finds(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, found: str | None, shown: str
) -> None:
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "beltcomm").write_text("")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(tmp_path / "bin" / "beltcomm")])
    monkeypatch.setattr("shutil.which", lambda _: found)
    lines = ["beltcomm fit: 3 records", "Next: beltcomm fit R   (a model)", "next: then `beltcomm fit R` again"]
    assert list(_typed(lines)) == [lines[0], "  Next  a model", f"    {shown}", "  Next  then again", f"    {shown}"]
