"""SDO server: expedited, segmented and block transfers (CiA 301, 7.2.4), one at a time."""

from __future__ import annotations

import struct
from binascii import crc_hqx
from collections.abc import Callable

from beltcomm.virtual.dictionary import ObjectDictionary, SdoAbort

# Command specifiers, bits 7 to 5 of the first byte; client and server.
_CCS_DOWNLOAD_SEGMENT, _CCS_DOWNLOAD, _CCS_UPLOAD, _CCS_UPLOAD_SEGMENT, _CCS_ABORT, _CCS_BLOCK_UPLOAD, _CCS_BLOCK_DOWNLOAD = range(7)
_SCS_UPLOAD_SEGMENT, _SCS_DOWNLOAD_SEGMENT, _SCS_UPLOAD, _SCS_DOWNLOAD = range(4)
_ABORT = 0x80
_SEGMENT = 7
# No object of these drives is longer; a client that sends more is stopped instead of stored.
_LONGEST_DOWNLOAD = 64


def begun_transfer(request: bytes) -> tuple[int, int, bool] | None:
    """Index and subindex of a request that begins a transfer, and True if it reads; None for any other.

    Parameters
    ----------
    request : bytes
        Data of the frame.
    """
    if len(request) != 8 or request[0] >> 5 not in (_CCS_DOWNLOAD, _CCS_UPLOAD):
        return None
    index, subindex = struct.unpack_from("<HB", request, 1)
    return index, subindex, request[0] >> 5 == _CCS_UPLOAD


def abort_of(index: int, subindex: int, code: int) -> bytes:
    """The frame that refuses a transfer.

    Parameters
    ----------
    index, subindex : int
    code : int
        SDO abort code.
    """
    return struct.pack("<BHBI", _ABORT, index, subindex, code)


class SdoServer:
    """Answers one client frame with the server's frames."""

    def __init__(self, dictionary: ObjectDictionary) -> None:
        self._dictionary = dictionary
        self.reset()

    def reset(self) -> None:
        """Forget a transfer that is under way."""
        self._index, self._subindex = 0, 0
        self._upload: bytes | None = None
        self._download: bytearray | None = None
        self._block: BlockDownload | BlockUpload | None = None
        self._announced: int | None = None
        self._toggle = 0

    def answer(self, request: bytes) -> list[bytes]:
        """The answer to a request of 8 bytes; nothing to what needs none (an abort, a frame of another length)."""
        if len(request) != 8:
            return []
        command = request[0] >> 5
        try:
            if request[0] == _ABORT:
                self.reset()
                return []
            if self._block is not None:
                answers = self._block.take(request)
                if self._block.done:
                    self.reset()
                return answers
            if command == _CCS_DOWNLOAD_SEGMENT and self._download is not None:
                return [self._download_segment(request, self._download)]
            if command == _CCS_UPLOAD_SEGMENT and self._upload is not None:
                return [self._upload_segment(request, self._upload)]
            if command in (_CCS_DOWNLOAD_SEGMENT, _CCS_UPLOAD_SEGMENT):
                raise SdoAbort(SdoAbort.UNKNOWN_COMMAND)  # of no transfer
            self.reset()
            self._index, self._subindex = struct.unpack_from("<HB", request, 1)
            if command == _CCS_DOWNLOAD:
                return [self._begin_download(request)]
            if command == _CCS_UPLOAD:
                return [self._begin_upload()]
            return [self._begin_block(request)]
        except SdoAbort as abort:
            answer = abort_of(self._index, self._subindex, abort.code)
            self.reset()
            return [answer]

    def _begin_block(self, request: bytes) -> bytes:
        command, index, subindex = request[0] >> 5, self._index, self._subindex
        if command == _CCS_BLOCK_DOWNLOAD and not request[0] & 1:
            if self._dictionary.seen(index, subindex).row.access in ("ro", "const"):
                raise SdoAbort(SdoAbort.READ_ONLY)
            self._block = BlockDownload(request, _LONGEST_DOWNLOAD, lambda data: self._dictionary.write(index, subindex, data))
            return self._block.begin
        if command == _CCS_BLOCK_UPLOAD and not request[0] & 3:
            data = self._dictionary.read(index, subindex)
            if len(data) <= request[5]:  # so short that the client would rather have it at once
                return self._begin_upload()
            self._block = BlockUpload(request, data)
            return self._block.begin
        raise SdoAbort(SdoAbort.UNKNOWN_COMMAND)

    def _begin_download(self, request: bytes) -> bytes:
        expedited, sized = bool(request[0] & 2), bool(request[0] & 1)
        if expedited:
            length = 4 - (request[0] >> 2 & 3) if sized else 4
            self._dictionary.write(self._index, self._subindex, request[4 : 4 + length], sized)
        else:
            row = self._dictionary.seen(self._index, self._subindex).row
            if row.access in ("ro", "const"):
                raise SdoAbort(SdoAbort.READ_ONLY)
            self._announced = struct.unpack_from("<I", request, 4)[0] if sized else None
            if self._announced is not None and self._announced != row.length:
                raise SdoAbort(SdoAbort.TOO_LONG if self._announced > row.length else SdoAbort.TOO_SHORT)
            self._download = bytearray()
        return struct.pack("<BHBI", _SCS_DOWNLOAD << 5, self._index, self._subindex, 0)

    def _download_segment(self, request: bytes, download: bytearray) -> bytes:
        self._check_toggle(request[0])
        unused, last = request[0] >> 1 & 7, bool(request[0] & 1)
        download += request[1 : 8 - unused]
        if len(download) > _LONGEST_DOWNLOAD:
            raise SdoAbort(SdoAbort.TOO_LONG)
        answer = bytes((_SCS_DOWNLOAD_SEGMENT << 5 | self._toggle << 4, 0, 0, 0, 0, 0, 0, 0))
        self._toggle ^= 1
        if last:
            self._dictionary.write(self._index, self._subindex, bytes(download))
            self.reset()
        return answer

    def _begin_upload(self) -> bytes:
        data = self._dictionary.read(self._index, self._subindex)
        if 1 <= len(data) <= 4:
            first = _SCS_UPLOAD << 5 | (4 - len(data)) << 2 | 3
            return struct.pack("<BHB4s", first, self._index, self._subindex, data)
        self._upload = data
        return struct.pack("<BHBI", _SCS_UPLOAD << 5 | 1, self._index, self._subindex, len(data))

    def _upload_segment(self, request: bytes, upload: bytes) -> bytes:
        self._check_toggle(request[0])
        segment, self._upload = upload[:_SEGMENT], upload[_SEGMENT:]
        last = not self._upload
        first = _SCS_UPLOAD_SEGMENT << 5 | self._toggle << 4 | (_SEGMENT - len(segment)) << 1 | last
        self._toggle ^= 1
        if last:
            self.reset()
        return struct.pack("<B7s", first, segment)

    def _check_toggle(self, first: int) -> None:
        if first >> 4 & 1 != self._toggle:
            raise SdoAbort(SdoAbort.TOGGLE)


_LONGEST_BLOCK = 127
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
        """A segment, or the end of the transfer; answers, none within a block."""
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
        """Start of the transfer, acknowledgement of a block, or of the end; answered with a block, its end, or nothing."""
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
