"""A quantity of an axis by one move, by several together, and how it stands."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import robust_deviation
from beltcomm.model.value import NORMAL_95

State = Literal["few", "steady", "changed", "alarm"]

#: Moves that are taken together, and moves before anything is said.
POOL, FEWEST = 10, 5
#: Moves from which on their scatter is told; share of the steps from move to move that are smaller ones, and what their mean square is of
#: that of all by chance.
SCATTERING, SMALLER, SMALLER_MEAN = 20, 0.9, 0.6226
#: Name of the error over the noise among the quantities.
ERROR = "model_error"


@dataclass(frozen=True)
class MoveEstimate:
    """value, interval : SI, 95 %, of one quantity by one move."""

    value: float
    interval: float


@dataclass(frozen=True)
class Standing:
    """A quantity over the last moves.

    Attributes
    ----------
    reference : MoveEstimate
        Of the run.
    base : MoveEstimate or None
        Of the first moves; None while they are driven.
    value, interval : float
        SI, 95 %; nan before enough moves have told it.
    low, high : float or None
        Limits, SI.
    place_m : float or None
        Of the carriage, of a quantity that is one of a place.
    noticed_from : float
        Share of the base from which on a change would be noticed; nan where these moves tell nothing of it.
    followed_m : tuple of (float, float)
        Stretches of the travel that are followed, of a quantity that is one of a place.
    """

    key: str
    reference: MoveEstimate
    base: MoveEstimate | None
    value: float
    interval: float
    low: float | None
    high: float | None
    why: str
    state: State
    place_m: float | None = None
    noticed_from: float = math.nan
    followed_m: tuple[tuple[float, float], ...] = ()

    @property
    def against(self) -> MoveEstimate:
        """Estimate that a change is held against: the base, the run before there is one."""
        return self.base or self.reference

    @property
    def change(self) -> float:
        """Share of the base."""
        return self.value / self.against.value - 1.0

    @property
    def change_interval(self) -> float:
        """Its interval, that of the base in it."""
        return math.hypot(self.interval, self.against.interval * self.value / self.against.value) / abs(self.against.value)


def pooled(key: str, told: Sequence[MoveEstimate], excess: float = 1.0) -> tuple[float, float]:
    """A quantity over moves, and its interval.

    Parameters
    ----------
    key : str
        Of the quantity.
    told : sequence of MoveEstimate
        By each move.
    excess : float
        Times as wide as the moves say of themselves, at least.
    """
    if len(told) == 1:
        return told[0].value, excess * told[0].interval
    return _median(told, excess) if key == ERROR else _mean(told, excess)


def excess_of(key: str, told: Sequence[MoveEstimate]) -> float:
    """How many times further than their intervals say moves are off the next one, at least 1; what grows steadily does not show in it.

    By the root mean square of the steps; of the error by that of the smaller ones, for a knock is two of them; 1 for few moves.

    Parameters
    ----------
    key : str
        Of the quantity.
    told : sequence of MoveEstimate
        By each move.
    """
    if len(told) < SCATTERING:
        return 1.0
    values, halves = np.array([one.value for one in told]), np.array([max(one.interval, 1e-300) for one in told])
    steps = np.sort(NORMAL_95**2 * np.diff(values) ** 2 / (halves[1:] ** 2 + halves[:-1] ** 2))
    square = float(np.mean(steps[: math.floor(SMALLER * len(steps))])) / SMALLER_MEAN if key == ERROR else float(np.mean(steps))
    return max(1.0, math.sqrt(square))


def _mean(last: Sequence[MoveEstimate], excess: float) -> tuple[float, float]:
    values, halves = np.array([one.value for one in last]), np.array([max(one.interval, 1e-300) for one in last])
    weights = (NORMAL_95 / halves) ** 2
    value = float(np.sum(weights * values) / np.sum(weights))
    square = float(np.sum(weights * (values - value) ** 2)) / (len(values) - 1)
    wide = max(NORMAL_95 * excess, float(stdtrit(len(values) - 1, 0.975)) * math.sqrt(square))
    return value, wide / math.sqrt(float(np.sum(weights)))


def _median(last: Sequence[MoveEstimate], excess: float) -> tuple[float, float]:
    """Median; its interval by the moves' own or by their scatter, √(π/2) wider than that of a mean."""
    values = np.array([one.value for one in last])
    middle = float(np.median(values))
    own = float(np.median([one.interval for one in last]))
    scatter = NORMAL_95 * robust_deviation(values - middle)
    return middle, math.sqrt(0.5 * math.pi / len(values)) * max(excess * own, scatter)
