"""The text protocol of serial CAN adapters ("slcan", LAWICEL CAN232 manual), on the adapter's side of a pseudo-terminal or of TCP.

A command is a line that ends with CR; the answer is CR, with text before it where there is something to tell, or BEL for a refusal.
Frames pass while the channel is open, between ``O`` and ``C``; a host that does not read loses them, as it does with a real adapter.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
from collections import deque
from typing import Final, Protocol

import can

from beltcomm.errors import BusError
from beltcomm.posix import terminal_pair

_CR, _BEL = b"\r", b"\a"
#: Answers to what asks for nothing but a word: version, serial number, status flags.
_ASKED: Final = {"V": "V1013", "v": "v0100", "N": "NBC01", "F": "F00"}
#: Settings of a real adapter's controller and time stamps off, taken without effect.
_TAKEN: Final = frozenset({"", "S", "s", "W", "M", "m", "X", "Z0"})
_LONGEST_LINE: Final = 32
#: Bytes that wait for a host that does not read; beyond them frames are lost.
_LONGEST_QUEUE: Final = 1 << 16
_CHUNK: Final = 4096


class ByteLine(Protocol):
    """Bytes to and from one host at a time; nothing blocks."""

    #: How a host finds the other end, as the scheme ``slcan`` takes it.
    address: str

    def fileno(self) -> int:
        """Descriptor to wait on for bytes, or for a host."""
        ...

    def read(self) -> bytes | None:
        """Bytes that are there; None when a host has come or gone and the channel begins anew."""
        ...

    def write(self, data: bytes) -> int:
        """Send; returns the number of bytes taken."""
        ...

    def forget(self) -> None:
        """Drop what was sent and nobody has read."""
        ...

    def close(self) -> None:
        """Give everything back; idempotent."""
        ...


class SlcanTerminal:
    """A :class:`ByteLine` on a pseudo-terminal, which looks like a serial port.   Raises BusError where the system has none."""

    def __init__(self) -> None:
        pair = terminal_pair()
        if pair is None:
            raise BusError("this system gives no pseudo-terminal; use --on socket:PORT")
        self._here, self._there = pair.here, pair.there  # our own hold on the other end: without it, a host that leaves would end us
        os.set_blocking(self._here, False)
        self._forget, self.address = pair.forget, pair.path

    def fileno(self) -> int:
        """Descriptor to wait on."""
        return self._here

    def read(self) -> bytes | None:
        """Bytes that have come."""
        try:
            return os.read(self._here, _CHUNK)
        except BlockingIOError:
            return b""

    def write(self, data: bytes) -> int:
        """Send bytes."""
        try:
            return os.write(self._here, data)
        except BlockingIOError:
            return 0

    def forget(self) -> None:
        """Drop what has come unread."""
        self._forget()

    def close(self) -> None:
        """Close the line."""
        for end in (self._here, self._there):
            with contextlib.suppress(OSError):
                os.close(end)


class LocalSocket:
    """A :class:`ByteLine` over TCP on 127.0.0.1; the next host is taken when the one before has gone.

    Parameters
    ----------
    port : int
        0 chooses a free one.

    Raises
    ------
    BusError
        When it is taken.
    """

    def __init__(self, port: int) -> None:
        self._listening = socket.socket()
        try:
            self._listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listening.bind(("127.0.0.1", port))
            self._listening.listen(1)
        except (OSError, OverflowError) as error:
            self._listening.close()
            raise BusError(f"nothing can be served on port {port}: {error}; choose another one, above 1023") from error
        self._listening.setblocking(False)
        self._host: socket.socket | None = None
        self.address = f"socket://127.0.0.1:{self._listening.getsockname()[1]}"

    def fileno(self) -> int:
        """Descriptor to wait on."""
        return (self._host or self._listening).fileno()

    def read(self) -> bytes | None:
        """Bytes that have come."""
        if self._host is None:
            with contextlib.suppress(BlockingIOError):
                self._host, _ = self._listening.accept()
                self._host.setblocking(False)
                # many small lines each way: none may wait for the acknowledgement of the one before
                self._host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return None
        try:
            data = self._host.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._host.close()
            self._host = None
            return None
        return data

    def write(self, data: bytes) -> int:
        """Send bytes."""
        if self._host is None:
            return len(data)
        try:
            return self._host.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            return len(data)  # the host has gone; reading will find that out

    def forget(self) -> None:
        """Do nothing: what is on its way cannot be called back."""

    def close(self) -> None:
        """Close the line."""
        if self._host is not None:
            self._host.close()
        self._listening.close()


class SlcanAdapter:
    """The adapter between a :class:`ByteLine` and classic CAN frames.

    Attributes
    ----------
    lost
        Frames that a host did not read in time.
    """

    def __init__(self, line: ByteLine) -> None:
        self._line = line
        self._received: deque[can.Message] = deque()
        self._begun = b""
        self._begin_anew()
        self.lost = 0

    def recv(self, timeout: float) -> can.Message | None:
        """The next frame from the host; None when none is complete after it, or sooner."""
        if not self._received:
            self._pass_on()
            readable, _, _ = select.select([self._line], [], [], max(timeout, 0.0))
            if readable:
                self._feed(self._line.read())
        return self._received.popleft() if self._received else None

    def send(self, message: can.Message) -> None:
        """A frame to the host, while the channel is open."""
        if not self._open:
            return
        if len(self._waiting) > _LONGEST_QUEUE:
            self.lost += 1
            return
        letter = "r" if message.is_remote_frame else "t"
        data = "" if message.is_remote_frame else bytes(message.data).hex().upper()
        self._answer(f"{letter}{message.arbitration_id:03X}{message.dlc:d}{data}".encode() + _CR)

    def shutdown(self) -> None:
        """Close the line."""
        self._line.close()

    def _begin_anew(self) -> None:
        self._open = self._listening_only = False
        self._begun = b""
        self._waiting = bytearray()

    def _feed(self, data: bytes | None) -> None:
        if data is None:
            self._begin_anew()
            return
        *lines, self._begun = (self._begun + data).split(_CR)
        for line in lines:
            self._answer(self._obey(line))
        if len(self._begun) > _LONGEST_LINE:  # no command is so long: somebody speaks something else
            self._begun = b""
            self._answer(_BEL)

    def _answer(self, data: bytes) -> None:
        self._waiting += data
        self._pass_on()

    def _pass_on(self) -> None:
        while self._waiting:
            taken = self._line.write(bytes(self._waiting))
            if not taken:
                return
            del self._waiting[:taken]

    def _obey(self, line: bytes) -> bytes:
        """The answer to a command; what is no command is refused, never an error of ours."""
        text = line.decode("ascii", "replace").strip("\n")
        letter = text[:1]
        if letter in ("t", "T", "r", "R"):
            return self._transmit(text)
        if letter == "C":
            self._begin_anew()
            self._line.forget()
            return _CR
        if text in ("O", "L"):
            if self._open:
                return _BEL
            self._open, self._listening_only = True, text == "L"
            return _CR
        if text in _ASKED:
            return _ASKED[text].encode() + _CR
        if letter in _TAKEN or text in _TAKEN:
            return _CR
        return _BEL

    def _transmit(self, text: str) -> bytes:
        extended, remote = text[0].isupper(), text[0] in "rR"
        digits = 8 if extended else 3
        try:
            identifier, length = int(text[1 : 1 + digits], 16), int(text[1 + digits])
            data = b"" if remote else bytes.fromhex(text[2 + digits :])
            if not self._open or self._listening_only or len(text) < 2 + digits or len(data) != (0 if remote else length):
                return _BEL
            message = can.Message(
                arbitration_id=identifier, is_extended_id=extended, is_remote_frame=remote, dlc=length, data=data or None, check=True
            )
        except (ValueError, IndexError):
            return _BEL
        self._received.append(message)
        return _CR
