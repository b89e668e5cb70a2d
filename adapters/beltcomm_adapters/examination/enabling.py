"""Conditions of the power stage: bus control, DC link, STO, enable inputs."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from beltcomm.drive.finding import Finding, Values
from beltcomm.drive.objects import name_of
from beltcomm_adapters.cia402 import State
from beltcomm_adapters.examination.patient import Check, Patient

AREA: Final = "enabling"
_VOLTAGE, _REMOTE = 1 << 4, 1 << 9  # statusword
#: V: no motor of a belt axis runs below.
_NO_VOLTAGE: Final = 10.0
_FAULTS: Final = (State.FAULT, State.FAULT_REACTION_ACTIVE)


def _control(patient: Patient) -> Iterator[Finding]:
    """Statusword bit 9 and the enable logic: does the drive obey the bus?"""
    remote = bool(patient.statusword & _REMOTE)
    logic = patient.profile.enable_logic
    if logic is not None:
        index, subindex, kind, wanted = logic
        place, value = name_of(index, subindex), patient.objects.read_int(index, subindex, kind)
        values: Values = {"enable_logic": value, "remote": remote}
        if value != wanted:
            yield Finding(
                AREA, "control", "warning", f"the enable logic {place} is {value}: the drive does not obey the bus, only with {wanted}",
                f"nothing to do: beltcomm writes {wanted} while it is connected, and {value} back at the end",
                values,
            )  # fmt: skip
            return
    else:
        values = {"remote": remote}
    if remote:
        yield Finding(AREA, "control", "ok", "the drive obeys the bus (6041h bit 9, remote)", "", values)
    else:
        yield Finding(
            AREA, "control", "wrong", "the drive does not obey the bus (6041h bit 9, remote, is 0)",
            "take control away from the maker's tool, and set the drive's control interface to CANopen", values,
        )  # fmt: skip


def _dc_link(patient: Patient) -> Iterator[Finding]:
    """6079h and statusword bit 4: is there power to move with?"""
    present = bool(patient.statusword & _VOLTAGE)
    millivolts = patient.objects.read_if_there(0x6079, 0, "uint32")
    if millivolts is None:
        shown, values = "the drive does not tell its DC link voltage (6079h)", {}
    else:
        shown, values = f"the DC link is at {1e-3 * millivolts:.0f} V (6079h)", {"dc_link_v": 1e-3 * millivolts}
    if not present or (millivolts is not None and 1e-3 * millivolts < _NO_VOLTAGE):
        bit = "" if present else ", and no power at the stage is reported (6041h bit 4 is 0)"
        remedy = (
            "switch the power supply of the motor on (mains or DC), look at its fuse and contactor; the logic supply alone is not enough"
        )
        yield Finding(AREA, "dc link", "wrong", f"{shown}{bit}", remedy, values)
    else:
        yield Finding(AREA, "dc link", "ok" if millivolts is not None else "unknown", shown, "", values)


def _ready(patient: Patient) -> Iterator[Finding]:
    """The drive's own word whether it could be enabled, where its profile names one; the reason it is not."""
    place = patient.signal("ready_for_enable")
    if place is None:
        yield Finding(
            AREA, "ready", "unknown", "this drive does not tell beforehand whether STO and the enable inputs let it be enabled",
            "if it stays in Switch On Disabled when commissioning enables it, look at these first",
        )  # fmt: skip
        return
    bit = patient.profile.signals["ready_for_enable"]["bit"]
    where = f"{name_of(*place)} bit {bit}"
    if patient.objects.read_int(*place, "uint32") >> bit & 1:
        yield Finding(AREA, "ready", "ok", f"the drive could be enabled ({where}): STO closed, encoder ready, no error")
    elif patient.state in _FAULTS:
        yield Finding(
            AREA, "ready", "wrong", f"the drive cannot be enabled ({where} is 0): its fault stands in the way", "see its state above"
        )
    elif (patient.objects.read_if_there(0x6079, 0, "uint32") or 0) < 1e3 * _NO_VOLTAGE:
        yield Finding(
            AREA, "ready", "wrong", f"the drive cannot be enabled ({where} is 0): its DC link has no voltage", "see the DC link above"
        )
    else:
        yield Finding(
            AREA, "ready", "wrong", f"the drive cannot be enabled ({where} is 0), with power and no fault: STO open or encoder not ready",
            "close the STO circuit (emergency stop, safety door, STO plug), and look at the encoder's cable",
        )  # fmt: skip


def _inputs(patient: Patient) -> Iterator[Finding]:
    """Digital inputs that must be high before the stage may be switched on, where the profile names their bits."""
    place = patient.signal("enable_inputs")
    if place is None:
        return
    entry = patient.profile.signals["enable_inputs"]
    word = patient.objects.read_if_there(*place, "uint32")
    if word is None:
        yield Finding(AREA, "inputs", "unknown", f"the drive does not tell its inputs ({name_of(*place)})")
        return
    low = [name for name, bit in entry["bits"].items() if not word >> bit & 1]
    names = ", ".join(entry["bits"])
    if not low:
        yield Finding(AREA, "inputs", "ok", f"the enable inputs are high ({names})", "", {"inputs": word})
        return
    unsure = patient.profile.sources.get("signals", {}).get("confidence") != "read"
    doubt = " (the position of these bits is not confirmed)" if unsure else ""
    yield Finding(
        AREA, "inputs", "warning" if unsure else "wrong",
        f"{' and '.join(low)} reads low in {name_of(*place)}{doubt}: without it the drive stays in Switch On Disabled",
        "apply 24 V, by the enable switch or the controller",
        {"inputs": word},
    )  # fmt: skip


CHECKS: Final = (
    Check(AREA, "control", _control),
    Check(AREA, "dc link", _dc_link),
    Check(AREA, "ready", _ready),
    Check(AREA, "inputs", _inputs),
)
