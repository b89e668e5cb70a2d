"""Comparisons of the design source, on the model and the records of one's own run."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.arrays import rms
from beltcomm.control import Cascade
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import closed_loop_poles
from beltcomm.design.thesis import thesis_design, thesis_margins
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.encoder.estimators import velocities
from beltcomm.encoder.formulas import (
    crossing_speed_m_s,
    event_counter_delay_s,
    event_counter_worst_percent,
    gate_delay_s,
    gate_error_percent,
    high_pass_delay_s,
    high_pass_worst_percent,
)
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.foreign.edgetimes import read_edges
from beltcomm.given import Place, pasted, place
from beltcomm.model import Model
from beltcomm.result import Result, plain
from beltcomm.rundata import offline
from beltcomm.rundata.offline import estimator_settings, structure_of
from beltcomm.rundata.proof import move_of
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.own_words import own_words
from beltcomm.simulate.stopping import total_friction, total_viscous
from beltcomm.thesis import excitations, identification
from beltcomm.thesis.closed_loop import CutOff
from beltcomm.thesis.excitations import LIMITS as SOURCE_LIMITS
from beltcomm.thesis.excitations import ExcitationStudy, ExcitedAxis
from beltcomm.thesis.identification import IdentificationStudy
from beltcomm.thesis.own_axis import curves, discretised, models, moves
from beltcomm.thesis.topics import TOPICS, draw_figures, save_figures
from beltcomm.trajectory import at_rest, join
from beltcomm.verify import Loop, demand, predict_move, tracking_error

#: Variants on which the claim of 5.1 is examined: words, factor on stiffness, factor on mass.
VARIANTS = (
    ("as found", 1.0, 1.0),
    ("belt twice as stiff", 2.0, 1.0),
    ("belt half as stiff", 0.5, 1.0),
    ("half the load", 1.0, 0.5),
    ("a tenth of the load", 1.0, 0.1),
    ("load and a half", 1.0, 1.5),
)
#: Shares of the torque that the move takes at which it is cut off; s of rest around it.
CUTS, REST_S = (0.95, 0.8), 1.7
#: s: of the edge timing of the source; speeds over the axis's own at which estimators are compared.
TICK_S, SHARES = 1e-8, (1e-4, 1e-3, 1e-2, 0.1, 0.5, 1.0)
#: deg: of a level axis that is tilted in thought; s of the integrator.
TILT_DEG, INTEGRATES_S, STEP_S = 20.0, 30.0, 1e-3

#: Of the belt's force limit, what an excitation may use.
BELT_SHARE = 0.9
#: Seeds of the noise there: each is a fit of four records.
OWN_SEEDS = (1, 2)

#: Counts in a sampling period, between which edges of a file are judged; names of the estimators.
BANDS = (0.0, 0.1, 1.0, 2.0, 10.0, 100.0, math.inf)
NAMES = {"high_pass": "high-pass", "event_counter": "event counter", "gate": "gate", "combined": "combination"}

_Told = tuple[dict[str, Any], list[str]]


@own_words
def own_thesis(topic: str, run: Place, edges: Place | None = None, *, pictures: Place | None = None, command: str = "") -> Result:
    """A topic of the design source on the model of a run.

    Parameters
    ----------
    topic : str
        One of ``OWN``.
    run : Place
        Run folder.
    edges : Place or None
        Of ``_estimators``: a file of edge times of the axis's own encoder, on which they are tried.
    pictures : Place or None
        Of ``models``, ``excitations`` and ``identification``: folder for their figures.
    command : str
        Command line, kept as provenance.

    Raises
    ------
    UsageError
        For a topic that has nothing to do with one's own axis.
    DataError
        For a run without a model of an elastic axis where one is compared, a file that holds no edges.
    """
    if topic not in {**OWN, **STUDIES}:
        raise UsageError(f"{topic} is not compared on a run; on a run are {', '.join((*OWN, *STUDIES))}")
    if edges is not None and topic != "estimators":
        raise UsageError(f"edge times say nothing of {topic}; they go with estimators")
    folder = RunFolder.open(place(run))
    model = offline.saved_model(folder)
    if topic != "estimators" and ("cart" not in model.base_bodies or not model.get("belt_stiffness.stiffness")):
        raise DataError(f"the model of {folder.path} has no belt of one stiffness, which the design source speaks of")
    if topic in STUDIES:
        study = STUDIES[topic](folder, model)
        made = draw_figures(topic, study, place(pictures, "folder"), command) if pictures is not None else []
        text = [*importlib.import_module(f"beltcomm.thesis.{topic}").lines(study), *(f"drawn: {path}" for path in made)]
        return Result({"topic": topic, "run": str(folder.path), **plain(study), "pictures": made}, text)
    if pictures is not None and topic != "models":
        raise UsageError(f"{topic} draws nothing on a run; beltcomm report {pasted(folder.path)} draws its responses, loops and moves")
    data, text = OWN[topic](folder, model) if edges is None else _on_edges(folder, model, place(edges, "file"))
    if pictures is not None:
        from beltcomm.report.style import Caption
        from beltcomm.thesis.figures.models import bode

        caption = Caption(command or f"beltcomm thesis {topic}", TOPICS[topic].source)
        drawn = {name: bode(title, shown, caption) for name, (title, shown) in curves(folder.axis, model, _plant(folder, model)).items()}
        text += [f"drawn: {path}" for path in save_figures(drawn, place(pictures, "folder"))]
    return Result({"topic": topic, "run": str(folder.path), **data}, text)


def _plant(folder: RunFolder, model: Model) -> DesignPlant:
    """The run's axis as (2.42) has it, with friction of the moving axis and the dead time that was found."""
    delay = (folder.load_result("fit") or {}).get("dead_time") or {}
    return DesignPlant(
        model["motor.inertia"],
        model["transmission.ratio"],
        model["cart.mass"],
        model["belt_stiffness.stiffness"],
        model.get("viscous.damping"),
        model.get("viscous_cart.damping"),
        model.get("belt_damping.damping"),
        float(delay.get("value_s") or 1e-3),
        "own axis",
    )


