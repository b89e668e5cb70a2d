"""The live display: phase and record, what is done, the carriage in its window, the load against its limits, what was found on the way,
seconds left and places in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from textwrap import fill
from typing import TYPE_CHECKING

from rich.text import Text

from beltcomm.language import tr
from beltcomm.quantities import three_digits
from beltcomm.talk import CarriagePosition, Gauge

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType

#: s and share of a calculation after which its pace tells how long it will still take.
PACE_S, PACE_SHARE = 1.0, 0.05

#: What a place says of a load that is no carriage.
_AT = {"load": "load at", "table": "table at"}


class Pace:
    """Seconds left in a phase: on the machine they are known, in a calculation its pace so far tells them.

    Parameters
    ----------
    clock : callable
        Wall clock, s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self.begin()

    def begin(self) -> None:
        """A phase begins now."""
        self._begun_s = self._clock()

    def left(self, fraction: float, seconds_left: float | None) -> str:
        """In words; nothing while it cannot be told.

        Parameters
        ----------
        fraction : float, 0 to 1
        seconds_left : float or None
            On the machine; None for a calculation, whose pace is measured.
        """
        if seconds_left is not None:
            return tr(", {s:.0f} s left", s=seconds_left) if seconds_left >= 1.0 else ""
        passed_s = self._clock() - self._begun_s
        if not PACE_SHARE <= fraction < 1.0 or passed_s < PACE_S:
            return ""
        return tr(", about {s:.0f} s left", s=passed_s * (1.0 - fraction) / fraction)


def machine_left(place: CarriagePosition) -> str:
    """Time that the whole job still takes on the machine; nothing where it is not known.

    Parameters
    ----------
    place : CarriagePosition
    """
    return "" if place.left_s is None else tr("{s:.0f} s left on the machine", s=place.left_s)


def _clock_words(seconds: float) -> str:
    """A time as ``00:41``, minutes and seconds."""
    return f"{int(seconds) // 60:02d}:{int(seconds) % 60:02d}"


def millimetres(position_m: float, place: CarriagePosition) -> str:
    """A position on the axis, or from where the carriage stood, then with its sign.

    Parameters
    ----------
    position_m : float, m
        Carriage on the axis.
    place : CarriagePosition
    """
    value = round(1e3 * position_m)
    unit = place.unit if place.unit == "°" else f" {place.unit}"
    return f"{value:d}{unit}" if place.known else f"{value:+d}{unit}"


def load_at(place: CarriagePosition) -> str:
    """``carriage at 250 mm``, and what else moves.

    Parameters
    ----------
    place : CarriagePosition
    """
    return f"{tr(_AT.get(place.load, 'carriage at'))} {millimetres(place.position_m, place)}"


#: Columns that a bar has at least and at most, and that stand before it.
SHORTEST, LONGEST, INDENT = 8, 60, "   "

#: s without a word from the job, after which it computes.
SILENT_S = 1.5

#: Share of a limit from which a bar is marked.
NEAR = 0.9


