"""A gap and the stiffness behind it: a wider gap behind a stiffer belt looks nearly alike, so that both lie in a narrow valley.

An observer holds near the model that it was made for, and a fit behind observers ends where no small step is better behind the one it has.
In that valley this may be far from its end: on a screw with a gap of 20 µm fits ended at 17.8 µm and 31 of 36 N/µm, at twice the noise and
2.6 intervals off.  So both are tried at some distance, each behind an observer of its own, and the fit goes on from the best.
"""

from __future__ import annotations

import math
from itertools import product

from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.records import Data, with_process_noise
from beltcomm.model import Model

#: Relative changes of gap and stiffness that are tried, at first and where none of them is better, and rounds of trials at most.
GAPS, STIFFNESSES, SMALLER, ROUNDS = (-0.1, -0.05, 0.0, 0.06, 0.12), (-0.1, 0.0, 0.1, 0.2), (1.0, 0.4), 8
#: Error over the noise up to which there is nothing to look for, and gain of O that is worth another round, nats.
AT_NOISE, WORTH = 1.1, 20.0
#: How often the carriage is asked anew how far it strays: the better the model, the less, and the more its motion tells.
CALMER, ITERATIONS = 4, 6
STIFFNESS = "belt_stiffness.stiffness"


def converged_gap(data: Data, fitted: Fitted) -> tuple[Data, Fitted]:
    """Records and model of a gap at the end of its valley, with a carriage that strays no further than this model leaves to chance.

    Parameters
    ----------
    fitted : Fitted
        As :func:`along_gap_valley`.

    Returns
    -------
    tuple of Data and Fitted
        Those given where the model is at the noise or nothing is better.
    """
    for _ in range(CALMER):
        further = along_gap_valley(data, fitted, ITERATIONS)
        calmer = with_process_noise(data, further.model)
        quieter = [piece.process_noise for piece in calmer.fitted] != [piece.process_noise for piece in data.fitted]
        if not quieter and (further is fitted or further.ratio <= AT_NOISE):
            return data, further
        data, fitted = (calmer, fit(calmer, further.model, ITERATIONS)) if quieter else (data, further)
    return data, fitted


def along_gap_valley(data: Data, fitted: Fitted, iterations: int) -> Fitted:
    """The fit of a model with a gap, from farther along the valley of gap and stiffness where that is likelier.

    Parameters
    ----------
    fitted : Fitted
        Of a model whose carriage is followed by an observer; any other comes back as it is.
    iterations : int
        Of the fit from each better place.

    Returns
    -------
    Fitted
        The likeliest; ``fitted`` itself where it is at the noise, or nothing is better.
    """
    gaps = [effect.full_names()[0] for effect in fitted.model.effect_list() if effect.rattles]  # the gap comes first
    if len(gaps) != 1 or STIFFNESS not in fitted.model.parameters:
        return fitted
    best, sizes = fitted, list(SMALLER)
    for _ in range(ROUNDS):
        if best.ratio <= AT_NOISE or not sizes:
            break
        near = min((fit(data, model, 0) for model in _around(best.model, gaps[0], sizes[0])), key=_objective, default=best)
        if near.objective < best.objective - WORTH:
            best = min(near, fit(data, near.model, iterations), key=_objective)
        else:
            sizes.pop(0)
    return best


def _around(model: Model, gap: str, size: float) -> list[Model]:
    """Models with other gaps and stiffnesses, inside their bounds.   size : of the changes, over the largest."""
    found = []
    for one, other in product(GAPS, STIFFNESSES):
        values = {gap: (1.0 + size * one) * model[gap], STIFFNESS: (1.0 + size * other) * model[STIFFNESS]}
        inside = all(model.parameters[name].low <= value <= model.parameters[name].high for name, value in values.items())
        if inside and (one or other):
            found.append(model.with_values(values, "laboratory"))
    return found


def _objective(fitted: Fitted) -> float:
    """O, infinite where a body flew off."""
    return fitted.objective if math.isfinite(fitted.objective) else math.inf
