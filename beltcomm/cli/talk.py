"""Talk on stderr: a live display in a terminal, plain lines elsewhere."""

from __future__ import annotations

import logging
import math
import sys
import time
from collections.abc import Callable, Mapping
from typing import Any, TextIO

from beltcomm.cli.display import Pace, load_at, machine_left, millimetres
from beltcomm.cli.terminal import console_of, draw, draws, echo, fitted
from beltcomm.errors import UsageError
from beltcomm.language import tr
from beltcomm.talk import CarriagePosition

#: Words that agree and that refuse, in any language of the screens.
YES, NO = ("y", "yes", "j", "ja"), ("n", "no", "nein")
#: Plain lines report progress at these steps of the fraction, so that a log of a minute stays short.
PLAIN_STEP = 0.25


def terminal_talk(verbose: int = 0, details: bool = False) -> PlainTalk | RichTalk:
    """The Talk for this process.

    Parameters
    ----------
    verbose : int
        1 shows what the library reports, 2 its details too.
    details : bool
        Of what happens.
    """
    if verbose:
        logging.basicConfig(stream=sys.stderr, format="%(name)s: %(message)s")
        logging.getLogger("beltcomm").setLevel(logging.DEBUG if verbose > 1 else logging.INFO)
    kind = RichTalk if draws(sys.stderr) else PlainTalk
    return kind(sys.stderr, details=details or verbose > 0)


def _place_of(index: int, count: int) -> str:
    """Of a phase: ``2/5``, or ``2`` where nobody knows of how many."""
    return f"{index}/{count}" if count else str(index)


