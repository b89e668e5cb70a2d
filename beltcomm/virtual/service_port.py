"""The RS-232 port of the virtual drive and its service language: characters take their time, and lines go wrong at will.

``?XXXXSU`` reads, ``=XXXXSU:HH`` writes and is echoed, ``!FFFFFFFF`` is an abort code; BAUD, RESET!, SAVE!, VERSION? beside them
(F2 p22, F3 p237).  It has an SDO server of its own, so that every range, access and state is checked as on the bus.

On a pseudo-terminal any program that opens serial ports can talk to it.
"""

from __future__ import annotations

import os
import random
import re
import select
import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType

from beltcomm.errors import UsageError
from beltcomm.posix import terminal_pair
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.dictionary import ObjectDictionary, SdoAbort
from beltcomm.virtual.sdo import SdoServer

BITS_PER_CHARACTER = 10
BOOT_TEXT = "\r\nBOOT 2.1\r\nCRC OK\r\nSTART\r\n"

#: s: from a reset to the first line that is answered.
BOOT_S = 0.3

#: A line that does not end is thrown away.
LONGEST_LINE = 80
BITRATES = (9600, 19200, 38400, 57600, 115200)
VERSION = "2300:VERSION:0001.0000"
ERROR = "ERROR!"
_READ = re.compile(r"\?([0-9A-F]{4})([0-9A-F]{2})")
_WRITE = re.compile(r"=([0-9A-F]{4})([0-9A-F]{2}):([0-9A-F]{2}|[0-9A-F]{4}|[0-9A-F]{8})")
_BAUD = re.compile(r"BAUD(\d+)")
_UPLOAD, _DOWNLOAD, _ABORTED = 0x40, 0x23, 0x80
_SAVE = b"save"


@dataclass
class LineFaults:
    """Faults of this line; shares are probabilities per character or per answer, times are virtual time in s, None is never.

    Attributes
    ----------
    seed : int
        Of everything random here.
    latency_s : float
        The firmware's time for an answer.
    noise : float
        Share of characters, either way, that arrive as others.
    lost, cut, doubled : float
        Share of answers that never come, lose their last characters, come twice.
    slow, slow_s : float
        Share of answers that come so much later.
    wrong_width : float
        Share of values with a byte too many or too few.
    echo : bool
        False: a write is not echoed.
    boots : bool
        The drive is just starting when the port opens.
    restart_at_s : float or None
        The drive starts anew by itself.
    silent_from_s : float or None
        The cable is pulled; the drive itself runs on.
    bitrate_locked : bool
        BAUD is not understood.
    """

    seed: int = 0
    latency_s: float = 0.5e-3
    noise: float = 0.0
    lost: float = 0.0
    cut: float = 0.0
    doubled: float = 0.0
    slow: float = 0.0
    slow_s: float = 0.5
    wrong_width: float = 0.0
    echo: bool = True
    boots: bool = False
    restart_at_s: float | None = None
    silent_from_s: float | None = None
    bitrate_locked: bool = False


