"""Draws of parameters, as uncertain as a fit leaves them, within their bounds."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from beltcomm.arrays import Array
from beltcomm.model import Model
from beltcomm.model.covariance import Covariance
from beltcomm.model.value import NORMAL_95

#: Draws that an interval is taken from; variance that is none.
DRAWS, TINY = 1000, 1e-300
#: A parameter whose interval alone is known, to more than this share of its range, is known together with others only, and stays.
KNOWN_SHARE = 0.5


def machines_like(model: Model, count: int, *, seed: int, held: Collection[str] = ()) -> list[Model]:
    """Models as uncertain as the parameters of one: by the covariance of its fit, else by its intervals, each by itself.

    Parameters
    ----------
    model : Model
        With the values of its fit.
    count : int
        How many.
    seed : int
    held : collection of str
        Full names of what is drawn, but left as it is in the models.

    Returns
    -------
    list of Model
        Within the bounds of the parameters.
    """
    known = model.covariance or _of_intervals(model)
    items = [model.parameters[name] for name in known.names]
    mean, low, high = (np.array([getattr(item, what) for item in items]) for what in ("value", "low", "high"))
    rows = joint_draws(mean, known.matrix, low, high, count, freedom=known.freedom, seed=seed)
    return [model.with_values({n: float(x) for n, x in zip(known.names, row, strict=True) if n not in held}) for row in rows]


def _of_intervals(model: Model) -> Covariance:
    """Covariance of the parameters that are known by themselves, in their units: diagonal, normal."""
    known = {n: p.interval for n, p in model.parameters.items() if p.interval and p.interval < KNOWN_SHARE * (p.high - p.low)}
    return Covariance(tuple(known), np.diag([(half / NORMAL_95) ** 2 for half in known.values()]), math.inf)


def share_within_bounds(mean: Array, covariance: Array, low: Array, freedom: float) -> Array:
    """Half the 95 % interval of each parameter that its own lower bound and those of the others leave, over the one without bounds, (k,).

    Frictions at motor and carriage of which the sum alone is known are each no more than the sum.

    Parameters
    ----------
    mean, covariance, low, freedom
        As of :func:`joint_draws`.
    """
    if np.all(mean - NORMAL_95 * np.sqrt(np.diag(covariance)) >= low):
        return np.ones(len(mean))
    nowhere = np.full(len(mean), np.inf)

    def half(least: Array) -> Array:
        drawn = joint_draws(mean, covariance, least, nowhere, DRAWS, freedom=freedom, seed=0)
        return np.asarray(np.quantile(np.abs(drawn - mean), 0.95, axis=0))

    free = half(-nowhere)
    return np.minimum(np.divide(half(low), free, out=np.ones_like(free), where=free > 0.0), 1.0)


def joint_draws(mean: Array, covariance: Array, low: Array, high: Array, count: int, *, freedom: float = math.inf, seed: int) -> Array:
    """Sets of parameters as uncertain as a fit leaves them, (count, k): multivariate Student t within the bounds.

    x = mean + C^(1/2) n √(f/χ²_f),   n standard normal (k,), one χ² per draw.   One beyond a bound becomes the likeliest on it: two
    frictions of which only the sum is known keep their sum.

    Parameters
    ----------
    mean : ndarray (k,)
        Values of the fit.
    covariance : ndarray
        C, (k, k), of the fit, with f degrees of freedom; inf is normal.
    low, high : ndarray (k,)
    count : int
        Of the draws.
    freedom : float
        f.
    seed : int

    References
    ----------
    The intervals' own law; Gelman et al., Bayesian Data Analysis, A.1.
    """
    random = np.random.default_rng(seed)
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = random.standard_normal((count, len(mean)))
    wide = np.ones(count) if math.isinf(freedom) else np.sqrt(freedom / random.chisquare(freedom, count))
    drawn = mean + wide[:, None] * (normal @ root.T)
    return np.array([np.clip(_within(x, root @ root.T, low, high), low, high) for x in drawn])


def _within(x: Array, covariance: Array, low: Array, high: Array) -> Array:
    """The likeliest set with the values on their bounds that are beyond one, the farthest first; (k,)."""
    deviation, held = np.sqrt(np.maximum(np.diag(covariance), TINY)), np.zeros(len(x), dtype=np.bool_)
    for _ in range(len(x)):
        beyond = np.abs(x - np.clip(x, low, high)) / deviation
        beyond[held] = 0.0
        at = int(np.argmax(beyond))
        if beyond[at] == 0.0 or covariance[at, at] <= TINY:
            break
        x = x + covariance[:, at] / covariance[at, at] * (np.clip(x[at], low[at], high[at]) - x[at])
        covariance = covariance - np.outer(covariance[:, at], covariance[at]) / covariance[at, at]
        held[at] = True
    return x
