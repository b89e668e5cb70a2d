"""The cyclic exchange with a drive: SYNC out, setpoints out, samples in (CiA 301, 7.2.2).

A frame with setpoints that follows SYNC k becomes active at SYNC k+1; the sample that answers SYNC k is taken at SYNC k.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import can

from beltcomm.drive.objects import name_of
from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm_adapters.link import INTERFACE_ERRORS, NMT_PRE_OPERATIONAL, NMT_START, Link
from beltcomm_adapters.sdo import Lending, Objects, abort_text
from beltcomm_adapters.sync_source import sync_source

_INVALID: Final = 1 << 31
_NO_REMOTE: Final = 1 << 30
#: PDOs of each direction that a drive of this profile has at most, as far as they are looked at.
_PDOS: Final = 4
#: CiA 301 object of communication and of mapping, and base identifier, of the first PDO of each direction.
_PDO: Final = {"receive": (0x1400, 0x1600, 0x200), "transmit": (0x1800, 0x1A00, 0x180)}
_PDO_STEP: Final = 0x100
_FRAME_BITS: Final = 64
#: Share of a period after which an answer is given up; the rest is for sending the next SYNC in time.
_WAIT_SHARE: Final = 0.8
#: s: stamps of frames that run away from the clock by more, from one sample to the next, are of a clock that was set.
_CLOCK_SET_S: Final = 0.5

MappedObject = tuple[int, int, int]  # index, subindex, length in bits

_POSITION, TORQUE, _WORD = (0x6064, 0, 32), (0x6077, 0, 16), (0x6041, 0, 16)
_SPEED, _DEMAND = (0x606C, 0, 32), (0x6074, 0, 16)
#: What the drive sends, the fullest first: a drive that cannot map all of it, or only few bytes, is asked for less.  Without 606Ch the
#: speed is the difference of positions.
ARRANGEMENTS: Final[tuple[tuple[tuple[MappedObject, ...], ...], ...]] = (
    ((_POSITION, TORQUE, _WORD), (_SPEED, _DEMAND)),
    ((_POSITION, TORQUE, _WORD), (_SPEED,)),
    ((_POSITION, TORQUE, _WORD), (_DEMAND,)),
    ((_POSITION, TORQUE, _WORD),),
    ((_POSITION, _WORD), (TORQUE, _DEMAND), (_SPEED,)),
    ((_POSITION, _WORD), (TORQUE,), (_SPEED,)),
    ((_POSITION, _WORD), (TORQUE,)),
    ((_POSITION,), (TORQUE, _WORD)),
    ((_POSITION,), (TORQUE,), (_WORD,)),
)


def arrangements(torque: MappedObject) -> tuple[tuple[tuple[MappedObject, ...], ...], ...]:
    """Those of :data:`ARRANGEMENTS` that frames hold, with the torque from this object.

    Parameters
    ----------
    torque : MappedObject
        Object that holds it.

    Returns
    -------
    tuple of tuple of tuple of MappedObject
        PDOs of each, fullest first.
    """
    found = [tuple(tuple(torque if entry == TORQUE else entry for entry in one) for one in pdos) for pdos in ARRANGEMENTS]
    return tuple(pdos for pdos in found if all(sum(bits for *_, bits in one) <= _FRAME_BITS for one in pdos))


#: What to do about a mapping that a drive refuses.
FREE_MAPPING: Final = (
    "let the mapping be changed with the maker's tool (it may be fixed, or need the node to be pre-operational), or choose --profile"
)
_BY_BITS: Final = {16: "h", 32: "i"}
_CODES: Final = {_POSITION: "i", TORQUE: "h", _WORD: "H", _SPEED: "i", _DEMAND: "h"}


class Sample(NamedTuple):
    """Answer of a drive to one SYNC, in its own units, the torque in those of setpoints; ``demand`` is None when the drive has no 6074h."""

    stamp_s: float
    position: int
    torque: float
    statusword: int
    velocity: int
    demand: int | None


#: A named tuple's own constructor is a Python function.
_sample: Final = tuple.__new__


def map_pdo(
    objects: Objects, lending: Lending, direction: Literal["receive", "transmit"], number: int, entries: Sequence[MappedObject]
) -> int:
    """Map ``entries`` into a PDO, synchronous in every cycle, and enable it.

    Written only while the PDO is invalid, its identifier too, and the mapping only while its count is 0 (CiA 301, 7.5.2.36, F1 p26-27).
    Bit 30 stays as it is: a drive without remote frames refuses to allow them.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    direction : str
        As the drive sees it.
    number : int
        Of the PDO, from 0.
    entries : sequence of MappedObject
        Objects, in their order.

    Returns
    -------
    int
        Its identifier.

    Raises
    ------
    ObjectRefused
        For an object that the drive does not map.
    """
    communication, mapping, base = _PDO[direction]
    communication, mapping = communication + number, mapping + number
    found = objects.read_int(communication, 1, "uint32")
    cob_id = base + _PDO_STEP * number + objects.node
    kept = found & _NO_REMOTE
    lending.set(communication, 1, "uint32", _INVALID | found)
    lending.set(communication, 1, "uint32", _INVALID | kept | cob_id)
    lending.set(communication, 2, "uint8", 1)
    lending.set(mapping, 0, "uint8", 0)
    try:
        for subindex, (index, part, bits) in enumerate(entries, start=1):
            lending.set(mapping, subindex, "uint32", index << 16 | part << 8 | bits)
        lending.set(mapping, 0, "uint8", len(entries))
    except ObjectRefused as error:
        raise _not_mapped(error, direction, mapping, entries) from error
    lending.set(communication, 1, "uint32", kept | cob_id)
    return cob_id


def _not_mapped(error: ObjectRefused, direction: str, mapping: int, entries: Sequence[MappedObject]) -> ObjectRefused:
    """The refusal of a mapping, with the objects that were to be mapped."""
    wanted = entries[error.subindex - 1 : error.subindex] if error.subindex else entries
    named = ", ".join(name_of(index, part) for index, part, _ in wanted)
    return ObjectRefused(
        f"the drive does not let {named} be mapped into its {direction} PDO {name_of(mapping)}: {abort_text(error.abort_code)}; "
        f"{FREE_MAPPING}",
        error.abort_code,
        error.index,
        error.subindex,
    )


def map_answers(objects: Objects, lending: Lending, first: int = 0, torque: MappedObject = TORQUE) -> tuple[int, list[int]]:
    """The fullest of :func:`arrangements` that the drive takes, from number ``first`` on, and the identifiers of its PDOs.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    first : int
        Number of the fullest that is tried.
    torque : MappedObject
        Object that holds it.

    Returns
    -------
    tuple of int and list of int
        Number of the arrangement, and the identifiers of its PDOs.

    Raises
    ------
    ObjectRefused
        Of what cannot be done without, when it takes none.
    """
    refusal: ObjectRefused | None = None
    offered = arrangements(torque)
    for number in range(first, len(offered)):
        try:
            return number, [map_pdo(objects, lending, "transmit", pdo, entries) for pdo, entries in enumerate(offered[number])]
        except ObjectRefused as error:
            refusal = error
    assert refusal is not None
    raise refusal


def _silence(objects: Objects, lending: Lending, direction: Literal["receive", "transmit"], first: int) -> None:
    """Switch off the PDOs from number ``first`` on: what somebody left enabled there loads the bus, or writes setpoints."""
    communication = _PDO[direction][0]
    for number in range(first, _PDOS):
        found = objects.read_if_there(communication + number, 1, "uint32")
        if found is not None and not found & _INVALID:
            lending.set(communication + number, 1, "uint32", _INVALID | found)


class Exchange:
    """SYNC-driven exchange at a fixed period; started by :meth:`start`, one :meth:`cycle` per period.

    lost : cycles without a complete answer.     lost_in_a_row : the latest such cycles.

    Parameters
    ----------
    arrangement : int
        Of the answers, its number.
    speed_unit_s : float
        Units of position per second in one unit of speed, for a drive that sends no speed.
    torque, torque_unit : Place, float
        Object of the torque that acts, and one of its units in units of the setpoint.
    """

    def __init__(
        self,
        link: Link,
        objects: Objects,
        lending: Lending,
        period_s: float,
        received: Sequence[Sequence[MappedObject]],
        arrangement: int = 0,
        speed_unit_s: float = 1.0,
        torque: MappedObject = TORQUE,
        torque_unit: float = 1.0,
    ):
        self._link = link
        self._period_s = period_s
        self.lost = 0
        self.lost_in_a_row = 0
        rpdos = [map_pdo(objects, lending, "receive", number, entries) for number, entries in enumerate(received)]
        self.arrangement, ids = map_answers(objects, lending, arrangement, torque)
        sent = [entry for entries in arrangements(torque)[self.arrangement] for entry in entries]
        codes = {**_CODES, torque: _BY_BITS[torque[2]]}
        self._torque_unit = torque_unit
        self._ids = {cob_id: slot for slot, cob_id in enumerate(ids)}
        self._answers = struct.Struct("<" + "".join(codes[entry] for entry in sent))
        self._order = [sent.index(entry) for entry in (_POSITION, torque, _WORD)]
        self._speed, self._demand = (sent.index(entry) if entry in sent else None for entry in (_SPEED, _DEMAND))
        self._speed_unit_s = speed_unit_s
        _silence(objects, lending, "receive", len(rpdos))
        _silence(objects, lending, "transmit", len(ids))
        self._out = [can.Message(arbitration_id=cob_id, is_extended_id=False) for cob_id in rpdos]
        for message, entries in zip(self._out, received, strict=True):
            message.dlc = sum(bits for *_, bits in entries) // 8
        self._source = sync_source(link, period_s)
        self._last: tuple[float, int] | None = None
        self._before: tuple[float, float] | None = None  # stamp of the last sample, and when it had been asked for

    def start(self) -> None:
        """Let the node exchange PDOs (NMT operational); the first SYNC is due one period from now."""
        self._link.send_nmt(NMT_START)
        self._source.start()

    def end(self) -> None:
        """Back to pre-operational, where the node exchanges no PDOs."""
        self.stop_sync()
        self._link.send_nmt(NMT_PRE_OPERATIONAL)

    def stop_sync(self) -> None:
        """No SYNC any more."""
        self._source.stop()

    def cycle(self, frames: Sequence[bytes]) -> Sample | None:
        """One period: wait for its time, SYNC, then the frames, then the answer to this SYNC.

        Parameters
        ----------
        frames : sequence of bytes
            One per receive PDO.

        Returns
        -------
        Sample or None
            None when the answer did not come in time, or is stamped no later than the last one; it is dropped when it comes later.

        Raises
        ------
        BusError
            The interface is gone, or the clock of its stamps was set.
        DriveError
            For an answer that is not what was mapped.
        """
        link, send = self._link, self._link.bus.send
        try:
            # what has arrived before a SYNC, late or doubled, must not pass for its answer: all rows would be a period late from then on
            now_s = self._source.next()
            if now_s is None:
                self.lost += 1
                self.lost_in_a_row += 1
                return None
            for out, data in zip(self._out, frames):  # noqa: B905  # as many as mapped; a check per cycle costs time
                out.data = bytearray(data)
                send(out)
            if now_s >= link.life_due_s:
                link.show_life(now_s)
            sample = self._answer(now_s + _WAIT_SHARE * self._period_s)
        except INTERFACE_ERRORS as error:
            raise link.gone(error) from error
        if sample is not None:
            sample = self._in_order(sample, now_s)
        if sample is None:
            self.lost += 1
            self.lost_in_a_row += 1
        else:
            self.lost_in_a_row = 0
        return sample

    def _answer(self, end_s: float) -> Sample | None:
        link, ids = self._link, self._ids
        receive = link.bus.recv
        wait_s = _WAIT_SHARE * self._period_s
        found: list[can.Message | None] = [None] * len(ids)
        missing = len(found)
        early = self._source.early
        while missing:
            message = early.popleft() if early else receive(wait_s)
            if message is None:
                return None
            slot = ids.get(message.arbitration_id)
            if slot is not None and not message.is_error_frame:
                missing -= found[slot] is None
                found[slot] = message
            else:
                link.dispatch(message)
                wait_s = end_s - link.clock.now()
                if wait_s <= 0:
                    return None
        if link.clock.now() > end_s:  # it could be that of a late drive, and the next one come right behind it
            return None
        answers = [message for message in found if message is not None]
        try:
            values = self._answers.unpack(b"".join([message.data for message in answers]))
        except struct.error as error:
            lengths = " and ".join(str(len(message.data)) for message in answers)
            raise DriveError(
                f"the drive's synchronous answers have {lengths} bytes, mapped were {self._answers.size} in all; another master is "
                "changing its PDOs"
            ) from error
        stamp_s = answers[0].timestamp
        position, torque, statusword = (values[place] for place in self._order)
        demand = None if self._demand is None else values[self._demand]
        velocity = self._difference(stamp_s, position) if self._speed is None else values[self._speed]
        if self._torque_unit != 1.0:
            torque *= self._torque_unit
        return _sample(Sample, (stamp_s, position, torque, statusword, velocity, demand))

    def _difference(self, stamp_s: float, position: int) -> int:
        """Speed by the change of position since the last sample, in units of speed, where the drive sends none."""
        last, self._last = self._last, (stamp_s, position)
        if last is None or not stamp_s > last[0]:
            return 0
        return round((position - last[1]) / max(stamp_s - last[0], self._period_s) / self._speed_unit_s)

    def _in_order(self, sample: Sample, asked_s: float) -> Sample | None:
        """The sample, None when it is no younger than the one before.   Raises BusError when the clock of its stamp was set."""
        before, self._before = self._before, (sample.stamp_s, asked_s)
        if before is None:
            return sample
        passed_s, jumped_s = sample.stamp_s - before[0], sample.stamp_s - before[0] - (asked_s - before[1])
        if abs(jumped_s) > _CLOCK_SET_S:
            raise BusError(
                f"the clock that stamps the CAN frames was set by {jumped_s:+.1f} s while the axis moved, so that its samples have no "
                "time; the axis was stopped; keep the computer's time from being set (NTP) during a recording and repeat it"
            )
        return sample if passed_s > 0.0 else None
