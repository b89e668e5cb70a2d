"""One CANopen node on one bus (CiA 301): frames out and in, its emergencies, and the signs of life the host owes it.

Single-threaded: nothing arrives unless somebody here waits for it.  python-can's Notifier is not used, because a callback
that waits would stall reception, and because virtual time has no second thread.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import can

from beltcomm.drive import GUARD_S, Clock
from beltcomm.errors import BusError

#: Node number of the host, the largest one, so that it meets no drive.
HOST_NODE: Final = 127
#: The host speaks three times within the guard time, so that two lost frames are no fault.
SIGNS_PER_GUARD_TIME: Final = 10 / 3

#: What python-can and the interfaces below it raise.
INTERFACE_ERRORS: Final = (can.CanError, OSError)

NMT_START, NMT_PRE_OPERATIONAL = 0x01, 0x80
_OPERATIONAL: Final = b"\x05"


@dataclass(frozen=True)
class Emergency:
    """An EMCY frame: error code (CiA 301, 7.2.7), error register 1001h, the maker's five bytes."""

    code: int
    register: int
    detail: bytes


class Link:
    """The host's end of the wire to node ``node``.

    Attributes
    ----------
    emergency
        The last EMCY with an error in it, None since :meth:`forget_emergency` or since the node took it back.
    emergency_s
        When it came.
    last_life_s
        When the last sign of life went out.
    life_due_s
        When the next one must, never (inf) without guarding.
    restarted
        A boot-up message has come: what was written to the node and not saved is gone, for the rest of the connection.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, node: int) -> None:
        self.bus = bus
        self.clock = clock
        self.node = node
        self.emergency: Emergency | None = None
        self.emergency_s = math.inf
        self.restarted = False
        self._handlers: dict[int, Callable[[can.Message], None]] = {0x80 + node: self._on_emergency, 0x700 + node: self._on_life}
        self._life: can.Message | None = None
        self._life_period_s = 0.0
        self.last_life_s = 0.0
        self.life_due_s = math.inf

    def subscribe(self, cob_id: int, handler: Callable[[can.Message], None]) -> None:
        """Have every data frame of this identifier handed on."""
        self._handlers[cob_id] = handler

    def send(self, message: can.Message) -> None:
        """Put a frame on the bus; raises BusError when the interface does not take it."""
        try:
            self.bus.send(message)
        except INTERFACE_ERRORS as error:
            raise self.gone(error) from error

    def send_data(self, cob_id: int, data: bytes) -> None:
        """Send one data frame."""
        self.send(can.Message(arbitration_id=cob_id, data=data, is_extended_id=False))

    def send_nmt(self, command: int) -> None:
        """Network management command to this node (CiA 301, 7.2.8)."""
        self.send_data(0, bytes((command, self.node)))

    def receive(self, timeout_s: float) -> can.Message | None:
        """The next frame from the bus, None when none came in time; raises BusError when the interface is gone."""
        try:
            return self.bus.recv(timeout_s)
        except INTERFACE_ERRORS as error:
            raise self.gone(error) from error

    def gone(self, error: Exception) -> BusError:
        """The interface's failure, in words, to be raised."""
        return BusError(
            f"the CAN interface {self.bus.channel_info} does not send or receive ({error}); check that it is plugged in and up, "
            "that the drive is on and the bus terminated"
        )

    def dispatch(self, message: can.Message) -> None:
        """Hand a frame to who has subscribed to it; error frames, remote frames and strangers are dropped."""
        if message.is_error_frame or message.is_remote_frame:
            return
        handler = self._handlers.get(message.arbitration_id)
        if handler is not None:
            handler(message)

    def pump(self, timeout_s: float) -> bool:
        """Wait for one frame, at most ``timeout_s``, and dispatch it; signs of life go out meanwhile.  False when nothing came."""
        end_s = self.clock.now() + timeout_s
        while True:
            now_s = self.clock.now()
            self.show_life(now_s)
            wait_s = max(end_s - now_s, 0.0)
            wait_s = min(wait_s, self.life_due_s - now_s)
            message = self.receive(wait_s)
            if message is not None:
                self.dispatch(message)
                return True
            self.clock.sleep_until(now_s + wait_s)  # an interface may give up early
            if self.clock.now() >= end_s:
                return False

    def forget_emergency(self) -> None:
        """From here on :attr:`emergency` tells of new ones only."""
        self.emergency = None

    def guard(self, kind: Literal["heartbeat", "node_guarding"] | None, guard_s: float = GUARD_S) -> None:
        """Begin to show signs of life, every 15 ms of 50 ms of guard time.

        Parameters
        ----------
        kind : Literal['heartbeat', 'node_guarding'] or None
            The host's own heartbeat (700h + 127), or a remote frame to 700h + node; None ends it.
        guard_s : float
        """
        if kind == "heartbeat":
            self._life = can.Message(arbitration_id=0x700 + HOST_NODE, data=_OPERATIONAL, is_extended_id=False)
        elif kind == "node_guarding":
            self._life = can.Message(arbitration_id=0x700 + self.node, is_remote_frame=True, dlc=1, is_extended_id=False)
        else:
            self._life = None
        self._life_period_s = guard_s / SIGNS_PER_GUARD_TIME
        self.life_due_s = math.inf if kind is None else self.clock.now()

    def show_life(self, now_s: float) -> None:
        """Send the sign of life when it is due."""
        if self._life is not None and now_s >= self.life_due_s:
            self.send(self._life)
            self.last_life_s = now_s
            self.life_due_s = now_s + self._life_period_s

    def _on_emergency(self, message: can.Message) -> None:
        if len(message.data) < 3:
            return
        code, register = struct.unpack_from("<HB", message.data)
        self.emergency = Emergency(code, register, bytes(message.data[3:])) if code else None
        self.emergency_s = self.clock.now()

    def _on_life(self, message: can.Message) -> None:
        """Boot-up is a heartbeat of state 0 (CiA 301, 7.2.8.3.3)."""
        self.restarted = self.restarted or bytes(message.data) == b"\x00"


def find_nodes(bus: can.BusABC, clock: Clock) -> list[int]:
    """Numbers of all nodes that answer a read of 1000h, in order.

    Every node is asked at once and answers are collected for half a second; an abort is an answer too.  Raises BusError.

    Parameters
    ----------
    bus : BusABC
        Open.
    clock : Clock

    Raises
    ------
    BusError
        When the interface fails.
    """
    link = Link(bus, clock, HOST_NODE)
    found: set[int] = set()
    for node in range(1, HOST_NODE):
        link.subscribe(0x580 + node, lambda message: found.add(message.arbitration_id - 0x580))
        link.send_data(0x600 + node, b"\x40\x00\x10\x00\x00\x00\x00\x00")
        if node % 4 == 0:  # send queues of real interfaces are short
            link.pump(0.005)
    end_s = clock.now() + 0.5
    while (left_s := end_s - clock.now()) > 0:
        link.pump(left_s)
    return sorted(found)
