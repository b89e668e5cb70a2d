"""From the address of a drive to an open CAN bus of python-can."""

from __future__ import annotations

import errno
import logging
import re
import socket
import time
from dataclasses import dataclass
from typing import Any, Final

import can

from beltcomm.errors import BusError, UsageError

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
        """``can0``, ``vcan0`` (SocketCAN) · ``/dev/ttyACM0``, ``COM3``, ``socket://host:port`` (slcan) · ``pcan:PCAN_USBBUS1``
        (any interface of python-can).  Raises UsageError."""
        if is_socketcan(text):
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


def is_socketcan(name: str) -> bool:
    """True if a drive's name is that of a SocketCAN interface."""
    return _SOCKETCAN.fullmatch(name) is not None


def is_can_bus(name: str) -> bool:
    """True if a drive's name is that of a SocketCAN interface, or begins with an interface of python-can (``pcan:PCAN_USBBUS1``)."""
    return is_socketcan(name) or name.partition(":")[0] in can.VALID_INTERFACES


def open_bus(address: Address, bitrate: int, **more: Any) -> can.BusABC:
    """Open the interface; ``more`` goes to python-can.  Raises BusError, UsageError when python-can lacks what the interface needs."""
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
