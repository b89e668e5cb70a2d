"""Homing (mode 6): onto the present position, or onto the edge of an end switch."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import Enum, auto

from beltcomm.virtual.loops import STANDSTILL_RAD_S, Loops
from beltcomm.virtual.modes import BIT_12, BIT_13, NEW_SETPOINT, TARGET_REACHED, OperationMode
from beltcomm.virtual.motion import Ramp

_HERE = (35, 37)
#: Method -> direction of the end switch that is looked for; 0: none is.
_SWITCH = {1: -1, 2: 1, 17: -1, 18: 1, 33: 0, 34: 0}
#: Method -> direction in which the index pulse behind it is looked for.
_INDEX = {1: 1, 2: -1, 33: -1, 34: 1}

# A search that has not found its switch by then never will: 600 mm at 10 mm/s.
_PATIENCE_MS = 60_000


class _Phase(Enum):
    IDLE = auto()
    TOWARDS = auto()
    OFF = auto()
    INDEX = auto()
    STOPPING = auto()
    ATTAINED = auto()
    FAILED = auto()


class Homing(OperationMode):
    """Mode 6, started by bit 4 of the controlword; taking the bit back stops the axis.

    Methods 35 and 37: the present position is the home position.  17 (18): towards the lower (upper) end switch at 6099h:1 until it
    closes, away from it at 6099h:2 until it opens; there is the home position.  1 (2): on from there to the next index pulse of the
    encoder, once a turn.  33 (34): the next index pulse below (above).  At the home position 6064h reads -607Ch: "the zero position is
    offset from the home position by adding the home offset to the home position".

    Parameters
    ----------
    switches : callable
        Present state of (lower, upper), None when none are wired. found(angle_rad) : home lies there.
    failed : callable
        Called when the search fails. under_way : the switches are what is looked for.
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
        self._index_rad = 0.0
        self._ticks = 0
        self._ramp = Ramp(0.0, loops.tick_s)

    @property
    def under_way(self) -> bool:
        """True if an end switch is being looked for or left."""
        return self._phase in (_Phase.TOWARDS, _Phase.OFF, _Phase.INDEX, _Phase.STOPPING)

    def start(self) -> None:
        """Ramp to rest from the present speed; nothing is looked for until bit 4 rises."""
        self._phase = _Phase.IDLE
        self._ramp = Ramp(self.loops.speed_rad_s, self.loops.tick_s)

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
        elif self._phase == _Phase.INDEX:
            target = self._to_index()
        acceleration = self.loops.acceleration(self._acceleration)
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
        elif _SWITCH[method] == 0:
            self._look_for_index()
        elif self._switches() is None:
            self._fail()
        else:
            self._direction = _SWITCH[method]
            self._phase = _Phase.TOWARDS

    def _search(self) -> float:
        """Speed reference of this tick while a switch is looked for."""
        switches = self._switches()
        self._ticks += 1
        if switches is None or self._ticks > _PATIENCE_MS * self.loops.ticks_per_ms:
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
        if self._method.value in _INDEX:
            self._look_for_index()
            return self._to_index()
        self._found(self.loops.angle_rad)
        self._phase = _Phase.STOPPING
        return 0.0

    def _look_for_index(self) -> None:
        self._phase = _Phase.INDEX
        self._direction = _INDEX[self._method.value]
        turns = self.loops.angle_rad / math.tau
        self._index_rad = math.tau * (math.floor(turns) + 1 if self._direction > 0 else math.ceil(turns) - 1)

    def _to_index(self) -> float:
        """Speed reference of this tick until the index pulse is passed."""
        if self._direction * (self.loops.angle_rad - self._index_rad) < 0.0:
            return float(self._direction * self._slow.value / abs(self.loops.scaling.velocity))
        self._found(self._index_rad)
        self._phase = _Phase.STOPPING
        return 0.0

    def _fail(self) -> None:
        self._phase = _Phase.FAILED
        self._failed()
