"""A foreign text table: separator, decimal mark, header, unit row, preamble and comments are recognised.

The rows decide: the separator and decimal mark are those under which the lines of the file's body split into the most regular
rows of numbers.  What stands above the first row is :mod:`beltcomm.foreign.heading`'s.
"""

from __future__ import annotations

import io
import re
import zlib
from bisect import bisect
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from beltcomm.arrays import Column
from beltcomm.errors import DataError
from beltcomm.foreign.heading import Heading, OtherLength, RowShape, TextLine, heading_of
from beltcomm.foreign.longtable import unstacked
from beltcomm.foreign.ownclocks import with_own_clocks
from beltcomm.foreign.table import Decimal, Separator, Table
from beltcomm.foreign.textformat import MISSING, Format, plain_numbers, recognised, wide_encoding
from beltcomm.outside import blocks, check_count, text_blocks, unreadable


class RowSpan(NamedTuple):
    """Rows that are wanted, counted from 1: what is torn elsewhere does not matter."""

    first: int = 1
    last: int = 2**62


EVERY = RowSpan()
_OTHER_ENDS = re.compile("[\x0b\x0c\x1c-\x1e\x85\u2028\u2029]")
_LINE = re.compile(r"[^\r\n]*(?:\r\n|\r|\n)|[^\r\n]+")
_COMMENT = ("#", "%", "//")

#: Lines at the beginning among which the first row is looked for; of up to twice as many, from everywhere, the format is recognised.
_HEAD_LINES = 4096

#: Shorter rows at the end that are signals that had ended, and no footer.
_FEWEST_SHORT = 3


def read_text_table(
    path: Path, separator: Separator | None, decimal: Decimal | None, skip_lines: int, torn_rows: bool, part: RowSpan
) -> Table:
    """As :func:`beltcomm.foreign.files.read_table`, for text; read twice, piece by piece: no more is kept in memory than its numbers.

    Parameters
    ----------
    path : Path
    separator, decimal : Separator or None
        None recognises it.
    skip_lines : int
        At the beginning.
    torn_rows : bool
        True if rows of another length are left out.
    part : RowSpan
        Rows that are kept.

    Raises
    ------
    DataError
        For a file that is no table of numbers.
    """
    look = _looked_at(path, skip_lines)
    content = [line for line in look.sample if not line.text.lstrip().startswith(_COMMENT)]
    if not content:
        raise DataError(f"{path} holds no rows")
    lines = [line for line in look.head if line.text.strip()]
    form = recognised(path, content, lines, separator, decimal)
    begin = _first_row(lines, form)
    if begin is None:
        where = f" in its first {_HEAD_LINES} lines" if len(look.head) == _HEAD_LINES else ""
        raise DataError(f"{path} holds no row of numbers{where} ({form.words()}); give --separator, --decimal or --skip-lines")
    heading = _heading(path, lines, begin, form)
    header = f"header in line {heading.line}, " if heading.line else ""
    notes = [f"{form.words()}, {header}first row in line {begin.number}"]
    if look.encoding != "utf-8-sig":
        notes.append(f"read as {look.encoding} text")
    names = _unique(heading.names) or [f"c{j}" for j in range(1, form.width + 1)]
    if not heading.names:
        notes.append(f"it has no header: its columns are called c1 to c{form.width}")
    rows = TextRows(path, form, names, torn_rows, part)
    number, without_end = 0, False
    for piece in _pieces(path, look.encoding):
        first, number = number + 1, number + len(_lines_in(piece))
        if number < begin.number:
            continue
        if first < begin.number:
            piece = "".join(_lines_in(piece, keepends=True)[begin.number - first :])
            first = begin.number
        if piece[-1] not in "\r\n" and number > begin.number:
            whole = _lines_in(piece, keepends=True)[:-1]
            without_end, piece = bool(piece[sum(map(len, whole)) :].strip()), "".join(whole)
        rows.add(first, piece)
    if without_end:
        notes.append("its last line has no end and was left out: it may be torn")
    columns, remarks = rows.columns()
    stated = {name: unit for name, unit in zip(names, heading.units, strict=False) if unit}
    table = Table(str(path), columns, stated, (*notes, *remarks))
    return with_own_clocks(unstacked(table), heading)


