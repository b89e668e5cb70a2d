"""Results of commands, for people and for programs."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from itertools import groupby
from typing import Any

import numpy as np

from beltcomm.borders import for_html
from beltcomm.language import told, tr

#: Characters of a bar between its brackets.
BAR = 16


@dataclass(frozen=True)
class Result:
    """Result of a command.

    Attributes
    ----------
    data : dict of str to Any
        Everything, for programs.
    text : sequence of str
        The same for people.
    exit_code : int
        0, or 1 for a missed target.
    details : sequence of str
        For whoever wants to know more.
    told : int
        How many of the first lines were said already, before a question.
    """

    data: Mapping[str, Any]
    text: Sequence[str]
    exit_code: int = 0
    details: Sequence[str] = ()
    told: int = 0

    def to_json(self) -> Mapping[str, Any]:
        """Everything as a mapping of plain values."""
        return dict(plain(self.data))

    def lines(self) -> Iterable[str]:
        """The result for people."""
        return self.text

    def __repr__(self) -> str:
        return "\n".join(map(str, self.text))

    def _repr_html_(self) -> str:
        return _html_of(self.text)


class Row(str):
    """A line of a table: as text what stands in files and pipes, and the cells of it, which a terminal may draw as it likes.

    Attributes
    ----------
    cells : tuple of str
        As shown.
    right : tuple of bool
        For each, whether it stands at the right of its column.
    head : bool
        The line of the titles.
    """

    cells: tuple[str, ...]
    right: tuple[bool, ...]
    head: bool

    def __new__(cls, text: str = "", cells: Sequence[str] = (), right: Sequence[bool] = (), head: bool = False) -> Row:
        """A line as it reads, and what it is made of."""
        row = super().__new__(cls, text)
        row.cells, row.right, row.head = tuple(cells), tuple(right), head
        return row


class Line(str):
    """A line of a screen: as text what stands in files and pipes, and its parts, which a terminal colours and sets below each other.

    Attributes
    ----------
    parts : tuple of tuple of str
        Text and style: "good", "bad", "note", "title", "soft", "command" (kept whole, to be copied), "bar" (dropped first) or "".
    """

    parts: tuple[tuple[str, str], ...]

    def __new__(cls, *parts: str | tuple[str, str]) -> Line:
        """The line as it reads, and what it is made of."""
        told = tuple((part, "") if isinstance(part, str) else part for part in parts)
        row = super().__new__(cls, "".join(text for text, _ in told).rstrip())
        row.parts = told
        return row


def bar(share: float) -> str:
    """``[#####...]``: a share of a limit; full from 1 on, empty for what is not known.

    Parameters
    ----------
    share : float
        Of the limit; nan for what is not known.
    """
    filled = 0 if not math.isfinite(share) else min(BAR, max(0, round(share * BAR)))
    return f"[{'#' * filled}{'.' * (BAR - filled)}]"


def command_lines(command: str, why: str) -> list[Line]:
    """Next command, alone on its line, so that it can be copied.

    Parameters
    ----------
    command : str
        To be typed.
    why : str
        Behind the title; "" for nothing.
    """
    return [Line("  ", (tr("Next"), "title"), f"  {tr(why)}" if why else ""), Line("    ", (command, "command"))]


class Described:
    """Object that a terminal shows as text, and a notebook with tables: the lines of ``_lines``."""

    def _lines(self) -> Iterable[str]:
        raise NotImplementedError

    def __repr__(self) -> str:
        return "\n".join(self._lines())

    def _repr_html_(self) -> str:
        return _html_of(self._lines())


def _html_of(lines: Iterable[str]) -> str:
    """Lines as a notebook shows them: rows as tables, text as it stands."""
    parts = []
    for is_row, some in groupby(lines, key=lambda line: isinstance(line, Row) and bool(line.cells)):
        if not is_row:
            parts.append(f"<pre>{escape(chr(10).join(map(str, some)))}</pre>")
            continue
        rows = []
        for row in some:
            assert isinstance(row, Row)
            kind = "th" if row.head else "td"
            sides = ["right" if right else "left" for right in row.right]
            cells = [f"<{kind} style='text-align:{side}'>{escape(cell)}</{kind}>" for cell, side in zip(row.cells, sides, strict=True)]
            rows.append(f"<tr>{''.join(cells)}</tr>")
        parts.append(f"<table>{''.join(rows)}</table>")
    return for_html("".join(parts))


def with_unit(number: str, unit: str) -> str:
    """A number with its unit as people write it: kg m² for the catalogue's kg m2, nothing for its 1.

    Parameters
    ----------
    number : str
        As it is printed.
    unit : str
        Of the catalogue; "" or "1" for none.
    """
    return number if unit in ("", "1") else f"{number} {re.sub(r'(?<=[a-z])[23]', lambda power: {'2': '²', '3': '³'}[power[0]], unit)}"


def table(columns: Sequence[str], rows: Iterable[Sequence[str]], indent: str = "") -> list[Row]:
    """Lines of equal columns, the titles first.

    A row may have fewer cells than there are titles.

    Parameters
    ----------
    columns : sequence of str
        Titles; one that begins with ``>`` has its cells at the right.
    rows : iterable of sequence of str
        Cells.
    indent : str
        Before each line.
    """
    right = [title.startswith(">") for title in columns]
    titles = (title.removeprefix(">") for title in columns)
    filled = [[told(tr(title)) for title in titles], *([*row, *[""] * (len(columns) - len(row))] for row in rows)]
    widths = [max(map(len, cells)) for cells in zip(*filled, strict=True)]
    padded = [[c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, widths, right, strict=True)] for row in filled]
    return [
        Row((indent + "  ".join(cells)).rstrip(), row, right, number == 0)
        for number, (cells, row) in enumerate(zip(padded, filled, strict=True))
    ]


def plain(value: Any) -> Any:
    """The value in the types that YAML and JSON have: dataclasses and mappings as mappings, arrays as lists.

    Complex values, of which neither has any, as a mapping of ``real`` and ``imag``.

    Parameters
    ----------
    value : Any
        Any value of a result.
    """
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value) if not f.name.startswith("_")}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, complex) or (isinstance(value, np.ndarray) and np.iscomplexobj(value)):
        return {"real": plain(value.real), "imag": plain(value.imag)}
    if isinstance(value, np.ndarray):
        return [plain(item) for item in value.tolist()]
    if isinstance(value, (list, tuple, set, frozenset)):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    return str(value) if isinstance(value, (Row, Line)) else value


def jsonable(value: Any) -> Any:
    """The value in the types JSON has: as :func:`plain`, numbers that are not finite become null, what is left becomes text.

    Parameters
    ----------
    value : Any
        Any value of a result.
    """
    value = plain(value)
    if isinstance(value, Mapping):
        return {key: jsonable(item) for key, item in value.items()}
    if isinstance(value, list):
        return [jsonable(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, (bool, int, float, str)) else str(value)
