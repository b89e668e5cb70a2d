"""Modes of operation 1, 3, 4, 7, 8, 9, 10 of CiA 402 (homing is in :mod:`beltcomm.virtual.homing`).

A mode starts when the operation is enabled in it or when 6060h changes, and is stepped once per tick.
"""

from __future__ import annotations

import math
from enum import IntEnum

from beltcomm.virtual.dictionary import ObjectEntry
from beltcomm.virtual.loops import STANDSTILL_RAD_S, Loops
from beltcomm.virtual.motion import Interpolator, Ramp, ReferenceProfile, stop_segments, trapezoid

NEW_SETPOINT, AT_ONCE, RELATIVE, HALT = 1 << 4, 1 << 5, 1 << 6, 1 << 8
TARGET_REACHED, BIT_12, BIT_13 = 1 << 10, 1 << 12, 1 << 13

# Profile velocity: within 10 min⁻¹ of the target it is reached (606Fh's default on the CMMP-AS).
_SPEED_WINDOW_RAD_S = 10.0 * math.pi / 30.0
#: A ramp that takes no time.
_AT_ONCE_RAD_S2 = 1e9


class OperationMode:
    """One mode of operation.

    Attributes
    ----------
    controlword
        The present one, for the bits that belong to the mode.
    """

    def __init__(self, loops: Loops) -> None:
        self.loops = loops
        self.controlword = 0

    def start(self) -> None:
        """Take the axis over as it moves now."""

    def control(self, controlword: int) -> None:
        """A controlword was written while the operation is enabled."""
        self.controlword = controlword

    def step(self) -> float:
        """Torque setpoint of this tick, N m."""
        raise NotImplementedError

    def status(self) -> int:
        """The mode's bits of the statusword: 10, 12, 13."""
        return 0

    def object(self, index: int, subindex: int = 0) -> ObjectEntry:
        """An object in user units, looked up once."""
        return self.loops.dictionary.entry(index, subindex)


class _PositionWindow:
    """Statusword bit 10: the actual position has been within 6067h of the target for 6068h milliseconds."""

    def __init__(self, loops: Loops) -> None:
        self._loops = loops
        self._window = loops.dictionary.entry(0x6067)
        self._time_ms = loops.dictionary.entry(0x6068)
        self._inside_ticks = 0

    def reached(self, target_rad: float, resting: bool) -> bool:
        """To be asked once per tick."""
        error = abs(target_rad - self._loops.angle_rad) * abs(self._loops.scaling.position)
        self._inside_ticks = self._inside_ticks + 1 if resting and error <= self._window.value else 0
        return bool(self._inside_ticks > self._time_ms.value * self._loops.ticks_per_ms)


