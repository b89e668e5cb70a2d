"""From the address of a drive to an open CAN bus of python-can.

Frames of a bus can be written down as they pass.
"""

from __future__ import annotations

import errno
import logging
import re
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import can

from beltcomm.drive import Clock
from beltcomm.errors import BusError, UsageError
from beltcomm_adapters.sync_source import SYNC_ID

# What makers' libraries lack is said in sentences, where it matters.
logging.getLogger("can").addHandler(logging.NullHandler())

DEFAULT_BITRATE: Final = 1_000_000
_SOCKETCAN: Final = re.compile(r"(v?can|slcan)\d+")
_SERIAL_PORT: Final = re.compile(r"(/|COM\d+$|socket://)")


class MonotonicClock:
    """The clock of a real bus."""

    def now(self) -> float:
        """Seconds of the system's monotonic clock."""
        return time.monotonic()

    def sleep_until(self, t_s: float) -> None:
        """Wait until ``now() >= t_s``."""
        while (left_s := t_s - time.monotonic()) > 0:
            time.sleep(left_s)


@dataclass(frozen=True)
class Address:
    """An interface of python-can and its channel."""

    interface: str
    channel: str

    @classmethod
    def parse(cls, text: str) -> Address:
        """Interface and channel of an address as people write it.

        Parameters
        ----------
        text : str
            ``can0``, ``vcan0`` (SocketCAN); ``/dev/ttyACM0``, ``COM3``, ``socket://host:port`` (slcan); ``pcan:PCAN_USBBUS1`` (any
            interface of python-can).

        Raises
        ------
        UsageError
            For what is no CAN interface.
        """
        if _is_socketcan(text):
            return cls("socketcan", text)
        if _SERIAL_PORT.match(text):
            return cls("slcan", text)
        interface, colon, channel = text.partition(":")
        if colon and channel and interface in can.VALID_INTERFACES:
            return cls(interface, channel)
        raise UsageError(
            f"{text or 'a drive without an address'} is no CAN interface; write can0 (SocketCAN), "
            "slcan:/dev/ttyACM0 (serial CAN adapter) or "
            "can:INTERFACE:CHANNEL with an interface of python-can"
        )


def _is_socketcan(name: str) -> bool:
    """True if a drive's name is that of a SocketCAN interface."""
    return _SOCKETCAN.fullmatch(name) is not None


def is_can_bus(name: str) -> bool:
    """True if a drive's name is that of a SocketCAN interface, or begins with an interface of python-can (``pcan:PCAN_USBBUS1``).

    Parameters
    ----------
    name : str
        As for ``--drive``.
    """
    return _is_socketcan(name) or name.partition(":")[0] in can.VALID_INTERFACES


def open_bus(address: Address, bitrate: int, **more: Any) -> can.BusABC:
    """Open a CAN interface.

    Parameters
    ----------
    address : Address
        Interface and channel.
    bitrate : int, bit/s
        Set by the administrator on SocketCAN.
    **more : Any
        For python-can.

    Raises
    ------
    BusError
        When it cannot be opened.
    UsageError
        When python-can lacks what the interface needs.
    """
    arguments: dict[str, Any] = {} if address.interface == "socketcan" else {"bitrate": bitrate, **more}
    try:
        bus: Any = can.Bus(channel=address.channel, interface=address.interface, **arguments)
        if address.channel.startswith("socket://"):  # else each frame waits for the acknowledgement of the one before, up to 40 ms
            bus.serialPortOrig._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        opened: can.BusABC = bus
        return opened
    except can.CanInterfaceNotImplementedError as error:
        raise UsageError(f"the CAN interface {address.interface!r} cannot be used here: {error}") from error
    except Exception as error:  # a maker's library may fail in any way, also by a name that it never defined
        remedy = f"plug it in and check the name; ports in use cannot be opened twice ({bitrate} bit/s)"
        if address.interface not in ("socketcan", "slcan"):
            remedy = (
                f"plug it in, check the name and that its maker's library is installed (`beltcomm doctor` lists what is); {bitrate} bit/s"
            )
        if address.interface == "socketcan":
            remedy = f"bring it up with `sudo ip link set {address.channel} up type can bitrate {bitrate}`, with the bit rate of the drive"
            if getattr(error, "errno", None) == errno.EAFNOSUPPORT:
                remedy = "this system's kernel has no CAN (on Linux: `sudo modprobe can can_raw`); containers mostly have none"
        raise BusError(f"the CAN interface {address.channel} cannot be opened: {error}; {remedy}") from error


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
