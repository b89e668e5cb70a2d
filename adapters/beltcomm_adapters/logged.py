"""A CAN bus whose frames somebody writes down."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import can

from beltcomm.drive import Clock
from beltcomm_adapters.sync_source import SYNC_ID


def _source(message: can.Message) -> str:
    """Sender of a frame that has come: a SYNC is always this computer's."""
    return "host" if message.arbitration_id == SYNC_ID else "node rtr" if message.is_remote_frame else "node"


class LoggedBus(can.BusABC):
    """A bus that calls ``log`` with (time in s, identifier, data, "host", "host rtr" or "node") for every frame sent or received.

    Parameters
    ----------
    clock : Clock
        Of the stamps, which are thus of one clock whatever the interface stamps with.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, log: Callable[[tuple[float, int, bytes, str]], object]) -> None:
        super().__init__(channel=bus.channel_info)
        self.channel_info = bus.channel_info
        self.inner, self._clock, self._log = bus, clock, log

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame.   Raises what the interface raises."""
        self.inner.send(msg, timeout)
        self._log((self._clock.now(), msg.arbitration_id, bytes(msg.data), "host rtr" if msg.is_remote_frame else "host"))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, None when none came in time.   Raises what the interface raises."""
        message = self.inner.recv(timeout)
        if message is not None and not message.is_error_frame:
            self._log((self._clock.now(), message.arbitration_id, bytes(message.data), _source(message)))
        return message

    def send_periodic(self, msgs: Any, period: float, *rest: Any, **more: Any) -> Any:
        """By the interface; the frames are seen by :meth:`recv`.   Raises what the interface raises."""
        return self.inner.send_periodic(msgs, period, *rest, **more)

    def shutdown(self) -> None:
        """Close the interface."""
        super().shutdown()
        self.inner.shutdown()
