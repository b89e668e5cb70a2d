"""What the last diagnosis of a run found of an effect: where ``beltcomm add`` can begin as well."""

from __future__ import annotations

from beltcomm.effects import effect_named
from beltcomm.errors import BeltcommError
from beltcomm.fit.base import NEXT_ITERATIONS
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data
from beltcomm.laboratory.acceptance import drop_by
from beltcomm.laboratory.forms import held
from beltcomm.laboratory.stage import MISSING
from beltcomm.model import Model
from beltcomm.runfolder import RunFolder


def told_before(folder: RunFolder, model: Model, effect: str) -> Model | None:
    """The model with the effect and the values that ``results/diagnosis.yaml`` ended with; None where it says nothing of it."""
    try:
        after = (folder.load_result("diagnosis") or {})["after"]
        if effect not in after["effects"]:
            return None
        grown = model.with_effect(effect)
        told = {name: float(said["value"]) for name, said in after["parameters"].items() if name in grown.parameters}
        for form in held(grown, effect_named(effect)):  # stays the usual one: it is found after the effect
            told.pop(form, None)
        return grown.with_values(told, "diagnosis")
    except (BeltcommError, KeyError, TypeError, ValueError, AttributeError):
        return None  # a start value that cannot be read is none


def named_beside(folder: RunFolder, model: Model) -> list[str]:
    """Effects that the last diagnosis names and a model does not have, without those that `add` tries by itself."""
    try:
        named = [effect_named(str(name)) for name in (folder.load_result("diagnosis") or {})["named"]]
    except (BeltcommError, KeyError, TypeError):
        return []
    along = {part for effect in named for part in effect.completed_by}
    return [e.name for e in named if e.name not in model.effects and e.name not in along]


def better(folder: RunFolder, data: Data, base: Fitted, grown: Fitted, effect: str) -> Fitted:
    """The model grown from a base, or the same begun at what the diagnosis found where that leaves less: it may have come another way."""
    if grown.objective < MISSING * grown.problem.samples:
        return grown
    told = told_before(folder, base.model, effect)
    if told is None:
        return grown
    again = fit(data, told, NEXT_ITERATIONS, offsets=grown.offsets)
    return again if drop_by(grown, again) > 0.0 else grown
