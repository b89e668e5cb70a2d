"""Ways from this machine to a drive: SocketCAN, python-can's interfaces, serial CAN adapters, ports."""

from __future__ import annotations

import contextlib
import importlib
import logging
import threading
import warnings
from collections.abc import Callable, Iterator
from functools import cache
from typing import Any, Final

import can
from can.interfaces import BACKENDS

from beltcomm.drive.finding import Finding, Values
from beltcomm_adapters.examination.host import Host, Interface, SerialPortInfo, ports

_AREA: Final = "this machine"
#: USB CAN adapters that need a kernel driver to become can0: (vendor, product or None for all) -> name, module.
#: Product numbers as in the kernel's drivers/net/can/usb.
_USB_CAN: Final[dict[tuple[int, int | None], tuple[str, str]]] = {
    (0x0C72, None): ("PEAK PCAN-USB", "peak_usb"),
    (0x1D50, 0x606F): ("candleLight / CANable with candleLight firmware", "gs_usb"),
    (0x1209, 0x2323): ("candleLight", "gs_usb"),
    (0x1CD2, 0x606F): ("CES CANext FD", "gs_usb"),
    (0x0BFD, None): ("Kvaser", "kvaser_usb"),
    (0x12D6, 0x0444): ("EMS CPC-USB", "ems_usb"),
    (0x0483, 0x1234): ("8devices USB2CAN", "usb_8dev"),
    (0x04D8, 0x0A30): ("Microchip CAN BUS Analyzer", "mcba_usb"),
    (0x0AB4, 0x0010): ("esd CAN-USB/2", "esd_usb"),
}
#: Serial ports that speak slcan, by USB vendor and product.
_SLCAN: Final = {
    (0xAD50, 0x60C4): "CANable with slcan firmware",
    (0x16D0, 0x117E): "CANable 2.0 with slcan firmware",
    (0x04D8, 0x000A): "USBtin",
    (0x0403, 0xFFA8): "Lawicel CANUSB",
}
#: Interfaces of python-can whose adapters hang on this machine and are searched for there; others listen on the network (socketcand), open
#: ports that may belong to anything (robotell), reach no drive (virtual), or are covered by the rest of this list.
_SEARCHED: Final = frozenset({
    "canalystii", "cantact", "etas", "gs_usb", "iscan", "ixxat", "kvaser", "neousys", "neovi", "nican", "nixnet", "pcan", "systec",
    "usb2can", "vector",
})  # fmt: skip
#: s, after which a maker's library that searches its adapters is given up.
_SEARCH_S: Final = 5.0


def surroundings(
    host: Host | None = None,
    list_ports: Callable[[], list[SerialPortInfo]] = ports,
    backends: Callable[[], dict[str, str]] | None = None,
    detect: Callable[[list[str]], list[dict[str, Any]] | None] | None = None,
) -> Iterator[Finding]:
    """Findings on the interfaces and ports of this machine, best first; the arguments stand in for it in tests.

    Parameters
    ----------
    host : Host or None
        None for this one.
    list_ports : callable
        Lists serial ports.
    backends : callable or None
        Tells which interfaces of python-can can be imported; None asks it.
    detect : callable or None
        Tells which of them have a device; None asks them.
    """
    host = host or Host()
    reasons = (backends or _importable)()
    yield from _socketcan(host)
    yield from _ports(list_ports())
    yield from _python_can(reasons, detect or _detected)


def _socketcan(host: Host) -> Iterator[Finding]:
    interfaces = host.interfaces()
    yield from map(_interface, interfaces)
    if not interfaces:
        if host.has_can():
            yield Finding(
                _AREA, "socketcan", "warning", "there is no SocketCAN interface (can0)",
                "plug the CAN adapter in; for a serial one see the ports below",
            )  # fmt: skip
        else:
            yield Finding(
                _AREA, "socketcan", "warning", "the kernel of this machine opens no CAN sockets, so there can be no can0",
                "on Linux: `sudo modprobe can can_raw`; containers mostly have none; a serial CAN adapter (slcan:) works without",
            )  # fmt: skip
    names = {interface.kind for interface in interfaces}
    for vendor, product in sorted(host.usb_devices()):
        known = _USB_CAN.get((vendor, product)) or _USB_CAN.get((vendor, None))
        if known and not names & {"can"}:
            adapter, module = known
            yield Finding(
                _AREA, f"usb {vendor:04x}:{product:04x}", "wrong",
                f"a CAN adapter is plugged in ({adapter}, USB {vendor:04x}:{product:04x}), but it has no can0: its driver is missing",
                f"`sudo modprobe {module}`, then `beltcomm doctor` again",
            )  # fmt: skip


def _interface(one: Interface) -> Finding:
    rate = f" at {one.bitrate // 1000} kbit/s" if one.bitrate else ""
    values: Values = {"up": one.up, "kind": one.kind, "controller": one.state}
    if one.bitrate:
        values["bitrate"] = one.bitrate
    if not one.up:
        return Finding(_AREA, one.name, "warning", f"{one.name} is down", f"`{bring_up(one)}`, with the bit rate of the drive", values)
    if one.state == "BUS-OFF":
        return Finding(_AREA, one.name, "wrong", f"{one.name} is up{rate}, but bus-off", restart(one.name), values)
    state = f", {one.state.lower()}" if one.state else ""
    return Finding(_AREA, one.name, "ok", f"{one.name} is up{rate}{state}", f"`beltcomm doctor --drive {one.name}`", values)


