"""Objects of a drive by number: typed reads and writes, by SDO (CiA 301, 7.2.4) or another carrier, and values lent for a while.

The SDO protocol is the stock ``canopen`` client; its waiting is replaced, because it expects a receiving thread.
"""

from __future__ import annotations

import logging
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Final, TypeVar

import can
from canopen.objectdictionary import ObjectDictionary
from canopen.sdo.client import SdoClient
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from beltcomm.drive import Clock
from beltcomm.drive.objects import COMMUNICATION, TYPES, name_of, packed
from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm_adapters.interrupts import deferred_interrupt
from beltcomm_adapters.link import Link
from beltcomm_adapters.locks import Locks

# The client logs every abort as an error; here an abort is an exception with its own words.
logging.getLogger("canopen").addHandler(logging.NullHandler())

ANSWER_TIME_S: Final = 0.3
SAVE_TIME_S: Final = 15.0
#: s: a bus that is off or a plug that is loose may come back within this time, tried again after every such pause.
RECOVERY_S: Final = 5.0
RETRY_S: Final = 0.2
#: A transfer that nobody answers is begun anew: a lost frame is no reason to give up, and some servers take 300 ms and more, so that the
#: answer to the first attempt comes in the second.  Waits over the usual one: of a node that has answered, and of one that never has.
_PATIENCE: Final = (1.0, 1.0, 1.0, 1.0, 1.0)
_FIRST_PATIENCE: Final = (1.0, 2.0, 4.0)
#: An answer is waited for as long as the slowest so far took, times this; at most so long, s, as is one that two transfers in a row lacked.
_OVER_SLOWEST, _LONGEST_ANSWER_S = 3.0, 3.0
#: Client commands that begin a transfer, and answers that name its object (CiA 301, 7.2.4.3); an abort names it too.
_DOWNLOAD, _UPLOAD, _NAMING, _ABORT = 1, 2, (2, 3), 0x80
#: Toggle bit not alternated, or no transfer to go on with: a frame came twice, which is no word of the drive on the object.  A long text
#: has many segments, so it is begun anew more often.
_OUT_OF_STEP: Final = (0x05030000, 0x05040001)
_STEPS: Final = 10
#: Share of requests answered twice from which on two nodes may have one number, and how often their places are asked for then.
_TWINS, _ASKED = 0.8, 4
Place = tuple[int, int, str]  # index, subindex, data type
#: Object that keeps parameters, and "save", CiA 301, 7.5.2.13.
SAVE_PLACE: Final[Place] = (0x1010, 1, "uint32")
SAVE: Final = 0x65766173
#: Abort codes of a drive that has no such object, or no such part of it.
ABSENT: Final = (0x06020000, 0x06090011)

_Result = TypeVar("_Result")


#: Multiplexor of aborts that name no object.
_ANY: Final = bytes(3)


class _Client(SdoClient):
    """Stock client that waits by pumping the link.   asked, doubled : requests, and answers beyond one to each.

    differ : a second answer was not the first one.   answer_time_s : s, by the answers seen.   doubt : that much longer is waited.
    """

    RETRY_DELAY = 0.0

    def __init__(self, link: Link, locks: Locks) -> None:
        super().__init__(0x600 + link.node, 0x580 + link.node, ObjectDictionary())  # type: ignore[no-untyped-call]  # canopen has no types
        self.network = self  # type: ignore[assignment]  # all that is asked of a network is send_message
        self.answer_time_s = ANSWER_TIME_S
        self.patience = self.doubt = 1.0
        self.answered = self._again = False
        self._asked_s = 0.0
        self._object = self._previous = b""
        self.asked = self.doubled = 0
        self.differ = False
        self._answers: dict[bytes, bytes] = {}
        self._link = link
        self._locks = locks
        link.subscribe(self.tx_cobid, self._on_frame)

    def download(self, index: int, subindex: int, data: bytes, force_segment: bool = False) -> None:
        """Every write goes through here.   Raises ObjectLocked."""
        self._locks.check(index, subindex, data)
        super().download(index, subindex, data, force_segment)

    def send_message(self, cob_id: int, data: bytes) -> None:
        while (message := self._link.receive(0.0)) is not None:  # a doubled or late answer must not pass for the one to this request
            self._link.dispatch(message)
        while not self.responses.empty():
            self._second(self.responses.get_nowait())
        if data[0] >> 5 in (_DOWNLOAD, _UPLOAD):
            self._previous, self._object = self._object, bytes(data[1:4])
        self.asked += 1
        self._asked_s = self._link.clock.now()
        self._link.send_data(cob_id, bytes(data))

    def _on_frame(self, message: can.Message) -> None:
        data = bytes(message.data)
        if len(data) != 8 or ((data[0] == _ABORT or data[0] >> 5 in _NAMING) and data[1:4] not in (self._object, _ANY)):
            if len(data) == 8 and data[1:4] == self._previous:
                self._second(data)
            return  # of another transfer: it comes late
        self.responses.put(data)

    def _second(self, data: bytes) -> None:
        self.doubled += 1
        self.differ |= self._answers.get(data[1:4], data) != data

    def follow(self, again: bool) -> None:
        """A transfer is over; ``again``: it was begun anew.  When two in a row were, answers may come late, and more time is given.

        Until one comes at the first attempt: then its time is known, and where frames got lost or changed places, every further one would
        be waited for in vain, for seconds each.
        """
        if again and self._again:
            self.doubt = min(2.0 * self.doubt, max(_LONGEST_ANSWER_S / self.answer_time_s, 1.0))
        elif not again:
            self.doubt = 1.0
        self._again = again

    def read_response(self) -> bytes:
        end_s = self._asked_s + self.patience * self.doubt * self.answer_time_s
        while self.responses.empty():
            left_s = end_s - self._link.clock.now()
            if left_s <= 0:
                raise SdoCommunicationError("no answer")
            self._link.pump(left_s)
        response: bytes = self.responses.get_nowait()
        self.answered = True
        self._answers[response[1:4]] = response
        took_s = self._link.clock.now() - self._asked_s
        self.answer_time_s = max(self.answer_time_s, min(_OVER_SLOWEST * took_s, _LONGEST_ANSWER_S))
        if response[0] == _ABORT:
            raise SdoAbortedError(struct.unpack_from("<L", response, 4)[0])
        return response


