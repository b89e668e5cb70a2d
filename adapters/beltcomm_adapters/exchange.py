"""The cyclic exchange with a drive: SYNC out, setpoints out, samples in (CiA 301, 7.2.2).

A frame with setpoints that follows SYNC k becomes active at SYNC k+1; the sample that answers SYNC k is taken at SYNC k.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import can

from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm_adapters.link import INTERFACE_ERRORS, NMT_PRE_OPERATIONAL, NMT_START, Link
from beltcomm_adapters.sdo import Lending, Objects

_INVALID: Final = 1 << 31
_NO_REMOTE: Final = 1 << 30
#: PDOs of each direction that a drive of this profile has at most, as far as they are looked at.
_PDOS: Final = 4
#: CiA 301 object of communication and of mapping, and base identifier, of the first PDO of each direction.
_PDO: Final = {"receive": (0x1400, 0x1600, 0x200), "transmit": (0x1800, 0x1A00, 0x180)}
_PDO_STEP: Final = 0x100
#: Share of a period after which an answer is given up; the rest is for sending the next SYNC in time.
_WAIT_SHARE: Final = 0.8
#: s: stamps of frames that run away from the clock by more, from one sample to the next, are of a clock that was set.
_CLOCK_SET_S: Final = 0.5
#: A SYNC later than this share of a period moves the grid instead of being followed by a burst.
_LATE_SHARE: Final = 0.25

#: What the drive sends: position, torque, statusword · velocity, torque demand.
TRANSMITTED: Final = (
    ((0x6064, 0, 32), (0x6077, 0, 16), (0x6041, 0, 16)),
    ((0x606C, 0, 32), (0x6074, 0, 16)),
)
_FIRST: Final = struct.Struct("<ihH")
_SECOND: Final = struct.Struct("<ih")
_SECOND_WITHOUT_DEMAND: Final = struct.Struct("<i")


class Sample(NamedTuple):
    """What a drive answered to one SYNC, in its own units; ``demand`` is None when the drive has no 6074h."""

    stamp_s: float
    position: int
    torque: int
    statusword: int
    velocity: int
    demand: int | None


#: A named tuple's own constructor is a Python function.
_sample: Final = tuple.__new__

MappedObject = tuple[int, int, int]  # index, subindex, length in bits


def map_pdo(
    objects: Objects, lending: Lending, direction: Literal["receive", "transmit"], number: int, entries: Sequence[MappedObject]
) -> int:
    """Map ``entries`` into PDO ``number`` (from 0), synchronous in every cycle, and enable it.  Returns its identifier.

    Written only while the PDO is invalid, its identifier too, and the mapping only while its count is 0 (CiA 301, 7.5.2.36, F1 p26-27).
    Bit 30 stays as it is: a drive without remote frames refuses to allow them.
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
    for subindex, (index, part, bits) in enumerate(entries, start=1):
        lending.set(mapping, subindex, "uint32", index << 16 | part << 8 | bits)
    lending.set(mapping, 0, "uint8", len(entries))
    lending.set(communication, 1, "uint32", kept | cob_id)
    return cob_id


def silence(objects: Objects, lending: Lending, direction: Literal["receive", "transmit"], first: int) -> None:
    """Switch off the PDOs from number ``first`` on: what somebody left enabled there loads the bus, or writes setpoints."""
    communication = _PDO[direction][0]
    for number in range(first, _PDOS):
        found = objects.read_if_there(communication + number, 1, "uint32")
        if found is not None and not found & _INVALID:
            lending.set(communication + number, 1, "uint32", _INVALID | found)


