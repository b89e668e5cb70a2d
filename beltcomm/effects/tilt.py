"""Gravity along a tilted axis."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: m/s², standard gravity.
GRAVITY_M_S2 = 9.80665


def _force(position: float, speed: float, t: float, angle: float, mass: float) -> float:
    """Force on the carriage:  f_g = -m_c g sin(angle), N.

    Parameters
    ----------
    angle : float, rad
        Positive when the axis rises in positive direction.
    mass : float, kg
        Carriage with payload.

    References
    ----------
    (2.22). The torque that holds the axis is + i_t m_c g sin(angle) (errata 11).
    """
    return -mass * GRAVITY_M_S2 * math.sin(angle)


def _slope(position: float, speed: float, t: float, angle: float, mass: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed): none."""
    return 0.0, 0.0


def _trials(ground: AxisSummary) -> list[Trial]:
    """Both ways, as a twentieth of the Coulomb friction pulls and up to eight times as much."""
    sines = [share * ground.coulomb / (ground.ratio * ground.mass * GRAVITY_M_S2) for share in (0.05, 0.1, 0.2, 0.4)]
    return [Trial({"angle": sign * math.asin(min(sine, 1.0))}) for sine in sines for sign in (1.0, -1.0)] if ground.belt else []


EFFECT = Effect(
    name="tilt",
    slot="force",
    title="tilt of the axis",
    parameters=(Parameter("angle", "rad", "cart", 0.0, -math.pi / 2, math.pi / 2, "angle to the horizontal, rising positive"),),
    law=_force,
    slope=_slope,
    body="cart",
    uses=("cart.mass",),
    trials=_trials,
    behind_gap=True,
    seen="more torque in one direction than in the other, at every speed; grows with the payload",
    causes="axis mounted at an angle, or not level",
    check="spirit level; the same picture comes from a current offset or from skewed seals",
    remedy="level the axis, or state mounting.tilt_deg in axis.yaml where it is meant to be tilted",
    alike={
        "constant_offset": "slow strokes with a second known payload: only a tilt grows with the mass",
        "cable_chain": "slow strokes over the whole travel: a chain changes with the place, a tilt does not",
    },
    linear=True,
    source="(2.22)",
)
