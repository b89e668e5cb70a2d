"""Imperfections between a drive's numbers and the axis: torque that acts late or changes inside the period, an angle that errs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np

from beltcomm.arrays import Array
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
#: Periods whose spreads are tried as shapes of all, and what they may miss of the largest.
TRIED, MISSED = 64, 1e-12


@dataclass(frozen=True)
class Intersample:
    """Torque less its mean over the period, in each of :data:`CELLS` cells, as amounts of a few shapes:  above = amounts shapes.

    A linear filter behind a held torque has as many shapes as states and levels of its command in a period.

    Attributes
    ----------
    amounts : ndarray (n, k), N m at the motor
    shapes : ndarray (k, CELLS)
        Of mean 0 each.
    """

    amounts: Array
    shapes: Array

    @classmethod
    def of(cls, above: Array) -> Intersample:
        """The spread in its cells, by as few shapes as give it but for rounding.

        Parameters
        ----------
        above : ndarray (n, CELLS), N m
            At the motor; the rows' means are 0.
        """
        if not len(above) or not np.isfinite(above).all():
            return cls(above, np.eye(CELLS))
        rows = above[np.linspace(0, len(above) - 1, min(len(above), TRIED)).astype(np.intp)]
        _, sizes, shapes = np.linalg.svd(rows, full_matrices=False)
        shapes = shapes[: int(np.sum(sizes > MISSED * sizes[0]))]
        if 2 * len(shapes) <= CELLS:
            amounts = above @ shapes.T
            if np.abs(amounts @ shapes - above).max() <= MISSED * np.abs(above).max():
                return cls(amounts, shapes)
        return cls(above, np.eye(CELLS))

    @property
    def above(self) -> Array:
        """The spread in its cells, (n, CELLS), N m at the motor."""
        return np.asarray(self.amounts @ self.shapes)

    def cells(self, torque: Array, per_sample: int) -> Array:
        """Mean over each of so many cells of a period.

        Parameters
        ----------
        torque : ndarray (n,), N m
            Mean over each period.
        per_sample : int
            Cells of a period.

        Returns
        -------
        ndarray, N m
            (n per_sample,).
        """
        edges = np.linspace(0.0, CELLS, per_sample + 1)  # fine steps for a coupling follow its frequency, and may divide cells
        low = np.minimum(edges.astype(np.intp), CELLS - 1)
        integral = np.concatenate((np.zeros((len(self.shapes), 1)), np.cumsum(self.shapes, axis=1)), axis=1)
        means = np.diff(integral[:, low] + (edges - low) * self.shapes[:, low], axis=1) * (per_sample / CELLS)
        return np.asarray((torque[:, None] + self.amounts @ means).reshape(-1))

    def triangular(self) -> Array:
        """By how much the mean with the triangular weight around a sample is higher than of an even spread, (n,), N m, ends 0.

        ∫_0^1 u x du of the period before and ∫_0^1 (1-u) x du of that behind a sample, x the spread around its mean.
        """
        rising = self.amounts @ (self.shapes @ ((np.arange(CELLS) + 0.5) / CELLS**2))
        more = np.zeros(len(rising))
        more[1:-1] = rising[:-2] - rising[1:-1]
        return more
