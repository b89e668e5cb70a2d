"""A step of a plan made on the machine: bring the carriage there, record.  Commissioning and plans from a file share it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

import numpy as np

from beltcomm.control import Cascade
from beltcomm.effects.belt_spans import stiffness as stiffness_of_spans
from beltcomm.errors import NoMotion, Refused
from beltcomm.excitation.record import RecordTooShort
from beltcomm.experiments import phases, stops_out_of_move, verification
from beltcomm.experiments.paths import Course, path_of, start_of
from beltcomm.experiments.raising import GROWTH
from beltcomm.given import EXPERIMENTS
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import load_sidecar
from beltcomm.rundata import analyse
from beltcomm.rundata.first_motions import CLEAR_SHARE
from beltcomm.schedule.steps import LOUD, Step
from beltcomm.simulate.stopping import total_friction
from beltcomm.trajectory import Trajectory
from beltcomm.verify import predict_move

#: s of machine time per frequency response: rest, one run-in period, three to four measured ones.
RESPONSE_S = 7.0
#: The same where an antiresonance is so low that its periods need it, at most; s, beyond what rounding makes of it.
LONGEST_RESPONSE_S, ROUNDING_S = 30.0, 1e-3
#: A quiet excitation lies above the friction by this factor, or nothing would move.
OVER_FRICTION = 1.1
#: Share of the belt's force that a hard motion may ask for, and periods of the antiresonance that its acceleration rises in: less would
#: let the belt swing.
HARD_SHARE, RISE_PERIODS = 1.0, 1.5
#: The record that says what holds the carriage where, and m/s of the strokes that count.
SWEEP, STROKE_M_S = "sweep", 5e-3
#: m: a place already measured nearby is not measured again.
SAME_PLACE_M = 0.08
#: Kind of record by kind of step.
EXPERIMENT = {"response": "frf", "strokes": "friction_sweep", "sweep": "friction_sweep", "reversals": "reversal", "moves": "trajectory"}
assert set(EXPERIMENT.values()) <= set(EXPERIMENTS)
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Closed:
    """The loop that is in the drive, None where nobody knows it, and the axis' model.

    Attributes
    ----------
    delay_s : float
        Torque setpoint to acting torque.
    """

    model: Model
    cascade: Cascade | None
    delay_s: float


def make(machine: Machine, loop: Closed, step: Step, name: str, loudest_nm: float, share: float = 1.0, pace: float = 1.0) -> None:
    """Record one step; a record that a resumed run has already is left alone.

    Raises what the machine raises.

    Parameters
    ----------
    machine : Machine
    loop : Closed
        In the drive, with its model.
    step : Step
        To be recorded.
    name : str
        Of the record.
    loudest_nm : float, N m
        Largest excitation to try.
    share : float
        Of the torque that an excitation would have.
    pace : float
        Times its speed.
    """
    if machine.folder.finished(name) is not None:
        machine.detail(f"{name}: kept from the earlier run")
        return
    machine.detail(f"{name}: {step.words()}")
    if step.kind == "response":
        _respond(machine, loop.model, step, name, loudest_nm, share)
        return
    course = course_of(machine, loop.model)
    phases.move_to(machine, start_of(step, course), loop.model)
    path = _stoppable_path(machine, loop, step, course, machine.position_m, pace)
    sidecar = phases.sidecar(machine, EXPERIMENT[step.kind], held_out=step.held_out)
    machine.record(name, machine.follow(path, machine.stroking()), phases.stroke_envelope(machine), sidecar)


def _respond(machine: Machine, model: Model, step: Step, name: str, loudest_nm: float, share: float) -> None:
    """A frequency response at a place of its own, with ``share`` of its torque: below 1 after a carriage that went too far."""
    phases.move_to(machine, step.at_m(machine.envelope().window_m), model)
    model = _at_place(machine, model)
    if machine.folder.finished(SWEEP) is not None and machine.stroking() == "position":
        held = _holding_at(machine.folder.recording(SWEEP), machine.ratio, machine.position_m)
        machine.holding_nm = machine.holding_nm if held is None else held
    amplitude = loudest_nm
    if step.share < LOUD:
        amplitude = quieter(_loudest_made(machine) or loudest_nm, total_friction(model), step.share)
    wanted = step.seconds or RESPONSE_S
    respond_for: Callable[..., object] = partial(
        phases.frequency_response,
        machine,
        name,
        model,
        share=share,
        held_out=step.held_out,
        loud=step.share >= LOUD and not (machine.wanderings or step.held_out or step.up_to_hz),
        up_to_hz=step.up_to_hz,
    )
    above_nm = 0.0
    while True:
        try:
            short_if_possible(partial(respond_for, amplitude, above_nm=above_nm), wanted)
            return
        except NoMotion as still:
            if share < 1.0 or still.torque_nm <= above_nm:  # what lets the carriage wander is no more than this
                raise
            above_nm, amplitude = still.torque_nm, GROWTH * still.torque_nm
            machine.talk.say(f"±{above_nm:.3f} N m did not move the axis; once more, louder")


def _at_place(machine: Machine, model: Model) -> Model:
    """The model found by the first response, with the stiffness that its belt has where the carriage stands, by its strands (2.26).

    As it is where nobody knows that place, or the lengths of the strands.

    A long axis has three times as stiff a belt near its driven pulley: its resonance, and what force an excitation makes, are others there.
    """
    if machine.folder.finished("frf_1") is None:
        return model
    axis, name, at_m = machine.axis, "belt_stiffness.stiffness", machine.place_m(machine.position_m)
    distance, offset = axis.get("belt.pulley_distance_m"), axis.travel.driven_side_offset_m
    found_m = load_sidecar(machine.folder.recordings_folder / "frf_1.yaml")[0].start_position_m
    if name not in model.parameters or not (distance and offset) or at_m is None or found_m is None:
        return model
    there, here = (stiffness_of_spans(x, 1.0, float(distance), offset) for x in (at_m, found_m))
    return model.with_values({name: model[name] * there / here})


def short_if_possible(respond_for: Callable[[float], Answer], wanted_s: float) -> Answer:
    """A response of the seconds asked for; of ``RESPONSE_S``, or longer, where a low antiresonance needs longer periods than fit in.

    Parameters
    ----------
    respond_for : callable
        Of seconds, to a response or what forbids it.
    wanted_s : float, s
        Asked for.
    """
    try:
        return respond_for(wanted_s)
    except Refused as refusal:
        longer_s = max(RESPONSE_S, refusal.needed_s + ROUNDING_S) if isinstance(refusal, RecordTooShort) else RESPONSE_S
        if not wanted_s < longer_s <= LONGEST_RESPONSE_S:
            raise
        return respond_for(longer_s)


def _holding_at(sweep: Recording, ratio: float, position_m: float) -> float | None:
    """Torque that holds the carriage at a place beside friction, N m, 0 within the scatter of friction; None when the strokes do not tell.

    τ = a + b x + τ_c sign v + d v  over the strokes of a sweep: a tilt is a, a cable chain b.
    """
    speed = sweep.reference_velocity
    if speed is None:
        return None
    steady = (np.abs(ratio * speed) > STROKE_M_S) & (np.abs(np.gradient(speed)) < 1e-3 * np.abs(speed))
    if len(np.unique(np.sign(speed[steady]))) < 2:
        return None
    v, x = speed[steady], ratio * sweep.position[steady]
    regressor = np.stack([np.ones(len(x)), x, np.sign(v), v], axis=1)
    (constant, slope, coulomb, _), *_ = np.linalg.lstsq(regressor, sweep.torque[steady], rcond=None)
    held = float(constant + slope * position_m)
    return held if abs(held) > CLEAR_SHARE * abs(coulomb) else 0.0


def _loudest_made(machine: Machine) -> float:
    """Largest amplitude among the run's excited records, N m; 0 without any."""
    folder = machine.folder
    sidecars = [load_sidecar(folder.recordings_folder / f"{name}.yaml")[0] for name in folder.finished_names()]
    notes = [s.excitation for s in sidecars if s.excitation is not None and not s.held_out]
    return max((note.amplitude_nm or 0.0 for note in notes), default=0.0)


