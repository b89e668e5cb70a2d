"""Uncertainty of a fit in words: limits of parameters at a bound, what is known badly."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.special import log_ndtr, ndtri_exp

from beltcomm.arrays import Array
from beltcomm.effects import effect_named
from beltcomm.model.value import Value

#: A parameter known worse than this share of its value is named; so are two whose estimates are correlated more than this.
BADLY_KNOWN_SHARE = 0.2
BADLY_APART = 0.95
#: Deviations by which the data pull a parameter beyond its bound from which this is a symptom and no chance.
BEYOND = 3.0


def _upper_limit(estimate: float, deviation: float) -> float:
    """Upper 95 % limit of a quantity that cannot be negative, seen as estimate ± deviation (normal, cut off at 0).

    Φ((estimate - limit)/deviation) = 0.05 Φ(estimate/deviation)
    """
    return float(estimate - deviation * ndtri_exp(math.log(0.05) + log_ndtr(estimate / deviation)))


def remark_on(name: str, item: Value, wanted: float, deviation: float) -> str:
    """Remark on one parameter; "" when it is known well.

    Parameters
    ----------
    name : str
        Full name of the parameter.
    item : Value
        The result, without interval at a bound.
    wanted : float
        Where the data alone, without bounds, would have it.
    deviation : float
        One standard deviation, 0 where the data do not see the parameter at all.
    """
    side = "lower" if item.value - item.low < item.high - item.value else "upper"
    if deviation == 0.0:
        return f"{name} stays at {item.value:g} {item.unit}: the residual does not depend on it"
    chance = item.low > 0.0 and (item.interval or 0.0) > abs(item.value)
    if chance or not max(deviation, item.interval or 0.0) < item.high - item.low:
        return (
            f"{name} is not identifiable from this data, its number is chance. Look at the recordings, or record an excitation with "
            "`beltcomm identify`"
        )
    if item.interval is None:
        beyond = abs(wanted - item.value) / deviation if (wanted < item.value) == (side == "lower") else 0.0
        if item.low < item.value < item.high or beyond <= BEYOND:
            return _none_seen(name, item, wanted, deviation)
        return f"{name} sits at its {side} bound {item.value:g} {item.unit}, and the data pull it {beyond:.0f} deviations beyond: " + (
            "something else takes its place, or the model lacks an effect" if item.low == 0.0 else "look at the bound"
        )
    if item.low == 0.0 and item.value < item.interval:
        return _none_seen(name, item, item.value, deviation)
    if item.interval > BADLY_KNOWN_SHARE * abs(item.value):
        share = 100.0 * item.interval / abs(item.value) if item.value else np.inf
        return f"{name} = {item.value:.3g} ± {item.interval:.2g} {item.unit}: uncertain (±{share:.0f} %)"
    return ""


def _none_seen(name: str, item: Value, estimate: float, deviation: float) -> str:
    if item.low != 0.0:
        return f"{name} sits at its bound {item.value:g} {item.unit}, which suits the data"
    title = effect_named(name.partition(".")[0]).title
    return f"no {title} seen (below {_upper_limit(estimate, deviation):.2g} {item.unit})"


def remarks_on_pairs(names: Sequence[str], items: Sequence[Value], correlation: Array) -> list[str]:
    """Pairs of parameters, one of them badly known, that the data tell apart badly, in words.

    Parameters
    ----------
    names : sequence of str
        Full names.
    items : sequence of Value
        With intervals.
    correlation : ndarray, (k, k)
        Of their estimates.
    """
    badly = [item.interval is not None and item.interval > BADLY_KNOWN_SHARE * abs(item.value) for item in items]
    return [
        f"{names[i]} and {names[j]} cannot be separated (correlation {correlation[i, j]:+.2f})"
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > BADLY_APART and (badly[i] or badly[j])
    ]
