"""Signals with time stamps of their own on one raster, without inventing torque.

The raster is the slower one of torque and position.  Torque on a slower raster is its mean over each step, which is what acts there;
torque is never interpolated.  Position and velocity are taken where stamps coincide, else between their two neighbours, and that is
said with the error it can make.  Setpoints and everything else hold their last value.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from beltcomm.arrays import Array
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.mapping import Source
from beltcomm.foreign.names import meaning_of
from beltcomm.foreign.table import Table
from beltcomm.quantities import UNITS
from beltcomm.recording.columns import CHANNELS, COMMON

#: Stamps that differ by less than this share of a step are one.
_SAME = 0.01
_TORQUES = {channels["torque"] for channels in CHANNELS.values()}
_POSITIONS = {channels["position"] for channels in CHANNELS.values()}
#: Signals that move on between two samples; all others are set at one moment and hold.
_CONTINUOUS = _POSITIONS | {channels["velocity"] for channels in CHANNELS.values()} | set(COMMON)


def on_one_raster(table: Table, sources: Mapping[str, Source], kept: Mapping[str, str]) -> tuple[Table, dict[str, Source], tuple[str, ...]]:
    """The table with all mapped columns on one raster, the sources with its time, and sentences on what was done.

    Parameters
    ----------
    table : Table
    sources : mapping of str to Source
        By column of ours.
    kept : mapping of str to str
        Further columns, by their names here.

    Raises
    ------
    DataError
        For time stamps that do not rise, or signals that were not recorded at the same time.
    """
    names = {column: source.theirs for column, source in sources.items() if column != "t_s"}
    names |= {f"kept {name}": theirs for name, theirs in kept.items()}
    clocks = {column: table.clocks[theirs] for column, theirs in names.items() if theirs in table.clocks}
    master = _master(table, clocks)
    if master is None:
        return table, dict(sources), ()
    given = dict(sources)
    if "t_s" not in given:
        given["t_s"] = replace(Source("t_s", master, written=master), scale=_seconds(table, master))
    elif given["t_s"].theirs != master and len(table.columns[given["t_s"].theirs]) == len(table.columns[master]):
        return table, given, ()  # another column of that raster is the time: the user's word
    elif given["t_s"].theirs != master and given["t_s"].theirs in clocks.values():
        given["t_s"] = replace(given["t_s"], theirs=master)  # his word on the unit holds for the slower rows, too
    others = {column: clock for column, clock in clocks.items() if clock != master and not _equal(table, clock, master)}
    if not others:
        return table, given, ()
    stamps = _stamps(table, master)
    columns = dict(table.columns)
    notes = [f"the rows are those of {master!r}, the raster of {', '.join(c for c in names if clocks.get(c) == master)}"]
    step = float(np.median(np.diff(stamps)))
    outside = np.zeros(len(stamps), dtype=bool)
    for column, clock in others.items():
        own, values = _stamps(table, clock), table.columns[names[column]]
        # what is neither torque nor position holds its last value until the next would have come
        after = _SAME * step if column in _TORQUES | _POSITIONS else max(_SAME * step, float(np.median(np.diff(own))))
        outside |= (stamps < own[0] - _SAME * step) | (stamps > own[-1] + after)
        if outside.all():
            raise DataError(f"{table.file}: {names[column]} was not recorded while the others were; map signals of one measurement")
        placed, words = _placed(column, own, values, stamps, step)
        columns[names[column]] = placed
        notes.append(f"{column.removeprefix('kept ')} is of another raster, {clock!r}: {words}")
    if outside.any():
        notes.append(f"{int(outside.sum())} rows at the ends left out, in which not every signal was recorded")
        for column in (*names.values(), given["t_s"].theirs):
            if len(columns[column]) == len(outside):
                columns[column] = np.where(outside, np.nan, columns[column])
    return replace(table, columns=columns), given, tuple(notes)


def _master(table: Table, clocks: Mapping[str, str]) -> str | None:
    """The slower raster of torque and position; the torque's when they are alike."""
    torque = next((clocks[name] for name in clocks if name in _TORQUES), None)
    position = next((clocks[name] for name in clocks if name in _POSITIONS), None)
    if torque is None or position is None:
        return torque or position
    steps = {clock: float(np.median(np.diff(_stamps(table, clock)))) for clock in (torque, position)}
    return position if steps[position] > (1.0 + _SAME) * steps[torque] else torque


