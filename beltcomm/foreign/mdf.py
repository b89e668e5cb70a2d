"""ASAM MDF files (version 3 and 4) as a table, by asammdf: each channel group has its raster, and none is resampled here.

asammdf runs in a process of its own (``python -m beltcomm.foreign.mdf FILE``): on a damaged file it can turn in circles for ever, and
prints tracebacks while it is taken down.
"""

from __future__ import annotations

import importlib.util
import io
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltcomm import isolation
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.table import Table, words_of

#: s that the reader may take, and how much more for each byte of the file: ten times what whole files take.
_LIMIT_S, _PER_BYTE_S = 30.0, 1e-6


def is_mdf(path: Path) -> bool:
    """Whether the file begins as MDF files do, finished or not."""
    with open(path, "rb") as file:
        return file.read(8) in (b"MDF     ", b"UnFinMF ")


def read_mdf(path: Path) -> Table:
    """All channels in physical units; two channels of one name get the number of their group.

    Raises UsageError when asammdf is not installed, DataError for a file that is damaged or holds no channel of numbers.
    """
    if importlib.util.find_spec("asammdf") is None:
        raise UsageError(f"{path} is an MDF file, which needs a further package: pip install 'beltcomm[mdf]', or export it as CSV")
    if not is_mdf(path):
        raise DataError(f"{path} does not begin as an MDF file does; is it one?")
    limit_s = _LIMIT_S + _PER_BYTE_S * path.stat().st_size
    try:
        done = isolation.run(isolation.python("beltcomm.foreign.mdf", str(path)), limit_s)
    except subprocess.TimeoutExpired as error:
        raise DataError(f"{path} cannot be read as an MDF file (its reader did not end within {limit_s:.0f} s); is it cut off?") from error
    try:
        with np.load(io.BytesIO(done.stdout), allow_pickle=False) as arrays:
            about: dict[str, Any] = json.loads(str(arrays["about"]))
            columns = {name: arrays[f"c{k}"] for k, name in enumerate(about["names"])}
    except Exception as error:  # it ended without an answer, in whatever way
        raise DataError(f"{path} cannot be read as an MDF file (its reader broke down); is it cut off?") from error
    if about["fault"]:
        raise DataError(f"{path} {about['fault']}")
    return Table(str(path), columns, about["units"], tuple(about["notes"]), about["clocks"])


def channels_of(path: Path) -> tuple[dict[str, NDArray[np.float64]], dict[str, Any]]:
    """Columns, and units, clocks, notes and a fault in words, "" for none; in this process."""
    from asammdf import MDF

    try:
        with MDF(path) as file:
            return _channels(file)
    except Exception as error:  # on damaged bytes this reader raises whatever it stumbles over
        fault = f"cannot be read as an MDF file ({words_of(error)}); is it cut off?"
        return {}, {"units": {}, "clocks": {}, "notes": [], "fault": fault}


def _channels(file: Any) -> tuple[dict[str, NDArray[np.float64]], dict[str, Any]]:
    found: dict[str, NDArray[np.float64]] = {}
    units: dict[str, str] = {}
    clocks: dict[str, str] = {}
    left_out: list[str] = []
    groups: dict[int, list[Any]] = {}
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
            if signal.unit:
                units[name] = str(signal.unit).strip()
    notes = [f"{len(groups)} channel groups, each with time stamps of its own"] if several else []
    notes += [f"not read, because they are no channels of numbers: {', '.join(left_out)}"] if left_out else []
    fault = "" if clocks else f"holds no channels of numbers; {', '.join(left_out[:10]) or 'it is empty'}"
    return found, {"units": units, "clocks": clocks, "notes": notes, "fault": fault}


def _answer(path: Path) -> None:
    """The channels of a file to stdout, as a NumPy archive."""
    columns, about = channels_of(path)
    arrays = {f"c{k}": column for k, column in enumerate(columns.values())}
    with io.BytesIO() as buffer:
        np.savez(buffer, about=json.dumps({**about, "names": list(columns)}), **arrays)  # type: ignore[arg-type,unused-ignore]
        sys.stdout.buffer.write(buffer.getvalue())


if __name__ == "__main__":
    _answer(Path(sys.argv[1]))
