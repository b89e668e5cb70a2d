"""A foreign table becomes the columns of a recording: scaled, cut, aligned; every change is said."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, replace
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import Column, rms
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.daystamps import are_days, seconds_of_days
from beltcomm.foreign.mapping import Source, kept_columns, sources_for
from beltcomm.foreign.rasters import on_one_raster, resampled
from beltcomm.foreign.table import Decimal, Separator, Table
from beltcomm.foreign.textformat import MISSING
from beltcomm.foreign.timestamps import checked_time, joined_counter, rough_stamps, seconds_of
from beltcomm.quantities import in_other_unit, parse_quantity, unit_of
from beltcomm.recording.columns import CHANNELS, COMMON, KNOWN_COLUMNS

#: Columns that act over a step; all others are sampled at its beginning.
_ACTING = tuple(channels[signal] for channels in CHANNELS.values() for signal in ("torque", "torque_setpoint") if signal in channels)
#: Share of the rows with the stamp before that have all its values, too, where rows were written twice; rates that differ by less are one.
DOUBLES, SAME_RATE = 0.9, 2e-3
#: Larger numbers stand for a missing value.
_NO_MEASUREMENT = 1e18
#: Columns whose sign --flip turns, by what is named.
_TURNED = {
    "torque": _ACTING + tuple(channels["torque_offset"] for channels in CHANNELS.values()),
    "position": tuple(
        channels[signal]
        for channels in CHANNELS.values()
        for signal in ("position", "velocity", "reference_position", "reference_velocity")
    ),
}
_POSITIONS = tuple(channels["position"] for channels in CHANNELS.values())


@dataclass(frozen=True)
class Reading:
    """Options of reading foreign files, the same for all files of one import.

    Attributes
    ----------
    mapping : tuple of str
        One ``column=name*scale`` each (:mod:`beltcomm.foreign.mapping`).
    keep : tuple of str
        Further columns to keep, or ("all",).
    separator, decimal, skip_lines
        Of a text file; recognised when None.
    period_s : float or None
        s between rows, where there is no time column or it is not to be used.
    first_row, last_row : int or None
        Only these rows, counted from 1.
    from_s, until_s : float or None
        Only this part, s after its first row.
    even_s : float or None, s
        Between the rows at which a table with uneven stamps is taken anew; None as it is.
    torque_acts : {'after', 'before'} or None
        "after" the time stamp of its row, or "before" it: then the row's torque is moved to the row before; None: "after" in a table, in a
        log of frames as the drive's profile says.
    unwrap : str or None
        Span after which the position starts anew, such as "1rev"; None when it does not.
    drop_incomplete : bool
        Leave out rows in which a value is missing, instead of refusing them.
    flip : tuple of str
        "torque", "position" or both: all columns of that kind get the other sign.
    record, channel, node, signals, dbc
        Of a log of frames: which of its moves, from 1; interface; node of the drive; what frames carry, by hand or by a DBC file.
    edges : str or None
        A file of encoder edge times on the same clock: the position at the rows is taken from it.
    """

    mapping: tuple[str, ...] = ()
    keep: tuple[str, ...] = ()
    separator: Separator | None = None
    decimal: Decimal | None = None
    skip_lines: int = 0
    period_s: float | None = None
    first_row: int | None = None
    last_row: int | None = None
    from_s: float | None = None
    until_s: float | None = None
    even_s: float | None = None
    torque_acts: Literal["after", "before"] | None = None
    unwrap: str | None = None
    drop_incomplete: bool = False
    flip: tuple[str, ...] = ()
    record: int | None = None
    channel: str | None = None
    node: int | None = None
    signals: tuple[str, ...] = ()
    dbc: str | None = None
    edges: str | None = None

    def __post_init__(self) -> None:
        if self.period_s is not None and not 0.0 < self.period_s < np.inf:
            raise UsageError(f"the time between rows is {self.period_s:g} s; it must be positive")
        if self.even_s is not None and not 0.0 < self.even_s < np.inf:
            raise UsageError(f"--resample gives {self.even_s:g} s between rows; it must be positive")
        first = 1 if self.first_row is None else self.first_row
        if first < 1 or (self.last_row is not None and self.last_row <= first):
            raise UsageError(f"the rows {first} to {self.last_row} are none; rows are counted from 1")

    def to_dict(self) -> dict[str, Any]:
        """Options that differ from the defaults, for the sidecar."""
        given = {item.name: getattr(self, item.name) for item in fields(self) if getattr(self, item.name) != item.default}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in given.items()}


def reading_from_dict(data: Mapping[str, Any]) -> Reading:
    """The inverse of :meth:`Reading.to_dict`.

    Parameters
    ----------
    data : mapping of str to Any
        As a sidecar keeps it.

    Raises
    ------
    DataError
        For keys that are none.
    """
    kinds = get_type_hints(Reading)
    given: dict[str, Any] = {}
    for key, value in (data if isinstance(data, Mapping) else {"reading": data}).items():
        value = (
            tuple(value) if isinstance(value, list) else float(value) if type(value) is int and kinds.get(key) == float | None else value
        )
        if key not in kinds or not _is(value, kinds[key]):
            raise DataError(f"the sidecar's import section is damaged: reading.{key} is {str(value)[:80]!r}; import the file again")
        given[key] = value
    try:
        return Reading(**given)
    except UsageError as error:
        raise DataError(f"the sidecar's import section is damaged: {error}; import the file again") from error


def _is(value: Any, kind: Any) -> bool:
    """True if a value is of the type of a field of :class:`Reading`."""
    choices = get_args(kind)
    if get_origin(kind) is Literal:
        return value in choices
    if get_origin(kind) is tuple:
        return isinstance(value, tuple) and all(_is(item, choices[0]) for item in value)
    return any(_is(value, choice) for choice in choices) if choices else type(value) is kind


@dataclass(frozen=True, eq=False)
class Converted:
    """The columns of a foreign table in our names and units.

    Attributes
    ----------
    columns : dict of str to Column
        Ours by name.
    sources : dict of str to Source
        Where each came from.
    not_taken : tuple of str
        Columns of the file that were left.
    notes : tuple of str
        Remarks, as sentences.
    """

    columns: Mapping[str, Column]
    sources: Mapping[str, Source]
    not_taken: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())

    @property
    def integrated(self) -> bool:
        """The position is the integral of a speed that the file has."""
        return any(name in self.columns and name not in self.sources for name in _POSITIONS)


def convert(table: Table, reading: Reading, *, timed: bool = True, turns: Callable[[Column], Column] | None = None) -> Converted:
    """Map, scale, cut and align the columns of a table.

    Parameters
    ----------
    table : Table
    reading : Reading
        Mappings, and what is kept and cut.
    timed : bool
        False for a static map, which has no time.
    turns : Callable or None
        Turns of the motor at given times, from encoder edges; they stand for the position of the table.

    Raises
    ------
    UsageError
        For a mapping that does not fit the table.
    DataError
        For values that are missing or time that does not rise.
    """
    sources = sources_for(table, reading.mapping)
    kept = kept_columns(table, reading.keep, sources)
    merged: tuple[str, ...] = ()
    if timed and reading.period_s is None and table.clocks:
        table, sources, merged = on_one_raster(table, sources, kept)
    notes: list[str] = []
    stamps = sources.pop("t_s", None) if reading.period_s is not None or not timed else None
    if timed and reading.period_s is not None and stamps is not None:
        with suppress(DataError):  # stamps that cannot be read are why a rate was given
            notes += _contradicting_stamps(_scaled(table, stamps, []), reading.period_s)
    columns = {name: _scaled(table, source, notes) for name, source in sources.items()}
    if turns is not None:
        columns["position_rad"], sources["position_rad"] = _from_edges(table, columns, sources, reading, turns)
    columns |= {name: table.columns[theirs] for name, theirs in kept.items()}
    _check_lengths(table, columns, sources)
    notes[:0] = [*table.notes, *merged]
    first = (reading.first_row or 1) - 1
    rows = np.arange(first, min(len(next(iter(columns.values()), ())), reading.last_row or 2**62))
    if not len(rows):
        raise UsageError(f"{table.file} has no row {reading.first_row}; it has {len(next(iter(columns.values()), ()))}")
    columns = {name: column[first : first + len(rows)] for name, column in columns.items()}
    if timed and reading.period_s is not None:
        columns = {"t_s": reading.period_s * np.arange(len(rows)), **columns}
        notes.append("without time stamps: lost samples cannot be seen")
    columns, rows = _complete(table.file, columns, list(sources) + ["t_s"] * timed, rows, reading.drop_incomplete, notes)
    if timed:
        _check_there_is_time(table, columns)
        columns, rows = _without_doubles(columns, rows, notes)
        if len(rows) > 1 and np.all(np.diff(columns["t_s"]) < 0.0):
            columns, rows = {name: column[::-1] for name, column in columns.items()}, rows[::-1]
            notes.append("the newest row stands first: the rows were taken in the order of their stamps")
        checked_time(table.file, columns["t_s"], rows)
        if not reading.period_s and (rough := rough_stamps(_as_written(table, sources, len(columns["t_s"])))):
            notes.append(rough)
        columns = _cut(table.file, columns, reading)
        if reading.even_s is not None:
            columns, said = resampled(table.file, _integrated(columns, notes), reading.even_s)
            notes.append(said)
    if timed:
        columns = _integrated(columns, notes)
    for name in _POSITIONS:
        if name in columns and reading.unwrap is not None:
            span = parse_quantity(reading.unwrap, name)
            if not 0.0 < span < np.inf:
                raise UsageError(f"--unwrap is {reading.unwrap}; give the span after which {name} starts anew, above 0")
            columns[name] = np.unwrap(columns[name], period=span)
    for name in columns:
        if any(name in _TURNED[kind] for kind in reading.flip):
            columns[name] = -columns[name]
    if reading.torque_acts == "before":
        columns = _moved(columns)
        notes.append("torque was moved to the row before: it acts until its own time stamp")
    ordered = {name: columns[name] for name in ("t_s", *KNOWN_COLUMNS, *columns) if name in columns}
    taken = {source.theirs for source in sources.values()} | set(kept.values()) | ({"position_rad"} if turns is not None else set())
    return Converted(ordered, sources, tuple(name for name in table.columns if name not in taken), tuple(notes))


def _from_edges(
    table: Table, columns: Mapping[str, Column], sources: Mapping[str, Source], reading: Reading, turns: Callable[[Column], Column]
) -> tuple[Column, Source]:
    """The motor's angle at the rows."""
    other = sources.get("position_rad")
    if other is not None and other.theirs != "position_rad":
        raise UsageError(f"--edges gives the position, and so does --map position_rad={other.written}; leave one out")
    if reading.period_s is None:
        _check_there_is_time(table, columns)
    count = max((len(column) for name, column in columns.items() if name != "position_rad"), default=0)
    stamps = columns["t_s"] if reading.period_s is None else reading.period_s * np.arange(count)
    return math.tau * turns(stamps), Source("position_rad", "edges", math.tau, written="--edges")


