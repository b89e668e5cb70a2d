"""Time stamps as loggers write them: dates, stamps that repeat or go back; a sentence for each fault."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Column, IntArray
from beltcomm.errors import DataError
from beltcomm.recording import LONGEST_STEP_S

#: A date in any order, a time of day; either alone.
_STAMP = re.compile(
    r"(?:(\d{1,4})[-./](\d{1,2})[-./](\d{1,4})\.?)?[T ,]*"
    r"(?:(\d{1,2}):(\d{1,2})(?::(\d{1,2})(?:[.,:](\d{1,12})\d*)?)?)?\s*([AaPp]\.?[Mm]\.?)?\s*(?:Z|UTC|GMT|[+-]\d\d:?\d\d)?"
)
_DAY_NS = 86_400 * 10**9
#: Orders of day, month and year, the usual ones first.
_ORDERS = {"year-month-day": (0, 1, 2), "day.month.year": (2, 1, 0), "month/day/year": (2, 0, 1)}
#: Share of a step by which the rounding of single-precision stamps disturbs it before it is told.
_ROUGH = 1e-3
#: Steps of stamps in order beyond which one is a gap, and way back below which rows have changed places.
_EVEN, _NEAR = 1.5, 100.0
#: Bits of counters of time.
_BITS = (16, 24, 32)
#: Ticks of a counter in the unit that a file writes: a counter of microseconds, written in ms or s.
_TICKS = (1e-3, 1e-6, 1e-9)


def seconds_of(file: str, name: str, stamps: Column) -> tuple[Column, tuple[str, ...]]:
    """Seconds since the first row of stamps in words, and sentences on what was taken for granted.

    Such as ``2024-05-03 14:02:11.204``, ``03.05.2024 14:02:11,204``, ``5/3/2024 2:02:11.204 PM`` or ``14:02:11.204``.

    Parameters
    ----------
    file, name : str
        Of file and column, for the sentence.
    stamps : Column (n,)
        Text.

    Raises
    ------
    DataError
        For text that is none.
    """
    found = [_STAMP.fullmatch(str(stamp).strip().strip("'\"()")) for stamp in stamps]
    bad = next((k for k, match in enumerate(found) if match is None or match[4] is None), None)
    if bad is not None:
        raise DataError(
            f"{file}: {name} holds text such as {str(stamps[bad])[:30]!r}, no time that is understood (row {bad + 1}); give --rate instead"
        )
    parts = [match.groups() for match in found if match is not None]
    try:
        days, notes = _days(parts)
        day_ns = np.array([_of_day(part) for part in parts], dtype=np.int64)
    except ValueError as error:
        raise DataError(f"{file}: {name} holds {str(stamps[0])[:30]!r}, {error}; give --rate instead") from error
    if days is None:
        midnights = np.cumsum(np.concatenate(([0], np.diff(day_ns) < -_DAY_NS // 2)))
        if midnights[-1]:
            notes = (*notes, f"{name} passes midnight {midnights[-1]} times: a day was added there")
        days = midnights
    since = (np.asarray(days, dtype=np.int64) - int(days[0])) * _DAY_NS + (day_ns - day_ns[0])
    seconds: Column = since * 1e-9
    return seconds, notes


def _of_day(part: Sequence[str | None]) -> int:
    """ns since midnight."""
    hour, minute, second, fraction, half = int(part[3] or 0), int(part[4] or 0), int(part[5] or 0), part[6] or "", part[7]
    if half:
        if not 1 <= hour <= 12:
            raise ValueError(f"which has the hour {hour} with AM or PM")
        hour = hour % 12 + (12 if half[0] in "pP" else 0)
    if hour > 24 or minute > 59 or second > 60:
        raise ValueError("which is no time of day")
    return (hour * 3600 + minute * 60 + second) * 10**9 + int(fraction[:9].ljust(9, "0"))


def _days(parts: Sequence[Sequence[str | None]]) -> tuple[IntArray | None, tuple[str, ...]]:
    """Numbers of the days, None for times of day alone, and a sentence where the order of day and month had to be chosen."""
    texts = [part[:3] for part in parts]
    if any(text[0] is None for text in texts):
        if any(text[0] is not None for text in texts):
            raise ValueError("with a date in some rows and none in others")
        return None, ()
    possible: dict[str, list[int]] = {}
    for order, places in _ORDERS.items():
        try:
            possible[order] = [_day(text, places) for text in texts]
        except ValueError:
            continue
    if not possible:
        raise ValueError("which is no date")
    spans = {order: days[-1] - days[0] for order, days in possible.items()}
    forward = [order for order in possible if spans[order] >= 0] or list(possible)
    chosen = min(forward, key=lambda order: abs(spans[order]))
    differing = [order for order in forward if spans[order] != spans[chosen]]
    notes = (f"the dates are read as {chosen}; read as {differing[0]} they span {spans[differing[0]]} days",) if differing else ()
    return np.array(possible[chosen], dtype=np.int64), notes


@lru_cache(maxsize=64)
def _day(text: tuple[str, str, str], places: tuple[int, int, int]) -> int:
    year, month, day = (text[place] for place in places)
    if len(year) not in (2, 4):
        raise ValueError("which is no date")
    return int(np.datetime64(f"{int(year) + (2000 if len(year) == 2 else 0):04}-{int(month):02}-{int(day):02}", "D").astype(np.int64))


def rough_stamps(t_s: Column) -> str:
    """A sentence on stamps that were kept as single-precision numbers, when that is coarse beside their steps; "" else.

    Parameters
    ----------
    t_s : Column (n,), s
        As they were read.
    """
    if len(t_s) < 3 or not np.array_equal(t_s, t_s.astype(np.float32).astype(np.float64)):
        return ""
    resolution, step = float(np.spacing(np.float32(np.abs(t_s).max()))), float(np.median(np.diff(t_s)))
    if not step > 0.0 or resolution < _ROUGH * step or np.array_equal(t_s, np.round(t_s)):
        return ""
    rate, share = (len(t_s) - 1) / float(t_s[-1] - t_s[0]), 100.0 * resolution / step
    return (
        f"the stamps are single-precision numbers, at {np.abs(t_s).max():.6g} s exact to {1e3 * resolution:.3g} ms ({share:.2g} % of "
        f"a step): if the sampling was even, import with --rate {rate:.6g}Hz instead of the stamps"
    )


def joined_counter(values: Column) -> tuple[Column, str]:
    """Stamps with a counter that began anew joined, and a sentence on it; as they are, and "", where there is none.

    Parameters
    ----------
    values : Column (n,)
        Stamps in ticks, or in units of which a tick is a thousandth, a millionth or a thousand-millionth.
    """
    usable = len(values) > 2 and values.dtype.kind in "fiu" and np.isfinite(values).all() and values.min() >= 0.0
    steps = np.diff(values.astype(np.float64)) if usable else np.zeros(0)
    back = np.flatnonzero(steps < 0.0)
    step = float(np.median(steps)) if len(steps) else 0.0
    if not len(back) or not step > 0.0:
        return values, ""
    whole = np.array_equal(values, np.round(values))
    for bits, tick in [(bits, 1.0) for bits in _BITS if whole] + [(32, tick) for tick in _TICKS]:
        span = tick * 2.0**bits
        over = steps[back] + span
        # of ticks that are none of the file's the seam must be as even as the rest: a clock that was set goes back by any time
        near = np.all((over > 0.0) & (over < _NEAR * step)) if tick == 1.0 else np.all(np.abs(over / step - 1.0) < 0.5)
        if near and values.max() < span:
            joined = values + span * np.concatenate(([0.0], np.cumsum(steps < 0.0)))
            ticks = "" if tick == 1.0 else f" that count {tick:g} of the file's unit"
            return joined, f"its time is a counter of {bits} bits{ticks} that began anew {len(back)} times: joined"
    return values, ""


def checked_time(file: str, t_s: Column, rows: NDArray[np.intp]) -> None:
    """Check that time rises, in seconds.

    Parameters
    ----------
    file : str
        Name, for the sentence.
    t_s : Column (n,), s
        As it was read.
    rows : ndarray
        Numbers from 0.

    Raises
    ------
    DataError
        When it stands still or goes back, or is in another unit.
    """
    if len(t_s) < 2:
        return
    steps = np.diff(t_s)
    back = np.flatnonzero(steps < 0.0)
    if len(back):
        at = int(back[0])
        ordered = np.diff(np.sort(t_s))
        if np.all(ordered > 0.0) and ordered.max() < _EVEN * np.median(ordered) and -steps.min() < _NEAR * np.median(ordered):
            raise DataError(
                f"{file}: {len(back)} rows stand out of their order, the first is row {rows[at + 1] + 1}, {-steps[at]:.6g} s early; "
                "sort the file by its time"
            )
        many = f" and {len(back) - 1} times more" if len(back) > 1 else ""
        raise DataError(
            f"{file}: time goes back by {-steps[at]:.6g} s in row {rows[at + 1] + 1}{many}; another record begins there: "
            f"take one part, --rows :{rows[at] + 1} or --rows {rows[at + 1] + 1}:, or do without the stamps with --rate"
        )
    still = np.flatnonzero(steps == 0.0)
    if len(still) == len(steps):
        raise DataError(f"{file}: the time is {t_s[0]:g} s in every row; map another column, or give --rate")
    if len(still):
        changes = np.flatnonzero(steps > 0.0) + 1  # rows before the first and behind the last one fill no whole step of the clock
        ends = changes[[0, -1]] if len(changes) > 1 else np.array([0, len(t_s) - 1])
        rate = float(np.diff(ends)[0] / np.diff(t_s[ends])[0])
        resolution = float(steps[steps > 0.0].min())
        why = (
            f"the stamps have a resolution of {resolution:.4g} s, coarser than the sampling: if it was even, give --rate {rate:.6g}Hz "
            "instead of the stamps"
            if len(still) > 0.05 * len(steps)
            else "other values go on there, so the clock stood: if the sampling was even, give "
            f"--rate {1.0 / float(np.median(steps)):.6g}Hz instead of the stamps, else leave one of each out"
        )
        raise DataError(f"{file}: {len(still)} time stamps repeat, the first in row {rows[int(still[0]) + 1] + 1}; {why}")
    median = float(np.median(steps))
    if median > LONGEST_STEP_S:
        unit = "us" if median > 50.0 else "ms"
        raise DataError(
            f"{file}: time rises by {median:.4g} s per row, which is no sampling of a drive; "
            f"if it is in {unit} write --map t_s=NAME*{unit}, if it counts the rows give --rate"
        )
