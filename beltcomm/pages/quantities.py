"""Numbers of a run that can be compared between runs, with 95 % intervals where they are known."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from beltcomm.axis.terms import PLAIN, Terms
from beltcomm.model import Model
from beltcomm.sentences.words import DERIVED, SHOWN, number
from beltcomm.watching.limits import UNKNOWN, USUAL


@dataclass(frozen=True)
class Quantity:
    """One number of an axis.

    Attributes
    ----------
    value, interval
        SI; interval None where it is not known.
    unit, scale
        As shown.
    more, less : str
        Words for a change.
    usual : float
        Share by which it changes without anything being wrong, and ``why``.
    """

    key: str
    words: str
    unit: str
    scale: float
    value: float
    interval: float | None
    more: str
    less: str
    usual: float
    why: str

    def shown(self) -> str:
        """Value ± interval, in the unit shown."""
        return number(self.scale * self.value, None if self.interval is None else self.scale * self.interval, self.unit)


_BELT = ("belt stiffer", "belt softer", "temperature and load of the belt")
_LOAD = "cables and what lies on the carriage"
#: Key -> words when it is more and less, and why it changes by itself.
_MEANING = {
    "cart.mass": ("carriage heavier", "carriage lighter", _LOAD),
    "mass": ("load heavier", "load lighter", _LOAD),
    "motor.inertia": ("more inertia at the motor", "less inertia at the motor", "scale of the torque from drive to drive"),
    "belt_stiffness.stiffness": _BELT,
    "belt_spans.specific_stiffness": _BELT,
    "belt_sections.specific_stiffness": _BELT,
    "belt_damping.damping": ("belt damping up", "belt damping down", "temperature"),
    "coulomb_total": ("friction up", "friction down", "temperature, standstill and the way driven before"),
    "viscous_total": ("viscous friction up", "viscous friction down", "temperature of the grease"),
    "resonance": ("resonance higher", "resonance lower", "temperature and load of the belt"),
    "antiresonance": ("antiresonance higher", "antiresonance lower", "temperature and load of the belt"),
    "dead_time": ("torque comes later", "torque comes earlier", "another sample period of the records"),
    "dynamic_error": ("following error up", "following error down", "friction, which changes with temperature"),
    "static_error": ("settled error up", "settled error down", "the axis sticks somewhere within its friction"),
}
#: Parts of a sum that is shown as a whole: which part moves is the fit's affair.
_PARTS = ("viscous.damping", "viscous_cart.damping", "coulomb.level", "cart_friction.level", "transmission.ratio")


def quantities_of(model: Model | None, results: Mapping[str, Mapping[str, Any]], terms: Terms = PLAIN) -> dict[str, Quantity]:
    """By key, in the order shown: model, what follows from it, delay, errors of the last move.

    Parameters
    ----------
    model : Model or None
        Of the axis; None while none is known.
    results : Mapping[str, Mapping[str, Any]]
        Of the run folder.
    terms : Terms
        With the units of the kind of axis.
    """
    found: dict[str, Quantity] = {}

    def add(key: str, words: str, unit: str, scale: float, value: float, interval: float | None) -> None:
        more, less, why = _MEANING.get(key, (f"{words} up", f"{words} down", "nobody measured how far it changes by itself"))
        known = interval if interval is not None and math.isfinite(interval) else None
        own = terms.shown(unit)
        found[key] = Quantity(key, words, own.symbol, scale * own.factor, float(value), known, more, less, USUAL.get(key, UNKNOWN), why)

    for name, value in (model.parameters if model is not None else {}).items():
        if name in _PARTS or value.interval is None:
            continue
        words, unit, scale = SHOWN.get(name, (name.replace(".", " ").replace("_", " "), value.unit, 1.0))
        add(name, words, unit, scale, value.value, value.interval)
    fit = results.get("fit") or {}
    for name, (words, unit, scale) in DERIVED.items():
        if (item := (fit.get("characteristics") or {}).get(name)) is not None:
            add(name, words, unit, scale, item["value"], item.get("interval"))
    if dead := fit.get("dead_time"):
        add("dead_time", "delay from setpoint to torque", "ms", 1e3, dead["value_s"], dead.get("interval_s"))
    moves = [result for name, result in results.items() if name.startswith("verify_")]
    if moves:
        measured = moves[-1]["measured"]
        add("dynamic_error", "following error, motor", "mm", 1e3, measured["dynamic_m"], None)
        add("static_error", "settled error, motor", "mm", 1e3, measured["static_m"], None)
    return found
