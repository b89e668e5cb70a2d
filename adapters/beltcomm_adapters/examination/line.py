"""A drive on RS-232: does the port open, at which baud rate does it answer, does it echo, does it need handshake lines.

The ASCII object protocol of the Metronix family (F2 p22, F3 p237): CR ends a line, ``VERSION?`` is answered ``2300:VERSION:MMMM.SSSS``,
``?604100`` is answered ``=604100:`` and four hex digits.  Nothing else is sent.
"""

from __future__ import annotations

import errno
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from beltcomm.drive import Clock
from beltcomm.drive.finding import Finding
from beltcomm.errors import UsageError
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.cia402 import state_of
from beltcomm_adapters.examination.host import group_of
from beltcomm_adapters.examination.surroundings import permission

AREA: Final = "serial line"
#: 9600 after every reset; the rest can be set (F3 p237, F6).
BAUDS: Final = (9600, 115200, 57600, 38400, 19200)
#: s: 30 characters at 9600 take 31 ms, firmware some ms; an answer that takes longer is none.
_ANSWER_S: Final = 0.3
_VERSION: Final = re.compile(rb"\w*:?VERSION:[0-9A-F]{4}\.[0-9A-F]{4}", re.IGNORECASE)
_STATUSWORD: Final = re.compile(rb"=604100:([0-9A-F]{4})$", re.IGNORECASE)


class PortLike(Protocol):
    """As much of pyserial's port as is used here."""

    def read(self, size: int = 1) -> bytes:
        """Bytes that have come, fewer than asked for when no more come within the port's time-out.

        Parameters
        ----------
        size : int
            At most.
        """
        ...

    def write(self, data: bytes, /) -> int | None:
        """Send."""
        ...

    def reset_input_buffer(self) -> None:
        """Forget what has come in."""
        ...

    def close(self) -> None:
        """Release the port."""
        ...


#: Opens the port: (device, baud rate, handshake by RTS/CTS) -> port.
Opener = Callable[[str, int, bool], Any]


def _open_port(device: str, baud: int, handshake: bool) -> Any:
    """A port of pyserial.  Raises OSError (serial.SerialException is one), ValueError."""
    import serial

    return serial.serial_for_url(  # type: ignore[no-untyped-call]  # pyserial has no types
        device, baudrate=baud, rtscts=handshake, timeout=0.02
    )


@dataclass(frozen=True)
class LineAnswer:
    """Answer of a serial line.

    Attributes
    ----------
    noise : bool
        Bytes that are no ASCII came in.
    """

    answers: tuple[bytes, ...]
    noise: bool
    seconds: float


def examine_line(
    device: str,
    options: Mapping[str, object],
    *,
    opener: Opener = _open_port,
    clock: Clock | None = None,
    group: Callable[[str], str] = group_of,
) -> Iterator[Finding]:
    """Examine the drive behind a serial port.

    Parameters
    ----------
    device : str
        Path of the port.
    options : Mapping[str, object]
        ``bitrate``, the one baud rate to try.
    opener : Opener
        Opens it at a bit rate.
    clock : Clock or None
        None for the monotonic one.
    group : callable
        Owner of a device file.

    Raises
    ------
    UsageError
        Without a device.
    """
    if not device:
        raise UsageError("say which serial port: serial:/dev/ttyUSB0 (`beltcomm doctor` lists them)")
    clock = clock or MonotonicClock()
    wanted = options.get("bitrate")
    bauds = BAUDS if wanted is None else (int(str(wanted)),)
    noisy = []
    for handshake in (False, True):
        for baud in bauds:
            try:
                port = opener(device, baud, handshake)
            except (OSError, ValueError) as error:
                yield not_opened(AREA, device, error, group(device))
                return
            try:
                said = _ask(port, clock, b"VERSION?")
                if any(map(_VERSION.search, said.answers)):
                    yield from _talking(port, clock, device, baud, handshake, said)
                    return
            except OSError as error:
                yield _lost(device, error)
                return
            finally:
                port.close()
            if said.answers or said.noise:
                noisy.append(baud)
    yield _silent(device, bauds, noisy)


