"""Talk on stderr: a progress line in a terminal, plain lines elsewhere.  ``NO_COLOR`` is honoured."""

from __future__ import annotations

import logging
import sys
from typing import Any, TextIO

from beltcomm.errors import UsageError

#: Plain lines report progress at these steps of the fraction, so that a log of a minute stays short.
PLAIN_STEP = 0.25


def terminal_talk(verbose: int = 0) -> PlainTalk | RichTalk:
    """The Talk for this process.   verbose : 1 shows what the library reports, 2 its details too."""
    if verbose:
        logging.basicConfig(stream=sys.stderr, format="%(name)s: %(message)s")
        logging.getLogger("beltcomm").setLevel(logging.DEBUG if verbose > 1 else logging.INFO)
    return RichTalk() if sys.stderr.isatty() else PlainTalk(sys.stderr)


class PlainTalk:
    """Lines without colour or movement, for logs and pipes."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._reported = 0.0

    def phase(self, index: int, count: int, title: str) -> None:
        """``[2/5] title``."""
        self._reported = 0.0
        self.say(f"[{index}/{count}] {title}")

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """A line at each quarter."""
        if fraction >= self._reported + PLAIN_STEP:
            self._reported = fraction - fraction % PLAIN_STEP
            self.say(f"      {100.0 * fraction:.0f} %{_left(seconds_left)}")

    def say(self, text: str) -> None:
        """The text on its own line."""
        print(text, file=self._stream, flush=True)

    def confirm(self, text: str) -> bool:
        """Ask and read a line from stdin.   Raises UsageError when stdin is closed."""
        return _ask(text, self._stream)

    def close(self) -> None:
        """Nothing to put back."""


class RichTalk:
    """A live progress line below the text."""

    def __init__(self) -> None:
        from rich.console import Console

        self._console = Console(stderr=True, highlight=False)
        self._live: Any = None
        self._task: Any = None

    def phase(self, index: int, count: int, title: str) -> None:
        """Begin a new line for the phase; the line of the one before stays as its record."""
        from rich.progress import BarColumn, Progress, TextColumn

        self.close()
        columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:>3.0f} %{task.fields[left]}"))
        self._live = Progress(*columns, console=self._console)
        self._task = self._live.add_task(f"[bold]{index}/{count}[/bold] {_escaped(title)}", total=1.0, left="")
        self._live.start()

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Move the bar; the phase ends at 1."""
        if self._live is None:
            return
        self._live.update(self._task, completed=fraction, left=_left(seconds_left))
        if fraction >= 1.0:
            self.close()

    def say(self, text: str) -> None:
        """The text above the progress line."""
        self._console.print(_escaped(text))

    def confirm(self, text: str) -> bool:
        """Ask below everything.   Raises UsageError when stdin is closed."""
        self.close()
        return _ask(text, sys.stderr)

    def close(self) -> None:
        """End the progress line and give the terminal its cursor back.   Idempotent."""
        if self._live is not None:
            self._live.stop()
            self._live = None


def _ask(text: str, stream: TextIO) -> bool:
    print(f"{text} [y/N] ", end="", file=stream, flush=True)
    answer = sys.stdin.readline()
    if not answer:
        raise UsageError("nobody answers (stdin is closed); use --yes where no one is asked")
    return answer.strip().lower() in {"y", "yes"}


def _left(seconds: float | None) -> str:
    return "" if seconds is None else f", {seconds:.0f} s left"


def _escaped(text: str) -> str:
    from rich.markup import escape

    return escape(text)