class Exchange:
    """SYNC-driven exchange at a fixed period; started by :meth:`start`, one :meth:`cycle` per period.

    lost : cycles without a complete answer.     lost_in_a_row : the latest such cycles.
    """

    def __init__(self, link: Link, objects: Objects, lending: Lending, period_s: float, received: Sequence[Sequence[MappedObject]]):
        self._link = link
        self._period_s = period_s
        self.lost = 0
        self.lost_in_a_row = 0
        rpdos = [map_pdo(objects, lending, "receive", number, entries) for number, entries in enumerate(received)]
        self._first = map_pdo(objects, lending, "transmit", 0, TRANSMITTED[0])
        try:
            self._second = map_pdo(objects, lending, "transmit", 1, TRANSMITTED[1])
            self._has_demand = True
        except ObjectRefused:  # 6074h is optional in CiA 402
            self._second = map_pdo(objects, lending, "transmit", 1, TRANSMITTED[1][:1])
            self._has_demand = False
        silence(objects, lending, "receive", len(rpdos))
        silence(objects, lending, "transmit", len(TRANSMITTED))
        self._out = [can.Message(arbitration_id=cob_id, is_extended_id=False) for cob_id in rpdos]
        for message, entries in zip(self._out, received, strict=True):
            message.dlc = sum(bits for *_, bits in entries) // 8
        self._sync = can.Message(arbitration_id=0x80, is_extended_id=False)
        self._next_s = 0.0
        self._before: tuple[float, float] | None = None  # stamp of the last sample, and when it had been asked for

    def start(self) -> None:
        """Let the node exchange PDOs (NMT operational); the first SYNC is due one period from now."""
        self._link.send_nmt(NMT_START)
        self._next_s = self._link.clock.now() + self._period_s

    def end(self) -> None:
        """Back to pre-operational, where the node exchanges no PDOs."""
        self._link.send_nmt(NMT_PRE_OPERATIONAL)

    def cycle(self, frames: Sequence[bytes]) -> Sample | None:
        """One period: wait for its time, SYNC, then ``frames`` (one per receive PDO), then the answer to this SYNC.

        Returns None when the answer did not come in time, or is stamped no later than the last one; it is dropped when it comes later.
        Raises BusError (the interface is gone, the clock of its stamps was set), DriveError (an answer that is not what was mapped).
        """
        link, due_s, period_s = self._link, self._next_s, self._period_s
        clock, send, receive = link.clock, link.bus.send, link.bus.recv
        clock.sleep_until(due_s)
        now_s = clock.now()
        self._next_s = (due_s if now_s - due_s <= _LATE_SHARE * period_s else now_s) + period_s
        try:
            # what has arrived before a SYNC, late or doubled, must not pass for its answer: all rows would be a period late from then on
            while (message := receive(0.0)) is not None:
                link.dispatch(message)
            send(self._sync)
            for out, data in zip(self._out, frames):  # noqa: B905  # as many as mapped; a check per cycle costs time
                out.data = bytearray(data)
                send(out)
            if now_s >= link.life_due_s:
                link.show_life(now_s)
            sample = self._answer(now_s + _WAIT_SHARE * period_s)
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
        link, first_id, second_id = self._link, self._first, self._second
        receive = link.bus.recv
        wait_s = _WAIT_SHARE * self._period_s
        first: can.Message | None = None
        second: can.Message | None = None
        while first is None or second is None:
            message = receive(wait_s)
            if message is None:
                return None
            cob_id = message.arbitration_id
            if cob_id == first_id and not message.is_error_frame:
                first = message
            elif cob_id == second_id and not message.is_error_frame:
                second = message
            else:
                link.dispatch(message)
                wait_s = end_s - link.clock.now()
                if wait_s <= 0:
                    return None
        if link.clock.now() > end_s:  # it could be that of a late drive, and the next one come right behind it
            return None
        try:
            position, torque, statusword = _FIRST.unpack(first.data)
            if self._has_demand:
                velocity, demand = _SECOND.unpack(second.data)
            else:
                (velocity,), demand = _SECOND_WITHOUT_DEMAND.unpack(second.data), None
        except struct.error as error:
            raise DriveError(
                f"the drive's synchronous answers have {len(first.data)} and {len(second.data)} bytes, mapped were 8 and 6; "
                "another master is changing its PDOs"
            ) from error
        return _sample(Sample, (first.timestamp, position, torque, statusword, velocity, demand))

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
