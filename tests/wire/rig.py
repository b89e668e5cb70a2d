"""The virtual drive with a rigid machine, served in a thread on a channel of python-can's virtual interface."""

from __future__ import annotations

import contextlib
import threading
from typing import Any

import can

from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.serving import Pump
from beltcomm_adapters.buses import MonotonicClock
from virtual.host import RigidPlant


class Stopped(Exception):
    """The test is over."""


class Wire:
    """The drive's end of the channel.   over : ends the pump.   mute : the process that served has died.   swallow : identifiers lost."""

    def __init__(self, channel: str) -> None:
        self.bus = can.Bus(interface="virtual", channel=channel)
        self.over = self.mute = False
        self.swallow: list[int] = []

    def recv(self, timeout: float) -> can.Message | None:
        if self.over:
            raise Stopped
        message = self.bus.recv(timeout)
        return None if self.mute else message

    def send(self, message: can.Message) -> None:
        if message.arbitration_id in self.swallow:
            self.swallow.remove(message.arbitration_id)
        elif not self.mute:
            self.bus.send(message)


class ServedDrive:
    """As ``beltcomm serve`` does it; ``by_sync`` False is its ``--realtime``.   seen : every frame, in the drive's time."""

    def __init__(self, channel: str, by_sync: bool, profile: str = "reference", **options: Any) -> None:
        self.seen: list[tuple[float, int, bytes, str]] = []
        self.inner = LockstepBus()
        self.inner.on_frame = self.seen.append
        self.plant = RigidPlant(2e-3, 1e-3)
        self.wire = Wire(channel)
        self.drive = VirtualDrive(self.inner, self.plant, profile, referenced=True, torque_noise_nm=0.0, **options)
        pump = Pump(self.wire, self.inner, self.drive, MonotonicClock())
        self._serve = pump.by_sync if by_sync else pump.by_wall_clock
        self._thread = threading.Thread(target=self._run)

    def start(self) -> None:
        self._thread.start()

    def _run(self) -> None:
        with contextlib.suppress(Stopped):
            self._serve()

    def close(self) -> None:
        self.wire.over = True
        if self._thread.ident is not None:
            self._thread.join()
        self.wire.bus.shutdown()
        self.inner.shutdown()
