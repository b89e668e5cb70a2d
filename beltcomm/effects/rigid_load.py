"""A load that moves with the motor, rigidly: what both weigh is all that a motion shows of them."""

from __future__ import annotations

from beltcomm.effects._effect import RIGID_OWNER, Effect, Parameter


def driven(inertia: float, ratio: float, mass: float) -> float:
    """Inertia of the motor with its load:  J + i_t² m, kg m² at the motor shaft.

    Parameters
    ----------
    inertia : float, kg m²
    ratio : float, m/rad
    mass : float, kg
    """
    return inertia + ratio * ratio * mass


EFFECT = Effect(
    name="rigid_load",
    slot="rigid",
    owner=RIGID_OWNER,
    title="load without compliance",
    parameters=(Parameter("mass", "kg", "cart", 1.0, 1e-3, 1e4, "load that moves with the motor, beside what turns with it"),),
    law=driven,
    group="rigid load",
    seen="one inertia at all frequencies: no antiresonance and no resonance of the motor's response",
    causes="a stiff screw, a direct drive, a linear motor",
    check="compare the inertia of motor and load together with the data sheets",
    remedy="where it swings after all, state its stiffness in axis.yaml",
    alike={"belt_stiffness": "a faster sampling period: an antiresonance far above the band looks rigid below it"},
    linear=True,
    source="(2.25) for c to infinity",
)
