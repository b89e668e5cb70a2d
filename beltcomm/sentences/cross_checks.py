"""Checks of a diagnosis besides its error: data sheets, resonances, static maps, the bound of friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from beltcomm.axis import Axis
from beltcomm.laboratory.cross_checks import (
    MapCheck,
    Resonances,
    SecondSensor,
    SheetDoubt,
    amplitudes_fitted,
    doubts_of,
    friction_bound,
    map_checks,
    resonances,
    second_sensor,
)
from beltcomm.laboratory.score import ground_of
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.sentences.words import number

if TYPE_CHECKING:  # the report, which searches for nothing, uses this module too
    from beltcomm.laboratory.diagnosis import Diagnosis

#: Share of the squares below which no law of friction is worth looking for, and from which the bound is worth a line.
WORTH = 0.05
#: Orders of a map that are shown, at most.
SHOWN = 6


@dataclass(frozen=True)
class Checks:
    """resonances : None for one rigid body.   amplitudes : whether the records show a dependence on amplitude.   maps : static maps.
    friction_bound : share of the squares that any further law of friction could explain; None where nothing is missing.
    sheets : what contradicts the data sheets.   sensor : what one at the load shows of the compliance before it."""

    resonances: Resonances | None
    amplitudes: bool
    maps: tuple[MapCheck, ...]
    friction_bound: float | None
    sheets: tuple[SheetDoubt, ...]
    sensor: SecondSensor | None = None


def cross_checked(found: Diagnosis, recordings: Sequence[Recording], axis: Axis) -> Checks:
    """All checks of a diagnosis.

    Parameters
    ----------
    found : Diagnosis
    recordings : sequence of Recording
        Of the diagnosis.
    axis : Axis
    """
    model = found.final_fit.model
    places = np.concatenate([piece.motion.theta for piece in found.data.fitted]) * model["transmission.ratio"]
    excited = any(r.sidecar.experiment == "frf" for r in recordings)
    open_question = found.verdict in ("partly explained", "none of the known effects explains this")
    return Checks(
        resonances(model, float(np.median(places))) if excited else None,
        amplitudes_fitted(recordings),
        map_checks(recordings, model),
        friction_bound(found.final_fit, ground_of(found.final_fit, found.data.fitted, axis)) if open_question else None,
        doubts_of(found.final_fit, axis, recordings),
        sensed(model, recordings),
    )


def sensed(model: Model, recordings: Sequence[Recording]) -> SecondSensor | None:
    """A sensor at the load against the antiresonances of a model.

    Parameters
    ----------
    model : Model
        With any bodies.
    recordings : sequence of Recording
        With a sensor at the load, or without.

    Returns
    -------
    SecondSensor or None
        None without one.
    """
    if not any(r.load_position_rad is not None or r.cart_position_m is not None for r in recordings):
        return None
    places = [r.sidecar.start_position_m for r in recordings if r.sidecar.start_position_m is not None]
    own = resonances(model, float(np.median(places)) if places else 0.0)
    return second_sensor(recordings, own.antiresonance_hz if own else ())


def sensor_lines(sensor: SecondSensor | None) -> list[str]:
    """The sensor at the load as a sentence; none where it shows nothing.

    Parameters
    ----------
    sensor : SecondSensor or None
        None for none.
    """
    if sensor is None:
        return []
    seen = f"The load by its sensor swings at {number(sensor.antiresonance_hz, sensor.interval_hz, 'Hz')}"  # what a screen has room for
    where = f"with the motor held ({sensor.column}, which no fit uses)"
    if sensor.model_hz is None:
        return [f"{seen}, the model is one rigid body: something gives way between them, {where}."]
    word = "which confirms it" if sensor.confirms else "which does not agree"
    return [f"{seen}, the model at {sensor.model_hz:.1f} Hz, {word}; {where}."]


def sheet_lines(doubts: Sequence[SheetDoubt]) -> list[str]:
    """Measured values against the data sheets, and below what to check: a wrong data sheet is no effect.

    Parameters
    ----------
    doubts : sequence of SheetDoubt
        In the units of their entries.
    """
    lines = []
    for doubt in doubts:
        what, usual, where = _SHEETS[doubt.entry]
        scale, unit = _UNITS.get(doubt.unit, (1.0, doubt.unit))
        interval = None if doubt.interval is None else scale * doubt.interval
        share = f"{100.0 * abs(doubt.factor - 1.0):.0f} % {'less' if doubt.factor < 1.0 else 'more'} than"
        if doubt.factor > 2.0:
            share = f"{doubt.factor:.3g} times"
        measured = number(scale * doubt.found, interval, unit)
        lines.append(f"Data sheet: {what} {measured}, {share} the {scale * doubt.sheet:.4g} {unit} by axis.yaml{where} (usual: {usual})")
        lines.append("  The measured value is used; nothing has to be added to the model for it.")
        if not doubt.common:
            lines += [f"  {check}" for check in _CHECKS[doubt.entry]]
    common = next((doubt.common for doubt in doubts if doubt.common), "")
    if common:
        lines.append("  Both are off by about one factor, so it is rather a unit than the data sheets:")
        lines.append(f"  {common}.")
        lines.append("  Check the units of the columns and motor.torque_constant_nm_a: everything in N m and kg is off by the same factor.")
    return lines


#: Units of the doubts as they are shown.
_UNITS = {"N/m": (1e-3, "kN/m"), "kg m2": (1e4, "kg cm²")}
#: What stands behind an entry of the axis file: words, what it usually differs by, and where it holds.
_SHEETS = {
    "motor.inertia_kg_m2": ("motor-side inertia", "-17 to +20 %", ""),
    "belt.specific_stiffness_n": ("belt stiffness", "-23 to +30 %", " at the places recorded"),
    "motor.encoder_counts_per_rev": ("steps of the angle", "the same, or a whole share", ""),
}
_CHECKS = {
    "motor.inertia_kg_m2": (
        "Check in axis.yaml: motor.inertia_kg_m2 (1 kg cm² is 1e-4 kg m²; a brake adds to it), inertias of coupling, gearbox and pulley.",
        "Where they are right: the sample period of the records, or the scale of the torque.",
    ),
    "motor.encoder_counts_per_rev": (
        "Check in axis.yaml: motor.encoder_counts_per_rev (lines times four; behind a gearbox more), and the unit of the angle.",
    ),
    "belt.specific_stiffness_n": (
        "Sheets state strands and coupling: teeth in mesh, clamps and bearings make a sound belt softer (5 to 13 % on the thesis's rigs).",
        "Check on the machine: the belt's tension and its clamps.",
        "Check in axis.yaml: belt.specific_stiffness_n, belt.pulley_distance_m, gearbox.ratio, pulley.effective_radius_m.",
        "The radius by hand: turn the motor ten times and measure how far the carriage goes; the stiffness goes with 1/radius².",
    ),
}


def as_data(checks: Checks) -> dict[str, Any]:
    """Checks of a diagnosis for ``--json``.

    Parameters
    ----------
    checks : Checks
        As :func:`cross_checked` made them.
    """
    return {
        "resonances": None if checks.resonances is None else asdict(checks.resonances),
        "static_maps": [{**asdict(check), "confirmed": check.is_confirmed} for check in checks.maps],
        "friction_bound": checks.friction_bound,
        "data_sheet": [asdict(doubt) for doubt in checks.sheets],
        "second_sensor": sensor_data(checks.sensor),
    }


def sensor_data(sensor: SecondSensor | None) -> dict[str, Any] | None:
    """The sensor at the load for ``--json``.

    Parameters
    ----------
    sensor : SecondSensor or None
        None for none.
    """
    return None if sensor is None else {**asdict(sensor), "confirmed": sensor.confirms}


def check_lines(checks: Checks) -> list[str]:
    """Checks of a diagnosis as sentences.

    Parameters
    ----------
    checks : Checks
        As :func:`cross_checked` made them.
    """
    lines = sheet_lines(checks.sheets)
    if checks.resonances is not None:
        low, high = (", ".join(f"{f:.1f}" for f in row) or "none" for row in asdict(checks.resonances).values())
        lines.append(f"The motor's response has its antiresonance at {low} Hz and its resonance at {high} Hz.")
        if not checks.amplitudes:
            lines.append(
                "Whether they depend on the amplitude: cannot tell, the fitted records hold one amplitude. "
                "Record the same excitation at half and at twice the torque."
            )
    for check in checks.maps:
        orders = sorted(check.orders, key=lambda order: -order.model)[:SHOWN]
        seen = ", ".join(f"{order.order:g}: {order.map:.3g} for {order.model:.3g}" for order in orders)
        word = "confirms" if check.is_confirmed else "does not confirm"
        lines.append(f"The static map {check.record} {word} the orders (correlation {check.correlation:.2f}; map for model {seen}).")
        if abs(np.angle(np.exp(1j * check.zero_rad))) > 0.05:
            lines.append(f"  The zero of its angle stands {np.degrees(check.zero_rad):.0f}° from that of the records.")
    if checks.friction_bound is not None:
        share = f"{'at most' if checks.friction_bound > WORTH else 'no more than'} {100.0 * checks.friction_bound:.0f} %"
        lines.append(f"Any further law of friction over speed and direction would explain {share} of the rest.")
    return ["", *lines] if lines else []
