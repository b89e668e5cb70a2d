"""The form of an effect that is named: its law may be another than the usual one, or another effect may belong to it.

While effects are searched every law has its usual form (a tight spot is a bell, a chain a straight spring): free forms would let one
effect explain another.  What is left over once nothing more is found asks for the form:

    evidence = O_before - O_after - n ln N,   n : numbers that become free

with the held-out records not against it.  An effect that was added for what a form explains as well is taken out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np

from beltcomm.effects import Effect, effect_named
from beltcomm.errors import UsageError
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.likelihood.problem import OFFSET_M
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.residual.whitened import whitened_residual
from beltcomm.laboratory.acceptance import EVIDENCE as TO_BE_NAMED  # of an effect; that of a form is below
from beltcomm.laboratory.acceptance import drop_by, exceeds_bounds, impossible, is_refuted
from beltcomm.model import Model

#: Evidence that a form must have, nats: noise alone reaches 10 once in some thousands.
EVIDENCE = 10.0
#: Iterations of a fit with the form free.
ITERATIONS = 12
#: Share of what a part at the carriage must explain that it has to promise to first order, or nothing is fitted for it.  On 7 machines with
#: their friction there it promised 0.6 to 1.0 of what fits then found (193 to 18000 nats); on 10 with it at the motor 0 to 9 nats.
PROMISED = 0.5
#: Shares of a law by which that is looked at: what sticks with all of it may slide with less.
PARTS = (1.0, 0.3, 0.1)


@dataclass(frozen=True)
class ShapedFit:
    """A model with forms.

    Attributes
    ----------
    new : tuple of str
        What became free (parameters) or came (effects).
    removed : tuple of str
        Effects that a form made superfluous.
    """

    fitted: Fitted
    new: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()


def fit_law_shapes(data: Data, fitted: Fitted, base: Model) -> ShapedFit:
    """The model with the forms of its added effects fitted where that pays.

    First a form in place of an effect that was added later, then one form after the other, in the order of the model's effects.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    base : Model
        Model without the added effects.
    """
    if needs_observer(fitted.model):
        return ShapedFit(fitted)  # an observer forgives what a form would explain
    new: list[str] = []
    removed: list[str] = []
    for effect in reversed(additions(fitted.model, base)[1:]):
        smaller = without(fitted.model, effect.name)
        formable = [] if smaller is None else [e for e in additions(smaller, base) if any(p.form for p in e.parameters)]
        if smaller is not None and formable:
            names = [name for e in formable for name in fixed_forms(smaller, e)]
            trial = fit(data, reduce(Model.with_forms, [e.name for e in formable], smaller), ITERATIONS, offsets=fitted.offsets)
            if drop_by(trial, fitted) < TO_BE_NAMED and not _is_contradicted(fitted, trial):
                fitted = trial
                new += names
                removed.append(effect.name)
    for effect in additions(fitted.model, base):
        for one in ("", *effect.completed_by):
            if one and _rubs_like(effect, one):
                on_body = _split_between_bodies(data, fitted, effect, one, EVIDENCE)
                new += [name for name in on_body.model.effects if name not in fitted.model.effects]
                fitted = on_body
            elif found := _variant(fitted.model, effect, one):
                trial = fit(data, found[1], ITERATIONS, offsets=fitted.offsets)
                if _is_worth_its_parameters(fitted, trial):
                    fitted = trial
                    new += found[0]
    return ShapedFit(fitted, tuple(new), tuple(removed))


def assign_body(data: Data, fitted: Fitted, effect: Effect) -> ShapedFit:
    """The model with what of a law acts on the carriage, asked as soon as the law is named at the motor.

    On the wrong body it would mislead the search.  It takes the evidence of an effect; with less it is asked again when all is found.

    Parameters
    ----------
    data : Data
    fitted : Fitted
        With the effect, named at the motor.
    effect : Effect

    Returns
    -------
    ShapedFit
        With the names of the effects that came in.
    """
    before = fitted
    for one in effect.completed_by if not needs_observer(fitted.model) else ():
        if _rubs_like(effect, one):
            fitted = _split_between_bodies(data, fitted, effect, one, TO_BE_NAMED)
    return ShapedFit(fitted, tuple(name for name in fitted.model.effects if name not in before.model.effects))


def _split_between_bodies(data: Data, fitted: Fitted, effect: Effect, one: str, evidence: float) -> Fitted:
    """The model with a law's friction where it acts: at the motor, at the carriage, or at both.

    Both parts are nearly the same to a motor that feels them together.  A fit that begins at the motor may stay there, and a part that is
    none takes from the other what it likes: a tight spot of 14 N at the carriage was 11.6 ± 0.7 N beside one at the motor.
    """
    behind = _at_carriage(fitted.model, effect, one)
    if behind is None:
        return fitted
    if one not in fitted.model.effects:
        begun, choice = fitted, math.log(fitted.problem.samples)  # no number more, but a body of its own
        if _promise_at_carriage(begun, effect, one) < PROMISED * (evidence + choice):
            return begun
        trial = fit(data, behind, ITERATIONS, offsets=begun.offsets)
        fitted = trial if _is_worth_its_parameters(begun, trial, evidence + choice) else begun
        if found := _variant(begun.model, effect, one):
            trial = fit(data, found[1], ITERATIONS, offsets=begun.offsets)
            fitted = trial if _is_worth_its_parameters(fitted, trial, evidence) else fitted
        if fitted is begun:
            return begun
    if not _acts_at_carriage_only(fitted.model, effect):
        return _smaller(data, fitted, effect, one)
    both = fit(data, _release(fitted.model, effect), ITERATIONS, offsets=fitted.offsets)
    return _smaller(data, both, effect, one) if _is_worth_its_parameters(fitted, both, TO_BE_NAMED) else fitted


def _promise_at_carriage(fitted: Fitted, effect: Effect, one: str) -> float:
    """By how much O falls to first order with a part of a law, or with all of it, at the carriage, nats.

    Where the law is the motor's, it says so in a hundredth of the time that fits would take.
    """
    behind = _at_carriage(fitted.model, effect, one)
    if behind is None:
        return 0.0
    nearby, part = fitted.local_quadratic, effect_named(one).full_names()[0]
    found = [nearby.best(_residual_change(fitted, behind)).objective]
    for share in PARTS:
        beside = fitted.model.with_effect(one, {part: share * behind[part]})
        found.append(nearby.best(columns=_residual_change(fitted, beside)[:, None]).objective)
    return nearby.objective - min(found)


def _residual_change(fitted: Fitted, model: Model) -> np.ndarray:
    """Change of the whitened residual by another model of the same records, nothing fitted again, (n,)."""
    vector, offsets = model.vector(), OFFSET_M * fitted.offsets
    pieces = zip(fitted.problem.pieces, offsets, strict=True)
    return np.asarray(
        np.concatenate([whitened_residual(piece, model, vector, float(offset)) for piece, offset in pieces]) - fitted.residual
    )


def _smaller(data: Data, both: Fitted, effect: Effect, one: str) -> Fitted:
    """The model with a law at the carriage alone, unless its part at the motor has the evidence of an effect of its own.

    With less it stands for the law's form, or for the roughness that sticking gives the objective: 61 and 28 nats on machines without it.
    """
    behind = _at_carriage(both.model, effect, one)
    if behind is None:
        return both
    alone = fit(data, behind, ITERATIONS, offsets=both.offsets)
    return both if _is_worth_its_parameters(alone, both, TO_BE_NAMED) or impossible(alone.model) else alone


def _rubs_like(effect: Effect, one: str) -> bool:
    """True if what completes an effect is the same law at the carriage."""
    return effect_named(one).slot == effect.slot


def _acts_at_carriage_only(model: Model, effect: Effect) -> bool:
    """True if all of a law acts at the carriage."""
    size = model.parameters[effect.full_names()[0]]
    return size.low == size.high == 0.0


def _at_carriage(model: Model, effect: Effect, one: str) -> Model | None:
    """The model with a law at the carriage alone; None where there is no carriage behind a belt."""
    size, part = effect.full_names()[0], effect_named(one).full_names()[0]
    try:
        grown = model if one in model.effects else model.with_effect(one, {part: 0.0})
    except UsageError:
        return None
    force, own = grown.parameters[part], grown.parameters[size]
    if own.unit != "N m" or force.unit != "N":
        return None
    level = force.value + own.value / grown["transmission.ratio"]
    none = replace(own, value=0.0, low=0.0, high=0.0, interval=None)
    all_of_it = replace(force, value=min(max(level, force.low), force.high), interval=None)
    return replace(grown, parameters={**grown.parameters, size: none, part: all_of_it})


def _release(model: Model, effect: Effect) -> Model:
    """The model with the motor's part of a law to be fitted again."""
    size = effect.full_names()[0]
    usual = model.parameters_of(effect)[size]
    return replace(model, parameters={**model.parameters, size: replace(model.parameters[size], low=usual.low, high=usual.high)})


