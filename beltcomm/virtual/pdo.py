"""Process data objects: remapping, SYNC and event-driven transmission (CiA 301, 7.2.2 and 7.5.2.35 to 7.5.2.38).

A mapping is compiled when its PDO becomes valid, so that a cycle costs one ``struct`` call.  Refusals: anything but the
COB-ID written while the PDO is valid is 08000022h; a mapping entry while their number is not 0 is 06010000h.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Literal

from beltcomm.virtual.dictionary import ObjectDictionary, ObjectEntry, ObjectRow, SdoAbort
from beltcomm.virtual.emcy import Code
from beltcomm.virtual.objects import PDO_COUNT, PDO_INVALID, PDO_NO_RTR

_EXTENDED = 1 << 29
_LAST_SYNC_TYPE, _SAMPLED, _REQUESTED, _CYCLIC, _ON_CHANGE = 240, 252, 253, 254, 255
_LONGEST_BITS = 64
_GAPS: tuple[tuple[int, Literal["i8", "i16", "i32", "u8", "u16", "u32"], int], ...] = (
    (2, "i8", 8),
    (3, "i16", 16),
    (4, "i32", 32),
    (5, "u8", 8),
    (6, "u16", 16),
    (7, "u32", 32),
)
#: Data types that a receive PDO may map to leave a gap (CiA 301, 7.4.7.1).
_DUMMIES = {index << 16 | bits: ObjectRow(index, 0, kind, "wo", 0, "dummy", pdo="r") for index, kind, bits in _GAPS}


@dataclass(frozen=True)
class PdoRules:
    """Abilities of a drive with its PDOs.

    Attributes
    ----------
    types : frozenset[int]
        Transmission types it takes.
    type_254_is_cyclic : bool
        A transmit PDO of type 254 is sent every inhibit time.
    dummies : bool
        Receive PDOs map data types as gaps.
    remote : bool
        Remote frames are answered where bit 30 of the COB-ID allows it.
    """

    types: frozenset[int] = frozenset({*range(1, _LAST_SYNC_TYPE + 1), _CYCLIC, _ON_CHANGE})
    type_254_is_cyclic: bool = False
    dummies: bool = False
    remote: bool = False
    ticks_per_ms: float = 1.0


#: All that CiA 301 has.
EVERY_TYPE = frozenset({*range(_LAST_SYNC_TYPE + 1), _SAMPLED, _REQUESTED, _CYCLIC, _ON_CHANGE})


def _restricted(identifier: int) -> bool:
    """Identifiers that no PDO may use (CiA 301, table 41)."""
    return (
        identifier < 0x81
        or 0x101 <= identifier <= 0x180
        or 0x581 <= identifier <= 0x5FF
        or 0x601 <= identifier <= 0x67F
        or identifier >= 0x6E0
    )


def _packer(pack: Callable[..., bytes], entries: Sequence[ObjectEntry]) -> Callable[[], bytes]:
    """Maker of the frame of these objects as they are then; two or three, which go out every period, without a list between."""
    if len(entries) == 2:
        first, second = entries
        return lambda: pack(first.value, second.value)
    if len(entries) == 3:
        one, two, three = entries
        return lambda: pack(one.value, two.value, three.value)
    return lambda: pack(*[entry.value for entry in entries])


class _Pdo:
    """One PDO: its communication and mapping objects, and what follows from them."""

    def __init__(
        self, dictionary: ObjectDictionary, communication: int, mapping: int, reconfigured: Callable[[], None], rules: PdoRules
    ) -> None:
        self._dictionary, self._rules = dictionary, rules
        self._direction = "r" if communication < 0x1800 else "t"
        self._reconfigured = reconfigured
        self._cob_id = dictionary.entry(communication, 1)
        self._type = dictionary.entry(communication, 2)
        self._inhibit = dictionary.entry(communication, 3) if dictionary.has(communication, 3) else None
        self._count = dictionary.entry(mapping, 0)
        self._slots = [dictionary.entry(mapping, sub) for sub in range(1, int(self._count.row.high or 0) + 1)]
        self._cob_id.check, self._cob_id.changed = self._check_cob_id, self._configure_anew
        self._type.check, self._type.changed = self._check_type, self._configure_anew
        if self._inhibit is not None:
            self._inhibit.check = self._check_free
        self._count.check = self._check_count
        for slot in self._slots:
            slot.check = self._check_slot
        self.enabled = False
        self.identifier = 0
        self.synchronous = False
        self.sync_type = 0  # 1 to 240, else 0
        self.entries: list[ObjectEntry] = []
        self._struct = struct.Struct("<")

    def configure(self) -> None:
        """Take the objects' values over."""
        cob_id = self._cob_id.value
        self.enabled = not cob_id & PDO_INVALID
        self.identifier = cob_id & 0x7FF
        kind = self._type.value
        self.sync_type = kind if kind <= _LAST_SYNC_TYPE else 0
        self.synchronous = kind <= _LAST_SYNC_TYPE or kind == _SAMPLED
        self.entries = [self._mapped(slot.value) for slot in self._slots[: self._count.value]]
        self._struct = struct.Struct("<" + "".join(entry.row.code[1] for entry in self.entries))
        self.restart()

    def restart(self) -> None:
        """Nothing has been sent or received yet."""
        raise NotImplementedError

    def _configure_anew(self) -> None:
        self.configure()
        self._reconfigured()

    def _mapped(self, mapping: int) -> ObjectEntry:
        if self._direction == "r" and mapping in _DUMMIES and self._rules.dummies:
            return ObjectEntry(_DUMMIES[mapping])
        return self._dictionary.seen(mapping >> 16, mapping >> 8 & 0xFF)

    def _check_free(self, value: int) -> int:
        if self.enabled and self._cob_id.row.access == "rw":  # one that is always valid is set while it is
            raise SdoAbort(SdoAbort.WRONG_STATE)
        return value

    def _check_cob_id(self, value: int) -> int:
        identifier = value & 0x7FF
        if value & _EXTENDED or (not value & PDO_INVALID and _restricted(identifier)):
            raise SdoAbort(SdoAbort.BAD_VALUE)
        if self.enabled and not value & PDO_INVALID and identifier != self.identifier:
            raise SdoAbort(SdoAbort.WRONG_STATE)
        return value if self._rules.remote and self._direction == "t" else value | PDO_NO_RTR

    def _check_type(self, value: int) -> int:
        self._check_free(value)
        if value not in self._rules.types or (self._direction == "r" and value in (_SAMPLED, _REQUESTED)):
            raise SdoAbort(SdoAbort.BAD_VALUE)
        return value

    def _check_count(self, value: int) -> int:
        self._check_free(value)
        mapped = [slot.value for slot in self._slots[:value]]
        if sum(mapping & 0xFF for mapping in mapped) > _LONGEST_BITS:
            raise SdoAbort(SdoAbort.PDO_TOO_LONG)
        if 0 in mapped:
            raise SdoAbort(SdoAbort.NOT_MAPPABLE)
        return value

    def _check_slot(self, value: int) -> int:
        self._check_free(value)
        if self._count.value != 0:
            raise SdoAbort(SdoAbort.UNSUPPORTED_ACCESS)
        if value != 0:
            row = self._mapped(value).row
            if self._direction not in row.pdo or value & 0xFF != 8 * row.length:
                raise SdoAbort(SdoAbort.NOT_MAPPABLE)
        return value


