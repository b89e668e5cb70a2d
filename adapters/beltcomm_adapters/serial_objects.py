"""Objects of a drive over its RS-232 line, and the commands beside them.

What may be repeated: a read, once.  A write never blindly: when its echo is missing or garbled the object is read, and only a drive that
says itself that it has another value, or that it refused, gets it again.  So a setpoint is never taken twice.
"""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable, Iterator
from typing import Final

from beltcomm.drive.objects import TYPES, name_of
from beltcomm.errors import BusError, DriveError
from beltcomm_adapters.sdo import SAVE, SAVE_PLACE, SAVE_TIME_S, Objects, Place, refusal
from beltcomm_adapters.serial_line import ANSWER_TIME_S, BITRATES, QUIET_TIME_S, Abort, Line, ObjectAnswer, SerialLine, Text

#: Characters of ``?XXXXSU`` with its end, of the head of an answer ``=XXXXSU:`` with the answer's end, and of the longest answer.
_REQUEST, _HEAD, _LONGEST = 8, 9, 17
_ATTEMPTS: Final = 2
RESET_TIME_S: Final = 10.0
#: s: what both ends are given for a change of bit rate.
_SWITCH_TIME_S: Final = 0.05
_DONE, _ERROR = Text("DONE"), Text("ERROR!")


