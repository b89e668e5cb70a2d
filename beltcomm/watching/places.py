"""Friction at each place of the travel, as moves tell it: a tight spot that only some of them cross is no change of the whole axis.

Of every place that the motor crosses a move tells by how much its friction is more than the model's, with everything that ages fitted
beside it (the score test of one column: friction of level 1 there).  As of all that is watched the first crossings are the base, so that
a friction that has hung on the place from the beginning is no news.  The place that is followed is the one where it has grown the most.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.residual.whitened import in_noise
from beltcomm.model.value import NORMAL_95
from beltcomm.watching.estimates import ERROR, POOL, MoveEstimate, Standing, State, pooled
from beltcomm.watching.limits import Limit

#: m: length of a place; at most so many along an axis.
WIDTH_M, MOST = 0.02, 100
#: Name of the friction at a place among the quantities.
PLACE = "friction_at_place"
#: Samples at a place, in all moves taken together, without which they tell nothing of it.
FEWEST_SAMPLES = 4
#: Crossings that are the base, crossings before anything is said, and deviations beyond which a growth is no chance, for the largest of all
#: places is looked at.
BASE, FEWEST_CROSSINGS, SURE = 8, 4, 6.0
#: Share of the axis's friction by which it changes at a place without anything being wrong.
USUAL = 0.2


def friction_at_places(fitted: Fitted, width_m: float) -> dict[int, MoveEstimate]:
    """Friction beside the model's at the motor by the number of its place, N m.

    Parameters
    ----------
    fitted : Fitted
        To moves whose places on the axis are known, what ages free.
    width_m : float, m
        Of a place.
    """
    ratio, pieces = fitted.model["transmission.ratio"], fitted.problem.pieces
    places = [_places(piece, ratio, width_m) for piece in pieces]
    counts: dict[int, int] = {}
    for piece, numbers in zip(pieces, places, strict=True):
        for number, samples in zip(*np.unique(numbers[piece.keep], return_counts=True), strict=True):
            counts[int(number)] = counts.get(int(number), 0) + int(samples)
    told = sorted(number for number, samples in counts.items() if samples >= FEWEST_SAMPLES)
    if not told or not len(fitted.residual):
        return {}
    columns = np.concatenate([_columns(piece, fitted, numbers, told) for piece, numbers in zip(pieces, places, strict=True)])
    near = fitted.local_quadratic
    lone = np.sum(near.beside(columns) ** 2, axis=0)  # what tells of each beside everything that ages
    every = near.best(columns=columns)
    rest = near.predicted_residual(columns @ every.amounts, every.step)  # friction another one everywhere
    wide = NORMAL_95 * max(1.0, float(np.sqrt(np.mean(rest**2))))
    found = {}
    for number, column, information in zip(told, columns.T, lone, strict=True):
        if information > 0.0:
            amount = float(near.best(columns=column[:, None]).amounts[0])
            found[number] = MoveEstimate(amount, wide / math.sqrt(information))
    return found


def _places(piece: Segment, ratio: float, width_m: float) -> np.ndarray:
    theta = piece.motion.theta[:: piece.motion.substeps]
    return np.floor(ratio * theta / width_m).astype(np.int64)


def _columns(piece: Segment, fitted: Fitted, numbers: np.ndarray, told: list[int]) -> Array:
    """Change of the whitened residual by friction of 1 N m at each place, (values, places)."""
    way = np.sign(piece.motion.omega[:: piece.motion.substeps])
    torque = np.stack([way * (numbers == number) for number in told], axis=1)
    return np.asarray(in_noise(piece, fitted.model, fitted.problem.full(fitted.x), torque))


class PlaceDrift:
    """Friction at each place over the last crossings.

    Parameters
    ----------
    friction : MoveEstimate
        Of the axis by the run, N m at the motor, that a growth is a share of.
    """

    def __init__(self, friction: MoveEstimate, limit: Limit | None, width_m: float) -> None:
        self._friction, self._limit, self._width_m = friction, limit, width_m
        self._last: dict[int, deque[MoveEstimate]] = {}
        self._first: dict[int, list[MoveEstimate]] = {}
        self._base: dict[int, MoveEstimate] = {}

    def begin_anew(self) -> None:
        """Begin a new base with the next move."""
        self._last, self._first, self._base = {}, {}, {}

    def add(self, told: Mapping[int, MoveEstimate]) -> Standing:
        """One more move, by the number of the place; how the place stands whose friction has grown most surely."""
        for number, one in told.items():
            if number not in self._base:
                first = self._first.setdefault(number, [])
                first.append(one)
                if len(first) >= BASE:
                    self._base[number] = MoveEstimate(*pooled(PLACE, first))
            else:
                self._last.setdefault(number, deque(maxlen=POOL)).append(one)
        return self.standing()

    def standing(self) -> Standing:
        """State of the place whose friction has grown most surely."""
        friction = self._friction
        low, high = self._limit.values(friction.value) if self._limit is not None else (None, None)
        why = self._limit.why if self._limit is not None else ""
        grown = []
        for number, last in self._last.items():
            if len(last) >= FEWEST_CROSSINGS:
                base, (value, interval) = self._base[number], pooled(PLACE, last)
                half = math.hypot(interval, base.interval)
                grown.append((NORMAL_95 * (value - base.value) / half, number, value - base.value, half))
        if not grown:
            return Standing(PLACE, friction, None, math.nan, math.nan, low, high, why, "few")
        alarmed = [one for one in grown if high is not None and friction.value + one[2] - one[3] > high and one[0] > SURE]
        news = [one for one in grown if one[0] > SURE and one[2] > USUAL * friction.value]
        _, number, more, half = max(alarmed or news or grown, key=lambda one: one[2] - one[3])
        state: State = "alarm" if alarmed else "changed" if news else "steady"
        place_m = (number + 0.5) * self._width_m
        own = MoveEstimate(friction.value, 0.0)
        least = max(USUAL, SURE / NORMAL_95 * float(np.median([one[3] for one in grown])) / friction.value)
        followed = _stretches([one[1] for one in grown], self._width_m)
        return Standing(PLACE, friction, own, friction.value + more, half, low, high, why, state, place_m, least, followed)


def _stretches(numbers: Iterable[int], width_m: float) -> tuple[tuple[float, float], ...]:
    """Neighbouring places as stretches of the travel, m."""
    found: list[tuple[int, int]] = []
    for number in sorted(numbers):
        if found and found[-1][1] == number:
            found[-1] = (found[-1][0], number + 1)
        else:
            found.append((number, number + 1))
    return tuple((low * width_m, high * width_m) for low, high in found)


@dataclass(frozen=True)
class Untold:
    """Quantities and stretches of which the moves so far tell nothing, so that a change would not be noticed.

    Attributes
    ----------
    keys : tuple of str
        Quantities.
    stretches_m : tuple of (float, float)
        Of the way of the moves, on which a tight spot would not be seen.
    """

    keys: tuple[str, ...] = ()
    stretches_m: tuple[tuple[float, float], ...] = ()


def untold_by(standings: Sequence[Standing], way_m: tuple[float, float] | None) -> Untold:
    """Quantities and stretches that standings lack.

    Parameters
    ----------
    standings : sequence of Standing
        Of the quantities.
    way_m : tuple of float, m, or None
        Ends of the way of all moves, those that told nothing among them; None where the place on the axis is not known.
    """
    keys = [one.key for one in standings if not math.isfinite(one.noticed_from) and one.key not in (PLACE, ERROR)]
    gaps = [gap for one in standings if one.key == PLACE and way_m is not None for gap in _between(one.followed_m, way_m)]
    return Untold(tuple(keys), tuple(gaps))


def _between(stretches: Sequence[tuple[float, float]], way_m: tuple[float, float]) -> list[tuple[float, float]]:
    """Parts of a way, m, that stretches leave, but for those no longer than a place."""
    ends = [way_m[0], *(end for pair in stretches for end in pair), way_m[1]]
    return [(low, high) for low, high in zip(ends[::2], ends[1::2], strict=True) if high - low > WIDTH_M]
