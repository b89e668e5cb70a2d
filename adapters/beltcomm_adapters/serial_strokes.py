"""A motion of kind "profile" as what the drive is told: strokes from rest to rest, each a trapezoid that the drive makes by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from beltcomm.drive import Capabilities, Limits, Motion
from beltcomm.errors import UsageError
from beltcomm_adapters.preparation import check_path, check_room, check_speed
from beltcomm_adapters.scaling import Scaling

#: Largest distance of a path from the trapezoid that stands for it, as a share of its way: a rounded ramp is 2 % off.
_SHAPE: Final = 0.05
#: rad: what rounding to the drive's units may add.
_FINE_RAD: Final = 2e-3
#: Speeds below this share of the largest are rest.
_REST: Final = 1e-9
_INT32: Final = 2**31 - 1


@dataclass(frozen=True)
class Trapezoid:
    """From rest to rest with equal ramps:  v ≤ speed, |a| = acceleration.  rad, rad/s, rad/s², motor shaft; speed and acceleration > 0."""

    start_rad: float
    end_rad: float
    speed_rad_s: float
    acceleration_rad_s2: float

    @property
    def top_rad_s(self) -> float:
        """Speed that is reached, rad/s: on a short way less than asked,  √(way a)."""
        return min(self.speed_rad_s, math.sqrt(abs(self.end_rad - self.start_rad) * self.acceleration_rad_s2))

    @property
    def duration_s(self) -> float:
        """way/v + v/a, s."""
        top = self.top_rad_s
        return abs(self.end_rad - self.start_rad) / top + top / self.acceleration_rad_s2 if top > 0.0 else 0.0

    def at(self, t_s: float) -> tuple[float, float]:
        """Angle and speed.

        Parameters
        ----------
        t_s : float
            At rest before 0 and after the duration.

        Returns
        -------
        tuple[float, float]
            Rad and rad/s, motor shaft.
        """
        total_s, top, a = self.duration_s, self.top_rad_s, self.acceleration_rad_s2
        if t_s <= 0.0 or total_s == 0.0:
            return self.start_rad, 0.0
        if t_s >= total_s:
            return self.end_rad, 0.0
        sign, ramp_s = math.copysign(1.0, self.end_rad - self.start_rad), top / a
        if t_s < ramp_s:
            return self.start_rad + sign * 0.5 * a * t_s**2, sign * a * t_s
        left_s = total_s - t_s
        if left_s < ramp_s:
            return self.end_rad - sign * 0.5 * a * left_s**2, sign * a * left_s
        return self.start_rad + sign * top * (t_s - 0.5 * ramp_s), sign * top


@dataclass(frozen=True)
class SerialStroke:
    """rest_s : before it.    end, speed, acceleration : in the drive's units.    path : what they make."""

    rest_s: float
    end: int
    speed: int
    acceleration: int
    path: Trapezoid


def strokes_of(motion: Motion, here: int, scaling: Scaling) -> tuple[list[SerialStroke], float]:
    """The strokes that a sampled path consists of, and the rest after the last, s.

    Way, time and top speed of each stroke are kept:  ramp = T - D/v,  a = v/ramp.

    Parameters
    ----------
    motion : Motion
        That is asked for.
    here : int
        Where the axis stands, counts.
    scaling : Scaling

    Raises
    ------
    UsageError
        For a path that is no sequence of such strokes.
    """
    position, velocity, period_s = motion.position_rad, motion.velocity_rad_s, motion.period_s
    top = float(np.abs(velocity).max())
    direction = np.where(np.abs(velocity) > _REST * top, np.sign(velocity), 0.0)
    edges = np.flatnonzero(np.diff(direction)) + 1
    strokes: list[SerialStroke] = []
    rested_from, last = 0, len(position) - 1
    start = here
    for first, stop in zip([0, *edges], [*edges, len(position)], strict=True):
        if direction[first] == 0.0:
            continue
        begin, end = max(first - 1, 0), min(stop, last)
        way, time_s = abs(float(position[end] - position[begin])), (end - begin) * period_s
        speed = min(float(np.abs(velocity[first:stop]).max()), 2.0 * way / time_s) if time_s > 0.0 else 0.0
        if way == 0.0 or speed * time_s <= way:
            raise UsageError("the motion does not begin and end at rest; this drive makes whole strokes by itself only")
        stroke = _stroke(start, float(position[end]), speed, speed / (time_s - way / speed), (begin - rested_from) * period_s, scaling)
        _check_shape(position[begin : end + 1] - position[begin], period_s, stroke.path)
        strokes.append(stroke)
        start, rested_from = stroke.end, end
    if not strokes:
        raise UsageError("the motion goes nowhere; this drive makes whole strokes by itself only")
    return strokes, (last - rested_from) * period_s


def _stroke(start: int, end_rad: float, speed_rad_s: float, acceleration_rad_s2: float, rest_s: float, scaling: Scaling) -> SerialStroke:
    """A stroke in whole units of the drive, never faster than asked."""
    end = min(max(round(end_rad / scaling.position_rad), -_INT32), _INT32)
    speed = max(1, math.floor(speed_rad_s / scaling.speed_rad_s + 1e-9))
    acceleration = scaling.raw_acceleration(acceleration_rad_s2, at_most=False)
    path = Trapezoid(
        start * scaling.position_rad, end * scaling.position_rad, speed * scaling.speed_rad_s, scaling.acceleration(acceleration)
    )
    return SerialStroke(rest_s, end, speed, acceleration, path)


def _check_shape(way_rad: np.ndarray, period_s: float, path: Trapezoid) -> None:
    asked = np.abs(way_rad)
    made = np.array([abs(path.at(n * period_s)[0] - path.start_rad) for n in range(len(asked))])
    if float(np.abs(asked - made).max()) > _SHAPE * float(asked[-1]) + _FINE_RAD:
        raise UsageError(
            "the motion is no sequence of strokes at one speed each; this drive makes trapezoids by itself only: plan it as such, or use "
            "the drive's CAN port"
        )


def check_limits(motion: Motion, limits: Limits, capabilities: Capabilities, here_rad: float) -> None:
    """Refuse a motion that cannot be run inside its limits by this drive from where the axis is.

    Parameters
    ----------
    motion : Motion
        That is asked for.
    limits : Limits
    capabilities : Capabilities
    here_rad : float, rad
        Present motor angle.

    Raises
    ------
    UsageError
        With what stands against it.
    """
    if motion.kind not in capabilities.kinds:
        why = capabilities.refused.get(motion.kind, "it has no such mode")
        raise UsageError(f"{capabilities.name} cannot run a motion of kind {motion.kind!r}: {why}")
    check_room(limits, here_rad)
    if not (np.all(np.isfinite(motion.position_rad)) and np.all(np.isfinite(motion.velocity_rad_s))):
        raise UsageError("the motion contains values that are no numbers")
    if motion.torque_nm.any() or motion.rest_nm:
        raise UsageError(
            f"{capabilities.name} takes no feedforward torque in a motion of kind {motion.kind!r}; plan it without (torque_nm = 0)"
        )
    check_path(motion, limits, here_rad)
    check_speed(motion.velocity_rad_s, limits)
