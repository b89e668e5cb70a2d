"""Signals in a CSV file: header row, comma separated, decimal point, UTF-8; read fast, faults named by column and row.

Row 1 is the first below the header.
"""

from __future__ import annotations

import codecs
import csv
import io
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltcomm.configfiles import write_text
from beltcomm.errors import DataError

Column = NDArray[Any]


def read_columns(path: Path, numeric: Collection[str], *, torn: bool = False) -> dict[str, Column]:
    """All columns of a CSV file by name, in order.

    numeric : names that must hold finite numbers; other columns are float64 where they hold only numbers, text else.
    torn : the writer may have been killed, so an incomplete last row is left out.
    Raises DataError, naming file, column and row, for a file that does not exist, is no UTF-8 text, has another separator or
    decimal comma, no or a doubled column name, rows of unequal length, missing or unreadable values.
    """
    text = _text(path)
    if torn:
        text = text[: text.rfind("\n") + 1]
    header, _, body = text.partition("\n")
    names = _names(path, header)
    if not body.strip():
        raise DataError(f"{path} has a header and no rows; record it again")
    try:
        # numpy reads a file in larger pieces than a string: 15 % faster
        source = io.StringIO(body) if torn else path
        table = np.loadtxt(source, delimiter=",", comments=None, ndmin=2, skiprows=0 if torn else 1, encoding=_encoding(path))
    except ValueError:
        return _read_slowly(path, names, body, numeric)
    if table.shape[1] != len(names):
        raise _unequal(path, 1, table.shape[1], len(names))
    columns: dict[str, Column] = {name: table[:, i] for i, name in enumerate(names)}
    for name in names:
        if name in numeric and not np.all(np.isfinite(columns[name])):
            row = int(np.flatnonzero(~np.isfinite(columns[name]))[0])
            raise _unreadable(path, name, row + 1, str(columns[name][row]))
    return columns


def write_columns(path: Path, columns: Mapping[str, Column]) -> None:
    """Write columns as CSV, whole or not at all; floats come back exactly.   Raises UsageError when it cannot be written."""
    text = [map(_cell, column.tolist()) for column in columns.values()]
    rows = map(",".join, zip(*text, strict=True))
    write_text(path, "\n".join([",".join(map(_cell, columns)), *rows, ""]))


def _cell(value: object) -> str:
    """A value as it stands in the file; text is quoted where it must be."""
    if isinstance(value, float):
        return repr(value)
    text = str(value)
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',"\r\n') else text


def _text(path: Path) -> str:
    try:
        raw = path.read_bytes()
    except FileNotFoundError as error:
        raise DataError(f"{path} does not exist; check the run folder and the name") from error
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
    if not raw.strip():
        raise DataError(f"{path} is empty; record it again")
    if raw[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        raise DataError(f"{path} is UTF-16 text; save it as UTF-8")
    if b"\0" in raw:
        raise DataError(f"{path} is not a text file (it holds zero bytes); give a CSV file")
    try:
        text = raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise DataError(f"{path} is not UTF-8 text (line {line}); save it as UTF-8") from error
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _encoding(path: Path) -> str:
    """UTF-8; the decoder that looks for a byte order mark takes as long as the reading, so it is left to files with one."""
    with path.open("rb") as file:
        return "utf-8-sig" if file.read(3) == codecs.BOM_UTF8 else "utf-8"


def _names(path: Path, header: str) -> list[str]:
    names = [name.strip() for name in next(csv.reader([header]), [])]
    for separator, word in ((";", "semicolons"), ("\t", "tabs")):
        if header.count(separator) > header.count(","):
            raise DataError(f"{path} separates its columns by {word}; separate them by commas, with '.' as the decimal point")
    if any(_number(name) is not None for name in names):
        raise DataError(f"{path} has no header row (its first line is {header[:40]!r}); name the columns in the first line")
    for name in names:
        if name and names.count(name) > 1:
            raise DataError(f"{path} has two columns called {name}; rename one")
    if "" in names[:-1]:
        raise DataError(f"{path} has no name for column {names.index('') + 1}; name it in the first line")
    return names


def _read_slowly(path: Path, names: list[str], body: str, numeric: Collection[str]) -> dict[str, Column]:
    """Row by row, for files with text columns, and to name the first fault."""
    rows: list[list[str]] = []
    try:
        for row in csv.reader(io.StringIO(body)):
            if row:
                rows.append(row)
    except csv.Error as error:
        raise DataError(f"{path}, row {len(rows) + 1}: {error}") from error
    for number, row in enumerate(rows, start=1):
        if len(row) != len(names):
            raise _unequal(path, number, len(row), len(names))
    columns: dict[str, Column] = {}
    for name, cells in zip(names, zip(*rows, strict=True), strict=True):
        values = [_number(cell) for cell in cells]
        for number, (cell, value) in enumerate(zip(cells, values, strict=True), start=1):
            if name in numeric and (value is None or not np.isfinite(value)):
                raise _unreadable(path, name, number, cell)
        columns[name] = np.array(cells) if None in values else np.array(values, dtype=np.float64)
    return columns


def _number(text: str) -> float | None:
    """The number a cell holds; None for text.  As numpy reads it: no underscores."""
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        return None


def _unreadable(path: Path, name: str, row: int, cell: str) -> DataError:
    place = f"{path}: {name} in row {row}"
    if not cell.strip() or cell.strip().lower() == "nan":
        return DataError(f"{place} is missing; leave out the rows without a value, or the column where it is optional")
    if "," in cell and _number(cell.replace(",", ".")) is not None:
        return DataError(f"{place} is {cell!r}; write the decimal point as '.'")
    return DataError(f"{place} is {cell[:40]!r}, not a finite number; correct it or leave out the row")


def _unequal(path: Path, row: int, found: int, wanted: int) -> DataError:
    hint = "a decimal comma? write '.'" if found in {2 * wanted, 2 * wanted - 1} else "is the file cut off?"
    return DataError(f"{path}: row {row} has {found} values, the header {wanted} names; {hint}")
