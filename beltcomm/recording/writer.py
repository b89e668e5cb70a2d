"""Rows to a file while the axis moves: what was flushed survives a killed process."""

from __future__ import annotations

import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, Self, TextIO

from beltcomm import atomic
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.errors import DataError, UsageError
from beltcomm.recording.columns import MOTOR_COLUMNS
from beltcomm.recording.sidecar import Sidecar

#: Rows between two flushes: at 1 kHz a killed process loses less than 0.1 s.
FLUSH_ROWS = 64


class RecordingWriter:
    """Writes one recording row by row: :meth:`write` is a :data:`beltcomm.drive.Sink`; then :meth:`close` it.

    While it runs there is ``NAME.csv.part`` and a sidecar with ``finished: false``; closing it as finished renames the part
    to ``NAME.csv``.  As a context manager it is finished unless an exception leaves the block; an exception or a killed
    process leaves the part: an unfinished record.

    Parameters
    ----------
    path : Path
        ``NAME.csv``.
    columns : tuple of str
        Names of a row's values; those that are NaN in the first row are left out.

    Raises
    ------
    DataError
        When the record exists; raw recordings never change. An unfinished one is moved aside, not deleted.
    UsageError
        When the folder cannot be written.
    """

    def __init__(self, path: Path, sidecar: Sidecar, columns: tuple[str, ...] = MOTOR_COLUMNS) -> None:
        if path.exists():
            raise DataError(f"{path} exists and raw recordings are never changed; choose another name")
        self.path = path
        self.rows = 0
        self._sidecar = sidecar
        self._columns = columns
        self._kept: list[int] = []
        self._part = path.with_name(f"{path.name}.part")
        _move_aside(self._part, path.with_suffix(".yaml"))
        self._write_sidecar(finished=False)
        try:
            self._file: TextIO | None = open(self._part, "x", encoding="utf-8", newline="\n")  # noqa: SIM115  # close() closes it
        except OSError as error:
            raise _unwritable(self._part, error) from error

    def write(self, row: tuple[float, ...]) -> None:
        """Append one row.

        Parameters
        ----------
        row : tuple of float
            One number per column, in SI units.

        Raises
        ------
        UsageError
            When the disk is full.
        ValueError
            For a row of another length.
        """
        if len(row) != len(self._columns):
            raise ValueError(f"a row has {len(row)} values for {len(self._columns)} columns")
        if self._file is None:
            raise ValueError("the recording is closed")
        try:
            if not self.rows:
                self._kept = [i for i, value in enumerate(row) if not math.isnan(value)]
                self._file.write(",".join(self._columns[i] for i in self._kept) + "\n")
            self._file.write(",".join([repr(float(row[i])) for i in self._kept]) + "\n")
            self.rows += 1
            if self.rows % FLUSH_ROWS == 0:
                self._file.flush()
        except OSError as error:
            raise _unwritable(self._part, error) from error

    def close(self, *, finished: bool, **changes: Any) -> Path:
        """Close the record.

        Idempotent: a closed record stays as it is.

        Parameters
        ----------
        finished : bool
            The record is complete.
        **changes : Any
            Fields of the sidecar known only now.

        Returns
        -------
        Path
            Path of the rows: ``NAME.csv`` when finished, else ``NAME.csv.part``.
        """
        if self._file is None:
            return self.path if self.path.exists() else self._part
        file, self._file = self._file, None
        try:
            with file:
                file.flush()
                os.fsync(file.fileno())
            self._sidecar = replace(self._sidecar, **changes)
            self._write_sidecar(finished)
            if not finished:
                return self._part
            # The rename comes last: whenever the process dies, a record without NAME.csv is unfinished.
            os.replace(self._part, self.path)
            atomic.sync(self.path.parent)
        except OSError as error:
            raise _unwritable(self._part, error) from error
        return self.path

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *rest: object) -> None:
        self.close(finished=kind is None)

    def _write_sidecar(self, finished: bool) -> None:
        write_text(self.path.with_suffix(".yaml"), to_yaml(replace(self._sidecar, finished=finished).to_dict()))


def _move_aside(part: Path, note: Path) -> None:
    """Rename an earlier unfinished record so that nothing is lost."""
    if not part.exists():
        return
    stem = part.name.removesuffix(".csv.part")
    number = 1
    while (aside := part.with_name(f"{stem}.unfinished{number}.csv.part")).exists():
        number += 1
    try:
        os.replace(part, aside)
        if note.exists():
            os.replace(note, aside.with_name(f"{stem}.unfinished{number}.yaml"))
    except OSError as error:
        raise _unwritable(aside, error) from error


def _unwritable(path: Path, error: OSError) -> UsageError:
    return UsageError(f"{path} cannot be written: {error.strerror or error}; make room or choose another --run folder")
