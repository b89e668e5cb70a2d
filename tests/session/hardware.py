"""A virtual drive that says that it is real, for what beltcomm does with hardware only; and its bus for another process."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

import can

from beltcomm.drive import Drive
from beltcomm_adapters.canopen import connect
from session.bench import Bench, Listener

#: A CMMP-AS by what it tells of itself.
IDENTITY = {"vendor_id": "29", "product_code": "8227", "serial_number": "4711", "device_name": "CMMP-AS", "hardware": "1.0"}


class HardwareBench(Bench):
    """A bench whose drive tells another identity than a virtual one."""

    def __init__(self, rig: str = "g_a", serial: str = "4711", **options: Any) -> None:
        super().__init__(rig, **options)
        self.told = {**IDENTITY, "serial_number": serial}

    def open(self, name: str, options: Mapping[str, object] | None = None) -> Drive:
        drive = super().open(name, options)
        drive.capabilities = replace(drive.capabilities, identity=self.told)
        return drive

    def remote(self, pipe: Connection) -> Callable[..., Drive]:
        """What opens this drive in another process, over a pipe that :func:`serve` answers."""

        def open_drive(_name: str, _options: Mapping[str, object] | None = None) -> Drive:
            drive = connect(RemoteBus(pipe), RemoteClock(pipe), 1, None, None, lambda: None)
            drive.capabilities = replace(drive.capabilities, identity=self.told)
            return drive

        return open_drive

    def serve(self, pipe: Connection, due: Callable[[], bool], kill: Callable[[], None]) -> bool:
        """Answer the other process until it is gone; ``kill`` is called once ``due`` is true.   Returns whether it was."""
        bus, killed = self._bus, False
        calls: dict[str, Callable[..., Any]] = {
            "send": lambda *frame: bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_remote_frame=frame[2], dlc=frame[3],
                                                        is_extended_id=False)),
            "recv": lambda wait: _packed(bus.recv(wait)),
            "now": bus.clock.now,
            "sleep": bus.clock.sleep_until,
        }  # fmt: skip
        while True:
            try:
                name, *values = pipe.recv()
                pipe.send(calls[name](*values))
            except (EOFError, OSError):
                return killed
            if not killed and due():
                killed = True
                kill()


def _packed(message: can.Message | None) -> tuple[Any, ...] | None:
    return None if message is None else (message.timestamp, message.arbitration_id, bytes(message.data), message.is_remote_frame)


class RemoteBus(can.BusABC):
    """The bench's bus, asked over a pipe."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe
        self.channel_info = "a bus in another process"

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._pipe.send(("send", msg.arbitration_id, bytes(msg.data), msg.is_remote_frame, msg.dlc))
        self._pipe.recv()

    def recv(self, timeout: float | None = None) -> can.Message | None:
        self._pipe.send(("recv", timeout))
        found = self._pipe.recv()
        if found is None:
            return None
        stamp, identifier, data, remote = found
        return can.Message(timestamp=stamp, arbitration_id=identifier, data=data, is_remote_frame=remote, is_extended_id=False)

    def shutdown(self) -> None:
        """The bus belongs to the bench."""
        self._is_shutdown = True


class RemoteClock:
    """The bench's virtual time."""

    def __init__(self, pipe: Connection) -> None:
        self._pipe = pipe

    def now(self) -> float:
        self._pipe.send(("now",))
        return float(self._pipe.recv())

    def sleep_until(self, t_s: float) -> None:
        self._pipe.send(("sleep", t_s))
        self._pipe.recv()


class Person(Listener):
    """Somebody at a terminal."""

    def attended(self) -> bool:
        return True


class Script(Listener):
    """Nobody: a pipe."""

    def attended(self) -> bool:
        return False
