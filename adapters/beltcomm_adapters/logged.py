"""A CAN bus whose frames somebody writes down."""

from __future__ import annotations

from collections.abc import Callable

import can

from beltcomm.drive import Clock


class LoggedBus(can.BusABC):
    """The same bus; ``log`` is called with (time in s, identifier, data, "host", "host rtr" or "node") for every frame sent or received.

    clock : of the stamps, which are thus of one clock whatever the interface stamps with.
    """

    def __init__(self, bus: can.BusABC, clock: Clock, log: Callable[[tuple[float, int, bytes, str]], object]) -> None:
        super().__init__(channel=bus.channel_info)
        self.channel_info = bus.channel_info
        self._bus, self._clock, self._log = bus, clock, log

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame.   Raises what the interface raises."""
        self._bus.send(msg, timeout)
        self._log((self._clock.now(), msg.arbitration_id, bytes(msg.data), "host rtr" if msg.is_remote_frame else "host"))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame, None when none came in time.   Raises what the interface raises."""
        message = self._bus.recv(timeout)
        if message is not None and not message.is_error_frame:
            self._log((self._clock.now(), message.arbitration_id, bytes(message.data), "node rtr" if message.is_remote_frame else "node"))
        return message

    def shutdown(self) -> None:
        """Close the interface."""
        super().shutdown()
        self._bus.shutdown()
