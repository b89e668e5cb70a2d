"""Changes over the last moves together: sure or not, usual or not, within its limit or not.

Production's moves are others than the run's records, and no law is quite the machine's: what a model's parameter is by them may be beside
what it was by those, with nothing changed.  So the first :data:`BASE` moves are the base that a change is held against, and limits are
shares of it.  Until there is one the run's values are held against, and moves in alarm make none: an axis that was bad from the first
move on stays in alarm.

Of the last :data:`POOL` moves the mean with weights 1/interval², whose interval is the moves' own or, where they scatter more than they
know of themselves, their scatter (Student); ten moves may scatter little by chance, so that of the last hundred counts, too, by the steps
from one to the next.  Of the error over the noise it is the median: a knock against the axis is one move.

A change is *noticed* when it is surer than :data:`SURE` and more than the axis changes by itself; it is an *alarm* when the limit is
passed by more than the interval.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping

from beltcomm.model.value import NORMAL_95
from beltcomm.watching.estimates import ERROR, FEWEST, POOL, MoveEstimate, Standing, State, excess_of, pooled
from beltcomm.watching.judge import JudgedMove
from beltcomm.watching.limits import UNKNOWN, USUAL, Limit
from beltcomm.watching.places import PLACE, PlaceDrift

#: Moves of the base, and moves that tell how far they scatter.
BASE, LATELY = 20, 100
#: Deviations beyond which a change is no chance, in a thousand moves and with some quantities looked at: set on one set of simulated
#: axes, told on another (docs/watch.md).
SURE = 4.5


class AxisDrift:
    """The last moves of an axis, and how each quantity stands by them.

    Parameters
    ----------
    reference : dict of str to MoveEstimate
        By the run; the error over the noise among them, under :data:`~beltcomm.watching.judge.ERROR`.
    limits : dict of str to Limit
        By key.
    width_m : float or None
        Length of a place of the travel at which friction is followed; None where places are not known.
    """

    def __init__(self, reference: Mapping[str, MoveEstimate], limits: Mapping[str, Limit], width_m: float | None = None) -> None:
        self._reference, self._limits = dict(reference), dict(limits)
        self._last: dict[str, deque[MoveEstimate]] = {}
        self._first: dict[str, list[MoveEstimate]] = {}
        self._base: dict[str, MoveEstimate] = {}
        friction = reference.get("coulomb_total")
        follows = width_m is not None and friction is not None
        self._places = PlaceDrift(friction, limits.get(PLACE), width_m) if follows else None  # type: ignore[arg-type]
        self.begin_anew()

    @property
    def keys(self) -> tuple[str, ...]:
        """Of all that is followed."""
        return (*self._reference, *((PLACE,) if self._places is not None else ()))

    def begin_anew(self) -> None:
        """Begin a new base with the next move."""
        self._last = {key: deque(maxlen=POOL) for key in self._reference}
        self._first, self._base = {key: [] for key in self._reference}, {}
        self._lately: dict[str, deque[MoveEstimate]] = {key: deque(maxlen=LATELY) for key in self._reference}
        if self._places is not None:
            self._places.begin_anew()

    def add(self, move: JudgedMove) -> list[Standing]:
        """One more move; how all stand now."""
        return self.add_told({**move.quantities, ERROR: MoveEstimate(move.ratio, move.ratio_interval)}, move.places)

    def add_told(self, told: Mapping[str, MoveEstimate], places: Mapping[int, MoveEstimate] | None = None) -> list[Standing]:
        """Add what a move told, of the axis and of places of its travel; how all stand now.

        Parameters
        ----------
        told : mapping of str to MoveEstimate
            By the keys of the quantities that are watched.
        places : mapping of int to MoveEstimate or None
            By the number of the place; None where none are watched.
        """
        for key, last in self._last.items():
            if key not in told:
                continue
            last.append(told[key])
            self._lately[key].append(told[key])
            if key not in self._base:
                self._first[key].append(told[key])
                if self._standing(key).state == "alarm":
                    self._first[key].clear()
                elif len(self._first[key]) >= BASE:
                    self._base[key] = MoveEstimate(*pooled(key, self._first[key], excess_of(key, self._lately[key])))
        return [*(self._standing(key) for key in self._last), *([] if self._places is None else [self._places.add(places or {})])]

    def _standing(self, key: str) -> Standing:
        reference, base, last = self._reference[key], self._base.get(key), self._last[key]
        against = base or reference
        limit = self._limits.get(key)
        low, high = limit.values(against.value) if limit is not None else (None, None)
        why = limit.why if limit is not None else ""
        if len(last) < FEWEST:
            return Standing(key, reference, base, math.nan, math.nan, low, high, why, "few")
        value, interval = pooled(key, last, excess_of(key, self._lately[key]))
        deviation = math.hypot(interval, against.interval) / NORMAL_95
        off = value - against.value
        if key == ERROR:
            off = max(off, 0.0)  # less than the noise is no news
        least = max(SURE * deviation / abs(against.value), USUAL.get(key, UNKNOWN))
        sure, news = abs(off) > SURE * deviation, abs(off) > least * abs(against.value)
        beyond = (low is not None and value + interval < low) or (high is not None and value - interval > high)
        state: State = "alarm" if beyond and sure else "changed" if news and base is not None else "steady"
        return Standing(key, reference, base, value, interval, low, high, why, state, noticed_from=least)
