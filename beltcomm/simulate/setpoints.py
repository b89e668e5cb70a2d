"""Setpoints that come more seldom than the drive's loop runs: what the loop makes of them.

A drive in a cyclic position or velocity mode goes from setpoint to setpoint on a straight line (60C2h, interpolation time period) and
reaches each in the last loop before the next one comes.  So its reference is the host's, later by

    lag = T_setpoint - T_loop,

and none where the two periods are one.  A torque that comes along (60B2h) is not interpolated: it acts at once, until the next comes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array

#: Of a loop's period: rounding of a time on its grid.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class SetpointGrid:
    """``count`` setpoints, one every ``period_s``, and the loop of the drive, one run every ``loop_s``; s."""

    period_s: float
    loop_s: float
    count: int

    @property
    def lag_s(self) -> float:
        """By which the loop's reference is later than the host's, s."""
        return max(self.period_s - self.loop_s, 0.0)

    @property
    def _same(self) -> bool:
        return abs(self.period_s - self.loop_s) <= _ROUNDING * self.loop_s

    def _sent_s(self) -> Array:
        return np.asarray(self.period_s * np.arange(self.count), dtype=np.float64)

    def _loops_s(self) -> Array:
        last = int(np.ceil((self.count - 1) * self.period_s / self.loop_s - _ROUNDING))
        return np.asarray(self.loop_s * np.arange(last + 1), dtype=np.float64)

    def on_loop(self, values: Array) -> Array:
        """Setpoints (count,) as the loop has them, one entry per run of it."""
        return values if self._same else np.asarray(np.interp(self._loops_s() - self.lag_s, self._sent_s(), values))

    def zero_order_hold(self, values: Array) -> Array:
        """Values (count,) that act from their setpoint to the next, one entry per run of the loop."""
        if self._same:
            return values
        latest = np.floor(self._loops_s() / self.period_s + _ROUNDING).astype(int)
        return np.asarray(values[np.minimum(latest, self.count - 1)])

    def in_loop(self, values: Array) -> Array:
        """Setpoints (count,) as the loop has them when the drive samples, (count,)."""
        return values if self._same else np.asarray(np.interp(self._sent_s() - self.lag_s, self._sent_s(), values))

    def at_samples(self, values: Array) -> Array:
        """Values that run with the loop, at the samples that go with the setpoints, (count,)."""
        return values if self._same else np.asarray(np.interp(self._sent_s(), self._loops_s(), values))

    def latest(self, values: Array) -> Array:
        """Latest value that the loop decided when the drive samples, (count,)."""
        if self._same:
            return values
        return np.asarray(values[np.floor(self._sent_s() / self.loop_s + _ROUNDING).astype(int)])

    def along(self, values: Array) -> Array:
        """A torque (count,) that fits the host's reference, as it must be sent to fit the loop's.

        Held for a period, it stands for the middle of that, where it came with each run of the loop for the middle of one; the reference is
        late by ``lag_s``: half of this is left.
        """
        return values if self._same else np.asarray(np.interp(self._sent_s() - 0.5 * self.lag_s, self._sent_s(), values))
