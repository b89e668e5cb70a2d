"""Position and speed of a drive against each other: two objects with factors of their own, of one motion."""

from __future__ import annotations

import math
from typing import Final

from beltcomm.errors import DriveError
from beltcomm_adapters.units import RPM

#: Position's scale over speed's: outside these the factors are wrong.
_LEAST, _MOST = 0.6, 1.6
#: rad of the motor and s: enough to judge by; a speed filter of some ms has forgotten how the motion began.   rad/s: slower, the noise of
#: a count is part of the speed.
_WAY_RAD: Final = 4.0
#: Factor that is seen within a quarter of that way: an excitation of a stiff axis goes no further.
_GROSS: Final = 3.0
_TIME_S: Final = 0.1
_SLOW_RAD_S: Final = 2.0
#: s: both are smoothed with this lag first, twice.  What a drive filters its speed with is not known; it matters near the sampling rate,
#: where a belt may ring, and not for the motion below.
_SMOOTH_S: Final = 0.008
#: A turn has more position units than this.
_FEWEST_UNITS: Final = 100.0
#: Position units of a turn that makers use, within this factor of what was measured.
_ROUND: Final = 1.06
#: rad of the motor and samples after which a unit of speed that nobody tells is known; position units of a change that is a motion, once
#: smoothed.
_LEARNT_RAD: Final = 0.01
_LEARNT_SAMPLES: Final = 12
_CLEAR_STEPS: Final = 0.5
#: Factor by which a unit may be off what was measured; s between two samples of one record at most.
_NEAR: Final = 1.25
_APART_S: Final = 0.1


class Odometer:
    """The scale between the smoothed rates of position and the reported speeds,  k = Σ φ' v Δt / Σ v² Δt,  over every 4 rad of way.

    It goes on from record to record, for an excitation alone is often shorter: :meth:`begin` before each, after which it stood.
    A speed that the drive has filtered with a first-order lag F leaves k as it is: Re F = |F|² at every frequency.  That holds over whole
    motions, so half of each sum goes on into the next: a filter shows the motion before while the axis stops.

    Parameters
    ----------
    position_rad, speed_rad_s : float
        Per raw unit. Call it with the raw change of position, raw speed and s since the sample before.
    """

    def __init__(self, position_rad: float, speed_rad_s: float) -> None:
        self._position_rad, self._speed_rad_s = abs(position_rad), abs(speed_rad_s)
        self.begin()
        self._way = self._time_s = self._both = self._square = 0.0

    def begin(self) -> None:
        """The axis stands."""
        self._first_rate = self._first_speed = self._rate = self._speed = 0.0

    def __call__(self, travel: int, speed: int, elapsed_s: float) -> None:
        """One sample.   Raises DriveError when position and speed cannot be of one motion."""
        if elapsed_s <= 0.0:
            return
        share = elapsed_s / (_SMOOTH_S + elapsed_s)
        self._first_rate += share * (travel * self._position_rad / elapsed_s - self._first_rate)
        self._first_speed += share * (speed * self._speed_rad_s - self._first_speed)
        self._rate = rate = self._rate + share * (self._first_rate - self._rate)
        self._speed = v = self._speed + share * (self._first_speed - self._speed)
        if -_SLOW_RAD_S < v < _SLOW_RAD_S and -_SLOW_RAD_S < rate < _SLOW_RAD_S:
            return
        self._way += abs(rate) * elapsed_s
        self._time_s += elapsed_s
        self._both += rate * v * elapsed_s
        self._square += v * v * elapsed_s
        if self._way < 0.25 * _WAY_RAD or self._time_s < _TIME_S:
            return
        scale = self._both / self._square if self._square > 0.0 else math.inf
        if self._way < _WAY_RAD and 1.0 / _GROSS < scale < _GROSS:
            return
        if not _LEAST < scale < _MOST:
            self._way = self._time_s = self._both = self._square = 0.0  # one damaged sample does not refuse all that follows
            raise DriveError(
                f"the drive's position changes {scale:.2f} times as fast as its speed says: one of its factors is wrong, or its encoder "
                "jumped; the axis was stopped; check 6093h and 6094h, or 608Fh, 6091h, 6092h and 60A9h with the maker's tool, "
                "position_unit and velocity_unit in the profile, and the encoder's cable"
            )
        self._way = self._time_s = 0.0
        self._both, self._square = 0.5 * self._both, 0.5 * self._square


