"""The CiA 402 state machine seen from the host: states, the next control word, what a fault means.

Written from CiA 402-2 (states, statusword, controlword); the drive's word is never assumed, every step is confirmed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import IntEnum
from typing import Final, Protocol

from beltcomm.drive import Clock
from beltcomm.errors import BusError, DriveError, DriveFault, ObjectRefused
from beltcomm_adapters.link import Emergency
from beltcomm_adapters.sdo import Objects


class State(IntEnum):
    """States of CiA 402, numbered in the order in which a drive passes them."""

    NOT_READY = 0
    SWITCH_ON_DISABLED = 1
    READY_TO_SWITCH_ON = 2
    SWITCHED_ON = 3
    OPERATION_ENABLED = 4
    QUICK_STOP_ACTIVE = 5
    FAULT_REACTION_ACTIVE = 6
    FAULT = 7

    @property
    def words(self) -> str:
        """The state in the standard's words, for messages."""
        return self.name.replace("_", " ").title()


SHUTDOWN: Final = 0x0006
SWITCH_ON: Final = 0x0007
ENABLE_OPERATION: Final = 0x000F
ENABLE_INTERPOLATION: Final = 0x001F  # bit 4 in mode 7
START_HOMING: Final = 0x001F  # bit 4 in mode 6
NEW_SETPOINT: Final = 1 << 4  # in mode 1
DISABLE_VOLTAGE: Final = 0x0000
QUICK_STOP: Final = 0x0002
FAULT_RESET: Final = 0x0080
RESET_TIME_S: Final = 1.0  # in which a fault that is acknowledged must be gone

#: Statusword bits.
FAULTED: Final = 1 << 3
WARNING: Final = 1 << 7
TARGET_REACHED: Final = 1 << 10
INTERNAL_LIMIT: Final = 1 << 11
FOLLOWS: Final = 1 << 12  # modes 8, 9, 10: the target is followed; mode 7: interpolation active; mode 6: homing attained
SETPOINT_TAKEN: Final = 1 << 12  # mode 1
HOMING_ERROR: Final = 1 << 13
FOLLOWING_ERROR: Final = 1 << 13  # modes 1, 7, 8

_PATTERNS: Final = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY_TO_SWITCH_ON),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.OPERATION_ENABLED),
    (0x6F, 0x07, State.QUICK_STOP_ACTIVE),
    (0x4F, 0x0F, State.FAULT_REACTION_ACTIVE),
    (0x4F, 0x08, State.FAULT),
)

_TOWARDS_ENABLED: Final = {
    State.SWITCH_ON_DISABLED: SHUTDOWN,
    State.READY_TO_SWITCH_ON: SWITCH_ON,
    State.SWITCHED_ON: ENABLE_OPERATION,
    State.OPERATION_ENABLED: ENABLE_OPERATION,
    State.QUICK_STOP_ACTIVE: DISABLE_VOLTAGE,
}

#: EMCY error codes by group (CiA 301, 7.2.7.1) and the single ones CiA 402 names.
_STANDARD_EMERGENCIES: Final = {
    0x2220: "continuous over-current inside the drive",
    0x2250: "short circuit inside the drive",
    0x2310: "continuous over-current",
    0x2320: "short circuit or earth leakage at the motor",
    0x2330: "earth leakage at the motor",
    0x2340: "short circuit at the motor",
    0x2350: "I2t overload",
    0x3110: "voltage of the mains is too high",
    0x3120: "voltage of the mains is too low",
    0x3130: "phase failure of the mains",
    0x3210: "voltage of the DC link is too high",
    0x3220: "voltage of the DC link is too low",
    0x4210: "temperature of the device is too high",
    0x6320: "a parameter is wrong",
    0x7121: "the motor is blocked",
    0x7300: "sensor",
    0x7305: "first incremental encoder",
    0x7320: "position sensor",
    0x8110: "CAN overrun: messages were lost",
    0x8120: "CAN in error passive mode",
    0x8130: "life guard or heartbeat: the host fell silent",
    0x8140: "recovered from bus off",
    0x8150: "two nodes send with one COB-ID",
    0x8210: "a PDO is too short and was not processed",
    0x8220: "a PDO is too long",
    0x8240: "a SYNC has another length than expected",
    0x8250: "a PDO did not come in time",
    0x8400: "speed control",
    0x8500: "position control",
    0x8600: "positioning",
    0x8611: "following error too large",
    0x8612: "reference or position limit",
}
_EMERGENCY_GROUPS: Final = {
    0x1000: "generic error",
    0x2000: "current",
    0x3000: "voltage",
    0x4000: "temperature",
    0x5000: "device hardware",
    0x6000: "device software",
    0x7000: "additional modules, encoder",
    0x8000: "monitoring",
    0x9000: "external error",
    0xF000: "additional functions",
    0xFF00: "device specific",
}


def state_of(statusword: int) -> State:
    """The state that a statusword tells.

    Bit 3 alone means a fault: drives differ in the other bits of that row.

    Parameters
    ----------
    statusword : int
        6041h.

    Returns
    -------
    State
        An unknown pattern counts as not ready.
    """
    for mask, pattern, state in _PATTERNS:
        if statusword & mask == pattern:
            return state
    return State.FAULT if statusword & FAULTED else State.NOT_READY


def step_to_enabled(state: State) -> int:
    """Control word that leads one confirmed step on towards Operation Enabled.

    Parameters
    ----------
    state : State
        As the drive has confirmed it.

    Returns
    -------
    int
        For 6040h; 0 where only waiting helps.  Never a fault reset: leaving a fault is a decision of its own.
    """
    return _TOWARDS_ENABLED.get(state, DISABLE_VOLTAGE)


