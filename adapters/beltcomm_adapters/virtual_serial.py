"""The virtual axis at the RS-232 port of its drive: inside this process in virtual time, or for others on a pseudo-terminal."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self

from beltcomm.drive import Drive
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.service_port import LockstepPort, PseudoTerminal, ServicePort
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.options import profile_name
from beltcomm_adapters.serial_drive import SerialDrive
from beltcomm_adapters.virtual_node import attached

_OPTIONS = ("bitrate", "line_faults")


def open_serial(address: str, options: Mapping[str, object], bitrate: int) -> Drive:
    """The virtual drive at its RS-232 port, in virtual time.

    Parameters
    ----------
    address, options
        As of the adapter ``virtual``.
    bitrate : int
        bit/s of the session. Further option: line_faults, a :class:`beltcomm.virtual.service_port.LineFaults`.
    """
    bus = LockstepBus(MonotonicClock() if options.get("realtime") else None)
    port, plant = _port(bus, address, options)
    end = LockstepPort(bus, port)

    def release() -> None:
        end.close()
        bus.shutdown()

    try:
        drive = SerialDrive(end, bus.clock, bitrate, profile_name(options), release)
    except BaseException:
        release()
        raise
    drive.capabilities = replace(drive.capabilities, identity={**drive.capabilities.identity, "plant": plant, "hardware": "virtual"})
    return drive


class ServedSerial:
    """The virtual drive's RS-232 port on a pseudo-terminal, at the wall clock, for other processes.   Use as a context manager.

    reached_as : what another process gives as ``--drive``.     title : what is served there, in words.

    Parameters
    ----------
    address, options
        As of :func:`open_serial`.

    Raises
    ------
    UsageError
    """

    def __init__(self, address: str, options: Mapping[str, object]) -> None:
        self._bus = LockstepBus(MonotonicClock())
        try:
            port, plant = _port(self._bus, address, options)
            self._terminal = PseudoTerminal(self._bus, port)
        except BaseException:
            self._bus.shutdown()
            raise
        self.reached_as = f"serial:{self._terminal.path}"
        self.title = (
            f"serial:virtual:{plant}, profile {profile_name(options) or 'reference'}, RS-232 on a pseudo-terminal, at the wall clock"
        )

    def run(self) -> Mapping[str, int]:
        """Serve until KeyboardInterrupt, which is the ordinary end; returns what was counted."""
        with contextlib.suppress(KeyboardInterrupt):
            self._terminal.serve(lambda: True)
        return {"ticks": self._bus.tick, "missed_ticks": self._bus.missed_cycles}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_exc: object) -> None:
        self._terminal.close()
        self._bus.shutdown()


def _port(bus: LockstepBus, address: str, options: Mapping[str, object]) -> tuple[ServicePort, str]:
    """A virtual drive on ``bus``, its port and its plant's name; without a drive the bus is shut down."""
    given: Mapping[str, Any] = options
    try:
        drive, plant = attached(bus, address, {name: value for name, value in options.items() if name not in _OPTIONS})
    except BaseException:
        bus.shutdown()
        raise
    return ServicePort(bus, drive, given.get("line_faults")), plant