class Objects(ABC):
    """The object dictionary of one drive, one transfer at a time; a carrier brings ``read_bytes``, ``write_bytes`` and ``save``.

    Attributes
    ----------
    clock : Clock
        Of its carrier. node : number on its bus, 0 where there is no bus. locks : what is never written, whoever asks.
    """

    clock: Clock
    node = 0

    def __init__(self) -> None:
        self.locks = Locks()
        self.taken_as_written: set[tuple[int, int, int]] = set()  # limits that were read back

    @property
    def twice(self) -> bool:
        """True if two nodes answer."""
        return False

    @abstractmethod
    def read_bytes(self, index: int, subindex: int = 0) -> bytes:
        """Raw content of an object, little endian; raises ObjectRefused when the drive aborts, BusError when it does not answer."""

    @abstractmethod
    def write_bytes(self, index: int, subindex: int, data: bytes, verb: str) -> None:
        """Raw content into an object, once ``locks`` allow it; raises ObjectLocked, ObjectRefused, BusError."""

    @abstractmethod
    def save(self, place: Place = SAVE_PLACE, value: int = SAVE, time_s: float | None = None) -> None:
        """Make all parameters permanent by one object, given by index, subindex and type, within ``time_s``; None for the usual patience.

        Raises ObjectRefused when the drive aborts, BusError when it does not answer.
        """

    def read(self, index: int, subindex: int, kind: str) -> float:
        """Value of an object.

        Parameters
        ----------
        index, subindex : int
        kind : str
            A key of :data:`beltcomm.drive.objects.TYPES`.

        Returns
        -------
        float
            As it stands on the wire, in the drive's own units.

        Raises
        ------
        ObjectRefused
            When the drive aborts.
        BusError
            When it does not answer.
        DriveError
            When it holds fewer bytes than its type.
        """
        raw = self.read_bytes(index, subindex)
        layout = TYPES[kind][0]
        if len(raw) < struct.calcsize(layout):
            raise DriveError(f"object {name_of(index, subindex)} has {len(raw)} bytes, expected is {kind}; is the profile right?")
        value: float = struct.unpack_from(layout, raw)[0]
        return value

    def read_int(self, index: int, subindex: int, kind: str) -> int:
        """Value of an object that is a whole number; all else as of :meth:`read`."""
        return int(self.read(index, subindex, kind))

    def read_if_there(self, index: int, subindex: int, kind: str) -> int | None:
        """Value of an object that a drive need not have, None when it has none; all else as of :meth:`read`."""
        return _if_there(lambda: self.read_int(index, subindex, kind))

    def bytes_if_there(self, index: int) -> bytes | None:
        """Raw content of an object with subindex 0, None where the drive has none; raises ObjectRefused when it is there and not told,
        BusError.
        """
        return _if_there(lambda: self.read_bytes(index))

    def read_text(self, index: int, subindex: int = 0) -> str:
        """Content of a VISIBLE_STRING object, "" when the drive has none; raises BusError when it does not answer."""
        try:
            return self.read_bytes(index, subindex).rstrip(b"\x00").decode("ascii", "replace").strip()
        except ObjectRefused:
            return ""

    def write(self, index: int, subindex: int, kind: str, value: float) -> None:
        """Write an object.

        Parameters
        ----------
        index, subindex : int
        kind : str
            A key of :data:`beltcomm.drive.objects.TYPES`.
        value : float
            As it stands on the wire, in the drive's own units.

        Raises
        ------
        ObjectLocked
            For one that is never written.
        ObjectRefused
            When the drive aborts.
        BusError
            When it does not answer.
        DriveError
            When the value does not fit its type.
        """
        try:
            data = packed(kind, value)
        except ValueError as error:
            raise DriveError(f"the value {value:g} does not fit into object {name_of(index, subindex)} ({kind})") from error
        shown = f"{int(value):X}h" if index in COMMUNICATION and kind != "real32" else f"{value:.10g}"  # identifiers, not amounts
        self.write_bytes(index, subindex, data, f"write {shown}")

    def lend(self) -> Lending:
        """A context in which objects are changed for a while."""
        return Lending(self)


