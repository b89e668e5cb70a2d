"""Roles of the columns of a table by their numbers, whatever they are called: time, a column and its derivative, what drives the motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from beltcomm.arrays import Array
from beltcomm.foreign.table import Table
from beltcomm.recording.belonging import belonging, roughness

#: Rows looked at, columns compared, windows over which a change is held against an integral, and their likeness.
_ROWS, _MOST_COLUMNS, _WINDOWS, _ALIKE = 20_000, 24, 100, 0.98
#: Share of a column that a motion explains, from which it is said to drive it.
_DRIVES, _MOST_DRIVERS = 0.6, 4
#: Shares of a position's range: off its middle, and near another column; share of those rows from which on that is its setpoint.
_AWAY, _NEAR, _OFTEN = 0.1, 0.03, 0.25
#: Times the usual step that nearly all steps of a time stay below.
_EVEN = 2.5


@dataclass(frozen=True)
class Relations:
    """time, position, velocity : names of columns, "" where the numbers do not tell.   torques : that may drive it, the likeliest first.
    factor : velocity over the derivative of the position, per unit of the time column.   words : column -> what was seen."""

    time: str = ""
    position: str = ""
    velocity: str = ""
    torques: tuple[str, ...] = ()
    factor: float = 1.0
    words: tuple[tuple[str, str], ...] = ()

    def why(self, name: str) -> str:
        """Relations of a column to others, in words; "" for none.

        Parameters
        ----------
        name : str
            Of the column.
        """
        return next((words for column, words in self.words if column == name), "")


def relations(table: Table, time: str = "") -> Relations:
    """Clock, motion and torque among columns, by their numbers alone.

    Parameters
    ----------
    table : Table
    time : str
        The column that is known to be it, "" to look for one.
    """
    names = [name for name, column in table.columns.items() if column.dtype.kind == "f" and np.isfinite(column[:_ROWS]).all()]
    sizes = [len(table.columns[name]) for name in names]
    names = [name for name in names if len(table.columns[name]) == max(sizes, default=0)][:_MOST_COLUMNS]
    values = {name: table.columns[name][:_ROWS] for name in names}
    words: list[tuple[str, str]] = []
    clock = time or next((name for name in names if _is_even(values[name])), "")
    if clock and clock in values:
        step = float(np.median(np.diff(values[clock])))
        words.append((clock, f"it rises, by {step:.6g} per row"))
        stamps = values[clock]
    else:
        stamps = np.arange(float(max((len(column) for column in values.values()), default=0)))
    moving = [name for name in names if name != clock and np.ptp(values[name]) > 0.0]
    if len(stamps) < 2 * _WINDOWS or len(moving) < 2:
        return Relations(clock, words=tuple(words))
    pair = _derivative(values, moving, stamps)
    position, velocity, factor = pair or ("", "", 1.0)
    if pair:
        place = list(table.columns).index
        words.append((velocity, f"column {place(velocity) + 1} looks like the derivative of column {place(position) + 1}{_times(factor)}"))
        words.append((position, f"column {place(velocity) + 1} looks like its derivative{_times(factor)}"))
    torques, position = _drivers(table, values, [name for name in moving if name != velocity], position, stamps, words)
    return Relations(clock, position, velocity, torques, factor, tuple(words))


def _times(factor: float) -> str:
    if abs(factor - 1.0) < 0.02:
        return ""
    known = {1e-3: "divided by 1000", 1e3: "times 1000", 60.0 / math.tau: "in 1/min of rad", 60.0 / 360.0: "in 1/min of degrees",
             60.0: "in 1/min of turns", math.tau / 60.0: "times 2π/60"}  # fmt: skip
    return next((f", {text}" for value, text in known.items() if abs(factor / value - 1.0) < 0.02), f", times {factor:.4g}")


def _is_even(values: Array) -> bool:
    steps = np.diff(values)
    if len(steps) < 3 or not np.all(steps > 0.0):
        return False
    return bool(np.percentile(steps, 95.0) < _EVEN * np.median(steps))


def _derivative(values: dict[str, Array], names: Sequence[str], stamps: Array) -> tuple[str, str, float] | None:
    """The column whose change is the integral of another one, that other one, and the factor; the pair that is most alike."""
    cuts = np.unique(np.linspace(0, len(stamps) - 1, _WINDOWS + 1).astype(int))
    travel = {name: np.diff(values[name][cuts]) for name in names}
    integral = {
        name: np.diff(np.concatenate(([0.0], np.cumsum(0.5 * (values[name][1:] + values[name][:-1]) * np.diff(stamps))))[cuts])
        for name in names
    }
    best: tuple[float, tuple[str, str, float]] | None = None
    for position, velocity in permutations(names, 2):
        a, b = travel[position], integral[velocity]
        power = float(a @ a), float(b @ b)
        if min(power) <= 0.0:
            continue
        alike = float(a @ b) / math.sqrt(power[0] * power[1])
        if abs(alike) > _ALIKE and (best is None or abs(alike) > best[0]):
            best = abs(alike), (position, velocity, math.copysign(math.sqrt(power[1] / power[0]), alike))
    return best[1] if best else None


def _drivers(
    table: Table, values: dict[str, Array], names: Sequence[str], position: str, stamps: Array, words: list[tuple[str, str]]
) -> tuple[tuple[str, ...], str]:
    """The columns that the motion explains best as its torque, and the position: that with a derivative, else the smoothest that does."""
    motions = [position] if position else sorted(names, key=lambda name: roughness(values[name]))[:3]
    found: list[tuple[float, str, str]] = []
    for motion in motions:
        for name in names:
            if name != motion and not _same(values[name], values[motion]) and roughness(values[name]) > roughness(values[motion]):
                told = belonging(stamps, values[name], values[motion])
                if told is not None and told.consistent and told.explained > _DRIVES:
                    found.append((told.explained, name, motion))
    if not found:
        return (), position
    motion = max(found)[2]
    drivers = sorted(((explained, name) for explained, name, other in found if other == motion), reverse=True)[:_MOST_DRIVERS]
    place = list(table.columns).index
    for explained, name in drivers:
        words.append(
            (name, f"column {place(name) + 1} looks like what drives column {place(motion) + 1}, {100.0 * explained:.0f} % explained")
        )
    if not position:
        words.append((motion, f"column {place(drivers[0][1]) + 1} looks like what drives it"))
    return tuple(name for _, name in drivers), motion


def _same(one: Array, position: Array) -> bool:
    """True if a column often stands where the position stands, off the middle of its range, as its setpoint does: none drives the other."""
    span = float(np.ptp(position))
    away = np.abs(position - np.median(position)) > _AWAY * span
    return bool(away.any()) and float(np.mean(np.abs(one - position)[away] < _NEAR * span)) > _OFTEN
