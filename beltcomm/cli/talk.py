"""Talk on stderr: a progress line in a terminal, plain lines elsewhere.  ``NO_COLOR`` is honoured."""

from __future__ import annotations

import logging
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

from beltcomm.errors import UsageError

#: Plain lines report progress at these steps of the fraction, so that a log of a minute stays short.
PLAIN_STEP = 0.25
#: s and share of a calculation after which its pace tells how long it will still take.
PACE_S, PACE_SHARE = 1.0, 0.05


def terminal_talk(verbose: int = 0) -> PlainTalk | RichTalk:
    """The Talk for this process.   verbose : 1 shows what the library reports, 2 its details too."""
    if verbose:
        logging.basicConfig(stream=sys.stderr, format="%(name)s: %(message)s")
        logging.getLogger("beltcomm").setLevel(logging.DEBUG if verbose > 1 else logging.INFO)
    return RichTalk() if sys.stderr.isatty() else PlainTalk(sys.stderr)


class _Pace:
    """Seconds left in a phase: on the machine they are known, in a calculation its pace so far tells them."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.begin()

    def begin(self) -> None:
        """A phase begins now."""
        self._begun_s = self._clock()

    def left(self, fraction: float, seconds_left: float | None) -> str:
        """In words; nothing while it cannot be told."""
        if seconds_left is not None:
            return f", {seconds_left:.0f} s left" if seconds_left >= 1.0 else ""
        passed_s = self._clock() - self._begun_s
        if not PACE_SHARE <= fraction < 1.0 or passed_s < PACE_S:
            return ""
        return f", about {passed_s * (1.0 - fraction) / fraction:.0f} s left"


class PlainTalk:
    """Lines without colour or movement, for logs and pipes.   clock : s, of the wall."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._reported = 0.0
        self._pace = _Pace(clock)

    def phase(self, index: int, count: int, title: str) -> None:
        """``[2/5] title``."""
        self._reported = 0.0
        self._pace.begin()
        self.say(f"[{index}/{count}] {title}")

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """A line at each quarter."""
        if fraction >= self._reported + PLAIN_STEP:
            self._reported = fraction - fraction % PLAIN_STEP
            self.say(f"      {100.0 * fraction:.0f} %{self._pace.left(fraction, seconds_left)}")

    def say(self, text: str) -> None:
        """The text on its own line."""
        print(text, file=self._stream, flush=True)

    def confirm(self, text: str) -> bool:
        """Ask and read a line from stdin.   Raises UsageError when stdin is closed."""
        return _ask(text, self._stream)

    def attended(self) -> bool:
        """Whether stdin is a terminal."""
        return sys.stdin.isatty()

    def close(self, done: bool = False) -> None:
        """Nothing to put back."""


class RichTalk:
    """A live progress line below the text."""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(stderr=True, highlight=False)
        self._live: Any = None
        self._task: Any = None
        self._pace = _Pace(time.monotonic)

    def phase(self, index: int, count: int, title: str) -> None:
        """Begin a new line for the phase; the line of the one before stays as its record."""
        from rich.progress import BarColumn, Progress, TextColumn

        self.close(done=True)
        self._pace.begin()
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %{task.fields[left]}"))
        self._live = Progress(*columns, console=self._console)
        self._task = self._live.add_task(f"[bold]{index}/{count}[/bold] {_escaped(title)}", total=1.0, left="")
        self._live.start()

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Move the bar; the phase ends at 1."""
        if self._live is None:
            return
        self._live.update(self._task, completed=fraction, left=self._pace.left(fraction, seconds_left))
        if fraction >= 1.0:
            self.close()

    def say(self, text: str) -> None:
        """The text above the progress line."""
        self._console.print(_escaped(text))

    def confirm(self, text: str) -> bool:
        """Ask below everything.   Raises UsageError when stdin is closed."""
        self.close(done=True)
        return _ask(text, sys.stderr)

    def attended(self) -> bool:
        """Whether stdin is a terminal."""
        return sys.stdin.isatty()

    def close(self, done: bool = False) -> None:
        """End the progress line and give the terminal its cursor back.   done : the phase came to its end.   Idempotent."""
        if self._live is not None:
            if done:
                self._live.update(self._task, completed=1.0, left="")
            self._live.stop()
            self._live = None


def _ask(text: str, stream: TextIO) -> bool:
    print(f"{text} [y/N] ", end="", file=stream, flush=True)
    answer = sys.stdin.readline()
    if not answer:
        raise UsageError("nobody answers (stdin is closed); use --yes where no one is asked")
    return answer.strip().lower() in {"y", "yes"}


def _escaped(text: str) -> str:
    from rich.markup import escape

    return escape(text)