def _designs(folder: RunFolder, model: Model) -> _Told:
    """(4.7) to (4.9), (4.13), (4.14) solved as printed, and whether the Butterworth is more robust than the notch (5.1)."""
    plant, period = _plant(folder, model), structure_of(folder).period_s
    text = [
        "(4.7) to (4.9) as printed: 60 deg, -10 dB at the resonance, T_R 2 ms; (4.13), (4.14): 80 deg. Own axis: "
        f"antiresonance {plant.antiresonance_rad_s / math.tau:.1f} Hz, resonance {plant.resonance_rad_s / math.tau:.1f} Hz",
        "With the friction of the moving axis; the source's own gains rest on what friction around standstill poses as (erratum 7).",
        f"  {'prefilter':12} {'K_P':>8} {'K_I':>7} {'K_PP':>7} {'crossover':>10}   margins: velocity, at ω_r, position",
    ]
    rows: dict[str, Any] = {}
    solved: dict[str, Cascade] = {}
    for kind in ("none", "notch", "butterworth"):
        try:
            found = thesis_design(plant, kind)
        except Refused as error:
            rows[kind] = {"refused": str(error)}
            text.append(f"  {kind:12} no root: {error}")
            continue
        one, margins = found.cascade, thesis_margins(plant, found.cascade)
        solved[kind] = one
        rows[kind] = {"kp": one.kp_nm_s_rad, "ki": one.ki_nm_rad, "kpp": one.kpp_1_s, "crossover_rad_s": found.crossover_rad_s}
        text.append(
            f"  {kind:12} {one.kp_nm_s_rad:8.4f} {one.ki_nm_rad:7.3f} {one.kpp_1_s:7.2f} {found.crossover_rad_s:5.1f} rad/s   "
            f"{margins.phase_margin_deg:.1f}°, {margins.suppression_db:.1f} dB, {margins.position_phase_margin_deg:.1f}°"
        )
    saved = saved_design(folder).get("parameters") or {}
    if saved:
        text.append(
            f"  {'the run':12} {saved['kp_nm_s_rad']:8.4f} {saved['ki_nm_rad']:7.3f} {saved['kpp_1_s']:7.2f}                  "
            "proven on every place, load and damping (`beltcomm design`)"
        )
    variants: dict[str, dict[str, Any]] = {}
    if {"notch", "butterworth"} <= set(solved):
        text += [
            "",
            "'Butterworth is more robust than the notch' (5.1): largest |z| of the closed cascade, margin of the velocity loop",
        ]
        text.append(f"  {'':22} {'notch':>20} {'Butterworth':>20}")
        left: dict[str, list[float]] = {"notch": [], "butterworth": []}
        for words, stiffer, heavier in VARIANTS:
            other = replace(plant, stiffness_n_m=stiffer * plant.stiffness_n_m, mass_kg=heavier * plant.mass_kg)
            pair = {kind: _robust(other, solved[kind], period) for kind in ("notch", "butterworth")}
            variants[words] = {kind: {"largest_pole": z, "phase_margin_deg": margin} for kind, (z, margin) in pair.items()}
            for kind, (z, margin) in pair.items():
                left[kind].append(-math.inf if z >= 1.0 or margin is None else margin)
            text.append(f"  {words:22} " + " ".join(f"{_robust_words(*pair[kind]):>20}" for kind in ("notch", "butterworth")))
        others = len(VARIANTS) - 1
        lost = {kind: [margins[0] - one for one in margins[1:]] for kind, margins in left.items()}
        better = sum(b <= n + 0.05 for n, b in zip(lost["notch"], lost["butterworth"], strict=True))
        told = "holds" if better == others else "does not hold" if better == 0 else "holds for some and fails for others"
        text.append(
            f"  the claim {told}: the Butterworth loses no more margin than the notch in {better} of {others} variants of this axis"
        )
    return {"equalities": rows, "robustness": variants}, text


