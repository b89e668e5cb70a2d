"""Damping of the belt, parallel to its spring."""

from __future__ import annotations

from beltcomm.effects._effect import DRIVING_END, Effect, Element, Parameter


def force(stretch: float, rate: float, x: float, damping: float) -> float:
    """Force in the damper:  force = d rate, N.   rate : m/s.   damping : N s/m at the belt line.   Source: (2.25)."""
    return damping * rate


def slope(x: float, damping: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return 0.0, damping


EFFECT = Effect(
    name="belt_damping",
    slot="element",
    title="belt damping",
    parameters=(Parameter("damping", "N s/m", "belt", 15.0, 0.0, 2000.0, "losses in the belt"),),
    elements=(Element((DRIVING_END, "cart"), force, slope),),
    seen="width of the resonance",
    check="nothing; every belt has it",
    source="(2.25), (2.27)",
)
