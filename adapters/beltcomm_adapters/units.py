"""Units of position, speed and acceleration, as a drive tells them (60A8h to 60AAh) or a profile names them, in SI at the motor shaft.

A unit object is power of ten, numerator, denominator and one more denominator, a byte each (CiA 402-2 with the codes of CiA 303-2):
00B44700h is revolutions per minute, FD010300h mm/s.  A name is a number and a unit: ``0.1 rpm``, ``10 counts/s2``.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final, Literal

from beltcomm.errors import DriveError

#: What a unit is a number of: rad of the motor, m of the load, position units of the drive, increments of the encoder.
Of = Literal["rad", "m", "unit", "count"]
TURN: Final = 2.0 * math.pi
RPM: Final = TURN / 60.0

#: Notation indices: numerators, with the seconds that are in them already; and denominators in s, with the power of time.
_NUMERATORS: Final[dict[int, tuple[float, Of, int]]] = {
    0x00: (1.0, "unit", 0),
    0x01: (1.0, "m", 0),
    0x10: (1.0, "rad", 0),
    0x41: (TURN / 360.0, "rad", 0),
    0x42: (TURN / 21600.0, "rad", 0),
    0x43: (TURN / 1296000.0, "rad", 0),
    0xA4: (RPM, "rad", 1),  # of CiA 402 before version 3, where a speed has a dimension of its own
    0xB4: (TURN, "rad", 0),
    0xB5: (1.0, "unit", 0),
    0xC0: (RPM, "rad", 1),
}
_DENOMINATORS: Final = {0x00: (1.0, 0), 0x03: (1.0, 1), 0x47: (60.0, 1), 0x48: (3600.0, 1), 0x57: (1.0, 2)}
_NAMES: Final[dict[str, tuple[float, Of, int]]] = {
    "rad": (1.0, "rad", 0),
    "deg": (TURN / 360.0, "rad", 0),
    "rev": (TURN, "rad", 0),
    "rpm": (RPM, "rad", 1),
    "m": (1.0, "m", 0),
    "mm": (1e-3, "m", 0),
    "um": (1e-6, "m", 0),
    "units": (1.0, "unit", 0),
    "counts": (1.0, "count", 0),
}
_TIMES: Final = {"s": (1.0, 1), "min": (60.0, 1), "ms": (1e-3, 1), "s2": (1.0, 2), "ms2": (1e-6, 2)}
#: ``ms to 3000 rpm``: the time of a ramp to a speed, so that a larger number is a softer ramp.
_RAMP: Final = re.compile(r"^(?P<time>ms|s) to (?P<speed>[0-9.]+) rpm$")
_NAMED: Final = re.compile(r"^(?:(?P<factor>[0-9.eE+-]+) )?(?P<what>[a-z]+)(?P<over>(?:/[a-z]+2?)*)$")


@dataclass(frozen=True)
class RawUnit:
    """One raw number: ``value`` of what it counts, per second to the power ``per``.

    Attributes
    ----------
    ramp : bool
        A raw number n is the time of a ramp, so that the acceleration is ``value``/n.
    """

    value: float
    of: Of
    per: int
    ramp: bool = False


def coded(code: int) -> RawUnit | None:
    """Unit that an object 60A8h to 60AAh tells; None for a code that is not known.

    Parameters
    ----------
    code : int
        Content of the object.
    """
    power = (code >> 24 & 0xFF ^ 0x80) - 0x80
    numerator = _NUMERATORS.get(code >> 16 & 0xFF)
    over = [_DENOMINATORS.get(code >> shift & 0xFF) for shift in (8, 0)]
    if numerator is None or None in over or not -12 <= power <= 12:
        return None
    value, of, per = numerator
    for one in over:
        assert one is not None
        value, per = value / one[0], per + one[1]
    return RawUnit(value * 10.0**power, of, per)


def named(text: str, per: int) -> RawUnit:
    """A unit by its name.

    Parameters
    ----------
    text : str
        Number and name, such as ``0.1 rpm``.
    per : int
        Power of 1/s: 0 of a position, 1 of a speed, 2 of an acceleration.

    Raises
    ------
    ValueError
        For text that is no such unit.
    """
    if ramp := _RAMP.match(text):
        if per != 2:
            raise ValueError(f"{text!r} is an acceleration")
        return RawUnit(float(ramp["speed"]) * RPM / _TIMES[ramp["time"]][0], "rad", 2, ramp=True)
    found = _NAMED.match(text)
    if found is None or found["what"] not in _NAMES:
        raise ValueError(f"{text!r} is no unit; write a number and one of {', '.join(_NAMES)} over {', '.join(_TIMES)}, such as 0.1 rpm")
    value, of, powers = _NAMES[found["what"]]
    value *= float(found["factor"] or 1.0)
    for time in found["over"].split("/")[1:]:
        if time not in _TIMES:
            raise ValueError(f"{text!r} has {time!r} below the line; write {', '.join(_TIMES)}")
        value, powers = value / _TIMES[time][0], powers + _TIMES[time][1]
    if powers != per or not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{text!r} is no {('position', 'speed', 'acceleration')[per]}")
    return RawUnit(value, of, per)


@dataclass(frozen=True)
class UnitSizes:
    """Sizes of the units: one position unit and one increment of the encoder in rad of the motor, one rad of the motor in m of the load.

    None where it is not known.
    """

    unit_rad: float | None
    count_rad: float | None
    m_per_rad: float | None = None

    def si(self, unit: RawUnit, what: str) -> float:
        """One raw number in rad of the motor, per second to its power.

        Parameters
        ----------
        unit : RawUnit
        what : str
            For the message.

        Raises
        ------
        DriveError
            Where what it counts is not known.
        """
        if unit.of == "rad":
            return unit.value
        if unit.of == "unit" and self.unit_rad is not None:
            return unit.value * self.unit_rad
        if unit.of == "count" and self.count_rad is not None:
            return unit.value * self.count_rad
        if unit.of == "m" and self.m_per_rad:
            return unit.value / self.m_per_rad
        needs = {"unit": "its position unit (6091h, 6092h)", "count": "its encoder (608Fh)", "m": "the feed of one turn (6091h, 6092h)"}
        raise DriveError(
            f"the drive counts {what} in something that rests on {needs[unit.of]}, which it does not tell; state "
            "motor.encoder_counts_per_rev in axis.yaml, or the unit in a drive profile (--profile)"
        )
