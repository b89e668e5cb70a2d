"""Is a resumed run still on its machine?  One cheap record is repeated before any loop is closed on old ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from beltcomm.arrays import Array, rms
from beltcomm.drive import Row
from beltcomm.errors import Refused, SafetyStop
from beltcomm.excitation import Excitation
from beltcomm.experiments import phases
from beltcomm.experiments.raising import unknown_axis
from beltcomm.identify.amplitude import largest_amplitude
from beltcomm.machine import exciting, host_loss, stops
from beltcomm.machine.machine import Machine
from beltcomm.recording import Recording
from beltcomm.rundata.first_motions import Breakaway
from beltcomm.schedule.sequences import shapes_at, short_sequence

#: Breakaway torque and motion may differ by this factor from the earlier session's: temperature, place and grease do less.
GROSSLY = 1.5
#: Share of the earlier amplitude that must be allowed: friction has changed a little since then, and the limits with it.  With a tenth
#: less of it, the amplitude 1.4 times the sliding friction, the motion is a third slower, which is still within ``GROSSLY``.
AS_LOUD = 0.9


def check_breakaway(machine: Machine, coulomb_nm: float) -> None:
    """Note the breakaway torque; in a resumed run refuse one that is grossly another than at the beginning.

    Parameters
    ----------
    machine : Machine
    coulomb_nm : float, N m, motor shaft
        As measured now.

    Raises
    ------
    Refused
        With both.
    """
    known = machine.folder.load_result("breakaway")
    if known is None:
        machine.folder.save("results", "breakaway", {"coulomb_nm": coulomb_nm})
        return
    _refuse_beyond(machine, "the breakaway torque", coulomb_nm, float(known["coulomb_nm"]), "N m")


def repeat_first_excitation(machine: Machine, breakaway: Breakaway, masses_kg: Sequence[float]) -> None:
    """Repeat the first recorded excitation and compare how fast the motor turned, rms over the record.

    Nothing is kept; it is predicted, bounded and watched as every excitation of an axis of which only the data sheets are known.

    Parameters
    ----------
    machine : Machine
    breakaway : Breakaway
        With its Coulomb friction.
    masses_kg : sequence of float, kg
        Of the carriage, to count with.

    Raises
    ------
    Refused
        When the limits do not allow it where the carriage stands, when the speed differs by more than ``GROSSLY``, or as soon as the motor
        turns that much faster than it ever did.
    """
    if machine.folder.finished("amplitude_1") is None:
        return
    earlier = machine.folder.recording("amplitude_1")
    note = earlier.sidecar.excitation
    if note is None or not note.amplitude_nm:
        return
    same = [(order, clock) for order, clock in shapes_at(earlier.sample_period_s) if (2**order - 1) * clock == note.period_samples]
    if not same:
        return
    excitation, context = _as_then(machine, breakaway, masses_kg, same[0], note.amplitude_nm, earlier.sidecar.start_position_m)
    at = machine.position_m
    before = _speed_rad_s(earlier)
    fastest = GROSSLY * float(np.max(np.abs(before)))
    rows: list[tuple[float, float]] = []
    envelope, guarding = exciting.guarded(machine, excitation, at, phases.excitation_envelope(machine, at), context)

    def watch(row: Row) -> None:
        rows.append((row[0], row[3]))
        if len(rows) > SPAN and abs(rows[-1][1] - rows[-1 - SPAN][1]) > fastest * (rows[-1][0] - rows[-1 - SPAN][0]):
            raise _other_machine(machine, f"the motor turns at more than {GROSSLY:g} times its earlier {fastest / GROSSLY:.3g} rad/s")
        guarding(row)

    try:
        machine.run(machine.torque_motion(excitation.torque), envelope, watch)
    except SafetyStop as stop:
        raise SafetyStop(f"{stop}; this happened while the first excitation of the run was repeated: {ADVICE}", stop.reason) from stop
    t_s, position_rad = np.array(rows).T
    now, then = (rms(v) for v in (_speed(t_s, position_rad), before))
    _refuse_beyond(machine, "the motor's speed under the same torque", now, then, "rad/s rms")


def _as_then(
    machine: Machine, breakaway: Breakaway, masses_kg: Sequence[float], shape: tuple[int, int], amplitude_nm: float, began_m: float | None
) -> tuple[Excitation, exciting.ExcitationContext]:
    """An excitation of this shape as loud as it was, or nearly, and what it is predicted to do here.   began_m : where it was made.

    Raises Refused.
    """
    own, at = machine.drive.capabilities, machine.position_m
    _, family = unknown_axis(machine, breakaway, masses_kg)
    braking, losses = stops.braking_of(machine, breakaway.least_friction_nm), host_loss.losses_of(machine, breakaway.least_friction_nm)
    one = short_sequence(*shape, 1.0, own.sample_period_s)
    unit = one.torque / one.amplitude_nm
    step = largest_amplitude(family, unit, own.sample_period_s, at, phases.motion_limits(machine, at), amplitude_nm, braking, losses)
    if step.amplitude_nm < AS_LOUD * amplitude_nm:
        began = "where the run began" if began_m is None else f"{machine.where(began_m)}, where the run began"
        raise Refused(
            f"{machine.folder.path} cannot be resumed from here: its first excitation of ±{amplitude_nm:.3f} N m is to be repeated, and "
            f"at {machine.where(at)} the limit on {step.binds} allows ±{step.amplitude_nm:.3f} N m; bring the carriage to {began}; if it "
            "stands there, its friction is another one: begin a new run"
        )
    excitation = short_sequence(*shape, step.amplitude_nm, own.sample_period_s, own.torque_step_nm)
    return excitation, exciting.ExcitationContext(step.prediction, family, losses)


#: Samples over which a speed is taken: the encoder's steps must not count as motion.
SPAN = 10
ADVICE = "payload or machine are not those of the run; begin a new run"


def _speed(t_s: Array, position_rad: Array) -> Array:
    return np.asarray((position_rad[SPAN:] - position_rad[:-SPAN]) / (t_s[SPAN:] - t_s[:-SPAN]))


def _speed_rad_s(recording: Recording) -> Array:
    return _speed(recording.t_s, recording.position)


def _refuse_beyond(machine: Machine, what: str, now: float, then: float, unit: str) -> None:
    machine.folder.journal(f"{what} is {now:.3g} {unit}, was {then:.3g} {unit}")
    if then > 0.0 and not 1.0 / GROSSLY <= now / then <= GROSSLY:
        raise _other_machine(machine, f"{what} is {now:.3g} {unit}, before it was {then:.3g} {unit} (limit factor {GROSSLY:g})")


def _other_machine(machine: Machine, what: str) -> Refused:
    return Refused(f"{machine.folder.path} cannot be resumed: {what}; {ADVICE}")