class SdoObjects(Objects):
    """Objects of a CANopen node."""

    def __init__(self, link: Link) -> None:
        super().__init__()
        self._client = _Client(link, self.locks)
        self.clock = link.clock
        self.node = link.node

    def read_bytes(self, index: int, subindex: int = 0) -> bytes:
        """Content of an object, by an SDO upload."""
        return self._transfer(index, subindex, "read", lambda: self._client.upload(index, subindex))

    def write_bytes(self, index: int, subindex: int, data: bytes, verb: str) -> None:
        """Content into an object, by an SDO download."""
        self._transfer(index, subindex, verb, lambda: self._client.download(index, subindex, data))

    def save(self, place: Place = SAVE_PLACE, value: int = SAVE, time_s: float | None = None) -> None:
        """Store the parameters in the drive for good, with the patience that takes."""
        usual_s, self._client.answer_time_s = self._client.answer_time_s, time_s or SAVE_TIME_S
        self._client.doubt = 1.0
        try:
            self.write(*place, value)
        finally:
            self._client.answer_time_s = usual_s

    @property
    def twice(self) -> bool:
        """True if nearly every request so far was answered more than once, with answers that differ."""
        return self._client.doubled > _TWINS * self._client.asked and self._differ()

    def _differ(self) -> bool:
        """True if answers that come twice are not the same: two axes stand at different places, an adapter that doubles frames is one."""
        if not self._client.differ:
            for _ in range(_ASKED):
                self.read_if_there(0x6064, 0, "int32")
        return self._client.differ

    def _transfer(self, index: int, subindex: int, verb: str, transfer: Callable[[], _Result]) -> _Result:
        unanswered = out_of_step = 0
        while True:
            patience = _PATIENCE if self._client.answered else _FIRST_PATIENCE
            self._client.patience = patience[min(unanswered, len(patience) - 1)]
            try:
                found = transfer()
                self._client.follow(again=bool(unanswered))
                return found
            except SdoAbortedError as error:
                out_of_step += error.code in _OUT_OF_STEP
                if error.code not in _OUT_OF_STEP or out_of_step == _STEPS:
                    raise refusal(index, subindex, verb, error.code) from error
            except SdoCommunicationError as error:
                unanswered += 1
                if unanswered >= len(patience):
                    waited_s = sum(patience) * self._client.doubt * self._client.answer_time_s
                    raise BusError(
                        f"node {self.node} gave no valid answer to {verb} of object {name_of(index, subindex)} in {unanswered} attempts "
                        f"over {waited_s:.1f} s ({error}); "
                        + (
                            "it has answered before: look whether it is still on, then at the load of the bus, the adapter and the cable"
                            if self._client.answered
                            else "check that the drive is on, its node number, the bit rate and the cable"
                        )
                    ) from error


def _if_there(read: Callable[[], _Result]) -> _Result | None:
    """Result of a read; None where the drive has no such object."""
    try:
        return read()
    except ObjectRefused as error:
        if error.abort_code in ABSENT:
            return None
        raise


def abort_text(code: int) -> str:
    """Meaning of an abort code, with the code behind it.

    Parameters
    ----------
    code : int
        CiA 301, table 22.
    """
    return f"{SdoAbortedError.CODES.get(code, 'no standard text')} (abort code {code:08X}h)"


def refusal(index: int, subindex: int, verb: str, code: int) -> ObjectRefused:
    """The exception for an abort code.

    Parameters
    ----------
    index, subindex : int
    verb : str
        What was tried: read, write 3.
    code : int
        As the drive sent it.

    Returns
    -------
    ObjectRefused
        With what to look at.
    """
    what = f"{verb} to" if verb.startswith("write") else verb
    return ObjectRefused(
        f"the drive refused to {what} object {name_of(index, subindex)}: {abort_text(code)}; "
        "check that the profile is the drive's (--profile) and that no other master is at work",
        code,
        index,
        subindex,
    )


