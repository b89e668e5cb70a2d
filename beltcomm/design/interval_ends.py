"""Models at the ends of the 95 % intervals of what a loop moves: a controller is designed in their middle and must hold there, too.

An inertia or a stiffness goes to an end of its interval, and with it what the fit cannot tell apart from it:

    δ_k = Σ_kn/Σ_nn δ_n

Σ : covariance of the fit.   The way ends where the parameter meets its bound, and the others stay at theirs: no mass is negative, however
wide its interval.
"""

from __future__ import annotations

from dataclasses import dataclass

from beltcomm.model import BELT_STIFFNESSES, Model


@dataclass(frozen=True)
class IntervalEnd:
    """A model at one end of the 95 % interval of one of its parameters.

    Attributes
    ----------
    name : str
        Full name of the parameter.
    model : Model
        With the parameter there.
    """

    name: str
    model: Model


def interval_ends(model: Model) -> list[IntervalEnd]:
    """Both ends of every inertia and spring of a model that is an estimate; none where nothing was estimated.

    Parameters
    ----------
    model : Model
        As a fit left it, with intervals and covariance.

    Returns
    -------
    list of IntervalEnd
        The lower end first, by parameter.
    """
    names = [name for name in (*(name for name, _ in model.bodies()), *BELT_STIFFNESSES) if name in model.parameters]
    estimated = [name for name in names if model.parameters[name].interval_95 is not None]
    return [IntervalEnd(name, _moved(model, name, sign, estimated)) for name in estimated for sign in (-1.0, 1.0)]


def _moved(model: Model, name: str, sign: float, along: list[str]) -> Model:
    """The model with a parameter at an end of its interval, and those along with it that the fit ties to it."""
    half, ties = model.parameters[name].interval or 0.0, {name: 1.0}
    if model.covariance is not None and name in model.covariance.names:
        matrix, at = model.covariance.of(along), along.index(name)
        if matrix[at, at] > 0.0:
            ties |= {other: float(matrix[k, at] / matrix[at, at]) for k, other in enumerate(along)}
    way = _inside(model, name, sign * half) - model[name]
    return model.with_values({other: _inside(model, other, tie * way) for other, tie in ties.items()})


def _inside(model: Model, name: str, way: float) -> float:
    """Value so far away from that of the model, or its bound on that way."""
    item = model.parameters[name]
    return min(max(item.value + way, item.low), item.high)
