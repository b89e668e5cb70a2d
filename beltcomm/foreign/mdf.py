"""ASAM MDF files (version 3 and 4) as a table, by asammdf: each channel group has its raster, and none is resampled here."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.table import Table, words_of


def is_mdf(path: Path) -> bool:
    """Whether the file begins as MDF files do, finished or not."""
    with open(path, "rb") as file:
        return file.read(8) in (b"MDF     ", b"UnFinMF ")


def read_mdf(path: Path) -> Table:
    """All channels in physical units; two channels of one name get the number of their group.

    Raises UsageError when asammdf is not installed, DataError for a file that is damaged or holds no channel of numbers.
    """
    try:
        from asammdf import MDF
    except ImportError as error:
        raise UsageError(
            f"{path} is an MDF file, which needs a further package: pip install 'beltcomm[mdf]', or export it as CSV"
        ) from error
    logging.getLogger("asammdf").setLevel(logging.CRITICAL)  # what is wrong with a file is said once, below
    try:
        with MDF(path, process_bus_logging=False) as file:
            return _table(path, file)
    except DataError:
        raise
    except Exception as error:  # on damaged bytes these readers raise whatever they stumble over
        raise DataError(f"{path} cannot be read as an MDF file ({words_of(error)}); is it cut off?") from error


def _table(path: Path, file: Any) -> Table:
    found: dict[str, Any] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    left_out: list[str] = []
    groups: dict[int, tuple[str, list[Any]]] = {}
    for signal in file.iter_channels(copy_master=False):
        groups.setdefault(int(signal.group_index), ("", []))[1].append(signal)
    several = len(groups) > 1
    for index, (_, signals) in groups.items():
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
            if signal.unit:
                units[name] = str(signal.unit).strip()
    if not clocks:
        raise DataError(f"{path} holds no channels of numbers; {', '.join(left_out[:10]) or 'it is empty'}")
    notes = [f"{len(groups)} channel groups, each with time stamps of its own"] if several else []
    notes += [f"not read, because they are no channels of numbers: {', '.join(left_out)}"] if left_out else []
    return Table(str(path), found, units, tuple(notes), clocks)