def quieter(loud_nm: float, friction_nm: float, share: float) -> float:
    """Amplitude of a quieter excitation, N m:  a = a_f + s (a_loud - a_f),  a_f : a little above friction, at most the loud one.

    Parameters
    ----------
    loud_nm : float, N m
        Loud amplitude.
    friction_nm : float, N m
        At the motor.
    share : float
        Of what lies between both.
    """
    least = min(OVER_FRICTION * friction_nm, loud_nm)
    return least + share * (loud_nm - least)


def course_of(machine: Machine, model: Model) -> Course:
    """Limits of motions of this axis.

    Parameters
    ----------
    machine : Machine
    model : Model
    """
    gentle = phases.gentle_limits(machine, model, np.inf)
    envelope, ends, period = machine.envelope(), phases.stroke_ends(machine), machine.drive.capabilities.sample_period_s
    if machine.stroking() != "position":  # a velocity loop lags, nobody predicts what the belt would carry
        return Course(envelope.window_m, ends, gentle, gentle, period)
    slowest_hz, _ = analyse.characteristic_hz(model, 0.5 * sum(envelope.window_m))
    hard = _hard_acceleration_m_s2(machine, model)
    limits = replace(gentle, acceleration_m_s2=hard, jerk_m_s3=hard * slowest_hz / RISE_PERIODS)
    return Course(envelope.window_m, ends, gentle, limits, period)