class ServicePort:
    """A node of the bus for its time only: what has arrived by a tick is answered in it."""

    def __init__(self, bus: LockstepBus, drive: VirtualDrive, faults: LineFaults | None = None) -> None:
        self.faults = faults or LineFaults()
        self.bitrate = BITRATES[0]
        self._bus, self._drive = bus, drive
        self._random = random.Random(self.faults.seed)
        self._interpreter = AsciiInterpreter(drive.objects, self._set_bitrate, self._restart)
        self._incoming: deque[tuple[float, int]] = deque()
        self._outgoing: deque[tuple[float, int, int]] = deque()
        self._line = bytearray()
        self._deaf_until_s = self._sending_until_s = 0.0
        if self.faults.boots:
            self._boot()
        bus.attach(self)

    # -- the host's end -------------------------------------------------------------------------------------------------

    def send(self, data: bytes, bitrate: int) -> None:
        """Characters from the host, one after the other at its own bit rate; at another than the drive's they arrive as others."""
        start_s = max(self._now_s, self._incoming[-1][0] if self._incoming else 0.0)
        for count, character in enumerate(data, start=1):
            heard = character if bitrate == self.bitrate else self._random.randrange(256)
            self._incoming.append((start_s + count * BITS_PER_CHARACTER / bitrate, self._spoilt(heard)))

    def take(self, bitrate: int) -> bytes:
        """Characters that have reached a host that listens at a bit rate."""
        taken = bytearray()
        while self._outgoing and self._outgoing[0][0] <= self._now_s + 1e-9:
            _, character, sent_at = self._outgoing.popleft()
            if not self._pulled:
                taken.append(self._spoilt(character if bitrate == sent_at else self._random.randrange(256)))
        return bytes(taken)

    # -- the bus --------------------------------------------------------------------------------------------------------

    def receive(self, identifier: int, data: bytes, remote: bool) -> None:
        """Frames are nothing to this port."""

    def begin_tick(self, tick: int) -> None:
        """Whatever has arrived by now; the drive's own samples of this tick are taken already."""
        faults, now_s = self.faults, tick * self._bus.tick_s
        if faults.restart_at_s is not None and now_s >= faults.restart_at_s:
            faults.restart_at_s = None
            self._restart()
        while self._incoming and self._incoming[0][0] <= now_s + 1e-9:
            _, character = self._incoming.popleft()
            if self._pulled or now_s < self._deaf_until_s:
                continue
            if character != 0x0D:
                self._line.append(character)
                if len(self._line) > LONGEST_LINE:
                    self._line.clear()
                continue
            line = self._line.decode("latin-1").strip("\n \0")
            self._line.clear()
            self._answer(line)

    def finish_tick(self) -> None:
        """Nothing moves here."""

    @property
    def _now_s(self) -> float:
        return self._bus.tick * self._bus.tick_s

    @property
    def _pulled(self) -> bool:
        return self.faults.silent_from_s is not None and self._now_s >= self.faults.silent_from_s

    def _answer(self, line: str) -> None:
        faults = self.faults
        if faults.bitrate_locked and line.startswith("BAUD"):
            self._put("ERROR!\r", faults.latency_s)
            return
        answer = self._interpreter.answer(line)
        if answer is None or (answer == line and not faults.echo) or self._happens(faults.lost):
            return
        if answer.startswith("=") and self._happens(faults.wrong_width):
            answer = answer + "00" if self._happens(0.5) or len(answer) == 10 else answer[:-2]
        text = answer + "\r"
        if self._happens(faults.cut):
            kept = self._random.randrange(1, len(answer) + 1)
            text = answer[:kept] + ("\r" if self._happens(0.5) else "")
        delay_s = faults.latency_s + (faults.slow_s if self._happens(faults.slow) else 0.0)
        self._put(text * (2 if self._happens(faults.doubled) else 1), delay_s)

    def _put(self, text: str, delay_s: float) -> None:
        start_s = max(self._now_s + delay_s, self._sending_until_s)
        for count, character in enumerate(text.encode("latin-1"), start=1):
            self._outgoing.append((start_s + count * BITS_PER_CHARACTER / self.bitrate, character, self.bitrate))
        self._sending_until_s = start_s + len(text) * BITS_PER_CHARACTER / self.bitrate

    def _set_bitrate(self, bitrate: int) -> None:
        self.bitrate = bitrate

    def _restart(self) -> None:
        self._drive.reset_node()
        self._boot()

    def _boot(self) -> None:
        """Deaf for a while, at the first bit rate, and talking."""
        self.bitrate = BITRATES[0]
        self._line.clear()
        self._deaf_until_s = self._now_s + BOOT_S
        self._put(BOOT_TEXT, 0.5 * BOOT_S)

    def _happens(self, share: float) -> bool:
        return share > 0.0 and self._random.random() < share

    def _spoilt(self, character: int) -> int:
        return self._random.randrange(256) if self._happens(self.faults.noise) else character


class LockstepPort:
    """The host's end in virtual time: waiting for characters lets the drive run.

    Attributes
    ----------
    name
        For messages.
    bitrate
        Of this end.
    """

    def __init__(self, bus: LockstepBus, port: ServicePort) -> None:
        self.name = "the virtual drive"
        self.bitrate = BITRATES[0]
        self._bus, self._port = bus, port
        self._open = True

    def write(self, data: bytes) -> None:
        """Send; raises OSError after :meth:`close`."""
        self._check()
        self._port.send(data, self.bitrate)

    def read(self, timeout_s: float) -> bytes:
        """Characters that have come; virtual time runs until some have, at most ``timeout_s``.  Raises OSError after :meth:`close`."""
        self._check()
        end_s = self._bus.clock.now() + timeout_s
        while not (data := self._port.take(self.bitrate)) and self._bus.clock.now() < end_s - 1e-9:
            self._bus.advance()
        return data

    def close(self) -> None:
        """Let it go."""
        self._open = False

    def _check(self) -> None:
        if not self._open:
            raise OSError("the port is closed")


