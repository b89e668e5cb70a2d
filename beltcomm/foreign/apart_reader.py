"""The process that reads a file whose reader may break down: the table to its standard output, for :mod:`beltcomm.foreign.apart`."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from beltcomm.errors import DataError
from beltcomm.foreign.apart import Kind, instead_of
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import check_columns, check_count, in_words, opened
from beltcomm.posix import bound_this_process


def _table_in(kind: Kind, path: Path) -> Table:
    """The table in a file, read in this process.   Raises DataError, or nothing that can be named."""
    return _READERS[kind](path)


def _matlab(path: Path) -> Table:
    from beltcomm.foreign.arrays import table_of
    from beltcomm.foreign.matlab import read_matlab

    return table_of(path, read_matlab(path))


def _hdf5(path: Path) -> Table:
    from beltcomm.foreign.arrays import table_of
    from beltcomm.foreign.matlab import read_hdf5

    return table_of(path, read_hdf5(path))


def _mdf(path: Path) -> Table:
    from beltcomm.foreign.optional_formats import read_mdf

    return read_mdf(path)


def _numpy(path: Path) -> Table:
    from beltcomm.foreign.arrays import table_of

    try:
        with opened(path) as file:
            loaded = np.load(file, allow_pickle=False)
            arrays = {"": loaded} if isinstance(loaded, np.ndarray) else {name: loaded[name] for name in loaded.files}
    except MemoryError:
        raise
    except Exception as error:  # on damaged bytes these readers raise whatever they stumble over
        raise DataError(f"{path} cannot be read as a NumPy file ({words_of(error)}); is it cut off, or does it hold objects?") from error
    return table_of(path, arrays)


def _tdms(path: Path) -> Table:
    from beltcomm.foreign.optional_formats import read_tdms

    return read_tdms(path)


def _mcap(path: Path) -> Table:
    from beltcomm.foreign.optional_formats import read_mcap

    return read_mcap(path)


def _json(path: Path) -> Table:
    from beltcomm.foreign.jsonfile import read_json

    return read_json(path)


def _frames(kind: Kind, path: Path) -> Table:
    from beltcomm.foreign.framelog import frames_apart

    return frames_apart(kind, path)


def _dbc(path: Path) -> Table:
    from beltcomm.foreign.signals import dbc_apart

    return dbc_apart(path)


_READERS: Final[dict[Kind, Callable[[Path], Table]]] = {
    "matlab": _matlab,
    "hdf5": _hdf5,
    "mdf": _mdf,
    "numpy": _numpy,
    "tdms": _tdms,
    "mcap": _mcap,
    "json": _json,
    "blf": partial(_frames, "blf"),
    "trc": partial(_frames, "trc"),
    "sqlite": partial(_frames, "sqlite"),
    "dbc": _dbc,
}


def _bounded(kind: str, memory: int, limit_s: int) -> None:
    """Bounds for this process, where the system knows them."""
    bounds = {"RLIMIT_AS": memory, "RLIMIT_CPU": limit_s, "RLIMIT_CORE": 0}
    if kind != "mdf":  # asammdf keeps what it unpacks in temporary files
        bounds["RLIMIT_FSIZE"] = 0
    bound_this_process(bounds)


def _answer(kind: Kind, path: Path, given: str, memory: int, limit_s: int) -> None:
    """The table of a file to the standard output.   given : how the file was named."""
    _bounded(kind, memory, limit_s)
    table, fault = Table(given, {}), ""
    try:
        table = _table_in(kind, path)
        check_columns(given, len(table.columns))
        check_count(given, sum(map(len, table.columns.values())), 1)
    except DataError as error:
        fault = str(error).replace(str(path), given)
    except MemoryError:
        fault = (
            f"{given} asks for more than {in_words(memory)} of memory, a file of its size needs far less; is it damaged? {instead_of(kind)}"
        )
    columns = {} if fault else table.columns
    about = {
        "fault": fault,
        "columns": [(name, len(column)) for name, column in columns.items()],
        "units": dict(table.units),
        "clocks": dict(table.clocks),
        "scalars": dict(table.scalars),
        "notes": [note.replace(str(path), given) for note in table.notes],
    }
    text = json.dumps(about).encode("utf-8", "replace")
    with os.fdopen(1, "wb") as out:
        out.write(len(text).to_bytes(8, "little") + text)
        for column in columns.values():
            out.write(np.ascontiguousarray(column, dtype=np.float64).data)


if __name__ == "__main__":
    _answer(sys.argv[1], Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))  # type: ignore[arg-type]
