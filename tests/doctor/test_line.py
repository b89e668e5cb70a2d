"""A drive on RS-232: another implementation of the ASCII protocol on a pseudo-terminal, and ports that fail."""

from __future__ import annotations

import errno
import os
import re
import threading
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from beltcomm.drive.finding import Finding
from beltcomm_adapters.examination.line import examine_line


class Responder:
    """Answers lines on a pseudo-terminal as drive-protocols.md, 5 says.   echo : sends every character back first."""

    def __init__(self, answers: dict[bytes, bytes], echo: bool = False) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.master)
        tty.setraw(self.slave)
        self.device = os.ttyname(self.slave)
        self.heard: list[bytes] = []
        self._answers, self._echo = answers, echo
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        line = b""
        while True:
            try:
                more = os.read(self.master, 64)
            except OSError:
                return
            for byte in more:
                if byte == 0:
                    return
                line += bytes((byte,))
                if byte == 13:
                    self._answer(line)
                    line = b""

    def _answer(self, line: bytes) -> None:
        if self._echo:
            os.write(self.master, line)
        text = line.strip()
        if text:
            self.heard.append(text)
            answer = self._answers.get(text, b"ERROR!")
            if answer:
                os.write(self.master, answer + b"\r")

    def close(self) -> None:
        os.write(self.slave, b"\0")  # ends the thread, whatever it was at
        self._thread.join(5.0)
        os.close(self.master)
        os.close(self.slave)


@pytest.fixture
def drive() -> Iterator[Responder]:
    one = Responder({b"VERSION?": b"2300:VERSION:0104.0007", b"?604100": b"=604100:0250"})
    yield one
    one.close()


def named(findings: Iterator[Finding]) -> dict[str, Finding]:
    return {finding.name: finding for finding in findings}


def test_a_drive_that_answers(drive: Responder) -> None:
    told = named(examine_line(drive.device, {}))
    assert told["port"].text == f"a drive answers on {drive.device} at 9600 baud: 2300:VERSION:0104.0007"
    assert told["echo"].state == "ok"
    assert told["state"].text.startswith("the drive is in Switch On Disabled (6041h = 0250h), answered in ")
    assert told["use"].remedy == "connect the CAN port to commission"
    assert set(drive.heard) == {b"VERSION?", b"?604100"}  # questions only


def test_an_echo_is_told() -> None:
    one = Responder({b"VERSION?": b"2300:VERSION:0104.0007", b"?604100": b"=604100:0250"}, echo=True)
    told = named(examine_line(one.device, {"bitrate": 9600}))
    one.close()
    assert told["echo"].text == "every line comes back as an echo before its answer"
    assert told["state"].values == {"statusword": 0x0250}


def test_something_else_on_the_port() -> None:
    one = Responder({})  # answers ERROR! to everything
    told = named(examine_line(one.device, {"bitrate": 9600}))
    one.close()
    assert told["port"].unreachable
    assert "nothing that reads as a drive's version" in told["port"].text


class Dead:
    """A port on which nothing ever comes; time passes with each read."""

    now_s = 0.0

    def now(self) -> float:
        return Dead.now_s

    def sleep_until(self, t_s: float) -> None:
        Dead.now_s = t_s

    def read(self, size: int = 1) -> bytes:
        Dead.now_s += 0.02
        return b""

    def write(self, data: bytes) -> int:
        return len(data)

    def reset_input_buffer(self) -> None:
        pass

    def close(self) -> None:
        pass


def test_nobody_answers_at_any_rate() -> None:
    tried = []

    def opener(_device: str, baud: int, handshake: bool) -> Dead:
        tried.append((baud, handshake))
        return Dead()

    (finding,) = examine_line("/dev/ttyUSB0", {}, opener=opener, clock=Dead())
    assert finding.unreachable
    assert finding.text == "nobody answers on /dev/ttyUSB0 at 9600, 115200, 57600, 38400, 19200 baud, with or without RTS/CTS"
    assert tried == [(baud, handshake) for handshake in (False, True) for baud in (9600, 115200, 57600, 38400, 19200)]


def test_handshake_lines_that_are_needed() -> None:
    class Needs(Dead):
        def __init__(self, handshake: bool) -> None:
            self._handshake, self._answer = handshake, b""

        def write(self, data: bytes) -> int:
            known = {b"VERSION?\r": b"2300:VERSION:0104.0007\r", b"?604100\r": b"!06020000\r"}
            self._answer = known.get(data, b"") if self._handshake else b""
            return len(data)

        def read(self, size: int = 1) -> bytes:
            Dead.now_s += 0.02
            answer, self._answer = self._answer, b""
            return answer

    told = named(examine_line("/dev/ttyUSB0", {}, opener=lambda _d, _b, handshake: Needs(handshake), clock=Dead()))
    assert told["port"].text == "a drive answers on /dev/ttyUSB0 at 9600 baud with RTS/CTS: 2300:VERSION:0104.0007"
    assert "handshake" in told["port"].remedy
    assert told["state"].text == "the drive answers !06020000 to ?604100 (its statusword)"


@pytest.mark.parametrize(
    ("error", "text", "remedy"),
    [
        (FileNotFoundError(errno.ENOENT, "No such file or directory"), "there is no serial port", "plug the adapter in"),
        (PermissionError(errno.EACCES, "Permission denied"), "you may not open", "usermod -aG dialout"),
        (OSError(errno.EBUSY, "Device or resource busy"), "another program has", "close it"),
        (OSError(errno.EIO, "Input/output error"), "cannot be opened", "out and in"),
    ],
)
def test_ports_that_do_not_open(error: OSError, text: str, remedy: str) -> None:
    def opener(*_: object) -> None:
        raise error

    (finding,) = examine_line("/dev/ttyUSB0", {}, opener=opener, group=lambda _device: "dialout")
    assert finding.unreachable
    assert text in finding.text
    assert remedy in finding.remedy


def test_a_port_that_is_not_there_for_real(tmp_path: Path) -> None:
    (finding,) = examine_line(str(tmp_path / "ttyS9"), {})
    assert re.match("there is no serial port", finding.text)
