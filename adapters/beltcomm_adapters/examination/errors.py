"""Error frames of a CAN interface in words: what its controller saw go wrong on the wire.

Bits as in the Linux header ``linux/can/error.h``; other interfaces say only that there was an error.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final, Literal

import can

Trouble = Literal["no_ack", "bus_off", "passive", "bit_errors", "other"]

_TX_TIMEOUT, _CONTROLLER, _PROTOCOL, _NO_ACK, _BUS_OFF, _BUS_ERROR = 0x001, 0x004, 0x008, 0x020, 0x040, 0x080
_PASSIVE_BITS: Final = 0x10 | 0x20  # of data byte 1: receiver, transmitter error passive

#: From the worst to the mildest; the first that was seen is what a person is told.
ORDER: Final[tuple[Trouble, ...]] = ("bus_off", "no_ack", "bit_errors", "passive", "other")

#: What was seen, and what to do about it.
WORDS: Final[dict[Trouble, tuple[str, str]]] = {
    "bus_off": (
        "the CAN controller went bus-off: it saw so many errors that it left the bus",
        "check bit rate, cable (CAN high and low swapped, short circuit) and both 120 ohm terminators, then take the interface down and up",
    ),
    "no_ack": (
        "what is sent is acknowledged by nobody (ACK error): no other node is on the bus, or its bit rate is another one",
        "switch the drive on, check the cable and the drive's bit rate; `--try-bitrates` looks for it",
    ),
    "bit_errors": (
        "frames on the bus are damaged (bit, stuff or form errors): wrong bit rate, missing terminator or a bad cable",
        "check the drive's bit rate (`--try-bitrates` looks for it), both terminators of 120 ohm and the cable",
    ),
    "passive": (
        "the CAN controller is error-passive: many frames were damaged lately",
        "check both terminators of 120 ohm, the cable and the bit rate",
    ),
    "other": ("the CAN interface reports errors on the bus", "check both terminators of 120 ohm, the cable and the bit rate"),
}


def trouble_of(frame: can.Message) -> Trouble:
    """Trouble that an error frame tells."""
    bits = frame.arbitration_id
    if bits & _BUS_OFF:
        return "bus_off"
    if bits & (_NO_ACK | _TX_TIMEOUT):
        return "no_ack"
    if bits & _CONTROLLER and len(frame.data) > 1 and frame.data[1] & _PASSIVE_BITS:
        return "passive"
    return "bit_errors" if bits & (_PROTOCOL | _BUS_ERROR) else "other"


def worst(frames: Iterable[can.Message]) -> Trouble | None:
    """The worst of what these error frames tell, None when there are none."""
    seen = {trouble_of(frame) for frame in frames}
    return next((trouble for trouble in ORDER if trouble in seen), None)