class Lending:
    """Objects changed for a while: the first value of each is kept, and put back in reverse order.

    As a context manager it gives everything back on the way out; what cannot be given back is a DriveError, or a note on the exception
    that is already under way.

    Attributes
    ----------
    refused
        What the drive has and did not let be written, of what it could do without.
    altered
        What it took otherwise, in words, with the object.
    """

    def __init__(self, objects: Objects) -> None:
        self._objects = objects
        self.refused: list[ObjectRefused] = []
        self.altered: dict[str, int] = {}
        self._lent: list[tuple[int, int, str, float]] = []
        self._unchanged: set[tuple[int, int]] = set()  # lent, but what stands there is what is to be given back

    def set(self, index: int, subindex: int, kind: str, value: float, *, keep: bool = False) -> None:
        """Write a value and remember what stood there; raises as :meth:`Objects.write`.

        With ``keep`` it is lent although nothing changes, as where a session that was cut off has left this value: what stood there before
        is
        owed.
        """
        before = self._objects.read(index, subindex, kind)
        if before == value and not keep:
            return
        self._lent.append((index, subindex, kind, before))  # first, so that an interrupted write is undone as well
        if before == value:
            self._unchanged.add((index, subindex))
            return
        self._unchanged.discard((index, subindex))
        try:
            self._objects.write(index, subindex, kind, value)
        except ObjectRefused:
            self._lent.pop()
            raise

    def keep(self, index: int, subindex: int, kind: str) -> None:
        """Remember what stands in an object, for whoever writes it afterwards; raises as :meth:`Objects.read`."""
        self._unchanged.discard((index, subindex))
        self._lent.append((index, subindex, kind, self._objects.read(index, subindex, kind)))

    def set_if_there(self, index: int, subindex: int, kind: str, value: float) -> bool:
        """Write an object that a drive need not have, and remember what stood there; raises as :meth:`Objects.write`.

        False when the drive has no such object, or does not let it be written: then :attr:`refused` tells.
        """
        try:
            self.set(index, subindex, kind, value)
        except ObjectRefused as error:
            if error.abort_code not in ABSENT:
                self.refused.append(error)
            return False
        return True

    def lent(self) -> list[tuple[int, int, str, float]]:
        """Objects that will be given back: index, subindex, type and the value that each object had."""
        first = {(index, subindex): (index, subindex, kind, before) for index, subindex, kind, before in reversed(self._lent)}
        return list(reversed(first.values()))

    def promise(self, index: int, subindex: int, value: float) -> bool:
        """Give another value back in place of the one found; False when the object is not lent."""
        for number, (i, s, kind, _) in enumerate(self._lent):
            if (i, s) == (index, subindex):
                self._unchanged.discard((i, s))
                self._lent[number] = (i, s, kind, value)
                return True
        return False

    def give_back(self) -> list[str]:
        """Put everything back, last change first.  Returns what could not be, in words; never raises a DriveError.

        A bus that is off gets ``RECOVERY_S`` to come back; a drive that does not answer at all is then asked no more.
        """
        failures = []
        give_up_s: float | None = None
        refused: set[tuple[int, int]] = set()
        while self._lent:
            index, subindex, kind, before = self._lent.pop()
            if (index, subindex) in self._unchanged:
                continue
            try:
                self._objects.write(index, subindex, kind, before)
            except BusError as error:
                now_s = self._objects.clock.now()
                give_up_s = now_s + RECOVERY_S if give_up_s is None else give_up_s
                if now_s < give_up_s:
                    self._lent.append((index, subindex, kind, before))
                    self._objects.clock.sleep_until(now_s + RETRY_S)
                    continue
                names = ", ".join(name_of(*entry) for entry in [(index, subindex), *((i, s) for i, s, *_ in reversed(self._lent))])
                self._lent.clear()
                failures.append(f"the objects {names} could not be set back: {error}")
            except DriveError as error:
                if (index, subindex) not in refused:  # once may be a passing state of the drive
                    refused.add((index, subindex))
                    self._lent.append((index, subindex, kind, before))
                    self._objects.clock.sleep_until(self._objects.clock.now() + RETRY_S)
                    continue
                failures.append(f"object {name_of(index, subindex)} could not be set back to {before:.10g}: {error}")
        return failures

    def __enter__(self) -> Lending:
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        with deferred_interrupt():
            failures = self.give_back()
        if not failures:
            return
        text = "; ".join(failures)
        if error is None:
            raise DriveError(f"{text}; switch the drive off and on to get its stored parameters back")
        error.add_note(text)
