"""Condition of the drive in its own words: fault, error register, error history, temperature."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from beltcomm.drive.finding import Finding, Values
from beltcomm.drive.objects import name_of
from beltcomm_adapters.cia402 import State, emergency_text
from beltcomm_adapters.examination.patient import Check, Patient

AREA: Final = "condition"
#: 1001h, CiA 301, 7.5.2.2.
_REGISTER: Final = ("generic", "current", "voltage", "temperature", "communication", "device profile", "reserved", "manufacturer")
_TEMPERATURE: Final = 1 << 3
_HISTORY: Final = 4
_MOVED: Final = (State.SWITCHED_ON, State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE)


def _state(patient: Patient) -> Iterator[Finding]:
    """The state of CiA 402; a fault with its code from 603Fh."""
    word = patient.statusword
    now = patient.state
    values: Values = {"statusword": word, "state": now.name.lower()}
    shown = f"{now.words} (6041h = {word:04X}h)"
    if now in (State.FAULT, State.FAULT_REACTION_ACTIVE):
        code = patient.objects.read_if_there(0x603F, 0, "uint16") or (patient.link.emergency.code if patient.link.emergency else 0)
        meaning = f"error {code:04X}h, {emergency_text(code, patient.profile.emergency)}" if code else "it tells no error code"
        remedy = "remove the cause; commissioning acknowledges the fault itself, and stops when it comes back"
        yield Finding(AREA, "state", "wrong", f"the drive is in {shown}: {meaning}", remedy, {**values, "error_code": code})
    elif now in _MOVED:
        remedy = "keep away from the axis; stop the controller or maker's tool that has enabled it"
        yield Finding(AREA, "state", "wrong", f"the power stage is on, and not by beltcomm: the drive is in {shown}", remedy, values)
    elif now is State.NOT_READY:
        yield Finding(
            AREA, "state", "wrong", f"the drive is in {shown}: it is still starting, or never will", "wait, then look again", values
        )
    else:
        yield Finding(AREA, "state", "ok", f"the drive is in {shown}, no fault", "", values)


def _register(patient: Patient) -> Iterator[Finding]:
    """1001h: the groups of errors that are present, the temperature by itself."""
    bits = patient.objects.read_int(0x1001, 0, "uint8")
    groups = [name for bit, name in enumerate(_REGISTER) if bits >> bit & 1]
    if groups:
        text = f"the error register 1001h = {bits:02X}h reports: {', '.join(groups)}"
        yield Finding(AREA, "error register", "wrong", text, "the drive's state above names the error", {"register": bits})
    else:
        yield Finding(AREA, "error register", "ok", "the error register 1001h is clear", "", {"register": bits})
    place = patient.signal("stage_temperature")
    degrees = patient.objects.read_if_there(*place, "int16") if place else None
    shown = "" if degrees is None or place is None else f"; {name_of(*place)} reads {degrees}"
    if bits & _TEMPERATURE:
        text = f"the drive reports over-temperature (1001h bit 3){shown}"
        yield Finding(AREA, "temperature", "wrong", text, "let motor and drive cool down; look for a jammed axis or a blocked fan")
    else:
        yield Finding(AREA, "temperature", "ok", f"no over-temperature is reported (1001h bit 3){shown}")


def _history(patient: Patient) -> Iterator[Finding]:
    """1003h: errors since it was cleared, youngest first."""
    count = patient.objects.read_if_there(0x1003, 0, "uint8")
    if count is None:
        yield Finding(AREA, "error history", "unknown", "the drive keeps no error history (1003h)")
        return
    codes = [patient.objects.read_int(0x1003, part, "uint32") & 0xFFFF for part in range(1, min(count, _HISTORY) + 1)]
    if not codes:
        yield Finding(AREA, "error history", "ok", "the error history 1003h is empty", "", {"errors": 0})
        return
    told = ", ".join(f"{code:04X}h ({emergency_text(code, patient.profile.emergency)})" for code in codes)
    yield Finding(
        AREA, "error history", "warning", f"the error history 1003h holds {count}, youngest first: {told}",
        "they may be old: writing 0 to 1003h:0, or the maker's tool, clears the list", {"errors": count},
    )  # fmt: skip


CHECKS: Final = (Check(AREA, "state", _state), Check(AREA, "error register", _register), Check(AREA, "error history", _history))
