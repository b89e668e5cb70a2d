"""Power drive system state machine of CiA 402 (IEC 61800-7-201, 5.3): its own table, all 16 transitions."""

from __future__ import annotations

from collections.abc import Callable
from enum import IntEnum

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
        command, machine = _decode(controlword), self._machine
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
        """Torque setpoint of a tick while ``ramping``, N m, motor shaft; the controlword is followed once the ramp is done."""
        torque_nm = self._stop.step()
        if self._stop.done:
            self.ramping = False
            self._machine.control(controlword)
        return torque_nm


class DriveState(IntEnum):
    """States in the order of the standard."""

    NOT_READY = 0
    SWITCH_ON_DISABLED = 1
    READY = 2
    SWITCHED_ON = 3
    OPERATION_ENABLED = 4
    QUICK_STOP_ACTIVE = 5
    FAULT_REACTION_ACTIVE = 6
    FAULT = 7


class Command(IntEnum):
    """Command in the bits 7, 3, 2, 1, 0 of the controlword."""

    DISABLE_VOLTAGE = 0
    QUICK_STOP = 1
    SHUTDOWN = 2
    SWITCH_ON = 3
    ENABLE_OPERATION = 4


#: (state, command) -> (number of the transition, next state).  Transition 1 follows power-on, 12 and 14 follow the end of
#: a ramp, 13 a fault, 15 the rising edge of bit 7; 16 needs a quick stop that holds (605Ah = 6).
TRANSITIONS = {
    (DriveState.SWITCH_ON_DISABLED, Command.SHUTDOWN): (2, DriveState.READY),
    (DriveState.READY, Command.SWITCH_ON): (3, DriveState.SWITCHED_ON),
    (DriveState.READY, Command.ENABLE_OPERATION): (3, DriveState.SWITCHED_ON),  # 4 follows at once
    (DriveState.SWITCHED_ON, Command.ENABLE_OPERATION): (4, DriveState.OPERATION_ENABLED),
    (DriveState.OPERATION_ENABLED, Command.SWITCH_ON): (5, DriveState.SWITCHED_ON),
    (DriveState.SWITCHED_ON, Command.SHUTDOWN): (6, DriveState.READY),
    (DriveState.READY, Command.DISABLE_VOLTAGE): (7, DriveState.SWITCH_ON_DISABLED),
    (DriveState.READY, Command.QUICK_STOP): (7, DriveState.SWITCH_ON_DISABLED),
    (DriveState.OPERATION_ENABLED, Command.SHUTDOWN): (8, DriveState.READY),
    (DriveState.OPERATION_ENABLED, Command.DISABLE_VOLTAGE): (9, DriveState.SWITCH_ON_DISABLED),
    (DriveState.SWITCHED_ON, Command.DISABLE_VOLTAGE): (10, DriveState.SWITCH_ON_DISABLED),
    (DriveState.SWITCHED_ON, Command.QUICK_STOP): (10, DriveState.SWITCH_ON_DISABLED),
    (DriveState.OPERATION_ENABLED, Command.QUICK_STOP): (11, DriveState.QUICK_STOP_ACTIVE),
    (DriveState.QUICK_STOP_ACTIVE, Command.DISABLE_VOLTAGE): (12, DriveState.SWITCH_ON_DISABLED),
    (DriveState.QUICK_STOP_ACTIVE, Command.ENABLE_OPERATION): (16, DriveState.OPERATION_ENABLED),
}

#: States in which the motor carries torque.
POWERED = frozenset({DriveState.OPERATION_ENABLED, DriveState.QUICK_STOP_ACTIVE, DriveState.FAULT_REACTION_ACTIVE})

# Bits 0-3, 5 and 6 of the statusword (table 30 of the standard).
_STATUS_BITS = {
    DriveState.NOT_READY: 0x00,
    DriveState.SWITCH_ON_DISABLED: 0x40,
    DriveState.READY: 0x21,
    DriveState.SWITCHED_ON: 0x23,
    DriveState.OPERATION_ENABLED: 0x27,
    DriveState.QUICK_STOP_ACTIVE: 0x07,
    DriveState.FAULT_REACTION_ACTIVE: 0x0F,
    DriveState.FAULT: 0x08,
}


def _decode(controlword: int) -> Command:
    """The command in the bits 3 to 0 of 6040h (a fault reset is an edge and not decoded here)."""
    if not controlword & 0x02:
        return Command.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return Command.QUICK_STOP
    if not controlword & 0x01:
        return Command.SHUTDOWN
    return Command.ENABLE_OPERATION if controlword & 0x08 else Command.SWITCH_ON


class DriveStateMachine:
    """State of the drive; moved by controlwords, faults and the ends of ramps.

    Parameters
    ----------
    fault_bits : int
        Bits 3-0 in the state Fault, 08h as CiA 402 says or 0Fh as some CMMP-AS settings show. entered(number, state) : called after
        each transition. status_bits : the statusword's bits of the state. operates : it is Operation Enabled. (Asked in every tick: an
        enum is slow.).
    """

    def __init__(self, entered: Callable[[int, DriveState], None], fault_bits: int = 0x08) -> None:
        self.quick_stop_holds = False
        self._entered = entered
        self._bits_of = {**_STATUS_BITS, DriveState.FAULT: fault_bits}
        self._stand_in(DriveState.NOT_READY)

    @property
    def powered(self) -> bool:
        """True if the motor carries torque."""
        return self.state in POWERED

    def power_on(self) -> None:
        """Start of the drive; transitions 0 and 1, the self-test is over at once."""
        self._stand_in(DriveState.NOT_READY)
        self._go(1, DriveState.SWITCH_ON_DISABLED)

    def control(self, controlword: int) -> None:
        """Follow the level of the controlword as far as it leads; done on each write and each tick."""
        command = _decode(controlword)
        while (found := TRANSITIONS.get((self.state, command))) is not None:
            if found[0] == 16 and not self.quick_stop_holds:
                return
            self._go(*found)

    def reset_fault(self) -> None:
        """Rising edge of bit 7; transition 15."""
        if self.state == DriveState.FAULT:
            self._go(15, DriveState.SWITCH_ON_DISABLED)

    def fault(self, coast: bool) -> None:
        """A fault: transition 13, and 14 at once with ``coast`` or when the stage is off."""
        if self.state == DriveState.FAULT:
            return
        must_brake = self.powered and not coast
        if self.state != DriveState.FAULT_REACTION_ACTIVE:
            self._go(13, DriveState.FAULT_REACTION_ACTIVE)
        if not must_brake:
            self._go(14, DriveState.FAULT)

    def ramp_done(self) -> None:
        """The axis has stopped after a quick stop (12) or a fault reaction (14)."""
        if self.state == DriveState.FAULT_REACTION_ACTIVE:
            self._go(14, DriveState.FAULT)
        elif self.state == DriveState.QUICK_STOP_ACTIVE and not self.quick_stop_holds:
            self._go(12, DriveState.SWITCH_ON_DISABLED)

    def _go(self, number: int, state: DriveState) -> None:
        self._stand_in(state)
        self._entered(number, state)

    def _stand_in(self, state: DriveState) -> None:
        self.state = state
        self.status_bits = self._bits_of[state]
        self.operates = state is DriveState.OPERATION_ENABLED