#: Units that a record does not tell apart: within this factor of each other.
_ALIKE: Final = 1.2


def _round_near(per_turn: float) -> float:
    """The power of two, or round decimal number, nearest to so many position units of a turn; itself where none is near."""
    if not math.isfinite(per_turn) or per_turn < 1.0:
        return per_turn
    decade = 10.0 ** math.floor(math.log10(per_turn))
    usual = [2.0 ** round(math.log2(per_turn)), *(k * decade for k in (1.0, 2.0, 2.5, 3.6, 4.0, 5.0, 8.0, 10.0))]
    nearest = min(usual, key=lambda one: abs(math.log(one / per_turn)))
    return nearest if abs(math.log(nearest / per_turn)) < math.log(_ROUND) else round(per_turn)


class SpeedUnit:
    """SI value of one raw number of a reported speed, by the rate of the position meanwhile, over whole records:  u = Σ φ' v Δt / Σ v² Δt.

    Both are smoothed alike, as in :class:`Odometer`, and a speed that the drive has filtered leaves u as it is, from rest to rest: the stop
    at a motion's end is part of it.
    position_rad : per raw unit.
    """

    def __init__(self, position_rad: float) -> None:
        self._position_rad = abs(position_rad)
        self._rate = self._speed = 0.0
        self._way_rad = self._both = self._square = 0.0
        self._moving = 0

    def __call__(self, travel: int, speed: int, elapsed_s: float) -> None:
        """One sample, as :class:`Odometer`."""
        if not 0.0 < elapsed_s < _APART_S:  # another record
            self._rate = self._speed = 0.0
            return
        share = elapsed_s / (_SMOOTH_S + elapsed_s)
        self._rate = rate = self._rate + share * (travel * self._position_rad / elapsed_s - self._rate)
        self._speed = v = self._speed + share * (speed - self._speed)
        if abs(rate) * elapsed_s > _CLEAR_STEPS * self._position_rad:
            self._moving += 1
            self._way_rad += abs(rate) * elapsed_s
            self._both += rate * v * elapsed_s
            self._square += v * v * elapsed_s

    def found_rad_s(self) -> float | None:
        """Of what makers use the unit that fits, position units per second first; None while the motor has not gone far enough.

        Raises DriveError where none does.
        """
        if self._way_rad < _LEARNT_RAD or self._moving < _LEARNT_SAMPLES or self._square <= 0.0:
            return None
        unit = abs(self._both) / self._square
        if unit > 0.0 and _LEAST < unit / self._position_rad < _MOST:
            return self._position_rad
        usual = [RPM * 10.0**-power for power in range(5)] + [self._position_rad * 10.0**-power for power in range(1, 3)]
        nearest = min(usual, key=lambda one: abs(math.log(one / unit))) if unit > 0.0 else 0.0
        if unit <= 0.0 or abs(math.log(nearest / unit)) > math.log(_NEAR):
            per_turn = 60.0 * unit / self._position_rad
            turn = _round_near(per_turn)
            self._way_rad, self._moving = 0.0, 0  # asked anew after another way: a damaged sample does not refuse all that follows
            self._both = self._square = 0.0
            if per_turn < _FEWEST_UNITS:
                raise DriveError(
                    f"the drive does not tell what its speeds (606Ch) count in, and by what its position does one is {unit:.4g} rad/s, "
                    "which is no unit that this program knows: look in its manual, and state it in a profile, velocity_unit: "
                    f'"{unit / RPM:.3g} rpm" or what the manual says; then start again with --profile'
                )
            raise DriveError(
                "the drive tells neither its position unit nor that of its speeds (606Ch), and by what its position does one is "
                f"{unit:.4g} rad/s, which no maker uses: one of both is wrong. If it shows speeds in rpm, one turn is about {per_turn:.0f} "
                f"position units (a round number near it: {turn:.10g}), ten times as many if in 0.1 rpm. Turn the motor once by hand, see "
                "how far 6064h goes, and state it "
                f'in a profile, position_unit: "{1.0 / turn:.10g} rev" and velocity_unit: "1 rpm"; then start again with --profile'
            )
        # 0.001 min⁻¹ and a count of 65536 per turn differ by 9 %, less than a filter makes of a shaken axis: then as CiA 402 says
        return self._position_rad if abs(math.log(nearest / self._position_rad)) < math.log(_ALIKE) else nearest
