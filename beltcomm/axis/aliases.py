"""Names of effects on an axis without a belt: what is called after the belt or its carriage is called after the link and the load."""

from __future__ import annotations

from collections.abc import Mapping

#: Other name -> name of the effect.
ALIASES: Mapping[str, str] = {
    "link_stiffness": "belt_stiffness",
    "link_damping": "belt_damping",
    "friction_at_load": "cart_friction",
    "viscous_at_load": "viscous_cart",
    "stribeck_at_load": "stribeck_cart",
    "presliding_at_load": "presliding_cart",
    "friction_by_place_at_load": "friction_position_cart",
}