class SerialObjects(Objects):
    """The object dictionary of the drive on a line.

    Attributes
    ----------
    answer_time_s, quiet_s
        How long an answer is waited for, and silence after one that did not come; shorter while the axis moves.
    """

    def __init__(self, line: SerialLine) -> None:
        super().__init__()
        self._line = line
        self.clock = line.clock
        self.answer_time_s, self.quiet_s = ANSWER_TIME_S, QUIET_TIME_S

    def read_bytes(self, index: int, subindex: int = 0) -> bytes:
        """Content of an object.  How long the content is, nobody knows: a cut answer shows only beside another one."""
        before = self._read(index, subindex, None)
        for _ in range(_ATTEMPTS):
            again = self._read(index, subindex, None)
            if len(again) == len(before):
                return again
            before = again
        raise self._nonsense(index, subindex, "read", "its answers differ in length")

    def read(self, index: int, subindex: int, kind: str) -> float:
        """Value of an object.  Raises DriveError for content of another width than the type's, too."""
        layout = TYPES[kind][0]
        value: float = struct.unpack(layout, self._read(index, subindex, kind))[0]
        return value

    def read_text(self, index: int, subindex: int = 0) -> str:
        """Nothing: texts do not travel on this line."""
        return ""

    @contextlib.contextmanager
    def impatient(self, time_s: float) -> Iterator[None]:
        """Inside the block an answer must come in this time: the axis moves meanwhile.

        Parameters
        ----------
        time_s : float
            The drive's own, beside that of the characters.
        """
        try:
            self.answer_time_s = self.quiet_s = time_s
            yield
        finally:
            self.answer_time_s, self.quiet_s = ANSWER_TIME_S, QUIET_TIME_S

    def poll(self, index: int, kind: str) -> tuple[int, float] | None:
        """A whole number, asked for once, and the middle of the time in which it was taken, s; None without a valid answer.

        Parameters
        ----------
        index : int
        kind : str
            CiA type of whole numbers.
        """
        layout, line = TYPES[kind][0], self._line
        width = struct.calcsize(layout)
        answer = self._ask(_reading(index, 0), _answer_to(index, 0))
        if not isinstance(answer, ObjectAnswer) or len(answer.data) != width:
            return None
        number: int = struct.unpack(layout, answer.data)[0]
        # the drive looks between the last character of the request and the first of its answer
        return number, 0.5 * (line.asked_s + line.seconds(_REQUEST) + line.answered_s - line.seconds(_HEAD + 2 * width))

    def write_bytes(self, index: int, subindex: int, data: bytes, verb: str) -> None:
        """Content into an object."""
        self.locks.check(index, subindex, data)
        asked, answer = ObjectAnswer(index, subindex, data), None
        for _ in range(_ATTEMPTS):
            answer = self._ask(asked.text, _answer_to(index, subindex))
            if answer == asked:
                return
            if not isinstance(answer, Abort) and self._read(index, subindex, None) == data:
                return
        if isinstance(answer, Abort):
            raise refusal(index, subindex, verb, answer.code)
        raise self._nonsense(index, subindex, verb, "it was not taken")

    def save(self, place: Place = SAVE_PLACE, value: int = SAVE, time_s: float | None = None) -> None:
        """Store the parameters in the drive for good: ``SAVE!``, sent once, because nobody can ask whether it was done."""
        answer = self._line.ask("SAVE!", lambda line: line in (_DONE, _ERROR), longest=7, time_s=SAVE_TIME_S)
        if answer is None:
            raise BusError(
                f"the drive did not say within {SAVE_TIME_S:.0f} s that it has saved its parameters; switch it off and on and compare them"
            )
        if answer == _ERROR:
            raise DriveError("the drive did not save its parameters (ERROR!); take its stage off and try again")

    def version(self) -> str:
        """Name that the firmware gives itself, ``VERSION?`` -> ``2300:VERSION:MMMM.SSSS``; "" when it does not say."""
        answer = self._line.ask("VERSION?", lambda line: isinstance(line, Text) and "VERSION:" in line.words, longest=40)
        return answer.words.rpartition("VERSION:")[2] if isinstance(answer, Text) else ""

    def find(self) -> None:
        """Bring this end to the bit rate at which a drive answers: that after a reset first.  Raises BusError when none does."""
        for bitrate in (BITRATES[0], *BITRATES[:0:-1]):
            self._line.set_bitrate(bitrate)
            self._line.settle()
            self._line.tell("")  # ends what somebody may have begun to type
            if self._answers():
                return
        rates = ", ".join(map(str, BITRATES))
        raise BusError(
            f"no drive answers on {self._line.port.name} at {rates} bit/s; check that it is on, the cable, that no other program has the "
            "port open, and whether the drive wants RTS/CTS (write ,rtscts behind the port's name)"
        )

    def change_bitrate(self, bitrate: int) -> None:
        """Both ends to another bit rate; the drive may also stay at the present one.

        Parameters
        ----------
        bitrate : int
            Bit/s.

        Raises
        ------
        BusError
            When it answers at neither.
        """
        before = self._line.bitrate
        if bitrate == before:
            return
        self._line.tell(f"BAUD{bitrate}")
        for rate in (bitrate, before):
            self._line.set_bitrate(rate)
            self._line.pump(_SWITCH_TIME_S)
            if self._answers():
                return
        raise BusError(
            f"the drive on {self._line.port.name} was lost while changing from {before} to {bitrate} bit/s; switch it off and on"
        )

    def reset(self) -> None:
        """``RESET!``: the drive starts anew at 9600 bit/s, its boot text is skipped.  Raises BusError when it does not come back."""
        self._line.tell("RESET!")
        self._line.set_bitrate(BITRATES[0])
        end_s = self._line.clock.now() + RESET_TIME_S
        while not self._answers():
            if self._line.clock.now() > end_s:
                raise BusError(f"the drive on {self._line.port.name} did not come back within {RESET_TIME_S:.0f} s after its reset")

    def _ask(self, request: str, fits: Callable[[Line], bool]) -> Line | None:
        return self._line.ask(request, fits, longest=_LONGEST, time_s=self.answer_time_s, quiet_s=self.quiet_s)

    def _answers(self) -> bool:
        """True if a drive answers at the present bit rate."""
        for _ in range(_ATTEMPTS):
            answer = self._ask(_reading(0x1000, 0), _answer_to(0x1000, 0))
            if isinstance(answer, (ObjectAnswer, Abort)):
                return True
        return False

    def _read(self, index: int, subindex: int, kind: str | None) -> bytes:
        """Content of an object; of the type's width where a type is known."""
        width = struct.calcsize(TYPES[kind][0]) if kind else None
        answer: Line | None = None
        for _ in range(_ATTEMPTS):
            answer = self._ask(_reading(index, subindex), _answer_to(index, subindex))
            if isinstance(answer, ObjectAnswer) and width in (None, len(answer.data)):
                return answer.data
        if isinstance(answer, Abort):
            raise refusal(index, subindex, "read", answer.code)
        if isinstance(answer, ObjectAnswer):
            raise DriveError(
                f"object {name_of(index, subindex)} has {len(answer.data)} bytes, expected is {kind}; is the profile right, is the line "
                "undisturbed?"
            )
        raise self._nonsense(index, subindex, "read", "it does not understand" if answer else "nothing came")

    def _nonsense(self, index: int, subindex: int, verb: str, what: str) -> BusError:
        return BusError(
            f"the drive on {self._line.port.name} gave no valid answer to {verb} of object {name_of(index, subindex)} in {_ATTEMPTS} "
            f"attempts ({what}); check the cable and its shield, that the drive is on, and that it was not restarted: then it is back at "
            f"{BITRATES[0]} bit/s"
        )


def _reading(index: int, subindex: int) -> str:
    return f"?{index:04X}{subindex:02X}"


def _answer_to(index: int, subindex: int) -> Callable[[Line], bool]:
    """Lines that can answer a request about this object; those about others are answers to earlier requests."""
    place = (index, subindex)
    return lambda line: (
        (line.index, line.subindex) == place if isinstance(line, ObjectAnswer) else isinstance(line, Abort) or line == _ERROR
    )
