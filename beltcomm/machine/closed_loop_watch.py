"""Watch of every row of a closed loop, whatever it is for: the force in the belt, and swings around the resonance."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.control import Cascade
from beltcomm.drive import Drive, Motion, Row
from beltcomm.drive.parameters import LIMIT_NAMES
from beltcomm.machine.envelope import Envelope
from beltcomm.machine.prediction_watch import BeltWatch
from beltcomm.machine.resonance import ResonanceWatch, allowed, band_of, predicted_torque
from beltcomm.model import Model
from beltcomm.simulate.stopping import total_friction, total_inertia, total_viscous
from beltcomm.verify import Loop

#: The drive may use so many times the planned torque, and that of a rigid axis where nobody knows the loop that is in it.
OVER_PLAN, OVER_RIGID = 1.5, 3.0


class Watched(Protocol):
    """Part of :class:`beltcomm.machine.machine.Machine` that the watch of a closed loop rests on, named as there."""

    axis: Axis
    drive: Drive
    ratio: float
    origin_rad: float
    friction: tuple[float, float]
    holding_nm: float
    deceleration_m_s2: float
    closed: tuple[Model, float] | None
    cascade: Cascade | None

    def envelope(self) -> Envelope:
        """The travel and all that axis and drive allow."""
        ...


def _rigid_torque(model: Model, motion: Motion, holding_nm: float) -> Array:
    """Torque of a rigid axis along a motion:  J φ̈ + τ_C sign φ̇ + d φ̇ + τ_g, N m, (n,)."""
    speed = motion.velocity_rad_s
    acceleration = np.gradient(speed, motion.period_s)
    return np.asarray(
        total_inertia(model) * acceleration + total_friction(model) * np.sign(speed) + total_viscous(model) * speed + holding_nm
    )


def _planned_torque_nm(machine: Watched, model: Model, torque_nm: Array) -> float:
    """Largest torque that a motion or a stop out of it takes, N m.

    Parameters
    ----------
    torque_nm : ndarray (n,)
        Predicted along the motion.
    """
    stop_nm = total_inertia(model) * machine.deceleration_m_s2 / machine.ratio + total_friction(model)
    return max(float(np.max(np.abs(torque_nm))), stop_nm) + abs(machine.holding_nm)


def lent_torque_nm(machine: Watched, model: Model, torque_nm: Array) -> float:
    """Torque beyond which a drive with a known loop does not go while it makes a motion: its limit 6072h is lent for that.

    Parameters
    ----------
    machine : Watched
        The axis behind its drive.
    model : Model
        For which a stop out of the motion is predicted.
    torque_nm : ndarray (n,), N m, motor shaft
        As of :func:`_planned_torque_nm`.

    Returns
    -------
    float, N m
        Motor shaft; the drive's peak torque where it takes no limit.
    """
    own = machine.drive.capabilities
    limit = own.parameters.get(LIMIT_NAMES[0])
    if limit is None or limit.index in own.not_taken:
        return own.peak_torque_nm
    return min(own.peak_torque_nm, machine.envelope().torque_nm, OVER_PLAN * _planned_torque_nm(machine, model, torque_nm))


def unwatched(_row: Row) -> None:
    """A record that nobody but the drive's limits watches.

    Parameters
    ----------
    _row : Row
        Of the record.
    """


@dataclass(frozen=True)
class Foreseen:
    """Prediction of a motion in the drive's own loops.

    Attributes
    ----------
    watch : callable
        Called with every row.
    torque_nm : float
        Limit in the drive.
    """

    watch: Callable[[Row], None]
    torque_nm: float = math.inf


def within(envelope: Envelope, found: Foreseen) -> Envelope:
    """The envelope with the torque that was foreseen, where that is lower.

    Parameters
    ----------
    envelope : Envelope
        Before.
    found : Foreseen
        As :func:`foreseen` returned it.
    """
    return replace(envelope, torque_nm=min(envelope.torque_nm, found.torque_nm))


def foreseen(machine: Watched, motion: Motion) -> Foreseen:
    """The watch of a motion in the drive's own loops; what an excitation may do is watched by its own prediction.

    As soon as there is a model to predict the motion with (a rigid axis where the loop is unknown), swings around the resonance are
    watched, and the drive gets a torque limit of ``OVER_PLAN`` times what the motion or a stop out of it takes: a loop that swings does
    so during its quick stop as well.

    Parameters
    ----------
    machine : Watched
        The axis behind its drive.
    motion : Motion
        That the drive will make.

    Returns
    -------
    Foreseen
        Watch of its rows and largest torque, N m at the motor shaft.
    """
    if motion.kind == "torque":
        return Foreseen(unwatched)
    belt = BeltWatch(machine.ratio, machine.axis.motor_side_inertia_kg_m2, machine.axis.belt_force_limit_n, machine.friction)
    if machine.closed is None or len(motion.torque_nm) < 2:
        return Foreseen(belt)
    (model, delay_s), capabilities = machine.closed, machine.drive.capabilities
    if machine.cascade is None:
        torque, over = _rigid_torque(model, motion, machine.holding_nm), OVER_RIGID
    else:
        drive = Loop(capabilities.structure, delay_s, capabilities.peak_torque_nm, capabilities.counts_per_rev)
        torque, over = predicted_torque(model, machine.cascade, motion, drive, machine.ratio, machine.origin_rad), OVER_PLAN
    swing = allowed(torque, motion.period_s, band_of(model, machine.envelope().window_m, motion.period_s), capabilities.rated_torque_nm)
    resonance = ResonanceWatch(swing, motion.period_s)

    def watch(row: Row) -> None:
        resonance(row)
        belt(row)

    return Foreseen(watch, over * _planned_torque_nm(machine, model, torque))
