"""Long tables: one value in a row, the signal's name in a column."""

from __future__ import annotations

import re

import numpy as np

from beltcomm.arrays import Array, Column
from beltcomm.errors import DataError
from beltcomm.foreign.daystamps import are_days, seconds_of_days
from beltcomm.foreign.names import meaning_of
from beltcomm.foreign.table import Table
from beltcomm.foreign.timestamps import seconds_of
from beltcomm.outside import check_columns

_SIGNAL = re.compile(
    r"(signal|channel|kanal|variable|var|parameter|param|tag|topic|_?field|item|point|measurement|metric|gr(ö|oe)(ß|ss)e|messgr(ö|oe)(ß|ss)e)"
    r"([ _]?(name|bezeichnung|id))?|name|bezeichnung",
    re.I,
)
_VALUE = re.compile(r"_?(value|wert|val|var_?value|messwert|data|reading|y)", re.I)
_UNIT = re.compile(r"units?|einheit(en)?|uom", re.I)

#: Values of a signal, on the average, below which a column of names is one of remarks or states.
_FEWEST_EACH, _MOST_SIGNALS = 5, 500


def unstacked(table: Table) -> Table:
    """The table with a column for each signal, where it is a long one; else as it is.

    Parameters
    ----------
    table : Table

    Raises
    ------
    DataError
        For stamps that are none.
    """
    roles = _roles(table)
    if roles is None:
        return table
    names, value, time, units = roles
    cells = [str(cell).strip().strip('"') for cell in table.columns[names]]
    signals = sorted(set(cells))
    place = {signal: number for number, signal in enumerate(signals)}
    which = np.array([place[cell] for cell in cells])
    check_columns(table.file, 2 * len(signals))
    meaning = meaning_of(table, time)
    stamps, notes, unit = _stamps(table, time, meaning.unit if meaning is not None else table.unit(time))
    columns: dict[str, Column] = {}
    stated: dict[str, str] = {}
    clocks: dict[str, str] = {}
    made: dict[bytes, str] = {}
    for number, signal in enumerate(signals):
        rows = np.flatnonzero(which == number)
        own = stamps[rows]
        key = own.tobytes()
        if key not in made:
            made[key] = "time" if not made else f"time {len(made) + 1}"
            columns[made[key]] = own
            stated |= {made[key]: unit} if unit else {}
        columns[signal] = table.columns[value][rows]
        clocks[signal] = made[key]
        if units is not None:
            stated[signal] = str(table.columns[units][rows[0]]).strip('" ')
    words = f"a long table: {len(signals)} signals by {names!r}, values in {value!r}, each with its own rows of {time!r}"
    return Table(table.file, columns, stated, (*table.notes, words, *notes), clocks)


def _stamps(table: Table, time: str, unit: str) -> tuple[Array, tuple[str, ...], str]:
    """Stamps, sentences on them, and their unit.   unit : by the file."""
    stamps = table.columns[time]
    if time == "Time_ms" and "VarName" in table.columns:  # of WinCC: millionths of a day
        return (stamps - stamps[0]) * 0.0864, (), "s"
    if unit in ("", "d") and stamps.dtype.kind == "f" and are_days(np.unique(stamps), named=unit == "d"):  # one stamp for each signal
        return *seconds_of_days(time, stamps), "s"
    return (stamps, (), unit) if stamps.dtype.kind == "f" else (*seconds_of(table.file, time, stamps), unit)


def _roles(table: Table) -> tuple[str, str, str, str | None] | None:
    """Columns of the names, the values, the time and the units (None where there is none); None for a table that is no long one."""
    texts = [name for name, column in table.columns.items() if column.dtype.kind not in "fiu"]
    numbers = [name for name, column in table.columns.items() if column.dtype.kind in "fiu"]
    if not texts or not numbers:
        return None
    units = next((name for name in texts if _UNIT.fullmatch(Table.bare(name))), None)
    values = [name for name in numbers if _VALUE.fullmatch(Table.bare(name))]
    times = [name for name in (*numbers, *texts) if _is_time(table, name) and name not in values]
    stamp = next((name for name in times if name in numbers), None) or next((name for name in times if _understood(table, name)), None)
    plain = [name for name in numbers if name != stamp and np.ptp(table.columns[name]) > 0.0]
    value = values[0] if values else plain[0] if len(plain) == 1 else None
    candidates = [name for name in texts if name not in (units, stamp) and _few(table.columns[name])]
    named = [name for name in candidates if _SIGNAL.fullmatch(Table.bare(name))]
    if value is None or not candidates:
        return None
    if not named and (len(candidates) > 1 or len(plain) > 1 or stamp is None or _rises(table, stamp)):
        return None  # a column of states beside a table's signals
    if named and not values and (stamp is None or _rises(table, stamp)):
        return None
    if stamp is None:
        raise DataError(
            f"{table.file} holds the values of several signals below each other ({named[0]}), and no time of each is understood"
        )
    return (named or candidates)[0], value, stamp, units


def _few(column: Column) -> bool:
    signals, counts = np.unique(column, return_counts=True)
    return (
        1 < len(signals) <= min(_MOST_SIGNALS, len(column) // _FEWEST_EACH)
        and all(str(signal).strip() for signal in signals)
        and counts.min() > 1
    )


def _is_time(table: Table, name: str) -> bool:
    meaning = meaning_of(table, name)
    return (meaning is not None and meaning.quantity == "time") or name.lower() in {"_time", "timestring", "t_s", "datetime", "date"}


def _understood(table: Table, name: str) -> bool:
    try:
        seconds_of(table.file, name, table.columns[name][:3])
    except DataError:
        return False
    return True


def _rises(table: Table, name: str) -> bool:
    """Strictly from row to row: then each row is a sample of all that stands in it."""
    column = table.columns[name]
    return column.dtype.kind == "f" and bool(np.all(np.diff(column) > 0.0))
