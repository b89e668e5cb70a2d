"""Sources of SYNC: the host itself, or the kernel's broadcast manager where the bus is SocketCAN's.

Some drives lock their loops to SYNC, so that its period must be kept exactly (60C2h); a process that others hold up cannot.  A timer of the
kernel can, and goes on whatever the process does; what must end with the process, its sign of life, is not left to it.
"""

from __future__ import annotations

from collections import deque
from typing import Any, Final, Protocol

import can

from beltcomm_adapters.link import Link

SYNC_ID: Final = 0x80
#: A SYNC later than this share of a period moves the host's grid instead of being followed by a burst.
_LATE_SHARE: Final = 0.25
#: Periods after which a kernel that sends no SYNC is given up.
_SILENT_PERIODS: Final = 20


class SyncSource(Protocol):
    """SYNCs one after the other.

    Attributes
    ----------
    early : deque[can.Message]
        Frames that have come behind the latest SYNC before the host looked.
    """

    early: deque[can.Message]

    def start(self) -> None:
        """The first SYNC is due one period from now."""
        ...

    def next(self) -> float | None:
        """Wait for the next SYNC; when it went out by the host's clock, s.   None: it went out before the host could answer the last one.

        What has come before it is dispatched: it must not pass for its answer.   Raises what the interface raises.
        """
        ...

    def stop(self) -> None:
        """No SYNC any more.   May be called at any time, and twice."""
        ...


class HostSync:
    """SYNCs that the host sends when they are due.   A late one moves those that follow."""

    def __init__(self, link: Link, period_s: float) -> None:
        self.early: deque[can.Message] = deque()
        self._link, self._period_s = link, period_s
        self._message = can.Message(arbitration_id=SYNC_ID, is_extended_id=False)
        self._next_s = 0.0

    def start(self) -> None:
        """Begin to send."""
        self._next_s = self._link.clock.now() + self._period_s

    def next(self) -> float | None:
        """Wait for the next SYNC."""
        link, due_s = self._link, self._next_s
        link.clock.sleep_until(due_s)
        now_s = link.clock.now()
        self._next_s = (due_s if now_s - due_s <= _LATE_SHARE * self._period_s else now_s) + self._period_s
        while (message := link.bus.recv(0.0)) is not None:
            link.dispatch(message)
        link.bus.send(self._message)
        return now_s

    def stop(self) -> None:
        """Send no more."""


class KernelSync:
    """SYNCs of the kernel, seen as they go out.   When another one has come before the host looked, the first has had no setpoints."""

    def __init__(self, link: Link, period_s: float) -> None:
        self.early: deque[can.Message] = deque()
        self._link, self._period_s = link, period_s
        self._task: Any = None
        self._waiting: can.Message | None = None

    def start(self) -> None:
        """Begin to send."""
        while (message := self._link.bus.recv(0.0)) is not None:
            self._link.dispatch(message)
        self._waiting = None
        message = can.Message(arbitration_id=SYNC_ID, is_extended_id=False)
        self._task = self._link.bus.send_periodic(message, self._period_s)

    def next(self) -> float | None:
        """Wait for the next SYNC."""
        link = self._link
        end_s = link.clock.now() + _SILENT_PERIODS * self._period_s
        self.early.clear()
        while True:
            message, self._waiting = self._waiting or link.bus.recv(self._period_s), None
            if message is not None and message.arbitration_id == SYNC_ID and not message.is_error_frame:
                break
            if message is not None:
                link.dispatch(message)
            elif link.clock.now() > end_s:
                raise can.CanOperationError("the kernel's broadcast manager sends no SYNC (CAN_BCM)")
        while (message := link.bus.recv(0.0)) is not None:
            if message.arbitration_id == SYNC_ID and not message.is_error_frame:
                self._waiting = message
                return None
            self.early.append(message)
        return link.clock.now()

    def stop(self) -> None:
        """Send no more."""
        task, self._task = self._task, None
        if task is not None:
            task.stop()


def _broadcast_by_kernel(bus: can.BusABC) -> bool:
    """True if periodic frames of this bus are sent by the kernel."""
    return type(getattr(bus, "inner", bus)).__name__ == "SocketcanBus"


def sync_source(link: Link, period_s: float) -> SyncSource:
    """The better source of SYNC that a bus has.

    Parameters
    ----------
    link : Link
        To the drive.
    period_s : float, s
        Of SYNC.
    """
    return KernelSync(link, period_s) if _broadcast_by_kernel(link.bus) else HostSync(link, period_s)
