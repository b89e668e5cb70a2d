"""A bus that is listened to: frames as they come, and at its begin what the process data mean, asked by SDO uploads alone."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, Final

import can

from beltcomm.drive import Clock, Heard
from beltcomm.errors import BusError, ObjectRefused, UsageError
from beltcomm_adapters.link import Link, find_nodes
from beltcomm_adapters.sdo import SdoObjects

#: s for which it is listened who is there.
HEARKEN_S: Final = 0.5
#: s: less is rounding of a time.
_INSTANT_S: Final = 1e-6
#: Functions that a node sends by: its four process data objects, and its sign of life (CiA 301, table 38).
_SENT: Final = (0x180, 0x280, 0x380, 0x480, 0x700)
#: Communication and mapping objects, received and sent; how many of each are asked for.
_PDOS: Final = ((0x1400, 0x1600), (0x1800, 0x1A00))
_MOST_PDOS: Final = 8
#: What units, period and mode of a drive follow from.
_UNITS: Final = (
    (0x1006, (0,)),
    (0x1008, (0,)),
    (0x1018, (1, 2, 3, 4)),
    (0x6061, (0,)),
    (0x6075, (0,)),
    (0x6076, (0,)),
    (0x608F, (1, 2)),
    (0x6091, (1, 2)),
    (0x6092, (1, 2)),
    (0x6093, (1, 2)),
    (0x6094, (1, 2)),
    (0x60A9, (0,)),
)


class HeardBus(can.BusABC):
    """A bus of which every frame is kept in ``heard``, by the interface's own stamps."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        super().__init__(channel=bus.channel_info)
        self.channel_info, self.inner, self._clock = bus.channel_info, bus, clock
        self.heard: list[Heard] = []
        self._last_s = 0.0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame.   Raises what the interface raises."""
        self.inner.send(msg, timeout)
        self.heard.append((self._last_s, msg.arbitration_id, bytes(msg.data), msg.is_remote_frame))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, None when none came in time.   Raises what the interface raises."""
        message = self.inner.recv(timeout)
        if message is not None and not (message.is_error_frame or message.is_extended_id or message.is_fd):
            self._last_s = message.timestamp or self._clock.now()
            self.heard.append((self._last_s, message.arbitration_id, bytes(message.data), message.is_remote_frame))
        return message

    def shutdown(self) -> None:
        """Close the interface."""
        super().shutdown()
        self.inner.shutdown()


class BusListening:
    """A CAN bus as :class:`beltcomm.drive.Listening` asks.

    Parameters
    ----------
    bus : BusABC
        Whose frames come into ``heard``.
    node : int or None
        None looks who is there.
    ask : bool
        SDO uploads are allowed.
    release : callable
        Called last.

    Raises
    ------
    BusError
        Where nobody is heard.
    UsageError
        Where several are.
    """

    def __init__(
        self, bus: can.BusABC, heard: list[Heard], clock: Clock, node: int | None, release: Callable[[], None], *, ask: bool
    ) -> None:
        self._link, self._heard, self._clock, self._release = Link(bus, clock, node or 0), heard, clock, release
        try:
            if node is None:
                node = self._who(ask)
            self.title = f"{bus.channel_info}, node {node}"
            if ask:
                _ask(SdoObjects(Link(bus, clock, node)))
        except BaseException:
            release()
            raise

    def frames(self, wait_s: float) -> list[Heard]:
        """Frames of the next seconds, as :meth:`beltcomm.drive.Listening.frames` has them."""
        self._wait(wait_s)
        found = list(self._heard)
        self._heard.clear()
        return found

    def _wait(self, wait_s: float) -> None:
        end_s = self._clock.now() + wait_s
        while (left_s := end_s - self._clock.now()) > _INSTANT_S:
            self._link.receive(left_s)

    def _who(self, ask: bool) -> int:
        self._wait(HEARKEN_S)
        nodes = sorted({one[1] & 0x7F for one in self._heard if one[1] & ~0x7F in _SENT and one[1] & 0x7F})
        if not nodes and ask:
            nodes = find_nodes(self._link.bus, self._clock)
        if len(nodes) == 1:
            return nodes[0]
        if nodes:
            raise UsageError(f"several nodes are on the bus: {', '.join(map(str, nodes))}; say which one is the drive with --node")
        raise BusError("nobody is heard on the bus; check that it is up, its bit rate, the cable and that the machine runs")

    def __enter__(self) -> BusListening:
        return self

    def __exit__(self, *exc: object) -> None:
        self._release()


class PlayedListening(BusListening):
    """A virtual bus that is listened to, whose drive moves as a played production says: an iterator that drives one move for each step."""

    def __init__(self, production: Iterator[object], *given: Any, **more: Any) -> None:
        self._production = production
        super().__init__(*given, **more)

    def frames(self, wait_s: float) -> list[Heard]:
        """Frames of one more move of the production, after its end those of the next ``wait_s`` seconds."""
        return super().frames(wait_s if next(self._production, None) is None else 0.0)


def _ask(objects: SdoObjects) -> None:
    """Uploads of what the process data hold: the answers are frames that are heard like any others.   Raises BusError."""

    def asked(index: int, subindex: int) -> int | None:
        with contextlib.suppress(ObjectRefused):
            return int.from_bytes(objects.read_bytes(index, subindex)[:4], "little")
        return None

    for index, places in _UNITS:
        for subindex in places:
            if asked(index, subindex) is None:
                break
    for communication, mapping in _PDOS:
        for number in range(_MOST_PDOS):
            if asked(communication + number, 1) is None:
                break
            asked(communication + number, 2)
            for entry in range(1, min(asked(mapping + number, 0) or 0, 8) + 1):
                asked(mapping + number, entry)
