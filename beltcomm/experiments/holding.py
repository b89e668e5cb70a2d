"""The torque that holds a tilted axis, found on the machine: felt for, then by two ways that are compared.

(a) the thesis's slow integrating controller (chapter 7): its torque settles where the carriage stands, and within gravity ± Coulomb
    friction it stands under any torque, so where it began decides what it says;
(b) the half sum of the torques up and down, in which friction cancels: at breakaway without any loop, and in slow creep with one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import runs_of
from beltcomm.axis import Axis
from beltcomm.axis.entries import LEVEL_DEG, TrajectoryLimits
from beltcomm.drive import Limits, Motion, Row
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.experiments import phases
from beltcomm.machine import gravity, host_loss
from beltcomm.machine.creep import Enough, creep
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.rundata.first_motions import Breakaway, Holding, HoldingTorque, Settled
from beltcomm.trajectory import Trajectory, at_rest, join, plan_trajectory

#: Feeling: s for which the carriage must stand, m by which it may slip before its stage goes off, and how often another torque is tried.
STAND_S, SLIP_M, TRIES = 0.3, 5e-4, 7
#: Pairs of breakaways, and of slow strokes: their scatter gives the interval.
PAIRS, STROKE_PAIRS = 3, 4
#: Slow creep: m/s, m to either side, s of rest before; share of a stroke that is run-in.
CREEP_M_S, CREEP_M, REST_S, RUN_IN = 4e-3, 2e-3, 0.2, 0.3
#: The integrator begins outside what friction holds by this share of it, and has so many s; s at their end that are read.
OUTSIDE, INTEGRATE_S, READ_S = 0.3, 2.0, 0.3
#: m: the longest slip that the integrator may need.
LONGEST_SLIP_M = 5e-3
#: m: a carriage that moves less while it is read stands.
STOOD_M = 1e-5
#: deg: a stated tilt is not known better.
TILT_READ_DEG = 1.0
#: Record of the slow strokes.
RECORD = "holding"


def _mean_of(values: Sequence[float]) -> HoldingTorque:
    """Mean and its 95 % interval by the scatter (Student's t); infinite for a single value."""
    n = len(values)
    spread = float(stdtrit(n - 1, 0.975) * np.std(values, ddof=1) / math.sqrt(n)) if n > 1 else math.inf
    return HoldingTorque(float(np.mean(values)), spread)


def masses_kg(machine: Machine, torque_nm: float) -> tuple[float, ...]:
    """Lightest, usual and heaviest carriage that a holding torque at this tilt, known within 5 degrees, allows, kg.

    Parameters
    ----------
    machine : Machine
    torque_nm : float, N m, motor shaft
        Holding torque.
    """
    steep = abs(machine.axis.mounting.tilt_deg)
    angles = [min(steep + d * gravity.TILT_ERROR_DEG, 90.0) for d in (1.0, 0.0, -1.0)]
    shares = [gravity.holding_torque_nm(machine.axis, 1.0, max(angle, LEVEL_DEG / 2.0)) for angle in angles]
    return tuple(max(abs(torque_nm) / share, gravity.LIGHTEST_KG) for share in shares)


def sign_and_scale(machine: Machine) -> tuple[Breakaway, Holding]:
    """Find a torque that holds the carriage, then breakaway in both directions from it; check direction and stopping.

    Parameters
    ----------
    machine : Machine

    Raises
    ------
    Refused
        When no torque of those expected holds it or too little is left for a motion.
    DriveError
    SafetyStop
    """
    guess = gravity.expected(machine.axis)
    phases.room_to_creep(machine)
    begun = machine.drive.clock.now()
    torque, slipped = _feel(machine, guess)
    pairs: list[Breakaway] = []
    for number in range(PAIRS):
        pairs.append(_break_away(machine, torque, release=number == 0))
        torque = float(np.mean([_half(pair) for pair in pairs]))
        machine.hold_with(torque)
        if not number:  # before, neither the torque that holds nor the encoder's direction is known: a drive that brakes might drive away
            host_loss.prove(machine, torque)
    machine.machine_seconds += machine.drive.clock.now() - begun
    found = _mean_of([_half(pair) for pair in pairs])
    found = replace(found, interval_nm=math.hypot(found.interval_nm, machine.drive.capabilities.torque_step_nm))  # each onset is in steps
    onsets = [float(np.mean([getattr(pair, name) for pair in pairs])) for name in ("forward_nm", "backward_nm")]
    held = machine.holding_nm if machine.holds_in_loops else 0.0
    breakaway = Breakaway(onsets[0], onsets[1], pairs[-1].slope_nm_s, held)
    machine.folder.journal(
        f"breakaway {onsets[0]:.3f} N m forward, {onsets[1]:.3f} N m backward: {found.torque_nm:.4f} ± {found.interval_nm:.4f} N m hold "
        f"the carriage, expected were {guess.torque_nm:.3f} N m; felt for, it slipped by {1e3 * slipped:.2f} mm at most"
    )
    mass = masses_kg(machine, found.torque_nm)[1]
    gravity.refuse_too_steep(machine.axis, found.torque_nm, breakaway.coulomb_nm, mass, "as measured")
    by = gravity.held_by(machine, found.torque_nm, breakaway.coulomb_nm)
    return breakaway, Holding(guess.torque_nm, guess.bounds_nm, found, breakaway.coulomb_nm, slipped, by)


def _half(pair: Breakaway) -> float:
    return 0.5 * (pair.forward_nm - pair.backward_nm)


def _limits(machine: Machine, release: bool) -> Limits:
    """Small envelope of the first motions.   release : a stop takes the stage off: no loop is known yet to hold the axis."""
    envelope = phases.envelope_around(machine, machine.position_m, phases.SIGN_REACH_M)
    return replace(machine.drive_limits(envelope), release=release)


def _break_away(machine: Machine, torque_nm: float, release: bool) -> Breakaway:
    """One breakaway up and one down, first upwards."""
    found = {}
    low, high = machine.envelope().window_m
    for sign in (math.copysign(1.0, machine.axis.mounting.tilt_deg), -math.copysign(1.0, machine.axis.mounting.tilt_deg)):
        machine.let_settle()
        here = machine.position_m
        left = high - here if sign > 0.0 else here - low
        way, reach = sign * phases.SIGN_TRAVEL_M, min(phases.SIGN_REACH_M, left)
        crept = creep(machine.drive, machine.axis, _limits(machine, release), way, reach, torque_nm, left)
        found[sign] = crept.onset_nm
    return Breakaway(torque_nm + found[1.0], found[-1.0] - torque_nm, crept.slope_nm_s)


def _feel(machine: Machine, guess: gravity.Expected) -> tuple[float, float]:
    """A torque under which the carriage stands, N m, and how far it slipped under others, m.

    Each try ends with the stage off as soon as the carriage has slipped by ``SLIP_M``.   Raises Refused when none does.
    """
    (low, high), torque, slipped = guess.bounds_nm, guess.torque_nm, 0.0
    tried: list[tuple[float, float]] = []
    begun = machine.position_m
    for _ in range(TRIES):
        machine.hold_with(torque)
        machine.let_settle()
        before = machine.position_m
        if abs(before - begun) + slipped > phases.SIGN_REACH_M:
            break
        acceleration = _let_go(machine, torque)
        if acceleration is None:
            return torque, slipped
        slipped = max(slipped, abs(machine.position_m - before))
        machine.folder.journal(f"{torque:.3f} N m do not hold the carriage: {acceleration:+.2f} m/s², {1e3 * slipped:.2f} mm slipped")
        tried.append((torque, acceleration))
        _check_answer(guess, tried)
        low, high = (torque, high) if acceleration < 0.0 else (low, torque)
        torque = 0.5 * (low + high)
    raise Refused(
        f"no torque was found that holds the carriage: it slips under each of {len(tried)} between {guess.bounds_nm[0]:.3f} and "
        f"{guess.bounds_nm[1]:.3f} N m, {1e3 * (before - begun):+.1f} mm by now; look at its guide, its load and at tilt and payload in "
        "axis.yaml"
    )


def _check_answer(guess: gravity.Expected, tried: Sequence[tuple[float, float]]) -> None:
    """Raise Refused when what was tried shows a wrong direction, or a holding torque beyond what was expected."""
    if len(tried) < 2:
        return
    (torque0, acceleration0), (torque1, acceleration1) = tried[-2:]
    if acceleration0 * acceleration1 < 0.0:
        return
    slope = (acceleration1 - acceleration0) / (torque1 - torque0)
    if slope <= 0.0:
        raise Refused(
            f"the carriage slips with {acceleration0:+.2f} m/s² under {torque0:.3f} N m and with {acceleration1:+.2f} m/s² under "
            f"{torque1:.3f} N m: torque and encoder count in opposite directions; set the drive's polarity (607Eh) or the direction of its "
            "encoder. Nothing else was tried"
        )
    stands = torque1 - acceleration1 / slope
    low, high = guess.bounds_nm
    if not low <= stands <= high:
        raise Refused(
            f"the carriage slips to {'positive' if acceleration1 > 0.0 else 'negative'} under {torque0:.3f} and {torque1:.3f} N m, so fast "
            f"that none of the {low:.3f} to {high:.3f} N m that axis.yaml makes likely would hold it: look at the sign of "
            "mounting.tilt_deg (positive when positive travel goes up), its size, and payload.mass_kg"
        )


def _let_go(machine: Machine, torque_nm: float) -> float | None:
    """Acceleration of the carriage under a constant torque, m/s²; None when it stands.   The stage goes off when it slips."""
    period, step = machine.drive.capabilities.sample_period_s, machine.drive.capabilities.torque_step_nm
    constant = np.full(round(STAND_S / period), round(torque_nm / step) * step if step else torque_nm)
    zero = np.zeros(len(constant))
    start = machine.drive.read(["position_rad"])["position_rad"]
    moved = speed = 0.0

    def watch(row: Row) -> None:
        nonlocal moved, speed
        moved, speed = machine.ratio * (row[3] - start), machine.ratio * row[4]
        if abs(moved) > SLIP_M:
            raise Enough

    try:
        machine.drive.record(Motion("torque", period, zero, zero, constant, float(constant[0])), _limits(machine, True), watch)
    except Enough:
        pass
    else:
        if abs(moved) < 0.5 * SLIP_M:
            return None
    # from rest; when the brake had opened is not known, and the first row may be the last
    return math.copysign(max(speed**2 / (2.0 * abs(moved)), 1e-6), moved)


def compare(machine: Machine, holding: Holding) -> Holding:
    """The slow integrating controller from both sides, and slow creep both ways, with the loop that is in the drive for a stop.

    A drive without a position loop that holds the axis has neither: then breakaway stands.

    Parameters
    ----------
    machine : Machine
    holding : Holding
        With the half sum at breakaway.

    Returns
    -------
    Holding
        With what both ways showed, or why not.
    """
    if machine.braking is None or not machine.holds_in_loops or machine.stroking() != "position":
        why = "no loop that holds the axis could be lent to the drive: the half sum at breakaway is used"
        holding = replace(holding, why_not=why)
    else:
        centre = holding.breakaway.torque_nm
        try:
            strokes = _creep(machine)
            found, friction = _half_sums(strokes, machine.ratio)
            holding = replace(holding, creep=found, creep_coulomb_nm=friction)
            centre = found.torque_nm
            settled = [_integrate(machine, centre, side * friction) for side in (-1.0, 1.0)]
            holding = replace(holding, integrators=tuple(settled))
        except (DataError, UsageError) as problem:
            holding = replace(holding, why_not=str(problem))
        machine.hold_with(centre)
    machine.folder.save("results", "gravity", holding.to_dict())
    for line in lines(holding):
        machine.folder.journal(line)
    return holding


def _creep(machine: Machine) -> Recording:
    """Slow strokes both ways around the present place, recorded."""
    at, period = machine.position_m, machine.drive.capabilities.sample_period_s
    slow = TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=1.0, speed_m_s=CREEP_M_S)
    parts, here = [at_rest(at, REST_S, period)], at
    for target in [at + CREEP_M, at - CREEP_M] * STROKE_PAIRS + [at + CREEP_M, at]:
        parts.append(plan_trajectory(here, target, slow, period))
        here = target
    path: Trajectory = join([*parts, at_rest(here, REST_S, period)])
    sidecar = Sidecar("reversal", machine.place_m(at), machine.session_time_s, closed_loop=True)
    return machine.record(RECORD, machine.follow(path, "position"), phases.untuned_envelope(machine), sidecar)


