"""Dates as numbers of days: what spreadsheets (Excel, 1900 and 1904 system), MATLAB and astronomers count in, and times of day alone.

They are told by content: numbers as large as dates of our time, whose steps would be fractions of a microsecond if they were seconds.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Column
from beltcomm.recording import LONGEST_STEP_S

DAY_S = 86_400.0
#: Shortest time between rows, s, and the longest of a time of day, beyond which hours would have such steps, too.
_SHORTEST_S, _LONGEST_OF_DAY_S = 2e-5, 0.017
#: Decimals that are looked for in a number of days; a double of a date of today has eleven, a time of day more.
_MOST_DECIMALS = 16
#: s, of which stamps may be whole multiples, and by how much finer the numbers must be to tell that.
_WHOLE_S, _FINER = (1e-3, 1e-4, 1e-5), 5.0
#: Share of a step by which the resolution disturbs it before it is told, and from which on stamps repeat.
_ROUGH = 1e-3
#: Share of the steps that go one way at least.
_RISING = 0.9
#: Share of the median step within which a step is as long as the others.
_EVEN = 0.5


class _Count(NamedTuple):
    """low, high : days that are dates of our time.   origin : day 0."""

    name: str
    low: float
    high: float
    origin: str


#: Excel's day 60 never was: from 1900-03-01 on its dates count from 1899-12-30.
_COUNTS = (
    _Count("a spreadsheet's days since 1900", 20_000.0, 80_000.0, "1899-12-30"),
    _Count("MATLAB's days", 700_000.0, 800_000.0, "-0001-12-31"),
    _Count("Julian dates", 2_415_000.0, 2_489_000.0, "-4713-11-24"),
)
_OF_DAY = _Count("times of day, as fractions of one", 0.0, 1.0, "")
_1904 = np.datetime64("1904-01-01")


def are_days(values: Column, *, named: bool = True) -> bool:
    """True for stamps that count days.

    Parameters
    ----------
    values : Column (n,)
        As the file holds them.
    named : bool
        The column is called time. Of another one a time of day alone is none, for other things lie between 0 and 1, too, and steps that
        are not even are none, for what else lies around 45 000 moves.
    """
    count = _count_of(values)
    if count is None or named:
        return count is not None
    steps = np.abs(np.diff(values[np.isfinite(values)]))
    return count is not _OF_DAY and float(np.mean(np.abs(steps - np.median(steps)) <= _EVEN * np.median(steps))) >= _RISING


def _count_of(values: Column) -> _Count | None:
    """How stamps count days; None where they do not."""
    known = values[np.isfinite(values)] if values.dtype.kind == "f" else values[:0]
    if len(known) < 3:
        return None
    low, high = float(known.min()), float(known.max())
    step_s = DAY_S * (high - low) / (len(known) - 1)
    if not _SHORTEST_S <= step_s <= LONGEST_STEP_S:
        return None
    steps = np.diff(known)
    one_way = max(float(np.mean(steps >= 0.0)), float(np.mean(steps <= 0.0)))  # the newest row may stand first
    if one_way < _RISING:
        return None
    if low >= 0.0 and high < 1.0:
        return _OF_DAY if step_s <= _LONGEST_OF_DAY_S else None
    return next((count for count in _COUNTS if count.low <= low and high <= count.high), None)


def seconds_of_days(name: str, values: Column) -> tuple[Column, tuple[str, ...]]:
    """Seconds since the first row of stamps in days, and sentences: how they were read, and how exact they are.

    A double has a date of today to 0.6 µs; a file with fewer decimals is coarser.  Stamps of whole milliseconds, tenths or hundredths of
    them are those again where the resolution tells.

    Parameters
    ----------
    name : str
        Of the column, for the sentence.
    values : Column (n,), days
        For which :func:`are_days` holds.
    """
    count = _count_of(values)
    assert count is not None
    known = values[np.isfinite(values)]
    first = float(known[0])
    resolution_s = DAY_S * _resolution(known)
    seconds, whole_s = DAY_S * (values - first), 0.0
    # to the day alone: the product with 86400 would round once more
    of_day_s = DAY_S * (values - math.floor(first))
    for grid_s in _WHOLE_S:
        if resolution_s * _FINER > grid_s:
            break
        ticks = np.round(of_day_s / grid_s)
        if float(np.nanmax(np.abs(of_day_s - grid_s * ticks))) <= 0.5 * resolution_s + DAY_S * float(np.spacing(first)):
            seconds, whole_s = grid_s * (ticks - ticks[np.flatnonzero(np.isfinite(values))[0]]), grid_s
            break
    rows = float(np.max(known) - np.min(known)) * DAY_S / (len(known) - 1)
    said = [f"{name} holds {count.name}{_began(count, first)}"]
    if whole_s:
        said[0] += f"; in whole {f'{1e3 * whole_s:g} ms' if whole_s < 1e-3 else 'milliseconds'}, which the stamps are then"
    elif resolution_s > _ROUGH * rows:
        said.append(
            f"the stamps are exact to {1e3 * resolution_s:.3g} ms ({100.0 * resolution_s / rows:.2g} % of a step), as many decimals as the "
            f"file has of a day: write them with eleven, or, if the sampling was even, import with --rate {1.0 / rows:.6g}Hz instead"
        )
    return seconds, tuple(said)


def _resolution(known: Column) -> float:
    """Of numbers of days as a file has them, days: its last decimal, or that of a double."""
    finest = float(np.spacing(np.abs(known).max()))
    for decimals in range(_MOST_DECIMALS + 1):
        if 10.0**-decimals < 4.0 * finest:  # any number is that near to one of so many decimals
            break
        if np.all(np.abs(known - np.round(known, decimals)) <= finest):
            return 10.0**-decimals
    return finest


def _began(count: _Count, first: float) -> str:
    """When the first row was, in words."""
    if not count.origin:
        return ""
    if count.name.startswith("Julian"):
        first += 0.5  # they begin at noon
    days, share = divmod(first, 1.0)
    origin = np.datetime64(count.origin)
    at = origin + np.timedelta64(int(days), "D")
    second = min(int(share * DAY_S + 0.5), 86_399)
    time = f"{second // 3600:02}:{second // 60 % 60:02}:{second % 60:02}"
    other = f" (in the 1904 system {_1904 + np.timedelta64(int(days), 'D')})" if count is _COUNTS[0] else ""
    return f", beginning {at} {time}{other}; only their differences count"
