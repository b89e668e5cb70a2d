"""Results, talk, errors and pages of a command in the words and units of the axis that it is about, of any kind but a belt."""

from __future__ import annotations

import dataclasses
import inspect
import os
import re
from collections.abc import Callable, Mapping, Sequence
from functools import wraps
from itertools import groupby
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

from beltcomm.axis import Axis
from beltcomm.axis.terms import PLAIN, Terms, terms_of, times
from beltcomm.errors import BeltcommError
from beltcomm.locks import changes_run
from beltcomm.result import Line, Result, Row
from beltcomm.runfolder import RunFolder
from beltcomm.talk import CarriagePosition, Talk, choose, detail, found

P = ParamSpec("P")
V = TypeVar("V")

#: Between the columns of a line of text; at least this much stays.
_GAP = re.compile(r"( {2,})")
_APART = 2
#: Columns of a screen.
WIDE = 80
#: A number, or one with its interval.
_VALUE = re.compile(r"-?[\d.]+(e[-+]?\d+)?( ± [\d.]+)?")
#: Text of a picture, between the marks of SVG.
_TEXT = re.compile(r">([^<>]+)<")


def _aligned(terms: Terms, text: str) -> str:
    """A line with columns: each begins where it did, or as soon after the one before it as it can."""
    if "\n" in text:
        return "\n".join(_aligned(terms, line) for line in text.split("\n"))
    made, at = "", 0
    for part in _GAP.split(text):
        if _GAP.fullmatch(part):
            made = made.ljust(max(at + len(part), len(made) + min(len(part), _APART)))
        else:
            made += terms.said(part)
        at += len(part)
    return made


def _line(terms: Terms, line: Line) -> list[Line]:
    """A line of a screen; one that has become too wide for it goes on below its first text, from a gap between two columns on."""
    made = Line(*((_aligned(terms, text).ljust(len(text)) if style != "command" else text, style) for text, style in line.parts))
    *before, (last, style) = made.parts
    begun = sum(len(text) for text, _ in before)
    gaps = [gap for gap in _GAP.finditer(last.rstrip()) if begun + gap.start() <= WIDE]
    if len(made) <= WIDE or len(line) > WIDE or style == "command" or not gaps:
        return [made]
    return [Line(*before, (last[: gaps[-1].start()], style)), Line(" " * begun, (last[gaps[-1].end() :], style))]


def _table(terms: Terms, rows: Sequence[Row]) -> list[Row]:
    """Rows of one table, its columns as wide as they now are; those of another make keep their text."""
    found = _table_in(terms, rows[0].cells, [row.cells for row in rows[1:]])
    own_cells = [found["head"], *found["rows"]] if rows[0].head else [row.cells for row in rows]
    cells = [[terms.said(cell) for cell in row] for row in own_cells]
    texts = [_aligned(terms, str(row)) for row in rows]
    if len(rows) > 1 and all(row and "\n" not in row for row in rows):
        indent = " " * min(len(row) - len(row.lstrip()) for row in rows)
        wide = [max(map(len, column)) for column in zip(*cells, strict=True)]
        for number, (row, own) in enumerate(zip(rows, cells, strict=True)):
            padded = [c.rjust(w) if right else c.ljust(w) for c, w, right in zip(own, wide, row.right, strict=True)]
            texts[number] = (indent + "  ".join(padded)).rstrip()
    return [Row(text, own, row.right, row.head) for text, own, row in zip(texts, cells, rows, strict=True)]


def lines_in(terms: Terms, lines: Sequence[str]) -> list[str]:
    """Lines of a result or of a talk in the words and units of an axis: sentences, screens and tables.

    Parameters
    ----------
    terms : Terms
    lines : sequence of str
        In those of a belt.
    """
    made: list[str] = []
    for width, some in groupby(lines, key=lambda line: len(line.cells) if isinstance(line, Row) else 0):
        if width:
            made += _table(terms, [line for line in some if isinstance(line, Row)])
        else:
            for line in some:
                made += _line(terms, line) if isinstance(line, Line) else [_aligned(terms, line)]
    return made


def text_in(terms: Terms, marked: str) -> str:
    """Text between the marks of SVG or HTML in the words and units of an axis.

    Parameters
    ----------
    terms : Terms
    marked : str
        Markup.
    """
    return _TEXT.sub(lambda one: f">{terms.said(one[1])}<", marked)


def said_in(terms: Terms, value: V, *, keys: bool = False) -> V:
    """The sentences within dataclasses, mappings and sequences; single words are names for programs, and stay.

    Parameters
    ----------
    terms : Terms
    value : V
        In the words of a belt.
    keys : bool
        Single words are for people, too; pictures are told by their marks.
    """
    if isinstance(value, str):
        if value.lstrip().startswith("<svg"):
            return cast(V, text_in(terms, value))
        return cast(V, terms.said(value)) if keys or " " in value else value
    if dataclasses.is_dataclass(value) and not isinstance(value, type) and hasattr(value, "head") and hasattr(value, "rows"):
        value = dataclasses.replace(value, **_table_in(terms, value.head, value.rows))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        changed = {one.name: said_in(terms, getattr(value, one.name), keys=keys) for one in dataclasses.fields(value) if one.init}
        return cast(V, dataclasses.replace(value, **changed))
    if isinstance(value, Mapping):
        return cast(V, {key: said_in(terms, one, keys=keys) for key, one in value.items()})
    if isinstance(value, (list, tuple)) and not hasattr(value, "_fields"):
        return cast(V, type(value)(said_in(terms, one, keys=keys) for one in value))
    return value


