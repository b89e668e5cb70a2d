"""``--hold-to-run``: the key's own logic on a pipe, and the command in a terminal whose space bar is let go."""

from __future__ import annotations

import os
import pty
import select
import signal
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm.cli.hold import KEY, HeldKey
from beltcomm.cli.main import cli


class Hand:
    """A pipe to a key, and its clock: every look passes 30 ms; presses come when they are due."""

    def __init__(self, presses_s: list[float], byte: bytes = KEY) -> None:
        self.read_fd, self._write_fd = os.pipe()
        self.presses, self.byte = list(presses_s), byte
        self.now_s, self.said = 0.0, list[str]()
        self.key = HeldKey(self.read_fd, KEY, self.said.append, self.clock)

    def clock(self) -> float:
        self.now_s += 0.03
        while self.presses and self.presses[0] <= self.now_s:
            self.presses.pop(0)
            os.write(self._write_fd, self.byte)
        if not self.presses and self._write_fd >= 0 and self.now_s > 60.0:
            self.close()
        return self.now_s

    def close(self) -> None:
        os.close(self._write_fd)
        self._write_fd = -1


def test_a_key_that_repeats_is_held_until_it_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(select, "select", lambda r, w, x, wait: _select(r, 0.0))
    hand = Hand([0.1 * k for k in range(1, 31)])  # for three seconds
    assert hand.key.begin()
    assert hand.said == ["Hold the space bar as long as the axis may move; letting go stops it."]
    released_s = next(hand.now_s for _ in range(1000) if not hand.key.pressed())
    assert 3.0 + 0.5 <= released_s <= 3.0 + 0.5 + 0.1


def test_a_key_that_was_hit_is_not_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """Single hits a second apart never arm it; the pipe's end means that nobody ever will."""
    monkeypatch.setattr(select, "select", lambda r, w, x, wait: _select(r, 0.0))
    hand = Hand([1.0, 2.0, 3.0])
    assert not hand.key.begin()


def test_another_key_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(select, "select", lambda r, w, x, wait: _select(r, 0.0))
    hand = Hand([0.1 * k for k in range(1, 31)], byte=b"x")
    assert not hand.key.begin()


_real_select = select.select


def _select(fds: list[int], wait: float) -> tuple[list[int], list[int], list[int]]:
    """Without waiting: the clock of the test passes by itself."""
    return _real_select(fds, [], [], wait)


@pytest.mark.parametrize(("words", "hint"), [(["--hold-to-run"], "needs a terminal"), (["--hold-to-run=77"], "no open file descriptor")])
def test_without_a_key_nothing_begins(words: list[str], hint: str) -> None:
    outcome = CliRunner().invoke(cli, ["move", "--drive", "virtual", "--by", "5mm", "--yes", *words])
    assert outcome.exit_code == 2
    assert hint in outcome.stderr


def test_letting_go_in_a_terminal_ends_like_ctrl_c(tmp_path: Path) -> None:
    """The command itself behind a pseudo-terminal in real time; the axis creeps while the space bar repeats."""
    words = ["identify", "--drive", "virtual", "--realtime", "--yes", "--hold-to-run", "--run", str(tmp_path / "run")]
    child, terminal = pty.fork()
    if child == 0:
        os.environ["COLUMNS"] = "400"
        os.execv(sys.executable, [sys.executable, "-c", "from beltcomm.cli.main import main; main()", *words])
    held_until: float | None = None
    seen, give_up = b"", time.monotonic() + 120.0
    record = tmp_path / "run" / "recordings" / "amplitude_1.csv.part"
    while time.monotonic() < give_up:
        if select.select([terminal], [], [], 0.05)[0]:
            try:
                seen += os.read(terminal, 4096)
            except OSError:  # the child has closed its end
                break
        if held_until is None and record.exists():
            held_until = time.monotonic() + 0.3
        if b"Hold the space bar" in seen and (held_until is None or time.monotonic() < held_until):
            os.write(terminal, KEY)
    else:
        os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    os.close(terminal)
    text = seen.decode(errors="replace")
    assert os.waitstatus_to_exitcode(status) == 4, text
    assert "the key was let go; the axis was stopped" in text
    journal = (tmp_path / "run" / "journal.txt").read_text(encoding="utf-8").splitlines()
    assert any("  safety stop (released): the key was let go" in line for line in journal)
    assert journal[-1].endswith("  all parameters restored")
