"""Position and speed of a drive against each other: two objects with factors of their own, of one motion."""

from __future__ import annotations

from typing import Final

from beltcomm.errors import DriveError

#: Position's scale over speed's: outside these the factors are wrong.
_LEAST, _MOST = 0.6, 1.6
#: rad of the motor and s: enough to judge by; a speed filter of some ms has forgotten how the motion began.   rad/s: slower, the noise of
#: a count is part of the speed.
_WAY_RAD: Final = 4.0
_TIME_S: Final = 0.1
_SLOW_RAD_S: Final = 2.0
#: s: both are smoothed with this lag first.  What a drive filters its speed with is not known; it matters near the sampling rate, where a
#: belt may ring, and not for the motion below.
_SMOOTH_S: Final = 0.008


class Odometer:
    """The scale between the smoothed rates of position and the reported speeds,  k = Σ φ' v Δt / Σ v² Δt,  over every 4 rad of way.

    A speed that the drive has filtered with a first-order lag F leaves k as it is: Re F = |F|² at every frequency.
    position_rad, speed_rad_s : per raw unit.   Call it with the raw change of position, raw speed and s since the sample before.
    """

    def __init__(self, position_rad: float, speed_rad_s: float) -> None:
        self._position_rad, self._speed_rad_s = abs(position_rad), abs(speed_rad_s)
        self._rate = self._speed = 0.0
        self._way = self._time_s = self._both = self._square = 0.0

    def __call__(self, travel: int, speed: int, elapsed_s: float) -> None:
        """One sample.   Raises DriveError when position and speed cannot be of one motion."""
        if elapsed_s <= 0.0:
            return
        share = elapsed_s / (_SMOOTH_S + elapsed_s)
        self._rate = rate = self._rate + share * (travel * self._position_rad / elapsed_s - self._rate)
        self._speed = v = self._speed + share * (speed * self._speed_rad_s - self._speed)
        if -_SLOW_RAD_S < v < _SLOW_RAD_S:
            return
        self._way += abs(rate) * elapsed_s
        self._time_s += elapsed_s
        self._both += rate * v * elapsed_s
        self._square += v * v * elapsed_s
        if self._way < _WAY_RAD or self._time_s < _TIME_S:
            return
        scale = self._both / self._square
        if not _LEAST < scale < _MOST:
            raise DriveError(
                f"the drive's position changes {scale:.2f} times as fast as its speed says: one of its factors is wrong, or its encoder "
                "jumped; the axis was stopped; check 6093h and 6094h, or 608Fh, 6091h, 6092h and 60A9h with the maker's tool, and the "
                "encoder's cable"
            )
        self._way = self._time_s = self._both = self._square = 0.0