def _stamps(table: Table, clock: str) -> Array:
    stamps = table.columns[clock] * _seconds(table, clock)
    steps = np.diff(stamps)
    if len(stamps) < 2 or not np.all(steps > 0.0):
        at = int(np.argmax(~(steps > 0.0))) if len(steps) else 0
        unit = " s" if table.unit(clock) else ""
        said = "has one value" if not len(steps) else f"goes back by {-steps[at]:.3g}{unit}" if steps[at] < 0.0 else "stands still"
        more = f" and {count} times more" if (count := int(np.sum(~(steps > 0.0))) - 1) > 0 else ""
        raise DataError(
            f"{table.file}: the time {clock!r} of its signals {said} in value {at + 2}{more}; rows changed places there, or another record "
            "begins: take one part with --rows, or do without the stamps with --rate"
        )
    return np.asarray(stamps, dtype=np.float64)


def _seconds(table: Table, clock: str) -> float:
    meaning = meaning_of(table, clock)
    return UNITS["s"].others[meaning.unit] if meaning is not None and meaning.suffix == "s" else 1.0


def _equal(table: Table, one: str, other: str) -> bool:
    first, second = table.columns[one], table.columns[other]
    return len(first) == len(second) and bool(np.array_equal(first * _seconds(table, one), second * _seconds(table, other)))


def _placed(column: str, own: Array, values: Array, stamps: Array, step: float) -> tuple[Array, str]:
    """A signal with stamps ``own`` at ``stamps``, and how that was done."""
    after = np.clip(np.searchsorted(own, stamps), 1, len(own) - 1)
    nearest = np.where(stamps - own[after - 1] < own[after] - stamps, after - 1, after)
    if column in _TORQUES and float(np.median(np.diff(own))) < (1.0 - _SAME) * step:
        return _means(own, values, stamps), f"its mean over each step of {1e3 * step:.4g} ms"
    if np.all(np.abs(own[nearest] - stamps)[(stamps >= own[0]) & (stamps <= own[-1])] <= _SAME * step):
        return values[nearest], "taken at the stamps that both have"
    if column in _CONTINUOUS:
        bend = np.abs(np.diff(values, 2)) / 8.0
        worst = float(np.nanmax(bend)) if len(bend) and np.isfinite(bend).any() else 0.0
        apart = 1e3 * float(np.median(np.diff(own)))
        words = f"interpolated between its samples {apart:.4g} ms apart, wrong by up to {worst:.3g} in the file's unit"
        return np.interp(stamps, own, values), words
    held = np.searchsorted(own, stamps * (1.0 + 1e-12) + _SAME * step, side="right") - 1
    return values[np.clip(held, 0, None)], "each row has its last value before"


def _means(own: Array, values: Array, stamps: Array) -> Array:
    """Mean of a signal that holds each value until its next stamp, over each step of ``stamps``."""
    edges = np.append(stamps, 2.0 * stamps[-1] - stamps[-2])
    ends = np.append(own[1:], 2.0 * own[-1] - own[-2])
    integral = np.concatenate(([0.0], np.cumsum(values * (ends - own))))
    at = np.interp(edges, np.append(own, ends[-1]), integral)
    means: Array = np.diff(at) / np.diff(edges)
    return means


def resampled(file: str, columns: Mapping[str, Any], period_s: float) -> tuple[dict[str, Any], str]:
    """All columns at even stamps, and a sentence on it.

    Torque is its mean over each step, which is what acts there, position and speed lie on a smooth curve through theirs, all else is as it
    was last.

    Parameters
    ----------
    file : str
        Name, for the sentence.
    columns : mapping of str to Any
        By name, with ``t_s``.
    period_s : float, s
        Between the stamps.

    Raises
    ------
    UsageError
        For steps shorter than the file's own.
    """
    own = columns["t_s"]
    usual = float(np.median(np.diff(own)))
    if period_s < (1.0 - _SAME) * usual:
        raise UsageError(
            f"{file}: its rows are {1e3 * usual:.4g} ms apart; rows every {1e3 * period_s:.4g} ms would be made up: --resample at most "
            f"{1.0 / usual:.4g}Hz"
        )
    stamps = np.arange(own[0], own[-1], period_s)
    found: dict[str, Any] = {}
    for name, column in columns.items():
        if name == "t_s":
            found[name] = stamps
        elif name in _TORQUES:
            found[name] = _means(own, column, stamps)
        elif name in _CONTINUOUS:
            found[name] = CubicSpline(own, column)(stamps)
        else:
            found[name] = column[np.clip(np.searchsorted(own, stamps * (1.0 + 1e-12), side="right") - 1, 0, None)]
    words = f"resampled to even rows every {1e3 * period_s:.6g} ms: torque is its mean over each, position and speed lie on a smooth curve"
    return found, words