class PlainTalk:
    """Lines without colour or movement, for logs and pipes.

    Parameters
    ----------
    clock : callable
        Wall clock, s.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic, details: bool = False) -> None:
        self._stream, self._details = stream, details
        self._reported = 0.0
        self._place: CarriagePosition | None = None
        self._pace = Pace(clock)

    def phase(self, index: int, count: int, title: str) -> None:
        """``[2/5] title``, ``[2] title`` where nobody knows of how many."""
        self._reported, self._place = 0.0, None
        self._pace.begin()
        self.say(f"[{_place_of(index, count)}] {tr(title)}")

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """A line at each quarter of a calculation."""
        if self._place is None and fraction >= self._reported + PLAIN_STEP:
            self._reported = fraction - fraction % PLAIN_STEP
            self.say(f"      {100.0 * fraction:.0f} %{self._pace.left(fraction, seconds_left)}")

    def moving(self, place: CarriagePosition) -> None:
        """A line at the first place that is told of each record: a log of a minute stays short."""
        if self._place is None or place.record != self._place.record:
            low, high = place.window_m
            ends = (millimetres(low, place), millimetres(high, place))
            window = tr(" (of {low} to {high})", low=ends[0], high=ends[1]) if math.isfinite(high - low) else ""
            left = ", ".join(part for part in (load_at(place) + window, machine_left(place)) if part)
            self.say(f"      {place.record}: {left}")
        self._place = place

    def say(self, *lines: str) -> None:
        """Each text on its own line."""
        echo(lines, self._stream)
        self._stream.flush()

    def detail(self, *lines: str) -> None:
        """A log has them; a terminal only where details were asked for."""
        if self._details or not self._stream.isatty():
            self.say(*lines)

    def found(self, name: str, value: str) -> None:
        """A line for each number, with its unit, that is found on the way."""
        self.say(f"      {name} {value}")

    def confirm(self, text: str) -> bool:
        """Ask and read a line from stdin.   Raises UsageError when stdin is closed."""
        return _ask(text, self._stream)

    def choose(self, question: str, choices: Mapping[str, str]) -> str:
        """Ask for one of the keys; the last one for an empty answer."""
        return _choose(question, choices, self._stream)

    def attended(self) -> bool:
        """True if stdin is a terminal."""
        return sys.stdin is not None and sys.stdin.isatty()

    def close(self, done: bool = False) -> None:
        """Nothing to put back."""


class RichTalk:
    """A live display below the text: phase n of m, the record with its seconds, where the carriage is in its window.

    Parameters
    ----------
    clock : callable
        Wall clock, s.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.monotonic, details: bool = False) -> None:
        self._stream, self._console, self._clock, self._details = stream, console_of(stream), clock, details
        self._found: dict[str, str] = {}
        self._live: Any = None
        self._shown: Any = None

    def phase(self, index: int, count: int, title: str) -> None:
        """The display of a job goes on with its next phase; another job begins one of its own."""
        from rich.live import Live

        from beltcomm.cli.display import Display

        title = tr(title)
        if self._live is not None and index > 1:
            self._shown.phase(_place_of(index, count), title)
            return
        self.close(done=True)
        self._shown = Display(_place_of(index, count), title, Pace(self._clock), self._clock, self._found)
        self._live = Live(self._shown, console=self._console, transient=True, refresh_per_second=8, redirect_stdout=False)
        self._live.start()

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Move the bar."""
        if self._live is not None:
            self._shown.progress(fraction, seconds_left)

    def moving(self, place: CarriagePosition) -> None:
        """Move the carriage in its window."""
        if self._live is not None:
            self._shown.moving(place)

    def say(self, *lines: str) -> None:
        """The text above the display."""
        draw(lines, self._console, self._stream)

    def detail(self, *lines: str) -> None:
        """Above the display where details were asked for."""
        if self._details:
            self.say(*lines)

    def found(self, name: str, value: str) -> None:
        """Kept in the display."""
        self._found[name] = value

    def confirm(self, text: str) -> bool:
        """Ask below everything.   Raises UsageError when stdin is closed."""
        self.close(done=True)
        return _ask(text, self._stream)

    def choose(self, question: str, choices: Mapping[str, str]) -> str:
        """Ask below everything for one of the keys; the last one for an empty answer."""
        self.close(done=True)
        return _choose(question, choices, self._stream)

    def attended(self) -> bool:
        """True if stdin is a terminal."""
        return sys.stdin is not None and sys.stdin.isatty()

    def close(self, done: bool = False) -> None:
        """End the display, whose phase came to its end or not, and give the terminal its cursor back.  Idempotent."""
        if self._live is not None:
            live, self._live = self._live, None
            live.stop()
            self.say(self._shown.ended(done))
            self._found.clear()


def _choose(question: str, choices: Mapping[str, str], stream: TextIO) -> str:
    """``[y] start  [q] quit   start? [y/Q]``: the first is a yes, the last is taken for an empty answer."""
    keys = "  ".join(f"[{tr('y') if key == 'y' else key}] {word}" for key, word in choices.items())
    first, last = next(iter(choices)), list(choices)[-1]
    while True:
        asked = f"{choices[first]}? [{tr('y')}/N]" if first == "y" else f"[{last.upper()}]"
        print(f"{fitted(f'  {keys}   {asked}', stream)} ", end="", file=stream, flush=True)
        answer = sys.stdin.readline() if sys.stdin is not None else ""
        if not answer:
            raise UsageError(f"nobody answers (stdin is closed); use --yes where no one is asked ({question})")
        word = answer.strip().lower()
        if not word:
            return last
        for key, meaning in choices.items():
            if word == key or meaning.lower().startswith(word) or (key == first and word in YES) or (key == last and word in NO):
                return key
        echo(
            ["  " + tr("{word} is none of {keys}", word=repr(word), keys=", ".join(tr("y") if key == "y" else key for key in choices))],
            stream,
        )


def _ask(text: str, stream: TextIO) -> bool:
    print(f"{fitted(text, stream)} [{tr('y')}/N] ", end="", file=stream, flush=True)
    answer = sys.stdin.readline() if sys.stdin is not None else ""  # it was closed before this program began
    if not answer:
        raise UsageError("nobody answers (stdin is closed); use --yes where no one is asked")
    return answer.strip().lower() in YES
