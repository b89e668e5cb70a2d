"""Is a resumed run still on its machine?  One cheap record is repeated before any loop is closed on old ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltcomm.drive import Row
from beltcomm.errors import Refused, SafetyStop
from beltcomm.excitation import prbs
from beltcomm.recording import Recording
from beltcomm.session.machine import Machine, Room
from beltcomm.session.sequences import SHAPES

#: Breakaway torque and motion may differ by this factor from the earlier session's: temperature, place and grease do less.
GROSSLY = 1.5

Array = NDArray[np.float64]


def check_breakaway(machine: Machine, coulomb_nm: float) -> None:
    """Note the breakaway torque; in a resumed run raise Refused when it is grossly another one than at the beginning."""
    known = machine.folder.load_result("breakaway")
    if known is None:
        machine.folder.save_result("breakaway", {"coulomb_nm": coulomb_nm})
        return
    _refuse_beyond(machine, "the breakaway torque", coulomb_nm, float(known["coulomb_nm"]), "N m")


def repeat_first_excitation(machine: Machine, room: Room) -> None:
    """Repeat the first recorded excitation and compare how fast the motor turned, rms over the record.

    Nothing is kept.   Raises Refused when the speed differs by more than ``GROSSLY``, or as soon as the motor turns that much faster
    than it ever did.
    """
    if machine.folder.finished("amplitude_1") is None:
        return
    earlier = machine.folder.recording("amplitude_1")
    note = earlier.sidecar.excitation
    if note is None or not note.amplitude_nm:
        return
    capabilities = machine.drive.capabilities
    same = [(order, clock) for order, clock in SHAPES if (2**order - 1) * clock == note.period_samples]
    if not same:
        return
    order, clock = same[0]
    excitation = prbs(order, clock, 2.0 * note.amplitude_nm, capabilities.sample_period_s, 1, torque_step_nm=capabilities.torque_step_nm)
    before = _speed_rad_s(earlier)
    fastest = GROSSLY * float(np.max(np.abs(before)))
    rows: list[tuple[float, float]] = []

    def watch(row: Row) -> None:
        rows.append((row[0], row[3]))
        if len(rows) > SPAN and abs(rows[-1][1] - rows[-1 - SPAN][1]) > fastest * (rows[-1][0] - rows[-1 - SPAN][0]):
            raise _other_machine(machine, f"the motor turns at more than {GROSSLY:g} times its earlier {fastest / GROSSLY:.3g} rad/s")

    try:
        machine.run(machine.torque_motion(excitation.torque), room, watch)
    except SafetyStop as stop:
        raise SafetyStop(f"{stop}; this happened while the first excitation of the run was repeated: {ADVICE}", stop.reason) from stop
    t_s, position_rad = np.array(rows).T
    now, then = (float(np.sqrt(np.mean(v**2))) for v in (_speed(t_s, position_rad), before))
    _refuse_beyond(machine, "the motor's speed under the same torque", now, then, "rad/s rms")


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
