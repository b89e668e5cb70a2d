"""The form of an effect that is named: its law may be another than the usual one, or another effect may belong to it.

While effects are searched every law has its usual form (a tight spot is a bell, a chain a straight spring): free forms would let one
effect explain another.  What is left over once nothing more is found asks for the form:

    evidence = O_before - O_after - n ln N,   n : numbers that become free

with the held-out records not against it.  An effect that was added for what a form explains as well is taken out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import reduce

from beltcomm.effects import Effect, effect_named
from beltcomm.errors import UsageError
from beltcomm.identify.following import follows
from beltcomm.laboratory.acceptance import EVIDENCE as TO_BE_NAMED  # of an effect; that of a form is below
from beltcomm.laboratory.acceptance import drop_by, grown_out_of_bounds, impossible, refuted
from beltcomm.laboratory.data import Data
from beltcomm.laboratory.fitting import Fitted, fit
from beltcomm.model import Model

#: Evidence that a form must have, nats: noise alone reaches 10 once in some thousands.
EVIDENCE = 10.0
#: Iterations of a fit with the form free.
ITERATIONS = 12


@dataclass(frozen=True)
class Formed:
    """A model with forms.   new : what became free (parameters) or came (effects).   removed : effects that a form made superfluous."""

    fitted: Fitted
    new: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()


def formed(data: Data, fitted: Fitted, base: Model) -> Formed:
    """The model with the forms of its added effects fitted where that pays.   base : model without the added effects.

    First a form in place of an effect that was added later, then one form after the other, in the order of the model's effects.
    """
    if follows(fitted.model):
        return Formed(fitted)  # an observer forgives what a form would explain
    new: list[str] = []
    removed: list[str] = []
    for effect in reversed(additions(fitted.model, base)[1:]):
        smaller = without(fitted.model, effect.name)
        formable = [] if smaller is None else [e for e in additions(smaller, base) if any(p.form for p in e.parameters)]
        if smaller is not None and formable:
            names = [name for e in formable for name in held(smaller, e)]
            trial = fit(data, reduce(Model.with_forms, [e.name for e in formable], smaller), ITERATIONS, offsets=fitted.offsets)
            if drop_by(trial, fitted) < TO_BE_NAMED and not spoiled(fitted, trial):
                fitted = trial
                new += names
                removed.append(effect.name)
    for effect in additions(fitted.model, base):
        for one in ("", *effect.completed_by):
            if found := variant(fitted.model, effect, one):
                trial = fit(data, found[1], ITERATIONS, offsets=fitted.offsets)
                if pays(fitted, trial):
                    fitted = trial
                    new += found[0]
    return Formed(fitted, tuple(new), tuple(removed))


def placed(data: Data, fitted: Fitted, effect: Effect) -> Formed:
    """The model with what of a law acts on the carriage, asked as soon as the law is named at the motor.

    On the wrong body it would mislead the search.  It takes the evidence of an effect; with less it is asked again when all is found.
    """
    new: list[str] = []
    for one in effect.completed_by if not follows(fitted.model) else ():
        found = variant(fitted.model, effect, one) if effect_named(one).slot == effect.slot else None
        if found and pays(fitted, trial := fit(data, found[1], ITERATIONS, offsets=fitted.offsets), TO_BE_NAMED):
            fitted = trial
            new += found[0]
    return Formed(fitted, tuple(new))


def additions(model: Model, base: Model) -> list[Effect]:
    """Effects that the base does not have and that mean something on their own."""
    effects = [e for e in model.effect_list() if e.name not in base.effects]
    completing = {name for e in effects for name in e.completed_by}
    return [e for e in effects if e.name not in completing]


def without(model: Model, name: str) -> Model | None:
    """The model without an effect; None where another stands on it, as presliding of the carriage does on its friction."""
    try:
        return model.without_effect(name)
    except UsageError:
        return None


def held(model: Model, effect: Effect) -> list[str]:
    """Forms of an effect's law that are not free yet."""
    forms = [f"{effect.name}.{p.name}" for p in effect.parameters if p.form]
    return [name for name in forms if model.parameters[name].low == model.parameters[name].high]


def variant(model: Model, effect: Effect, one: str) -> tuple[list[str], Model] | None:
    """The names of what is new, and the model with it: the forms of an effect's law free for "", or an effect that completes it.

    None where there is nothing new, or no body for it.
    """
    if not one:
        return (names, model.with_forms(effect.name)) if (names := held(model, effect)) else None
    try:
        return None if one in model.effects else ([one], model.with_effect(one))
    except UsageError:
        return None


def pays(before: Fitted, after: Fitted, evidence: float = EVIDENCE) -> bool:
    """Whether a form explains so much more than what it costs, and as an axis can be."""
    price = (len(after.problem.free) - len(before.problem.free)) * math.log(before.problem.samples)
    return drop_by(before, after) - price > evidence and not spoiled(before, after)


def spoiled(before: Fitted, after: Fitted) -> bool:
    """Whether the held-out records or its own values speak against a form."""
    against = refuted(drop_by(before, after), before.held_objective - after.held_objective)
    new = [e for e in after.model.effect_list() if e.name not in before.model.effects]
    return against or bool(impossible(after.model)) or any(grown_out_of_bounds(after.model, e) for e in new)