class AsciiInterpreter:
    """Answers lines.

    Parameters
    ----------
    set_bitrate : callable
        Of the port, from the next line on.
    reset : callable
        The drive starts anew.
    """

    def __init__(self, objects: ObjectDictionary, set_bitrate: Callable[[int], None], reset: Callable[[], None]) -> None:
        self._sdo = SdoServer(objects)
        self._set_bitrate = set_bitrate
        self._reset = reset

    def answer(self, line: str) -> str | None:
        """The answer to a line without its end; None to what is not answered."""
        if found := _READ.fullmatch(line):
            return self._read(int(found[1], 16), int(found[2], 16))
        if found := _WRITE.fullmatch(line):
            refused = self._write(int(found[1], 16), int(found[2], 16), bytes.fromhex(found[3])[::-1])
            return refused or line
        if (found := _BAUD.fullmatch(line)) and int(found[1]) in BITRATES:
            self._set_bitrate(int(found[1]))
            return None
        if line == "RESET!":
            self._reset()
            return None
        if line == "SAVE!":
            return ERROR if self._write(0x1010, 1, _SAVE) else "DONE"
        return VERSION if line == "VERSION?" else ERROR

    def _read(self, index: int, subindex: int) -> str:
        (answer,) = self._sdo.answer(struct.pack("<BHB4x", _UPLOAD, index, subindex))
        if answer[0] == _ABORTED:
            return _abort(answer)
        if not answer[0] & 2:  # a text, which would need segments
            self._sdo.reset()
            return f"!{SdoAbort.UNSUPPORTED_ACCESS:08X}"
        data = answer[4 : 8 - (answer[0] >> 2 & 3)]
        return f"={index:04X}{subindex:02X}:{data[::-1].hex().upper()}"

    def _write(self, index: int, subindex: int, data: bytes) -> str:
        """Empty when it was written, else the abort."""
        command = _DOWNLOAD | (4 - len(data)) << 2
        (answer,) = self._sdo.answer(struct.pack("<BHB4s", command, index, subindex, data))
        return _abort(answer) if answer[0] == _ABORTED else ""


def _abort(answer: bytes) -> str:
    return f"!{struct.unpack_from('<I', answer, 4)[0]:08X}"


class PseudoTerminal:
    """A pair of terminals; ``path`` is what the other program opens.  Use as a context manager.

    The other program's bit rate is that of the terminal, so that a wrong one garbles here as on a wire.

    Parameters
    ----------
    bus : LockstepBus
        With a wall clock, which paces it.

    Raises
    ------
    UsageError
        On a system without pseudo-terminals.
    """

    def __init__(self, bus: LockstepBus, port: ServicePort) -> None:
        pair = terminal_pair()
        if pair is None:
            raise UsageError("this system has no pseudo-terminals; use serial:virtual inside one program instead")
        self._bus, self._port, self._pair = bus, port, pair
        self._master, self._slave = pair.here, pair.there  # the other end stays open, or the first program to leave would end it
        self.path = pair.path

    def serve(self, goes_on: Callable[[], bool]) -> None:
        """Carry characters and let time pass while ``goes_on()``, asked before each step."""
        while goes_on():
            self.step()

    def step(self) -> None:
        """One tick of the drive."""
        bitrate = self._pair.bitrate() or self._port.bitrate
        if select.select([self._master], [], [], 0.0)[0]:
            self._port.send(os.read(self._master, 4096), bitrate)
        self._bus.advance()
        if answer := self._port.take(bitrate):
            os.write(self._master, answer)

    def close(self) -> None:
        """Let both ends go."""
        os.close(self._master)
        os.close(self._slave)

    def __enter__(self) -> PseudoTerminal:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None) -> None:
        self.close()
