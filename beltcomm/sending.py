"""Reference and torque that the host sends with a move, and the move predicted with them: the one prediction of verdict and page."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import Cascade
from beltcomm.design.compliant import Leading, lead_motion, torque_along
from beltcomm.design.feedforward import compensation
from beltcomm.design.led_reference import LedReference, led_reference
from beltcomm.model import Model
from beltcomm.simulate.loop import SetpointGrid
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, PredictedMove, demand, predict_move

#: What the host sends along: nothing; the torque of effects that the drive's numbers cannot say; a motor that leads by the stretch of the
#: belt; the same with friction of the carriage in that stretch; a reference that leads the motor by the inverse of the drive's cascade.
Sending = Literal["nothing", "rigid", "stretch", "compliant", "led"]


@dataclass(frozen=True)
class Sent:
    """Reference and torque sent to the drive.

    Attributes
    ----------
    motor, carriage : Trajectory
        Paths to follow, m.
    torque_nm : ndarray or None
        Along with it, (n,), or None.
    demanded_nm : float
        Largest torque at the motor that this will take.
    led : Leading or None
        How the motor leads, where it does.
    reference : LedReference or None
        How the reference leads the motor, where it does.
    """

    motor: Trajectory
    carriage: Trajectory
    torque_nm: Array | None
    demanded_nm: float
    led: Leading | None = None
    reference: LedReference | None = None


def reference_for(model: Model, cascade: Cascade, path: Trajectory, drive: Loop, sending: Sending, time_s: float) -> Sent:
    """Reference and torque for a motion of the carriage that ends with a rest.

    Parameters
    ----------
    model : Model
    cascade : Cascade
        As it runs in the drive.
    path : Trajectory
        Motion of the carriage.
    drive : Loop
        Loop of the drive, with dead time and limits.
    sending : Sending
        Way in which the host leads the move.
    time_s : float
        Session's clock at its start.

    Raises
    ------
    UsageError
        For a motor that should lead without a belt.
    """
    feedforward = cascade.feedforward
    if sending == "led":
        led = led_reference(model, path, cascade, drive.structure, drive.delay_s, time_s)
        return Sent(led.motor, led.carriage, None, float(np.max(np.abs(led.torque_nm))), reference=led)
    asked = demand(path, model).torque_nm
    if sending == "nothing":
        return Sent(path, path, None, asked)
    if sending == "rigid":
        extra = compensation(model, feedforward, path, path.sample_period_s, time_s)
        along = grid_of(path, drive).along(extra)
        return Sent(path, path, along, asked + float(np.max(np.abs(extra))))
    ahead = lead_motion(model, path, feedforward.advance_s, friction=sending == "compliant", time_s=time_s)
    along = grid_of(ahead.trajectory, drive).along(torque_along(ahead, feedforward, model["transmission.ratio"]))
    return Sent(ahead.trajectory, ahead.carriage, along, float(np.max(np.abs(ahead.torque_nm))), ahead)


def grid_of(sent: Trajectory, drive: Loop) -> SetpointGrid:
    """Setpoints of a trajectory in the loop of a drive.

    Parameters
    ----------
    sent : Trajectory
        With the period in which it is sent.
    drive : Loop
        With the period of its loop.
    """
    return SetpointGrid(sent.sample_period_s, drive.structure.period_s, len(sent.t_s))


def predict_sent(model: Model, cascade: Cascade, sent: Sent, drive: Loop, *, belt_stretch_m: float = 0.0, time_s: float) -> PredictedMove:
    """The axis with a controller along what is sent, held against the motion that the motor is to make.

    Parameters
    ----------
    model : Model
    cascade : Cascade
        That runs in the drive.
    sent : Sent
        Motor's motion, and torque or led reference with it.
    drive : Loop
        Loop of the drive, with dead time and limits.
    belt_stretch_m : float, m
        At the start.
    time_s : float, s
        Session's clock at the start.

    Returns
    -------
    PredictedMove
        m, at motor and carriage.
    """
    if sent.reference is not None:
        return predict_led(model, cascade, sent.reference, drive, belt_stretch_m, time_s)
    return predict_move(model, cascade, sent.motor, drive, belt_stretch_m=belt_stretch_m, extra_torque_nm=sent.torque_nm, time_s=time_s)


def predict_led(
    model: Model, cascade: Cascade, led: LedReference, drive: Loop, belt_stretch_m: float = 0.0, time_s: float = 0.0
) -> PredictedMove:
    """The axis along a led reference, held against the motion that the motor is to make.

    Parameters
    ----------
    model : Model
    cascade : Cascade
        That runs in the drive.
    led : LedReference
        Reference that is sent, and the motion it is led for.
    drive : Loop
        Loop of the drive, with dead time and limits.
    belt_stretch_m : float, m
        At the start.
    time_s : float, s
        Session's clock at the start.

    Returns
    -------
    PredictedMove
        m, at motor and carriage.
    """
    path = predict_move(model, cascade, led.sent, drive, belt_stretch_m=belt_stretch_m, time_s=time_s)
    return replace(path, reference_m=grid_of(led.motor, drive).in_loop(led.motor.position_m))
