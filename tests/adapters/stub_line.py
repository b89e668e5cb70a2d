"""A drive on RS-232 scripted by hand for the adapter's tests, from the makers' pages; it shares nothing with ``beltcomm.virtual``.

Time is a number that only waiting moves.  ``tamper`` sees every answer before it is sent and may change it.
"""

from __future__ import annotations

import re
from collections.abc import Callable

Content = tuple[int, int]  # value, hex digits


class StubClock:
    def __init__(self) -> None:
        self.t_s = 0.0

    def now(self) -> float:
        return self.t_s

    def sleep_until(self, t_s: float) -> None:
        self.t_s = max(self.t_s, t_s)


class StubLine:
    """Both the port and the drive behind it.   requests : every line the drive understood at its bit rate, in order."""

    name = "stub port"

    def __init__(self, clock: StubClock) -> None:
        self.clock = clock
        self.bitrate = self.drive_bitrate = 9600
        self.objects: dict[str, Content] = {"100000": (0x00020192, 8), "100100": (0, 2), "100500": (0x80, 8), "101801": (0x1D, 8)}
        self.requests: list[str] = []
        self.tamper: Callable[[str, str], bytes | None] = lambda _request, answer: answer.encode() + b"\r"
        self.delay_s: Callable[[str], float] = lambda _request: 0.002
        self.interrupt: BaseException | None = None
        self.broken = False
        self.locked = False
        self._line = b""
        self._coming: list[tuple[float, bytes]] = []
        self._busy_until_s = 0.0

    def put(self, place: str, value: int, digits: int) -> None:
        self.objects[place] = (value & (16**digits - 1), digits)

    def say(self, data: bytes, after_s: float = 0.0) -> None:
        self._coming.append((self.clock.now() + after_s, data))

    def write(self, data: bytes) -> None:
        if self.broken:
            raise OSError("device is gone")
        if self.bitrate != self.drive_bitrate:
            return
        *lines, self._line = (self._line + data).split(b"\r")
        for line in lines:
            self._heard(line.decode())

    def read(self, timeout_s: float) -> bytes:
        if self.broken:
            raise OSError("device is gone")
        if self.interrupt is not None:
            error, self.interrupt = self.interrupt, None
            raise error
        self._coming.sort(key=lambda item: item[0])
        end_s = self.clock.now() + timeout_s
        if not self._coming or self._coming[0][0] > end_s + 1e-12:
            self.clock.sleep_until(end_s)
            return b""
        at_s, data = self._coming.pop(0)
        self.clock.sleep_until(at_s)
        return data

    def close(self) -> None:
        self.broken = True

    def writes_of(self, place: str) -> list[str]:
        return [request for request in self.requests if request.startswith(f"={place}:")]

    def _heard(self, request: str) -> None:
        self.requests.append(request)
        answer = self._answer(request)
        if answer is None:
            return
        sent = self.tamper(request, answer)
        if sent is not None:
            self._busy_until_s = max(self.clock.now(), self._busy_until_s) + self.delay_s(request)  # one request after the other
            self.say(sent, self._busy_until_s - self.clock.now())

    def _answer(self, request: str) -> str | None:
        if found := re.fullmatch(r"\?([0-9A-F]{6})", request):
            content = self.objects.get(found[1])
            return f"={found[1]}:{content[0]:0{content[1]}X}" if content else "!06020000"
        if found := re.fullmatch(r"=([0-9A-F]{6}):([0-9A-F]+)", request):
            content = self.objects.get(found[1])
            if content is None:
                return "!06020000"
            if len(found[2]) != content[1]:
                return "!06070010"
            self.objects[found[1]] = (int(found[2], 16), content[1])
            return request
        if (found := re.fullmatch(r"BAUD(\d+)", request)) and not self.locked:
            self.drive_bitrate = int(found[1])
            return None
        if request == "RESET!":
            self.drive_bitrate = 9600
            self.say(b"\r\nBOOT\r\n=100000:00\r\nOK\r\n", 0.3)
            return None
        return {"SAVE!": "DONE", "VERSION?": "2300:VERSION:0001.0007"}.get(request, "ERROR!")