def _scaled(table: Table, source: Source, notes: list[str]) -> Column:
    values = table.columns[source.theirs]
    if source.column == "t_s" and values.dtype.kind not in "fiu":
        seconds, said = seconds_of(table.file, source.theirs, values)
        notes += said
        return seconds
    if values.dtype.kind not in "fiu":
        words = next((str(value) for value in values if str(value).strip().lower() not in MISSING), "")
        what = f"text such as {words[:30]!r}; map a column of numbers" if words else "no value; map another column"
        raise DataError(f"{table.file}: {source.theirs} holds {what}")
    if source.column == "t_s" and _in_days(table, source) and are_days(values):
        seconds, said = seconds_of_days(source.theirs, values)
        notes += said
        return seconds + source.offset
    if source.column == "t_s":
        values, joined = joined_counter(values)
        notes += [joined] * bool(joined)
    if source.scale == 1.0 and source.offset == 0.0:
        return values
    with np.errstate(all="ignore"):  # what is no number is found with the missing values
        return source.scale * values + source.offset


def _in_days(table: Table, source: Source) -> bool:
    """True where nobody says that a time is in another unit than days."""
    return source.written.endswith("*d") if source.scaled else table.unit(source.theirs) in ("", "d")


def _as_written(table: Table, sources: Mapping[str, Source], rows: int) -> Column:
    """The stamps as the file holds them."""
    source = sources.get("t_s")
    values = table.columns[source.theirs] if source is not None else np.zeros(0)
    return values[:rows] if values.dtype.kind == "f" else np.zeros(0)


