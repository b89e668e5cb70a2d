"""Objects of a CANopen node in a log of frames: objects read and written by SDO, and what its PDOs carry (CiA 301, 7.2.4, 7.5.2)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from beltcomm.arrays import BoolArray, IntArray
from beltcomm.foreign.framelog import FrameLog

Place = tuple[int, int]
"""Index and subindex of an object."""

_ABORT = 4
#: Answers that name their object: to the first frame of an upload or download, and a refusal (CiA 301, 7.2.4.3).
_NAMING = (2, 3, _ABORT)
#: How far an answer may stand from its request on the wrong side, frames and s: those of one instant change places, no others.
_FRAMES_APART, _SECONDS_APART = 5, 5e-3
_INVALID = 1 << 31
#: Communication and mapping objects of the PDOs, by direction, and the identifiers that CiA 301 gives the first four.
_PDO = {"received": (0x1400, 0x1600, 0x200), "sent": (0x1800, 0x1A00, 0x180)}
_MOST_PDOS = 0x200
#: Mapped in place of an object, to skip bits of a received PDO (CiA 301, 7.4.7).
_DUMMIES = range(0x0001, 0x0020)


class Seen(NamedTuple):
    """One object whose value went over the bus.

    Attributes
    ----------
    frame : int
        Of the confirmation.
    value : bytes
        Its bytes, little endian.
    """

    frame: int
    node: int
    place: Place
    value: bytes
    written: bool


class Pdo(NamedTuple):
    """Mapping of a PDO from a frame on.

    Attributes
    ----------
    number : int
        From 0.
    entries : tuple[tuple[int, int, int], ...]
        (index, subindex, bits) in their order, () while switched off.
    """

    frame: int
    cob_id: int
    direction: str
    number: int
    transmission: int | None
    entries: tuple[tuple[int, int, int], ...]


@dataclass(frozen=True, eq=False)
class ObjectSamples:
    """Values of one object.

    Attributes
    ----------
    frames : ndarray (n,)
        Places in the log, rising.
    raw : ndarray (n,), int64
    synchronous : ndarray (n,)
        Of a PDO that waits for the SYNC.
    """

    frames: NDArray[np.intp]
    raw: IntArray
    synchronous: BoolArray


@dataclass
class _Transfer:
    place: Place = (0, 0)
    frame: int = 0
    upload: bool = False
    data: bytearray = field(default_factory=bytearray)
    last: bool = False


def objects_seen(log: FrameLog) -> list[Seen]:
    """Every SDO transfer that was confirmed, expedited or in segments; aborted ones are none.

    An answer that stands a few frames before its request, or behind the next one, is taken for what it names: a logger with several
    queues exchanges frames of one instant.

    Parameters
    ----------
    log : FrameLog
    """
    return _transfers(log)[0]


def unanswered_mappings(log: FrameLog, node: int) -> list[Place]:
    """Objects of the PDOs of a node that were asked for or written without an answer in the log, each once.

    Parameters
    ----------
    log : FrameLog
    node : int
    """
    open_ones = dict.fromkeys(transfer.place for number, transfer in _transfers(log)[1] if number == node)
    return [place for place in open_ones if _pdo_object(place[0])[0] is not None]


def _transfers(log: FrameLog) -> tuple[list[Seen], list[tuple[int, _Transfer]]]:
    """Transfers that were confirmed, in the order of their confirmations, and those that nobody answered, with their node."""
    conversations: dict[int, _Conversation] = {}
    base = log.identifier & ~0x7F
    node = log.identifier & 0x7F
    mask = ((base == 0x580) | (base == 0x600)) & (node > 0) & ~log.remote & (log.length == 8)
    for frame in np.flatnonzero(mask).tolist():
        number = int(node[frame])
        talk = conversations.setdefault(number, _Conversation(log, number))
        (talk.asked if base[frame] == 0x600 else talk.answered)(frame, log.data[frame].tobytes())
    found = sorted((item for talk in conversations.values() for item in talk.end()), key=lambda item: item.frame)
    return found, [(number, transfer) for number, talk in conversations.items() for transfer in talk.unanswered]


class _Conversation:
    """SDO server of one node: requests whose answer may still come, the last one the transfer under way, and answers without a request.

    unanswered : what was asked and not confirmed, nor refused, at the end.
    """

    def __init__(self, log: FrameLog, node: int) -> None:
        self._log, self._node = log, node
        self._confirmed: list[tuple[Seen, int]] = []  # with the frame of the request
        self.unanswered: list[_Transfer] = []
        self._open: list[_Transfer] = []
        self._early: list[tuple[int, bytes]] = []

    def asked(self, frame: int, data: bytes) -> None:
        """A frame of the client."""
        command, now = data[0] >> 5, self._open[-1] if self._open else None
        self._settle()
        if command in (1, 2):
            self.unanswered += [one for one in self._open if not self._near(one.frame, frame)]
            self._open = [one for one in self._open if self._near(one.frame, frame)]
            transfer = _Transfer(_place(data), frame, command == 2)
            if command == 1 and data[0] & 2:
                transfer.data, transfer.last = _expedited(data), True
            self._open.append(transfer)
        elif command == 0 and now is not None and not now.upload:
            now.data += data[1 : 8 - ((data[0] >> 1) & 7)]
            now.last = bool(data[0] & 1)
        elif command == _ABORT:
            self._open.clear()

    def answered(self, frame: int, data: bytes) -> None:
        """A frame of the node."""
        if data[0] >> 5 not in _NAMING or (data[0] >> 5 == _ABORT and _place(data) == (0, 0)):  # these name nothing
            if self._open:
                self._take(self._open[-1], frame, data)
            return
        meant = next((one for one in self._open if _fits(one, data)), None)
        if meant is None:
            self._early.append((frame, data))
        else:
            self._take(meant, frame, data)

    def end(self) -> list[Seen]:
        """Values that were confirmed, once no frame comes any more; those asked for before another was written are gone."""
        self._settle()
        self.unanswered += self._open
        written: dict[Place, Seen] = {}
        kept = []
        for item, asked in sorted(self._confirmed, key=lambda one: one[0].frame):
            if item.written:
                written[item.place] = item
            last = written.get(item.place, item)
            if last.value == item.value or asked > last.frame or not self._near(last.frame, item.frame):
                kept.append(item)
        return kept

    def _settle(self) -> None:
        """Take an answer that stood before its request, where none came behind it: one that came twice is no answer to what follows."""
        for transfer in list(self._open):
            early = next((one for one in self._early if _fits(transfer, one[1]) and self._near(one[0], transfer.frame)), None)
            if early is not None:
                self._take(transfer, transfer.frame, early[1])
        if self._open:
            self._early = [one for one in self._early if self._near(one[0], self._open[-1].frame)]

    def _take(self, transfer: _Transfer, frame: int, data: bytes) -> None:
        if data[0] >> 5 == _ABORT:
            self._open.remove(transfer)
        elif _completed(transfer, data):
            self._open.remove(transfer)
            seen = Seen(frame, self._node, transfer.place, bytes(transfer.data), not transfer.upload)
            self._confirmed.append((seen, transfer.frame))

    def _near(self, one: int, other: int) -> bool:
        """True if two frames stand next to each other but for a few, at almost the same stamp."""
        return abs(one - other) <= _FRAMES_APART and not abs(self._log.t_s[one] - self._log.t_s[other]) > _SECONDS_APART


def _place(data: bytes) -> Place:
    return int.from_bytes(data[1:3], "little"), data[3]


def _expedited(data: bytes) -> bytearray:
    unused = (data[0] >> 2) & 3 if data[0] & 1 else 0
    return bytearray(data[4 : 8 - unused])


def _fits(transfer: _Transfer, data: bytes) -> bool:
    """True if an answer that names its object is one to this request."""
    return _place(data) == transfer.place and data[0] >> 5 in (_ABORT, 2 if transfer.upload else 3)


def _completed(transfer: _Transfer, data: bytes) -> bool:
    """True if this answer completes the transfer; False when there is more to come."""
    command = data[0] >> 5
    if transfer.upload and command == 2 and data[0] & 2:
        transfer.data = _expedited(data)
        return True
    if transfer.upload and command == 0:
        transfer.data += data[1 : 8 - ((data[0] >> 1) & 7)]
        return bool(data[0] & 1)
    return not transfer.upload and transfer.last and command in (1, 3)


def pdos(seen: list[Seen], node: int) -> list[Pdo]:
    """Every change of what the PDOs of a node carry.   A COB-ID that the log does not show is the one of CiA 301, 7.3.5.

    Parameters
    ----------
    seen : list of Seen
        Transfers of the log.
    node : int
    """
    state: dict[tuple[str, int], dict[str, int]] = {}
    entries: dict[tuple[str, int], dict[int, int]] = {}
    last: dict[tuple[str, int], Pdo] = {}
    changes: list[Pdo] = []
    for item in seen:
        if item.node != node:
            continue
        key, part = _pdo_object(item.place[0])
        if key is None:
            continue
        value = int.from_bytes(item.value, "little")
        if part == "mapping":
            if item.place[1] == 0:
                state.setdefault(key, {})["count"] = value
            else:
                entries.setdefault(key, {})[item.place[1]] = value
        else:
            state.setdefault(key, {})[f"comm{item.place[1]}"] = value
        now = _pdo_now(key, item.frame, state.get(key, {}), entries.get(key, {}), node)
        if now is not None and now[1:] != last.get(key, Pdo(0, 0, "", 0, None, ()))[1:]:
            last[key] = now
            changes.append(now)
    return changes


def _pdo_object(index: int) -> tuple[tuple[str, int] | None, str]:
    for direction, (communication, mapping, _) in _PDO.items():
        for first, part in ((communication, "communication"), (mapping, "mapping")):
            if first <= index < first + _MOST_PDOS:
                return (direction, index - first), part
    return None, ""


def _pdo_now(key: tuple[str, int], frame: int, state: Mapping[str, int], entries: Mapping[int, int], node: int) -> Pdo | None:
    direction, number = key
    cob_id = state.get("comm1", _PDO[direction][2] + 0x100 * number + node if number < 4 else _INVALID)
    count = state.get("count")
    if count is None:
        return None
    valid = not cob_id & _INVALID and 0 < count <= 64 and all(k in entries for k in range(1, count + 1))
    mapped = tuple((e >> 16, (e >> 8) & 0xFF, e & 0xFF) for e in (entries[k] for k in range(1, count + 1))) if valid else ()
    return Pdo(frame, cob_id & 0x7FF, direction, number, state.get("comm2"), mapped)


def samples(log: FrameLog, seen: list[Seen], node: int, signed: frozenset[int]) -> dict[tuple[str, Place], ObjectSamples]:
    """Values of every object that PDOs carried or SDOs wrote, by direction ("sent" by the node, "received" by it).

    Parameters
    ----------
    log : FrameLog
    seen : list of Seen
        Transfers of the log.
    node : int
    signed : frozenset[int]
        Indices of objects that may be negative.
    """
    pieces: dict[tuple[str, Place], list[tuple[NDArray[np.intp], IntArray, BoolArray]]] = {}
    changes = pdos(seen, node)
    for position, change in enumerate(changes):
        pdo = (change.direction, change.number)
        later = [c.frame for c in changes[position + 1 :] if c.cob_id == change.cob_id or (c.direction, c.number) == pdo]
        end = later[0] if later else len(log.t_s)
        if not change.entries or end <= change.frame:
            continue
        size = sum(bits for *_, bits in change.entries)
        mask = log.identifier[change.frame : end] == change.cob_id
        frames = np.flatnonzero(mask & ~log.remote[change.frame : end] & (8 * log.length[change.frame : end] >= size)) + change.frame
        words = log.data[frames]
        waits = np.full(len(frames), change.transmission is None or change.transmission <= 240)
        for index, subindex, first, bits in _placed(change.entries):
            pieces.setdefault((change.direction, (index, subindex)), []).append(
                (frames, bits_of(words, first, bits, index in signed), waits)
            )
    for item in seen:
        if item.node == node and item.written and 0x6000 <= item.place[0] < 0x6800 and 0 < len(item.value) <= 4:
            value = int.from_bytes(item.value, "little", signed=item.place[0] in signed)
            pieces.setdefault(("received", item.place), []).append((np.array([item.frame]), np.array([value]), np.array([False])))
    return {key: _joined(parts) for key, parts in pieces.items()}


def _placed(entries: tuple[tuple[int, int, int], ...]) -> Iterator[tuple[int, int, int, int]]:
    """Index, subindex, first bit and bits of each entry that is an object."""
    first = 0
    for index, subindex, bits in entries:
        if index not in _DUMMIES and 0 < bits <= 64 and first + bits <= 64:
            yield index, subindex, first, bits
        first += bits


def bits_of(words: NDArray[np.uint8], first: int, bits: int, signed: bool) -> IntArray:
    """Little-endian integers of ``bits`` bits from bit ``first`` on.

    Parameters
    ----------
    words : ndarray (n, 8)
    first : int
        Bit, from 0.
    bits : int
        1 to 64.
    signed : bool
        True for two's complement.
    """
    whole = np.ascontiguousarray(words).view("<u8").ravel()
    shifted = (whole << np.uint64(64 - first - bits)) if first + bits < 64 else whole
    if signed:
        return np.asarray(shifted.view(np.int64) >> np.int64(64 - bits), dtype=np.int64)
    return np.asarray((shifted >> np.uint64(64 - bits)).view(np.int64), dtype=np.int64)


def _joined(parts: list[tuple[NDArray[np.intp], IntArray, BoolArray]]) -> ObjectSamples:
    frames, raw, waits = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(frames, kind="stable")
    return ObjectSamples(frames[order], raw[order], waits[order])
