"""The best values of an effect's own parameters near a fitted model, before anything is refitted.

What is fitted already gives way to first order (``likelihood.local_quadratic``), so one look costs one evaluation of the effect; the
few parameters of its own are searched without derivatives, because gap and slack have none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize

from beltcomm.arrays import Array
from beltcomm.effects import Effect
from beltcomm.effects._effect import BELT_STIFFNESS
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.laboratory.score import Scored, Scorer
from beltcomm.model import Model

#: Share of a value that a search moves it by at first where the trials say nothing.
FIRST_STEP = 0.3
#: Looks per parameter searched, the same where an observer makes each of them dear, and the gain below which a search ends, nats.
LOOKS, FOLLOWED_LOOKS, ENOUGH = 18, 8, 0.5
#: What a law of the belt changes so much that a first order does not do.
BELT = ("belt_stiffness.stiffness",)


def refine_best(scorer: Scorer, ways: Sequence[Scored], number: int) -> Scored:
    """The best of the first ``number`` ways with its own parameters searched; the best way itself where there is nothing to search.

    Parameters
    ----------
    scorer : Scorer
        Of the model without the effect.
    ways : sequence of Scored
        The best first.
    number : int
        That are searched.
    """
    names = _searched_names(scorer, ways[0])
    if not names:
        return ways[0]
    return max((_refine_way(scorer, way, names, [w.trial.values for w in ways]) for way in ways[:number]), key=lambda w: w.drop)


def _searched_names(scorer: Scorer, way: Scored) -> list[str]:
    """Names of what is searched, bare, or full ones of the base model: values of the trial that are fitted and no amplitudes."""
    effect = way.effect
    if effect.needs_observer:
        return []  # a refit finds them with fewer runs of the observer
    own = [p.name for p in effect.parameters if p.fitted] + [f"{b.name}.{b.inertia.name}" for b in effect.bodies]
    linear = len(own) == 1 and way.trial.signed
    names = [name for name in own if name in way.trial.values and name not in way.trial.amplitudes and not linear]
    if names and (effect.slot == "belt_law" or BELT_STIFFNESS in effect.uses):
        names += [name for name in BELT if name in scorer.problem.free]
    return names


def _refine_way(scorer: Scorer, way: Scored, names: Sequence[str], trials: Sequence[Mapping[str, float]]) -> Scored:
    """One way with the named values searched."""
    effect = way.effect
    limits = {name: _limit_of(scorer.model, effect, name) for name in names}
    extended = scorer.model_with(effect, way.values, way.trial)
    start = np.array([extended[_full_name(scorer.model, effect, name)] for name in names])
    scale = np.array([_first_step(name, value, trials) for name, value in zip(names, start, strict=True)])
    low, high = ((np.array([limits[name][i] for name in names]) - start) / scale for i in (0, 1))
    best = way

    def look(place: Array) -> float:
        nonlocal best
        values = {name: float(np.clip(v, *limits[name])) for name, v in zip(names, start + scale * place, strict=True)}
        base = {**way.trial.base, **{name: value for name, value in values.items() if name in BELT}}
        own = {**way.values, **{name: value for name, value in values.items() if name not in BELT}}
        found = scorer.score_at(effect, replace(way.trial, base=base), own)
        if found.drop > best.drop:
            best = found
        return -found.drop

    looks = FOLLOWED_LOOKS if needs_observer(scorer.model) else LOOKS
    corners = np.vstack([np.zeros(len(names)), np.diag(np.where(high >= 1.0, 1.0, -1.0))])
    minimize(
        look,
        corners[0],
        method="Nelder-Mead",
        bounds=list(zip(low, high, strict=True)),
        options={"initial_simplex": np.clip(corners, low, high), "maxfev": looks * len(names), "fatol": ENOUGH, "xatol": 1e-3},
    )
    return best


def _full_name(model: Model, effect: Effect, name: str) -> str:
    """Name in the model's list of parameters."""
    own = f"{effect.name}.{name}"
    return own if own in model.with_effect(effect.name).parameters else name


def _limit_of(model: Model, effect: Effect, name: str) -> tuple[float, float]:
    """Bounds of a searched value; a parameter of the base model stays within a factor of three."""
    if name in BELT:
        return model[name] / 1.5, 3.0 * model[name]
    limit = model.with_effect(effect.name).parameters[_full_name(model, effect, name)]
    return limit.low, limit.high


def _first_step(name: str, value: float, trials: Sequence[Mapping[str, float]]) -> float:
    """First step of a value: half the way to the next trial, at most a share of itself."""
    share = FIRST_STEP * abs(value)
    others = sorted(abs(trial[name] - value) for trial in trials if name in trial and abs(trial[name] - value) > 1e-9 * abs(value))
    near = [0.5 * others[0]] if others else []
    return max(min([share, *near]), 1e-9) if share else max([*near, 1e-6])