def _check_lengths(table: Table, columns: Mapping[str, Column], sources: Mapping[str, Source]) -> None:
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        listed = ", ".join(f"{sources[name].theirs if name in sources else name} {count}" for name, count in lengths.items())
        raise DataError(f"{table.file}: the columns differ in length ({listed}); map signals that were sampled together")


def _complete(
    file: str, columns: dict[str, Column], needed: Sequence[str], rows: NDArray[np.intp], drop: bool, notes: list[str]
) -> tuple[dict[str, Column], NDArray[np.intp]]:
    """The rows in which no mapped value is missing; without ``drop`` only rows at both ends may be incomplete."""
    missing = {name: ~(np.abs(columns[name]) < _NO_MEASUREMENT) for name in needed if name in columns}
    for name in [name for name in COMMON if name in missing and missing[name].any()]:
        notes.append(f"{name} has no value in {int(missing.pop(name).sum())} of {len(rows)} rows and is left out")
        columns = {other: column for other, column in columns.items() if other != name}
    absent = [name for name, mask in missing.items() if mask.all()]
    if absent:
        raise DataError(f"{file}: the column for {absent[0]} holds no value; map another one")
    bad = np.logical_or.reduce(list(missing.values())) if missing else np.zeros(len(rows), dtype=bool)
    if not bad.any():
        return columns, rows
    if bad.all():
        counts = ", ".join(f"{name} in {int(mask.sum())}" for name, mask in missing.items())
        raise DataError(f"{file}: in every row a value is missing ({counts} of {len(bad)}); map columns that were sampled together")
    good = np.flatnonzero(~bad)
    inside = np.flatnonzero(bad[good[0] : good[-1]]) + good[0]
    if len(inside) and not drop:
        at = int(inside[0])
        names = ", ".join(name for name, mask in missing.items() if mask[at])
        raise DataError(
            f"{file}: {len(inside)} of {len(bad)} rows miss a value, first {names} in row {rows[at] + 1}; "
            "leave such rows out with --drop-incomplete (a gap is then reported), or map other columns"
        )
    notes.append(f"{int(bad.sum())} rows without a value left out, the first is row {rows[int(np.flatnonzero(bad)[0])] + 1}")
    keep = ~bad if drop else slice(good[0], good[-1] + 1)
    return {name: column[keep] for name, column in columns.items()}, rows[keep]


