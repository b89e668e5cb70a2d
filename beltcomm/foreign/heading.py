"""The lines above the first row of a text table: names, units and sample times, as a header or in a block of keyed lines.

A block has one line for each property of the channels, its key in the first cell, and often again where a further time column begins::

    Name            Torque   Name            Position        TwinCAT Scope
    SampleTime[ms]  1        SampleTime[ms]  10
    Delta_X  0.001  0.001                                    LabVIEW
    Sample Interval,0.001,s                                  oscilloscopes
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from beltcomm.foreign.spellings import COUNTS, PER_CENT, PER_MILLE, plain_unit
from beltcomm.quantities import UNITS

#: Keys of a block in small letters without blanks, units and punctuation.
_NAMES = {
    "name",
    "names",
    "channelname",
    "channel",
    "signal",
    "signalname",
    "tracename",
    "kanal",
    "kanalname",
    "variable",
    "labels",
    "label",
}
_UNITS = {"unit", "units", "yunitlabel", "verticalunits", "verticalunit", "vunit", "einheit", "einheiten", "channelunit"}
_PERIODS = {
    *("sampletime", "sampleinterval", "samplinginterval", "samplingperiod", "sampleperiod", "samplingtime", "deltax", "hresolution", "dt"),
    *(
        "abtastzeit",
        "abtastintervall",
        "tracecycle",
        "cycletime",
        "zykluszeit",
        "xincrement",
        "increment",
        "horizontalinterval",
        "timestep",
    ),
    *("obtaininginterval", "recordinginterval"),
}
_RATES = {"samplerate", "samplingrate", "samplefrequency", "samplingfrequency", "abtastrate", "abtastfrequenz"}
_STARTS = {"x0", "xorigin", "start", "starttime", "hoffset"}
#: A column that counts the rows, and no time.
_COUNTS_ROWS = {"x", "sequence", "n", "no", "nr", "index", "sample", "samples", "number"}
#: Names above no values: what a person notes beside a row.
_REMARKS = {"comment", "comments", "remark", "remarks", "kommentar", "bemerkung", "marker", "event", "note", "notes", ""}
_SECONDS = {"s": 1.0, "sec": 1.0, "second": 1.0, "seconds": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0}
_HERTZ = {"hz": 1.0, "khz": 1e3, "mhz": 1e6, "s/s": 1.0, "sa/s": 1.0}
_UNIT_WORDS = {other for unit in UNITS.values() for other in unit.others} | {
    *("v", "mv", "-", "1", "bool", "w", "k", "volt", "volts", "none", "unitless", "user", "na", "sequence", *COUNTS, *PER_CENT, *PER_MILLE),
}
#: A line drawn between header and rows, as of a table printed by a database.
_RULE = re.compile(r"[\s\-+=|:_]+")


class TextLine(NamedTuple):
    """A line of a text file.

    Attributes
    ----------
    number : int
        From 1.
    """

    number: int
    text: str


@dataclass(frozen=True)
class Heading:
    """names, units : of the columns, [] where the lines give none.   line : that of the names, 0 for none.

    periods : s between two values, of each column, 0 where it is not stated; [] for none.   starts : s, of the first value.
    clocks : places of the columns that are marked as the time of those behind them.
    """

    names: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    line: int = 0
    periods: list[float] = field(default_factory=list)
    starts: list[float] = field(default_factory=list)
    clocks: tuple[int, ...] = ()


class OtherLength(ValueError):
    """A line that looks like a header and has another number of names than the rows have values."""

    def __init__(self, line: TextLine, names: int) -> None:
        super().__init__(line, names)
        self.line, self.names = line, names


@dataclass(frozen=True)
class RowShape:
    """Layout of the rows.

    Attributes
    ----------
    width : int
        Their values.
    split : callable
        A line into its cells.
    number : callable
        A cell's, None for text.
    blank : tuple of bool
        Columns without a value in any row looked at.
    spaces : bool
        Whether blanks part the columns.
    counted : bool
        Whether their first cell is the number of the row.
    """

    width: int
    split: Callable[[str], list[str]]
    number: Callable[[str], float | None]
    blank: tuple[bool, ...]
    spaces: bool = False
    counted: bool = False


def heading_of(above: Sequence[TextLine], shape: RowShape, commented: tuple[str, ...]) -> Heading:
    """Names, units, period and clocks that the lines above the first row state.

    Parameters
    ----------
    above : sequence of TextLine
        Lines above the first row.
    shape : RowShape
    commented : tuple of str
        Marks before a comment.

    Raises
    ------
    OtherLength
    """
    block = _Block(shape)
    rest = [line for line in above if not _RULE.fullmatch(line.text) and not block.takes(line)]
    names, units, number = _header(rest, shape, commented, required=not block.names)
    names, units = (block.names or names), (_beside_clocks(block.units, names) or units)
    period, start = block.periods, block.starts
    if names and not any(period) and len(names) == shape.width:
        names, period, start = _increment_beside(names, rest, shape)
    return Heading(names, units, block.line or number, period, start, block.clocks)


def _beside_clocks(units: list[str], names: list[str]) -> list[str]:
    """Units of the channels alone by column, where each channel has a time column of one name."""
    channels = [k for k, name in enumerate(names) if name and name != names[0]]
    stated = [unit for unit in units if unit]
    if len(names) - len(channels) < 2 or len(stated) != len(channels):
        return units
    return [stated[channels.index(k)] if k in channels else "" for k in range(len(names))]


class _Block:
    """Keyed lines, taken one by one."""

    def __init__(self, shape: RowShape) -> None:
        self._shape = shape
        self.names: list[str] = []
        self.units: list[str] = []
        self.periods: list[float] = []
        self.starts: list[float] = []
        self.clocks: tuple[int, ...] = ()
        self.line = 0

    def takes(self, line: TextLine) -> bool:
        """True for a line of a block; what it says is kept, the last one of a kind."""
        cells = [cell.strip().strip('"') for cell in self._shape.split(line.text.lstrip("#%/ "))]
        if self._shape.spaces or len(cells) < 2:
            cells = _by_mark(line.text) or cells
        if len(cells) < 2 or not any(cells[1:]):
            return False
        key, unit = _key(cells[0])
        width = self._shape.width
        if key in _NAMES | _UNITS and 2 < len(cells) <= width + 1:
            values = self._spread(cells)
            if sum(bool(value) for value in values) < 2 or any(self._shape.number(value) is not None for value in values if value):
                return False
            if key in _UNITS:
                self.units = values
            else:
                self.names, self.line, self.clocks = values, line.number, self._marked(cells)
            return True
        if key in _PERIODS | _RATES | _STARTS:
            return self._times(key, unit, cells)
        return False

    def _marked(self, cells: Sequence[str]) -> tuple[int, ...]:
        return tuple(k for k, cell in enumerate(cells) if cell == cells[0] and k < self._shape.width)

    def _spread(self, cells: Sequence[str]) -> list[str]:
        """Cells by column; those that repeat the key stand above a time column."""
        values = ["" if cell == cells[0] else cell for cell in cells]
        return (values + [""] * self._shape.width)[: self._shape.width]

    def _times(self, key: str, unit: str, cells: Sequence[str]) -> bool:
        numbers = [self._shape.number(cell) for cell in cells]
        found = [number for number in numbers[1:] if number is not None]
        words = [cell.lower().strip("[]() ") for cell in cells[1:] if self._shape.number(cell) is None and cell and cell != cells[0]]
        if not found or len(words) > 1:
            return False
        scales = _HERTZ if key in _RATES else _SECONDS
        factor = scales.get(unit or (words[0] if words else ""), 0.0 if unit or words else 1.0)
        if factor == 0.0:
            return False
        if len(found) == 1:
            values = [found[0]] * self._shape.width
        else:
            values = [number if number is not None else 0.0 for number in (*numbers, *[None] * self._shape.width)][: self._shape.width]
        if key in _RATES:
            self.periods = [1.0 / (factor * value) if value > 0.0 else 0.0 for value in values]
        elif key in _PERIODS:
            self.periods = [factor * max(value, 0.0) for value in values]
        else:
            self.starts = [factor * value for value in values]
        return True


def _key(cell: str) -> tuple[str, str]:
    """The key in a cell without its unit, and the unit."""
    match = re.fullmatch(r"(.*?)\s*[\[(]\s*([^\])]*)\s*[\])]\s*:?", cell)
    text, unit = (match[1], match[2]) if match else (cell, "")
    return re.sub(r"[^a-zäöüß0-9]", "", text.lower()), unit.lower().replace("µ", "u").strip()


def _by_mark(text: str) -> list[str]:
    """``Sample interval: 0.001 s`` as cells."""
    match = re.match(r"\s*[#%/]*\s*([^:=\t]{1,40}?)\s*[:=]\s*([-+0-9.,eE]+)\s*([A-Za-zµ/]*)\s*$", text)
    return [match[1], match[2], *([match[3]] if match[3] else [])] if match else []


def _header(above: Sequence[TextLine], shape: RowShape, commented: tuple[str, ...], *, required: bool) -> tuple[list[str], list[str], int]:
    """Names and units from the nearest lines that have a cell for each column; [] where there are none, and the line of the names."""
    candidates: list[list[str]] = []
    numbers: list[int] = []
    for line in reversed(above):
        comment = line.text.lstrip().startswith(commented)
        text = line.text.lstrip().lstrip("#%/").strip() if comment else line.text
        fields = _as_wide(shape.split(text), text, shape, comment)
        if len(fields) != shape.width or all(shape.number(cell) is not None for cell in fields if cell):
            if comment and not candidates:
                continue
            if not candidates and len(fields) > 1 and required:
                raise OtherLength(line, len(fields))
            break
        candidates.append(fields)
        numbers.append(line.number)
        if len(candidates) == 2:
            break
    if not candidates:
        return [], [], 0
    under = [_is_unit(cell) or (shape.blank[k] and shape.number(cell) is not None) for k, cell in enumerate(candidates[0])]
    if len(candidates) == 2 and all(under):
        return candidates[1], [cell.strip("[]() ") for cell in candidates[0]], numbers[1]
    return candidates[0], [], numbers[0]


def _as_wide(fields: list[str], text: str, shape: RowShape, comment: bool) -> list[str]:
    """The cells of a header as many as the rows', where it is plain how they differ."""
    if shape.spaces and len(fields) != shape.width:  # names with a blank inside, more blanks between them
        parted = re.split(r"\s{2,}|\t", text.strip())
        fields = parted if len(parted) == shape.width else fields
    if len(fields) > shape.width and all(cell.strip().strip('"').lower() in _REMARKS for cell in fields[shape.width :]):
        return fields[: shape.width]  # a column of remarks that no row has
    if len(fields) == shape.width - 1 and not comment:
        return [*fields, ""] if shape.blank[-1] else ["row", *fields] if shape.counted else fields
    return fields


def _is_unit(cell: str) -> bool:
    """True for a cell that holds a unit, or nothing."""
    plain = plain_unit(cell.strip('" '))
    return not plain or plain in _UNIT_WORDS or (cell.startswith(("[", "(")) and cell.endswith(("]", ")")))


def _increment_beside(names: list[str], above: Sequence[TextLine], shape: RowShape) -> tuple[list[str], list[float], list[float]]:
    """Start and increment that stand behind the units, under names of their own: ``X,CH1,CH2,Start,Increment``."""
    keys = [_key(name)[0] for name in names]
    for line in reversed(above):
        cells = shape.split(line.text)
        if len(cells) != shape.width:
            continue
        found = {key: shape.number(cell) for key, cell in zip(keys, cells, strict=True) if key in _PERIODS | _STARTS}
        period = next((value for key, value in found.items() if key in _PERIODS and value), None)
        if period is not None and keys[0] in _COUNTS_ROWS:
            start = next((value for key, value in found.items() if key in _STARTS and value is not None), 0.0)
            return names, [period] * shape.width, [start] * shape.width
    return names, [], []
