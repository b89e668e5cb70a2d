"""Columns of one text table that have time stamps of their own: pairs of time and value, several sample times, signals with gaps by intent.

A table with one time for all its columns stays as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltcomm.arrays import BoolArray, Column
from beltcomm.foreign.heading import Heading
from beltcomm.foreign.names import meaning_of
from beltcomm.foreign.table import Table

#: Share of missing values from which a column may be a slower signal, and how evenly its values must lie, in their usual distance.
_SPARSE, _UNEVEN = 0.1, 2.5
_FEWEST = 10
#: Share of the steps of a time that go on.
_RISING = 0.98
#: Units in which a logger counts its time, s.
_TICKS = (1.0, 1e-3, 1e-6, 1e-7, 1e-9)


def with_own_clocks(table: Table, heading: Heading) -> Table:
    """The table, each column with the time that belongs to it, where that is not one for all.

    Parameters
    ----------
    table : Table
    heading : Heading
        Names and units of the columns.
    """
    return _without_doubles(_with_clocks(table, heading))


def _without_doubles(table: Table) -> Table:
    """Without values that repeat the ones before, time included: the logger wrote them twice."""
    columns, notes = dict(table.columns), []
    for clock in dict.fromkeys(table.clocks.values()):
        stamps = table.columns[clock]
        own = [name for name, other in table.clocks.items() if other == clock and len(table.columns[name]) == len(stamps)]
        same = np.diff(stamps) == 0.0
        for name in own if same.any() else ():
            column = table.columns[name]
            same &= (column[1:] == column[:-1]) | (np.isnan(column[1:]) & np.isnan(column[:-1]))
        if same.any():
            keep = np.append(True, ~same)
            columns |= {name: table.columns[name][keep] for name in (clock, *own)}
            first = int(np.argmax(same)) + 2
            notes.append(f"{int(same.sum())} values of {clock!r} that repeat the ones before left out, the first is number {first}")
    return replace(table, columns=columns, notes=(*table.notes, *notes)) if notes else table


def _with_clocks(table: Table, heading: Heading) -> Table:
    places = _clock_places(table, heading)
    if len(places) > 1 or (places and heading.clocks):
        return _pairs(table, heading, places)
    if any(heading.periods):
        return _by_period(table, heading)
    return _sparse(table)


def _clock_places(table: Table, heading: Heading) -> list[int]:
    """Places of the columns that are the time of those behind them: marked in a block, or of one name that stands again and again."""
    names = list(table.columns)
    rising = [_rises(column) for column in table.columns.values()]
    if heading.clocks:
        return [k for k in heading.clocks if k < len(names) and rising[k]]
    first = names[0] if names else ""
    again = [0, *(k for k, name in enumerate(names) if k and name.rpartition("_")[0] == first and name.rpartition("_")[2].isdigit())]
    if len(again) < 2 or not all(rising[k] for k in again) or 1 in again:
        return []
    if (meaning := meaning_of(table, first)) is not None and meaning.quantity not in {"time", "position"}:
        return []
    return again


def _pairs(table: Table, heading: Heading, places: Sequence[int]) -> Table:
    names = list(table.columns)
    columns: dict[str, Column] = {}
    clocks: dict[str, str] = {}
    units = dict(table.units)
    clock, stamps = "", np.zeros(0)
    for k, name in enumerate(names):
        column = table.columns[name]
        if k in places:
            period = heading.periods[k + 1] if k + 1 < len(heading.periods) else 0.0
            clock = "time" if len(places) == 1 else f"time {places.index(k) + 1}"
            stamps, unit = _in_seconds(column[np.isfinite(column)], period)
            columns[clock] = stamps
            units.pop(name, None)
            if unit or table.unit(name):
                units[clock] = unit or table.unit(name)
        elif column.dtype.kind == "f" and clock and np.isfinite(column[len(stamps) :]).any():
            columns[name] = column  # longer than its time: what that means a person must say
        elif column.dtype.kind == "f" and clock:
            columns[name], clocks[name] = column[: len(stamps)], clock
        else:
            columns[name] = column
    kept = {name: unit for name, unit in units.items() if name in columns}
    return Table(table.file, columns, kept, (*table.notes, f"{len(places)} time columns, each for those behind it"), clocks)


def _in_seconds(stamps: Column, period_s: float) -> tuple[Column, str]:
    """Stamps in seconds since the first where a known sample time tells their unit, as they are else; and "s" or ""."""
    step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 0.0
    if period_s <= 0.0 or step <= 0.0:
        return stamps, ""
    tick = next((tick for tick in _TICKS if abs(step * tick / period_s - 1.0) < 0.01), None)
    return (stamps, "") if tick is None else ((stamps - stamps[0]) * tick, "s")


def _by_period(table: Table, heading: Heading) -> Table:
    """Stated sample times: they tell the unit of a time column, or stand for one."""
    names = list(table.columns)
    periods = dict(zip(names, heading.periods, strict=False))
    starts = dict(zip(names, heading.starts or [0.0] * len(names), strict=False))
    stated = {period for period in periods.values() if period > 0.0}
    one = stated.pop() if len(stated) == 1 else 0.0
    time = next((name for name in names if one and _is_time(table, name, one)), None)
    if time is not None:
        return _timed_by(table, time, one)
    columns: dict[str, Column] = {}
    clocks: dict[str, str] = {}
    made: dict[tuple[float, float, int], str] = {}
    for name in names:
        column = table.columns[name]
        if column.dtype.kind != "f" or not np.isfinite(column).any():
            continue
        period, length = periods.get(name, 0.0), int(np.flatnonzero(np.isfinite(column))[-1]) + 1
        if period <= 0.0:
            columns[name] = column
            continue
        key = (period, starts.get(name, 0.0), length)
        if key not in made:
            made[key] = f"time at {1.0 / period:.6g} Hz" + (f" ({len(made) + 1})" if any(k[0] == period for k in made) else "")
            columns[made[key]] = key[1] + period * np.arange(length)
        columns[name], clocks[name] = column[:length], made[key]
    if not clocks:
        return _sparse(table)
    units = {name: unit for name, unit in table.units.items() if name in columns} | dict.fromkeys(made.values(), "s")
    told = ", ".join(f"{1e3 * period:.6g} ms" for period, *_ in made)
    return Table(table.file, columns, units, (*table.notes, f"the time is that of the file's sample time, {told}"), clocks)


def _timed_by(table: Table, time: str, period_s: float) -> Table:
    """The table with a column that steps by the stated sample time as the time of all."""
    if _is_named_time(table, time) and table.unit(time):
        return _sparse(table)
    seconds, _ = _in_seconds(table.columns[time], period_s)
    clock = time if _is_named_time(table, time) else "time"
    columns = {clock if name == time else name: seconds if name == time else column for name, column in table.columns.items()}
    units = {name: unit for name, unit in table.units.items() if name != time} | {clock: "s"}
    made = _sparse(replace(table, columns=columns, units=units))
    same = {name: clock for name, column in columns.items() if name != clock and len(column) == len(seconds) and column.dtype.kind == "f"}
    return made if made.clocks else replace(made, clocks=same)


def _is_time(table: Table, name: str, period_s: float) -> bool:
    """True if a column is the time in steps of a stated period, in whatever unit; a count of the rows is none."""
    column = table.columns[name]
    if not _rises(column):
        return False
    finite = column[np.isfinite(column)]
    steps = np.diff(finite)
    usual = float(np.median(steps))
    even = bool(np.mean(np.abs(steps / usual - 1.0) < 0.2) > 0.9)
    fits = any(abs(usual * tick / period_s - 1.0) < 0.01 for tick in _TICKS)
    named = (meaning := meaning_of(table, name)) is not None and meaning.quantity == "time"
    return even and fits and (named or next(iter(table.columns)) == name)


def _sparse(table: Table) -> Table:
    """Signals that have a value in every tenth row, say, get the time of those rows."""
    time = next((name for name, column in table.columns.items() if _is_named_time(table, name) and _rises(column)), None)
    if time is None or table.clocks:
        return table
    stamps = table.columns[time]
    columns: dict[str, Column] = dict(table.columns)
    clocks: dict[str, str] = {}
    made: dict[bytes, str] = {}
    notes = []
    for name, column in table.columns.items():
        if column.dtype.kind != "f" or name == time:
            continue
        there = np.isfinite(column) & np.isfinite(stamps)
        if not _by_intent(there):
            continue
        key = np.packbits(there).tobytes()
        if key not in made:
            made[key] = f"time {len(made) + 2}"
            columns[made[key]] = stamps[there]
            notes.append(f"{name} has a value in {int(there.sum())} of {len(there)} rows: a signal with a raster of its own")
        columns[name], clocks[name] = column[there], made[key]
    if not clocks:
        return table
    unit = meaning.unit if (meaning := meaning_of(table, time)) is not None and meaning.suffix == "s" else "s" if time == "t_s" else ""
    units = dict(table.units) | ({clock: unit for clock in made.values()} if unit else {})
    clocks |= {name: time for name, column in columns.items() if len(column) == len(stamps) and name not in clocks and name != time}
    return Table(table.file, columns, units, (*table.notes, *notes), clocks)


def _by_intent(there: BoolArray) -> bool:
    """True if values are missing as a slower raster leaves them out: evenly, or all behind the end of a shorter record."""
    count = int(there.sum())
    if count < _FEWEST or count > (1.0 - _SPARSE) * len(there):
        return False
    distances = np.diff(np.flatnonzero(there))
    usual = float(np.median(distances))
    return bool(distances.max() <= _UNEVEN * usual) if usual > 1.0 else bool(distances.max() == 1)


def _is_named_time(table: Table, name: str) -> bool:
    meaning = meaning_of(table, name)
    return name == "t_s" or (meaning is not None and meaning.quantity == "time")


def _rises(column: Column) -> bool:
    """True if a column rises but for few rows: whether those changed places or another record begins there, says who takes it for time."""
    if column.dtype.kind != "f":
        return False
    finite = column[np.isfinite(column)]
    return len(finite) > 2 and bool(np.mean(finite[1:] >= finite[:-1]) > _RISING) and bool(finite[-1] > finite[0])
