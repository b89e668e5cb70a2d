"""Emergency messages with the error register 1001h, the error list 1003h and the error code 603Fh."""

from __future__ import annotations

import struct
from collections.abc import Callable

from beltcomm.virtual.dictionary import ObjectDictionary, SdoAbort

GENERIC, CURRENT, VOLTAGE, TEMPERATURE, COMMUNICATION, PROFILE = (1 << bit for bit in range(6))


class Code:
    """EMCY error codes this drive produces (CiA 301, table 26; CiA 402 error codes; 808xh is the maker's)."""

    I2T = 0x2312
    MOTOR_TEMPERATURE = 0x4310
    LOWER_SWITCH, UPPER_SWITCH = 0x8081, 0x8082
    COMMUNICATION = 0x8100
    LIFE_GUARD = 0x8130
    PDO_TOO_SHORT, PDO_TOO_LONG = 0x8210, 0x8220
    SYNC_LENGTH = 0x8240
    OVERSPEED = 0x8400
    FOLLOWING_ERROR = 0x8611
    SOFTWARE_LIMIT = 0x8612
    HOMING = 0x8A80


def _register_bits(code: int) -> int:
    """Bits of 1001h for an error code: generic always, and the group of its first digits."""
    if code >> 8 in (0x80, 0x81, 0x82):
        return GENERIC | (COMMUNICATION if code >> 8 != 0x80 else PROFILE)
    group = {0x2: CURRENT, 0x3: VOLTAGE, 0x4: TEMPERATURE, 0x8: PROFILE}.get(code >> 12, 0)
    return GENERIC | group


class ErrorRegister:
    """Raises and clears errors; each new one goes out once, and 0000h when the last one is cleared.

    Parameters
    ----------
    send : callable
        Puts 8 data bytes under the COB-ID of 1014h, or drops them when the node may not send.
    """

    def __init__(self, dictionary: ObjectDictionary, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._register = dictionary.entry(0x1001)
        self._error_code = dictionary.entry(0x603F)
        self._count = dictionary.entry(0x1003)
        self._list = [dictionary.entry(0x1003, sub) for sub in range(1, 5)]
        self._count.check = self._only_zero
        self._count.changed = self._clear_list
        self._active: set[int] = set()

    def raise_error(self, code: int) -> None:
        """A fault of the drive: register, list, 603Fh and one message."""
        if code in self._active:
            return
        self._active.add(code)
        self._register.value |= _register_bits(code)
        self._error_code.value = code
        self._note(code)
        self._send(struct.pack("<HB5x", code, self._register.value))

    def report(self, code: int) -> None:
        """Something went wrong once and is over: a message and a line in the list, no fault."""
        self._note(code)
        self._send(struct.pack("<HB5x", code, self._register.value | _register_bits(code)))

    def clear(self) -> None:
        """All causes are gone; the list 1003h stays."""
        if self._active:
            self._active.clear()
            self._register.value = 0
            self._error_code.value = 0
            self._send(struct.pack("<HB5x", 0, 0))

    def restart(self) -> None:
        """After power-on: nothing is known."""
        self._active.clear()

    def _note(self, code: int) -> None:
        for older, younger in zip(reversed(self._list[1:]), reversed(self._list[:-1]), strict=True):
            older.value = younger.value
        self._list[0].value = code
        self._count.value = min(self._count.value + 1, len(self._list))

    @staticmethod
    def _only_zero(value: int) -> int:
        if value != 0:
            raise SdoAbort(SdoAbort.BAD_VALUE)
        return value

    def _clear_list(self) -> None:
        for entry in self._list:
            entry.value = 0
