"""SDO block transfer (CiA 301, 7.2.4.3.9 to 7.2.4.3.16), the server's end."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Callable

from beltcomm.virtual.dictionary import SdoAbort

_SEGMENT, _LONGEST_BLOCK = 7, 127
_CRC_SUPPORTED, _SIZED = 4, 2
_LAST = 0x80


class BlockDownload:
    """From the client to the server.

    Parameters
    ----------
    store : callable
        Takes the bytes when the client has said the end, may raise SdoAbort.
    """

    def __init__(self, request: bytes, longest: int, store: Callable[[bytes], None]) -> None:
        self._store, self._longest = store, longest
        self._checks = bool(request[0] & _CRC_SUPPORTED)
        self._size = struct.unpack_from("<I", request, 4)[0] if request[0] & _SIZED else None
        if self._size is not None and self._size > longest:
            raise SdoAbort(SdoAbort.TOO_LONG)
        self._data = bytearray()
        self._sequence = 0
        self._complete = False
        self.begin = struct.pack("<B3sB3x", 0xA0 | _CRC_SUPPORTED, request[1:4], _LONGEST_BLOCK)
        self.done = False

    def take(self, request: bytes) -> list[bytes]:
        """A segment, or the end of the transfer."""
        if self._complete:
            return self._end(request)
        number = request[0] & 0x7F
        if number == 0:
            raise SdoAbort(SdoAbort.BAD_SEQUENCE)
        if number == self._sequence + 1:
            self._sequence = number
            self._data += request[1:]
            self._complete = bool(request[0] & _LAST)
            if len(self._data) > self._longest + _SEGMENT:
                raise SdoAbort(SdoAbort.TOO_LONG)
        elif not request[0] & _LAST and number < _LONGEST_BLOCK:
            return []  # what was lost is asked for again at the end of the block
        if not (request[0] & _LAST or number == _LONGEST_BLOCK):
            return []
        answer = struct.pack("<BBB5x", 0xA2, self._sequence, _LONGEST_BLOCK)
        self._sequence = 0
        return [answer]

    def _end(self, request: bytes) -> list[bytes]:
        if request[0] & 0xE3 != 0xC1:
            raise SdoAbort(SdoAbort.UNKNOWN_COMMAND)
        data = bytes(self._data[: len(self._data) - (request[0] >> 2 & 7)])
        if self._size is not None and len(data) != self._size:
            raise SdoAbort(SdoAbort.TOO_SHORT if len(data) < self._size else SdoAbort.TOO_LONG)
        if self._checks and crc_hqx(data, 0) != struct.unpack_from("<H", request, 1)[0]:
            raise SdoAbort(SdoAbort.BAD_CRC)
        self._store(data)
        self.done = True
        return [struct.pack("<B7x", 0xA1)]


class BlockUpload:
    """From the server to the client."""

    def __init__(self, request: bytes, data: bytes) -> None:
        self._data, self._at = data, 0
        self._checks = bool(request[0] & _CRC_SUPPORTED)
        self._block = request[4]
        if not 1 <= self._block <= _LONGEST_BLOCK:
            raise SdoAbort(SdoAbort.BAD_BLOCK_SIZE)
        self.begin = struct.pack("<B3sI", 0xC0 | _CRC_SUPPORTED | _SIZED, request[1:4], len(data))
        self._sent: list[bytes] = []
        self._ending = False
        self.done = False

    def take(self, request: bytes) -> list[bytes]:
        """Start of the transfer, acknowledgement of a block, or of the end."""
        command = request[0]
        if self._ending and command == 0xA1:
            self.done = True
            return []
        if command == 0xA2 and self._sent:
            acknowledged, self._block = request[1], request[2]
            if acknowledged > len(self._sent):
                raise SdoAbort(SdoAbort.BAD_SEQUENCE)
            if not 1 <= self._block <= _LONGEST_BLOCK:
                raise SdoAbort(SdoAbort.BAD_BLOCK_SIZE)
            self._at += _SEGMENT * acknowledged
            if self._at >= len(self._data):
                return [self._end()]
            return self._send_block()
        if command == 0xA3 and not self._sent:
            return self._send_block()
        raise SdoAbort(SdoAbort.UNKNOWN_COMMAND)

    def _send_block(self) -> list[bytes]:
        left = self._data[self._at : self._at + _SEGMENT * self._block]
        self._sent = []
        for number, begin in enumerate(range(0, max(len(left), 1), _SEGMENT), 1):
            last = self._at + begin + _SEGMENT >= len(self._data)
            self._sent.append(struct.pack("<B7s", number | (_LAST if last else 0), left[begin : begin + _SEGMENT]))
        return self._sent

    def _end(self) -> bytes:
        self._ending = True
        unused = -len(self._data) % _SEGMENT
        return struct.pack("<BH5x", 0xC1 | unused << 2, crc_hqx(self._data, 0) if self._checks else 0)
