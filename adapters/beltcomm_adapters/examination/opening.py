"""Questions of every command to a drive before anything moves, asked here by the same functions: capabilities, gains, records."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from beltcomm.drive import Capabilities
from beltcomm.drive.finding import Finding
from beltcomm.drive.objects import name_of
from beltcomm.drive.parameters import GAIN_NAMES
from beltcomm.errors import BusError, DriveError
from beltcomm_adapters.examination.patient import OFF, Check, Patient
from beltcomm_adapters.gains import Parameters
from beltcomm_adapters.identification import FASTEST_RAD_S, read_capabilities, read_top_speed_rad_s, supported_modes, sync_steps
from beltcomm_adapters.trial import AREA, tried

GAINS: Final = "gains"
_OPERATIONAL: Final = 0x05


def _opened(patient: Patient) -> Iterator[Finding]:
    """Capabilities as a command reads them; what can be done with the gains."""
    if patient.scaling is None:
        return  # told under units
    objects, profile = patient.objects, patient.profile
    try:
        table = Parameters(objects, profile, patient.scaling)
        found = read_capabilities(
            objects, profile, patient.scaling, patient.identity, patient.bitrate, False, table.table, table.uncalibrated, None,
            patient.nameplate,
        )  # fmt: skip
    except BusError:
        raise
    except DriveError as error:
        text, remedy = error.fault_and_remedy
        yield Finding(GAINS, "opening", "wrong", f"no command could open this drive: {text}", remedy)
        return
    yield _gains_finding(found)


def _gains_finding(found: Capabilities) -> Finding:
    """Written, calibrated first, or typed in."""
    held = [one for name, one in found.parameters.items() if name in GAIN_NAMES]
    values = {"gains": found.gains, "peak_torque_nm": found.peak_torque_nm, "max_speed_rad_s": found.max_speed_rad_s}
    places = ", ".join(dict.fromkeys(name_of(one.index) for one in held))
    if found.gains == "writable":
        return Finding(GAINS, "gains", "ok", f"the gains can be written: {places}", "", values)
    if found.gains == "to_calibrate":
        return Finding(
            GAINS, "gains", "ok", f"the gains can be written ({places}), once commissioning has measured what one unit of them means, by "
            "small steps at standstill", "", values,
        )  # fmt: skip
    known = "; ".join(f"{term.place}, {term.what} ({term.missing or 'read'})" for term in found.gain_terms)
    return Finding(
        GAINS, "gains", "warning", "the gains cannot be written: nobody knows where they are, or what they mean"
        + (f"; what is said of them: {known}" if known else ""),
        "commissioning moves it with the loop that stands in the drive, and ends with model, gains and what to type into the maker's "
        "tool; a profile of your own makes them writable (`beltcomm drives --new`)", values,
    )  # fmt: skip


def _records(patient: Patient) -> Iterator[Finding]:
    """PDOs and limits of a record, tried and put back."""
    if patient.scaling is None:
        return
    if reason := _why_not(patient):
        yield Finding(AREA, "mapping", "unknown", f"mapping and limits of a record were not tried: {reason}")
        return
    modes = supported_modes(patient.objects, patient.profile)
    period_s, _ = sync_steps(patient.objects, patient.profile)
    fastest_rad_s = read_top_speed_rad_s(patient.objects) or (patient.nameplate.max_speed_rad_s if patient.nameplate else None)
    yield from tried(patient.objects, patient.profile, patient.scaling, modes, period_s, fastest_rad_s or FASTEST_RAD_S)


def _why_not(patient: Patient) -> str:
    if patient.state not in OFF:
        return "the power stage is not off"
    if patient.nmt == _OPERATIONAL:
        return "the node is Operational, so another master may use its PDOs"
    return ""


CHECKS: Final = (Check(GAINS, "opening", _opened), Check(AREA, "mapping", _records))