def _half_sums(recording: Recording, ratio: float) -> tuple[HoldingTorque, float]:
    """Holding torque by half sums, and half differences, N m, of the strokes at constant speed.

    τ_g = (τ_up + τ_down)/2  of each pair over the same way; their scatter gives the interval. Raises DataError without two pairs.
    """
    speed = recording.reference_velocity
    if speed is None:
        raise DataError(f"record {recording.name} holds no reference velocity")
    steady = np.abs(np.abs(ratio * speed) - CREEP_M_S) < 1e-3 * CREEP_M_S
    means = []
    for first, last in runs_of(steady):
        begin = first + int(RUN_IN * (last - first))
        if last - begin > 50:
            means.append((float(np.sign(speed[begin])), float(np.mean(recording.torque[begin:last]))))
    whole = means[1:-1]  # the first and the last are half strokes
    if len(whole) < 4:
        raise DataError(f"record {recording.name} holds {len(whole)} slow strokes, at least 4 are needed")
    torques = np.array([torque for _, torque in whole])
    signs = np.array([sign for sign, _ in whole])
    torques, signs = (values[: len(values) // 2 * 2] for values in (torques, signs))
    pairs = 0.5 * (torques[::2] + torques[1::2])
    friction = 0.5 * (float(np.mean(torques[signs > 0.0])) - float(np.mean(torques[signs < 0.0])))
    return _mean_of([float(value) for value in pairs]), friction


def _integrate(machine: Machine, centre_nm: float, friction_nm: float) -> Settled:
    """The thesis's way: a slow integrator, begun outside what friction holds.   friction_nm : with the side's sign.

    τ = τ_0 - K_I ∫φ̇ dt - K_P φ̇:  it settles where the carriage stands.  (An integrator of the position error, as chapter 7 has it, goes on
    rising while the carriage sticks beside its place, until it breaks away to the other side: it hunts and never settles.)
    The slip  i_t ε τ_C/K_I  swings out to twice that.
    """
    ki = machine.drive.read(["ki_nm_rad"])["ki_nm_rad"]
    share = min(OUTSIDE, LONGEST_SLIP_M / machine.ratio * ki / (2.0 * abs(friction_nm)))
    began = centre_nm + (1.0 + share) * friction_nm
    machine.hold_with(began)
    start, period = machine.position_m, machine.drive.capabilities.sample_period_s
    rows: list[tuple[float, float]] = []

    def watch(row: Row) -> None:
        rows.append((row[1], machine.ratio * row[3]))

    machine.run(machine.follow(at_rest(start, INTEGRATE_S, period), "velocity"), phases.untuned_envelope(machine), watch)
    last = np.array(rows[-round(READ_S / period) :])
    seen = np.array(rows)[:, 1]
    slipped, stood = float(np.ptp(seen)), float(np.ptp(last[:, 1])) < STOOD_M
    return Settled(float(np.mean(last[:, 0])), began, slipped, stood)


def plausibility(holding: Holding, model: Model, axis: Axis) -> list[str]:
    """Holding torque found against that of the mass found at the tilt stated, in words:  τ_g = i_t m_c g sin(α).

    Parameters
    ----------
    holding : Holding
        As measured, N m at the motor shaft.
    model : Model
        With the carriage's mass, kg.
    axis : Axis
        With its tilt, deg.
    """
    mass, tilt = model.parameters["cart.mass"], axis.mounting.tilt_deg
    would = gravity.holding_torque_nm(axis, mass.value, tilt)
    share = (mass.interval or 0.0) / mass.value
    off = holding.best.torque_nm - would
    scatter = math.hypot(share * would, holding.best.interval_nm)
    text = (
        f"  the mass found, {mass.value:.4g} ± {mass.interval or math.inf:.2g} kg, at {tilt:g} deg would need {1e3 * would:.1f} ± "
        f"{1e3 * abs(share * would):.1f} mN m: "
    )
    whole = holding.best.torque_nm / gravity.holding_torque_nm(axis, mass.value, 90.0)
    if abs(off) <= scatter:
        return [text + "that fits"]
    if abs(whole) > 1.0:
        return [text + "more is held than a vertical axis would need: a cable, a counterweight or a current offset pulls too"]
    found = math.degrees(math.asin(whole))
    other = f"{1e3 * off:+.1f} mN m differ, as at a tilt of {found:.1f} deg"
    if abs(found - tilt) < TILT_READ_DEG:
        return [text + f"{other}; a spirit level reads no better"]
    return [text + f"{other}: check mounting.tilt_deg, or what else pulls (a cable, a counterweight, a current offset)"]


def lines(holding: Holding) -> list[str]:
    """The ways to measure the holding torque, side by side, as a table in plain text.

    Parameters
    ----------
    holding : Holding
        As measured, N m at the motor shaft.
    """
    low, high = holding.bounds_nm
    friction = holding.friction_nm

    def row(what: str, value: float, interval: float, note: str = "") -> str:
        return f"  {what:46} {1e3 * value:8.1f} ± {1e3 * interval:5.1f} mN m{note}"

    found = [
        "Torque that holds the carriage against gravity, at the motor:",
        f"  {'expected by tilt and payload of axis.yaml':46} {1e3 * holding.expected_nm:8.1f} mN m ({1e3 * low:.0f} to {1e3 * high:.0f})",
    ]
    for settled in holding.integrators:
        side = "below" if settled.began_nm < holding.best.torque_nm else "above"
        still = "" if settled.stood else ", still moving"
        found.append(row(f"(a) slow integrating controller, from {side}", settled.torque_nm, friction, f" (friction holds any{still})"))
    used = "  <- used" if holding.creep is None else ""
    found.append(row("(b) half sum of the breakaway torques", holding.breakaway.torque_nm, holding.breakaway.interval_nm, used))
    if holding.creep is not None:
        found.append(row("(b) half sum of slow creep, up and down", holding.creep.torque_nm, holding.creep.interval_nm, "  <- used"))
    if holding.why_not:
        found.append(f"  not all ways were gone: {holding.why_not}")
    slipped = f"; it slipped by {1e3 * holding.slipped_m:.1f} mm while the torque was felt for" if holding.slipped_m else ""
    found.append(f"  without torque the carriage is held by {holding.held_by}{slipped}")
    return found
