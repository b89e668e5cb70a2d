"""Removes earlier additions that a newer one made superfluous: the model refitted without each of them is as good."""

from __future__ import annotations

import math

import numpy as np

from beltcomm.effects import effect_named
from beltcomm.fit.estimate import Fitted, fit_of, problem_of
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.laboratory.acceptance import EVIDENCE, drop_by, is_negligible, most_within
from beltcomm.laboratory.law_shape import additions, without
from beltcomm.model import Model

#: Iterations of a refit, and where another kind of observer is needed.
ITERATIONS, MORE_ITERATIONS = 12, 25
#: A loss of so many times the least evidence needs no exact figure.
SURE = 4.0
#: Factor by which the error may be larger without an effect that is superfluous.
WORSE = 1.5


def drop_superfluous(data: Data, fitted: Fitted, base: Model, newest: str) -> tuple[Fitted, tuple[str, ...]]:
    """Throw out earlier additions without which the model is as good, or of which nothing is left: what stays, and their names.

    Parameters
    ----------
    base : Model
        Model that the search began with.
    newest : str
        Name of the effect that was added last, which is not asked.
    """
    removed = []
    worth = rise_without(fitted)
    for name in [e.name for e in additions(fitted.model, base) if e.name != newest]:
        if worth.get(name, 0.0) > SURE * EVIDENCE:
            continue
        smaller = without(fitted.model, name)
        if smaller is None:
            continue
        # Where an observer is no longer needed, where each carriage stood at first has to be found anew.
        iterations = ITERATIONS if needs_observer(smaller) == needs_observer(fitted.model) else MORE_ITERATIONS
        nothing = is_negligible(fitted.model, effect_named(name))
        problem = problem_of(data, smaller)
        goal = math.inf if nothing else most_within(problem, fitted, SURE * EVIDENCE)
        trial = fit_of(problem, data, iterations, offsets=fitted.offsets, goal=goal)
        missed = trial.ratio > WORSE * fitted.ratio  # what an observer does to the noise may outweigh the whole error
        if nothing or (not missed and drop_by(trial, fitted) < EVIDENCE):
            removed.append(name)
            fitted = trial
    return fitted, tuple(removed)


def rise_without(fitted: Fitted) -> dict[str, float]:
    """By how much O rises to first order when an effect that is a sum of amplitudes is taken out and the rest gives way, nats."""
    problem = fitted.problem
    linear = {}
    for effect in fitted.model.effect_list():
        if effect.harmonic != "load":
            continue
        linear[effect.name] = [problem.free.index(name) for name in effect.full_names() if name in problem.free]
    if not linear:
        return {}
    jacobian = problem.jacobian(fitted.x).weighted_rows(problem.weights(fitted.residual))
    inverse = np.linalg.pinv(jacobian.information())
    return {name: float(fitted.x[at] @ np.linalg.pinv(inverse[np.ix_(at, at)]) @ fitted.x[at]) for name, at in linear.items()}
