"""The catalogue of physical effects.  ``EFFECTS`` is the only list; everything else looks effects up here."""

from __future__ import annotations

import difflib

from beltcomm.effects import (
    belt_damping,
    belt_stiffness,
    stiffness_position,
    coulomb,
    coupling,
    end_pulley,
    tilt,
    viscous,
)
from beltcomm.effects._effect import DRIVING_BODY, DRIVING_END, Body, Effect, Element, Parameter, Point
from beltcomm.errors import UsageError

__all__ = ["DRIVING_BODY", "DRIVING_END", "EFFECTS", "Body", "Effect", "Element", "Parameter", "Point", "effect_named"]

EFFECTS: tuple[Effect, ...] = (
    belt_stiffness.EFFECT,
    stiffness_position.EFFECT,
    end_pulley.EFFECT,
    coupling.EFFECT,
    belt_damping.EFFECT,
    *viscous.EFFECTS,
    *coulomb.EFFECTS,
    tilt.EFFECT,
)

_BY_NAME = {effect.name: effect for effect in EFFECTS}


def effect_named(name: str) -> Effect:
    """The effect of that name.  Raises UsageError with the nearest names."""
    if name in _BY_NAME:
        return _BY_NAME[name]
    near = difflib.get_close_matches(name, _BY_NAME, n=3)
    hint = f"did you mean {', '.join(near)}?" if near else "`beltcomm effects` lists all"
    raise UsageError(f"there is no effect {name!r}; {hint}")