class _ReceivePdo(_Pdo):
    """A PDO from the host to the drive."""

    def restart(self) -> None:
        self.waiting: bytes | None = None
        self.length = self._struct.size
        self._plain = [(i, e) for i, e in enumerate(self.entries) if not e.needs_check and e.changed is None]
        self._watched = [(i, e) for i, e in enumerate(self.entries) if e.needs_check or e.changed is not None]

    def apply(self, data: bytes, calls: list[Callable[[], None]]) -> None:
        """Store the values; appends to ``calls`` what is to be called when the values of all PDOs are stored.

        A value that the object refuses leaves it as it was: a PDO has no answer.
        """
        values = self._struct.unpack_from(data)
        for position, entry in self._plain:
            entry.value = values[position]
        for position, entry in self._watched:
            if values[position] != entry.value:
                try:
                    self._dictionary.store(entry, values[position])
                except SdoAbort:
                    continue
                if entry.changed is not None:
                    calls.append(entry.changed)


class _TransmitPdo(_Pdo):
    """A PDO from the drive to the host."""

    def __init__(
        self,
        dictionary: ObjectDictionary,
        number: int,
        reconfigured: Callable[[], None],
        send: Callable[[int, bytes], None],
        rules: PdoRules,
    ) -> None:
        super().__init__(dictionary, 0x1800 + number, 0x1A00 + number, reconfigured, rules)
        self._send = send
        self._event_timer = dictionary.entry(0x1800 + number, 5) if dictionary.has(0x1800 + number, 5) else None
        if self._event_timer is not None:
            self._event_timer.check = self._check_free

    def restart(self) -> None:
        self._syncs = 0
        self._sent: bytes | None = None
        self._sent_at = 0
        self._data = _packer(self._struct.pack, self.entries)
        self._sampled: bytes | None = None

    @property
    def remote(self) -> bool:
        """True if a remote frame is answered."""
        return self._rules.remote and not self._cob_id.value & PDO_NO_RTR

    def on_request(self) -> None:
        """A remote frame: what was sampled at the last SYNC, or what is there now."""
        if self._type.value == _SAMPLED:
            if self._sampled is not None:
                self._send(self.identifier, self._sampled)
        else:
            self._send(self.identifier, self._data())

    def on_sync(self) -> None:
        """One SYNC; type n goes out with every n-th, type 0 when something has changed, type 252 keeps a sample."""
        if self.sync_type == 0:
            data = self._data()
            if self._type.value == _SAMPLED:
                self._sampled = data
            elif data != self._sent:
                self._sent = data
                self._send(self.identifier, data)
            return
        self._syncs += 1
        if self._syncs >= self.sync_type:
            self._syncs = 0
            self._send(self.identifier, self._data())

    def on_tick(self, tick: int) -> None:
        """Types 254 and 255: on change, not sooner than the inhibit time, and whenever the event timer runs out."""
        if self._type.value == _REQUESTED:
            return
        per_ms = self._rules.ticks_per_ms
        inhibit_ticks = ceil(self._inhibit.value * per_ms / 10.0 - 1e-9) if self._inhibit is not None else 0
        timer_ticks = self._event_timer.value * per_ms if self._event_timer is not None else 0
        waited = tick - self._sent_at
        if self._sent is not None:
            cyclic = self._rules.type_254_is_cyclic and self._type.value == _CYCLIC
            if cyclic:
                if waited < max(inhibit_ticks, 1):
                    return
            elif waited < inhibit_ticks or (self._data() == self._sent and not (timer_ticks and waited >= timer_ticks)):
                return
        self._sent, self._sent_at = self._data(), tick
        self._send(self.identifier, self._sent)


