"""Raw numbers and what they mean: units, ratings, modes, sync period."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from beltcomm.drive.finding import Finding, State
from beltcomm_adapters.busload import shortest_period_s
from beltcomm_adapters.examination.patient import Check, Patient
from beltcomm_adapters.identification import HOMING_MODE, supported_modes, sync_period_s, sync_steps
from beltcomm_adapters.scaling import read_scaling

AREA: Final = "units"
_MODES: Final = {
    1: "profile position", 2: "velocity", 3: "profile velocity", 4: "profile torque", 6: "homing", 7: "interpolated position",
    8: "cyclic position", 9: "cyclic velocity", 10: "cyclic torque",
}  # fmt: skip


def _scaling(patient: Patient) -> Iterator[Finding]:
    """Position units, ratings; the numbers are there for the comparison with axis.yaml."""
    found = patient.scaling = read_scaling(patient.objects, patient.profile, None, patient.nameplate)
    per_turn = 2.0 * math.pi / found.position_rad
    gear = _gear_ratio(patient)
    values = {"units_per_rev": per_turn, "counts_per_rev": found.counts_per_rev, "gear_ratio": gear}
    text = f"{per_turn:.6g} position units per motor revolution, {found.counts_per_rev} encoder increments"
    if gear != 1.0:
        text += f", gear {gear:g} (6091h)"
    yield Finding(AREA, "position", "ok", text, "", values)
    peak = patient.objects.read_if_there(0x6073, 0, "uint16") or patient.objects.read_if_there(0x6072, 0, "uint16")
    ratings = {"rated_torque_nm": found.rated_torque_nm, "rated_current_a": found.rated_current_a, "peak_permille": peak or 1000}
    text = f"rated torque {found.rated_torque_nm:.4g} N m (6076h), rated current {found.rated_current_a:.4g} A (6075h), "
    text += f"peak {peak / 10:g} %" if peak is not None else "peak not told (6072h, 6073h)"
    for sentence in found.said:
        yield Finding(AREA, "units", "warning", sentence)
    if peak is not None and peak < 1000:
        remedy = "raise the drive's torque or current limit with the maker's tool, unless it is meant so"
        yield Finding(AREA, "ratings", "warning", f"{text}: less than rated", remedy, ratings)
    else:
        yield Finding(AREA, "ratings", "ok", text, "", ratings)


def _gear_ratio(patient: Patient) -> float:
    """Motor revolutions per revolution of the driving shaft, 6091h; 1 where the drive has none."""
    if patient.profile.units != "cia402":
        return 1.0
    parts = [patient.objects.read_if_there(0x6091, part, "uint32") for part in (1, 2)]
    return parts[0] / parts[1] if parts[0] and parts[1] else 1.0


def _modes(patient: Patient) -> Iterator[Finding]:
    """6502h against what beltcomm moves the axis with."""
    has = supported_modes(patient.objects, patient.profile)
    told = "6502h" if patient.objects.read_if_there(0x6502, 0, "uint32") is not None else "its profile, it has no 6502h"
    missing = {kind: mode for kind, mode in patient.profile.modes.items() if mode not in has}
    text = f"modes of operation by {told}: {', '.join(f'{mode} {_MODES.get(mode, chr(63))}' for mode in sorted(has))}"
    values = {"modes": ", ".join(map(str, sorted(has)))}
    if missing:
        wanted = ", ".join(f"{mode} ({_MODES[mode]}, for {kind})" for kind, mode in missing.items())
        remedy = "commissioning needs torque and position; choose another --profile, or another firmware of the drive"
        state: State = "wrong" if set(missing) & {"torque", "position"} else "warning"
        yield Finding(AREA, "modes", state, f"{text}; missing: {wanted}", remedy, values)
    elif HOMING_MODE not in has:
        yield Finding(AREA, "modes", "ok", f"{text}; no homing: --position says where the carriage is", "", values)
    else:
        yield Finding(AREA, "modes", "ok", text, "", values)


def _period(patient: Patient) -> Iterator[Finding]:
    """60C2h against what the bus can carry."""
    stored_s = sync_period_s(patient.objects)
    after_reset = patient.profile.sync_change == "after_reset"
    modes, steps = (
        supported_modes(patient.objects, patient.profile),
        (1e-3 * patient.profile.shortest_sync_ms, 1e-3 * patient.profile.sync_step_ms),
    )
    if not after_reset:
        steps = sync_steps(patient.objects, patient.profile)
    shortest_s = shortest_period_s(patient.profile, modes, patient.bitrate, steps)
    on_bus = f"; the bus carries {1e3 * shortest_s:g} ms and longer" if patient.bitrate else ""
    if stored_s is None:
        unused = "uses no 60C2h (it is 0)" if patient.objects.read_if_there(0x60C2, 1, "uint8") == 0 else "has no 60C2h"
        yield Finding(AREA, "sync period", "ok", f"the drive {unused}{on_bus}", "", {"shortest_s": shortest_s})
        return
    values = {"stored_s": stored_s, "shortest_s": shortest_s}
    text = f"sync period 60C2h = {1e3 * stored_s:g} ms{on_bus}"
    if after_reset and stored_s < shortest_s * (1.0 - 1e-9):
        remedy = f"set 60C2h to {1e3 * shortest_s:g} ms with the maker's tool, save and restart the drive, or raise the bit rate"
        yield Finding(AREA, "sync period", "wrong", f"{text}: the bus would be more than 60 % full", remedy, values)
    else:
        yield Finding(AREA, "sync period", "ok", text + ("" if after_reset else ", set by beltcomm for each record"), "", values)


CHECKS: Final = (Check(AREA, "position", _scaling), Check(AREA, "modes", _modes), Check(AREA, "sync period", _period))
