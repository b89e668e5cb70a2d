"""Signals in a CSV file: header row, comma separated, decimal point, UTF-8; read fast, faults named by column and row.

Row 1 is the first below the header.
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path

import numpy as np

from beltcomm.arrays import Column
from beltcomm.configfiles import write_text
from beltcomm.errors import DataError
from beltcomm.outside import check_columns, check_count, opened

#: Bytes read at a time.
_BLOCK = 1 << 22
csv.field_size_limit(1 << 24)  # a field of any length is data; a line has half of that at most
_LINE_END = re.compile(r"\r\n|\r|\n")
#: Rows that are written at a time.
_ROWS = 1 << 16


def read_columns(path: Path, numeric: Collection[str], *, torn: bool = False) -> dict[str, Column]:
    """All columns of a CSV file by name, in order.

    Parameters
    ----------
    path : Path
    numeric : collection of str
        Names that must hold finite numbers; other columns are float64 where they hold only numbers, text else.
    torn : bool
        The writer may have been killed, so an incomplete last row is left out.

    Raises
    ------
    DataError
        Naming file, column and row, for a file that does not exist, is no UTF-8 text, has another separator or decimal comma, no or a
        doubled column name, rows of unequal length, missing or unreadable values.
    """
    header, lines = _looked_at(path)
    names = _names(path, header)
    if not lines:
        raise DataError(f"{path} has a header and no rows; record it again")
    check_count(str(path), lines, len(names))
    try:
        if torn:
            text = _text(path)
            body = text[: text.rfind("\n") + 1].partition("\n")[2]
            if not body.strip():
                raise DataError(f"{path} has a header and no rows; record it again")
            table = np.loadtxt(io.StringIO(body), delimiter=",", comments=None, ndmin=2)
        else:  # numpy reads a file in larger pieces than a string: 15 % faster
            table = np.loadtxt(path, delimiter=",", comments=None, ndmin=2, skiprows=1, encoding=_encoding(path))
    except ValueError:
        text = _text(path)
        return _read_slowly(path, names, (text[: text.rfind("\n") + 1] if torn else text).partition("\n")[2], numeric)
    if table.shape[1] != len(names):
        raise _unequal(path, 1, table.shape[1], len(names))
    columns: dict[str, Column] = {}
    for i, name in enumerate(names):
        columns[name] = np.ascontiguousarray(table[:, i])
        columns[name].setflags(write=False)
    del table
    for name in names:
        if name in numeric and not np.all(np.isfinite(columns[name])):
            row = int(np.flatnonzero(~np.isfinite(columns[name]))[0])
            raise _unreadable(path, name, row + 1, str(columns[name][row]))
    return columns


def write_columns(path: Path, columns: Mapping[str, Column]) -> None:
    """Write columns as CSV, whole or not at all; floats come back exactly.

    Parameters
    ----------
    path : Path
        Of the CSV file.
    columns : mapping of str to Column
        By name, equally long.

    Raises
    ------
    UsageError
        When it cannot be written.
    DataError
        For names that would not come back as they are.
    """
    header = ",".join(map(_cell, columns))
    if _names(path, _LINE_END.split(header, maxsplit=1)[0]) != list(columns):
        raise DataError(
            f"{path}: the columns {', '.join(map(repr, columns))[:200]} cannot be written so that they can be read again; rename one"
        )
    write_text(path, _pieces(columns))


def _pieces(columns: Mapping[str, Column]) -> Iterator[str]:
    """The text of a CSV file, some rows at a time."""
    yield ",".join(map(_cell, columns)) + "\n"
    for first in range(0, max((len(column) for column in columns.values()), default=0), _ROWS):
        text = [map(repr if column.dtype == np.float64 else _cell, column[first : first + _ROWS].tolist()) for column in columns.values()]
        yield "\n".join([*map(",".join, zip(*text, strict=True)), ""])


def _cell(value: object) -> str:
    """A value as it stands in the file; text is quoted where it must be."""
    if isinstance(value, float):
        return repr(value)
    text = str(value)
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',"\r\n') else text


def _looked_at(path: Path) -> tuple[str, int]:
    """The first line, and how many come after it at least, 0 when they are blank.   Raises DataError for what is no text in UTF-8."""
    decoder = codecs.getincrementaldecoder("utf-8-sig")()
    header, blank, lines, seen = "", True, 0, False
    try:
        with opened(path) as file:
            while raw := file.read(_BLOCK):
                if not seen and raw[:2] in {b"\xff\xfe", b"\xfe\xff"}:
                    raise DataError(f"{path} is UTF-16 text; save it as UTF-8")
                if b"\0" in raw:
                    raise DataError(f"{path} is not a text file (it holds zero bytes); give a CSV file")
                try:
                    text = decoder.decode(raw)
                except UnicodeDecodeError as error:
                    line = lines + error.object.count(b"\n", 0, error.start) + 1
                    raise DataError(f"{path} is not UTF-8 text (line {line}); save it as UTF-8") from error
                lines += max(raw.count(b"\n"), raw.count(b"\r"))
                if not seen:
                    begin = text
                    header = _LINE_END.split(text, maxsplit=1)[0]
                    text, seen = text[len(header) :], True
                blank = blank and not text.strip()
        decoder.decode(b"", final=True)
    except FileNotFoundError as error:
        raise DataError(f"{path} does not exist; check the run folder and the name") from error
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise DataError(f"{path} is not UTF-8 text (line {lines + 1}); save it as UTF-8") from error
    if not seen or (blank and not begin.strip()):
        raise DataError(f"{path} is empty; record it again")
    return header, 0 if blank else max(lines, 1)


def _text(path: Path) -> str:
    """The whole text of a file that was looked at, its lines ended by a line feed."""
    with opened(path) as file:
        text = file.read().decode("utf-8-sig")
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def _encoding(path: Path) -> str:
    """UTF-8; the decoder that looks for a byte order mark takes as long as the reading, so it is left to files with one."""
    with opened(path) as file:
        return "utf-8-sig" if file.read(3) == codecs.BOM_UTF8 else "utf-8"


def _names(path: Path, header: str) -> list[str]:
    check_columns(str(path), header.count(",") + 1)
    try:
        names = [name.strip() for name in next(csv.reader([header]), [])]
    except csv.Error as error:
        raise DataError(f"{path}, first line: {error}; name the columns in it, separated by commas") from error
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
        columns[name] = np.array(cells, dtype=object) if None in values else np.array(values, dtype=np.float64)
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
