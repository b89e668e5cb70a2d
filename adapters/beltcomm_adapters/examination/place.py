"""Checks of the place of the axis, as far as the drive knows it: zero, position, end switches, software limits."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from beltcomm.drive.finding import Finding, Values
from beltcomm_adapters.examination.patient import Check, Patient

AREA: Final = "place"
_LOWER, _UPPER = 0x1, 0x2  # 60FDh


def _zero(patient: Patient) -> Iterator[Finding]:
    """Zero of the drive, known or not, and its position, rad at the motor shaft."""
    units = patient.objects.read_int(0x6064, 0, "int32")
    values: Values = {"position_units": units}
    shown = f"position {units} units (6064h)"
    if patient.scaling is not None:
        values["position_rad"] = units * patient.scaling.position_rad
        shown = f"position {units * patient.scaling.position_rad:.4g} rad at the motor"
    place = patient.profile.referenced
    if place is None:
        remedy = "commissioning asks for --home, or for --position with the carriage's place"
        yield Finding(AREA, "zero", "unknown", f"{shown}; this kind of drive does not tell whether it knows its zero", remedy, values)
        return
    index, subindex, bit = place
    known = bool(int.from_bytes(patient.objects.read_bytes(index, subindex), "little") >> bit & 1)
    values["referenced"] = known
    if known:
        yield Finding(AREA, "zero", "ok", f"{shown}; the drive knows its zero", "", values)
    else:
        yield Finding(
            AREA, "zero", "warning", f"{shown}; the drive does not know its zero (not homed)",
            "commission with --home, or measure where the carriage stands and give --position (or --window where nobody knows)", values,
        )  # fmt: skip


def _switches(patient: Patient) -> Iterator[Finding]:
    """60FDh bits 0 and 1: the end switches."""
    word = patient.objects.read_if_there(0x60FD, 0, "uint32")
    if word is None:
        yield Finding(AREA, "end switches", "unknown", "the drive does not tell its end switches (60FDh)")
        return
    values = {"lower": bool(word & _LOWER), "upper": bool(word & _UPPER)}
    if word & _LOWER and word & _UPPER:
        yield Finding(
            AREA, "end switches", "wrong", "both end switches are active (60FDh bits 0 and 1)",
            "they are not wired, or their polarity is set the wrong way (normally open, normally closed): maker's tool", values,
        )  # fmt: skip
    elif word & (_LOWER | _UPPER):
        which, bit = ("lower", 0) if word & _LOWER else ("upper", 1)
        yield Finding(
            AREA, "end switches", "wrong", f"the {which} end switch is active (60FDh bit {bit})",
            "push the carriage off it by hand, with the power off; if it is nowhere near, look at the switch's cable and polarity", values,
        )  # fmt: skip
    else:
        yield Finding(AREA, "end switches", "ok", "no end switch is active (60FDh bits 0 and 1)", "", values)


def _software_limits(patient: Patient) -> Iterator[Finding]:
    """607Dh, and whether the axis stands inside."""
    low = patient.objects.read_if_there(0x607D, 1, "int32")
    if low is None:
        yield Finding(AREA, "software limits", "ok", "the drive has no software limits (607Dh); the host watches the travel")
        return
    high, here = patient.objects.read_int(0x607D, 2, "int32"), patient.objects.read_int(0x6064, 0, "int32")
    if low >= high or (low <= -(2**31) + 1 and high >= 2**31 - 1):
        text = "the software limits 607Dh are off; beltcomm sets them around the travel for each motion"
        yield Finding(AREA, "software limits", "ok", text)
        return
    values: Values = {"low_units": low, "high_units": high}
    if patient.scaling is not None:
        values |= {"low_rad": low * patient.scaling.position_rad, "high_rad": high * patient.scaling.position_rad}
    text = f"the axis stands at {here}, the software limits 607Dh are {low} to {high} units"
    if low <= here <= high:
        yield Finding(AREA, "software limits", "ok", text, "", values)
    else:
        yield Finding(
            AREA, "software limits", "wrong", f"{text}: outside", "push the carriage inside by hand, or correct 607Dh or the zero", values
        )


CHECKS: Final = (Check(AREA, "zero", _zero), Check(AREA, "end switches", _switches), Check(AREA, "software limits", _software_limits))