def _without_doubles(columns: dict[str, Column], rows: NDArray[np.intp], notes: list[str]) -> tuple[dict[str, Column], NDArray[np.intp]]:
    """Without rows that repeat the one before in every value, time included; with coarse stamps an axis at rest makes such rows, too."""
    double = np.logical_and.reduce([column[1:] == column[:-1] for column in columns.values()])
    if not double.any() or double.sum() < DOUBLES * np.count_nonzero(columns["t_s"][1:] == columns["t_s"][:-1]):
        return columns, rows
    notes.append(f"{int(double.sum())} rows that repeat the row before left out, the first is row {rows[int(np.argmax(double)) + 1] + 1}")
    keep = np.concatenate(([True], ~double))
    return {name: column[keep] for name, column in columns.items()}, rows[keep]


def _contradicting_stamps(t_s: Column, period_s: float) -> list[str]:
    """A sentence where the stamps of a file say another rate than the one that was given, none where they agree."""
    whole = float(t_s[-1] - t_s[0]) if len(t_s) > 1 else 0.0
    if not (np.isfinite(whole) and whole > 0.0) or abs((len(t_s) - 1) * period_s / whole - 1.0) < SAME_RATE:
        return []
    return [
        f"its stamps say {(len(t_s) - 1) / whole:.6g} Hz from the first row to the last, --rate or --period {1.0 / period_s:.6g} Hz: "
        "the given one was taken; an inertia goes with its square"
    ]