def additions(model: Model, base: Model) -> list[Effect]:
    """Effects that the base does not have and that mean something on their own.

    Parameters
    ----------
    model : Model
        With the effects.
    base : Model
        Without them.
    """
    effects = [e for e in model.effect_list() if e.name not in base.effects]
    completing = {name for e in effects for name in e.completed_by}
    return [e for e in effects if e.name not in completing]


def without(model: Model, name: str) -> Model | None:
    """The model without an effect; None where another stands on it, as presliding of the carriage does on its friction.

    Parameters
    ----------
    model : Model
        With the effect.
    name : str
        Of the effect.
    """
    try:
        return model.without_effect(name)
    except UsageError:
        return None


def fixed_forms(model: Model, effect: Effect) -> list[str]:
    """Forms of an effect's law that are not free yet.

    Parameters
    ----------
    model : Model
    effect : Effect

    Returns
    -------
    list of str
        Full names of parameters.
    """
    forms = [f"{effect.name}.{p.name}" for p in effect.parameters if p.form]
    return [name for name in forms if model.parameters[name].low == model.parameters[name].high]


def _variant(model: Model, effect: Effect, one: str) -> tuple[list[str], Model] | None:
    """The names of what is new, and the model with it: the forms of an effect's law free for "", or an effect that completes it.

    None where there is nothing new, or no body for it.
    """
    if not one:
        return (names, model.with_forms(effect.name)) if (names := fixed_forms(model, effect)) else None
    try:
        return None if one in model.effects else ([one], model.with_effect(one))
    except UsageError:
        return None


def _is_worth_its_parameters(before: Fitted, after: Fitted, evidence: float = EVIDENCE) -> bool:
    """True if a form explains so much more than what it costs, and as an axis can be."""
    price = (len(after.problem.free) - len(before.problem.free)) * math.log(before.problem.samples)
    return drop_by(before, after) - price > evidence and not _is_contradicted(before, after)


def _is_contradicted(before: Fitted, after: Fitted) -> bool:
    """True if the held-out records or its own values speak against a form."""
    against = is_refuted(drop_by(before, after), before.held_out_objective - after.held_out_objective, before.held_out_share)
    new = [e for e in after.model.effect_list() if e.name not in before.model.effects]
    return against or bool(impossible(after.model)) or any(exceeds_bounds(after.model, e) for e in new)
