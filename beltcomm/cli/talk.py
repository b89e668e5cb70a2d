"""Talk on stderr: a live display in a terminal, plain lines elsewhere."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable
from typing import Any, TextIO

from beltcomm.cli.pace import Pace, machine_left, millimetres
from beltcomm.cli.terminal import console_of, draw, draws, echo, fitted
from beltcomm.errors import UsageError
from beltcomm.talk import CarriagePosition

#: Plain lines report progress at these steps of the fraction, so that a log of a minute stays short.
PLAIN_STEP = 0.25


def terminal_talk(verbose: int = 0) -> PlainTalk | RichTalk:
    """The Talk for this process.   verbose : 1 shows what the library reports, 2 its details too."""
    if verbose:
        logging.basicConfig(stream=sys.stderr, format="%(name)s: %(message)s")
        logging.getLogger("beltcomm").setLevel(logging.DEBUG if verbose > 1 else logging.INFO)
    return RichTalk(sys.stderr) if draws(sys.stderr) else PlainTalk(sys.stderr)


def place_of(index: int, count: int) -> str:
    """Of a phase: ``2/5``, or ``2`` where nobody knows of how many."""
    return f"{index}/{count}" if count else str(index)


class PlainTalk:
    """Lines without colour or movement, for logs and pipes.   clock : s, of the wall."""

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream = stream
        self._reported = 0.0
        self._place: CarriagePosition | None = None
        self._pace = Pace(clock)

    def phase(self, index: int, count: int, title: str) -> None:
        """``[2/5] title``, ``[2] title`` where nobody knows of how many."""
        self._reported, self._place = 0.0, None
        self._pace.begin()
        self.say(f"[{place_of(index, count)}] {title}")

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """A line at each quarter of a calculation."""
        if self._place is None and fraction >= self._reported + PLAIN_STEP:
            self._reported = fraction - fraction % PLAIN_STEP
            self.say(f"      {100.0 * fraction:.0f} %{self._pace.left(fraction, seconds_left)}")

    def moving(self, place: CarriagePosition) -> None:
        """A line at the first place that is told of each record: a log of a minute stays short."""
        if self._place is None or place.record != self._place.record:
            low, high = place.window_m
            window = f" (of {millimetres(low, place)} to {millimetres(high, place)})" if math.isfinite(high - low) else ""
            left = ", ".join(part for part in (f"carriage at {millimetres(place.position_m, place)}{window}", machine_left(place)) if part)
            self.say(f"      {place.record}: {left}")
        self._place = place

    def say(self, *lines: str) -> None:
        """Each text on its own line."""
        echo(lines, self._stream)
        self._stream.flush()

    def confirm(self, text: str) -> bool:
        """Ask and read a line from stdin.   Raises UsageError when stdin is closed."""
        return _ask(text, self._stream)

    def attended(self) -> bool:
        """Whether stdin is a terminal."""
        return sys.stdin is not None and sys.stdin.isatty()

    def close(self, done: bool = False) -> None:
        """Nothing to put back."""


class RichTalk:
    """A live display below the text: phase n of m, the record with its seconds, where the carriage is in its window.

    clock : s, of the wall.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic) -> None:
        self._stream, self._console, self._clock = stream, console_of(stream), clock
        self._live: Any = None
        self._shown: Any = None

    def phase(self, index: int, count: int, title: str) -> None:
        """Begin a new display for the phase; of the one before a line stays."""
        from rich.live import Live

        from beltcomm.cli.display import Display

        self.close(done=True)
        self._shown = Display(place_of(index, count), title, Pace(self._clock), self._clock)
        self._live = Live(self._shown, console=self._console, transient=True, refresh_per_second=8, redirect_stdout=False)
        self._live.start()

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Move the bar."""
        if self._live is not None:
            self._shown.progress(fraction, seconds_left)

    def moving(self, place: CarriagePosition) -> None:
        """Move the carriage in its window."""
        if self._live is not None:
            self._shown.place = place

    def say(self, *lines: str) -> None:
        """The text above the display."""
        draw(lines, self._console, self._stream)

    def confirm(self, text: str) -> bool:
        """Ask below everything.   Raises UsageError when stdin is closed."""
        self.close(done=True)
        return _ask(text, self._stream)

    def attended(self) -> bool:
        """Whether stdin is a terminal."""
        return sys.stdin is not None and sys.stdin.isatty()

    def close(self, done: bool = False) -> None:
        """End the display and give the terminal its cursor back.   done : the phase came to its end.   Idempotent."""
        if self._live is not None:
            live, self._live = self._live, None
            live.stop()
            self.say(self._shown.ended(done))


def _ask(text: str, stream: TextIO) -> bool:
    print(f"{fitted(text, stream)} [y/N] ", end="", file=stream, flush=True)
    answer = sys.stdin.readline() if sys.stdin is not None else ""  # it was closed before this program began
    if not answer:
        raise UsageError("nobody answers (stdin is closed); use --yes where no one is asked")
    return answer.strip().lower() in {"y", "yes"}