def _table_in(terms: Terms, head: Sequence[str], rows: Sequence[Sequence[str]]) -> dict[str, Any]:
    """Head and rows of a page's table; a unit stands behind the title of its column, or in a cell of its own."""
    titles, cells = list(head), [_in_its_unit(terms, head, row) for row in rows]
    for i, title in enumerate(head):
        name = next((one for one in sorted(terms.units, key=len, reverse=True) if f" {title}".endswith(f" {one}")), "")
        if not name or title.endswith(f"N {name}"):
            continue
        unit = terms.units[name]
        titles[i] = f"{title.removesuffix(name)}{unit.symbol}"
        for row in cells:
            if i < len(row) and _VALUE.fullmatch(row[i]):
                row[i] = " ± ".join(times(one, unit.factor) for one in row[i].split(" ± "))
    return {"head": titles, "rows": cells}


def _in_its_unit(terms: Terms, head: Sequence[str], row: Sequence[str]) -> list[str]:
    """A row whose unit stands in a cell of its own: the numbers before it, and what a data sheet says, are in that unit."""
    cells = list(row)
    for at, cell in enumerate(row):
        unit = terms.units.get(cell)
        if unit is None or unit.factor == 1.0:
            continue
        meant = [i for i, name in enumerate(head[: len(row)]) if (i < at or name == "data sheet") and _VALUE.fullmatch(row[i])]
        for i in meant:
            cells[i] = " ± ".join(times(one, unit.factor) for one in row[i].split(" ± "))
        cells[at] = unit.symbol
    return cells


class OwnWords:
    """A talk in the words of an axis."""

    def __init__(self, talk: Talk, terms: Terms) -> None:
        self._talk, self._terms = talk, terms

    def phase(self, index: int, count: int, title: str) -> None:
        """Said on."""
        self._talk.phase(index, count, self._terms.said(title))

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Said on."""
        self._talk.progress(fraction, seconds_left)

    def moving(self, place: CarriagePosition) -> None:
        """Said on, with gauges in the units of the axis."""
        self._talk.moving(dataclasses.replace(place, **_shown(self._terms, place)))

    def say(self, *lines: str) -> None:
        """Said on."""
        self._talk.say(*lines_in(self._terms, lines))

    def detail(self, *lines: str) -> None:
        """Said on."""
        detail(self._talk, *lines_in(self._terms, lines))

    def found(self, name: str, value: str) -> None:
        """Said on."""
        found(self._talk, self._terms.said(name), self._terms.said(value))

    def confirm(self, text: str) -> bool:
        """Asked on."""
        return self._talk.confirm(self._terms.said(text))

    def choose(self, question: str, choices: Mapping[str, str]) -> str:
        """Asked on."""
        return choose(self._talk, self._terms.said(question), {key: self._terms.said(word) for key, word in choices.items()})

    def attended(self) -> bool:
        """True if somebody is there to be asked."""
        return self._talk.attended()


def _shown(terms: Terms, place: CarriagePosition) -> dict[str, Any]:
    gauges = []
    for gauge in place.gauges:
        unit = terms.units.get(gauge.unit)
        own: dict[str, Any] = (
            {} if unit is None else {"value": unit.factor * gauge.value, "limit": unit.factor * gauge.limit, "unit": unit.symbol}
        )
        gauges.append(dataclasses.replace(gauge, name=terms.said(gauge.name), **own))
    unit = terms.units.get("mm")
    return {"gauges": tuple(gauges), "load": terms.said(place.load), "unit": place.unit if unit is None else unit.symbol}


def _terms_for(given: Mapping[str, Any]) -> Terms:
    """Of the axis that a command is about: the one given, or that of its run, of several the first.

    Whatever is wrong with it, the command says.
    """
    axis, run = given.get("axis"), given.get("run", given.get("runs"))
    run = run[0] if isinstance(run, (list, tuple)) and run else run
    try:
        if isinstance(axis, Axis):
            return terms_of(axis)
        if isinstance(axis, (str, os.PathLike)):
            from beltcomm.axis import load_axis

            return terms_of(load_axis(os.fspath(axis)))
        if isinstance(run, (str, os.PathLike)):
            return RunFolder.open(Path(run)).terms
    except (BeltcommError, OSError):
        pass
    return PLAIN


def own_words(command: Callable[P, Result]) -> Callable[P, Result]:
    """A public function whose result, talk and errors are in the words of the axis that it is about.

    Parameters
    ----------
    command : callable
        With an axis or a run among its arguments.
    """
    signature = inspect.signature(command)

    @wraps(command)
    def call(*args: P.args, **kwargs: P.kwargs) -> Result:
        given = signature.bind(*args, **kwargs)
        terms = _terms_for(given.arguments)
        if not terms:
            return command(*args, **kwargs)
        if given.arguments.get("talk") is not None:
            given.arguments["talk"] = OwnWords(given.arguments["talk"], terms)
        try:
            result = command(*given.args, **given.kwargs)
        except BeltcommError as error:
            error.args = tuple(said_in(terms, one) for one in error.args)
            if error.diagnosis is not None:
                error.diagnosis = said_in(terms, error.diagnosis)
            raise
        return dataclasses.replace(
            result,
            data=said_in(terms, dict(result.data)),
            text=lines_in(terms, list(result.text)),
            details=lines_in(terms, list(result.details)),
        )

    return call


def about_run(*, waits: bool = True) -> Callable[[Callable[P, Result]], Callable[P, Result]]:
    """A public function that changes a run, :func:`beltcomm.locks.changes_run`, in the words of its axis.

    Parameters
    ----------
    waits : bool
        True if it waits for another command in the run to end.
    """

    def made(command: Callable[P, Result]) -> Callable[P, Result]:
        return own_words(changes_run(waits=waits)(command))

    return made