def _robust(plant: DesignPlant, cascade: Cascade, period: float) -> tuple[float, float | None]:
    largest = float(np.max(np.abs(closed_loop_poles(plant, cascade, period))))
    try:
        return largest, thesis_margins(plant, cascade).phase_margin_deg
    except Refused:
        return largest, None


def _robust_words(largest: float, margin: float | None) -> str:
    return f"{largest:.4f} {'unstable' if largest >= 1.0 else '-' if margin is None else f'{margin:.0f}°':>9}"


def _closed_loop(folder: RunFolder, model: Model) -> _Told:
    """Figures 5.1 to 5.4 on the own move, and figure 6.10: the torque cut off, with conditional integration (6.26) and without."""
    structure, saved, axis = structure_of(folder), saved_design(folder), folder.axis
    cascade, delay_s = offline.cascade_of(saved, model, structure, None)
    move = move_of(folder, structure.period_s, None)
    start, end = float(move.position_m[0]), float(move.position_m[-1])
    path = join([move, at_rest(end, REST_S, structure.period_s)])
    needs = demand(move, model).torque_nm
    counts = offline.counts_of(folder)
    apparent = float(saved.get("apparent_damping_nm_s_rad") or 0.0)
    loop = Loop(structure, delay_s, axis.motor.peak_torque_nm or axis.torque_limit_nm, counts)
    data, table = moves(_plant(folder, model), model, path, structure, cascade, loop, apparent)
    text = [
        f"Figures 5.1 to 5.4 on this run's move, {1e3 * abs(end - start):.0f} mm in {move.duration_s:.2f} s, {needs:.2f} N m; predicted",
        *table,
        "Figure 6.10 on this run's gains, simulated",
        f"  {'torque cut off at':>18} {'':24} {'following':>12} {'at rest':>10} {'beyond the goal':>16}",
    ]
    rows = []
    for share in CUTS:
        most = share * needs
        for words, known in (("without anti-windup", 1e6), ("conditional integration", most)):
            moved = predict_move(model, cascade, path, Loop(structure, delay_s, known, counts), plant=CutOff(model, most, start))
            error = tracking_error(path.t_s, path.position_m, moved.motor_m)
            found = {"dynamic_m": error.dynamic_m, "static_m": error.static_m, "beyond_m": error.overshoot_m}
            rows.append({"cut_nm": most, "way": words, **found})
            cells = [f"{1e3 * value:.{digits}f} mm" for value, digits in zip(found.values(), (2, 3, 2), strict=True)]
            text.append(f"  {most:14.2f} N m {words:24} {cells[0]:>12} {cells[1]:>10} {cells[2]:>16}")
    return {**data, "windup": rows, "needs_nm": needs}, text


