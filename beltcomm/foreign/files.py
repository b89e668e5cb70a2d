"""A foreign file as tables: which reader it takes; a log of frames gives one table per move."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from beltcomm.axis import Axis
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.apart import read_apart
from beltcomm.foreign.convert import Reading
from beltcomm.foreign.framelines import kind_of_log
from beltcomm.foreign.framelog import read_frames
from beltcomm.foreign.kinds import kind_of_table
from beltcomm.foreign.table import Decimal, Separator, Table
from beltcomm.foreign.textfile import EVERY, RowSpan, read_text_table
from beltcomm.outside import opened, sha256_of
from beltcomm.recording.sidecar import ExcitationNote

#: Packages of readers that are optional: module, and the extra that brings it.
_EXTRAS: Final[Mapping[str, tuple[str, str]]] = {"mdf": ("asammdf", "mdf"), "tdms": ("nptdms", "tdms"), "mcap": ("mcap", "mcap")}


@dataclass(frozen=True, eq=False)
class Part:
    """One recording's worth of a file.

    Attributes
    ----------
    number : int or None
        From 1, of the moves in a log of frames; None for a table.
    sha256 : str
        Of the file.
    start_s : float
        s after the file's first row.
    experiment, closed_loop, excitation
        What a log shows was done.
    lost : str
        What of a log may hold moves that were not read, in words.
    """

    table: Table
    sha256: str
    number: int | None = None
    start_s: float = 0.0
    experiment: str = "free"
    closed_loop: bool = False
    excitation: ExcitationNote | None = None
    lost: str = ""


def parts_of(path: Path, reading: Reading, axis: Axis) -> list[Part]:
    """All recordings that a file holds.

    Parameters
    ----------
    path : Path
    reading : Reading
        Mappings, and what is kept and cut.
    axis : Axis
        Gives units that a log of frames does not show.

    Raises
    ------
    UsageError, DataError
    """
    try:
        return _parts_of(path, reading, axis)
    except OSError as error:  # a disk that fails, a stick that is pulled
        raise DataError(f"{path} cannot be read: {error.strerror or error}; copy it to another disk, or export it again") from error


def _parts_of(path: Path, reading: Reading, axis: Axis) -> list[Part]:
    _check_there(path)
    sha256 = sha256_of(path)
    if kind_of_log(path) is None:
        for option in ("signals", "dbc", "channel", "record", "node"):
            if getattr(reading, option):
                name = option.removesuffix("s")
                raise UsageError(f"--{name} is for logs of CAN frames, and {path} is none that is known: candump, .asc, .blf, .trc")
        table = read_table(
            path,
            separator=reading.separator,
            decimal=reading.decimal,
            skip_lines=reading.skip_lines,
            torn_rows=reading.drop_incomplete,
            rows=RowSpan(reading.first_row or 1, reading.last_row or EVERY.last),
        )
        if reading.edges is not None:  # a place for it: its values come with the times of the rows
            rows = max((len(column) for column in table.columns.values()), default=0)
            table = replace(table, columns={**table.columns, "position_rad": np.full(rows, np.nan)})
        return [Part(table, sha256)]
    if reading.edges is not None:
        raise UsageError(f"--edges gives a table its position, and {path} is a log of frames, which has one; leave it out")
    from beltcomm.foreign.busrecords import readable, records_of
    from beltcomm.foreign.doubles import without_doubles
    from beltcomm.foreign.logclock import in_order
    from beltcomm.foreign.lostsyncs import in_stamped_order

    log = in_stamped_order(in_order(without_doubles(read_frames(path, reading.channel, readable)), readable))
    if reading.signals or reading.dbc:
        from beltcomm.foreign.signals import by_hand, of_dbc, table_of_signals

        signals = [by_hand(text) for text in reading.signals] + (of_dbc(Path(reading.dbc)) if reading.dbc else [])
        return [Part(table_of_signals(log, signals), sha256)]
    if not np.isfinite(log.t_s).all() and reading.period_s is None:
        raise DataError(f"{path} has no time stamps; record with candump -L, or -t a, or give the SYNC's rate with --rate")
    found = records_of(log, axis, reading.node, reading.torque_acts, reading.period_s)
    parts = [Part(r.table, sha256, k, r.start_s, r.experiment, r.closed_loop, r.excitation, r.lost) for k, r in enumerate(found, start=1)]
    if reading.record is not None:
        if not 1 <= reading.record <= len(parts):
            raise UsageError(f"{path} holds {len(parts)} moves, there is no --record {reading.record}")
        return [parts[reading.record - 1]]
    return parts


def _check_there(path: Path) -> None:
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "is no file" if path.exists() else "does not exist"
        raise UsageError(f"{path} {what}; give the file with the measurements")
    try:
        opened(path).close()
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error


def read_table(
    path: Path,
    *,
    separator: Separator | None = None,
    decimal: Decimal | None = None,
    skip_lines: int = 0,
    torn_rows: bool = False,
    rows: RowSpan = EVERY,
) -> Table:
    """All columns of a file, whose kind is told by its content: text (also .gz), MATLAB, HDF5, MDF, TDMS, MCAP, JSON, NumPy.

    Parameters
    ----------
    path : Path
    separator, decimal
        Of a text file; recognised when None.
    skip_lines : int
        Leave out so many at its beginning.
    torn_rows : bool
        Leave out rows in the middle of a text file that have another number of values.
    rows : RowSpan
        Of a text file those that are wanted: elsewhere torn ones do not matter.

    Raises
    ------
    UsageError
        For a file that does not exist or is of no such kind.
    DataError
        For one that cannot be read.
    """
    _check_there(path)
    kind = kind_of_table(path)
    if kind == "text":
        return read_text_table(path, separator, decimal, skip_lines, torn_rows, rows)
    if kind in _EXTRAS and importlib.util.find_spec(_EXTRAS[kind][0]) is None:
        extra = _EXTRAS[kind][1]
        raise UsageError(
            f"{path} is a {extra.upper()} file, which needs a further package: pip install 'beltcomm[{extra}]', or export it as CSV"
        )
    return read_apart(kind, path)
