"""Units of a drive by the objects that a log shows: what one raw number is in SI at the motor shaft, and which profile the drive has.

The same formulas as the adapter's, written for bytes that were overheard instead of asked for.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from beltcomm.axis import Axis
from beltcomm.configfiles import config_names, find_config, read_yaml
from beltcomm.errors import BeltcommError
from beltcomm.foreign.canopen import Place, Seen

_RPM = math.tau / 60.0
#: Internal units of the Metronix family, per revolution and per min⁻¹ (F1 p80-87).
_INTERNAL_POSITION, _INTERNAL_SPEED = 65536, 4096
#: 60A9h, unit of velocity: min⁻¹ (CiA 402-2 v4, CiA 303-2).
_MINUTE_SPEED_UNIT = 0x00B44700
#: Objects of the factor group, the units of CiA 402, the ratings.
_SCALING = (0x608F, 0x6091, 0x6092, 0x6093, 0x6094, 0x6075, 0x6076, 0x60A9)


@dataclass(frozen=True)
class LogUnits:
    """SI of one raw number, motor shaft; None where the log does not tell.

    Attributes
    ----------
    notes : tuple of str
        Where each comes from, in words.
    """

    position_rad: float | None
    speed_rad_s: float | None
    torque_nm: float | None
    current_a: float | None
    notes: tuple[str, ...]


def units_of(seen: list[Seen], node: int, axis: Axis, frame: int) -> LogUnits:
    """From SDO transfers in the log; what they do not show from the axis file.

    Position: factor group (6093h, F1 p80-87) or feed constant over gear ratio (608Fh, 6091h, 6092h, CiA 402-2).  Speed: 6094h; 60A9h.
    Torque: thousandths of 6076h (mN m); current: of 6075h (mA).

    Parameters
    ----------
    seen : list of Seen
        Transfers of the log.
    node : int
    axis : Axis
    frame : int
        At which they hold, for a session may change them and put them back; what was seen only later counts as well.
    """
    values: dict[Place, int] = {}
    for item in seen:
        if item.node == node and item.place[0] in _SCALING and (item.frame <= frame or item.place not in values):
            values[item.place] = int.from_bytes(item.value, "little")
    notes: list[str] = []
    position, speed = _motion(values, notes)
    if position is None and axis.motor.encoder_counts_per_rev is not None:
        position = math.tau / axis.motor.encoder_counts_per_rev
        notes.append(f"position unit: not in the log, 1/{axis.motor.encoder_counts_per_rev} rev by the axis file")
    rated, rated_current = values.get((0x6076, 0)), values.get((0x6075, 0))
    torque = rated * 1e-6 if rated else None
    if torque is not None:
        notes.append(f"torque unit: thousandths of {rated} mN m by 6076h in the log")
    elif axis.motor.rated_torque_nm is not None:
        torque = axis.motor.rated_torque_nm * 1e-3
        notes.append(f"torque unit: not in the log, thousandths of {axis.motor.rated_torque_nm:g} N m by the axis file")
    if rated and axis.motor.rated_torque_nm is not None and abs(rated * 1e-3 / axis.motor.rated_torque_nm - 1.0) > 0.05:
        notes.append(
            f"the drive's rated torque is {rated * 1e-3:g} N m, the axis file says {axis.motor.rated_torque_nm:g} N m: one of them is wrong"
        )
    return LogUnits(position, speed, torque, rated_current * 1e-6 if rated_current else None, tuple(notes))


def _motion(values: Mapping[Place, int], notes: list[str]) -> tuple[float | None, float | None]:
    factor, speed_factor = _ratio(values, 0x6093), _ratio(values, 0x6094)
    if factor is not None:
        notes.append(f"position unit: {_INTERNAL_POSITION / factor:g} per rev by the factor group 6093h in the log")
        return factor * math.tau / _INTERNAL_POSITION, speed_factor * _RPM / _INTERNAL_SPEED if speed_factor is not None else None
    counts, gear, feed = _ratio(values, 0x608F), _ratio(values, 0x6091), _ratio(values, 0x6092)
    if feed is None and counts is None:
        return None, None
    per_rev = (feed if feed is not None else counts or 1.0) / (gear if gear is not None else 1.0)
    position = math.tau / per_rev
    notes.append(f"position unit: {per_rev:g} per motor revolution by 608Fh, 6091h and 6092h in the log")
    unit = values.get((0x60A9, 0))
    if unit in (None, 0):
        return position, position
    return position, _RPM if unit == _MINUTE_SPEED_UNIT else None


def _ratio(values: Mapping[Place, int], index: int) -> float | None:
    numerator, divisor = values.get((index, 1)), values.get((index, 2), 1)
    return numerator / divisor if numerator and divisor else None


@dataclass(frozen=True)
class Overheard:
    """title : of the drive's profile.   torque_sampling : as in its file.   known : whether the log names the drive."""

    title: str
    torque_sampling: Literal["over", "after"]
    known: bool


def profile_of(seen: list[Seen], node: int) -> Overheard:
    """The shipped profile that fits the vendor, product and name in the log (1018h, 1008h); else the generic one.

    Parameters
    ----------
    seen : list of Seen
        Transfers of the log.
    node : int
    """
    values = {item.place: item.value for item in seen if item.node == node and item.place[0] in (0x1008, 0x1018)}
    name = values.get((0x1008, 0), b"").rstrip(b"\0").decode("ascii", "replace")
    numbers = {"vendor_id": values.get((0x1018, 1)), "product_code": values.get((0x1018, 2))}
    for profile in config_names("drives"):
        try:
            raw = read_yaml(find_config("drives", profile))
        except BeltcommError:
            continue
        match: Mapping[str, Any] = raw.get("match") or {}
        wanted = {key: match[key] for key in numbers if key in match}
        fits = all((got := numbers[key]) is not None and int.from_bytes(got, "little") == value for key, value in wanted.items())
        named = any(name.startswith(known) for known in match["device_names"]) if "device_names" in match else bool(wanted)
        if match and fits and named:
            return Overheard(str(raw.get("title", profile)), "over" if raw.get("torque_sampling") == "over" else "after", True)
    return Overheard("generic CiA 402 drive", "after", False)