def emergency_text(code: int, special: Mapping[int, str]) -> str:
    """Meaning of an EMCY error code.

    Parameters
    ----------
    code : int
        As the drive sent it, or 603Fh.
    special : Mapping[int, str]
        The maker's own codes, from the profile.

    Returns
    -------
    str
        The maker's text, CiA 402's, or the group of CiA 301.
    """
    if code in special:
        return special[code]
    if code in _STANDARD_EMERGENCIES:
        return _STANDARD_EMERGENCIES[code]
    return _EMERGENCY_GROUPS.get(code & 0xFF00, _EMERGENCY_GROUPS.get(code & 0xF000, "unknown"))


class Wire(Protocol):
    """Carrier of the objects: its time, and what a drive tells unasked."""

    clock: Clock
    emergency: Emergency | None
    restarted: bool

    def pump(self, timeout_s: float) -> bool:
        """Wait for something to come, at most ``timeout_s``; False when nothing came."""
        ...

    def forget_emergency(self) -> None:
        """From here on ``emergency`` tells of new ones only."""
        ...


class StateMachine:
    """States asked and commanded object by object, while nothing cyclic runs."""

    def __init__(self, link: Wire, objects: Objects, emergencies: Mapping[int, str]) -> None:
        self._link = link
        self._objects = objects
        self._emergencies = emergencies
        self._clock: Clock = link.clock

    def statusword(self) -> int:
        """6041h as the drive has it now."""
        return self._objects.read_int(0x6041, 0, "uint16")

    def state(self) -> State:
        """The present state."""
        return state_of(self.statusword())

    def fault(self, doing: str) -> DriveFault:
        """The drive's fault as an exception, with code and text from its EMCY, else from 603Fh; a restart is one too.

        ``doing``: what was being done, for the sentence.
        """
        if self._link.restarted:
            return DriveFault(
                f"the drive restarted while {doing}: what was written to it since its last power-on is gone; check its supply and its "
                "cable, then start again"
            )
        code = self._link.emergency.code if self._link.emergency else 0
        if not code:
            try:
                code = self._objects.read_if_there(0x603F, 0, "uint16") or 0
            except (BusError, ObjectRefused):
                code = 0
        text = f"error {code:04X}h, {emergency_text(code, self._emergencies)}" if code else "no error code was sent"
        what = "reported an error" if self._link.emergency else "went into fault"
        return DriveFault(f"the drive {what} while {doing}: {text}; remove the cause, then start again", code)

    def reset_fault(self) -> None:
        """Acknowledge a fault, if there is one; the drive is left disabled.  Raises DriveFault when it stays."""
        if not self.statusword() & FAULTED:
            return
        for command in (DISABLE_VOLTAGE, FAULT_RESET):  # the edge of bit 7 counts
            self._objects.write(0x6040, 0, "uint16", command)
        cleared = self._wait(lambda word: not word & FAULTED, RESET_TIME_S)
        self._objects.write(0x6040, 0, "uint16", DISABLE_VOLTAGE)
        if not cleared:
            raise self.fault("resetting its fault, which is still there")
        self._link.forget_emergency()

    def enable(self, timeout_s: float = 3.0) -> None:
        """Step by step to Operation Enabled, each state confirmed.

        Parameters
        ----------
        timeout_s : float, s
            For all steps together.

        Raises
        ------
        DriveFault
            When the drive is in fault or goes into it.
        DriveError
            When it does not follow.
        """
        end_s = self._clock.now() + timeout_s
        commanded: int | None = None
        while (state := state_of(word := self.statusword())) is not State.OPERATION_ENABLED:
            if word & FAULTED:
                raise self.fault("being enabled")
            if self._clock.now() >= end_s:
                raise DriveError(
                    f"the drive stays in {state.words} and cannot be enabled; check STO, the enable inputs and the power stage's supply"
                )
            if (step := step_to_enabled(state)) != commanded:
                self._objects.write(0x6040, 0, "uint16", step)
                commanded = step
            else:
                self._link.pump(0.01)

    def disable(self, timeout_s: float = 3.0) -> None:
        """Quick stop when the axis is enabled, then take the stage off; a stop that is under way is waited for, that of a fault too.

        Parameters
        ----------
        timeout_s : float, s
            For the stop, and again for the stage.

        Raises
        ------
        BusError
            When the drive does not answer.
        DriveError
            When the stage stays on.
        """
        state, braking = self.state(), (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE)
        if state is State.OPERATION_ENABLED:
            self._objects.write(0x6040, 0, "uint16", QUICK_STOP)
        if state in braking:  # with the stage off it would coast, and gains are not taken while it is on
            self._wait(lambda word: state_of(word) not in braking, timeout_s)
        self._objects.write(0x6040, 0, "uint16", DISABLE_VOLTAGE)
        live = (State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.SWITCHED_ON)
        if not self._wait(lambda word: state_of(word) not in live, timeout_s):
            raise DriveError(f"the drive stays in {self.state().words} after Disable Voltage; switch its power off")

    def confirm_mode(self, mode: int) -> None:
        """Wait up to half a second until the drive shows the mode that was asked for.

        Parameters
        ----------
        mode : int
            As written to 6060h; 6061h must show it.

        Raises
        ------
        DriveError
            When it does not.
        """
        end_s = self._clock.now() + 0.5
        while (shown := self._objects.read_int(0x6061, 0, "int8")) != mode:
            if self._clock.now() >= end_s:
                raise DriveError(f"the drive does not take mode of operation {mode} (6061h shows {shown}); it may not have it")
            self._link.pump(0.01)

    def _wait(self, done: Callable[[int], bool], timeout_s: float) -> bool:
        end_s = self._clock.now() + timeout_s
        while not done(self.statusword()):
            if self._clock.now() >= end_s:
                return False
            self._link.pump(0.01)
        return True
