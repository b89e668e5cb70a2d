"""A foreign text table: separator, decimal mark, header, unit row, preamble and comments are recognised.

The rows decide: the separator and decimal mark are those under which the lines of the file's body split into the most regular
rows of numbers.  The header is the line above the first row, as a comment too; where that line holds nothing but units, the header
is the line above it.
"""

from __future__ import annotations

import csv
import gzip
import re
import zlib
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from beltcomm.errors import DataError
from beltcomm.foreign.table import Column, Decimal, Separator, Table
from beltcomm.quantities import UNITS

_SEPARATORS: dict[Separator, str] = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " "}
_COMMENT = ("#", "%", "//")
_MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "inf", "-inf", "+inf"}
#: Lines looked at to recognise the format, and the share of them that must be rows of one length.
_SAMPLED_LINES = 60
_REGULAR_SHARE = 0.8
_UNIT_WORDS = {other for unit in UNITS.values() for other in unit.others} | {"v", "%", "-", "1", "counts", "inc", "bool", "w", "k"}


class _Line(NamedTuple):
    number: int
    text: str


class _Format(NamedTuple):
    separator: str
    decimal_comma: bool
    width: int
    numeric: tuple[bool, ...]

    def fields(self, line: str) -> list[str]:
        return _split(line, self.separator)

    def number(self, text: str) -> float | None:
        return _number(text, self.decimal_comma)

    def is_row(self, fields: Sequence[str]) -> bool:
        """Whether the numeric columns hold numbers or nothing, and one of them a number."""
        if len(fields) != self.width:
            return False
        cells = [cell for cell, numeric in zip(fields, self.numeric, strict=True) if numeric]
        values = [self.number(cell) for cell in cells]
        return any(value is not None and np.isfinite(value) for value in values) and all(
            value is not None or cell.lower() in _MISSING for cell, value in zip(cells, values, strict=True)
        )

    def words(self) -> str:
        name = next(name for name, mark in _SEPARATORS.items() if mark == self.separator)
        return f"columns separated by {name}, decimal {'comma' if self.decimal_comma else 'point'}"


