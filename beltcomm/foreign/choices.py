"""Mappings that a foreign column's unit, or its numbers, allow."""

from __future__ import annotations

from typing import Literal

import numpy as np

from beltcomm.axis import Axis
from beltcomm.foreign.names import Meaning, counts_per_turn
from beltcomm.foreign.table import Table
from beltcomm.quantities import UNITS

Confidence = Literal["sure", "likely", "unsure"]
#: A torque column without a unit is N m when its largest value lies between these shares of the motor's peak torque.
_SMALLEST_SHARE, _LARGEST_SHARE = 0.01, 1.1


def by_unit(table: Table, column: str, meaning: Meaning, axis: Axis, ratio: float | None) -> tuple[tuple[str, ...], Confidence, str]:
    """Mappings of one foreign column to ours, by its unit."""
    name, suffix = meaning.name, meaning.suffix
    own = column.removeprefix("reference_").split("_", 1)[1].removeprefix("setpoint_")
    if suffix == own and meaning.by_name:
        return (spelled(column, name, meaning.unit),), "sure", f"its name, and its unit {meaning.unit} by the file"
    if suffix == own:
        return (spelled(column, name, meaning.unit),), "likely", f"its unit {meaning.unit} alone"
    if suffix == "m" and own == "rad" and ratio is not None:
        why = (
            f"it is in {meaning.unit}: the motor's angle is that over the {ratio:.6g} m/rad of {axis}, if the drive's feed constant is that"
        )
        return (f"{column}={quoted(name)}*{UNITS['m'].others[meaning.unit]:g}/{ratio:.9g}",), "likely", why
    if suffix == "m" and own == "rad":
        why = f"it is in {meaning.unit}, the torque at the motor; a feed constant of 60 mm per revolution is only an example"
        return (f"{column}={quoted(name)}*{meaning.unit}*rev/60mm",), "unsure", why
    if own == "rad" and (stated := counts_per_turn(table.unit(name))):
        return (f"{column}={quoted(name)}*rev/{stated}",), "sure", f"its unit by the file, {stated} to a turn"
    if meaning.special == "counts" and own == "rad":
        counts = axis.motor.encoder_counts_per_rev or 65536
        known = axis.motor.encoder_counts_per_rev is not None
        why = f"it is in counts, {counts} per revolution {'by the axis file' if known else 'is only an example'}"
        return (f"{column}={quoted(name)}*rev/{counts}",), "likely", why
    if meaning.special.startswith("per") and own == "nm":
        rated, share = axis.motor.rated_torque_nm, 100 if meaning.special == "per cent" else 1000
        of = "torque" if meaning.quantity == "torque" else "current, taken as the same share of the rated torque"
        why = f"it is in {meaning.special} of a rated {of}, {'that of the axis file' if rated else '1.0 N m is only an example'}"
        return (f"{column}={quoted(name)}*{rated or 1.0:g}/{share}",), "likely", why
    return without_unit(table, column, meaning, axis, own)


def without_unit(table: Table, column: str, meaning: Meaning, axis: Axis, own: str) -> tuple[tuple[str, ...], Confidence, str]:
    """Units that the numbers allow, for a column that states none."""
    values = table.columns[meaning.name]
    known = values[np.isfinite(values)]
    largest = float(np.abs(known).max()) if len(known) else 0.0
    name = quoted(meaning.name)
    if own == "nm":
        rated = axis.motor.rated_torque_nm or 1.0
        choices = [f"{column}={name}*1", f"{column}={name}*{rated:g}/100", f"{column}={name}*{rated:g}/1000", f"{column}={name}*mnm"]
        peak = axis.motor.peak_torque_nm
        fits = [c for c, f in zip(choices, (1.0, rated / 100, rated / 1000, 1e-3), strict=True) if peak and _possible(largest * f, peak)]
        ordered = (*fits, *(c for c in choices if c not in fits))
        return tuple(ordered), "unsure", f"its unit is not stated; its largest value is {largest:.4g}"
    if own == "rad":
        span = float(np.ptp(known)) if len(known) else 0.0
        counts = axis.motor.encoder_counts_per_rev or 65536
        whole = bool(np.all(known == np.round(known))) and span > 1000.0
        choices = [f"{column}={name}*1", f"{column}={name}*deg", f"{column}={name}*rev", f"{column}={name}*rev/{counts}"]
        ordered = (choices[3], *choices[:3]) if whole else tuple(choices)
        return ordered, "unsure", f"its unit is not stated; it covers {span:.6g}{', in whole numbers' if whole else ''}"
    units = {"rad_s": ("1", "rpm", "deg/s"), "m": ("1", "mm"), "m_s": ("1", "mm/s"), "a": ("1", "ma"), "n": ("1", "kn")}.get(own, ("1",))
    return tuple(f"{column}={name}*{unit}" for unit in units), "unsure", "its unit is not stated"


def _possible(largest: float, peak: float) -> bool:
    return _SMALLEST_SHARE * peak <= largest <= _LARGEST_SHARE * peak


def spelled(column: str, name: str, unit: str) -> str:
    """A mapping as a user writes it."""
    return f"{column}={quoted(name)}{f'*{unit}' if unit else ''}"


def quoted(name: str) -> str:
    """A foreign name as it stands in a mapping."""
    bare = Table.bare(name)
    return f'"{name}"' if bare != name or not name.replace("_", "").isalnum() else name
