"""The limits of a motion, held against every sample of it on the host."""

from __future__ import annotations

import math
from typing import Final

from beltcomm.drive import Limits
from beltcomm.errors import SafetyStop
from beltcomm_adapters.consistency import Odometer, SpeedUnit
from beltcomm_adapters.exchange import Sample
from beltcomm_adapters.scaling import Scaling

STOP_TIME_S: Final = 3.0  # beyond the ramp of the quick stop
#: A reported torque may exceed the limit, at which the drive itself clamps, by its noise and its current ripple.
_TORQUE_SHARE: Final = 1.1
_TORQUE_NOISE_OF_RATED: Final = 0.02
_BELIEVED: Final = 0.5


class LimitWatch:
    """The limits in the drive's units; every sample is held against them.

    Speed is watched twice: as the drive reports it, and as the difference of positions.  A difference is divided by the elapsed time,
    but never by less than a period: stamps jitter, the drive's sampling does not.  ``differences`` False: only as reported, for homing,
    which moves the zero.

    Parameters
    ----------
    speed_unit : SpeedUnit or None
        Learns what the reported one counts in, where nobody tells; then it counts only where the difference is half of it.
    odometer : Odometer or None
        Of earlier records, None for a new one.
    """

    def __init__(
        self,
        limits: Limits,
        scaling: Scaling,
        period_s: float,
        differences: bool = True,
        speed_unit: SpeedUnit | None = None,
        odometer: Odometer | None = None,
    ) -> None:
        self._limits = limits
        self._scaling = scaling
        self._differences = differences
        self._period_s = period_s
        self._lowest = limits.position_min_rad / scaling.position_rad
        self._highest = limits.position_max_rad / scaling.position_rad
        self._farthest = math.inf if limits.lag_rad is None else limits.lag_rad / scaling.position_rad
        self._travel_per_s = limits.speed_rad_s / scaling.position_rad
        self._strongest = (_TORQUE_SHARE * limits.torque_nm + _TORQUE_NOISE_OF_RATED * scaling.rated_torque_nm) / scaling.torque_nm
        self._before: Sample | None = None
        known = odometer or Odometer(scaling.position_rad, scaling.speed_rad_s)
        known.begin()
        self._odometer = speed_unit or known
        self._fastest = limits.speed_rad_s / scaling.speed_rad_s
        #: Of the speed by difference beyond which the reported one counts: where nobody tells its unit, it alone stops nothing.
        self._believed = _BELIEVED if speed_unit else 0.0

    def check(self, sample: Sample) -> None:
        """Check a sample against the limits.

        Raises
        ------
        SafetyStop
            When it breaks one.
        DriveError
            When its position and speed cannot be of one motion.
        """
        before, self._before = self._before, sample
        stamp_s, position, torque, _, velocity, _ = sample
        elapsed_s, travel = math.inf, 0
        if before is not None:
            elapsed_s, travel = stamp_s - before.stamp_s, position - before.position
            if elapsed_s < self._period_s:
                elapsed_s = self._period_s
        # A jump of the angle is the reason for whatever else it breaks, so it comes first; one count at either end is no speed.
        if self._differences and abs(travel) - 1 > self._travel_per_s * elapsed_s:
            speed = travel / elapsed_s * self._scaling.position_rad
            self._stop("speed", speed, "reduce the amplitude, or look at the encoder if its position jumped")
        if not self._lowest <= position <= self._highest:
            self._stop("position", position * self._scaling.position_rad, "shorten the motion; if it swings, look at the gains")
        if abs(velocity) > self._fastest and abs(travel) >= self._believed * self._travel_per_s * min(elapsed_s, 1.0):
            self._stop("speed", velocity * self._scaling.speed_rad_s, "reduce the amplitude; if the axis swings, look at the gains")
        if abs(torque) > self._strongest:
            self._stop("torque", torque * self._scaling.torque_nm, "reduce the amplitude or soften the gains")
        if before is not None and self._differences:
            self._odometer(travel, velocity, elapsed_s)

    def learn(self, sample: Sample) -> None:
        """A sample of the stop, which breaks no limit any more, for a unit of speed that is being learnt."""
        before, self._before = self._before, sample
        if before is not None and isinstance(self._odometer, SpeedUnit):
            self._odometer(sample.position - before.position, sample.velocity, max(sample.stamp_s - before.stamp_s, self._period_s))

    @property
    def watches_stop(self) -> bool:
        """True if a stop is watched until the drive ends it."""
        return self._limits.stop_s is not None

    @property
    def longest_stop_s(self) -> float:
        """Longest time of a quick stop, s: its ramp from the highest speed, and what a drive needs beside it; or what the limits say."""
        if self._limits.stop_s is not None:
            return self._limits.stop_s
        return STOP_TIME_S + self._limits.speed_rad_s / self._limits.deceleration_rad_s2

    def in_words(self, angle_rad: float) -> str:
        """A way in words, of the carriage where its ratio is known.

        Parameters
        ----------
        angle_rad : float, motor shaft
        """
        ratio = self._limits.ratio_m_rad
        return f"{1e3 * ratio * angle_rad:.0f} mm" if ratio else f"{angle_rad:.4g} rad"

    def follow(self, sample: Sample, reference: float) -> None:
        """Check a sample against its reference position.

        Parameters
        ----------
        sample : Sample
        reference : float, raw
            Position that was asked for.

        Raises
        ------
        SafetyStop
            When it is too far off.
        """
        if abs(reference - sample.position) > self._farthest:
            off = (reference - sample.position) * self._scaling.position_rad
            self._stop("lag", off, "the axis is not the one that was counted with, or its gains do not hold it: identify again")

    def _stop(self, reason: str, value: float, remedy: str) -> None:
        """Raise SafetyStop, in terms of the carriage where its ratio is known."""
        limits = self._limits
        ratio, lag = limits.ratio_m_rad, limits.lag_rad or 0.0
        ends = (limits.position_min_rad, limits.position_max_rad)
        if reason == "torque":
            what = f"torque {value:.4g} N m at the motor is beyond the limit of {limits.torque_nm:.4g} N m"
        elif not ratio:
            limit = {
                "position": f"outside the window {ends[0]:.4g} to {ends[1]:.4g} rad",
                "speed": f"beyond the limit of {limits.speed_rad_s:.4g} rad/s",
                "lag": f"beyond the limit of {lag:.4g} rad off the reference",
            }[reason]
            what = f"{reason} {value:.4g} {'rad/s' if reason == 'speed' else 'rad'} at the motor is {limit}"
        elif reason == "position":
            at, low, high = (1e3 * ratio * (angle - limits.zero_rad) for angle in (value, *ends))
            what = f"the carriage at {at:.1f} mm is outside its window of {low:.1f} to {high:.1f} mm ({value:.4g} rad at the motor)"
        elif reason == "speed":
            what = f"the carriage's speed of {ratio * value:.3g} m/s is beyond the limit of {ratio * limits.speed_rad_s:.3g} m/s"
        else:
            what = f"the axis is {abs(1e3 * ratio * value):.3g} mm off its reference, {1e3 * ratio * lag:.3g} mm are allowed"
        raise SafetyStop(f"{what}; the axis was stopped; {remedy}", reason)
