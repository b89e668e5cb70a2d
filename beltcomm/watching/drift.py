"""Changes over the last moves together: sure or not, usual or not, within its limit or not.

Production's moves are others than the run's records, and no law is quite the machine's: what a model's parameter is by them may be beside
what it was by those, with nothing changed.  So the first :data:`BASE` moves are the base that a change is held against, and limits are
shares of it.  Until there is one the run's values are held against, and moves in alarm make none: an axis that was bad from the first
move on stays in alarm.

Of the last :data:`POOL` moves the mean with weights 1/interval², whose interval is the moves' own or, where they scatter more than they
know of themselves, their scatter (Student).  Of the error over the noise it is the median: a knock against the axis is one move.

A change is *noticed* when it is surer than :data:`SURE` and more than the axis changes by itself; it is an *alarm* when the limit is
passed by more than the interval.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from beltcomm.identify.course import NORMAL
from beltcomm.watching.judge import ERROR, JudgedMove, MoveEstimate
from beltcomm.watching.limits import UNKNOWN, USUAL, Limit

State = Literal["few", "steady", "changed", "alarm"]

#: Moves that are taken together, moves before anything is said, and moves of the base.
POOL, FEWEST, BASE = 10, 5, 20
#: Deviations beyond which a change is no chance, in a thousand moves and with some quantities looked at: set on one set of simulated
#: axes, told on another (docs/watch.md).
SURE = 4.5


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


class AxisDrift:
    """The last moves of an axis, and how each quantity stands by them.

    Parameters
    ----------
    reference : dict of str to MoveEstimate
        By the run; the error over the noise among them, under :data:`~beltcomm.watching.judge.ERROR`.
    limits : dict of str to Limit
        By key.
    """

    def __init__(self, reference: Mapping[str, MoveEstimate], limits: Mapping[str, Limit]) -> None:
        self._reference, self._limits = dict(reference), dict(limits)
        self._last: dict[str, deque[MoveEstimate]] = {}
        self._first: dict[str, list[MoveEstimate]] = {}
        self._base: dict[str, MoveEstimate] = {}
        self.begin_anew()

    def begin_anew(self) -> None:
        """Begin a new base with the next move."""
        self._last = {key: deque(maxlen=POOL) for key in self._reference}
        self._first, self._base = {key: [] for key in self._reference}, {}

    def add(self, move: JudgedMove) -> list[Standing]:
        """One more move; how all stand now."""
        return self.add_told({**move.quantities, ERROR: MoveEstimate(move.ratio, move.ratio_interval)})

    def add_told(self, told: Mapping[str, MoveEstimate]) -> list[Standing]:
        """Add what a move told; how all stand now."""
        for key, last in self._last.items():
            if key not in told:
                continue
            last.append(told[key])
            if key not in self._base:
                self._first[key].append(told[key])
                if self._standing(key).state == "alarm":
                    self._first[key].clear()
                elif len(self._first[key]) >= BASE:
                    self._base[key] = MoveEstimate(*pooled(key, self._first[key]))
        return [self._standing(key) for key in self._last]

    def _standing(self, key: str) -> Standing:
        reference, base, last = self._reference[key], self._base.get(key), self._last[key]
        against = base or reference
        limit = self._limits.get(key)
        low, high = limit.values(against.value) if limit is not None else (None, None)
        why = limit.why if limit is not None else ""
        if len(last) < FEWEST:
            return Standing(key, reference, base, math.nan, math.nan, low, high, why, "few")
        value, interval = pooled(key, last)
        deviation = math.hypot(interval, against.interval) / NORMAL
        off = value - against.value
        if key == ERROR:
            off = max(off, 0.0)  # less than the noise is no news
        sure, usual = abs(off) > SURE * deviation, abs(off) <= USUAL.get(key, UNKNOWN) * abs(against.value)
        beyond = (low is not None and value + interval < low) or (high is not None and value - interval > high)
        state: State = "alarm" if beyond and sure else "changed" if sure and not usual and base is not None else "steady"
        return Standing(key, reference, base, value, interval, low, high, why, state)


def pooled(key: str, told: Sequence[MoveEstimate]) -> tuple[float, float]:
    """A quantity over moves, and its interval."""
    if len(told) == 1:
        return told[0].value, told[0].interval
    return _median(told) if key == ERROR else _mean(told)


def _mean(last: Sequence[MoveEstimate]) -> tuple[float, float]:
    values, halves = np.array([one.value for one in last]), np.array([max(one.interval, 1e-300) for one in last])
    weights = (NORMAL / halves) ** 2
    value = float(np.sum(weights * values) / np.sum(weights))
    square = float(np.sum(weights * (values - value) ** 2)) / (len(values) - 1)
    wide = max(NORMAL, float(stdtrit(len(values) - 1, 0.975)) * math.sqrt(square))
    return value, wide / math.sqrt(float(np.sum(weights)))


def _median(last: Sequence[MoveEstimate]) -> tuple[float, float]:
    """Median; its interval by the moves' own or by their scatter, √(π/2) wider than that of a mean."""
    values = np.array([one.value for one in last])
    middle = float(np.median(values))
    own = float(np.median([one.interval for one in last]))
    scatter = NORMAL * 1.4826 * float(np.median(np.abs(values - middle)))
    return middle, math.sqrt(0.5 * math.pi / len(values)) * max(own, scatter)