def _hard_acceleration_m_s2(machine: Machine, model: Model) -> float:
    """Acceleration with all of the belt's force or what the motor bears for ever beside friction, whichever is less, m/s²."""
    ratio, mass = model["transmission.ratio"], model["cart.mass"]
    borne = phases.excitation_torque_nm(machine.axis, machine.drive.capabilities, machine.holding_nm)
    torque = min(machine.envelope().torque_nm, borne)
    by_torque = phases.acceleration_m_s2(model["motor.inertia"], ratio, mass, torque, 2.0 * total_friction(model))
    return HARD_SHARE * min(machine.axis.limits.acceleration_m_s2 or math.inf, machine.belt_left_n / mass, by_torque)


def _stoppable_path(machine: Machine, loop: Closed, step: Step, course: Course, at_m: float, pace: float) -> Trajectory:
    """The path of a step, slowed down until every stop ends inside the travel and moves keep the belt's force."""

    def plan(share: float) -> Trajectory:
        eased = replace(course, gentle=course.gentle.slower(pace * share), hard=course.hard.slower(pace * share))
        return path_of(step, eased, at_m)

    def leaves_by_m(path: Trajectory, enough_m: float) -> float:
        return phases.strokes_leave_by_m(machine, path, enough_m) if _within_belt(machine, loop, step, path) else math.inf

    return phases.stoppable(machine, plan, leaves_by_m)


def _within_belt(machine: Machine, loop: Closed, step: Step, path: Trajectory) -> bool:
    """True if a motion with more than gentle acceleration is predicted to load the belt no more than it may."""
    if step.kind != "moves" or machine.stroking() != "position" or loop.cascade is None:
        return True
    force = predict_move(loop.model, loop.cascade, path, verification.in_drive(machine, loop.delay_s)).belt_force_n
    top = float(np.max(np.abs(path.velocity_m_s)))
    return force <= stops_out_of_move.belt_force_limit_n(machine, loop.model, top, stops_out_of_move.BELT_SWING)


def is_measured(machine: Machine, step: Step) -> bool:
    """True if the first response stands for that of a step.

    Parameters
    ----------
    machine : Machine
    step : Step
        Of the plan.
    """
    here = machine.folder.recording("frf_1").sidecar.start_position_m
    loud = step.kind == "response" and step.share >= LOUD and not step.held_out
    return loud and here is not None and abs(step.at_m(machine.envelope().window_m) - here) < SAME_PLACE_M
