"""Friction that turns round over a distance: elastic lips and preload give way before anything slides."""

from __future__ import annotations

import math

from beltcomm.effects._effect import Effect, Ground, Parameter, Trial


def turned(step: float, z: float, length: float) -> float:
    """Share of the friction level that acts after a small step, -1 to 1 (Dahl, distance driven).

    z' = s + (z - s) exp(-|step|/length),   s = sign(step)

    step, length : m at the belt.   Source: effects-and-diagnosis sheet, section 2; Dahl 1968.
    """
    if step == 0.0:
        return z
    side = 1.0 if step > 0.0 else -1.0
    return side + (z - side) * math.exp(-abs(step) / length)


def trials(ground: Ground) -> list[Trial]:
    """Three lengths."""
    return [Trial({"length": length}) for length in (1.5e-5, 4e-5, 1e-4)]


EFFECT = Effect(
    name="presliding",
    slot="friction_onset",
    title="friction that builds up over a distance",
    parameters=(Parameter("length", "m", "motor", 3e-5, 2e-7, 2e-3, "travel over which friction turns round"),),
    law=turned,
    body="motor",
    trials=trials,
    seen="after a reversal friction does not jump but grows over some tens of micrometres",
    causes="elastic seal lips, bearing preload",
    check="normally nothing; it limits the smallest moves",
    source="data sheet of seals",
)