def read_text_table(path: Path, separator: Separator | None, decimal: Decimal | None, skip_lines: int, torn_rows: bool) -> Table:
    """As :func:`beltcomm.foreign.table.read_table`, for text."""
    text, encoding = _text(path)
    lines = [_Line(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip() and number > skip_lines]
    content = [line for line in lines if not line.text.lstrip().startswith(_COMMENT)]
    if not content:
        raise DataError(f"{path} holds no rows")
    form = _recognised(path, content, separator, decimal)
    begin = next((i for i, line in enumerate(content) if form.is_row(form.fields(line.text))), None)
    if begin is None:
        raise DataError(f"{path} holds no row of numbers ({form.words()}); give --separator, --decimal or --skip-lines")
    above = [line for line in lines if line.number < content[begin].number]
    names, units, header_line = _header(path, above, form)
    header = f"header in line {header_line}, " if names else ""
    notes = [f"{form.words()}, {header}first row in line {content[begin].number}"]
    if encoding != "utf-8":
        notes.append(f"read as {encoding} text")
    if not names:
        names = [f"c{j}" for j in range(1, form.width + 1)]
        notes.append(f"it has no header: its columns are called c1 to c{form.width}")
    rows = content[begin:]
    if text[-1] not in "\r\n" and len(rows) > 1:
        rows = rows[:-1]
        notes.append("its last line has no end and was left out: it may be torn")
    columns, remarks = _columns(path, rows, form, names, torn_rows)
    stated = {name: unit for name, unit in zip(names, units, strict=True) if unit} if units else {}
    return Table(str(path), columns, stated, (*notes, *remarks))


def _text(path: Path) -> tuple[str, str]:
    try:
        raw = path.read_bytes()
        if raw[:2] == b"\x1f\x8b":
            raw = gzip.decompress(raw)
    except (OSError, EOFError, zlib.error) as error:
        raise DataError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    if not raw.strip():
        raise DataError(f"{path} is empty")
    if raw[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        return raw.decode("utf-16", errors="replace"), "utf-16"
    if b"\0" in raw[:4096]:
        raise DataError(f"{path} is not a text file (it holds zero bytes); give CSV, .mat or .npz")
    try:
        return raw.decode("utf-8-sig"), "utf-8"
    except UnicodeDecodeError:  # the degree sign of an older Windows program
        return raw.decode("cp1252", errors="replace"), "cp1252"


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    if '"' in line:
        return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def _number(text: str, decimal_comma: bool) -> float | None:
    """The number in a cell, None for text; under a decimal comma a point is text, for it would separate thousands."""
    if decimal_comma:
        if "." in text:
            return None
        text = text.replace(",", ".")
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        return None


def _recognised(path: Path, content: Sequence[_Line], separator: Separator | None, decimal: Decimal | None) -> _Format:
    """The format under which the most of the file's cells are numbers, in rows of one length."""
    body = content[len(content) // 4 :]  # a preamble stands at the beginning
    sample = [body[i].text for i in np.unique(np.linspace(0, len(body) - 1, _SAMPLED_LINES).astype(int))]
    marks = [_SEPARATORS[separator]] if separator else [",", ";", "\t", " "]
    best: tuple[float, _Format] | None = None
    for mark in marks:
        for comma in [False, True] if decimal is None else [decimal == "comma"]:
            if mark == "," and comma:
                continue
            found = _tried(sample, mark, comma)
            if found is not None and (best is None or found[0] > best[0] + 1e-9):
                best = found
    if best is None and (len(content) < 3 or all(_number(line.replace(",", "."), False) is not None for line in sample)):
        what = "holds no rows" if len(content) < 3 else "has one column only"
        raise DataError(f"{path} {what}; torque and position are needed, one row per sample")
    if best is None:
        raise DataError(
            f"{path} is no table of numbers: no separator (comma, semicolon, tab, space) gives rows of one length; "
            "give --separator, --decimal or --skip-lines"
        )
    return best[1]


def _tried(sample: Sequence[str], mark: str, comma: bool) -> tuple[float, _Format] | None:
    """Share of numbers among the cells under one format, None when the lines make no rows."""
    rows = [_split(line, mark) for line in sample]
    width, count = Counter(len(row) for row in rows).most_common(1)[0]
    if width < 2 or count < _REGULAR_SHARE * len(rows):
        return None
    rows = [row for row in rows if len(row) == width]
    filled = [[cell for cell in column if cell.lower() not in _MISSING] for column in zip(*rows, strict=True)]
    numbers = [[_number(cell, comma) is not None for cell in column] for column in filled]
    # some cells may be damaged; a column of states or dates holds hardly any number
    numeric = tuple(sum(column) > 0.5 * len(column) for column in numbers)
    cells = sum(map(len, filled))
    if not any(numeric):
        return None
    return sum(map(sum, numbers)) / cells, _Format(mark, comma, width, numeric)


def _header(path: Path, above: Sequence[_Line], form: _Format) -> tuple[list[str], list[str], int]:
    """Names and units of the columns from the lines above the first row, empty lists where there are none; the line of the names."""
    candidates: list[list[str]] = []
    numbers: list[int] = []
    for line in reversed(above):
        commented = line.text.lstrip().startswith(_COMMENT)
        text = line.text.lstrip().lstrip("#%/").strip() if commented else line.text
        fields = form.fields(text)
        if form.separator == " " and len(fields) != form.width:  # names with a blank inside, more blanks between them
            fields = re.split(r"\s{2,}|\t", text.strip())
        if len(fields) == form.width - 1 and not commented:  # rows that end in a separator
            fields = [*fields, ""]
        if len(fields) != form.width or all(form.number(cell) is not None for cell in fields if cell):
            if commented and not candidates:
                continue
            if not candidates and len(fields) > 1:
                raise _other_length(path, line, len(fields), form)
            break
        candidates.append(fields)
        numbers.append(line.number)
        if len(candidates) == 2:
            break
    if not candidates:
        return [], [], 0
    if len(candidates) == 2 and all(_is_unit(cell) for cell in candidates[0]):
        return _unique(candidates[1]), [cell.strip("[]() ") for cell in candidates[0]], numbers[1]
    return _unique(candidates[0]), [], numbers[0]


def _other_length(path: Path, line: _Line, names: int, form: _Format) -> DataError:
    remedy = "a decimal comma between commas cannot be read; export with semicolons" if form.width in {2 * names, 2 * names - 1} else (
        "leave out what stands above the header with --skip-lines, or give --separator"
    )  # fmt: skip
    return DataError(f"{path}: line {line.number} above the first row has {names} names, the rows have {form.width} values; {remedy}")


def _is_unit(cell: str) -> bool:
    plain = cell.strip("[]() ").replace(" ", "").replace("·", "").replace("²", "2").replace("µ", "u").lower()
    return not plain or plain in _UNIT_WORDS or (cell.startswith("[") and cell.endswith("]"))


def _unique(names: Sequence[str]) -> list[str]:
    """Names without blanks at the ends; an empty one becomes c and its number, a repeated one gets a number."""
    found: list[str] = []
    for number, name in enumerate(names, start=1):
        plain = name.strip().strip('"') or f"c{number}"
        copies = sum(plain == known or known.startswith(f"{plain}_") for known in found)
        found.append(f"{plain}_{copies + 1}" if plain in found else plain)
    return found


def _columns(
    path: Path, rows: Sequence[_Line], form: _Format, names: Sequence[str], torn_rows: bool
) -> tuple[dict[str, Column], list[str]]:
    if all(form.numeric):
        try:
            body = (line.text.replace(",", ".") if form.decimal_comma else line.text for line in rows)
            delimiter = None if form.separator == " " else form.separator
            table = np.loadtxt(body, delimiter=delimiter, comments=None, ndmin=2, dtype=np.float64)
            if table.shape[1] == form.width and (not form.decimal_comma or not any("." in line.text for line in rows)):
                table[np.isinf(table)] = np.nan
                return {name: table[:, i] for i, name in enumerate(names)}, []
        except ValueError:
            pass
    return _slowly(path, rows, form, names, torn_rows)


def _slowly(path: Path, rows: Sequence[_Line], form: _Format, names: Sequence[str], torn_rows: bool) -> tuple[dict[str, Column], list[str]]:
    """Cell by cell: with text columns, missing values, a footer or a torn last line."""
    split = [form.fields(line.text) for line in rows]
    end = len(rows)
    while end and not (len(split[end - 1]) == form.width and form.is_row(split[end - 1])):
        end -= 1
    remarks = [f"left out from line {rows[end].number} on: {len(rows) - end} lines that are no rows"] if end < len(rows) else []
    whole = [i for i in range(end) if len(split[i]) == form.width]
    if len(whole) < end:
        bad = next(i for i in range(end) if len(split[i]) != form.width)
        if not torn_rows:
            raise DataError(
                f"{path}: line {rows[bad].number} has {len(split[bad])} values, the rows have {form.width}; it is torn or begins another "
                "record: --rows takes a part of the file, --drop-incomplete leaves such lines out"
            )
        remarks.append(f"{end - len(whole)} torn lines left out, the first is line {rows[bad].number}")
    columns: dict[str, Column] = {}
    for j, name in enumerate(names):
        cells = [split[i][j] for i in whole]
        if not form.numeric[j]:
            columns[name] = np.array(cells)
            continue
        values = [form.number(cell) for cell in cells]
        odd = [i for i, (cell, value) in enumerate(zip(cells, values, strict=True)) if value is None and cell.lower() not in _MISSING]
        if odd:
            line, cell = rows[whole[odd[0]]].number, cells[odd[0]][:30]
            if cell.strip('"') == name or names.count(cell):
                raise DataError(f"{path}: the header stands again in line {line}: a second record begins there; take a part with --rows")
            remarks.append(f"{name} is no number in {len(odd)} rows, first {cell!r} in line {line}: taken as missing")
        column = np.array([np.nan if value is None else value for value in values])
        column[np.isinf(column)] = np.nan
        columns[name] = column
    return columns, remarks
