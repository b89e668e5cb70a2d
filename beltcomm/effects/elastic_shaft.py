"""Compliance between the motor and a turning load, on an axis without a belt: shaft, coupling, screw."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Body, Effect, Element, Parameter, Trial
from beltcomm.effects.coupling import slope

#: Hz; antiresonances tried, and shares of the whole inertia that the load may have.
FREQUENCIES_HZ = (8.0, 12.0, 17.0, 24.0, 32.0, 42.0, 55.0, 70.0, 90.0, 115.0, 150.0, 200.0)
SHARES = (0.4, 1.0, 2.5)


def torque(twist: float, rate: float, x: float, stiffness: float, damping: float) -> float:
    """Torque in the shaft:  stiffness twist + damping rate, N m.

    Parameters
    ----------
    twist : float, rad
        Motor angle minus load angle.
    """
    return stiffness * twist + damping * rate


def trials(ground: AxisSummary) -> list[Trial]:
    """Antiresonances from 8 to 200 Hz, for a load lighter than, equal to and heavier than what the rigid model sees."""
    if ground.belt:
        return []
    return [
        Trial(
            {
                "load.inertia": share * ground.inertia,
                "stiffness": share * ground.inertia * (2.0 * math.pi * f) ** 2,
                "damping": 0.04 * share * ground.inertia * 2.0 * math.pi * f,
            }
        )
        for f in FREQUENCIES_HZ
        for share in SHARES
    ]


EFFECT = Effect(
    name="elastic_shaft",
    slot="body",
    title="compliance between motor and load",
    parameters=(
        Parameter("stiffness", "N m/rad", "motor", 50.0, 1e-3, 1e6, "torsional stiffness between motor and load"),
        Parameter("damping", "N m s/rad", "motor", 1e-3, 0.0, 10.0, "torsional damping between motor and load"),
    ),
    bodies=(
        Body("load", Parameter("inertia", "kg m2", "motor", 5e-5, 1e-8, 10.0, "load behind the compliance, at the motor"), rotary=True),
    ),
    elements=(Element(("motor", "load"), torque, slope, angular=True),),
    trials=trials,
    seen="antiresonance and resonance in the motor's response; above them the motor turns alone",
    causes="long shaft, coupling, screw between motor and load",
    check="clamping screws, coupling, bearings of the screw",
    remedy="tighten the coupling; a shorter or thicker shaft, a stiffer coupling",
    alike={
        "payload_mode": "take the payload off: its mode goes, that of the shaft stays",
    },
    linear=True,
    source="(2.38) for a shaft instead of a belt; data sheet",
)