def _first_row(lines: Sequence[TextLine], form: Format) -> TextLine | None:
    """The first line that is a row, or that of numbers just above it which has lost some."""
    at = next(
        (k for k, line in enumerate(lines) if not line.text.lstrip().startswith(_COMMENT) and form.is_row(form.fields(line.text))), -1
    )
    while at > 0 and len(above := form.fields(lines[at - 1].text)) > 1 and form.is_torn(above):
        at -= 1
    return lines[at] if at >= 0 else None


def _heading(path: Path, lines: Sequence[TextLine], begin: TextLine, form: Format) -> Heading:
    firsts = [form.number(form.fields(line.text)[0].strip('"')) for line in lines if line.number >= begin.number][:4]
    counted = (
        len(firsts) > 2 and firsts[0] in (0.0, 1.0) and all(b is not None and a is not None and b - a == 1.0 for a, b in pairwise(firsts))
    )
    shape = RowShape(form.width, form.fields, form.number, form.blank, form.separator == " ", counted)
    try:
        return heading_of([line for line in lines if line.number < begin.number], shape, _COMMENT)
    except OtherLength as error:
        more = form.width in {2 * error.names, 2 * error.names - 1}
        remedy = "a decimal comma between commas cannot be read; export with semicolons" if more else (
            "leave out what stands above the header with --skip-lines, or give --separator"
        )  # fmt: skip
        raise DataError(
            f"{path}: line {error.line.number} above the first row has {error.names} names, the rows have {form.width} values; {remedy}"
        ) from error


class _Look(NamedTuple):
    """encoding : of the file.   head : its first lines, blank ones too.   sample : lines with content, from everywhere in it."""

    encoding: str
    head: list[TextLine]
    sample: list[TextLine]


def _looked_at(path: Path, skip_lines: int) -> _Look:
    """The whole file once, for what it is and what its lines look like.   Raises DataError."""
    try:
        begin = next(blocks(path), b"")
        if wide := wide_encoding(begin):
            return _sampled(path, wide, skip_lines)
        if b"\0" in begin[:4096]:
            raise DataError(f"{path} is not a text file (it holds zero bytes); give CSV, .mat or .npz")
        try:
            return _sampled(path, "utf-8-sig", skip_lines)
        except UnicodeDecodeError:  # the degree sign of an older Windows program
            return _sampled(path, "cp1252", skip_lines)
    except (OSError, EOFError, zlib.error) as error:
        raise DataError(f"{path} cannot be read: {unreadable(error)}") from error


def _sampled(path: Path, encoding: str, skip_lines: int) -> _Look:
    head: list[TextLine] = []
    sample: list[TextLine] = []
    number, every, blank = 0, 1, True
    for piece in _pieces(path, encoding):
        lines = _lines_in(piece)
        blank = blank and not piece.strip()
        if len(head) < _HEAD_LINES:
            begun = [TextLine(number + k, text) for k, text in enumerate(lines, start=1) if number + k > skip_lines]
            head += begun[: _HEAD_LINES - len(head)]
        sample += [
            TextLine(number + k + 1, lines[k])
            for k in range(-number % every, len(lines), every)
            if number + k >= skip_lines and lines[k].strip()
        ]
        number += len(lines)
        while len(sample) > 2 * _HEAD_LINES:
            sample, every = [line for line in sample if (line.number - 1) % (2 * every) == 0], 2 * every
    if blank:
        raise DataError(f"{path} is empty")
    return _Look(encoding, head, sample)


def _lines_in(text: str, *, keepends: bool = False) -> list[str]:
    """The lines of a text; what Python takes for ends of lines besides, a file of measurements has inside its words."""
    if _OTHER_ENDS.search(text) is None:
        return text.splitlines(keepends)
    return [match[0] if keepends else match[0].rstrip("\r\n") for match in _LINE.finditer(text)]


def _pieces(path: Path, encoding: str) -> Iterator[str]:
    return map(plain_numbers, text_blocks(path, encoding, "strict" if encoding == "utf-8-sig" else "replace"))


