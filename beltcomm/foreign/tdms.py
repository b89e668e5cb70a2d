"""National Instruments' TDMS files as a table, by npTDMS: a channel's time is its waveform's, or a column of its group."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import Column
from beltcomm.errors import DataError
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import check_columns, opened


def read_tdms(path: Path) -> Table:
    """All channels of numbers and dates.   Raises DataError for a file that is damaged or holds none."""
    from nptdms import TdmsFile

    try:
        with opened(path) as file:
            return _channels(path, TdmsFile.read(file))
    except (DataError, MemoryError):
        raise
    except Exception as error:  # on damaged bytes this reader raises whatever it stumbles over
        raise DataError(f"{path} cannot be read as a TDMS file ({words_of(error)}); is it cut off?") from error


def _channels(path: Path, file: Any) -> Table:
    columns: dict[str, Column] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    made: dict[tuple[float, float, int], str] = {}
    left_out: list[str] = []
    groups = file.groups()
    for group in groups:
        for channel in group.channels():
            name = channel.name if len(groups) == 1 or channel.name not in columns else f"{group.name}/{channel.name}"
            values = np.asarray(channel[:])
            if values.dtype.kind == "M":
                values, units[name] = (
                    (values - values[0]).astype("timedelta64[ns]").astype(np.float64) * 1e-9 if len(values) else values,
                    "s",
                )
            if values.dtype.kind not in "buif" or values.ndim != 1 or len(values) < 2:
                left_out.append(name)
                units.pop(name, None)
                continue
            columns[name] = values.astype(np.float64)
            check_columns(str(path), len(columns))
            unit = channel.properties.get("unit_string") or channel.properties.get("NI_UnitDescription")
            if unit:
                units[name] = str(unit).strip()
            step, start = _number(channel.properties.get("wf_increment")), _number(channel.properties.get("wf_start_offset"))
            if step > 0.0 and len(values) > 1:
                key = (step, start, len(values))
                if key not in made:
                    made[key] = f"time at {1.0 / step:.6g} Hz" + (f" ({len(made) + 1})" if any(k[0] == step for k in made) else "")
                clocks[name] = made[key]
    for (step, start, length), clock in made.items():
        columns[clock], units[clock] = start + step * np.arange(length), "s"
    notes = [f"not read, because they are no channels of numbers: {', '.join(left_out)}"] if left_out else []
    if not columns:
        raise DataError(f"{path} holds no channels of numbers; {', '.join(left_out[:10]) or 'it is empty'}")
    return Table(str(path), columns, units, tuple(notes), clocks)


def _number(value: Any) -> float:
    return float(value) if isinstance(value, (int, float, np.number)) and np.isfinite(value) else 0.0
