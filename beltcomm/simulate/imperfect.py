"""Imperfections between a drive's numbers and the axis: torque that acts late or changes inside the period, an angle that errs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np

from beltcomm.arrays import Array, row_means
from beltcomm.effects import Effect
from beltcomm.model import Model

#: A lag is forgotten after this many time constants: e⁻¹⁵ = 3e-7.
_FORGOTTEN = 15.0
#: Rounds in which the angle shown is found: an error of 0.4 rad per radian, as the lines of an encoder may have, needs four.
ROUNDS = 6
#: Least rise of the true angle over the one shown that a round counts on; one that falls has no angle of its own.
LEAST_STEEP = 0.25


def late_torque(model: Model, cells: Array, h: float) -> Array:
    """Torque that acts, averaged over cells of ``h`` seconds, from the reported one in the same cells; (n,) -> (n,), N m.

    Parameters
    ----------
    model : Model
        With any effects.
    cells : ndarray (n,), N m, motor shaft
        Reported torque.
    h : float, s
        Length of a cell.
    """
    for law, values in _delays(model):
        cells = law(cells, h, *values)
    return cells


def is_late(model: Model) -> bool:
    """True if any effect of the model stands between reported and acting torque.

    Parameters
    ----------
    model : Model
        With any effects.
    """
    return bool(_delays(model))


def memory_s(model: Model) -> float:
    """Time after which the torque path has forgotten a torque, s.

    Parameters
    ----------
    model : Model
        With any effects.
    """
    return sum(_FORGOTTEN * abs(value) for _, values in _delays(model) for value in values)


def angle_sensor(model: Model) -> Callable[[float], float]:
    """The angle a sensor shows for a true one, rad; the laws give the error at the angle shown, so it is found by Newton's iteration.

    Parameters
    ----------
    model : Model
        With any effects.

    Returns
    -------
    callable
        From the true angle to the one shown, rad, motor shaft.
    """
    laws = [
        (effect.law, effect.slope, _values(model, effect))
        for effect in model.effect_list()
        if effect.slot == "sensor" and effect.law is not None and effect.slope is not None
    ]

    def measured(theta: float) -> float:
        shown = theta
        for _ in range(ROUNDS):
            error = sum(law(shown, *values) for law, _, values in laws)
            steep = sum(cast("float", slope(shown, *values)) for _, slope, values in laws)
            shown -= (shown + error - theta) / max(LEAST_STEEP, 1.0 + steep)
        return shown

    return measured if laws else _as_it_is


def _as_it_is(theta: float) -> float:
    return theta


def _delays(model: Model) -> list[tuple[Callable[..., Array], list[float]]]:
    chosen = [effect for effect in model.effect_list() if effect.slot == "torque_delay"]
    return [(cast("Callable[..., Array]", effect.law), _values(model, effect)) for effect in chosen]


def _values(model: Model, effect: Effect) -> list[float]:
    return [model[name] for name in effect.full_names()]


#: Cells of a sampling period in which a torque is given; most numbers of fine steps a sample divide it.
CELLS = 32


@dataclass(frozen=True)
class Intersample:
    """Torque less its mean over the period, in each of :data:`CELLS` cells, (n, CELLS), N m at the motor; the rows' means are 0."""

    above: Array

    def cells(self, torque: Array, per_sample: int) -> Array:
        """Mean over each of so many cells of a period, N m, (n per_sample,), of a torque given by its mean over each period, (n,)."""
        if CELLS % per_sample == 0:
            above = row_means(self.above.reshape(len(torque), per_sample, -1)) if per_sample < CELLS else self.above
        else:  # fine steps for a coupling follow its frequency
            edges = np.linspace(0.0, CELLS, per_sample + 1)
            low = np.minimum(edges.astype(np.intp), CELLS - 1)
            integral = np.concatenate((np.zeros((len(torque), 1)), np.cumsum(self.above, axis=1)), axis=1)
            above = np.diff(integral[:, low] + (edges - low) * self.above[:, low], axis=1) * (per_sample / CELLS)
        return np.asarray((torque[:, None] + above).reshape(-1))

    def triangular(self) -> Array:
        """By how much the mean with the triangular weight around a sample is higher than of an even spread, (n,), N m, ends 0.

        ∫_0^1 u x du of the period before and ∫_0^1 (1-u) x du of that behind a sample, x the spread around its mean.
        """
        rising = self.above @ ((np.arange(CELLS) + 0.5) / CELLS**2)
        more = np.zeros(len(self.above))
        more[1:-1] = rising[:-2] - rising[1:-1]
        return more
