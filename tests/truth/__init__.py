"""The independent truth simulator: judges the product and therefore imports nothing from it.

``nominal(name)``, ``draw(name, rng)`` and ``geared(name, ratio)`` give the thesis's rigs; :class:`TruthPlant` takes any :class:`Axis`.
:mod:`truth.hidden` draws machines with hidden effects and writes their run folders.
"""

from truth.plant import Axis, ConstantBelt, Coupling, EndStops, ThreeSectionBelt, TruthPlant, TwoStrandBelt
from truth.rigs import RIGS, Rig, draw, geared, nominal

__all__ = [
    "RIGS",
    "Axis",
    "ConstantBelt",
    "Coupling",
    "EndStops",
    "Rig",
    "ThreeSectionBelt",
    "TruthPlant",
    "TwoStrandBelt",
    "draw",
    "geared",
    "nominal",
]
