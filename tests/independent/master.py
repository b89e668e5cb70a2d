"""A CANopen master written from CiA 301 for these checks alone: bare CAN frames, no protocol library, nothing of the product.

It speaks over anything with ``send`` and ``recv`` of python-can.
"""

from __future__ import annotations

import struct
from collections import deque

import can


class Refusal(Exception):
    """The server has aborted.   code : of the abort.   index, subindex : that the abort names."""

    def __init__(self, frame: bytes) -> None:
        self.index, self.subindex, self.code = struct.unpack_from("<HBI", frame, 1)
        super().__init__(f"{self.index:04X}h:{self.subindex} {self.code:08X}h")


class Silence(Exception):
    """No answer came."""


def crc_ccitt(data: bytes) -> int:
    """x^16 + x^12 + x^5 + 1, begun with 0 (CiA 301, 7.2.4.3.16), bit by bit."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


class Master:
    """One node's master.   patience_s : for an answer."""

    def __init__(self, bus: can.BusABC, node: int = 1, patience_s: float = 1.0) -> None:
        self.bus, self.node, self.patience_s = bus, node, patience_s
        self.heard: deque[tuple[float, int, bytes]] = deque()

    # frames
    def put(self, identifier: int, data: bytes = b"", remote: bool = False) -> None:
        self.bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False, is_remote_frame=remote))

    def wait(self, seconds: float) -> list[tuple[float, int, bytes]]:
        """All frames of so long."""
        self.heard.extend(self._collect(seconds))
        found = list(self.heard)
        self.heard.clear()
        return found

    def _collect(self, seconds: float) -> list[tuple[float, int, bytes]]:
        found = []
        end = self._now() + seconds
        while (left := end - self._now()) > 1e-9:
            message = self.bus.recv(left)
            if message is not None:
                found.append((message.timestamp, message.arbitration_id, bytes(message.data)))
        while (message := self.bus.recv(0.0)) is not None:
            found.append((message.timestamp, message.arbitration_id, bytes(message.data)))
        return found

    def _now(self) -> float:
        return float(self.bus.clock.now())  # type: ignore[attr-defined]  # the virtual bus's

    def next_of(self, identifier: int) -> bytes:
        """The next frame with this identifier; others are kept."""
        end = self._now() + self.patience_s
        while True:
            message = self.bus.recv(max(end - self._now(), 0.0))
            if message is None:
                raise Silence
            if message.arbitration_id == identifier:
                return bytes(message.data)
            self.heard.append((message.timestamp, message.arbitration_id, bytes(message.data)))

    # NMT
    def command(self, specifier: int, node: int | None = None) -> None:
        self.put(0x000, bytes((specifier, self.node if node is None else node)))

    def guard(self) -> int:
        """Toggle bit and state."""
        self.put(0x700 + self.node, remote=True)
        return self.next_of(0x700 + self.node)[0]

    # SDO
    def request(self, frame: bytes) -> bytes:
        self.put(0x600 + self.node, frame)
        answer = self.next_of(0x580 + self.node)
        if answer[0] == 0x80:
            raise Refusal(answer)
        return answer

    def abort(self, index: int, subindex: int, code: int = 0x08000000) -> None:
        self.put(0x600 + self.node, struct.pack("<BHBI", 0x80, index, subindex, code))

    def upload(self, index: int, subindex: int = 0) -> bytes:
        answer = self.request(struct.pack("<BHB4x", 0x40, index, subindex))
        assert answer[0] >> 5 == 2, answer.hex()
        assert struct.unpack_from("<HB", answer, 1) == (index, subindex), answer.hex()
        if answer[0] & 2:
            return answer[4 : 8 - (answer[0] >> 2 & 3)] if answer[0] & 1 else answer[4:]
        size = struct.unpack_from("<I", answer, 4)[0] if answer[0] & 1 else None
        data, toggle = b"", 0
        while True:
            answer = self.request(bytes((0x60 | toggle, *(0,) * 7)))
            assert answer[0] & 0xF0 == toggle, answer.hex()
            data += answer[1 : 8 - (answer[0] >> 1 & 7)]
            toggle ^= 0x10
            if answer[0] & 1:
                assert size in (None, len(data))
                return data

    def download(self, index: int, subindex: int, data: bytes, segmented: bool = False) -> None:
        begin = struct.pack("<HB", index, subindex)
        if not segmented and len(data) <= 4:
            answer = self.request(bytes((0x23 | (4 - len(data)) << 2,)) + begin + data.ljust(4, b"\0"))
            assert answer == b"\x60" + begin + bytes(4), answer.hex()
            return
        answer = self.request(b"\x21" + begin + struct.pack("<I", len(data)))
        assert answer == b"\x60" + begin + bytes(4), answer.hex()
        toggle = 0
        for at in range(0, len(data), 7):
            piece = data[at : at + 7]
            last = at + 7 >= len(data)
            answer = self.request(bytes((toggle | (7 - len(piece)) << 1 | last,)) + piece.ljust(7, b"\0"))
            assert answer == bytes((0x20 | toggle, *(0,) * 7)), answer.hex()
            toggle ^= 0x10

    def block_upload(self, index: int, subindex: int, block: int, lose: int = 0) -> bytes:
        """lose : number of a segment of the first block that is said not to have come."""
        answer = self.request(struct.pack("<BHBBB2x", 0xA4, index, subindex, block, 0))
        assert answer[0] >> 5 == 6, answer.hex()
        assert not answer[0] & 1, answer.hex()
        assert struct.unpack_from("<HB", answer, 1) == (index, subindex), answer.hex()
        checks = bool(answer[0] & 4)
        size = struct.unpack_from("<I", answer, 4)[0] if answer[0] & 2 else None
        self.put(0x600 + self.node, bytes((0xA3, *(0,) * 7)))
        data, ended = b"", False
        while not ended:
            good = 0
            for number in range(1, block + 1):
                segment = self.next_of(0x580 + self.node)
                assert segment[0] & 0x7F == number, segment.hex()
                if not lose or number < lose:
                    data += segment[1:]
                    good = number
                if segment[0] & 0x80:
                    ended = not lose or number < lose
                    break
            lose = 0
            self.put(0x600 + self.node, bytes((0xA2, good, block, *(0,) * 5)))
        answer = self.next_of(0x580 + self.node)
        assert answer[0] & 0xE3 == 0xC1, answer.hex()
        unused = answer[0] >> 2 & 7
        data = data[: len(data) - unused]
        assert size in (None, len(data))
        if checks:
            assert struct.unpack_from("<H", answer, 1)[0] == crc_ccitt(data)
        self.put(0x600 + self.node, bytes((0xA1, *(0,) * 7)))
        return data

    def block_download(self, index: int, subindex: int, data: bytes) -> None:
        answer = self.request(struct.pack("<BHBI", 0xC6, index, subindex, len(data)))
        assert answer[0] & 0xFB == 0xA0, answer.hex()
        block = answer[4]
        pieces = [data[at : at + 7] for at in range(0, len(data), 7)]
        for first in range(0, len(pieces), block):
            part = pieces[first : first + block]
            for number, piece in enumerate(part, 1):
                last = first + number == len(pieces)
                self.put(0x600 + self.node, bytes((number | (0x80 if last else 0),)) + piece.ljust(7, b"\0"))
            answer = self.next_of(0x580 + self.node)
            if answer[0] == 0x80:
                raise Refusal(answer)
            assert answer[:2] == bytes((0xA2, len(part))), answer.hex()
        crc = crc_ccitt(data) if answer is not None else 0
        answer = self.request(struct.pack("<BH5x", 0xC1 | (-len(data) % 7) << 2, crc))
        assert answer[0] == 0xA1, answer.hex()

    # values
    def read(self, index: int, subindex: int = 0, signed: bool = False) -> int:
        return int.from_bytes(self.upload(index, subindex), "little", signed=signed)

    def write(self, index: int, subindex: int, value: int, length: int) -> None:
        self.download(index, subindex, (value & (1 << 8 * length) - 1).to_bytes(length, "little"))

    def has(self, index: int, subindex: int = 0) -> bool:
        try:
            self.upload(index, subindex)
        except Refusal:
            return False
        return True
