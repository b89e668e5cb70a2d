"""The format of a text table: separator, decimal mark and columns of numbers, under which its lines make the most regular rows."""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from beltcomm.errors import DataError
from beltcomm.foreign.heading import TextLine
from beltcomm.foreign.table import Decimal, Separator
from beltcomm.outside import check_columns

_SEPARATORS: dict[Separator, str] = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "space": " "}
#: What stands for a missing value.
MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "inf", "-inf", "+inf"}
#: Lines looked at to recognise the format, and the share of them that must be rows of one length.
_SAMPLED_LINES = 60
_REGULAR_SHARE = 0.8
#: Share of the rows that have words in a column of none: keys of a block between two records, remarks.
_SELDOM = 0.01
#: Thousands in groups of three under a decimal comma, and under a decimal point.
_GROUPED = {
    True: re.compile(r"[-+]?\d{1,3}(\.\d{3})+(,\d*)?([eE][-+]?\d+)?"),
    False: re.compile(r"[-+]?\d{1,3}(,\d{3})+(\.\d*)?([eE][-+]?\d+)?"),
}
#: Marks that part thousands and nothing else, between digits: apostrophes, narrow and unbroken blanks; and a minus as books print it.
_MARKS = "'\u2019\u00a0\u2007\u2009\u202f"
_PARTS = re.compile(rf"(?<=\d)[{_MARKS}](?=\d{{3}}(?!\d))")
_MINUS = "\u2212"
#: A number as Fortran writes it, D before the exponent; and one with its unit behind it.
_DOUBLE = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[dD][-+]?\d{1,3}")
_WITH_UNIT = re.compile(r"[-+]?\d+([.,]\d+)?\s*[a-zA-Z°µ%][a-zA-Z0-9°/·*²%]{0,8}")
#: Columns at least, and rows at most, of a table that lies on its side.
_LYING = (50, 12)
#: Bytes at the beginning that tell two bytes a letter, and share of them that are zero there.
_WIDE, _ZEROS = 400, 0.9
#: Quotes in a line of more than 100 000 characters beyond which they are no marks: a million would take minutes.
_MOST_QUOTES = 1000


