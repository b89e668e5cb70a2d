"""The form of an effect that is named: its law may be another than the usual one, or another effect may belong to it.

While effects are searched every law has its usual form (a tight spot is a bell, a chain a straight spring): free forms would let one
effect explain another.  What is left over once nothing more is found asks for the form:

    evidence = O_before - O_after - n ln N,   n : numbers that become free

with the held-out records not against it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from beltcomm.effects import Effect
from beltcomm.identify.following import follows
from beltcomm.laboratory.acceptance import drop_by, grown_out_of_bounds, impossible, refuted
from beltcomm.laboratory.data import Data
from beltcomm.laboratory.fitting import Fitted, fit
from beltcomm.model import Model

#: Evidence that a form must have, nats: noise alone reaches 10 once in some thousands.
EVIDENCE = 10.0
#: Iterations of a fit with the form free.
ITERATIONS = 12


def formed(data: Data, fitted: Fitted, base: Model) -> tuple[Fitted, tuple[str, ...]]:
    """The model with the forms of its added effects fitted where that pays; names of what became free (parameters) or came (effects).

    base : model without the added effects.   One form after the other, in the order of the model's effects.
    """
    found: list[str] = []
    if follows(fitted.model):
        return fitted, ()  # an observer forgives what a form would explain
    for effect in [e for e in fitted.model.effect_list() if e.name not in base.effects]:
        for names, model in variants(fitted.model, effect):
            trial = fit(data, model, ITERATIONS, offsets=fitted.offsets)
            if pays(fitted, trial):
                fitted = trial
                found += names
    return fitted, tuple(found)


def variants(model: Model, effect: Effect) -> Iterator[tuple[list[str], Model]]:
    """Models with the forms of an effect's law free, or with an effect that completes it; with the names of what is new."""
    held = [f"{effect.name}.{p.name}" for p in effect.parameters if p.form]
    if any(model.parameters[name].low == model.parameters[name].high for name in held):
        yield held, model.with_forms(effect.name)
    for name in effect.completed_by:
        if name not in model.effects:
            yield [name], model.with_effect(name)


def pays(before: Fitted, after: Fitted) -> bool:
    """Whether a form explains enough of what was left over, and as an axis can be."""
    price = (len(after.problem.free) - len(before.problem.free)) * math.log(before.problem.samples)
    evidence = drop_by(before, after) - price
    against = refuted(evidence, before.held_objective - after.held_objective)
    new = [e for e in after.model.effect_list() if e.name not in before.model.effects]
    return evidence > EVIDENCE and not (against or impossible(after.model) or any(grown_out_of_bounds(after.model, e) for e in new))
