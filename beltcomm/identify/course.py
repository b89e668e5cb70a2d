"""The course of a quantity over many runs: a line through values with intervals, and when it reaches a limit."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from beltcomm.arrays import Array
from beltcomm.errors import DataError
from beltcomm.model.value import NORMAL_95

#: Runs from which on their scatter can be told from a course.
FEWEST = 3


@dataclass(frozen=True)
class LinearTrend:
    """y = level + slope (t - middle_s).   half widths : 95 %, of level and slope, which are independent of each other.

    Attributes
    ----------
    sure_interval : float
        Of the slope, so wide that of all quantities looked at together hardly one seems to drift by chance.
    scatter : float
        rms of the values around the line over what their intervals let expect; 1 where they scatter as these say, nan where no interval is
        known.
    """

    middle_s: float
    level: float
    slope: float
    level_interval: float
    slope_interval: float
    sure_interval: float
    scatter: float

    @property
    def drifts(self) -> bool:
        """True if the slope differs from none, however many others were looked at."""
        return abs(self.slope) > self.sure_interval

    def at(self, t_s: Array) -> tuple[Array, Array]:
        """The line, and half the width of its 95 % band, (n,) each, at times on the clock of the course."""
        u = t_s - self.middle_s
        return self.level + self.slope * u, np.hypot(self.level_interval, self.slope_interval * u)

    def reaches(self, limit: float) -> tuple[float, float, float] | None:
        """Time at which the line, and the edges of its band, cross a limit.

        (level + slope u - limit)² = level_interval² + slope_interval² u²   with u = t - middle: both roots are finite while the slope
        differs from none.

        Parameters
        ----------
        limit : float
            In the unit of the level.

        Returns
        -------
        tuple of float, or None
            Earliest, by the line, latest, s; None without a drift.

        References
        ----------
        Fieller, J. R. Stat. Soc. B 16 (1954) 175.
        """
        if not self.drifts:
            return None
        away = self.level - limit
        square = self.slope**2 - self.slope_interval**2
        half = self.slope * away
        inner = math.sqrt(max(half**2 - square * (away**2 - self.level_interval**2), 0.0))
        first, last = sorted(((-half - inner) / square, (-half + inner) / square))
        return self.middle_s + first, self.middle_s - away / self.slope, self.middle_s + last


def course_of(t_s: Array, values: Array, intervals: Array, looked_at: int = 1) -> LinearTrend:
    """A line by weighted least squares.   t_s, values (n,); intervals (n,): half widths, 95 %, nan where they are not known.

    Where the values scatter more than their intervals say, runs differ by more than one run knows of itself: then their own scatter makes
    the intervals, by Student's t with n - 2 degrees of freedom.

    Parameters
    ----------
    t_s : ndarray (n,), s
        Dates of the runs.
    values : ndarray (n,)
        Of any unit.
    intervals : ndarray (n,)
        Half widths in that unit.
    looked_at : int
        Quantities of which this is one; a drift is sure with 1 - 0.05/looked_at (Bonferroni).

    Raises
    ------
    DataError
        For fewer than three runs or for one and the same time.
    """
    if len(values) < FEWEST or float(np.ptp(t_s)) <= 0.0:
        raise DataError(f"a course needs {FEWEST} runs at different times; there are {len(values)}")
    known = bool(np.all(np.isfinite(intervals)) and np.all(intervals > 0.0))
    weights = (NORMAL_95 / intervals) ** 2 if known else np.ones(len(values))
    middle = float(np.sum(weights * t_s) / np.sum(weights))
    u = t_s - middle
    spread = float(np.sum(weights * u**2))
    level, slope = float(np.sum(weights * values) / np.sum(weights)), float(np.sum(weights * u * values) / spread)
    freedom = len(values) - 2
    square = float(np.sum(weights * (values - level - slope * u) ** 2)) / freedom

    def wide(level_of_chance: float) -> float:
        own, by_scatter = ndtri(1.0 - 0.5 * level_of_chance), stdtrit(freedom, 1.0 - 0.5 * level_of_chance) * math.sqrt(square)
        return float(max(own, by_scatter) if known else by_scatter)

    level_interval, slope_interval = wide(0.05) / math.sqrt(float(np.sum(weights))), wide(0.05) / math.sqrt(spread)
    sure = wide(0.05 / looked_at) / math.sqrt(spread)
    return LinearTrend(middle, level, slope, level_interval, slope_interval, sure, math.sqrt(square) if known else math.nan)