def wide_encoding(begin: bytes) -> str:
    """The encoding of a text with two bytes a letter, by its mark or by the zeros of Latin letters; "" for another one.

    Parameters
    ----------
    begin : bytes
        First bytes of the file.
    """
    if begin[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        return "utf-16"
    for name, first in (("utf-16-le", 0), ("utf-16-be", 1)):
        letters, zeros = begin[first:_WIDE:2], begin[1 - first : _WIDE : 2]
        if len(zeros) > 3 and zeros.count(0) > _ZEROS * len(zeros) and not letters.count(0):
            return name
    return ""


def plain_numbers(text: str) -> str:
    """A text with its numbers as programs write them: thousands not parted by marks that nothing else has, a minus that is one.

    Parameters
    ----------
    text : str
        Of a file.
    """
    if any(mark in text for mark in _MARKS):  # a table without them is looked through for nothing, which takes as long as to read it
        text = _PARTS.sub("", text)
    return text.replace(_MINUS, "-")


class Format(NamedTuple):
    """numeric, blank : of each column, whether it holds numbers, or nothing at all.   grouped : thousands are parted."""

    separator: str
    decimal_comma: bool
    width: int
    numeric: tuple[bool, ...]
    blank: tuple[bool, ...] = ()
    grouped: bool = False

    @property
    def has_text(self) -> bool:
        """True if some column holds words."""
        return not all(numeric or blank for numeric, blank in zip(self.numeric, self.blank, strict=True))

    def fields(self, line: str) -> list[str]:
        """The cells of a line."""
        return _split(line, self.separator)

    def number(self, text: str) -> float | None:
        """The number in a cell, None for text."""
        return _number(text, self.decimal_comma, self.grouped)

    def is_row(self, fields: Sequence[str]) -> bool:
        """True where the numeric columns hold numbers or nothing, and one of them a number."""
        if len(fields) != self.width:
            return False
        if any(cell and empty for cell, empty in zip(fields, self.blank, strict=True)):
            return False
        cells = [cell for cell, numeric in zip(fields, self.numeric, strict=True) if numeric]
        values = [self.number(cell) for cell in cells]
        return any(value is not None and np.isfinite(value) for value in values) and all(
            value is not None or cell.lower() in MISSING for cell, value in zip(cells, values, strict=True)
        )

    def is_whole(self, fields: Sequence[str]) -> bool:
        """True for as many cells as a row has, without a key before its numbers as a block of properties has."""
        before = self.numeric.index(True) if True in self.numeric else 0
        keyed = any(cell and empty for cell, empty in zip(fields[:before], self.blank[:before], strict=False))
        return len(fields) == self.width and not keyed

    def is_torn(self, fields: Sequence[str]) -> bool:
        """True for numbers alone that are not as many as in a row."""
        filled = [cell for cell in fields if cell.lower() not in MISSING]
        return len(fields) != self.width and bool(filled) and all(self.number(cell) is not None for cell in filled)

    def words(self) -> str:
        """For a note."""
        name = next(name for name, mark in _SEPARATORS.items() if mark == self.separator)
        return f"columns separated by {name}, decimal {'comma' if self.decimal_comma else 'point'}{', thousands parted' * self.grouped}"


def _split(line: str, separator: str) -> list[str]:
    if separator == " ":
        return line.split()
    if '"' in line and (len(line) <= 100_000 or line.count('"') <= _MOST_QUOTES):
        return [cell.strip() for cell in next(csv.reader([line.strip()], delimiter=separator, skipinitialspace=True))]
    return [cell.strip() for cell in line.split(separator)]


def _number(text: str, decimal_comma: bool, grouped: bool = False) -> float | None:
    """The number in a cell, None for text.   grouped : the file parts thousands; else a mark that could part them is text."""
    if grouped and _GROUPED[decimal_comma].fullmatch(text):
        text = text.replace("." if decimal_comma else ",", "")
    if decimal_comma:
        if "." in text:
            return None
        text = text.replace(",", ".")
    try:
        return float(text) if "_" not in text else None
    except ValueError:
        return float(re.sub("[dD]", "e", text)) if _DOUBLE.fullmatch(text) else None


def recognised(
    path: Path, content: Sequence[TextLine], begin: Sequence[TextLine], separator: Separator | None, decimal: Decimal | None
) -> Format:
    """The format under which the most of the file's cells are numbers, in rows of one length.

    Parameters
    ----------
    path : Path
    content : sequence of TextLine
        Lines without comments.
    begin : sequence of TextLine
        The file's first lines, all of them.
    separator, decimal : Separator or None
        None recognises it.

    Raises
    ------
    DataError
        For a file that is no table of numbers.
    """
    _check_standing(path, content)
    body = content[len(content) // 4 :]  # a preamble stands at the beginning
    sample = [body[i].text for i in np.unique(np.linspace(0, len(body) - 1, _SAMPLED_LINES).astype(int))]
    marks = [_SEPARATORS[separator]] if separator else [",", ";", "\t", "|", " "]
    best: tuple[float, Format] | None = None
    for mark in marks:
        for comma in [False, True] if decimal is None else [decimal == "comma"]:
            if (mark == "," and comma) or (mark == " " and best is not None and best[1].separator == "\t"):
                continue
            found = _tried(str(path), sample, mark, comma, _parts_thousands(body, mark, comma))
            if found is not None and (best is None or found[0] > best[0] + 1e-9):
                best = found
    if best is None and (len(content) < 3 or all(_number(line.replace(",", "."), False) is not None for line in sample)):
        what = "holds no rows" if len(content) < 3 else "has one column only"
        raise DataError(f"{path} {what}; torque and position are needed, one row per sample")
    if best is None and (separator or decimal):
        given = " ".join(f"--{name} {word}" for name, word in (("separator", separator), ("decimal", decimal)) if word)
        raise DataError(f"{path} has no rows of one length under {given}; leave it out, and the format is recognised")
    if best is None:
        raise DataError(
            f"{path} is no table of numbers: no separator (comma, semicolon, tab, bar, space) gives rows of one length. It begins with "
            f"{content[0].text.strip()[:60]!r}. Export the signals as CSV: a row of names, then one row for each sample"
        )
    form = best[1]
    if form.separator == " " and (cell := _unit_in_cells(sample)):
        raise DataError(
            f"{path} has units behind its numbers ({cell!r}); take them out (replace them by nothing) and put them into the names above"
        )
    return _looked_through(form, content, begin)


def _check_standing(path: Path, content: Sequence[TextLine]) -> None:
    """Refuse a table that has a row for each signal."""
    if len(content) > _LYING[1]:
        return
    width = max(len(_split(content[-1].text, mark)) for mark in _SEPARATORS.values())
    if width >= _LYING[0]:
        raise DataError(
            f"{path} has {len(content)} rows of some {width} values: its signals lie in rows; transpose it (Excel: paste special; "
            "pandas: read_csv(..., header=None, index_col=0).T), so that each row is a sample"
        )


def _unit_in_cells(sample: Sequence[str]) -> str:
    """A cell such as ``0.12 Nm`` where all cells between some mark are such; "" where none are."""
    for mark in ",;\t|":
        cells = [cell for line in sample for cell in _split(line, mark)]
        if len(cells) > len(sample) and sum(_WITH_UNIT.fullmatch(cell) is not None for cell in cells) > _REGULAR_SHARE * len(cells):
            return cells[-1]
    return ""


def _looked_through(form: Format, content: Sequence[TextLine], begin: Sequence[TextLine]) -> Format:
    """The format with what only many lines show: columns that seldom hold a value, those that do at the beginning alone, as a slower
    signal beside faster ones does, and those that never do."""
    rows, first = (
        [row for row in (form.fields(line.text) for line in lines) if len(row) == form.width]
        for lines in (content[len(content) // 4 :], begin)
    )
    early = list(zip(*(row for row in first if form.is_row(row)), strict=True)) or [()] * form.width
    numeric, blank = list(form.numeric), [False] * form.width
    for j, column in enumerate(zip(*rows, strict=True)):
        filled = [cell for cell in column if cell.lower() not in MISSING]
        numbers = sum(form.number(cell) is not None for cell in filled)
        blank[j] = not numbers and sum(map(bool, column)) <= _SELDOM * len(column)
        numeric[j] = numeric[j] or (bool(filled) and numbers > 0.5 * len(filled))
        values = [form.number(cell) for cell in early[j] if cell]
        if blank[j] and values and None not in values:
            numeric[j], blank[j] = True, False
    return form._replace(numeric=tuple(numeric), blank=tuple(blank))


def _parts_thousands(body: Sequence[TextLine], mark: str, comma: bool) -> bool:
    """True if some cell has both marks, which only a number with parted thousands has."""
    both = _GROUPED[comma]
    lines = (line.text for line in body if "." in line.text and "," in line.text)
    return any("." in cell and "," in cell and both.fullmatch(cell) for line in lines for cell in _split(line, mark))


def _tried(file: str, sample: Sequence[str], mark: str, comma: bool, grouped: bool) -> tuple[float, Format] | None:
    """Share of numbers among the cells under one format, None when the lines make no rows."""
    rows = [_split(line, mark) for line in sample]
    width, count = Counter(len(row) for row in rows).most_common(1)[0]
    if width < 2 or count < _REGULAR_SHARE * len(rows):
        return None
    check_columns(file, width)
    rows = [row for row in rows if len(row) == width]
    filled = [[cell for cell in column if cell.lower() not in MISSING] for column in zip(*rows, strict=True)]
    numbers = [[_number(cell, comma, grouped) is not None for cell in column] for column in filled]
    # some cells may be damaged; a column of states or dates holds hardly any number
    numeric = tuple(sum(column) > 0.5 * len(column) for column in numbers)
    cells = sum(map(len, filled))
    if not any(numeric):
        return None
    return sum(map(sum, numbers)) / cells, Format(mark, comma, width, numeric, (False,) * width, grouped)
