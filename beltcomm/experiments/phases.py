"""The phases of a commissioning, each a step on the machine followed by what it taught.

Every phase predicts what its motion will do before it asks the machine to move, and stays inside :class:`Envelope`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeVar

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.drive import Capabilities, Limits
from beltcomm.errors import NoMotion, Refused, SafetyStop, UsageError
from beltcomm.excitation import AskedExcitation, Choice, Excitation, PrbsChoice, choose, choose_prbs, visible_band
from beltcomm.excitation.record import SELDOM_S
from beltcomm.experiments import own_strokes
from beltcomm.experiments.stops_out_of_move import leaves_by_m, positioning
from beltcomm.given import ExcitationKind
from beltcomm.identify.amplitude import AmplitudeStep, MotionLimits, family_around, largest_amplitude
from beltcomm.machine import exciting, host_loss, stops
from beltcomm.machine.creep import Crept, creep
from beltcomm.machine.heat import Thermal
from beltcomm.machine.machine import Envelope, Machine, stroking
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.rundata import analyse
from beltcomm.rundata.first_motions import MOVED_M, Breakaway
from beltcomm.schedule.orders import SWEEP_LONGEST_S, SWEEP_SHORTEST_S, fastest_stroke_m_s, sweep_strokes
from beltcomm.schedule.sequences import HARDLY, calmer_choice, excitation_travel_m, held_choice
from beltcomm.simulate.stopping import total_friction
from beltcomm.trajectory import Strokes, Trajectory, plan_trajectory, with_dwell

M = TypeVar("M", Trajectory, Strokes)

#: m; how far the carriage goes in the sign check, and with the way of its stop.
SIGN_TRAVEL_M = 2e-3
SIGN_REACH_M = 1e-2

#: Counts of an encoder by which two ways of breaking away are compared, at most this share of the way that counts as moving.
FINE = 0.25

#: m, room kept to the ends of the travel.
END_MARGIN_M = 5e-3

#: Share of the belt force limit that a prediction may use: the models are known to FIRST_ESTIMATE_SPREAD.
BELT_SHARE = 0.9

#: Shares of the travel kept free at both ends: for the overshoot of a first position loop, and for the drift of a velocity loop.
OVERSHOOT_SHARE = 0.06
DRIFT_SHARE = 0.15

#: Positioning, m: near enough to try no more, so far off that the loop cannot be trusted, and how often it is tried.
ARRIVED_M = 1e-3
ASTRAY_M = 2e-2
POSITIONING_TRIES = 4

#: m: first way of a loop whose gains nobody knows.
FELT_M = 5e-3

#: Shares of speed that a motion is slowed down by until every stop ends inside the travel.
STOPPABLE_SHARES = tuple(float(share) for share in np.geomspace(1.0, 0.1, 16))

#: An excitation after one that did not move the axis is louder by this factor at least.
LOUDER = 1.05

#: m: a loop that is further off its reference has lost it; until it is tuned, all that is asked.  Share of the speed that axis and
#: drive allow which a reference may use: what overshoots it must not be stopped.
LOST_M = 5e-2
SPEED_SHARE = 0.95
#: Share of what strokes leave free at the ends that a loop which is not tuned yet must not use.
LAST_BIT = 0.25
#: Share of what a path leaves free at an end of the travel that positioning keeps off.
FREE_END = 0.5
#: Share of the belt's force that motions take which nobody asked for.
GENTLE_SHARE = 1.0 / 3.0

#: m/s: the carriage gets no faster under an excitation, and is brought from place to place no faster.
EXCITATION_SPEED_M_S = 0.5
POSITIONING_SPEED_M_S = 0.5


def envelope_around(machine: Machine, position_m: float, travel_m: float) -> Envelope:
    """Full speed and torque inside a window around a place, cut at the ends of the travel.

    Parameters
    ----------
    machine : Machine
    position_m : float, m
        Of the carriage.
    travel_m : float, m
        Half of the window.
    """
    full = machine.envelope()
    low, high = full.window_m
    return Envelope((max(low, position_m - travel_m), min(high, position_m + travel_m)), full.speed_m_s, full.torque_nm)


def room_to_creep(machine: Machine) -> float:
    """Position of the carriage, m.

    Parameters
    ----------
    machine : Machine

    Raises
    ------
    UsageError
        When that is too near to an end to creep both ways.
    """
    at = machine.position_m
    low, high = machine.envelope().window_m
    if min(at - low, high - at) < 2.0 * SIGN_TRAVEL_M:
        raise UsageError(
            f"the carriage stands at {machine.where(at)}, within {2e3 * SIGN_TRAVEL_M:.0f} mm of an end of its {machine.room_word}; "
            f"{machine.more_room}"
        )
    return at


def sign_and_scale(machine: Machine) -> Breakaway:
    """Let the torque rise until the carriage creeps a few millimetres, both ways; check direction and stopping.

    Parameters
    ----------
    machine : Machine

    Raises
    ------
    Refused
        When nothing moves.
    DriveError
        When positive torque drives to negative position or the axis does not stop.
    """
    low, high = machine.envelope().window_m
    at = room_to_creep(machine)
    limits = machine.drive_limits(envelope_around(machine, at, SIGN_REACH_M))
    limits = replace(limits, release=bool(machine.axis.motor.brake_torque_nm))  # should gravity pull after all, the brake stops it
    host_loss.prove(machine)
    begun = machine.drive.clock.now()
    feel_units(machine, limits, 1.0, min(SIGN_REACH_M, high - at))

    def crept(sign: float) -> Crept:
        here = machine.position_m
        left = high - here if sign > 0.0 else here - low
        return creep(machine.drive, machine.axis, limits, sign * SIGN_TRAVEL_M, min(SIGN_REACH_M, left), left_m=left)

    first, back = crept(1.0), crept(-1.0)
    found = Breakaway(first.onset_nm, back.onset_nm, first.slope_nm_s)
    count_m = math.tau * machine.ratio / machine.drive.capabilities.counts_per_rev
    # Or the belt, which the first way left stretched, helped the second: a weight shows when it helps the first, too.
    if found.holding_nm and count_m < FINE * MOVED_M:
        apart = sorted((0.0, first.onset_nm - back.onset_nm, crept(1.0).onset_nm - back.onset_nm))[1]
        found = replace(found, backward_nm=first.onset_nm - apart)
    machine.machine_seconds += machine.drive.clock.now() - begun
    machine.folder.journal(f"breakaway {found.forward_nm:.3f} N m forward, {found.backward_nm:.3f} N m backward")
    return found


def feel_units(machine: Machine, limits: Limits, sign: float, left_m: float) -> None:
    """Of a drive whose units nobody tells, creep so little that no wrong unit makes a long way of it; the next record knows them.

    Parameters
    ----------
    machine : Machine
    limits : Limits
    sign : float
        Of the first way.
    left_m : float, m
        Free way on the shorter side.
    """
    feel_m = machine.drive.capabilities.feel_rad * machine.ratio
    if feel_m:
        creep(machine.drive, machine.axis, limits, sign * min(feel_m, SIGN_TRAVEL_M), left_m, left_m=left_m)


def motion_limits(machine: Machine, position_m: float) -> MotionLimits:
    """Limits of an excitation at a place.

    Parameters
    ----------
    machine : Machine
    position_m : float, m
        Of the carriage.

    Raises
    ------
    Refused
        Beside an end of the travel.
    """
    full = machine.envelope()
    low, high = full.window_m
    space = min(position_m - low, high - position_m) - END_MARGIN_M
    if space < 2e-3:
        raise Refused(
            f"at {machine.where(position_m)} only {1e3 * space:.1f} mm of {machine.room_word} are left beside the "
            f"{1e3 * END_MARGIN_M:.0f} mm kept to the end; {machine.more_room}"
        )
    travel = min(space, excitation_travel_m(machine.drive.capabilities.sample_period_s))
    return MotionLimits(
        travel,
        min(full.speed_m_s, EXCITATION_SPEED_M_S),
        min(full.torque_nm - abs(machine.holding_nm), excitation_torque_nm(machine.axis, machine.drive.capabilities, machine.holding_nm)),
        BELT_SHARE * machine.axis.belt_force_limit_n - machine.weight_n,
        travel + END_MARGIN_M,
        min(position_m - low, high - position_m),
    )


def excitation_torque_nm(axis: Axis, capabilities: Capabilities, held_nm: float) -> float:
    """Largest amplitude of a binary excitation that a motor bears for ever beside what it holds, N m:  a² + τ_g² ≤ τ_rated².

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    held_nm : float, N m
        Against weight, at the motor.
    """
    rated = Thermal.of(axis, capabilities).rated_nm
    return min(axis.torque_limit_nm, math.sqrt(max(rated**2 - held_nm**2, 0.0)))


def acceleration_m_s2(inertia_kg_m2: float, ratio: float, mass_kg: float, torque_nm: float, friction_nm: float) -> float:
    """Acceleration of a rigid axis by a torque beside friction, which leaves a tenth of it at least, m/s²:  (τ - τ_C)/(Θ_e/i_t + i_t m).

    Parameters
    ----------
    inertia_kg_m2 : float, kg m²
        At the motor.
    ratio : float, m/rad
        i_t, of the carriage per motor angle.
    mass_kg : float, kg
        Of the carriage.
    torque_nm : float, N m
        At the motor.
    friction_nm : float, N m
        At the motor.
    """
    return max(torque_nm - friction_nm, 0.1 * torque_nm) / (inertia_kg_m2 / ratio + ratio * mass_kg)


def check_asked(asked: AskedExcitation, kind: ExcitationKind, axis: Axis, capabilities: Capabilities) -> None:
    """Raise UsageError or Refused for an excitation that this axis and drive cannot be asked for; before anything moves.

    Parameters
    ----------
    asked : AskedExcitation
        By the user.
    kind : ExcitationKind
        Of the sequence.
    axis : Axis
    capabilities : Capabilities
    """
    most = min(excitation_torque_nm(axis, capabilities, 0.0), capabilities.peak_torque_nm)
    asked.check(kind, capabilities.sample_period_s, capabilities.torque_step_nm, most)


def frequency_response(
    machine: Machine,
    name: str,
    model: Model,
    amplitude_nm: float,
    seconds: float,
    *,
    share: float = 1.0,
    held_out: bool = False,
    loud: bool = True,
    up_to_hz: float = 0.0,
    above_nm: float = 0.0,
) -> tuple[Recording, Excitation, AmplitudeStep]:
    """Excite at the present place with an amplitude that the limits allow there, long enough for a frequency response.

    Parameters
    ----------
    machine : Machine
    name : str
        Of the record.
    model : Model
    amplitude_nm : float, N m
        Of the motor.
    seconds : float, s
        Asked for.
    share : float
        Of that amplitude.
    held_out : bool
        Only to judge with; another sequence than those that are fitted, and one measured period of it.
    loud : bool
        Where friction hardly lets the carriage move, the sequence may leave the resonance out to be louder.
    up_to_hz : float
        Power up to there at least, also above the resonance.
    above_nm : float
        What did not move the axis: raises NoMotion where the limits allow no more.
    """
    chosen = partial(response_to_come, machine, model, seconds=seconds, held_out=held_out, loud=loud, up_to_hz=up_to_hz)
    choice, step = chosen(amplitude_nm=amplitude_nm)
    if share < 1.0:
        choice, step = chosen(amplitude_nm=share * step.amplitude_nm)
    louder(machine, step, above_nm)
    return planned_response(machine, name, model, choice, step, held_out=held_out)


def louder(machine: Machine, step: AmplitudeStep, above_nm: float) -> None:
    """Check that a step is louder than what did not move the axis.

    Parameters
    ----------
    machine : Machine
    step : AmplitudeStep
        With its amplitude.
    above_nm : float, N m
        That did not move the axis.

    Raises
    ------
    NoMotion
        Where the limits allow no more.
    """
    if step.amplitude_nm > LOUDER * above_nm:
        return
    raise NoMotion(
        f"±{above_nm:.3f} N m did not move the axis at {machine.where(machine.position_m)}, and the limit on {step.binds} allows only "
        f"±{step.amplitude_nm:.3f} N m: friction holds more than that there; look for a tight spot, a brake or dry guides",
        above_nm,
    )


def planned_response(
    machine: Machine, name: str, model: Model, choice: Choice, step: AmplitudeStep, *, held_out: bool = False
) -> tuple[Recording, Excitation, AmplitudeStep]:
    """Long frequency response with the excitation that :func:`response_to_come` has chosen.

    Parameters
    ----------
    machine : Machine
    name : str
        Of the record.
    model : Model
    choice : Choice
        Of :func:`response_to_come`.
    step : AmplitudeStep
        With its amplitude.
    held_out : bool
        It judges, nothing is fitted to it.

    Returns
    -------
    tuple[Recording, Excitation, AmplitudeStep]
        The record, what excited it, and the step as given.
    """
    at, period = machine.position_m, machine.drive.capabilities.sample_period_s
    excitation = choice.excitation(step.amplitude_nm, period, torque_step_nm=machine.drive.capabilities.torque_step_nm)
    run_on = exciting.run_on_words(machine, step.prediction, motion_limits(machine, at).ends_m)
    machine.folder.journal(
        f"{name}: {choice.reason}; ±{step.amplitude_nm:.3f} N m, limited by {step.binds}; stopping distance at most "
        f"{1e3 * step.prediction.stop_m:.1f} mm; {run_on}"
    )
    context, envelope = (
        exciting.ExcitationContext(step.prediction, family_around(without_offset(model)), host_loss.losses_of(machine)),
        excitation_envelope(machine, at),
    )
    return exciting.excite(machine, name, excitation, at, envelope, context, held_out), excitation, step


def response_to_come(
    machine: Machine,
    model: Model,
    amplitude_nm: float,
    seconds: float,
    *,
    held_out: bool = False,
    loud: bool = True,
    up_to_hz: float = 0.0,
) -> tuple[Choice, AmplitudeStep]:
    """Sequence and amplitude of :func:`frequency_response`; nothing moves.

    Parameters
    ----------
    machine : Machine
    model : Model
    amplitude_nm : float, N m
        Of the motor.
    seconds : float, s
        Asked for.
    held_out : bool
        It judges, nothing is fitted to it.
    loud : bool
        As loud as the limits allow.
    up_to_hz : float, Hz
        Highest line that is asked for.
    """
    at, period = machine.position_m, machine.drive.capabilities.sample_period_s
    limits = motion_limits(machine, at)
    antiresonance, resonance = analyse.characteristic_hz(model, at)
    antiresonance, resonance = visible_band(period, antiresonance, max(resonance, up_to_hz))
    choice: Choice
    if held_out:
        choice = held_choice(choose_prbs(period, antiresonance, resonance, seconds))
    else:
        kind = (
            machine.excitation if machine.excitation != "prbs" or period <= SELDOM_S else "chirp"
        )  # what jumps makes the motor swing unseen
        choice = machine.asked.of(choose(kind, period, antiresonance, resonance, seconds), period)
        if machine.asked.amplitude_nm is not None:
            step = _loudest(machine, model, choice, min(machine.asked.amplitude_nm, amplitude_nm), at, limits)
            machine.asked.amplitude_of(step.amplitude_nm, step.binds)
            return choice, step
    step = _loudest(machine, model, choice, amplitude_nm, at, limits)
    if loud and not machine.asked.shape and isinstance(choice, PrbsChoice) and step.amplitude_nm < HARDLY * total_friction(model):
        calm = calmer_choice(choice, resonance, period)
        louder = _loudest(machine, model, calm, machine.axis.torque_limit_nm, at, limits)
        choice, step = (calm, louder) if louder.amplitude_nm > step.amplitude_nm else (choice, step)
    return choice, step


def _loudest(machine: Machine, model: Model, choice: Choice, at_most_nm: float, at: float, limits: MotionLimits) -> AmplitudeStep:
    """The loudest version of a sequence that keeps the limits."""
    period = machine.drive.capabilities.sample_period_s
    shape = choice.excitation(1.0, period)
    unit = shape.torque / shape.amplitude_nm
    counted = stops.braking_of(machine), host_loss.losses_of(machine)
    return largest_amplitude(family_around(without_offset(model)), unit, period, at, limits, at_most_nm, *counted)


def without_offset(model: Model) -> Model:
    """The model without the constant torque that open-loop records hold.

    Parameters
    ----------
    model : Model
    """
    return model.with_values({name: 0.0 for name in ("constant_offset.torque", "tilt.angle") if name in model.parameters})


def excitation_envelope(machine: Machine, at: float) -> Envelope:
    """Envelope of an excitation at a place.

    Parameters
    ----------
    machine : Machine
    at : float, m
        Of the carriage.
    """
    return envelope_around(machine, at, excitation_travel_m(machine.drive.capabilities.sample_period_s) + END_MARGIN_M)


def move_to(machine: Machine, target_m: float, model: Model, slow_m_s: float = POSITIONING_SPEED_M_S) -> None:
    """Bring the carriage somewhere with the loop that is in the drive; gentle: a third of the belt's force at most.

    Parameters
    ----------
    machine : Machine
    target_m : float, m
        Of the carriage.
    model : Model
    slow_m_s : float, m/s
        At most.

    Raises
    ------
    SafetyStop
        When it does not arrive within ``ASTRAY_M``.
    """
    if machine.drive.capabilities.gains == "unknown" and not machine.loop_tried:
        _feel_loop(machine, target_m, model, slow_m_s)
    limits, period = gentle_limits(machine, model, slow_m_s), machine.drive.capabilities.sample_period_s

    def plan_to_target(share: float) -> Trajectory:
        plan = partial(plan_trajectory, machine.position_m, target_m, sample_period_s=period)
        return with_dwell(stoppable(machine, lambda slower: plan(limits.slower(share * slower))), 0.3)

    for _ in range(POSITIONING_TRIES):  # the velocity loop ends a little beside its goal
        if abs(machine.position_m - target_m) < ARRIVED_M:
            return
        path, envelope = positioning(machine, plan_to_target, _positioning_envelope)
        machine.run(machine.follow(path, machine.stroking()), envelope)
    if abs(machine.position_m - target_m) > ASTRAY_M:
        raise SafetyStop(
            f"the carriage stands at {machine.position_m:.4f} m instead of {target_m:.4f} m after a move; the loop does not hold it",
            "position",
        )


def _feel_loop(machine: Machine, target_m: float, model: Model, slow_m_s: float) -> None:
    """A first short way with a loop whose gains nobody knows: one that does not move the axis is not let wind up for a long one."""
    at = machine.position_m
    if abs(target_m - at) < 2.0 * FELT_M:
        return
    goal_m = at + math.copysign(FELT_M, target_m - at)
    path = plan_trajectory(at, goal_m, gentle_limits(machine, model, slow_m_s), sample_period_s=machine.drive.capabilities.sample_period_s)
    machine.run(machine.follow(with_dwell(path, 0.3), machine.stroking()), untuned_envelope(machine))
    if abs(machine.position_m - goal_m) > 0.5 * FELT_M:
        raise SafetyStop(
            f"the loop that stands in the drive ends a slow stroke of {1e3 * FELT_M:.0f} mm "
            f"{1e3 * abs(machine.position_m - goal_m):.1f} mm beside its goal; the axis was stopped",
            "position",
        )
    machine.loop_tried = True


def untuned_envelope(machine: Machine) -> Envelope:
    """The whole axis for a loop that is not tuned yet.  The drive's own window counts motor revolutions, whatever the gearbox.

    Parameters
    ----------
    machine : Machine
    """
    return replace(machine.envelope(), lag_m=LOST_M + own_strokes.LAG_M * (own_strokes.kpp_1_s(machine) < np.inf))


def _positioning_envelope(machine: Machine, path: Trajectory) -> Envelope:
    """The axis for positioning by such a loop, without half of what the path leaves free at its ends: what overshoots is to stop there."""
    return _without_ends(untuned_envelope(machine), (float(np.min(path.position_m)), float(np.max(path.position_m))), FREE_END)


def stroke_envelope(machine: Machine) -> Envelope:
    """The axis for strokes by such a loop, without the last bit at its ends: what overshoots is to stop on the axis.

    Parameters
    ----------
    machine : Machine
    """
    envelope = untuned_envelope(machine)
    kept = _without_ends(envelope, stroke_ends(machine), LAST_BIT)
    return kept if kept.window_m[0] < machine.position_m < kept.window_m[1] else envelope


def _without_ends(envelope: Envelope, ends_m: tuple[float, float], share: float) -> Envelope:
    """An envelope without a share of what a motion leaves free at either end.   ends_m : of the motion, carriage side, m."""
    (low, high), (first, last) = envelope.window_m, ends_m
    return replace(envelope, window_m=(low + share * max(first - low, 0.0), high - share * max(high - last, 0.0)))


def sidecar(machine: Machine, experiment: str, **more: Any) -> Sidecar:
    """Sidecar of a record in closed loop that begins where and when the machine is.

    Parameters
    ----------
    machine : Machine
    experiment : str
        Kind of record.
    **more : Any
        Further fields.
    """
    return Sidecar(experiment, machine.position_m, machine.session_time_s, closed_loop=True, **more)


def gentle_limits(machine: Machine, model: Model, speed_m_s: float) -> TrajectoryLimits:
    """Speed, acceleration and jerk that load the belt with a third of its force at most, and the motor with what it bears for ever.

    Parameters
    ----------
    machine : Machine
    model : Model
    speed_m_s : float, m/s
        At most.
    """
    limits, top = machine.axis.limits, min(SPEED_SHARE * machine.envelope().speed_m_s, own_strokes.LAG_M * own_strokes.kpp_1_s(machine))
    inertia, ratio, mass = model["motor.inertia"], model["transmission.ratio"], model["cart.mass"]
    borne = excitation_torque_nm(machine.axis, machine.drive.capabilities, machine.holding_nm)
    by_torque = acceleration_m_s2(inertia, ratio, mass, borne, 2.0 * total_friction(model))
    acceleration = min(limits.acceleration_m_s2 or np.inf, GENTLE_SHARE * machine.belt_left_n / mass, by_torque)
    return TrajectoryLimits(jerk_m_s3=20.0 * acceleration, acceleration_m_s2=acceleration, speed_m_s=min(speed_m_s, top))


def stoppable(machine: Machine, plan: Callable[[float], M], leaves_by_m: Callable[[Trajectory, float], float] = lambda *_: 0.0) -> M:
    """The fastest motion that keeps inside the travel with a stop at any moment, or that which leaves it least.

    Neither a fast one nor a slow one leaves it least: friction that a loop does not know drives it the further, the longer a motion takes.
    Where all of them stop badly, the machine itself says of the slowest what is wrong.

    Parameters
    ----------
    machine : Machine
    plan : callable
        Of a share of its speed, to the motion.
    leaves_by_m : callable
        Of a path and a way beyond which nobody asks, as of :func:`beltcomm.experiments.stops_out_of_move.leaves_by_m`.
    """
    best, least_m = None, math.inf
    for share in STOPPABLE_SHARES:
        motion = plan(share)
        path = motion.trajectory if isinstance(motion, Strokes) else motion
        if machine.stops_badly(path.position_m, path.velocity_m_s):
            continue
        beyond_m = leaves_by_m(path, least_m)
        if not beyond_m:
            return motion
        if beyond_m < least_m:
            best, least_m = motion, beyond_m
    return best or motion


def strokes_leave_by_m(machine: Machine, path: Trajectory, enough_m: float = math.inf) -> float:
    """How far strokes leave the axis without the last bit at its ends, m; as :func:`leaves_by_m` of any envelope.

    Parameters
    ----------
    machine : Machine
    path : Trajectory
        Setpoints, m of the carriage.
    enough_m : float, m
        Beyond which nobody asks how far.
    """
    return leaves_by_m(machine, path, stroke_envelope(machine), enough_m)


def stroke_ends(machine: Machine) -> tuple[float, float]:
    """Turning points of strokes: near the ends of the travel in a position loop, well inside in a velocity loop, which drifts.

    Parameters
    ----------
    machine : Machine
    """
    low, high = machine.envelope().window_m
    margin = max(stroke_share(machine.drive.capabilities), machine.free_share) * (high - low)
    return low + margin, high - margin


def stroke_share(capabilities: Capabilities) -> float:
    """Share of the travel that strokes leave free at either end.

    Parameters
    ----------
    capabilities : Capabilities
    """
    return DRIFT_SHARE if stroking(capabilities) == "velocity" else OVERSHOOT_SHARE


def farther_end_m(machine: Machine) -> float:
    """Last turning point of strokes from here, m: of the two ends the farther one.

    Parameters
    ----------
    machine : Machine
    """
    low, high = stroke_ends(machine)
    return high if high - machine.position_m > machine.position_m - low else low


def room_to_sweep(machine: Machine, model: Model, speeds_m_s: Sequence[float]) -> bool:
    """True if strokes at these speeds can begin where the carriage stands; those at the usual seven use the whole travel.

    Parameters
    ----------
    machine : Machine
    model : Model
    speeds_m_s : sequence of float
        Instead of the usual seven.
    """
    limits = gentle_limits(machine, model, np.inf)
    way_m = abs(farther_end_m(machine) - machine.position_m)
    plateau_s = SWEEP_SHORTEST_S + own_strokes.settle_s(machine)
    return bool(speeds_m_s) and fastest_stroke_m_s(limits, way_m, plateau_s) >= max(speeds_m_s)


def sweep(machine: Machine, model: Model, speeds_m_s: Sequence[float] = (), longest_s: float = SWEEP_LONGEST_S) -> Strokes:
    """:func:`sweep_strokes` from where the carriage stands to the farther end.

    Parameters
    ----------
    machine : Machine
    model : Model
    speeds_m_s : sequence of float
        Instead of the usual seven.
    longest_s : float, s
        That a plateau counts at most.
    """
    at, period = machine.position_m, machine.drive.capabilities.sample_period_s
    far = farther_end_m(machine)
    limits, settle_s = gentle_limits(machine, model, np.inf), own_strokes.settle_s(machine)
    return stoppable(
        machine,
        lambda share: sweep_strokes(at, far, limits.slower(share), period, "twice", speeds_m_s, settle_s, longest_s),
        partial(strokes_leave_by_m, machine),
    )


def sweep_is_sure(machine: Machine, model: Model) -> bool:
    """True if a sweep over the whole way of strokes keeps to it by the loop in the drive, whatever of its family the axis is.

    Parameters
    ----------
    machine : Machine
    model : Model
    """
    near, far = stroke_ends(machine)
    path = sweep_strokes(near, far, gentle_limits(machine, model, np.inf), machine.drive.capabilities.sample_period_s, "once").trajectory
    return not strokes_leave_by_m(machine, path, 0.0)
