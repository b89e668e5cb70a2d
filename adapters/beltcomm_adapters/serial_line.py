"""The drive's RS-232 line: text lines out and in, one request at a time, at a bit rate that both ends have.

A line ends with CR; ``?XXXXSU`` reads an object, ``=XXXXSU:HH`` writes one and is echoed, ``!FFFFFFFF`` is an abort code
(F2 p22, F3 p237).  There is no checksum and no number on an answer, so whatever came before a request is thrown away, an answer must
name the object that was asked for, and after a missing one another object is asked for first: the drive answers in order, so that with
its answer nothing earlier can come any more, and nothing late passes for the answer to a later request.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from beltcomm.drive import Clock
from beltcomm.errors import BusError
from beltcomm_adapters.link import Emergency

#: Bit rates of the port; every reset leads back to the first (F3 p237, F6).
BITRATES: Final = (9600, 19200, 38400, 57600, 115200)
DEFAULT_BITRATE: Final = 115200
#: Start bit, eight data bits, stop bit.
BITS_PER_CHARACTER: Final = 10
#: How long the drive may think before it answers, beside the time that the characters take.
ANSWER_TIME_S: Final = 0.2
#: Silence after which nothing more is to be expected of an earlier request.
QUIET_TIME_S: Final = 0.1
#: A drive that talks unasked for so long, as one that restarts does, is talking nonsense.
TALK_TIME_S: Final = 5.0
#: Objects that every drive has and nobody else asks for: what tells that the drive has come so far.
_MARKERS: Final = ((0x1001, 0), (0x1005, 0), (0x1018, 1))
#: A line that does not end is none.
_LONGEST_LINE: Final = 200

_VALUE: Final = re.compile(r"=([0-9A-F]{4})([0-9A-F]{2}):([0-9A-F]{2}|[0-9A-F]{4}|[0-9A-F]{8})")
_ABORT: Final = re.compile(r"!([0-9A-F]{8})")
#: What line noise puts around a line; inside one it stays and spoils it.
_STRAY: Final = " \n\t\0"


class Port(Protocol):
    """A serial port, real or simulated.

    Attributes
    ----------
    name : str
        For messages.
    bitrate : int
        Of this end; may be set at any time.
    """

    name: str
    bitrate: int

    def write(self, data: bytes) -> None:
        """Send.

        Raises
        ------
        OSError
        """
        ...

    def read(self, timeout_s: float) -> bytes:
        """Bytes that have come; empty when nothing came in time.

        Parameters
        ----------
        timeout_s : float
            For the first byte.

        Raises
        ------
        OSError
        """
        ...

    def close(self) -> None:
        """Let the port go."""
        ...


@dataclass(frozen=True)
class ObjectAnswer:
    """An object's content, or the echo of a write.

    Attributes
    ----------
    data : bytes
        Little endian, as everywhere in CANopen.
    """

    index: int
    subindex: int
    data: bytes

    @property
    def text(self) -> str:
        """As it stands on the line."""
        return f"={self.index:04X}{self.subindex:02X}:{self.data[::-1].hex().upper()}"


@dataclass(frozen=True)
class Abort:
    """A request was refused (CiA 301, table 22); which one is not said."""

    code: int


@dataclass(frozen=True)
class Text:
    """Anything else: ``DONE``, ``ERROR!``, boot text, noise."""

    words: str


Line = ObjectAnswer | Abort | Text


def _parse(raw: bytes) -> Line:
    """One line without its end.  Never raises: what is no value and no abort is text."""
    words = raw.decode("ascii", "replace").strip(_STRAY)
    if found := _VALUE.fullmatch(words):
        return ObjectAnswer(int(found[1], 16), int(found[2], 16), bytes.fromhex(found[3])[::-1])
    if found := _ABORT.fullmatch(words):
        return Abort(int(found[1], 16))
    return Text(words)


class SerialLine:
    """The host's end of the line.  Single-threaded; nothing arrives unless somebody waits for it.

    emergency, restarted : always None and False, the port reports nothing unasked.

    Attributes
    ----------
    asked_s, answered_s
        When the last request was sent and answered.
    """

    emergency: Emergency | None = None
    restarted = False

    def __init__(self, port: Port, clock: Clock) -> None:
        self.port = port
        self.clock = clock
        self.asked_s = self.answered_s = clock.now()
        self._buffer = bytearray()
        self._unsettled = True  # who knows what the port has kept
        self._owed = False
        self._markers = itertools.cycle(_MARKERS)

    @property
    def bitrate(self) -> int:
        """Of both ends."""
        return self.port.bitrate

    def seconds(self, characters: int) -> float:
        """Time that characters take on the line, s."""
        return characters * BITS_PER_CHARACTER / self.bitrate

    def ask(
        self,
        request: str,
        fits: Callable[[Line], bool],
        *,
        longest: int,
        time_s: float = ANSWER_TIME_S,
        quiet_s: float = QUIET_TIME_S,
    ) -> Line | None:
        """Send a request; the first line that fits, or None when none came in time.

        Parameters
        ----------
        request : str
        fits : callable
            True for its answer.
        longest : int
            Characters of the longest answer.
        time_s : float
            The drive's own time, beside that of the characters.
        quiet_s : float
            Silence to wait for when an earlier request is still owed its answer.

        Raises
        ------
        BusError
        """
        if self._unsettled or self._owed:
            self.settle(quiet_s)
        if self._owed and not self._caught_up(time_s):
            return None
        self._drop()
        self._owed = True  # until the answer has come, whatever interrupts the waiting
        self.asked_s = self.clock.now()
        line = self._exchange(request, fits, time_s + self.seconds(longest))
        if line is not None:
            self.answered_s = self.clock.now()
            self._owed = False
        return line

    def settle(self, quiet_s: float = QUIET_TIME_S) -> None:
        """Drop what comes until nothing has come for a while: late answers, boot text.   Raises BusError when it never ends."""
        end_s = self.clock.now() + TALK_TIME_S
        while self._receive(quiet_s):
            if self.clock.now() > end_s:
                raise BusError(
                    f"something talks on {self.port.name} without being asked; check that a drive's RS-232 port is connected, and nothing "
                    "else uses it"
                )
        self._buffer.clear()
        self._unsettled = False

    def _caught_up(self, time_s: float) -> bool:
        """True if the drive has answered all that it was asked before: it answers another question, each time another one."""
        index, subindex = next(self._markers)
        place = f"={index:04X}{subindex:02X}:"
        self._owed = (
            self._exchange(f"?{place[1:-1]}", lambda line: isinstance(line, ObjectAnswer) and line.text.startswith(place), time_s) is None
        )
        return not self._owed

    def _exchange(self, request: str, fits: Callable[[Line], bool], time_s: float) -> Line | None:
        self._send(request)
        end_s = self.clock.now() + time_s + self.seconds(len(request) + 1)
        while (line := self._next_line(end_s)) is not None:
            if fits(line):
                return line
        return None

    def set_bitrate(self, bitrate: int) -> None:
        """Set the bit rate of this end only; raises BusError."""
        try:
            self.port.bitrate = bitrate
        except (OSError, ValueError) as error:
            raise self._gone(error) from error
        self._unsettled, self._owed = True, False

    def tell(self, text: str) -> None:
        """Send what has no answer, and wait until it is out; raises BusError."""
        self._send(text)
        self._unsettled = True
        self.clock.sleep_until(self.clock.now() + self.seconds(len(text) + 1) + QUIET_TIME_S)

    def pump(self, timeout_s: float) -> bool:
        """Wait: nothing comes unasked."""
        self.clock.sleep_until(self.clock.now() + timeout_s)
        return False

    def forget_emergency(self) -> None:
        """There are none."""

    def _send(self, text: str) -> None:
        try:
            self.port.write(text.encode("ascii") + b"\r")
        except OSError as error:
            raise self._gone(error) from error

    def _receive(self, timeout_s: float) -> bytes:
        try:
            return self.port.read(max(timeout_s, 0.0))
        except OSError as error:
            raise self._gone(error) from error

    def _drop(self) -> None:
        self._buffer.clear()
        while self._receive(0.0):
            pass

    def _next_line(self, end_s: float) -> Line | None:
        while True:
            line, found, rest = self._buffer.partition(b"\r")
            if found:
                self._buffer = rest
                return _parse(bytes(line))
            if len(self._buffer) > _LONGEST_LINE:
                self._buffer.clear()
            left_s = end_s - self.clock.now()
            if left_s <= 0:
                return None
            self._buffer += self._receive(left_s)

    def _gone(self, error: Exception) -> BusError:
        return BusError(f"the serial port {self.port.name} does not send or receive ({error}); check that it is plugged in")
