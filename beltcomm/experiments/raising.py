"""The first excitations: as loud as friction needs, then louder step by step as far as the limits allow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import NoMotion, Refused, SafetyStop
from beltcomm.experiments.phases import BELT_SHARE, excitation_envelope, motion_limits, without_offset
from beltcomm.experiments.recentre import QUIETER, may_not_excite, stands_after
from beltcomm.fit.start.first_estimate import data_sheet_model, first_path, moves_enough, stiffness_range
from beltcomm.fit.torque.acting_torque import acting_recording
from beltcomm.identify.amplitude import (
    AmplitudeStep,
    MotionLimits,
    family_around,
    largest_amplitude,
    not_ruled_out,
    unknown_payload,
)
from beltcomm.machine import exciting, gravity, host_loss, scale, stops
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.quantities import three_digits
from beltcomm.recording import Recording
from beltcomm.rundata.first_motions import Breakaway, Excited
from beltcomm.schedule.sequences import shapes_at, short_sequence
from beltcomm.simulate.stopping import UNKNOWN_MASSES_KG, HostLoss, unknown_loads_kg

#: An excitation must reach this share of the breakaway torque; the ramp finds the latter some 20 % too high.
OVER_BREAKAWAY = 1.0
#: A belt is at most this many times as stiff, or as soft, as its data sheet says.
STIFFNESS_FACTOR = 4.0
#: Growth of the amplitude from one record to the next; below this share of what is allowed a kept record was bound by that growth.
GROWTH, KEPT_SHARE = 1.7, 0.9
MOST_STEPS = 5


def unknown_axis(machine: Machine, breakaway: Breakaway, masses_kg: Sequence[float]) -> tuple[Model, Sequence[Model]]:
    """The model of the data sheets where the carriage stands, and the family that it may be before anything is measured.

    Parameters
    ----------
    machine : Machine
    breakaway : Breakaway
        With its Coulomb friction.
    masses_kg : sequence of float, kg
        Of the carriage.
    """
    sheet = data_sheet_model(machine.axis, machine.place_m(machine.position_m), breakaway.coulomb_nm)
    factors = (1.0, 1.0) if machine.place_known else stiffness_range(machine.axis, machine.envelope().window_m)
    return sheet, unknown_payload(sheet, factors, masses_kg)


@dataclass(frozen=True)
class _Next:
    """A step before it is made.   order, clock : of its sequence.   unit : (n,), the sequence with an amplitude of 1.   at_m : where.

    family : what the axis may be.   losses : what the death of the host means for each of them.
    """

    order: int
    clock: int
    unit: Array
    step: AmplitudeStep
    at_m: float
    limits: MotionLimits
    family: Sequence[Model]
    losses: Callable[[Model], Sequence[HostLoss]]


def raise_amplitude(
    machine: Machine,
    breakaway: Breakaway,
    masses_kg: Sequence[float] = UNKNOWN_MASSES_KG,
    *,
    response: Callable[[Model, float], AmplitudeStep] | None = None,
) -> Excited:
    """Excite at the present place with rising amplitude; each step is predicted from the model so far.

    Parameters
    ----------
    machine : Machine
    breakaway : Breakaway
        With its Coulomb friction.
    masses_kg : sequence of float
        To count with.
    response : callable or None
        The frequency response that would follow, from a model and the most that growth allows, N m. Where it is given, it is the last step
        as soon as a limit binds it, or the next step, instead of the growth.

    Raises
    ------
    Refused
        When friction leaves no room below the limits.
    """
    counts = machine.drive.capabilities.counts_per_rev
    sheet, family = unknown_axis(machine, breakaway, masses_kg)
    known = sheet.with_effect("constant_offset", {"torque": machine.holding_nm}) if machine.holding_nm else sheet
    asked_nm = machine.asked.amplitude_nm or np.inf
    if asked_nm < OVER_BREAKAWAY * breakaway.coulomb_nm:
        raise Refused(
            f"±{asked_nm:g} N m of excitation is asked for, and the axis broke away at {breakaway.coulomb_nm:.3f} N m only: friction would "
            "hold it; ask for more"
        )
    at_most = min(2.0 * breakaway.coulomb_nm, asked_nm)
    shapes: Sequence[tuple[int, int]] = shapes_at(machine.drive.capabilities.sample_period_s)
    recordings: list[Recording] = []
    found: Excited | None = None
    while True:
        following = _next(machine, breakaway, family, shapes, at_most)
        name = f"amplitude_{len(recordings) + 1}"
        kept = machine.folder.finished(name) is not None
        try:
            recordings.append(_record_of_step(machine, name, following, kept))
        except SafetyStop as problem:
            louder = following.step.amplitude_nm  # the model does not know it well enough: no louder than what stayed inside
            if (found is None and QUIETER * louder < OVER_BREAKAWAY * breakaway.coulomb_nm) or not stands_after(machine, problem):
                raise
            if found is None:
                if may_not_excite(machine):
                    raise
                at_most = QUIETER * louder
                continue
            machine.talk.say(f"±{louder:.3f} N m let the carriage wander too far; the search ends with ±{found.at_most_nm:.3f} N m")
            return found
        except NoMotion:
            if following.step.binds == "step":
                at_most = min(GROWTH * following.step.amplitude_nm, asked_nm)
            elif len(shapes) > 1:
                shapes = shapes[1:]
            else:
                raise Refused(
                    f"±{following.step.amplitude_nm:.3f} N m of excitation, all that the limit on {following.step.binds} allows, did not "
                    f"move the axis, which broke away at {breakaway.coulomb_nm:.3f} N m: friction holds it; reduce the friction, or "
                    f"{_remedy(machine, following.step, breakaway)}"
                ) from None
            continue
        step = _as_made(following.step, recordings[-1]) if kept else following.step
        if len(recordings) < MOST_STEPS and not moves_enough(recordings[-1], sheet, counts):
            family = not_ruled_out(family, recordings[-1], machine.ratio, following.at_m)
            if step.binds == "step":  # an axis without Coulomb friction breaks away long before it moves visibly
                at_most = min(GROWTH * step.amplitude_nm, asked_nm)
                continue
            if len(shapes) > 1:  # a heavy carriage hardly follows fast changes
                shapes = shapes[1:]
                continue
        with machine.withdrawing():
            first = first_path(recordings[-1], known, counts)
        model = _believable(first.model, sheet, unknown_loads_kg(machine.axis)[0])
        machine.folder.journal(
            f"amplitude {step.amplitude_nm:.3f} N m ({step.binds}): mass {model['cart.mass']:.2f} kg"
            + ("" if model.rigid else f", stiffness {model['belt_stiffness.stiffness']:.4g} N/m")
        )
        model = scale.check_first(machine, model, acting_recording(recordings[-1], first.path))
        stops.lend_brake(machine, model, following.at_m)
        family = family_around(without_offset(model))
        at_most = min(GROWTH * step.amplitude_nm, asked_nm)
        last = _louder(machine, family, following, at_most)
        bound = last.amplitude_nm < 1.1 * step.amplitude_nm
        if response is not None and not bound:
            bound = last.binds != "step" or _bound(response, model, at_most)
        if bound or len(recordings) >= MOST_STEPS:
            return Excited(last, tuple(recordings), model, at_most, first.path)
        found = Excited(step, tuple(recordings), model, step.amplitude_nm, first.path)


def _next(machine: Machine, breakaway: Breakaway, family: Sequence[Model], shapes: Sequence[tuple[int, int]], at_most_nm: float) -> _Next:
    """The first of the sequences that may be louder than friction, as loud as it may be.   Raises Refused when none may."""
    at, period = machine.position_m, machine.drive.capabilities.sample_period_s  # every excitation leaves the carriage a little aside
    limits = motion_limits(machine, at)
    braking, losses = stops.braking_of(machine, breakaway.least_friction_nm), host_loss.losses_of(machine, breakaway.least_friction_nm)
    for order, clock in shapes:
        shape = short_sequence(order, clock, 1.0, period)
        unit = shape.torque / shape.amplitude_nm
        step = largest_amplitude(family, unit, period, at, limits, min(at_most_nm, limits.torque_nm), braking, losses)
        if step.amplitude_nm >= OVER_BREAKAWAY * breakaway.coulomb_nm:
            return _Next(order, clock, unit, step, at, limits, family, losses)
    raise Refused(
        f"friction holds the axis up to {breakaway.coulomb_nm:.3f} N m, but the limit on {step.binds} allows only "
        f"±{step.amplitude_nm:.3f} N m of excitation; reduce the friction, or {_remedy(machine, step, breakaway)}"
    )


def _record_of_step(machine: Machine, name: str, wanted: _Next, kept: bool) -> Recording:
    """The record of a step.   kept : it is there from an earlier run."""
    own, step = machine.drive.capabilities, wanted.step
    if not kept:
        machine.detail(
            f"excitation ±{step.amplitude_nm:.3f} N m: up to {1e3 * step.prediction.travel_m:.1f} mm, "
            f"{three_digits(step.prediction.belt_force_n)} N in the belt (limited by {step.binds}); stopping distance at most "
            f"{1e3 * step.prediction.stop_m:.1f} mm; {exciting.run_on_words(machine, step.prediction, wanted.limits.ends_m)}"
        )
    excitation = short_sequence(wanted.order, wanted.clock, step.amplitude_nm, own.sample_period_s, own.torque_step_nm)
    context = exciting.ExcitationContext(step.prediction, wanted.family, wanted.losses)
    return exciting.excite(machine, name, excitation, wanted.at_m, excitation_envelope(machine, wanted.at_m), context)


def _louder(machine: Machine, family: Sequence[Model], made: _Next, at_most_nm: float) -> AmplitudeStep:
    """The next step with the same sequence, by the model that the last one taught and the brake that it lent."""
    counted = stops.braking_of(machine), host_loss.losses_of(machine)
    most, period = min(at_most_nm, made.limits.torque_nm), machine.drive.capabilities.sample_period_s
    return largest_amplitude(family, made.unit, period, made.at_m, made.limits, most, *counted)


def _bound(response: Callable[[Model, float], AmplitudeStep], model: Model, at_most_nm: float) -> bool:
    """True if a limit binds a response already, so that another step before it would not make it louder."""
    try:
        return response(model, at_most_nm).binds != "step"
    except Refused:  # by a model of which the next step may think better
        return False


def _as_made(step: AmplitudeStep, recording: Recording) -> AmplitudeStep:
    """A step as a kept record was made: with the amplitude that its sidecar notes, which was bound by the steps where more is allowed now.

    Judged by today's step, a record that hardly moved would pass for one as loud as the limits allow.
    """
    note = recording.sidecar.excitation
    if note is None or not note.amplitude_nm:
        return step
    own_nm = note.amplitude_nm
    return replace(step, amplitude_nm=own_nm, binds="step" if own_nm < KEPT_SHARE * step.amplitude_nm else step.binds)


def _believable(model: Model, sheet: Model, mass: float) -> Model:
    """A first estimate within what can be: a gap or a lag drives it to a feather on a rod, and no prediction may count on that.

    ``mass`` is the lightest load, kg.
    """
    if model.rigid:
        return model.with_values({"cart.mass": mass}, "first estimate, bounded") if model["cart.mass"] < mass else model
    stiffness = sheet["belt_stiffness.stiffness"]
    low, high = stiffness / STIFFNESS_FACTOR, stiffness * STIFFNESS_FACTOR
    found = {"cart.mass": max(model["cart.mass"], mass), "belt_stiffness.stiffness": min(max(model["belt_stiffness.stiffness"], low), high)}
    return model if all(model[name] == value for name, value in found.items()) else model.with_values(found, "first estimate, bounded")


def _remedy(machine: Machine, step: AmplitudeStep, breakaway: Breakaway) -> str:
    """Remedy for a limit that lets no excitation move the axis, in words."""
    by_travel = "travel" in step.binds
    if (by_travel or step.binds == "speed") and not machine.axis.payload.mass_kg:
        room = f"{machine.more_room}, or " if by_travel else ""
        lightest = unknown_loads_kg(machine.axis)[0]
        return (
            f"{room}state payload.mass_kg in axis.yaml: a carriage of {lightest:.2g} kg is counted with until it is weighed, and "
            "a heavier one may be shaken harder"
        )
    if by_travel:
        return machine.more_room
    factor = breakaway.coulomb_nm / step.amplitude_nm if step.amplitude_nm else np.inf
    if machine.weight_n and "belt" in step.binds:
        return gravity.less_steep(machine, BELT_SHARE * machine.axis.belt_force_limit_n, factor * step.prediction.belt_force_n)
    return (
        f"check that limit in axis.yaml: it would have to be {factor:.2g} times as high, which only the data sheets of belt, axis and "
        "motor can allow"
    )