class ProfilePosition(OperationMode):
    """Mode 1: trapezoidal moves to 607Ah; one more setpoint waits while a move runs (bits 4, 5, 6, 8)."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._target_position = self.object(0x607A)
        self._speed = self.object(0x6081)
        self._acceleration = self.object(0x6083)
        self._deceleration = self.object(0x6084)

    def start(self) -> None:
        """Brake to rest along 6084h; setpoints of an earlier start are forgotten."""
        loops = self.loops
        self._trajectory = ReferenceProfile(loops.angle_rad, loops.speed_rad_s, loops.tick_s)
        self._target = loops.position_of(loops.angle_rad)
        self._waiting: float | None = None
        self._acknowledged = False
        self._cut = False
        self._window = _PositionWindow(loops)
        self._reached = False
        self._halted = False
        self._brake()
        self._to_target = False

    def control(self, controlword: int) -> None:
        """Bit 4 rising takes 607Ah over: at once, after the present move, or relative to the last setpoint."""
        rising = controlword & ~self.controlword & NEW_SETPOINT
        self.controlword = controlword
        if rising and not self._acknowledged:
            asked = self._target_position.value
            if controlword & RELATIVE:
                asked += self._waiting if self._waiting is not None else self._target
            target = self.loops.within_limits(asked)
            self._cut = target != asked
            self._acknowledged = True
            self._reached = False
            if controlword & AT_ONCE or not self._to_target:
                self._waiting = None
                self._go(target)
            else:
                self._waiting = target
        if not controlword & NEW_SETPOINT and self._waiting is None:
            self._acknowledged = False

    def step(self) -> float:
        """Torque setpoint of this tick, N m, along the trapezoid; the setpoint that waits follows a finished move."""
        halt = bool(self.controlword & HALT)
        if halt != self._halted:
            self._halted = halt
            if halt:
                self._brake()
            elif self._to_target:
                self._go(self._target)
        if self._cut:
            self.loops.limited = True
        trajectory = self._trajectory
        trajectory.step()
        if trajectory.done and not halt:
            self._to_target = False
            if self._waiting is not None:
                self._go(self._waiting)
                self._waiting = None
                self._acknowledged = bool(self.controlword & NEW_SETPOINT)
        if halt:
            self._reached = trajectory.done and abs(self.loops.speed_rad_s) < STANDSTILL_RAD_S
        else:
            self._reached = self._window.reached(self.loops.angle_of(self._target), trajectory.done and self._waiting is None)
        return self.loops.position(trajectory.position, trajectory.speed, trajectory.acceleration)

    def status(self) -> int:
        """Bit 10: in the window 6067h (with halt: at rest); bit 12: the setpoint is acknowledged."""
        return (TARGET_REACHED if self._reached else 0) | (BIT_12 if self._acknowledged else 0)

    def _brake(self) -> None:
        deceleration = self.loops.halt_deceleration() if self._halted else self.loops.acceleration(self._deceleration)
        self._trajectory.run(stop_segments(self._trajectory.speed, deceleration))

    def _go(self, target: float) -> None:
        self._target = target
        self._to_target = True
        if self._halted:
            return
        scaling, trajectory = self.loops.scaling, self._trajectory
        end = self.loops.angle_of(target)
        segments = trapezoid(
            end - trajectory.position,
            trajectory.speed,
            max(self._speed.value, 1.0) / abs(scaling.velocity),
            self.loops.acceleration(self._acceleration),
            self.loops.acceleration(self._deceleration),
        )
        trajectory.run(segments, end)


class ProfileVelocity(OperationMode):
    """Mode 3: ramps 6083h, 6084h to 60FFh; halt ramps to zero."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._target_velocity = self.object(0x60FF)
        self._top_rpm = self.object(0x6080)
        self._acceleration = self.object(0x6083)
        self._deceleration = self.object(0x6084)

    def start(self) -> None:
        """Ramp from the present speed."""
        self._ramp = Ramp(self.loops.speed_rad_s, self.loops.tick_s)
        self._target = 0.0

    def step(self) -> float:
        """Torque setpoint of this tick, N m, along the ramp to 60FFh within ± 6080h."""
        loops = self.loops
        top = self._top_rpm.value * math.pi / 30.0
        asked = 0.0 if self.controlword & HALT else self._target_velocity.value / loops.scaling.velocity
        self._target = min(max(asked, -top), top)
        if self._target != asked:
            loops.limited = True
        falling = loops.halt_deceleration() if self.controlword & HALT else loops.acceleration(self._deceleration)
        self._ramp.step(self._target, loops.acceleration(self._acceleration), falling)
        return loops.velocity(self._ramp.value, self._ramp.slope)

    def status(self) -> int:
        """Bit 10: the target speed is reached; bit 12: the axis stands."""
        speed = self.loops.speed_rad_s
        reached = self._ramp.value == self._target and abs(speed - self._target) <= _SPEED_WINDOW_RAD_S
        return (TARGET_REACHED if reached else 0) | (BIT_12 if abs(speed) < STANDSTILL_RAD_S else 0)


