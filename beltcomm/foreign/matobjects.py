"""Objects in MATLAB files (tables, timetables, timeseries, Simulink's), by mat-io, as nested mappings."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

_DEEPEST = 12


def read_objects(path: Path) -> dict[str, Any]:
    """All variables by name, objects as mappings of what they hold.   Raises whatever the reader raises."""
    from matio import load_from_mat

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = load_from_mat(str(path), add_table_attrs=True)
        return {name: _plain(value, 0) for name, value in found.items() if not name.startswith("__")}


def _plain(value: Any, depth: int) -> Any:
    if depth > _DEEPEST:
        return None
    if hasattr(value, "properties") and isinstance(value.properties, Mapping):
        return {name.rstrip("_"): _plain(item, depth + 1) for name, item in value.properties.items()}
    if hasattr(value, "columns") and hasattr(value, "index"):
        return _of_frame(value)
    if isinstance(value, Mapping):
        return {str(name): _plain(item, depth + 1) for name, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item, depth + 1) for item in value]
    if not isinstance(value, np.ndarray):
        return value
    if value.dtype.names:
        parts = [{name: _plain(part[name], depth + 1) for name in value.dtype.names} for part in value.ravel()]
        return parts[0] if len(parts) == 1 else parts
    if value.dtype == object:
        parts = [_plain(item, depth + 1) for item in value.ravel()]
        return parts[0] if len(parts) == 1 else parts
    if value.dtype.kind in "mM":
        return _seconds(value.ravel())
    if value.dtype.kind == "U":
        return str(value.ravel()[0]) if value.size == 1 else [str(item) for item in value.ravel()]
    return value


def _of_frame(frame: Any) -> dict[str, Any]:
    """A table or timetable: its variables, its time, its units."""
    found: dict[str, Any] = {}
    index = np.asarray(frame.index)
    if index.dtype.kind in "mM":
        found["Time"], found["Time_unit"] = _seconds(index), "s"
    units = frame.attrs.get("VariableUnits", frame.attrs.get("varUnits")) or []
    for k, name in enumerate(frame.columns):
        values = np.asarray(frame[name])
        if values.dtype.kind in "mM":
            found[str(name)], found[f"{name}_unit"] = _seconds(values), "s"
            continue
        found[str(name)] = np.stack(list(values)) if values.dtype == object and len(values) and np.ndim(values[0]) else values
        if k < len(units) and str(units[k]).strip():
            found[f"{name}_unit"] = str(units[k]).strip()
    return found


def _seconds(stamps: Any) -> Any:
    """Since the first for dates, as they are for durations."""
    values = stamps - stamps[0] if stamps.dtype.kind == "M" and len(stamps) else stamps
    return values.astype("timedelta64[ns]").astype(np.int64) * 1e-9
