"""What is watched in every row of a closed loop, whatever it is for: the force in the belt, and swings around the resonance."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from beltcomm.drive import Motion, Row
from beltcomm.session.expectation import BeltWatch
from beltcomm.session.resonance import ResonanceWatch, allowed, band_of, predicted_torque
from beltcomm.verify import Loop

if TYPE_CHECKING:
    from beltcomm.session.machine import Machine


def unwatched(_row: Row) -> None:
    """A record that nobody but the drive's limits watches."""


def closed_loop_watch(machine: Machine, motion: Motion) -> Callable[[Row], None]:
    """The watch of a motion in the drive's own loops; what an excitation may do is watched by its own prediction.

    The resonance is watched as soon as there is a model to predict the motion with.
    """
    if motion.kind == "torque":
        return unwatched
    belt = BeltWatch(machine.ratio, machine.axis.motor_side_inertia_kg_m2, machine.axis.belt_force_limit_n, machine.friction)
    if machine.closed is None or machine.cascade is None or len(motion.torque_nm) < 2:
        return belt
    (model, delay_s), capabilities = machine.closed, machine.drive.capabilities
    drive = Loop(capabilities.structure, delay_s, capabilities.peak_torque_nm, capabilities.counts_per_rev)
    torque = predicted_torque(model, machine.cascade, motion, drive, machine.ratio, machine.origin_rad)
    swing = allowed(torque, motion.period_s, band_of(model, machine.full_room().window_m, motion.period_s), capabilities.rated_torque_nm)
    resonance = ResonanceWatch(swing, motion.period_s)

    def watch(row: Row) -> None:
        resonance(row)
        belt(row)

    return watch