def _ask(port: PortLike, clock: Clock, question: bytes) -> LineAnswer:
    """Send a line and collect the lines that come back, at most 0.3 s after the last byte.   Raises OSError."""
    port.reset_input_buffer()
    port.write(b"\r")  # ends whatever stands half-typed in the drive
    _read(port, clock, 0.05)
    port.reset_input_buffer()
    begun_s = clock.now()
    port.write(question + b"\r")
    raw = _read(port, clock, _ANSWER_S)
    seconds = clock.now() - begun_s
    lines = tuple(line.strip() for line in re.split(rb"[\r\n]+", raw) if line.strip())
    noise = any(byte > 126 or (byte < 32 and byte not in b"\r\n\0") for byte in raw)
    return LineAnswer(lines, noise, seconds)


def _read(port: PortLike, clock: Clock, wait_s: float) -> bytes:
    """Everything until the line is quiet after its end."""
    raw, end_s = b"", clock.now() + wait_s
    while clock.now() < end_s:
        more = port.read(64)
        raw += more
        if not more and raw.endswith(b"\r") and raw.count(b"\r") > raw.count(b"?\r"):  # an echo alone is no answer
            break
    return raw


def _talking(port: PortLike, clock: Clock, device: str, baud: int, handshake: bool, said: LineAnswer) -> Iterator[Finding]:
    version = next(line for line in said.answers if _VERSION.search(line)).decode("ascii", "replace")
    lines = " with RTS/CTS" if handshake else ""
    remedy = "use the handshake lines: the drive answered only with them" if handshake else ""
    yield Finding(
        AREA, "port", "ok", f"a drive answers on {device} at {baud} baud{lines}: {version}", remedy,
        {"baud": baud, "handshake": handshake, "version": version},
    )  # fmt: skip
    if b"VERSION?" in said.answers:
        yield Finding(
            AREA, "echo", "warning", "every line comes back as an echo before its answer", "an adapter or a cable loops it; it is skipped"
        )
    else:
        yield Finding(AREA, "echo", "ok", "no echo of what is sent")
    status = _ask(port, clock, b"?604100")
    words = [match[1] for line in status.answers if (match := _STATUSWORD.match(line))]
    if words:
        word = int(words[0], 16)
        text = f"the drive is in {state_of(word).words} (6041h = {word:04X}h), answered in {1e3 * status.seconds:.0f} ms"
        yield Finding(AREA, "state", "ok", text, "", {"statusword": word})
    else:
        told = ", ".join(line.decode("ascii", "replace") for line in status.answers) or "nothing"
        yield Finding(
            AREA, "state", "wrong", f"the drive answers {told} to ?604100 (its statusword)", "its firmware may not have this protocol"
        )
    yield Finding(
        AREA, "use", "warning", "RS-232 carries parameters, slow moves and friction sweeps, no identification by PRBS",
        "connect the CAN port to commission",
    )  # fmt: skip


def not_opened(area: str, device: str, error: Exception, group: str) -> Finding:
    """Why a serial port does not open.

    Parameters
    ----------
    area : str
        Of the finding.
    device : str
        Path of the port.
    error : Exception
        That opening raised.
    group : str
        That owns it.
    """
    number = getattr(error, "errno", None)
    if number == errno.EACCES or "Permission denied" in str(error):
        text, remedy = f"you may not open {device}", permission(group)
    elif number == errno.EBUSY or "exclusive" in str(error).lower():
        text, remedy = f"another program has {device} open", "close it (FCT, a terminal, ModemManager)"
    elif number == errno.ENOENT or "No such file" in str(error):
        text, remedy = f"there is no serial port {device}", "plug the adapter in; `beltcomm doctor` without --drive lists the ports"
    else:
        text, remedy = f"{device} cannot be opened ({error})", "plug the adapter out and in"
    return Finding(area, "port", "wrong", text, remedy, unreachable=True)


def _lost(device: str, error: Exception) -> Finding:
    return Finding(AREA, "port", "wrong", f"{device} failed while it was used ({error})", "is the adapter plugged in?", unreachable=True)


def _silent(device: str, bauds: tuple[int, ...], noisy: list[int]) -> Finding:
    names = ", ".join(map(str, bauds))
    if noisy:
        text = f"something answers on {device}, but nothing that reads as a drive's version at {names} baud"
        remedy = "the baud rate may be another one (9600 after a reset of the drive), or this is no drive of the Metronix family"
    else:
        text = f"nobody answers on {device} at {names} baud, with or without RTS/CTS"
        remedy = "check that the drive is on, that the cable is the one for its service port (RX and TX crossed), and that FCT is closed"
    return Finding(AREA, "port", "wrong", text, remedy, unreachable=True)
