"""This machine by itself: network interfaces, USB devices, kernel modules, ports and permissions; read only."""

from __future__ import annotations

import importlib
import json
import os
import socket
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from beltcomm import isolation

_CAN_TYPE: Final = 280  # ARPHRD_CAN
_UP: Final = 0x1  # IFF_UP
_IP_TIME_S: Final = 3.0


@dataclass(frozen=True)
class Interface:
    """One SocketCAN interface.

    Attributes
    ----------
    bitrate : int or None
        bit/s, None where it has none (vcan) or nobody tells.
    state : str
        Of its CAN controller, "" where nobody tells.
    """

    name: str
    up: bool
    kind: str = "can"
    bitrate: int | None = None
    state: str = ""


@dataclass(frozen=True)
class SerialPortInfo:
    """One serial port.

    Attributes
    ----------
    usb : tuple[int, int] or None
        Vendor and product number, None when it is no USB device.
    group : str
        That may use it, "" unknown.
    """

    device: str
    description: str
    usb: tuple[int, int] | None
    may_use: bool
    group: str = ""


def _ip_link() -> str:
    """Output of ``ip``; "" where it is missing or fails."""
    try:
        done = isolation.run(["ip", "-details", "-json", "link", "show"], _IP_TIME_S)
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.decode(errors="replace") if done.returncode == 0 else ""


def _can_socket() -> bool:
    family = getattr(socket, "AF_CAN", None)
    if family is None:
        return False
    try:
        socket.socket(family, socket.SOCK_RAW, socket.CAN_RAW).close()
    except OSError:
        return False
    return True


@dataclass(frozen=True)
class Host:
    """This machine; every field can be another one's in a test.

    Attributes
    ----------
    sys : Path
        Root of sysfs.
    ip_link : callable
        JSON of ``ip -details -json link show``.
    has_can : callable
        Whether the kernel opens CAN sockets.
    """

    sys: Path = Path("/sys")
    ip_link: Callable[[], str] = _ip_link
    has_can: Callable[[], bool] = _can_socket

    def interfaces(self) -> list[Interface]:
        """All SocketCAN interfaces, up or down."""
        told = self._told()
        found = []
        for folder in sorted((self.sys / "class" / "net").glob("*")):
            if _number(folder / "type", 10) != _CAN_TYPE:
                continue
            info = told.get(folder.name, {}).get("linkinfo", {})
            data = info.get("info_data", {})
            rate = data.get("bittiming", {}).get("bitrate")
            up = bool(_number(folder / "flags", 16) & _UP)
            found.append(Interface(folder.name, up, info.get("info_kind", "can"), rate, data.get("state", "")))
        return found

    def usb_devices(self) -> set[tuple[int, int]]:
        """Vendor and product numbers of everything plugged in."""
        folders = (self.sys / "bus" / "usb" / "devices").glob("*")
        pairs = {(_number(folder / "idVendor", 16), _number(folder / "idProduct", 16)) for folder in folders}
        return {(vendor, product) for vendor, product in pairs if vendor >= 0}

    def _told(self) -> dict[str, Any]:
        """Answer of ``ip`` on each interface, by name."""
        try:
            return {entry["ifname"]: entry for entry in json.loads(self.ip_link() or "[]") if "ifname" in entry}
        except (ValueError, TypeError):
            return {}


def ports() -> list[SerialPortInfo]:
    """All serial ports of this machine, and whether this user may open them."""
    found = []
    for port in sorted(_comports(), key=lambda port: str(port.device)):
        usb = None if port.vid is None or port.pid is None else (int(port.vid), int(port.pid))
        described = "" if port.description in (None, "n/a") else str(port.description)
        device = str(port.device)
        allowed = not device.startswith("/") or os.access(device, os.R_OK | os.W_OK)
        found.append(SerialPortInfo(device, described, usb, allowed, group_of(device)))
    return found


def _comports() -> list[Any]:
    tools: Any = importlib.import_module("serial.tools.list_ports")  # it has no types
    return list(tools.comports())


def group_of(device: str) -> str:
    """Name of the group that owns a device file, "" where there is none to tell.

    Parameters
    ----------
    device : str
        Path.
    """
    try:
        return Path(device).group()
    except (OSError, KeyError, NotImplementedError):
        return ""


def _number(path: Path, base: int) -> int:
    """The number in a file of sysfs, -1 when there is none."""
    try:
        return int(path.read_text(encoding="ascii").strip(), base)
    except (OSError, ValueError):
        return -1