def _estimators(folder: RunFolder, model: Model) -> _Told:
    """The four velocity estimators of 6.1 at the own encoder, sampling and speeds: which errs least, and how late each is."""
    settings = estimator_settings(folder, TICK_S)
    step, period, lag = model["transmission.ratio"] * settings.increment_m, settings.period_s, settings.lag_s
    top = min(folder.axis.limits.speed_m_s or 1.0, 0.9 * step / TICK_S)
    crossing = crossing_speed_m_s(step, TICK_S, period, sign=-1)
    text = [
        f"Increment {1e6 * step:.3g} µm, sampling {1e3 * period:g} ms, edges by {1e9 * TICK_S:g} ns, T_R {1e3 * lag:g} ms; errors at worst",
        f"  {'speed':>12} {'difference':>12} {'high-pass':>11} {'event counter':>14} {'gate':>9}   least, late by; %",
    ]
    rows = []
    for share in SHARES:
        speed = share * top
        gate_late, event_late = float(gate_delay_s(speed, step)[1]), float(event_counter_delay_s(speed, step, period)[1])
        worst = {
            "difference": (float(high_pass_worst_percent(speed, step, period, 0.0)), high_pass_delay_s(period, 0.0)),
            "high-pass": (float(high_pass_worst_percent(speed, step, period, lag)), high_pass_delay_s(period, lag)),
            "event counter": (float(event_counter_worst_percent(speed, step, TICK_S, period)), event_late),
            "gate": (float(gate_error_percent(speed, step, TICK_S, sign=-1)), gate_late),
        }
        known = {name: pair for name, pair in worst.items() if math.isfinite(pair[0])}
        best = min(known, key=lambda name: known[name][0])
        rows.append({"speed_m_s": speed, "best": best, **{name: pair[0] for name, pair in known.items()}})
        cells = [f"{worst[name][0]:.3g}" if name in known else "-" for name in worst]
        text.append(
            f"  {1e3 * speed:8.3g} mm/s {cells[0]:>12} {cells[1]:>11} {cells[2]:>14} {cells[3]:>9}   {best}, {1e3 * known[best][1]:.3g} ms"
        )
    text += [
        "The event counter's worst is that of its fewest intervals: (6.12) is no bound; (C.6) with the factor 100 that its print lacks.",
        f"Gate below and event counter above {1e3 * crossing:.3g} mm/s (6.19) is what the combination takes on this axis.",
        "A drive that gives counts at the sampling alone has the first two; T_R is chosen in `beltcomm design` (--velocity-filter).",
    ]
    return {"increment_m": step, "crossing_m_s": crossing, "rows": rows}, text


def _on_edges(folder: RunFolder, model: Model, path: Path) -> _Told:
    """The four estimators on edges of a file, against the mean speed of the edges over two periods around each sampling instant."""
    found = read_edges(path)
    settings = estimator_settings(folder, found.edges.tick_s)
    settings = replace(settings, increment_m=model["transmission.ratio"] * settings.increment_m)
    step, period = settings.increment_m, settings.period_s
    last_s = float(found.edges.tick[-1]) * found.edges.tick_s
    if last_s < 10.0 * period:
        raise DataError(
            f"the edges of {path} last {1e3 * last_s:.3g} ms, less than ten periods of {1e3 * period:g} ms; give a longer record"
        )
    read = velocities(replace(found.edges, increment_m=step), settings, last_s)
    t = found.start_s + read.t_s
    true = step * (found.counts_at(t + period) - found.counts_at(t - period)) / (2.0 * period)
    known, per_period = ~np.isnan(true), np.abs(true) * period / step
    text = [
        *found.notes,
        f"{len(found.edges.tick)} edges in {last_s:.4g} s, {int(np.count_nonzero(known))} periods of {1e3 * period:g} ms, increment "
        f"{1e6 * step:.3g} µm; rms of each against the edges' mean speed over two periods, mm/s",
        f"  {'counts a period':>16} {'periods':>8} {'high-pass':>10} {'event counter':>14} {'gate':>9} {'combined':>9}   least",
    ]
    rows = []
    for low, high in pairwise(BANDS):
        here = known & (per_period >= low) & (per_period < high)
        if not here.any():
            continue
        off = {name: 1e3 * rms((getattr(read, name) - true)[here]) for name in NAMES}
        usable = off if low >= 2.0 else {name: value for name, value in off.items() if name != "event_counter"}
        best = min(usable, key=lambda name: usable[name])
        rows.append({"from_counts": low, "to_counts": high, "periods": int(here.sum()), "best": best, "rms_mm_s": off})
        band = f"{low:g} to {high:g}" if math.isfinite(high) else f"above {low:g}"
        cells = [f"{off[name]:.3g}" if name in usable else "-" for name in NAMES]
        text.append(f"  {band:>16} {here.sum():8d} {cells[0]:>10} {cells[1]:>14} {cells[2]:>9} {cells[3]:>9}   {NAMES[best]}")
    text.append("What lags errs while the axis accelerates. As code for firmware: beltcomm export RUN --format c --part encoder")
    return {"edges": len(found.edges.tick), "invalid": read.invalid, "increment_m": step, "rows": rows}, text


