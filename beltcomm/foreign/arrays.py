"""Nested arrays (MATLAB structures, cells, NumPy archives, HDF5 groups) as a table: which vector is a signal, which is its time.

Layouts that are known by their shape, whatever they are called::

    S.Time, S.Data [, S.DataInfo.Units]                a time series as a structure
    S.time, S.signals(k).values, .label                Simulink, "structure with time"
    S.X(j).Data, S.Y(k).Name, .Data, .Unit, .XIndex    dSPACE
    S.t, S.torque, S.position                          a structure of vectors with one time among them
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import Column
from beltcomm.errors import DataError
from beltcomm.foreign.table import Table
from beltcomm.outside import check_columns

_TIME = re.compile(r"(t|time|times|timestamps?|tout|zeit|t_?(s|sec|ms|us))$", re.I)
_DATA = ("data", "values", "value", "daten", "werte")
_UNIT = ("unit", "units", "einheit", "einheiten")
#: Structures nest no deeper in any measurement; a file that refers to itself would go on for ever.
_DEEPEST = 12


def table_of(path: Path, arrays: Mapping[str, Any]) -> Table:
    """One column per vector; a matrix gives one per row or column, whichever are fewer, named NAME1, NAME2, ...

    Parameters
    ----------
    path : Path
    arrays : mapping of str to Any
        Nested mappings of arrays.

    Raises
    ------
    DataError
        When there is no vector of numbers.
    """
    found = _Found(str(path))
    found.structure(arrays, "", 0)
    if not found.columns:
        raise DataError(f"{path} holds no vectors of numbers; give a file with one vector per signal{found.objects_hint()}")
    notes = (f"not read, because they are no vectors of numbers: {', '.join(found.left_out)}",) if found.left_out else ()
    return Table(str(path), found.columns, found.units, notes, found.clocks, found.scalars)


class _Found:
    """Findings of the walk through the structures: columns, units, and which column holds the time of which."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.columns: dict[str, Column] = {}
        self.units: dict[str, str] = {}
        self.clocks: dict[str, str] = {}
        self.left_out: list[str] = []
        self.scalars: dict[str, float] = {}

    def structure(self, value: Mapping[str, Any], prefix: str, depth: int) -> None:
        """Everything inside one structure."""
        if depth > _DEEPEST:
            self.left_out.append(prefix.rstrip("."))
            return
        outer = prefix.rstrip(".")
        if self._time_series(value, outer) or self._simulink(value, outer) or self._dspace(value, outer):
            return
        if self._one_signal(value, outer):
            return
        time_name = next((key for key in value if _TIME.match(key) and _length(value[key]) > 1), None) if prefix else None
        here: list[str] = []
        for key, item in value.items():
            if not key.startswith("__"):
                here += self._item(key, item, prefix, depth)
        self._units_beside(value, prefix)
        if time_name is not None:
            clock = f"{prefix}{time_name}"
            self.clocks |= {n: clock for n in here if n != clock and len(self.columns[n]) == len(self.columns[clock])}

    def _item(self, key: str, item: Any, prefix: str, depth: int) -> list[str]:
        name = f"{prefix}{key}"
        if isinstance(item, np.ndarray) and item.dtype.names:
            item = {field: item[field] for field in item.dtype.names}
            name = name or prefix.rstrip(".")
        if isinstance(item, np.ndarray) and item.dtype == object:
            item = item.tolist()
        if isinstance(item, Mapping):
            self.structure(item, f"{name}." if name else "", depth + 1)
        elif isinstance(item, list) and any(isinstance(part, (Mapping, np.ndarray, list)) for part in item):
            labels = [_text_of(part, "name", "label") if isinstance(part, Mapping) else "" for part in item]
            for label, part in zip(numbered([label or f"{key}{k}" for k, label in enumerate(labels, start=1)]), item, strict=True):
                self._item(label, part, prefix, depth + 1)
        else:
            return self._vector(name, item)
        return []

    def _vector(self, name: str, value: Any, unit: str = "") -> list[str]:
        """Columns of a vector or a matrix; their names."""
        try:
            values = np.asarray(value)
        except ValueError:  # a list of lists of unequal lengths
            values = np.asarray(None)
        if values.dtype.kind in "iuf" and values.size == 1 and not name.startswith("_") and np.isfinite(values.ravel()[0]):
            self.scalars[name] = float(values.ravel()[0])
        if values.dtype.kind not in "buif" or values.size < 2 or values.ndim > 2:
            if not name.startswith("_") and name.rpartition(".")[2].lower() not in _UNIT:
                self.left_out.append(name)
            return []
        flat = np.squeeze(values).astype(np.float64)
        flat[~np.isfinite(flat)] = np.nan
        parts = {name or "c1": flat} if flat.ndim == 1 else _of_matrix(name or "c", flat)
        parts = {self._free(part): column for part, column in parts.items()}
        self.columns |= parts
        check_columns(self.file, len(self.columns))
        if unit:
            self.units |= dict.fromkeys(parts, unit)
        return list(parts)

    def _signal(self, name: str, data: Any, clock: str, unit: str) -> None:
        """Columns of one signal that has a clock."""
        samples = len(self.columns[clock])
        values = np.squeeze(np.asarray(data))
        if values.ndim == 2 and values.shape[0] != samples and values.shape[1] == samples:
            values = values.T
        if values.ndim == 2 and values.dtype.kind in "buif" and values.shape[0] == samples:
            parts = {f"{name}{k}": column for k, column in enumerate(values.T, start=1)}
        else:
            parts = {name: values}
        for part, column in parts.items():
            for made in self._vector(self._free(part), column, unit):
                if len(self.columns[made]) == samples:
                    self.clocks[made] = clock

    def _clock(self, name: str, time: Any, unit: str = "") -> str:
        """The column of a time vector; an equal one that is there already serves as well.  "" when it is no time."""
        made = self._vector(name, time, unit)
        if len(made) != 1:
            for column in made:
                del self.columns[column]
            return ""
        for other in dict.fromkeys(self.clocks.values()):
            same = np.array_equal(self.columns[other], self.columns[made[0]]) and self.units.get(other) == self.units.get(made[0])
            if other != made[0] and same:
                del self.columns[made[0]]
                self.units.pop(made[0], None)
                return other
        return made[0]

    def _one_signal(self, value: Mapping[str, Any], name: str) -> bool:
        """A vector and the words on it: its name and unit."""
        data, unit = _member(value, *_DATA), _text_of(value, *_UNIT)
        if not name or not unit or _length(data) < 2 or sum(_length(item) > 1 for item in value.values()) > 1:
            return False
        return bool(self._vector(name, data, unit))

    def _time_series(self, value: Mapping[str, Any], name: str) -> bool:
        time, data = _member(value, "time", "timestamps", "t"), _member(value, *_DATA)
        if not name or time is None or data is None or _length(time) < 2 or _length(data) < 2:
            return False
        info = _member(value, "timeinfo")
        clock = self._clock(f"{name}.{_key(value, 'time', 'timestamps', 't')}", time, _text_of(info, *_UNIT))
        if not clock:
            return False
        about = _member(value, "datainfo")
        self._signal(name, data, clock, _text_of(value, *_UNIT) or _text_of(about, *_UNIT))
        return True

    def _simulink(self, value: Mapping[str, Any], name: str) -> bool:
        time, signals = _member(value, "time"), _member(value, "signals")
        if isinstance(signals, np.ndarray):
            signals = signals.tolist()
        signals = [signals] if isinstance(signals, Mapping) else signals
        if time is None or _length(time) < 2 or not isinstance(signals, list) or not all(isinstance(part, Mapping) for part in signals):
            return False
        clock = self._clock(f"{name}.time" if name else "time", time)
        for number, part in enumerate(signals, start=1) if clock else ():
            label = _text_of(part, "label") or _text_of(part, "blockname").rpartition("/")[2]
            own = label or (f"{name}.{number}" if len(signals) > 1 else name) or f"signal{number}"
            data = _member(part, *_DATA)
            if data is not None:
                self._signal(own, data, clock, _text_of(part, *_UNIT))
        return bool(clock)

    def _dspace(self, value: Mapping[str, Any], name: str) -> bool:
        axes, signals = _parts(value.get("X")), _parts(value.get("Y"))
        if not axes or not signals or not all(_member(part, "data") is not None for part in (*axes, *signals)):
            return False
        clocks = [
            self._clock(f"{name}.{_text_of(axis, 'name') or 'time'}{k if k > 1 else ''}", _member(axis, "data"), _text_of(axis, *_UNIT))
            for k, axis in enumerate(axes, start=1)
        ]
        for number, part in enumerate(signals, start=1):
            index = np.atleast_1d(np.asarray(_member(part, "xindex") if _member(part, "xindex") is not None else 1)).ravel()
            place = int(index[0]) - 1 if index.size and index.dtype.kind in "iuf" and 0 < index[0] <= len(clocks) else 0
            label = _text_of(part, "name", "path") or f"{name}.Y{number}"
            data = _member(part, "data")
            if clocks[place]:
                self._signal(label.strip('"'), data, clocks[place], _text_of(part, *_UNIT))
            else:
                self._vector(self._free(label), data, _text_of(part, *_UNIT))
        return True

    def _units_beside(self, value: Mapping[str, Any], prefix: str) -> None:
        """Units that stand beside the vectors: ``units.torque``, ``torque_unit``."""
        beside = _member(value, *_UNIT)
        for key in value:
            column = f"{prefix}{key}"
            if column not in self.columns or column in self.units:
                continue
            text = _text_of(beside, key.lower()) or _text_of(value, *(f"{key}_{word}".lower() for word in _UNIT))
            if text:
                self.units[column] = text

    def _free(self, name: str) -> str:
        number = 2
        free = name
        while free in self.columns:
            free, number = f"{name}_{number}", number + 1
        return free

    def objects_hint(self) -> str:
        """Note of the objects that were left out, which only MATLAB itself can open."""
        return f" (not read: {', '.join(self.left_out[:10])})" if self.left_out else ""


