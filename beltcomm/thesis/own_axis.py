"""Chapters 2 to 5 of the design source on an axis of one's own: what its own model and records make of the comparisons."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from beltcomm.arrays import ComplexArray, decibels
from beltcomm.axis import Axis
from beltcomm.control import Cascade, CascadeStructure, Prefilter
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.feedforward import feedforward_from
from beltcomm.design.loops import closed_loop_poles
from beltcomm.design.thesis import ThesisDesign, thesis_design, thesis_margins
from beltcomm.errors import Refused
from beltcomm.model import Model
from beltcomm.model.linear import modes, operating_point, state_space
from beltcomm.recording import Recording
from beltcomm.response import log_spaced_lines
from beltcomm.result import plain
from beltcomm.simulate.stopping import total_friction, total_inertia, total_viscous
from beltcomm.thesis import discretisation, identification
from beltcomm.thesis.closed_loop import FORWARD
from beltcomm.thesis.models import FREQ_HZ, REDUCED, two_mass_of
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, predict_move, tracking_error

_Told = tuple[dict[str, Any], list[str]]

#: Shares of the travel at which resonances are told; of half the sampling rate up to which a record is read; over the resonance.
PLACES, UP_TO, ABOVE = (0.1, 0.5, 0.9), 0.9, 2.0
#: dB within which an approximation stands for the exact response.
NEAR_DB = 1.0


def models(axis: Axis, model: Model, plant: DesignPlant, records: Sequence[Recording]) -> _Told:
    """(2.26), (2.38) to (2.49), figures 2.4 to 2.10, 3.7 and 3.9: belt, approximations, carriage; scatter and lines of the own records.

    Parameters
    ----------
    axis : Axis
    model : Model
        Of the run.
    plant : DesignPlant
        Two masses of the model.
    records : sequence of Recording
        Of the run.

    Returns
    -------
    _Told
        Data for ``--json``, and lines.
    """
    two = two_mass_of(plant)
    text = [
        f"f_r {two.resonance_hz:.2f} Hz (2.44), f_z {two.antiresonance_hz:.2f} Hz (2.45), inertia ratio κ {two.inertia_ratio:.3g} (2.46); "
        f"f_r/f_z = √(1 + κ) = {two.resonance_hz / two.antiresonance_hz:.3g} (2.47)",
    ]
    data: dict[str, Any] = {"resonance_hz": two.resonance_hz, "antiresonance_hz": two.antiresonance_hz, "inertia_ratio": two.inertia_ratio}
    low, high = axis.travel.ends_m
    places = [low + share * (high - low) for share in PLACES]
    known = axis.belt is not None and axis.belt.specific_stiffness_n is not None
    data["places"] = []
    for place in places:
        point = operating_point(model, place, 1.0)
        resonance, held = (min(m.freq_hz for m in modes(model, point, held=one)) for one in ((), ("motor",)))
        sheet = axis.belt_stiffness_n_m(place) if known else math.inf
        data["places"].append({"place_m": place, "resonance_hz": resonance, "antiresonance_hz": held, "sheet_n_m": plain(sheet)})
        belt = f"; data sheet with its coupling {1e-3 * sheet:.0f} kN/m (2.26)" if math.isfinite(sheet) else ""
        text.append(f"  at {place:.2f} m  f_r {resonance:.1f}, f_z {held:.1f} Hz by the model{belt}")
    text.append(f"  found {1e-3 * plant.stiffness_n_m:.1f} kN/m")
    exact = two.torque_to_angle_without_belt_damper().response(FREQ_HZ)
    off = {
        name: np.abs(decibels(one.response(FREQ_HZ) / exact))
        for name, one in (("product", two.product_form()), ("low", two.low_frequency()), ("high", two.high_frequency()))
    }
    worst = int(np.argmax(off["product"]))
    up_to, begin = FREQ_HZ[int(np.argmax(off["low"] > NEAR_DB))], FREQ_HZ[len(FREQ_HZ) - int(np.argmax(off["high"][::-1] > NEAR_DB)) - 1]
    at = np.array([two.antiresonance_hz])
    above = 20.0 * math.log10(abs(two.torque_to_cart().response(at)[0] / (two.transmission_m_rad * two.torque_to_angle().response(at)[0])))
    data |= {
        "product_off_db": float(off["product"][worst]),
        "low_up_to_hz": float(up_to),
        "high_from_hz": float(begin),
        "cart_above_db": above,
    }
    text += [
        f"(2.42) against (2.39): at most {off['product'][worst]:.2f} dB, at {FREQ_HZ[worst]:.1f} Hz; (2.40) within {NEAR_DB:g} dB up to "
        f"{up_to:.3g} Hz, (2.41) from {begin:.3g} Hz",
        f"(2.48) torque to carriage has no antiresonance: at f_z {above:.1f} dB above torque to motor",
    ]
    said, data["records"] = _of_records(records, two.resonance_hz)
    return data, [*text, *said]


def curves(axis: Axis, model: Model, plant: DesignPlant) -> dict[str, tuple[str, dict[str, ComplexArray]]]:
    """Responses of figures 2.7, 2.9 and 2.10 at FREQ_HZ: file name to title and curves.

    Parameters
    ----------
    axis : Axis
        For the ends of its travel.
    model : Model
        Of the run.
    plant : DesignPlant
        Two masses of the model.

    Returns
    -------
    dict of str to tuple of str and dict of str to ndarray of complex
        rad/(N m), and m/(N m) for the carriage.
    """
    two, (low, high) = two_mass_of(plant), axis.travel.ends_m
    exact = {"(2.39) exact": two.torque_to_angle_without_belt_damper(), "(2.40) low": two.low_frequency()}
    exact |= {"(2.41) high": two.high_frequency(), "(2.42) product": two.product_form()}
    places = [low + share * (high - low) for share in PLACES]
    at = {f"{place:.2f} m": state_space(model, operating_point(model, place, 1.0)).response(FREQ_HZ)[:, 0] for place in places}
    motor, cart = two.transmission_m_rad * two.torque_to_angle().response(FREQ_HZ), two.torque_to_cart().response(FREQ_HZ)
    return {
        "own_2_7_approximations": ("Approximations (figure 2.7)", {name: one.response(FREQ_HZ) for name, one in exact.items()}),
        "own_2_9_places": ("Three carriage positions (figure 2.9)", at),
        "own_2_10_cart": ("Motor and carriage (figure 2.10)", {"torque to motor, times i_t": motor, "torque to cart (2.48)": cart}),
    }


def _of_records(records: Sequence[Recording], resonance_hz: float) -> tuple[list[str], list[dict[str, Any]]]:
    """Gain of averaging (3.4), error of a response far above the resonance (figure 3.7), and the lines that a fit takes (3.32)."""
    text, rows = list[str](), list[dict[str, Any]]()
    for recording in records:
        note = recording.sidecar.excitation
        if note is None or note.period_samples is None or note.period_starts is not None:
            continue
        period_s, period = recording.sample_period_s, note.period_samples
        repeats = (len(recording.t_s) - note.first_sample) // period
        rate = UP_TO * 0.5 / period_s
        bands = {"low": (2.0 / (period * period_s), 1.5 * resonance_hz), "above": (min(ABOVE * resonance_hz, 0.7 * rate), rate)}
        found = {
            name: identification.scatter_of_mean(
                recording.torque, recording.position, period_s, (note.first_sample, period, repeats), *band
            )
            for name, band in bands.items()
        }
        if not all(found.values()):
            continue
        lines_hz = np.arange(1, period // 2) / (period * period_s)
        fitted = lines_hz[log_spaced_lines(lines_hz, REDUCED, lines_hz[0], bands["low"][1])] if len(lines_hz) > REDUCED else lines_hz
        rows.append({"record": recording.name, **found, "lines": len(lines_hz), "reduced": len(fitted)})
        words = {name: ", ".join(f"{100 * value:.2g} % of {n}" for n, value in each.items()) for name, each in found.items()}
        text.append(f"  {recording.name:8} up to {bands['low'][1]:.0f} Hz {words['low']}")
        text.append(f"  {'':8} {bands['above'][0]:.0f} to {rate:.0f} Hz {words['above']}")
    if rows:
        first = rows[0]
        text.insert(0, "Scatter of the mean over n periods (3.4; 1/√n for noise alone), and far above the resonance (figure 3.7):")
        counted = f"{first['lines']} lines of {first['record']} reduced to {first['reduced']}"
        text.append(f"(3.32) {counted}, nearly logarithmic, each a line of the record")
    return text, rows


def discretised(plant: DesignPlant, cascade: Cascade, period_s: float) -> _Told:
    """(4.4) to (4.6), (6.1), (6.25): the run's own gains, discrete against continuous, at its own sampling and others.

    Parameters
    ----------
    plant : DesignPlant
        Two masses of the model.
    cascade : Cascade
        Of the run.
    period_s : float, s
        Of the drive's loops.

    Returns
    -------
    _Told
        Data for ``--json``, and lines.
    """
    found = thesis_margins(plant, cascade)
    design = ThesisDesign(cascade, found.crossover_rad_s, found.position_crossover_rad_s)
    periods = sorted({period_s, *discretisation.PERIODS_S[-1:]})
    differences = [row for one in periods for row in discretisation.differences_of(plant, design, one)]
    loops = [discretisation.loop_margins(plant, design, one) for one in periods]
    text = [*discretisation.difference_lines("this run's gains", plant, differences), "", *discretisation.loop_lines(loops)]
    return {"differences": plain(differences), "loops": plain(loops)}, text


def moves(
    plant: DesignPlant, model: Model, path: Trajectory, structure: CascadeStructure, own: Cascade, loop: Loop, apparent_nm_s_rad: float
) -> _Told:
    """Figures 5.1 to 5.4 on the own move: prefilter, feedforward, filter removed, reference behind the same lag; predicted.

    Parameters
    ----------
    plant : DesignPlant
        Two masses of the model.
    model : Model
        Of the run.
    path : Trajectory
        Of the carriage.
    structure : CascadeStructure
    own : Cascade
        Design of the run.
    loop : Loop
        Of the drive, with dead time and limits.
    apparent_nm_s_rad : float, N m s/rad, motor shaft
        Viscous friction around standstill.

    Returns
    -------
    _Told
        Data for ``--json``, and lines.
    """
    text = [f"  {'figure':6} {'':46} {'motor, mm':>10} {'at rest':>8} {'load, mm':>9} {'torque':>9}"]
    rows: list[dict[str, Any]] = []
    friction = {
        "viscous_nm_s_rad": total_viscous(model),
        "coulomb_nm": total_friction(model),
        "apparent_viscous_nm_s_rad": apparent_nm_s_rad,
    }
    forward = {kind: feedforward_from(structure, kind, inertia_kg_m2=total_inertia(model), **friction) for kind in FORWARD}
    wanted: list[tuple[str, str, Cascade]] = []
    solved: dict[str, Cascade] = {}
    for kind in ("none", "notch", "butterworth"):
        try:
            solved[kind] = replace(thesis_design(plant, kind).cascade, filter_reference=False)
        except Refused:
            text.append(f"  5.1    prefilter {kind}: (4.7) to (4.9) have no root on this axis (beltcomm thesis designs --run RUN)")
            continue
        wanted.append(("5.1", f"prefilter {kind}", replace(solved[kind], feedforward=replace(forward["nonlinear"], advance_s=0.0))))
    base = solved.get("butterworth", replace(own, filter_reference=False))
    wanted += [("5.2", f"feedforward {kind}", replace(base, feedforward=replace(forward[kind], advance_s=0.0))) for kind in FORWARD]
    wanted.append(("5.4", "nonlinear, reference behind the same lag", replace(wanted[-1][2], filter_reference=True)))
    wanted.append(("", "this run's design", own))
    for figure, name, cascade in wanted:
        moved = predict_move(model, cascade, path, loop)
        motor, cart = (tracking_error(path.t_s, path.position_m, one) for one in (moved.motor_m, moved.cart_m))
        torque = float(np.max(np.abs(moved.torque_nm)))
        rows.append({"figure": figure, "name": name, "motor_m": motor.dynamic_m, "static_m": motor.static_m, "cart_m": cart.dynamic_m})
        cells = f"{1e3 * motor.dynamic_m:10.3f} {1e3 * motor.static_m:8.3f} {1e3 * cart.dynamic_m:9.3f} {torque:5.2f} N m"
        text.append(f"  {figure:6} {name:46} {cells}")
    text.append(
        "  5.4    up to 5.2 the reference is compared with a velocity that lags by T_R + T/2, hence more than the 1 mm of the source"
    )
    unstable = {
        kind: float(np.max(np.abs(closed_loop_poles(plant, replace(one, prefilter=Prefilter()), structure.period_s))))
        for kind, one in solved.items()
        if kind != "none"
    }
    if unstable:
        sizes = ", ".join(f"{kind} {size:.3f}{' (unstable)' if size >= 1.0 else ''}" for kind, size in unstable.items())
        text.append(f"  5.1    filter removed from its gains: largest |z| {sizes}")
    return {"moves": rows, "filter_removed": unstable}, text