def _gravity(folder: RunFolder, model: Model) -> _Told:
    """Chapter 7's slow integrator, simulated on the own model, against half sums of creep, from which Coulomb friction falls out."""
    ratio, friction = model["transmission.ratio"], total_friction(model)
    own = folder.axis.mounting.tilt_deg or TILT_DEG
    inertia = model["motor.inertia"] + ratio**2 * model["cart.mass"]
    held = ratio * model["cart.mass"] * GRAVITY_M_S2 * math.sin(math.radians(own))
    settled = [_integrated(held, friction, total_viscous(model), inertia, held + side * 2.0 * friction) for side in (-1.0, 1.0)]
    halves = 0.5 * ((held + friction) + (held - friction))
    text = [
        f"Gravity on {own:g} deg with this load: {1e3 * held:.1f} mN m at the motor; Coulomb friction {1e3 * friction:.1f} mN m",
        f"  slow integrator (chapter 7), begun below and above   {1e3 * settled[0]:.1f} and {1e3 * settled[1]:.1f} mN m",
        f"  half the sum of slow creep both ways (erratum 11)    {1e3 * halves:.1f} mN m",
        "The integrator ends where friction lets the carriage stand, within gravity ± Coulomb friction: it says from which side it came.",
        "Creep slides, so friction has its full size and opposite signs, and falls out of the half sum. On a tilted axis",
        "`beltcomm identify` measures both.",
    ]
    return {"tilt_deg": own, "gravity_nm": held, "friction_nm": friction, "integrator_nm": settled, "half_sum_nm": halves}, text


def _integrated(held: float, friction: float, viscous: float, inertia: float, begin: float) -> float:
    """Torque at which a slow integrator of the speed leaves a rigid axis with Coulomb friction, N m."""
    torque, speed = begin, 0.0
    gain, damping = 0.2 * friction, 0.2 * friction  # N m/rad and N m s/rad: seconds to give way
    for _ in range(round(INTEGRATES_S / STEP_S)):
        drive = torque - damping * speed - held
        if speed == 0.0 and abs(drive) <= friction:
            break
        moving = math.copysign(friction, speed if speed != 0.0 else drive)
        after = speed + STEP_S * (drive - moving - viscous * speed) / inertia
        speed = 0.0 if after * speed < 0.0 else after
        torque -= gain * speed * STEP_S
    return torque


def _belt_and_records(folder: RunFolder, model: Model) -> _Told:
    """Chapter 2, and what chapter 3 says of any record, on the own ones."""
    records = [one for one in folder.recordings() if one.sidecar.experiment == "frf"]
    return models(folder.axis, model, _plant(folder, model), records)


def _discretised_gains(folder: RunFolder, model: Model) -> _Told:
    """The run's design, discrete against continuous."""
    structure = structure_of(folder)
    cascade, _ = offline.cascade_of(saved_design(folder), model, structure, None)
    return discretised(_plant(folder, model), cascade, structure.period_s)


def _excited(folder: RunFolder, model: Model) -> ExcitationStudy:
    """The four signals on the own model, inside the own limits."""
    axis = folder.axis
    torque_nm = axis.motor.peak_torque_nm or axis.torque_limit_nm
    limits = replace(SOURCE_LIMITS, torque_nm=torque_nm, belt_force_n=BELT_SHARE * axis.belt_force_limit_n)
    return excitations.compare([ExcitedAxis("own axis", model, axis.travel.middle_m, limits, offline.counts_of(folder), OWN_SEEDS)])


def _ways(folder: RunFolder, model: Model) -> IdentificationStudy:
    """Open loop, direct, indirect and speed setpoint, simulated on the own model with the torque of the own record."""
    notes = [one.sidecar.excitation for one in folder.recordings()]
    amplitude = min((note.amplitude_nm for note in notes if note is not None and note.amplitude_nm), default=identification.AMPLITUDE_NM)
    low, high = folder.axis.travel.ends_m
    zero = _plant(folder, model).antiresonance_rad_s
    return identification.compare(identification.own_rig(model, zero, amplitude, low, high, offline.counts_of(folder)))


#: Topics that there are on a run: those told in a table, and those that are the source's own comparison of another axis.
OWN: Mapping[str, Callable[[RunFolder, Model], _Told]] = {
    "models": _belt_and_records,
    "designs": _designs,
    "discretisation": _discretised_gains,
    "closed-loop": _closed_loop,
    "estimators": _estimators,
    "gravity": _gravity,
}
STUDIES: Mapping[str, Callable[[RunFolder, Model], Any]] = {"excitations": _excited, "identification": _ways}
