"""The catalogue of physical effects.  ``EFFECTS`` is the only list; everything else looks effects up here."""

from __future__ import annotations

import difflib

from beltcomm.axis.terms import ALIASES
from beltcomm.effects import (
    backlash,
    belt_damping,
    belt_sections,
    belt_slack,
    belt_spans,
    belt_stiffness,
    cable_chain,
    cogging,
    constant_offset,
    coulomb,
    coupling,
    current_lag,
    dead_time,
    elastic_shaft,
    encoder_eccentricity,
    encoder_interpolation,
    end_pulley,
    feed_constant,
    friction_dip,
    friction_freeform,
    friction_position,
    holding_brake,
    load_friction,
    measurement_lag,
    other_load,
    payload_mode,
    presliding,
    pulley_eccentricity,
    quadratic_drag,
    rigid_load,
    stiffness_position,
    stribeck,
    tilt,
    tooth_ripple,
    torque_ripple,
    torque_saturation,
    travel_ripple,
    unbalance,
    viscous,
    viscous_asymmetry,
    warmup,
)
from beltcomm.effects._effect import (
    BELT_DAMPING,
    BELT_SPRING,
    BELT_STIFFNESS,
    DRIVING_BODY,
    DRIVING_END,
    AxisSummary,
    Body,
    DiscriminatingExperiment,
    Effect,
    Element,
    Parameter,
    Point,
    Trial,
    is_plain_belt,
)
from beltcomm.errors import UsageError

__all__ = [
    "BELT_DAMPING",
    "BELT_SPRING",
    "BELT_STIFFNESS",
    "DRIVING_BODY",
    "DRIVING_END",
    "EFFECTS",
    "AxisSummary",
    "Body",
    "DiscriminatingExperiment",
    "Effect",
    "Element",
    "Parameter",
    "Point",
    "Trial",
    "effect_named",
    "is_plain_belt",
    "stands_for",
]

EFFECTS: tuple[Effect, ...] = (
    rigid_load.EFFECT,
    belt_stiffness.EFFECT,
    belt_spans.EFFECT,
    stiffness_position.EFFECT,
    belt_sections.EFFECT,
    end_pulley.EFFECT,
    coupling.EFFECT,
    elastic_shaft.EFFECT,
    payload_mode.EFFECT,
    belt_damping.EFFECT,
    backlash.EFFECT,
    belt_slack.EFFECT,
    *viscous.EFFECTS,
    viscous_asymmetry.EFFECT,
    warmup.EFFECT,
    quadratic_drag.EFFECT,
    *coulomb.EFFECTS,
    *stribeck.EFFECTS,
    friction_dip.EFFECT,
    friction_freeform.EFFECT,
    holding_brake.EFFECT,
    load_friction.EFFECT,
    *friction_position.EFFECTS,
    *presliding.EFFECTS,
    tilt.EFFECT,
    constant_offset.EFFECT,
    cable_chain.EFFECT,
    unbalance.EFFECT,
    *cogging.EFFECTS,
    tooth_ripple.EFFECT,
    travel_ripple.EFFECT,
    torque_ripple.EFFECT,
    torque_saturation.EFFECT,
    dead_time.EFFECT,
    current_lag.EFFECT,
    measurement_lag.EFFECT,
    *pulley_eccentricity.EFFECTS,
    feed_constant.EFFECT,
    *encoder_eccentricity.EFFECTS,
    encoder_interpolation.EFFECT,
    *other_load.EFFECTS,
)

_BY_NAME = {effect.name: effect for effect in EFFECTS}


def effect_named(name: str) -> Effect:
    """Look an effect up by its name.

    Parameters
    ----------
    name : str
        As in the catalogue.

    Returns
    -------
    Effect
        From ``EFFECTS``.

    Raises
    ------
    UsageError
        With the nearest names.
    """
    name = ALIASES.get(name, name)
    if name in _BY_NAME:
        return _BY_NAME[name]
    near = difflib.get_close_matches(name, _BY_NAME, n=3)
    hint = f"did you mean {', '.join(near)}?" if near else "`beltcomm effects` lists all"
    raise UsageError(f"there is no effect {name!r}; {hint}")


def stands_for(name: str, *, behind_gap: bool = False) -> str:
    """The effect by which a name is fitted: itself, or the one that holds it among its twins and cannot be told from it.

    Parameters
    ----------
    name : str
        Of an effect.
    behind_gap : bool
        The carriage moves free of the motor at times, so that effects which are told from their twins only there are themselves.

    Returns
    -------
    str
        The name to fit.
    """
    effect = _BY_NAME.get(name)
    if effect is not None and (behind_gap or not effect.behind_gap):
        return name
    return next((e.name for e in EFFECTS if name in e.twins), name)
