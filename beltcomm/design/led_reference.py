"""A position reference that leads the axis by the inverse of the drive's own P-PI cascade.

A drive that takes positions only, with neither velocity nor torque feedforward, follows late: by ω/K_PP at least.  With the motion u
and torque τ of its motor known from the model (:mod:`beltcomm.design.compliant`), the cascade gives that torque along that motion when its
reference is

    r = u + (ω + e)/K_PP,      e[k] = (τ[k] - I[k])/K_P,      I[k+1] = I[k] + K_I T e[k]

ω is u as the drive measures it (6.1), τ is asked for so much earlier as it acts late (figure 4.1 and (6.25), solved for the reference).  At
rest friction holds: the torque rises to friction before the motion, and after it the reference comes back to where the axis is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.compliant import REST_M_S, lead_motion, with_rest_before
from beltcomm.errors import Refused
from beltcomm.identify.led_gains import filtered_speed
from beltcomm.model import Model
from beltcomm.simulate.stopping import total_friction
from beltcomm.trajectory import Trajectory

#: s: before the motion the torque rises to friction, and after it the reference comes back to the axis.
RAMP_S = 0.1
#: Share of Coulomb friction that surely holds an axis at rest.
HELD_SHARE = 0.8


@dataclass(frozen=True)
class LedReference:
    """Motion of the motor, and what the reference is ahead of it.

    Attributes
    ----------
    motor, carriage : Trajectory
        u of the module, and what the carriage does, m, on one grid.
    lead_m : ndarray (n,)
        r - u.
    torque_nm : ndarray (n,)
        τ, N m at the motor shaft.
    """

    motor: Trajectory
    carriage: Trajectory
    lead_m: Array
    torque_nm: Array

    @property
    def sent(self) -> Trajectory:
        """r, as the drive gets it."""
        place = self.motor.position_m + self.lead_m
        speed = np.gradient(place, self.motor.sample_period_s)
        return Trajectory(self.motor.t_s, place, speed, np.gradient(speed, self.motor.sample_period_s))


def can_lead(structure: CascadeStructure, cascade: Cascade) -> bool:
    """True if a cascade is the one that is inverted here: P-PI without filters, and no feedforward that follows better.

    Parameters
    ----------
    structure : CascadeStructure
        What the drive's loop has.
    cascade : Cascade

    Returns
    -------
    bool
        False without gains.
    """
    own, prefilter = structure.velocity_feedforward or structure.torque_feedforward, cascade.prefilter
    return not own and prefilter.kind == "none" and not prefilter.roll_off_rad_s and min(cascade.kp_nm_s_rad, cascade.kpp_1_s) > 0.0


def led_reference(
    model: Model, carriage: Trajectory, cascade: Cascade, structure: CascadeStructure, delay_s: float, time_s: float = 0.0
) -> LedReference:
    """The reference with which a P-PI cascade without feedforward moves the carriage along ``carriage``, which begins and ends at rest.

    Parameters
    ----------
    model : Model
    carriage : Trajectory
        Motion of the carriage.
    cascade : Cascade
    structure : CascadeStructure
        Of the drive, with the period of its loop.
    delay_s : float
        Torque setpoint to acting torque.
    time_s : float
        Session's clock at the start.

    Raises
    ------
    Refused
        For another cascade than P-PI without filters and feedforward, and a tilted axis.
    """
    if not can_lead(structure, cascade) or model.get("tilt.angle"):
        raise Refused(
            f"the reference of {structure.name} cannot be led: that takes P and PI without filter and feedforward, on a level axis"
        )
    period, loop_s, ratio = carriage.sample_period_s, structure.period_s, model["transmission.ratio"]
    ahead_s, ramp = delay_s + 0.5 * loop_s, math.ceil(RAMP_S / period)
    led = lead_motion(model, with_rest_before(carriage, ramp), ahead_s, time_s=time_s)
    motor, moving = led.trajectory, np.flatnonzero(np.abs(led.trajectory.velocity_m_s) > REST_M_S)
    first, last = int(moving[0]), int(moving[-1])
    torque = led.torque_nm.copy()
    torque[max(first - ramp, 0) : first] = torque[first] * _rise(min(ramp, first))
    loops = np.arange(0.0, motor.t_s[-1] + 0.5 * loop_s, loop_s)
    angle = np.interp(loops, motor.t_s, motor.position_m / ratio)
    asked = np.interp(loops + ahead_s, motor.t_s, torque)
    over = int(np.searchsorted(loops + ahead_s, motor.t_s[last]))
    friction = HELD_SHARE * total_friction(model)
    error = _speed_error(asked, over, cascade, loop_s, friction)
    speed = filtered_speed(angle, loop_s, cascade.velocity_filter_s)
    lead = np.interp(motor.t_s, loops, ratio * (speed + error) / cascade.kpp_1_s)
    return LedReference(motor, led.carriage, lead, torque)


def _speed_error(torque_nm: Array, over: int, cascade: Cascade, loop_s: float, held_nm: float) -> Array:
    """e of the module, rad/s, (n,).   over : sample from which the axis stands, held within ±``held_nm``."""
    error, integral = np.empty(len(torque_nm)), 0.0
    back = _rise(max(round(RAMP_S / loop_s), 1))
    last = torque_nm[over - 1]
    for k, torque in enumerate(torque_nm):
        if k >= over:  # what friction holds, from the last torque on: the integral may still be far from it
            share = back[k - over] if k - over < len(back) else 1.0
            torque = (1.0 - share) * last + share * min(max(integral, -held_nm), held_nm)
        error[k] = (torque - integral) / cascade.kp_nm_s_rad
        integral += cascade.ki_nm_rad * loop_s * error[k]
    return error


def _rise(samples: int) -> Array:
    """From 0 to 1 without a jump of its slope, (samples,)."""
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * np.arange(samples) / max(samples, 1)))