def _unique(names: Sequence[str]) -> list[str]:
    """Names without blanks at the ends; an empty one becomes c and its number, a repeated one gets a number."""
    found: dict[str, None] = {}
    for number, name in enumerate(names, start=1):
        plain = name.strip().strip('"') or f"c{number}"
        copies = sum(plain == known or known.startswith(f"{plain}_") for known in found) if plain in found else 0
        while (free := f"{plain}_{copies + 1}" if copies else plain) in found:
            copies += 1
        found[free] = None
    return list(found)


class TextRows:
    """The rows of a text table, as they come; :meth:`columns` at the end."""

    def __init__(self, path: Path, form: Format, names: Sequence[str], torn_rows: bool, part: RowSpan) -> None:
        self._path, self._form, self._names, self._torn_rows, self._part = path, form, names, torn_rows, part
        self._parts: list[list[Column]] = [[] for _ in names]
        #: Lines that are no rows: a footer, unless a row comes after them.
        self._waiting: list[tuple[TextLine, list[str]]] = []
        self._torn: list[int] = []
        #: Remarks beside or between the rows: line and words.
        self._said: list[tuple[int, str]] = []
        self._odd: dict[int, tuple[int, str, int]] = {}
        self._count = 0

    def add(self, first: int, text: str) -> None:
        """Take whole lines.

        Parameters
        ----------
        first : int
            Number of the first line in the file.
        text : str

        Raises
        ------
        DataError
            For torn ones, a second header, too many values.
        """
        if not text.strip():
            return
        table = self._numbers(text)
        if table is None:
            self._slowly([TextLine(first + k, line) for k, line in enumerate(_lines_in(text))])
            return
        if self._waiting:
            self._keep(self._waiting)
            self._waiting = []
        table[np.isinf(table)] = np.nan
        self._append([np.ascontiguousarray(column) for column in table.T])

    def columns(self) -> tuple[dict[str, Column], list[str]]:
        """All columns by name, and sentences on what was left out; only once."""
        remarks = []
        ended = {len(fields) for _, fields in self._waiting}
        if len(self._waiting) >= _FEWEST_SHORT and len(ended) == 1 and 1 < (length := ended.pop()) < self._form.width:
            remarks.append(f"from line {self._waiting[0][0].number} on the rows have {length} values: the other signals had ended")
            padded = [(line, [*fields, *[""] * (self._form.width - length)]) for line, fields in self._waiting]
            if all(self._form.is_row(fields) for _, fields in padded):
                self._keep(padded)
                self._waiting = []
            else:
                remarks.pop()
        if self._waiting:
            remarks.append(f"left out from line {self._waiting[0][0].number} on: {len(self._waiting)} lines that are no rows")
        if self._torn:
            remarks.append(f"{len(self._torn)} torn lines left out, the first is line {self._torn[0]}")
        if self._said:
            words = f"{self._said[0][1][:60]!r} in line {self._said[0][0]}"
            remarks.append(f"{len(self._said)} remarks in the rows are passed over, the first is {words}")
        for j, (count, cell, line) in sorted(self._odd.items()):
            remarks.append(f"{self._names[j]} is no number in {count} rows, first {cell!r} in line {line}: taken as missing")
        found: dict[str, Column] = {}
        for name, parts in zip(self._names, self._parts, strict=True):
            found[name] = np.concatenate(parts) if parts else np.zeros(0)
            parts.clear()  # never all columns twice in memory
        return found, remarks

    def _numbers(self, text: str) -> Column | None:
        """The table of a piece in which every cell is a number; None for any other."""
        form = self._form
        if not all(form.numeric) or (form.decimal_comma and "." in text):
            return None
        body = text.replace(",", ".") if form.decimal_comma else text
        delimiter = None if form.separator == " " else form.separator
        try:
            table = np.loadtxt(io.StringIO(body, newline=None), delimiter=delimiter, comments=None, ndmin=2, dtype=np.float64)
        except ValueError:
            return None
        return table if table.shape[1] == form.width else None

    def _slowly(self, lines: Sequence[TextLine]) -> None:
        """Cell by cell: with text columns, missing values, a footer or a torn last line."""
        form = self._form
        rows = [
            (line, self._without_remark(line, form.fields(line.text)))
            for line in lines
            if line.text.strip() and not line.text.lstrip().startswith(_COMMENT)
        ]
        end = len(rows)
        while end and not form.is_row(rows[end - 1][1]):
            end -= 1
        if end:
            self._keep([*self._waiting, *rows[:end]])
            self._waiting = []
        self._waiting += rows[end:]

    def _without_remark(self, line: TextLine, fields: list[str]) -> list[str]:
        """The cells of a line without words behind them that are no value."""
        form = self._form
        if len(fields) > form.width:
            more = [cell for cell in fields[form.width :] if cell]
            if all(form.number(cell) is None for cell in more) and form.is_row(fields[: form.width]):
                self._said += [(line.number, " ".join(more))] * bool(more)
                return fields[: form.width]
        return fields

    def _keep(self, rows: Sequence[tuple[TextLine, list[str]]]) -> None:
        form, path = self._form, self._path
        whole = [row for row in rows if form.is_whole(row[1]) and not self._is_remark(*row)]
        torn = [row for row in rows if not form.is_whole(row[1]) and not self._is_remark(*row)]
        self._said += [(line.number, line.text.strip()) for line, fields in rows if self._is_remark(line, fields)]
        if torn:
            lines = [line.number for line, _ in whole]
            before = [self._count + bisect(lines, line.number) for line, _ in torn]
            inside = [k for k, count in enumerate(before) if self._part.first <= count < self._part.last]
            if inside and not self._torn_rows:
                (bad, fields), count = torn[inside[0]], before[inside[0]]
                wide = f"has {len(fields)} values, the rows have {form.width}"
                has = f"begins with {fields[0][:30]!r}, the rows with numbers" if len(fields) == form.width else wide
                raise DataError(
                    f"{path}: line {bad.number} {has}; it is torn or begins another "
                    f"record: --rows :{count} or --rows {count + 1}: takes a part of the file, --drop-incomplete leaves such lines out"
                )
            self._torn += [line.number for line, _ in torn]
        if torn and self._torn_rows and not form.has_text:  # they keep their places, for time may be a count of the rows
            whole = [(line, fields if form.is_whole(fields) else [""] * form.width) for line, fields in rows if self._stays(line, fields)]
        cells = list(zip(*(fields for _, fields in whole), strict=True)) or [()] * form.width
        self._append([self._column(j, cells[j], whole) for j in range(form.width)])

    def _stays(self, line: TextLine, fields: Sequence[str]) -> bool:
        """True for a row, or one that has lost some of its numbers."""
        return self._form.is_torn(fields) or (self._form.is_whole(fields) and not self._is_remark(line, fields))

    def _is_remark(self, line: TextLine, fields: Sequence[str]) -> bool:
        """True if a line between rows is words alone; the header again is none, for another record begins there."""
        words = [cell for cell in fields if cell]
        if not words or (len(words) > 1 and self._form.separator != " ") or any(word.strip('"') in self._names for word in words):
            return False
        return not any(character.isdigit() for character in line.text) or all(self._form.number(word) is None for word in words)

    def _column(self, j: int, cells: Sequence[str], rows: Sequence[tuple[TextLine, list[str]]]) -> Column:
        if not self._form.numeric[j]:
            return np.array(cells, dtype=object)  # one long cell would widen a fixed width in every row
        values = [self._form.number(cell) for cell in cells]
        odd = [i for i, (cell, value) in enumerate(zip(cells, values, strict=True)) if value is None and cell.lower() not in MISSING]
        if odd:
            line, cell = rows[odd[0]][0].number, cells[odd[0]][:30]
            at = self._count + odd[0] + 1
            if (cell.strip('"') == self._names[j] or self._names.count(cell)) and self._part.first <= at <= self._part.last:
                raise DataError(
                    f"{self._path}: the header stands again in line {line}: a second record begins there; take a part with "
                    f"--rows :{at - 1} or --rows {at + 1}:"
                )
            count, known, first = self._odd.get(j, (0, cell, line))
            self._odd[j] = (count + len(odd), known, first)
        column = np.array([np.nan if value is None else value for value in values])
        column[np.isinf(column)] = np.nan
        return column

    def _append(self, columns: Sequence[Column]) -> None:
        self._count += len(columns[0])
        check_count(str(self._path), self._count, len(columns))
        for part, column in zip(self._parts, columns, strict=True):
            part.append(column)
