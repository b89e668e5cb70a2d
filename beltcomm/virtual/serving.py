"""The virtual drive for other processes: frames pumped between a CAN interface and the lock-step bus.

Two ways of time.  By SYNC: each SYNC is one period of the drive (60C2h) and time stands in between, so that host and drive
may be as slow as they like and every run is the same.  By the wall clock: 1 kHz, and what comes late is late.
"""

from __future__ import annotations

import math
from typing import Final, Protocol

import can

from beltcomm.virtual.bus import LockstepBus, WallClock
from beltcomm.virtual.device import VirtualDrive

_SYNC: Final = 0x80
#: Part of a tick.
_ROUNDING: Final = 1e-6
#: s: how long at most nobody looks after time and interrupts.
_LOOK_S: Final = 0.1
#: s of the wall clock: a host that is silent for so long while the motor carries torque is dead, and time runs on without
#: it: then the drive's guarding stops the axis.  A host that computes something between two SYNCs is never so slow.
SILENCE_S: Final = 5.0


class CanInterface(Protocol):
    """A CAN interface: one of python-can's, or :class:`beltcomm.virtual.slcan.SlcanAdapter`."""

    def recv(self, timeout: float) -> can.Message | None:
        """The next frame of another process; None when none came in time."""
        ...

    def send(self, message: can.Message) -> None:
        """Put a frame on the bus."""
        ...


class Pump:
    """Serves what is attached to ``bus`` on ``wire``.

    frames, syncs : received from other processes.   missed_ticks : of the wall clock, which came too late and were left out.

    Parameters
    ----------
    clock : WallClock
        The wall's. Runs until it is interrupted.
    """

    def __init__(self, wire: CanInterface, bus: LockstepBus, drive: VirtualDrive, clock: WallClock) -> None:
        self._wire, self._bus, self._drive, self._clock = wire, bus, drive, clock
        self.frames = self.syncs = self.missed_ticks = 0
        self._left_ticks = 0.0

    def by_sync(self) -> None:
        """Serve in the time of SYNCs; see the module.   Raises what the wire raises."""
        self._drive.answers_at_once = True  # no time passes while its host waits for it
        self._pass_on()
        heard_s = self._clock.now()
        while True:
            message = self._wire.recv(_LOOK_S)
            if message is not None:
                heard_s = self._clock.now()
                if message.arbitration_id == _SYNC and _is_data(message):
                    ticks = self._left_ticks + self._drive.sync_ticks
                    self._left_ticks = ticks - math.floor(ticks + _ROUNDING)
                    self._run(round(ticks - self._left_ticks))
                self._take(message)
            elif self._drive.powered and self._clock.now() - heard_s >= SILENCE_S:
                self._run(round(_LOOK_S / self._bus.tick_s))

    def by_wall_clock(self) -> None:
        """Serve at 1 kHz; see the module.   Raises what the wire raises."""
        self._pass_on()
        due_s = self._clock.now()
        while True:
            self._run(1)
            due_s += self._bus.tick_s
            late = int((self._clock.now() - due_s) / self._bus.tick_s)
            if late >= 1:
                self.missed_ticks += late
                due_s += late * self._bus.tick_s
            while True:
                message = self._wire.recv(max(due_s - self._clock.now(), 0.0))
                if message is not None:
                    self._take(message)
                if self._clock.now() >= due_s:
                    break

    def _take(self, message: can.Message) -> None:
        if message.is_error_frame:
            return
        self.frames += 1
        self.syncs += message.arbitration_id == _SYNC and _is_data(message)
        self._bus.send(message)
        self._pass_on()

    def _run(self, ticks: int) -> None:
        for _ in range(ticks):
            self._bus.advance()
        self._pass_on()

    def _pass_on(self) -> None:
        while (message := self._bus.recv(0.0)) is not None:
            self._wire.send(message)


def _is_data(message: can.Message) -> bool:
    return not (message.is_extended_id or message.is_remote_frame or message.is_error_frame)
