"""Raw numbers of a drive and SI at the motor shaft, read from the drive and never assumed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from beltcomm.errors import DriveError
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.sdo import Lending, Objects

_RPM: Final = 2.0 * math.pi / 60.0
#: Internal units of the Metronix family, per revolution, per min⁻¹ and per min⁻¹/s (F1 p80-87).
_INTERNAL_POSITION, _INTERNAL_SPEED, _INTERNAL_ACCELERATION = 65536, 4096, 256
#: 60A9h, unit of velocity (CiA 402-2 v4, CiA 303-2): min⁻¹.
_MINUTE_SPEED_UNIT: Final = 0x00B44700


@dataclass(frozen=True)
class Scaling:
    """SI value of one raw unit, motor shaft, and the drive's ratings.

    position_rad, speed_rad_s, acceleration_rad_s2, torque_nm : per raw unit.     counts_per_rev : encoder counts.
    rated_torque_nm : N m (6076h).     rated_current_a : A rms (6075h).
    """

    position_rad: float
    speed_rad_s: float
    acceleration_rad_s2: float
    torque_nm: float
    counts_per_rev: int
    rated_torque_nm: float
    rated_current_a: float


def read_scaling(objects: Objects, profile: Profile, lending: Lending | None) -> Scaling:
    """Ask the drive for its units.

    Factor group: internal = user * numerator / divisor; the speed factor is set to 1/1, 1/4096 min⁻¹, for the session, because
    whole min⁻¹ are useless as feedback; without ``lending`` nothing is written.
    CiA 402: user units per motor revolution = feed constant / gear ratio.
    Raises DriveError when a divisor is zero or a unit is not known, ObjectRefused, BusError.
    """
    rated_torque_nm = objects.read_int(0x6076, 0, "uint32") * 1e-3
    rated_current_a = objects.read_int(0x6075, 0, "uint32") * 1e-3
    if rated_torque_nm <= 0 or rated_current_a <= 0:
        raise DriveError(
            f"the drive reports rated torque {rated_torque_nm:g} N m (6076h) and rated current {rated_current_a:g} A (6075h); "
            "enter the motor's data with the maker's tool first"
        )
    if profile.units == "factor_group":
        position, speed, acceleration, counts = _factor_group(objects, lending)
    else:
        position, speed, acceleration, counts = _cia402_units(objects)
    return Scaling(position, speed, acceleration, rated_torque_nm * 1e-3, counts, rated_torque_nm, rated_current_a)


def _factor_group(objects: Objects, lending: Lending | None) -> tuple[float, float, float, int]:
    if lending is not None:
        for subindex in (1, 2):
            lending.set(0x6094, subindex, "uint32", 1, keep=True)
    position = _ratio(objects, 0x6093) * 2.0 * math.pi / _INTERNAL_POSITION
    speed = _ratio(objects, 0x6094) * _RPM / _INTERNAL_SPEED
    acceleration = _ratio(objects, 0x6097) * _RPM / _INTERNAL_ACCELERATION
    return position, speed, acceleration, _INTERNAL_POSITION


def _cia402_units(objects: Objects) -> tuple[float, float, float, int]:
    counts = _ratio(objects, 0x608F)
    gear = _ratio_or_one(objects, 0x6091)
    feed = _ratio(objects, 0x6092) if objects.read_if_there(0x6092, 1, "uint32") is not None else counts
    position = 2.0 * math.pi * gear / feed
    unit = objects.read_if_there(0x60A9, 0, "uint32")
    if unit not in (None, 0, _MINUTE_SPEED_UNIT):
        raise DriveError(f"the drive's velocity unit 60A9h = {unit:08X}h is not known; set it to position units/s (0) or min⁻¹")
    speed = _RPM if unit == _MINUTE_SPEED_UNIT else position
    return position, speed, position, round(counts)


def _ratio(objects: Objects, index: int) -> float:
    numerator, divisor = (objects.read_int(index, subindex, "uint32") for subindex in (1, 2))
    if numerator == 0 or divisor == 0:
        raise DriveError(f"object {index:04X}h is {numerator}/{divisor}; set the drive's units with the maker's tool first")
    return numerator / divisor


def _ratio_or_one(objects: Objects, index: int) -> float:
    return 1.0 if objects.read_if_there(index, 1, "uint32") is None else _ratio(objects, index)
