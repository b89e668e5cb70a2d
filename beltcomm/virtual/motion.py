"""Reference generators inside the drive: trapezoidal profile, ramp, linear interpolation.  rad, rad/s at the motor shaft."""

from __future__ import annotations

import math

Segment = tuple[float, float]
"""Duration, s; constant acceleration, rad/s²."""


def stop_segments(speed: float, deceleration: float) -> list[Segment]:
    """Segments of a motion that brakes to rest.

    Parameters
    ----------
    speed : float
        Either way, at the start.
    deceleration : float
        In that unit over s.

    Returns
    -------
    list of Segment
        Duration, s, and acceleration.
    """
    return [(abs(speed) / deceleration, -math.copysign(deceleration, speed))]


def trapezoid(distance: float, speed: float, top_speed: float, acceleration: float, deceleration: float) -> list[Segment]:
    """Fastest way over ``distance`` that ends at rest, from ``speed``, with bounded speed and acceleration.

    Peak speed v from  (v² - v0²)/2a + v²/2d = distance,  cut at ``top_speed``.  Moving the wrong way or too fast to stop in front of
    the target, the profile brakes first.

    Parameters
    ----------
    distance : float, rad
        Signed.
    speed : float, rad/s
        Signed. others > 0.
    top_speed : float, rad/s
        At most.
    acceleration, deceleration : float, rad/s²
        At most.
    """
    braking = speed * abs(speed) / (2.0 * deceleration)
    if distance == braking:
        return stop_segments(speed, deceleration)
    direction = math.copysign(1.0, distance - braking)
    left, v0 = direction * distance, direction * speed
    segments: list[Segment] = []
    if v0 < 0.0:
        segments.append((-v0 / deceleration, direction * deceleration))
        left += v0 * v0 / (2.0 * deceleration)
        v0 = 0.0
    elif v0 > top_speed:
        segments.append(((v0 - top_speed) / deceleration, -direction * deceleration))
        left -= (v0 * v0 - top_speed * top_speed) / (2.0 * deceleration)
        v0 = top_speed
    peak_squared = (left + v0 * v0 / (2.0 * acceleration)) / (0.5 / acceleration + 0.5 / deceleration)
    peak = min(top_speed, math.sqrt(max(peak_squared, v0 * v0)))
    ramps = (peak * peak - v0 * v0) / (2.0 * acceleration) + peak * peak / (2.0 * deceleration)
    segments.append(((peak - v0) / acceleration, direction * acceleration))
    if peak > 0.0:
        segments.append((max(0.0, left - ramps) / peak, 0.0))
    segments.append((peak / deceleration, -direction * deceleration))
    return segments


class ReferenceProfile:
    """A position reference that runs through segments of constant acceleration, sampled once per tick.

    Attributes
    ----------
    position, speed, acceleration
        The present reference.
    done
        It is at rest.
    """

    def __init__(self, position: float, speed: float, tick_s: float) -> None:
        self.position, self.speed, self.acceleration = position, speed, 0.0
        self._tick_s = tick_s
        self.done = True
        self.run([])

    def run(self, segments: list[Segment], end: float | None = None) -> None:
        """Follow segments from the present reference on, to the exact position ``end``, rad, motor shaft; None where they tell it."""
        self._segments = segments
        self._end = end
        self._start = (self.position, self.speed)
        self._elapsed_ticks = 0
        self.done = not segments

    def step(self) -> None:
        """Move the reference on by one tick."""
        if self.done:
            self.speed = self.acceleration = 0.0
            return
        self._elapsed_ticks += 1
        position, speed = self._start
        left = self._elapsed_ticks * self._tick_s
        for duration, acceleration in self._segments:
            part = min(left, duration)
            position += (speed + 0.5 * acceleration * part) * part
            speed += acceleration * part
            left -= part
            if left <= 0.0:
                self.position, self.speed, self.acceleration = position, speed, acceleration
                return
        self.position = position if self._end is None else self._end
        self.speed = self.acceleration = 0.0
        self.done = True


class Ramp:
    """A value that follows its target with bounded slope.

    Attributes
    ----------
    slope
        The step of the last tick per second.
    """

    def __init__(self, value: float, tick_s: float) -> None:
        self.value = value
        self._tick_s = tick_s
        self.slope = 0.0

    def step(self, target: float, rising: float, falling: float) -> None:
        """One tick towards a target, with slopes per second away from zero and towards it; passing zero takes no time."""
        before = value = self.value
        left = self._tick_s
        if value * target < 0.0 or abs(target) < abs(value):
            goal = 0.0 if value * target < 0.0 else target
            need = abs(goal - value) / falling
            value = goal if need <= left else value + math.copysign(falling * left, goal - value)
            left -= min(need, left)
        if left > 0.0 and value != target:
            need = abs(target - value) / rising
            value = target if need <= left else value + math.copysign(rising * left, target - value)
        self.value = value
        self.slope = (value - before) / self._tick_s


class Interpolator:
    """Linear interpolation of a pair (position, speed) between setpoints that come every ``ticks`` ticks.

    The setpoint that arrives at t_k is reached in the loop of tick k + ticks - 1: at once when ticks = 1.
    """

    def __init__(self, position: float, speed: float) -> None:
        self.position, self.speed = position, speed
        self._target_position, self._target_speed = position, speed
        self._step = (0.0, 0.0)
        self._left = 0

    def step(self, position: float, speed: float, ticks: int) -> None:
        """One tick towards the present setpoint; a new one is reached in so many ticks."""
        if position != self._target_position or speed != self._target_speed:
            self._target_position, self._target_speed = position, speed
            self._left = ticks
            self._step = ((position - self.position) / ticks, (speed - self.speed) / ticks)
        if self._left > 1:
            self._left -= 1
            self.position += self._step[0]
            self.speed += self._step[1]
        else:
            self._left = 0
            self.position, self.speed = position, speed
