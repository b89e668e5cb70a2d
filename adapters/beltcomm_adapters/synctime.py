"""A drive whose time is the count of SYNCs: a simulated one that another process serves (``beltcomm serve``), told by its 1009h.

Between SYNCs its time stands, so the host's must stand too: whatever the host waits for is made to pass by SYNCs, and signs of
life are counted in the drive's milliseconds.  No real drive says so of itself, and none is ever waited for in this way.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Final

import can

from beltcomm.drive import Clock
from beltcomm.errors import BusError
from beltcomm_adapters.link import NMT_PRE_OPERATIONAL, NMT_START, Link
from beltcomm_adapters.sdo import SdoObjects

#: How the hardware version 1009h of such a drive ends.
TIME_BY_SYNC: Final = "time by SYNC"

#: s of the drive that one SYNC stands for while no PDOs are exchanged; while they are, it is the period of the exchange.
_TICKS_PER_SECOND: Final = 1000
_TICK_S: Final = 1.0 / _TICKS_PER_SECOND
#: SYNCs after which the drive is asked whether it has come so far: queues of interfaces are short.
_TICKS_AHEAD: Final = 10
#: s of the wall clock, for what must come: at first, for the process that serves may be compiling just then; and from one that has
#: just not answered.
_PATIENCE_S: Final = 20.0
_LITTLE_PATIENCE_S: Final = 0.05
#: s: the same once an answer was lost although the process lives: the adapter between loses frames.
_AFTER_LOSS_S: Final = 2.0
#: The same for whether the drive has come so far, which a node that is booting does not tell.
_CAUGHT_UP_S: Final = 2.0
_ROUNDING_S: Final = 1e-9
_SYNC: Final = 0x80
#: Upload of 1018h:0, which nobody else reads; its answer tells that everything before it has been dealt with.
_OBJECT: Final = b"\x18\x10\x00"
_ASK: Final = b"\x40" + _OBJECT + bytes(4)


def keeps_time_by_sync(bus: can.BusABC, clock: Clock, node: int) -> bool:
    """True if this node's time is the count of SYNCs; False also when it does not answer.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock
    node : int
    """
    try:
        return SdoObjects(Link(bus, clock, node)).read_text(0x1009).endswith(TIME_BY_SYNC)
    except BusError:
        return False


class SyncClock:
    """The drive's time as its host counts it."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now(self) -> float:
        """Seconds since the first SYNC."""
        return self._now_s

    def sleep_until(self, t_s: float) -> None:
        """It becomes ``t_s`` at once; the drive follows with the next frame."""
        self._now_s = max(self._now_s, t_s)


class SyncTimeBus(can.BusABC):
    """An open bus to such a drive.   Before a frame goes out, SYNCs bring the drive to the host's time; the exchange has its own.

    Parameters
    ----------
    release : callable
        Called by :meth:`shutdown`, last.
    """

    def __init__(self, bus: can.BusABC, node: int, release: Callable[[], None]) -> None:
        super().__init__(channel=node)
        self.channel_info = bus.channel_info
        self.clock = SyncClock()
        self._bus = bus
        self._node = node
        self._release = release
        self._drive_s = 0.0
        self._exchanging = False
        self._owed = False
        self._patience_s = _PATIENCE_S
        self._lost = False
        self._received: deque[can.Message] = deque()
        self._sync = can.Message(arbitration_id=_SYNC, is_extended_id=False)
        self._answer_id = 0x580 + node
        self._question = can.Message(arbitration_id=0x600 + node, data=_ASK, is_extended_id=False)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame; raises what the interface raises."""
        if msg.arbitration_id == _SYNC:
            self._drive_s = self.clock.now()
        elif not self._exchanging:
            self._catch_up(self.clock.now())
        if msg.arbitration_id == 0 and bytes(msg.data[1:2]) == bytes((self._node,)) and msg.data[0] in (NMT_START, NMT_PRE_OPERATIONAL):
            self._exchanging = msg.data[0] == NMT_START
        if msg.arbitration_id in (_SYNC, self._question.arbitration_id):
            self._owed = True
        self._bus.send(msg, timeout)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, with the drive's time as its stamp.

        An answer that is owed is waited for by the wall clock; with nothing owed, the drive runs for ``timeout`` of its own seconds.
        """
        until_s = self.clock.now() + (math.inf if timeout is None else timeout)
        if timeout == 0.0:
            return self._next(0.0)
        if self._owed or self._exchanging:
            message = self._next(self._patience_s)
            self._heard(message)
            if message is None or (message.arbitration_id == self._answer_id and not self._exchanging):
                self._owed = False
            if message is None and timeout is not None:
                self.clock.sleep_until(until_s)
            return message
        if (message := self._next(0.0)) is not None:
            return message
        while self._drive_s < until_s - _ROUNDING_S:
            self._catch_up(min(self._drive_s + _TICKS_AHEAD * _TICK_S, until_s))
            self.clock.sleep_until(self._drive_s)
            if self._received:
                return self._next(0.0)
        return None

    def shutdown(self) -> None:
        """Close the bus."""
        if not self._is_shutdown:
            super().shutdown()
            self._release()

    def _next(self, wait_s: float) -> can.Message | None:
        message = self._received.popleft() if self._received else self._bus.recv(wait_s)
        while message is not None and self._is_ours(message):  # of a wait that was interrupted
            message = self._bus.recv(wait_s)
        if message is not None:
            message.timestamp = round(self.clock.now() * 1e6) / 1e6  # the drive samples on whole ticks, of microseconds at the finest
        return message

    def _catch_up(self, t_s: float) -> None:
        """Bring the drive to ``t_s`` and see that it is there; what it says meanwhile is kept."""
        ahead = 0
        while self._drive_s < t_s - _ROUNDING_S:
            self._bus.send(self._sync)
            self._drive_s += _TICK_S
            ahead += 1
            if ahead == _TICKS_AHEAD or self._drive_s >= t_s - _ROUNDING_S:
                ahead = 0
                self._bus.send(self._question)
                wait_s = min(self._patience_s, _CAUGHT_UP_S)
                while (message := self._bus.recv(wait_s)) is not None and not self._is_ours(message):
                    self._received.append(message)
                self._heard(message)

    def _heard(self, message: can.Message | None) -> None:
        if message is None:
            self._lost = True
        self._patience_s = (_AFTER_LOSS_S if self._lost else _PATIENCE_S) if message is not None else _LITTLE_PATIENCE_S

    def _is_ours(self, message: can.Message) -> bool:
        return message.arbitration_id == self._answer_id and bytes(message.data[1:4]) == _OBJECT
