"""A design as a person types it into the maker's tool: in units that tools have, and in the maker's own where they are known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from beltcomm.control import Cascade
from beltcomm.drive.parameters import GainTerm, cascade_to_parameters
from beltcomm.result import table
from beltcomm.runfolder import RunFolder

_PER_RPM = math.pi / 30.0
#: Digits of a number that somebody types.
DIGITS = 4


def _typed_lines(cascade: Cascade, drive: Mapping[str, Any]) -> list[str]:
    """Each gain in units that tools have, then what the drive calls it, as far as ``results/drive.yaml`` knows."""
    terms, per_amp = [GainTerm(**entry) for entry in drive.get("gain_terms") or ()], _torque_per_amp(drive)
    rows = [[what, " = ".join(ways)] for what, ways in _gains(cascade, per_amp)]
    lines = [
        "To be typed into the maker's tool (at the motor shaft; each way of writing it is the same gain):",
        *table(["", ""], rows, "  ")[1:],
    ]
    if per_amp:
        lines.append(f"  A rms by {per_amp:.4g} N m/A, rated torque over rated current: look whether the tool counts in rms or in peak")
    values = _values(cascade)
    for term in terms:
        lines.append(f"  {_own(term, values, per_amp)}")
    if not terms:
        lines.append(
            "  what this drive calls them is not known: look for velocity (speed) controller and position controller in its manual"
        )
    return lines


def of_run(folder: RunFolder, cascade: Cascade) -> list[str]:
    """Gains to type into the drive of a run; nothing where beltcomm writes them itself.

    Parameters
    ----------
    folder : RunFolder
    cascade : Cascade
        That was designed.
    """
    drive = folder.load_result("drive") or {}
    return _typed_lines(cascade, drive) if drive.get("gains") == "unknown" else []


def _gains(cascade: Cascade, per_amp: float) -> list[tuple[str, list[str]]]:
    """Gains that a cascade needs, and the ways in which tools write them."""
    kp, forward = cascade.kp_nm_s_rad, cascade.feedforward
    found = [
        ("velocity controller, gain", [*_torque(kp, per_amp, "s/rad"), f"{_short(1e3 * kp * _PER_RPM)} mN m per r/min"]),
    ]
    if cascade.ki_nm_rad > 0.0:
        found.append(
            (
                "velocity controller, integral",
                [f"{_short(1e3 * kp / cascade.ki_nm_rad)} ms integral time", *_torque(cascade.ki_nm_rad, per_amp, "/rad")],
            )
        )
    else:
        found.append(("velocity controller, integral", ["none (longest time, or gain 0)"]))
    found.append(("position controller, gain", [f"{_short(cascade.kpp_1_s)} 1/s", f"{_short(0.06 * cascade.kpp_1_s)} (m/min)/mm"]))
    filter_s = cascade.velocity_filter_s
    found.append(
        (
            "filter of the measured speed",
            [f"{_short(1e3 * filter_s)} ms", f"{_short(0.5 / math.pi / filter_s)} Hz"]
            if filter_s > 0.0
            else ["none, or as short as it goes"],
        )
    )
    prefilter = cascade.prefilter
    if prefilter.kind != "none":
        hertz, width = 0.5 * prefilter.omega_rad_s / math.pi, ", low-pass of second order"
        if prefilter.kind == "notch":  # (4.1): damping d_n below and 1/d_n above
            width = f", {_short(2.0 * prefilter.d_n * hertz)} Hz wide, {_short(40.0 * math.log10(prefilter.d_n))} dB deep"
        found.append((f"{prefilter.kind} on the speed error", [f"{_short(hertz)} Hz{width}"]))
    if prefilter.roll_off_rad_s:
        found.append(("low-pass behind it", [f"{_short(0.5 * prefilter.roll_off_rad_s / math.pi)} Hz"]))
    if forward.velocity:
        found.append(("velocity feedforward", [f"{100.0 * forward.velocity:.0f} %"]))
    if forward.inertia_kg_m2:
        found.append(
            (
                "acceleration feedforward",
                [f"{_short(1e4 * forward.inertia_kg_m2)} kg cm²", *_torque(forward.inertia_kg_m2, per_amp, "s²/rad")],
            )
        )
    if forward.viscous_nm_s_rad:
        found.append(("friction feedforward, by speed", _torque(forward.viscous_nm_s_rad, per_amp, "s/rad")))
    if forward.coulomb_nm:
        found.append(("friction feedforward, constant", _torque(forward.coulomb_nm, per_amp, "")))
    return found


def _torque(value: float, per_amp: float, by: str) -> list[str]:
    unit = f" {by}" if by and not by.startswith("/") else by
    found = [f"{_short(value)} N m{unit}"]
    return [*found, f"{_short(value / per_amp)} A{unit}"] if per_amp else found


def _values(cascade: Cascade) -> dict[str, float]:
    values = cascade_to_parameters(cascade)
    return {**values, "integral_time_s": cascade.kp_nm_s_rad / cascade.ki_nm_rad if cascade.ki_nm_rad else math.inf}


def _own(term: GainTerm, values: Mapping[str, float], per_amp: float) -> str:
    """One of the maker's own."""
    told = f"{term.place}, {term.what}"
    if term.parameter not in values or not term.scale or (term.current and not per_amp) or not math.isfinite(values[term.parameter]):
        return f"{told}: not known is the {term.missing or 'unit'}"
    number = values[term.parameter] / term.scale / (per_amp if term.current else 1.0)
    doubt = f" (not known is the {term.missing})" if term.missing else ""
    return f"{told}: {_short(number)} {term.unit}".rstrip() + doubt


def _torque_per_amp(drive: Mapping[str, Any]) -> float:
    """N m per A rms; 0 where the drive tells no ratings."""
    torque, current = drive.get("rated_torque_nm") or 0.0, drive.get("rated_current_a") or 0.0
    return torque / current if torque > 0.0 and current > 0.0 and math.isfinite(torque / current) else 0.0


def _short(value: float) -> str:
    return f"{value:.{DIGITS}g}"
