"""The live display of a phase: what is done, the seconds left, and the carriage inside the way it may use."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.progress_bar import ProgressBar
from rich.spinner import Spinner
from rich.table import Table
from rich.text import Text

from beltcomm.cli.pace import Pace, machine_left, millimetres
from beltcomm.talk import CarriagePosition

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType

#: Columns that a bar has at least and at most, and that stand before it.
SHORTEST, LONGEST, INDENT = 8, 60, "    "


class Display:
    """One phase.   number : ``2/5``.   place : of the carriage, None while nothing moves.   clock : s, of the wall."""

    def __init__(self, number: str, title: str, pace: Pace, clock: Callable[[], float]) -> None:
        self.number, self.title = number, title
        self.place: CarriagePosition | None = None
        self._pace, self._clock, self._begun_s = pace, clock, clock()
        self._fraction: float | None = None
        self._left = ""
        self._spinner = Spinner("dots")
        self._plain_spinner = Spinner("line")

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Of the record that is made, or of the calculation; only a record has seconds that are known."""
        if seconds_left is None:
            self.place = None
        self._fraction, self._left = fraction, self._pace.left(fraction, seconds_left)

    def ended(self, done: bool) -> str:
        """What stays of it: a line."""
        if done:
            passed = self._clock() - self._begun_s
            return f"{self.number} {self.title}: done" + (f" in {passed:.0f} s" if passed >= 1.0 else "")
        return f"{self.number} {self.title}: not finished"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Title with the seconds of the whole job, bar of the record or calculation, carriage in its window."""
        title = Text.assemble((f"{self.number} ", "bold"), self.title)
        if self.place is not None and (left := machine_left(self.place)):
            title.append(f" · {left}" if not options.ascii_only else f", {left}")
        line = Table.grid(padding=(0, 1))
        line.add_row(self._plain_spinner if options.ascii_only else self._spinner, title)
        yield line
        if self._fraction is not None:
            yield self._bar(self._fraction, options.max_width)
        if self.place is not None:
            yield window_line(self.place, options.max_width, options.ascii_only)

    def _bar(self, fraction: float, width: int) -> RenderableType:
        name = f"{self.place.record} " if self.place is not None else ""
        after = f"{100.0 * fraction:3.0f} %{self._left}"
        length = min(LONGEST, max(SHORTEST, width - len(INDENT) - len(name) - len(after) - 4))
        line = Table.grid(padding=(0, 1))
        line.add_row(f"{INDENT[:-1]}", *([name.strip()] if name else []), ProgressBar(1.0, min(1.0, fraction), width=length), after)
        return line


def window_line(place: CarriagePosition, width: int, ascii_only: bool = False) -> Text:
    """``0 mm [····|······] 570 mm, carriage at 124 mm``, no wider than the terminal; without a bar where the window is not known."""
    here = f"carriage at {millimetres(place.position_m, place)}"
    low, high = place.window_m
    if not math.isfinite(high - low) or high <= low:
        return Text(INDENT + here)
    before, after = f"{INDENT}{millimetres(low, place)} [", f"] {millimetres(high, place)}"
    gap, left = "  ", width - len(before) - len(after)
    if left - len(here) - len(gap) < SHORTEST:
        gap = "\n" + INDENT
    length = min(LONGEST, max(SHORTEST, left if "\n" in gap else left - len(here) - len(gap)))
    at = round((length - 1) * min(1.0, max(0.0, (place.position_m - low) / (high - low))))
    dot = "-" if ascii_only else "·"
    mark, remark = (("|", "bold"), "") if low <= place.position_m <= high else (("|", "bold red"), " (outside)")
    return Text.assemble(before, dot * at, mark, dot * (length - 1 - at), after, gap, here, remark)
