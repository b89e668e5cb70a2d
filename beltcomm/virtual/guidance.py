"""The state machine along the controlword: at once, after the time that the stage takes, or after a ramp (605Bh, 605Ch)."""

from __future__ import annotations

from collections.abc import Callable

from beltcomm.virtual.cia402 import Command, DriveState, DriveStateMachine, decode
from beltcomm.virtual.dictionary import ObjectDictionary
from beltcomm.virtual.modes import StopKind, StopMode

_SWITCH_ON_WORD = 0x0007
_RAMP_FIRST = 1


class Guidance:
    """Leads ``machine``.

    ramping : the axis is braked before the state that was asked for is entered.

    Parameters
    ----------
    enable_s : float
        Until the stage is on.
    resume : callable
        Called when an ordered end is taken back.
    """

    def __init__(
        self, machine: DriveStateMachine, stop: StopMode, dictionary: ObjectDictionary, enable_s: float, resume: Callable[[], None]
    ) -> None:
        self._machine, self._stop, self._enable_s, self._resume = machine, stop, enable_s, resume
        options = {Command.SHUTDOWN: 0x605B, Command.SWITCH_ON: 0x605C}
        self._options = {command: dictionary.entry(index) for command, index in options.items() if dictionary.has(index)}
        self.forget()

    def forget(self) -> None:
        """A transition has happened."""
        self.ramping = False
        self._on_at_s: float | None = None

    def follow(self, controlword: int, now_s: float) -> None:
        """Follow this controlword as far as it leads."""
        command, machine = decode(controlword), self._machine
        if machine.state == DriveState.OPERATION_ENABLED:
            option = self._options.get(command)
            if option is not None and option.value == _RAMP_FIRST:
                if not self.ramping:
                    self.ramping = True
                    self._stop.start(StopKind.PROFILE)
                return
            if self.ramping and command == Command.ENABLE_OPERATION:
                self.ramping = False
                self._resume()
        elif self._enable_s and command == Command.ENABLE_OPERATION and machine.state in (DriveState.READY, DriveState.SWITCHED_ON):
            begun = self._on_at_s
            machine.control(_SWITCH_ON_WORD)
            self._on_at_s = now_s + self._enable_s if begun is None else begun
            if now_s < self._on_at_s:
                return
        machine.control(controlword)

    def pass_tick(self, controlword: int, now_s: float) -> None:
        """The stage may be on by now."""
        if self._on_at_s is not None and now_s >= self._on_at_s:
            self._machine.control(controlword)

    def brake(self, controlword: int) -> float:
        """Torque setpoint of a tick while ``ramping``, N m."""
        torque_nm = self._stop.step()
        if self._stop.done:
            self.ramping = False
            self._machine.control(controlword)
        return torque_nm
