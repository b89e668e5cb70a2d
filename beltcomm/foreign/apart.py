"""MATLAB, HDF5, MDF, NumPy, BLF, TRC and DBC files are read in a process of their own: on a damaged one their readers crash, turn in
circles for ever, or ask for all memory there is.

``beltcomm.foreign.apart_reader`` writes to its standard output: the length of a JSON text (8 bytes, little endian), that
text (names and numbers of rows, units, clocks, notes, or the fault in words), then the columns as float64 one after the other.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
from pathlib import Path
from typing import IO, Any, Final, Literal

import numpy as np

from beltcomm import isolation
from beltcomm.errors import DataError
from beltcomm.foreign.table import Table
from beltcomm.outside import MEASURED_BYTES, check_columns, check_count, opened

Kind = Literal["matlab", "hdf5", "mdf", "numpy", "tdms", "mcap", "json", "blf", "trc", "sqlite", "dbc"]

#: s of processor time that a reader may take, and how much more for each byte of the file: ten times what whole files take; and how many
#: times as long by the clock, on a machine that is busy otherwise.
_LIMIT_S, _PER_BYTE_S, _PATIENCE = 30.0, 1e-6, 4.0
#: Bytes of memory that a reader may take, how many more for each byte of the file, and at most.
_MEMORY, _PER_BYTE, _MOST_MEMORY = 1 << 30, 32, 6 << 30
#: Bytes of the text before the columns, at most.
_MOST_TEXT: Final = 1 << 26
_NAMES: Final[dict[Kind, str]] = {
    "matlab": "a MATLAB file",
    "hdf5": "an HDF5 file",
    "mdf": "an MDF file",
    "numpy": "a NumPy file",
    "tdms": "a TDMS file",
    "mcap": "an MCAP file",
    "json": "JSON",
    "blf": "a BLF file",
    "trc": "a TRC file",
    "sqlite": "a database of CAN frames",
    "dbc": "a DBC file",
}


def read_apart(kind: Kind, path: Path, most: int = MEASURED_BYTES) -> Table:
    """The table in a file of at most ``most`` bytes.

    Parameters
    ----------
    kind : Kind
        Of the file.
    path : Path
    most : int, bytes
        That are read.

    Raises
    ------
    DataError
        For a file that is damaged, refused, or whose reader breaks down or does not end.
    """
    with opened(path, most) as file:
        size = os.fstat(file.fileno()).st_size
    limit_s, memory = _LIMIT_S + _PER_BYTE_S * size, min(_MEMORY + _PER_BYTE * size, _MOST_MEMORY)
    too_late = threading.Event()
    with _started(kind, path, memory, limit_s) as child:

        def stop() -> None:
            too_late.set()
            child.kill()

        guard = threading.Timer(_PATIENCE * limit_s, stop)
        guard.start()
        try:
            assert child.stdout is not None
            table = _received(path, child.stdout)
        except (EOFError, ValueError, KeyError, TypeError, AttributeError) as error:  # it ended without an answer, in whatever way
            child.kill()
            code = child.wait()
            if too_late.is_set() or code == -getattr(signal, "SIGXCPU", 0):
                how = f"its reader did not end within {limit_s:.0f} s"
            else:
                how = f"its reader broke down{f', {signal.Signals(-code).name}' if code < 0 and code != -signal.SIGKILL else ''}"
            raise DataError(f"{path} cannot be read as {_NAMES[kind]} ({how}); is it cut off or damaged? {instead_of(kind)}") from error
        finally:
            guard.cancel()
            child.kill()
    return table


def instead_of(kind: Kind) -> str:
    """Remedy for a file whose reader fails.

    Parameters
    ----------
    kind : Kind
        Of the file.
    """
    return "Name the signals by --signal instead" if kind == "dbc" else "Export it as CSV"


def _started(kind: Kind, path: Path, memory: int, limit_s: float) -> subprocess.Popen[bytes]:
    """The process with the reader; nothing of the working directory is imported there."""
    command = isolation.python("beltcomm.foreign.apart_reader", kind, str(path.absolute()), str(path), str(memory), str(int(limit_s) + 1))
    # plug-ins of HDF5 are machine code from a folder that the environment names
    return isolation.start(command, subprocess.PIPE, HDF5_PLUGIN_PRELOAD="::", OPENBLAS_NUM_THREADS="1")


def _received(path: Path, stream: IO[bytes]) -> Table:
    """The answer of the process, believed in nothing but numbers.   Raises DataError for its fault, EOFError, ValueError, ... for none."""
    length = int.from_bytes(_whole(stream, bytearray(8)), "little")
    if length > _MOST_TEXT:
        raise ValueError("too long a text")
    about = json.loads(bytes(_whole(stream, bytearray(length))))
    if about["fault"]:
        raise DataError(str(about["fault"]))
    check_columns(str(path), len(about["columns"]))
    columns: dict[str, Any] = {}
    total = 0
    for name, rows in about["columns"]:
        total += int(rows)
        check_count(str(path), total, 1)
        column = np.empty(int(rows))
        if len(column):
            _whole(stream, column.data.cast("B"))
        columns[str(name)] = column
    texts: list[dict[str, str]] = [{str(key): str(value) for key, value in about[part].items()} for part in ("units", "clocks")]
    scalars = {str(key): float(value) for key, value in about["scalars"].items()}
    return Table(str(path), columns, texts[0], tuple(str(note) for note in about["notes"]), texts[1], scalars)


def _whole(stream: IO[bytes], place: bytearray | memoryview) -> bytes | bytearray | memoryview:
    """The place, filled.   Raises EOFError."""
    view, at = memoryview(place), 0
    while at < len(view):
        got = stream.readinto(view[at:])  # type: ignore[attr-defined]
        if not got:
            raise EOFError
        at += got
    return place
