"""Homing (mode 6): onto the present position, or onto the edge of an end switch."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, auto

from beltcomm.virtual.bus import TICKS_PER_SECOND
from beltcomm.virtual.loops import STANDSTILL_RAD_S, Loops
from beltcomm.virtual.modes import BIT_12, BIT_13, NEW_SETPOINT, TARGET_REACHED, OperationMode
from beltcomm.virtual.motion import Ramp

_HERE = (35, 37)
_LOWER_SWITCH, _UPPER_SWITCH = 17, 18
METHODS = frozenset({*_HERE, _LOWER_SWITCH, _UPPER_SWITCH})

# A search that has not found its switch by then never will: 600 mm at 10 mm/s.
_PATIENCE_TICKS = 60 * TICKS_PER_SECOND


class _Phase(Enum):
    IDLE = auto()
    TOWARDS = auto()
    OFF = auto()
    STOPPING = auto()
    ATTAINED = auto()
    FAILED = auto()


class Homing(OperationMode):
    """Mode 6, started by bit 4 of the controlword; taking the bit back stops the axis.

    Methods 35 and 37: the present position is the home position.  17 (18): towards the lower (upper) end switch at 6099h:1
    until it closes, away from it at 6099h:2 until it opens; there is the home position.  At the home position 6064h reads
    -607Ch: "the zero position is offset from the home position by adding the home offset to the home position".

    switches : present state of (lower, upper), None when none are wired.   found(angle_rad) : home lies there.
    failed : called when the search fails.   under_way : the switches are what is looked for.
    """

    def __init__(
        self,
        loops: Loops,
        switches: Callable[[], tuple[bool, bool] | None],
        found: Callable[[float], None],
        failed: Callable[[], None],
    ) -> None:
        super().__init__(loops)
        self._switches = switches
        self._found = found
        self._failed = failed
        self._method = self.object(0x6098)
        self._fast, self._slow = self.object(0x6099, 1), self.object(0x6099, 2)
        self._acceleration = self.object(0x609A)
        self._phase = _Phase.IDLE
        self._direction = 0
        self._ticks = 0
        self._ramp = Ramp(0.0)

    @property
    def under_way(self) -> bool:
        """Whether an end switch is being looked for or left."""
        return self._phase in (_Phase.TOWARDS, _Phase.OFF, _Phase.STOPPING)

    def start(self) -> None:
        """Ramp to rest from the present speed; nothing is looked for until bit 4 rises."""
        self._phase = _Phase.IDLE
        self._ramp = Ramp(self.loops.speed_rad_s)

    def control(self, controlword: int) -> None:
        """Bit 4 rising begins the search, falling breaks it off."""
        rising = controlword & ~self.controlword & NEW_SETPOINT
        falling = self.controlword & ~controlword & NEW_SETPOINT
        self.controlword = controlword
        if rising and not self.under_way:
            self._begin()
        elif falling and self.under_way:
            self._phase = _Phase.IDLE

    def step(self) -> float:
        """Torque setpoint of this tick, N m, along the ramp 609Ah to the speed of the search."""
        target = 0.0
        if self._phase in (_Phase.TOWARDS, _Phase.OFF):
            target = self._search()
        acceleration = self._acceleration.value / self.loops.scaling.acceleration
        self._ramp.step(target, acceleration, acceleration)
        if self._phase == _Phase.STOPPING and abs(self.loops.speed_rad_s) < STANDSTILL_RAD_S and self._ramp.value == 0.0:
            self._phase = _Phase.ATTAINED
        return self.loops.velocity(self._ramp.value, self._ramp.slope)

    def status(self) -> int:
        """Bit 12: home is found; bit 13: the search has failed; bit 10: nothing is under way."""
        if self._phase == _Phase.ATTAINED:
            return TARGET_REACHED | BIT_12
        if self._phase == _Phase.FAILED:
            return TARGET_REACHED | BIT_13
        return 0 if self.under_way else TARGET_REACHED

    def _begin(self) -> None:
        method = self._method.value
        self._ticks = 0
        if method in _HERE:
            self._found(self.loops.angle_rad)
            self._phase = _Phase.ATTAINED
        elif self._switches() is None:
            self._fail()
        else:
            self._direction = -1 if method == _LOWER_SWITCH else 1
            self._phase = _Phase.TOWARDS

    def _search(self) -> float:
        """Speed reference of this tick while a switch is looked for."""
        switches = self._switches()
        self._ticks += 1
        if switches is None or self._ticks > _PATIENCE_TICKS:
            self._fail()
            return 0.0
        closed = switches[0] if self._direction < 0 else switches[1]
        per_rad_s = abs(self.loops.scaling.velocity)
        if self._phase == _Phase.TOWARDS:
            if not closed:
                return float(self._direction * self._fast.value / per_rad_s)
            self._phase = _Phase.OFF
        if closed:
            return float(-self._direction * self._slow.value / per_rad_s)
        self._found(self.loops.angle_rad)
        self._phase = _Phase.STOPPING
        return 0.0

    def _fail(self) -> None:
        self._phase = _Phase.FAILED
        self._failed()
