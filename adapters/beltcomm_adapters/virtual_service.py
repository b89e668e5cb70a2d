"""The virtual drive on a CAN interface for other processes: SocketCAN, a pseudo-terminal, TCP on this computer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beltcomm.drive import Service
from beltcomm.errors import BusError, UsageError
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.serving import Pump
from beltcomm.virtual.slcan import LocalSocket, SlcanAdapter, SlcanTerminal
from beltcomm_adapters.buses import DEFAULT_BITRATE, Address, MonotonicClock, is_can_bus, open_bus
from beltcomm_adapters.link import INTERFACE_ERRORS
from beltcomm_adapters.options import whole_number
from beltcomm_adapters.synctime import TIME_BY_SYNC
from beltcomm_adapters.virtual_node import NODE, OPTIONS, attached, played, ticks_per_second


class ServedDrive:
    """The virtual drive on a CAN interface for other processes; see :class:`beltcomm.drive.Service`.

    Parameters
    ----------
    on : str
        ``slcan`` (a pseudo-terminal), ``socket:PORT`` (TCP on this computer), or an interface of
        :class:`beltcomm_adapters.buses.Address`.
    options : Mapping[str, object]
        As of the adapter ``virtual``, with ``node`` (1). Without ``realtime`` each SYNC is one period of the drive.

    Raises
    ------
    UsageError, BusError
    """

    def __init__(self, address: str, on: str, options: Mapping[str, object]) -> None:
        if unknown := sorted(set(options) - {*OPTIONS, "node"}):
            raise UsageError(f"a served drive has no option {', '.join(unknown)}; leave it out")
        self._realtime = bool(options.get("realtime"))
        node = whole_number(options, "node", NODE, 1, 126) or NODE
        given: Mapping[str, Any] = options
        self._bus = LockstepBus(ticks_per_second=ticks_per_second(options))
        self._bus.on_frame = given.get("log")
        self._wire: Any = None
        try:
            hardware = "virtual" if self._realtime else f"virtual, {TIME_BY_SYNC}"
            drive, plant = attached(self._bus, address, options, node, hardware)
            self._wire, self.reached_as = _wire(on)
        except BaseException:
            self._bus.shutdown()
            raise
        time = "at the wall clock" if self._realtime else "each SYNC is one of its periods"
        profile, _ = played(options)
        self.title = f"virtual:{plant}, profile {profile}, node {node}, {time}"
        self._pump = Pump(self._wire, self._bus, drive, MonotonicClock())

    def run(self) -> Mapping[str, int]:
        """Serve the drive until it is stopped."""
        pump = self._pump
        try:
            (pump.by_wall_clock if self._realtime else pump.by_sync)()
        except KeyboardInterrupt:
            pass
        except INTERFACE_ERRORS as error:
            raise BusError(f"the interface {self.reached_as} does not take or give frames any more ({error}); serve again") from error
        counted = {"frames": pump.frames, "syncs": pump.syncs}
        return {**counted, "missed_ticks": pump.missed_ticks} if self._realtime else counted

    def __enter__(self) -> Service:
        return self

    def __exit__(self, *_exc: object) -> None:
        self._wire.shutdown()
        self._bus.shutdown()


def _wire(on: str) -> tuple[Any, str]:
    """The interface called ``on``, and how another process on this computer calls it."""
    kind, _, port = on.partition(":")
    if on == "slcan":
        line: SlcanTerminal | LocalSocket = SlcanTerminal()
    elif kind == "socket":
        if not (port.isdecimal() and int(port) < 1 << 16):
            raise UsageError(f"{on} names no TCP port; write socket:29536, or socket:0 for any free one")
        line = LocalSocket(int(port))
    else:
        return open_bus(Address.parse(on), DEFAULT_BITRATE), on if is_can_bus(on) else f"can:{on}"
    return SlcanAdapter(line), f"slcan:{line.address}"
