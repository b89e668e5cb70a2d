"""MATLAB, HDF5, MDF, NumPy and BLF files are read in a process of their own: on a damaged one their readers crash, turn in circles for
ever, or ask for all memory there is.

``python -P -m beltcomm.foreign.apart KIND FILE`` writes to its standard output: the length of a JSON text (8 bytes, little endian), that
text (names and numbers of rows, units, clocks, notes, or the fault in words), then the columns as float64 one after the other.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any, Final, Literal

import numpy as np

from beltcomm.errors import DataError
from beltcomm.foreign.table import Table, words_of
from beltcomm.outside import check_columns, check_count, in_words, opened

Kind = Literal["matlab", "hdf5", "mdf", "numpy", "blf"]

#: s of processor time that a reader may take, and how much more for each byte of the file: ten times what whole files take; and how many
#: times as long by the clock, on a machine that is busy otherwise.
_LIMIT_S, _PER_BYTE_S, _PATIENCE = 30.0, 1e-6, 4.0
#: Bytes of memory that a reader may take, how many more for each byte of the file, and at most.
_MEMORY, _PER_BYTE, _MOST_MEMORY = 1 << 30, 32, 6 << 30
#: Bytes of the text before the columns, at most.
_MOST_TEXT: Final = 1 << 26
_NAMES: Final = {"matlab": "a MATLAB file", "hdf5": "an HDF5 file", "mdf": "an MDF file", "numpy": "a NumPy file", "blf": "a BLF file"}


def read_apart(kind: Kind, path: Path) -> Table:
    """The table in a file.   Raises DataError for a file that is damaged, refused, or whose reader breaks down or does not end."""
    with opened(path) as file:
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
            raise DataError(f"{path} cannot be read as {_NAMES[kind]} ({how}); is it cut off or damaged? Export it as CSV") from error
        finally:
            guard.cancel()
            child.kill()
    return table


def _started(kind: Kind, path: Path, memory: int, limit_s: float) -> subprocess.Popen[bytes]:
    """The process with the reader; nothing of the working directory is imported there."""
    search = os.pathsep.join(entry for entry in sys.path if os.path.isabs(entry) and entry != os.getcwd())
    # plug-ins of HDF5 are machine code from a folder that the environment names
    environment = {**os.environ, "PYTHONPATH": search, "HDF5_PLUGIN_PRELOAD": "::", "OPENBLAS_NUM_THREADS": "1"}
    command = [
        sys.executable,
        "-P",
        "-m",
        "beltcomm.foreign.apart",
        kind,
        str(path.absolute()),
        str(path),
        str(memory),
        str(int(limit_s) + 1),
    ]
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment)


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
    return Table(str(path), columns, texts[0], tuple(str(note) for note in about["notes"]), texts[1])


def _whole(stream: IO[bytes], place: bytearray | memoryview) -> bytes | bytearray | memoryview:
    """The place, filled.   Raises EOFError."""
    view, at = memoryview(place), 0
    while at < len(view):
        got = stream.readinto(view[at:])  # type: ignore[attr-defined]
        if not got:
            raise EOFError
        at += got
    return place


def table_in(kind: Kind, path: Path) -> Table:
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
    from beltcomm.foreign.mdf import read_mdf

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


def _blf(path: Path) -> Table:
    from beltcomm.foreign.framelog import read_blf

    return read_blf(path)


_READERS: Final[dict[str, Callable[[Path], Table]]] = {"matlab": _matlab, "hdf5": _hdf5, "mdf": _mdf, "numpy": _numpy, "blf": _blf}


def _bounded(kind: str, memory: int, limit_s: int) -> None:
    """Bounds for this process, where the system knows them."""
    try:
        import resource
    except ImportError:
        return
    bounds = {"RLIMIT_AS": memory, "RLIMIT_CPU": limit_s, "RLIMIT_CORE": 0}
    if kind != "mdf":  # asammdf keeps what it unpacks in temporary files
        bounds["RLIMIT_FSIZE"] = 0
    for name, bound in bounds.items():
        number = getattr(resource, name, None)
        if number is not None:
            _, hard = resource.getrlimit(number)
            most = bound if hard == resource.RLIM_INFINITY else min(bound, hard)
            resource.setrlimit(number, (most, hard))


def _answer(kind: Kind, path: Path, given: str, memory: int, limit_s: int) -> None:
    """The table of a file to the standard output.   given : how the file was named."""
    _bounded(kind, memory, limit_s)
    table, fault = Table(given, {}), ""
    try:
        table = table_in(kind, path)
        check_columns(given, len(table.columns))
        check_count(given, sum(map(len, table.columns.values())), 1)
    except DataError as error:
        fault = str(error).replace(str(path), given)
    except MemoryError:
        fault = (
            f"{given} asks for more than {in_words(memory)} of memory, a file of its size needs far less; is it damaged? Export it as CSV"
        )
    columns = {} if fault else table.columns
    about = {
        "fault": fault,
        "columns": [(name, len(column)) for name, column in columns.items()],
        "units": dict(table.units),
        "clocks": dict(table.clocks),
        "notes": [note.replace(str(path), given) for note in table.notes],
    }
    text = json.dumps(about).encode("utf-8", "replace")
    with os.fdopen(1, "wb") as out:
        out.write(len(text).to_bytes(8, "little") + text)
        for column in columns.values():
            out.write(np.ascontiguousarray(column, dtype=np.float64).data)


if __name__ == "__main__":
    _answer(sys.argv[1], Path(sys.argv[2]), sys.argv[3], int(sys.argv[4]), int(sys.argv[5]))  # type: ignore[arg-type]
