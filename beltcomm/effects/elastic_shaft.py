"""Compliance between the motor and a turning load, on an axis without a belt: shaft, coupling, screw."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Body, Effect, Element, Parameter, Trial
from beltcomm.effects.coupling import slope

#: Hz; antiresonances tried, from a rope drive or a robot joint to a stiff screw, and shares of the whole inertia that the load may have.
FREQUENCIES_HZ = (1.0, 1.5, 2.1, 3.0, 4.2, 5.8, 8.0, 12.0, 17.0, 24.0, 32.0, 42.0, 55.0, 70.0, 90.0, 115.0, 150.0, 200.0)
SHARES = (0.4, 1.0, 2.5)
#: The same of a coupling so soft that the load's swing is most of what a rigid model made an inertia of: shares of that.
SOFT_HZ, SOFT_SHARES = (1.0, 1.7, 2.9, 5.0), (0.6, 0.85)


def _torque(twist: float, rate: float, x: float, stiffness: float, damping: float) -> float:
    """Torque in the shaft:  stiffness twist + damping rate, N m.

    Parameters
    ----------
    twist : float, rad
        Motor angle minus load angle.
    """
    return stiffness * twist + damping * rate


def _trials(ground: AxisSummary) -> list[Trial]:
    """Antiresonances from 1 to 200 Hz, for a load lighter than, equal to and heavier than what the rigid model sees."""
    if ground.belt:
        return []
    beside = [Trial(_load(share * ground.inertia, f)) for f in FREQUENCIES_HZ for share in SHARES]
    return beside + [
        Trial(_load(share * ground.inertia, f), base={"motor.inertia": (1.0 - share) * ground.inertia}, swallowed=True)
        for f in SOFT_HZ
        for share in SOFT_SHARES
    ]


def _load(inertia: float, antiresonance_hz: float) -> dict[str, float]:
    """A load of so many kg m² that swings with a damping ratio of 2 % while the motor is held."""
    turns = 2.0 * math.pi * antiresonance_hz
    return {"load.inertia": inertia, "stiffness": inertia * turns**2, "damping": 0.04 * inertia * turns}


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
    elements=(Element(("motor", "load"), _torque, slope, angular=True),),
    trials=_trials,
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
