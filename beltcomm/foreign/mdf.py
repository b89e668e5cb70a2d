"""ASAM MDF files (version 3 and 4) as a table, by asammdf: each channel group has its raster, and none is resampled here."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import DataError
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import check_columns, check_count

#: Times its size that a packed file can hold at most (deflate).
_PACKED = 1032


def read_mdf(path: Path) -> Table:
    """All channels in physical units; two channels of one name get the number of their group.

    Raises DataError for a file that is damaged or holds no channel of numbers.
    """
    from asammdf import MDF

    try:
        with MDF(path) as file:
            return _channels(path, file)
    except (DataError, MemoryError):
        raise
    except Exception as error:  # on damaged bytes this reader raises whatever it stumbles over
        raise DataError(f"{path} cannot be read as an MDF file ({words_of(error)}); is it cut off?") from error


def _channels(path: Path, file: Any) -> Table:
    found: dict[str, Array] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    left_out: list[str] = []
    groups: dict[int, list[Any]] = {}
    for group in file.groups:  # before anything is made of numbers that a damaged file says
        head = group.channel_group
        rows, record = int(head.cycles_nr), max(int(getattr(head, "samples_byte_nr", 1)), 1)
        check_count(str(path), rows, len(group.channels))
        if rows * record > _PACKED * path.stat().st_size:
            raise DataError(f"{path} says that it holds {rows} rows of {record} bytes, more than a file of its size can; it is damaged")
    for signal in file.iter_channels(copy_master=False):
        groups.setdefault(int(signal.group_index), []).append(signal)
    several = len(groups) > 1
    for index, signals in groups.items():
        stamps = np.asarray(signals[0].timestamps, dtype=np.float64)
        clock = f"time of group {index}" if several else "time"
        if len(stamps) < 2:
            left_out += [signal.name for signal in signals]
            continue
        found[clock], units[clock] = stamps, "s"
        for signal in signals:
            values = np.asarray(signal.samples)
            if values.dtype.kind not in "buif" or values.ndim != 1 or len(values) != len(stamps):
                left_out.append(signal.name)
                continue
            name = signal.name if signal.name not in found else f"{signal.name} of group {index}"
            column = values.astype(np.float64)
            if signal.invalidation_bits is not None:
                column[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
            column[~np.isfinite(column)] = np.nan
            found[name], clocks[name] = column, clock
            check_columns(str(path), len(found))
            if signal.unit:
                units[name] = str(signal.unit).strip()
    notes = [f"{len(groups)} channel groups, each with time stamps of its own"] if several else []
    notes += [f"not read, because they are no channels of numbers: {', '.join(left_out)}"] if left_out else []
    if not clocks:
        raise DataError(f"{path} holds no channels of numbers; {', '.join(left_out[:10]) or 'it is empty'}")
    return Table(str(path), found, units, tuple(notes), clocks)