def bring_up(one: Interface) -> str:
    """The command that brings an interface up.

    Parameters
    ----------
    one : Interface
        With kind and bit rate.
    """
    if one.kind in ("vcan", "slcan"):
        return f"sudo ip link set {one.name} up"
    return f"sudo ip link set {one.name} up type can bitrate {one.bitrate or 1_000_000} restart-ms 100"


def restart(name: str) -> str:
    """Remedy for a controller that has gone bus-off.

    Parameters
    ----------
    name : str
        Of the interface.
    """
    return (
        "check bit rate, cable (CAN high and low swapped, short circuit) and both terminators, then "
        f"`sudo ip link set {name} down` and up again; `restart-ms 100` makes it come back by itself"
    )


def _ports(found: list[SerialPortInfo]) -> Iterator[Finding]:
    for port in found:
        adapter = _SLCAN.get(port.usb) if port.usb else None
        usb = f", USB {port.usb[0]:04x}:{port.usb[1]:04x}" if port.usb else ""
        name = f"{port.device} ({adapter or port.description or 'serial port'}{usb})"
        values: Values = {"device": port.device, "may_use": port.may_use, "slcan": adapter is not None}
        if not port.may_use:
            yield Finding(_AREA, port.device, "wrong", f"{name}: you may not open it", permission(port.group), values)
        elif adapter:
            yield Finding(
                _AREA, port.device, "ok", f"{name} is a serial CAN adapter", f"`beltcomm doctor --drive slcan:{port.device}`", values
            )
        else:
            hint = (
                f"if it is a serial CAN adapter: `beltcomm doctor --drive slcan:{port.device}`; if a drive's RS-232: serial:{port.device}"
            )
            yield Finding(_AREA, port.device, "ok", name, hint, values)
    if not found:
        yield Finding(_AREA, "serial ports", "ok", "there is no serial port")


def permission(group: str) -> str:
    """Remedy for a port that this user may not open.

    Parameters
    ----------
    group : str
        That owns it; "" where that is not known.
    """
    if group in ("", "root"):
        return "ask who administers this machine for the right to open it (a udev rule)"
    return f"`sudo usermod -aG {group} $USER`, then log out and in again"


def _python_can(reasons: dict[str, str], detect: Callable[[list[str]], list[dict[str, Any]] | None]) -> Iterator[Finding]:
    usable = sorted(name for name, reason in reasons.items() if not reason)
    values: Values = {name: reason or "usable" for name, reason in sorted(reasons.items())}
    text = f"python-can {can.__version__} can use {', '.join(usable) or 'nothing'}"
    if broken := sorted(set(reasons) - set(usable)):
        text += f"; {len(broken)} more need their maker's library or another system ({', '.join(broken)})"
    yield Finding(_AREA, "python-can", "ok" if usable else "wrong", text, "" if usable else "`pip install python-can`", values)
    searched = [name for name in usable if name in _SEARCHED]
    if not searched:
        return
    found = detect(searched)
    if found is None:
        text = f"the search of {', '.join(searched)} for adapters did not end within {_SEARCH_S:g} s"
        yield Finding(_AREA, "search", "unknown", text, "name yours: `beltcomm doctor --drive can:INTERFACE:CHANNEL`")
    for entry in found or []:
        name = f"can:{entry['interface']}:{entry['channel']}"
        yield Finding(_AREA, name, "ok", f"{name} is there", f"`beltcomm doctor --drive {name}`")


class _Kept(logging.Handler):
    """Log of the library while an interface is imported: a missing driver of its maker."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.said = ""

    def emit(self, record: logging.LogRecord) -> None:
        self.said = self.said or record.getMessage()


@contextlib.contextmanager
def _kept_log() -> Iterator[_Kept]:
    kept, logger = _Kept(), logging.getLogger("can")
    before = logger.propagate
    logger.propagate = False
    logger.addHandler(kept)
    try:
        yield kept
    finally:
        logger.removeHandler(kept)
        logger.propagate = before


@cache  # a library complains at its first import only
def _importable() -> dict[str, str]:
    """Interfaces of python-can: why each cannot be used here, "" where it can."""
    reasons = {}
    for name, (module, attribute) in BACKENDS.items():
        with _kept_log() as kept, warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                getattr(importlib.import_module(module), attribute)
            except Exception as error:  # a maker's library may fail in any way
                kept.said = f"{type(error).__name__}: {error}"
        reasons[name] = kept.said
    return reasons


def _detected(interfaces: list[str]) -> list[dict[str, Any]] | None:
    """Adapters that python-can finds at these interfaces; None when the search does not end in time."""
    found: list[dict[str, Any]] = []

    def search() -> None:
        with _kept_log(), contextlib.suppress(Exception):  # a maker's library may fail in any way
            found.extend(dict(entry) for entry in can.detect_available_configs(interfaces, timeout=_SEARCH_S))

    thread = threading.Thread(target=search, daemon=True)  # one that hangs must not keep the command alive
    thread.start()
    thread.join(_SEARCH_S + 1.0)
    return None if thread.is_alive() else found