def numbered(names: Sequence[str]) -> list[str]:
    """The names, the second of one name with ``_2`` behind it, the third with ``_3``, as columns of a text file.

    Parameters
    ----------
    names : sequence of str
    """
    taken: set[str] = set(names)
    seen: set[str] = set()
    made = []
    for name in names:
        number, free = 2, name
        while free in seen or (free != name and free in taken):
            free, number = f"{name}_{number}", number + 1
        seen.add(free)
        made.append(free)
    return made


def _of_matrix(name: str, values: Column) -> dict[str, Column]:
    columns = values if values.shape[0] < values.shape[1] else values.T
    return {f"{name}{number}": column for number, column in enumerate(columns, start=1)}


def _length(value: Any) -> int:
    return int(np.size(value)) if isinstance(value, np.ndarray) and value.dtype.kind in "buif" else 0


def _key(value: Mapping[str, Any], *names: str) -> str:
    return next((key for name in names for key in value if key.lower() == name), "")


def _member(value: Any, *names: str) -> Any:
    """The member of a structure that has one of these names, in whatever case; None when there is none."""
    key = _key(value, *names) if isinstance(value, Mapping) else ""
    return value[key] if key else None


def _text_of(value: Any, *names: str) -> str:
    """Text in a member, "" for anything else; a MATLAB string in a cell counts."""
    member = _member(value, *names)
    while isinstance(member, (list, np.ndarray)) and np.size(np.asarray(member, dtype=object)) == 1:
        member = np.asarray(member, dtype=object).ravel()[0]
    return member.strip() if isinstance(member, str) else ""


def _parts(value: Any) -> list[Mapping[str, Any]]:
    """A structure array as a list of structures; a single one counts as one."""
    if isinstance(value, Mapping):
        return [value]
    items = value.ravel().tolist() if isinstance(value, np.ndarray) and value.dtype == object else value
    return list(items) if isinstance(items, list) and all(isinstance(item, Mapping) for item in items) else []
