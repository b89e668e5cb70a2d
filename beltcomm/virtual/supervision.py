"""Supervision by the drive while its motor carries torque, and code and reaction of its faults."""

from __future__ import annotations

import math
from collections.abc import Callable

from beltcomm.virtual.emcy import Code
from beltcomm.virtual.loops import STANDSTILL_RAD_S, Loops

_RAD_S_PER_RPM = math.pi / 30.0
_WINDOW_OFF = 0xFFFFFFFF


class Supervision:
    """Overspeed, end switches, software limits, following error and I²t.

    fault(code, coast) : the drive goes into fault, with the stage off at once when ``coast``, else it brakes first. follows_position :
    whether the running mode has a position reference.

    Attributes
    ----------
    following_error
        Bit 13 of the statusword.
    """

    def __init__(self, loops: Loops, fault: Callable[[int, bool], None]) -> None:
        self._loops = loops
        self._fault = fault
        entry = loops.dictionary.entry
        self._top_rpm = entry(0x6080)
        self._lower, self._upper = entry(0x607D, 1), entry(0x607D, 2)
        self._window, self._time_ms = entry(0x6065), entry(0x6066)
        has_switch_off = loops.dictionary.has(0x6510, 0x22)
        self._switch_off = entry(0x6510, 0x22) if has_switch_off else None
        self.begin()

    def begin(self) -> None:
        """The stage has just been switched on: what is already beyond a limit may come back."""
        self._beyond = [True, True, True, True]
        self._any_beyond = True
        self._late_ticks = 0
        self.following_error = False

    def check(self, position: int, switches: tuple[bool, bool], homing: bool, follows_position: bool) -> None:
        """One look per tick.

        Parameters
        ----------
        position : int
            User units.
        switches : tuple[bool, bool]
            Lower, upper.
        homing : bool
            A switch is looked for.
        follows_position : bool
            A following error counts.
        """
        loops = self._loops
        speed = loops.speed_rad_s
        if abs(speed) > self._top_rpm.value * _RAD_S_PER_RPM:
            # The velocity loop may be the cause (a wrong encoder sign), so it does not brake.
            self._fault(Code.OVERSPEED, True)
            return
        lower, upper = self._lower.value, self._upper.value
        if self._any_beyond or switches[0] or switches[1] or not lower <= position <= upper:
            self._check_ends(position, switches, homing)
        if follows_position:
            self._follow(abs(loops.following_error_rad * loops.scaling.position))
        else:
            self._late_ticks = 0
            self.following_error = False

    def _check_ends(self, position: int, switches: tuple[bool, bool], homing: bool) -> None:
        speed = self._loops.speed_rad_s
        if not homing:
            self._end(0, switches[0], -speed, Code.LOWER_SWITCH)
            self._end(1, switches[1], speed, Code.UPPER_SWITCH)
        lower, upper = self._lower.value, self._upper.value
        user_speed = speed if self._loops.scaling.position > 0.0 else -speed
        on = lower < upper
        self._end(2, on and position < lower, -user_speed, Code.SOFTWARE_LIMIT)
        self._end(3, on and position > upper, user_speed, Code.SOFTWARE_LIMIT)
        self._any_beyond = any(self._beyond)

    def _end(self, which: int, beyond: bool, outward_speed: float, code: int) -> None:
        """A limit faults when it is passed, and again when the axis moves further out."""
        if beyond and (not self._beyond[which] or outward_speed > STANDSTILL_RAD_S):
            self._fault(code, False)
        self._beyond[which] = beyond

    def _follow(self, error: float) -> None:
        outside = error > self._window.value != _WINDOW_OFF
        self._late_ticks = self._late_ticks + 1 if outside else 0
        self.following_error = outside and self._late_ticks > self._time_ms.value * self._loops.ticks_per_ms
        if self.following_error and self._loops.profile.following_error_faults:
            self._fault(Code.FOLLOWING_ERROR, False)
        if self._switch_off is not None and 0 < self._switch_off.value < error:
            self._fault(Code.FOLLOWING_ERROR, True)
