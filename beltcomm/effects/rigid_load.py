"""A load that moves with the motor, rigidly: what both weigh is all that a motion shows of them."""

from __future__ import annotations

from beltcomm.effects._effect import RIGID_OWNER, Effect, Parameter

EFFECT = Effect(
    name="rigid_load",
    slot="rigid",
    owner=RIGID_OWNER,
    title="load without compliance",
    parameters=(Parameter("mass", "kg", "cart", 1.0, 1e-3, 1e4, "load that moves with the motor, beside what turns with it"),),
    group="rigid load",
    seen="one inertia at all frequencies: no antiresonance and no resonance of the motor's response",
    causes="a stiff screw, a direct drive, a linear motor",
    check="compare the inertia of motor and load together with the data sheets",
    alike={"belt_stiffness": "a faster sampling period: an antiresonance far above the band looks rigid below it"},
    linear=True,
    source="(2.25) for c to infinity",
)