class ProfileTorque(OperationMode):
    """Mode 4: 6071h along the slope 6087h, all loops open; halt ramps to zero and the axis coasts."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._target_torque = self.object(0x6071)
        self._slope = self.object(0x6087)

    def start(self) -> None:
        """Ramp from zero torque."""
        self._ramp = Ramp(0.0, self.loops.tick_s)  # 0.1 % of rated torque
        self._target = 0.0

    def step(self) -> float:
        """Torque setpoint of this tick, N m, along the slope 6087h."""
        self._target = 0.0 if self.controlword & HALT else self._target_torque.value
        slope = self._slope.value
        self._ramp.step(self._target, slope, slope)
        return self.loops.torque(self._ramp.value * self.loops.nm_per_unit)

    def status(self) -> int:
        """Bit 10: the slope has reached its target."""
        return TARGET_REACHED if self._ramp.value == self._target else 0


class InterpolatedPosition(OperationMode):
    """Mode 7: 60C1h:1 with linear interpolation while bit 4 is set; without it, or with halt, the reference stands."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._target_position = self.object(0x60C1, 1)

    def start(self) -> None:
        """Hold the present angle until bit 4 is set."""
        self._interpolator = Interpolator(self.loops.angle_rad, 0.0)
        self._window = _PositionWindow(self.loops)
        self._reached = False

    @property
    def _active(self) -> bool:
        return self.controlword & (NEW_SETPOINT | HALT) == NEW_SETPOINT

    def step(self) -> float:
        """Torque setpoint of this tick, N m, on the line from one 60C1h:1 to the next."""
        loops, interpolator = self.loops, self._interpolator
        before = interpolator.position
        target = loops.angle_of(loops.within_limits(self._target_position.value)) if self._active else before
        interpolator.step(target, 0.0, loops.interpolation_ticks)
        self._reached = self._window.reached(target, interpolator.position == target)
        # The speed for the feedforward is the reference's own; a setpoint in whole counts has no usable second difference.
        return loops.position(interpolator.position, (interpolator.position - before) / loops.tick_s, 0.0)

    def status(self) -> int:
        """Bit 10: in the window 6067h; bit 12: interpolation is active."""
        return (TARGET_REACHED if self._reached else 0) | (BIT_12 if self._active else 0)


class _Cyclic(OperationMode):
    """The cyclic synchronous modes; bit 12: the drive follows the command."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._torque_offset = self.object(0x60B2)

    def status(self) -> int:
        return 0 if self.controlword & HALT else BIT_12

    def extra_nm(self) -> float:
        """60B2h in N m."""
        offset: float = self._torque_offset.value * self.loops.nm_per_unit
        return offset


class CyclicPosition(_Cyclic):
    """Mode 8: 607Ah + 60B0h, with 60B1h as its speed and 60B2h added to the torque; halt holds the reference."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._target_position = self.object(0x607A)
        self._position_offset = self.object(0x60B0)
        self._velocity_offset = self.object(0x60B1)

    def start(self) -> None:
        """Interpolate from the present angle, at rest."""
        self._interpolator = Interpolator(self.loops.angle_rad, 0.0)

    def step(self) -> float:
        """Torque setpoint of this tick, N m, with the acceleration as difference quotient of the speed."""
        loops, interpolator = self.loops, self._interpolator
        speed_before = interpolator.speed
        if self.controlword & HALT:
            target, speed = interpolator.position, 0.0
        else:
            target = loops.angle_of(loops.within_limits(self._target_position.value + self._position_offset.value))
            speed = self._velocity_offset.value / loops.scaling.velocity
        interpolator.step(target, speed, loops.interpolation_ticks)
        acceleration = (interpolator.speed - speed_before) / loops.tick_s
        return loops.position(interpolator.position, interpolator.speed, acceleration, self.extra_nm())