class PdoSet:
    """The receive and the transmit PDOs that the drive has.

    send(identifier, data) : puts a frame on the bus.   report(code) : sends an emergency that is no fault.

    Attributes
    ----------
    receivers
        Identifier -> handler of the valid receive PDOs while the node is operational.
    asked
        Identifier -> what answers a remote frame.
    """

    def __init__(
        self,
        dictionary: ObjectDictionary,
        send: Callable[[int, bytes], None],
        report: Callable[[int], None],
        rules: PdoRules,
    ) -> None:
        self._report = report
        self._receive = [
            _ReceivePdo(dictionary, 0x1400 + n, 0x1600 + n, self._sort, rules) for n in range(PDO_COUNT) if dictionary.has(0x1400 + n, 1)
        ]
        self._transmit = [_TransmitPdo(dictionary, n, self._sort, send, rules) for n in range(PDO_COUNT) if dictionary.has(0x1800 + n, 1)]
        self._operational = False
        self.receivers: dict[int, Callable[[bytes], None]] = {}
        self.asked: dict[int, Callable[[], None]] = {}
        self._sync_receive: list[_ReceivePdo] = []
        self._sync_transmit: list[_TransmitPdo] = []
        self._event_transmit: list[_TransmitPdo] = []

    def configure(self) -> None:
        """Take over all objects, after a reset."""
        for pdo in (*self._receive, *self._transmit):
            pdo.configure()
        self._sort()

    def set_operational(self, operational: bool) -> None:
        """PDOs live in the NMT state operational only; what was waiting is forgotten."""
        self._operational = operational
        for pdo in (*self._receive, *self._transmit):
            pdo.restart()
        self._sort()

    def on_sync(self) -> None:
        """SYNC: first the samples of this tick go out, then what was received since the last SYNC becomes active."""
        for pdo in self._sync_transmit:
            pdo.on_sync()
        calls: list[Callable[[], None]] = []
        for receive_pdo in self._sync_receive:
            if receive_pdo.waiting is not None:
                receive_pdo.apply(receive_pdo.waiting, calls)
                receive_pdo.waiting = None
        for call in calls:
            call()

    def on_tick(self, tick: int) -> None:
        """Event-driven transmit PDOs."""
        for pdo in self._event_transmit:
            pdo.on_tick(tick)

    def _sort(self) -> None:
        """After a change of validity: who hears what."""
        receive = [pdo for pdo in self._receive if pdo.enabled and self._operational]
        transmit = [pdo for pdo in self._transmit if pdo.enabled and self._operational]
        self.receivers = {pdo.identifier: self._receiver(pdo) for pdo in receive}
        self.asked = {pdo.identifier: pdo.on_request for pdo in transmit if pdo.remote}
        self._sync_receive = [pdo for pdo in receive if pdo.synchronous]
        self._sync_transmit = [pdo for pdo in transmit if pdo.synchronous]
        self._event_transmit = [pdo for pdo in transmit if not pdo.synchronous]

    def _receiver(self, pdo: _ReceivePdo) -> Callable[[bytes], None]:
        length, synchronous = pdo.length, pdo.synchronous

        def receive(data: bytes) -> None:
            if len(data) != length:
                if len(data) < length:
                    self._report(Code.PDO_TOO_SHORT)
                    return
                self._report(Code.PDO_TOO_LONG)
            if synchronous:
                pdo.waiting = data
            else:
                calls: list[Callable[[], None]] = []
                pdo.apply(data, calls)
                for call in calls:
                    call()

        return receive