def _check_there_is_time(table: Table, columns: Mapping[str, Column]) -> None:
    if "t_s" in columns:
        return
    rising = [
        f"{name} rises by {np.median(np.diff(column)):.6g} per row"
        for name, column in table.columns.items()
        if column.dtype.kind == "f" and len(column) > 2 and np.all(np.diff(column) > 0.0)
    ]
    hint = f" ({'; '.join(rising[:3])})" if rising else ""
    spelled = {name: in_other_unit(name, "t_s") for name in table.columns}
    example = next((f"{name}*{factor:.6g}" for name, factor in spelled.items() if factor is not None), "NAME")
    raise UsageError(
        f"{table.file}: nothing says when its rows were sampled{hint}; map its time with --map t_s={example}, or give --rate or --period"
    )


def _integrated(columns: dict[str, Column], notes: list[str]) -> dict[str, Column]:
    """With the position as the integral of the speed, where a side has a torque, a speed and no position."""
    for channels in CHANNELS.values():
        torque, position, velocity = (channels[signal] for signal in ("torque", "position", "velocity"))
        if torque in columns and velocity in columns and not any(name in columns for name in _POSITIONS):
            steps = 0.5 * (columns[velocity][1:] + columns[velocity][:-1]) * np.diff(columns["t_s"])
            notes.append(
                f"{position} is the integral of {velocity}: inertia and friction can be told, places and errors of the encoder cannot"
            )
            return {**columns, position: np.concatenate(([0.0], np.cumsum(steps)))}
    return columns


def _cut(file: str, columns: dict[str, Column], reading: Reading) -> dict[str, Column]:
    if reading.from_s is None and reading.until_s is None:
        return columns
    since = columns["t_s"] - columns["t_s"][0]
    kept = (since >= (reading.from_s or 0.0)) & (since <= (np.inf if reading.until_s is None else reading.until_s))
    if not kept.any():
        raise UsageError(f"{file} lasts {since[-1]:.6g} s; nothing of it is left by --from and --until")
    return {name: column[kept] for name, column in columns.items()}


def _moved(columns: dict[str, Column]) -> dict[str, Column]:
    """Torque one row earlier; the last row, whose torque is not known then, goes."""
    return {name: column[1:] if name in _ACTING else column[:-1] for name, column in columns.items()}


def alignment(reading: Reading, columns: Mapping[str, Column]) -> str:
    """The sentence that says what is assumed of the torque's time.

    Parameters
    ----------
    reading : Reading
        Mappings, and what is kept and cut.
    columns : mapping of str to Column
        Of the recording.
    """
    name = next((name for name in _ACTING if name in columns), "torque")
    step = f"{1e3 * float(np.median(np.diff(columns['t_s']))):.4g} ms" if "t_s" in columns else "one row"
    before = reading.torque_acts == "before"
    acts = "until its row's time stamp" if before else "from its row's time stamp to the next"
    other = "after" if before else "before"
    return (
        f"{name} is taken to act {acts}. If the recorder means it otherwise, import with --torque-acts {other}: no data can tell "
        f"this error of {step} from a real dead time."
    )


def line_of_table(name: str, column: Column, source: Source | None) -> dict[str, Any]:
    """One line of the table that shows what was read: column, source, factor, extremes and rms, in the unit of the column.

    Parameters
    ----------
    name : str
        Of the column.
    column : Column (n,)
        In its unit.
    source : Source or None
        Where it is from; None for the rate.
    """
    line: dict[str, Any] = {
        "column": name,
        "from": source.theirs if source else "(rate)" if name == "t_s" else name,
        "scale": 1.0,
        "offset": 0.0,
        "unit": unit_of(name),
    }
    if source:
        line |= {"scale": source.scale, "offset": source.offset}
    if column.dtype.kind == "f" and len(column):
        line |= {"min": float(column.min()), "max": float(column.max()), "rms": rms(column)}
    return line


def without_time(reading: Reading) -> Reading:
    """Convert a static map.

    Parameters
    ----------
    reading : Reading
        Mappings, and what is kept and cut.

    Raises
    ------
    UsageError
        When a rate or a part in time was given.
    """
    if reading.period_s is not None or reading.from_s is not None or reading.until_s is not None:
        raise UsageError("a static map has no time; leave out --rate, --period, --from and --until")
    return replace(reading, torque_acts=None)