class CyclicVelocity(_Cyclic):
    """Mode 9: 60FFh + 60B1h; 60B2h is added to the torque; halt asks for zero."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._target_velocity = self.object(0x60FF)
        self._velocity_offset = self.object(0x60B1)

    def start(self) -> None:
        """Interpolate from the present speed."""
        self._interpolator = Interpolator(0.0, self.loops.speed_rad_s)

    def step(self) -> float:
        """Torque setpoint of this tick, N m, with the acceleration as difference quotient of the speed."""
        loops, interpolator = self.loops, self._interpolator
        speed_before = interpolator.speed
        asked = 0.0 if self.controlword & HALT else self._target_velocity.value + self._velocity_offset.value
        interpolator.step(0.0, asked / loops.scaling.velocity, loops.interpolation_ticks)
        acceleration = (interpolator.speed - speed_before) / loops.tick_s
        return loops.velocity(interpolator.speed, acceleration, self.extra_nm())


class CyclicTorque(_Cyclic):
    """Mode 10: 6071h + 60B2h, all loops open; halt asks for zero."""

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._target_torque = self.object(0x6071)

    def step(self) -> float:
        """Torque setpoint of this tick, N m: what is asked for, not interpolated."""
        if self.controlword & HALT:
            return self.loops.torque(0.0)
        nm_per_unit = self.loops.nm_per_unit
        return self.loops.torque(self._target_torque.value * nm_per_unit + self._torque_offset.value * nm_per_unit)


class NoMode(OperationMode):
    """Mode 0: none is assigned yet; the stage is on and asks for no torque."""

    def step(self) -> float:
        """Nothing."""
        return self.loops.torque(0.0)


class StopKind(IntEnum):
    """Kind of a stop: no braking, along 6084h, along 6085h, at the limit of the current.  Values of 605Eh."""

    COAST = 0
    PROFILE = 1
    QUICK = 2
    LIMIT = 3


class StopMode(OperationMode):
    """Quick stop, fault reaction and ordered end: the drive's own velocity loop along 6085h, or as :class:`StopKind` says, to rest.

    The ramp brings no acceleration feedforward: it begins and ends with a step of the acceleration, which a feedforward would hand on
    to the belt as a step of torque; the speed controller alone rounds it off.

    It begins at the measured speed, but where a loop was closed never beyond the speed that it was asked for: no stop asks for more
    than was asked before, whatever the encoder says (Synapticon's published firmware, sc_sncn_ethercat_drive: "we update the velocity
    command only if decreasing"; Beckhoff AX2000, DECSTOP: the internal setpoint goes to 0 along the ramp).   With all loops open the
    measured speed is all that a drive has.

    Attributes
    ----------
    done
        At standstill for 10 ms after the ramp, or 1 s after it whatever the axis does; at once where no loop brakes.
    """

    _STILL_MS, _PATIENCE_MS = 10, 1000

    def __init__(self, loops: Loops) -> None:
        super().__init__(loops)
        self._decelerations = {StopKind.PROFILE: self.object(0x6084), StopKind.QUICK: self.object(0x6085)}
        self._kind = StopKind.QUICK
        self.done = False

    def start(self, kind: StopKind = StopKind.QUICK) -> None:
        """Ramp from the present speed."""
        self._kind = kind
        speed, asked = self.loops.speed_rad_s, self.loops.asked_rad_s
        self._ramp = Ramp(speed if asked is None else min(max(speed, min(asked, 0.0)), max(asked, 0.0)), self.loops.tick_s)
        self.loops.begin_ramp(self._ramp.value)
        self._still_ticks = 0
        self._ended_ticks = 0
        self.done = False

    def step(self) -> float:
        """Torque setpoint of this tick, N m; sets ``done``."""
        if self._kind == StopKind.COAST:
            self.done = True
            return self.loops.torque(0.0)
        found = self._decelerations.get(self._kind)
        deceleration = _AT_ONCE_RAD_S2 if found is None else self.loops.acceleration(found)
        self._ramp.step(0.0, deceleration, deceleration)
        if self._ramp.value == 0.0:
            per_ms = self.loops.ticks_per_ms
            self._ended_ticks += 1
            self._still_ticks = self._still_ticks + 1 if abs(self.loops.speed_rad_s) < STANDSTILL_RAD_S else 0
            self.done = self._still_ticks >= self._STILL_MS * per_ms or self._ended_ticks >= self._PATIENCE_MS * per_ms
        return self.loops.velocity(self._ramp.value, 0.0)
