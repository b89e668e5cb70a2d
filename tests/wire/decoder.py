"""Frames on a CAN bus to what they say, by CiA 301 and CiA 402 alone: nothing here comes from beltcomm.

Objects are known from the SDO transfers seen, PDOs from the mapping that was read or written there.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

Object = tuple[int, int]

SIGNED = {0x605A, 0x6060, 0x6061, 0x6064, 0x606C, 0x6071, 0x6074, 0x6077, 0x607A, 0x60B0, 0x60B1, 0x60B2, 0x60C1, 0x60F4, 0x60FF}
PDO_BASES = {"r": (0x1400, 0x1600), "t": (0x1800, 0x1A00)}
PDO_COUNT = 4
STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x04, 0x05, 0x7F
NMT_STATES = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL, 0x81: 0, 0x82: 0}
_LINE = re.compile(r"\(([\d.]+)\)\s+\S+\s+([0-9A-Fa-f]{3})#(R\d?|[0-9A-Fa-f]*)\s*(?:[RT])?$")


@dataclass(frozen=True)
class Frame:
    """One classic frame with an 11-bit identifier."""

    stamp_s: float
    identifier: int
    data: bytes = b""
    remote: bool = False


@dataclass(frozen=True)
class Event:
    """What a frame said.   number : of the frame, from 0.   what : see :class:`Decoder`."""

    number: int
    stamp_s: float
    what: str
    index: int = 0
    subindex: int = 0
    value: int = 0
    data: bytes = b""
    text: str = ""
    values: tuple[tuple[Object, int], ...] = ()

    @property
    def object(self) -> Object:
        return self.index, self.subindex


def candump(lines: Iterable[str]) -> Iterator[Frame]:
    """Frames of ``candump -L``.   Raises ValueError for a line that is none, but for a last one that was cut off."""
    cut = ""
    for line in lines:
        if cut:
            raise ValueError(f"no line of candump -L: {cut!r}")
        found = _LINE.match(line.strip())
        if found is None:
            cut = line
            continue
        stamp, identifier, data = found.groups()
        remote = data.startswith("R")
        yield Frame(float(stamp), int(identifier, 16), b"" if remote else bytes.fromhex(data), remote)


def lockstep(frames: Iterable[tuple[float, int, bytes, str]]) -> Iterator[Frame]:
    """Frames that a virtual bus has handed to its hook: time, identifier, data, who."""
    for stamp_s, identifier, data, source in frames:
        yield Frame(stamp_s, identifier, data, source.endswith("rtr"))


class Decoder:
    """Frames to and from node ``node``; :meth:`events` yields what they say:

    sync · nmt (value: command) · boot · heartbeat (index: whose; value: state) · guard (asked) · guarded (value: state and toggle)
    · emergency (value: code) · read, written (object, data; text: what was known before, as hex)
    · refused (object, value: abort code) · received, sent (a PDO, values)
    · broken (text: what is wrong with the frame, or with its place; data: the rule).

    known : object -> its bytes as last read or written.   state : of network management, as commanded.
    """

    def __init__(self, node: int = 1) -> None:
        self.node = node
        self.known: dict[Object, bytes] = {}
        self.state = PRE_OPERATIONAL
        self._pending: tuple[int, Object] | None = None  # request's first byte, object
        self._transfer: dict[str, object] | None = None

    def events(self, frames: Iterable[Frame]) -> Iterator[Event]:
        number = -1
        stamp_s = 0.0
        for number, frame in enumerate(frames):
            stamp_s = frame.stamp_s
            for what, fields in self._of(frame):
                yield Event(number, stamp_s, what, **fields)  # type: ignore[arg-type]
        if self._pending is not None:
            yield Event(number, stamp_s, "broken", data=b"sdo", text="the last SDO request was never answered")

    def number(self, index: int, subindex: int) -> int | None:
        """An object's value, None while unknown."""
        data = self.known.get((index, subindex))
        return None if data is None else int.from_bytes(data, "little", signed=index in SIGNED)

    def pdos(self) -> dict[int, tuple[str, int]]:
        """Identifier -> direction and number of every valid PDO."""
        found = {}
        for direction, (communication, _) in PDO_BASES.items():
            for pdo in range(PDO_COUNT):
                cob_id = self.number(communication + pdo, 1)
                if cob_id is not None and not cob_id >> 31:
                    found[cob_id & 0x7FF] = (direction, pdo)
        return found

    def mapping(self, direction: str, pdo: int) -> list[tuple[Object, int]] | None:
        """Objects of a PDO and their bytes; None while it is not wholly known."""
        base = PDO_BASES[direction][1] + pdo
        count = self.number(base, 0)
        entries = [self.number(base, part + 1) for part in range(count or 0)]
        if count is None or any(entry is None for entry in entries):
            return None
        return [((entry >> 16, entry >> 8 & 0xFF), (entry & 0xFF) // 8) for entry in entries if entry is not None]

    def _of(self, frame: Frame) -> Iterator[tuple[str, dict[str, object]]]:
        identifier, data, node = frame.identifier, frame.data, self.node
        pdo = self.pdos().get(identifier)
        if frame.remote:
            yield ("guard", {}) if identifier == 0x700 + node else _broken("frame", f"remote frame to {identifier:03X}h")
        elif identifier == 0x000:
            yield from self._nmt(data)
        elif identifier == 0x080:
            yield ("sync", {}) if not data else _broken("frame", "a SYNC with data")
        elif identifier == 0x080 + node:
            yield ("emergency", {"value": int.from_bytes(data[:2], "little")}) if len(data) == 8 else _broken("frame", "short EMCY")
        elif identifier == 0x600 + node:
            yield from self._request(data)
        elif identifier == 0x580 + node:
            yield from self._answer(data)
        elif 0x700 < identifier <= 0x77F:
            yield from self._life(identifier - 0x700, data)
        elif pdo is not None:
            yield from self._pdo(*pdo, data)
        elif not 0x600 < identifier <= 0x67F:  # who looks for nodes asks them all
            yield _broken("frame", f"nobody was given the identifier {identifier:03X}h")

    def _nmt(self, data: bytes) -> Iterator[tuple[str, dict[str, object]]]:
        if len(data) != 2 or data[0] not in NMT_STATES:
            yield _broken("frame", f"no network management command: {data.hex()}")
        elif data[1] in (0, self.node):
            self.state = NMT_STATES[data[0]]
            yield "nmt", {"value": data[0]}

    def _life(self, whose: int, data: bytes) -> Iterator[tuple[str, dict[str, object]]]:
        if len(data) != 1:
            yield _broken("frame", f"a sign of life with {len(data)} bytes")
        elif whose == self.node and data[0] == 0:
            self.state = PRE_OPERATIONAL
            self.known.clear()
            yield "boot", {}
        elif whose == self.node and not self.number(0x1017, 0):
            yield "guarded", {"value": data[0]}
        else:
            yield "heartbeat", {"index": whose, "value": data[0]}

    def _pdo(self, direction: str, pdo: int, data: bytes) -> Iterator[tuple[str, dict[str, object]]]:
        what = "received" if direction == "r" else "sent"
        if self.state != OPERATIONAL:
            yield _broken("pdo state", f"{direction}PDO{pdo + 1} although the node is not operational")
        mapping = self.mapping(direction, pdo)
        if mapping is None:
            yield _broken("pdo mapping", f"{direction}PDO{pdo + 1} whose mapping nobody knows")
            return
        if len(data) != sum(length for _, length in mapping):
            yield _broken("pdo mapping", f"{direction}PDO{pdo + 1} has {len(data)} bytes, mapped are {sum(n for _, n in mapping)}")
            return
        values, place = [], 0
        for key, length in mapping:
            values.append((key, int.from_bytes(data[place : place + length], "little", signed=key[0] in SIGNED)))
            place += length
        yield what, {"index": pdo, "values": tuple(values)}

    def _request(self, data: bytes) -> Iterator[tuple[str, dict[str, object]]]:
        if len(data) != 8:
            yield _broken("sdo", f"an SDO request with {len(data)} bytes")
            return
        if self._pending is not None:
            yield _broken("sdo", "an SDO request before the answer to the one before")
        command, key = data[0] >> 5, struct.unpack_from("<HB", data, 1)
        if command == 4:  # the client breaks off; nobody answers
            self._pending = self._transfer = None
            return
        if command in (1, 2):  # initiate download, upload
            self._transfer = {"key": key, "toggle": 0, "data": b"", "write": command == 1}
            if command == 1 and data[0] & 2:
                self._transfer["data"] = data[4 : 8 - (data[0] >> 2 & 3 if data[0] & 1 else 0)]
            elif command == 1 and data[0] & 1:
                self._transfer["announced"] = struct.unpack_from("<I", data, 4)[0]
        elif command in (0, 3):  # segments
            transfer = self._transfer
            if transfer is None or transfer["write"] != (command == 0):
                yield _broken("sdo", "a segment of no transfer")
            elif data[0] >> 4 & 1 != transfer["toggle"]:
                yield _broken("sdo", "a segment whose toggle bit does not alternate")
            elif command == 0:
                transfer["data"] = bytes(transfer["data"]) + data[1 : 8 - (data[0] >> 1 & 7)]  # type: ignore[call-overload]
        else:
            yield _broken("sdo", f"the SDO command {data[0]:02X}h is not expedited or segmented")
        self._pending = data[0], key

    def _answer(self, data: bytes) -> Iterator[tuple[str, dict[str, object]]]:
        pending, transfer = self._pending, self._transfer
        self._pending = None
        if len(data) != 8:
            yield _broken("sdo", f"an SDO answer with {len(data)} bytes")
            return
        if pending is None:
            yield _broken("sdo", "an SDO answer to no request")
            return
        asked, answered = pending[0] >> 5, data[0] >> 5
        key: Object = struct.unpack_from("<HB", data, 1)
        if answered == 4:
            self._transfer = None
            expected = transfer["key"] if transfer is not None else key
            if key != expected:
                yield _broken("sdo", f"an abort of {key[0]:04X}h:{key[1]:X}, which was not asked for")
            else:
                yield "refused", {"index": key[0], "subindex": key[1], "value": struct.unpack_from("<I", data, 4)[0]}
            return
        if answered != {1: 3, 2: 2, 0: 1, 3: 0}.get(asked) or transfer is None:
            yield _broken("sdo", f"{data[0]:02X}h is no answer to {pending[0]:02X}h")
            return
        if asked in (1, 2):
            if key != transfer["key"]:
                yield _broken("sdo", f"an answer about {key[0]:04X}h:{key[1]:X}, asked was another object")
            elif asked == 1 and pending[0] & 2:
                yield self._done("written", transfer)
            elif asked == 2 and data[0] & 2:
                transfer["data"] = data[4 : 8 - (data[0] >> 2 & 3 if data[0] & 1 else 0)]
                yield self._done("read", transfer)
            elif asked == 2 and data[0] & 1:
                transfer["announced"] = struct.unpack_from("<I", data, 4)[0]
            return
        if data[0] >> 4 & 1 != transfer["toggle"]:
            yield _broken("sdo", "an answer whose toggle bit does not alternate")
        transfer["toggle"] = 1 - int(str(transfer["toggle"]))
        if asked == 3:
            transfer["data"] = bytes(transfer["data"]) + data[1 : 8 - (data[0] >> 1 & 7)]  # type: ignore[call-overload]
        if (pending[0] if asked == 0 else data[0]) & 1:  # the last segment
            if transfer.get("announced", len(transfer["data"])) != len(transfer["data"]):  # type: ignore[arg-type]
                yield _broken("sdo", "a segmented transfer of another length than announced")
            yield self._done("written", transfer) if asked == 0 else self._done("read", transfer)

    def _done(self, what: str, transfer: dict[str, object]) -> tuple[str, dict[str, object]]:
        index, subindex = transfer["key"]  # type: ignore[misc]
        data = bytes(transfer["data"])  # type: ignore[call-overload]
        before = self.known.get((index, subindex))
        self.known[index, subindex] = data
        self._transfer = None
        return what, {"index": index, "subindex": subindex, "data": data, "text": "" if before is None else before.hex()}


def _broken(rule: str, text: str) -> tuple[str, dict[str, object]]:
    return "broken", {"data": rule.encode(), "text": text}