class Display:
    """One job.

    Parameters
    ----------
    number : str
        Of its phase, ``2/5``. place : of the carriage, None while nothing moves.
    clock : callable
        Wall clock, s.
    """

    def __init__(self, number: str, title: str, pace: Pace, clock: Callable[[], float], found: Mapping[str, str] | None = None) -> None:
        self.place: CarriagePosition | None = None
        self._fraction: float | None = None
        self._peaks: dict[str, float] = {}
        self._pace, self._clock, self._begun_s = pace, clock, clock()
        self._most_left_s = 0.0
        self._found: Mapping[str, str] = {} if found is None else found
        self.phase(number, title)

    def phase(self, number: str, title: str) -> None:
        """The next phase of the same job.

        Parameters
        ----------
        number : str
            ``2/5``, or ``2`` where nobody knows of how many.
        title : str
        """
        self.number, self.title = number, title
        self.place, self._fraction, self._left = None, None, ""
        self._told_s = self._clock()
        self._pace.begin()

    def moving(self, place: CarriagePosition) -> None:
        """Show the carriage's place; the largest load of a record stays in sight."""
        if self.place is None or self.place.record != place.record:
            self._peaks.clear()
        for gauge in place.gauges:
            self._peaks[gauge.name] = max(self._peaks.get(gauge.name, 0.0), abs(gauge.value))
        self.place, self._told_s = place, self._clock()
        self._most_left_s = max(self._most_left_s, place.left_s or 0.0)

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Of the record that is made, or of the calculation; only a record has seconds that are known.

        Parameters
        ----------
        fraction : float, 0 to 1
        seconds_left : float or None
            None for a calculation.
        """
        self._told_s = self._clock()
        if seconds_left is None:
            self.place = None
        self._fraction = fraction
        self._left = self._pace.left(fraction, seconds_left)

    def ended(self, done: bool) -> str:
        """Leave one line of it, and return it; not ``done`` where it was broken off."""
        if not done:
            return f"{self.number} {self.title}: {tr('not finished')}"
        if found := self._found_words():
            return f"  {tr('found')}: {found}"
        passed = self._clock() - self._begun_s
        return f"{self.number} {self.title}: {tr('done')}" + (f" {tr('in')} {passed:.0f} s" if passed >= 1.0 else "")

    def _found_words(self) -> str:
        return ", ".join(f"{tr(name)} {value}" for name, value in self._found.items())

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Phase and clock, what is done, the carriage, the load, what was found, and how to stop it: at most eight lines."""
        width, silent_s = options.max_width, self._clock() - self._told_s
        if silent_s > SILENT_S:
            self.place = self._fraction = None  # the record is made: what it is computed from stands still
        moves = self.place is not None
        record = self.place.record if self.place is not None else ""
        title = Text.assemble((f" {self.number} ", "bold"), (self.title, "bold"), f"   {record}" if record else "")
        passed = _clock_words(self._clock() - self._begun_s)
        if len(title) + len(passed) + 2 <= width:
            title.append(" " * (width - len(title) - len(passed) - 1) + passed)
        title.truncate(width)
        yield title
        if self._fraction is not None:
            yield from self._done(width)
        elif silent_s > SILENT_S:
            yield Text(f"{INDENT}{tr('computing')}{'.' * (1 + int(silent_s) % 3)}", "dim")
        if self.place is not None:
            yield _window_line(self.place, width, options.ascii_only)
            for gauge in self.place.gauges:
                yield _gauge_line(gauge, width, self._peaks.get(gauge.name, 0.0))
        if self._found:
            told = f"{tr('found')}: {self._found_words()}"
            yield Text(fill(told, width, initial_indent=INDENT, subsequent_indent=INDENT + "  "))
        if moves:
            yield Text(f"{INDENT}{tr('Ctrl-C stops the axis and restores the drive')}", "dim")

    def _done(self, width: int) -> Iterator[Text]:
        """Of the whole job on the machine where its seconds are known, else of the calculation."""
        share, after = self._fraction or 0.0, f"{100.0 * (self._fraction or 0.0):.0f} %{self._left}"
        if self.place is not None and self.place.left_s is not None and self._most_left_s > 0.0:
            share, after = 1.0 - self.place.left_s / self._most_left_s, f"{machine_left(self.place)}   {tr('record')} {after}"
        length = min(40, width - len(after) - len(INDENT) - 2)
        if length < SHORTEST:
            yield Text(INDENT + after)
            return
        full = round(length * min(1.0, max(0.0, share)))
        yield Text.assemble(INDENT, ("#" * full, "green"), ("-" * (length - full), "dim"), "  ", after)


def _gauge_line(gauge: Gauge, width: int, peak: float) -> Text:
    """``torque   [####..|...]  0.23 of 3.1 N m, peak 0.3``: its bar is as full as the limit is reached."""
    before = f"{INDENT}{tr(gauge.name):<8} ["
    after = f"]  {_digits(gauge, gauge.value)} {tr('of')} {three_digits(gauge.limit)} {gauge.unit}"
    most = f"{after}, {tr('peak')} {_digits(gauge, peak)}"
    length = min(LONGEST - 26, width - len(before) - len(most))
    if length < SHORTEST:
        most, length = after, width - len(before) - len(after)
    if length < SHORTEST:
        return Text(f"{before[:-1]}{after[1:].strip()}")
    full = min(length, round(length * gauge.share))
    mark = min(length - 1, round(length * peak / gauge.limit)) if peak > 0.0 else -1
    cells = "".join("|" if k == mark and k >= full else "#" if k < full else "." for k in range(length))
    style = "bold yellow" if gauge.share >= NEAR else "green"
    return Text.assemble(before, (cells[:full], style), cells[full:], most)


def _digits(gauge: Gauge, value: float) -> str:
    return f"{abs(value):.0f}" if gauge.limit >= 10.0 else f"{abs(value):.2f}"


def _window_line(place: CarriagePosition, width: int, ascii_only: bool = False) -> Text:
    """``0 mm [····|······] 570 mm, carriage at 124 mm``, no wider than the terminal; without a bar where the window is not known."""
    here = load_at(place)
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
