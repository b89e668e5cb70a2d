"""The drive's service language on RS-232: a line of text in, a line of text out, over the same objects as the bus.

``?XXXXSU`` reads, ``=XXXXSU:HH`` writes and is echoed, ``!FFFFFFFF`` is an abort code; BAUD, RESET!, SAVE!, VERSION? beside them
(F2 p22, F3 p237).  It has an SDO server of its own, so that every range, access and state is checked as on the bus.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

from beltcomm.virtual.dictionary import ObjectDictionary, SdoAbort
from beltcomm.virtual.sdo import SdoServer

BITRATES = (9600, 19200, 38400, 57600, 115200)
VERSION = "2300:VERSION:0001.0000"
ERROR = "ERROR!"

_READ = re.compile(r"\?([0-9A-F]{4})([0-9A-F]{2})")
_WRITE = re.compile(r"=([0-9A-F]{4})([0-9A-F]{2}):([0-9A-F]{2}|[0-9A-F]{4}|[0-9A-F]{8})")
_BAUD = re.compile(r"BAUD(\d+)")
_UPLOAD, _DOWNLOAD, _ABORTED = 0x40, 0x23, 0x80
_SAVE = b"save"


class AsciiInterpreter:
    """Answers lines.

    Parameters
    ----------
    set_bitrate : callable
        Of the port, from the next line on.
    reset : callable
        The drive starts anew.
    """

    def __init__(self, objects: ObjectDictionary, set_bitrate: Callable[[int], None], reset: Callable[[], None]) -> None:
        self._sdo = SdoServer(objects)
        self._set_bitrate = set_bitrate
        self._reset = reset

    def answer(self, line: str) -> str | None:
        """The answer to a line without its end; None to what is not answered."""
        if found := _READ.fullmatch(line):
            return self._read(int(found[1], 16), int(found[2], 16))
        if found := _WRITE.fullmatch(line):
            refused = self._write(int(found[1], 16), int(found[2], 16), bytes.fromhex(found[3])[::-1])
            return refused or line
        if (found := _BAUD.fullmatch(line)) and int(found[1]) in BITRATES:
            self._set_bitrate(int(found[1]))
            return None
        if line == "RESET!":
            self._reset()
            return None
        if line == "SAVE!":
            return ERROR if self._write(0x1010, 1, _SAVE) else "DONE"
        return VERSION if line == "VERSION?" else ERROR

    def _read(self, index: int, subindex: int) -> str:
        (answer,) = self._sdo.answer(struct.pack("<BHB4x", _UPLOAD, index, subindex))
        if answer[0] == _ABORTED:
            return _abort(answer)
        if not answer[0] & 2:  # a text, which would need segments
            self._sdo.reset()
            return f"!{SdoAbort.UNSUPPORTED_ACCESS:08X}"
        data = answer[4 : 8 - (answer[0] >> 2 & 3)]
        return f"={index:04X}{subindex:02X}:{data[::-1].hex().upper()}"

    def _write(self, index: int, subindex: int, data: bytes) -> str:
        """Empty when it was written, else the abort."""
        command = _DOWNLOAD | (4 - len(data)) << 2
        (answer,) = self._sdo.answer(struct.pack("<BHB4s", command, index, subindex, data))
        return _abort(answer) if answer[0] == _ABORTED else ""


def _abort(answer: bytes) -> str:
    return f"!{struct.unpack_from('<I', answer, 4)[0]:08X}"
