"""The virtual axis: a simulated drive and machine on a virtual CAN bus, driven by the same adapter as a real one.

The only module of this package that knows :mod:`beltcomm.virtual`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from beltcomm.drive import Adapter, Drive, Service
from beltcomm.errors import BusError, UsageError
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.serving import Pump
from beltcomm.virtual.slcan import LocalSocket, PseudoTerminal, SlcanAdapter
from beltcomm_adapters.buses import DEFAULT_BITRATE, Address, MonotonicClock, is_socketcan, open_bus
from beltcomm_adapters.canopen import connect, profile_name, whole_number
from beltcomm_adapters.link import INTERFACE_ERRORS
from beltcomm_adapters.synctime import TIME_BY_SYNC

DEFAULT_PLANT: Final = "g_a"
#: m; the middle of the rig's 0 to 0.5 m.
DEFAULT_START_M: Final = 0.25
_NODE: Final = 1
_OPTIONS: Final = ("seed", "profile", "realtime", "plant", "start_position", "referenced", "faults", "log")


def _open(address: str, options: Mapping[str, object]) -> Drive:
    """``address``: a plant's name or path, "" for g_a.  Options:

    seed : whole number, of the torque noise (0).     profile : "reference" or "cmmp-as".     realtime : run at the wall clock.
    start_position : m, where the carriage stands (0.25).     referenced : the encoder knows the carriage's zero (yes).
    plant : a :class:`beltcomm.plant.Plant` in place of the plant file's model; its delay and noise stay.
    faults : a :class:`beltcomm.virtual.faults.Faults`.     log : called with every frame.
    """
    if unknown := sorted(set(options) - set(_OPTIONS)):
        raise UsageError(f"the virtual drive has no option {', '.join(unknown)}; leave it out")
    given: Mapping[str, Any] = options  # objects are handed over by programs only, of the types named above
    bus = LockstepBus(MonotonicClock() if options.get("realtime") else None)
    bus.on_frame = given.get("log")
    try:
        _, plant = _attached(bus, address, options)
    except BaseException:
        bus.shutdown()
        raise
    drive = connect(bus, bus.clock, _NODE, None, None, bus.shutdown)
    identity = {**drive.capabilities.identity, "plant": plant}  # the machine behind it is part of what a run was made on
    drive.capabilities = replace(drive.capabilities, identity=identity)
    return drive


def _attached(
    bus: LockstepBus, address: str, options: Mapping[str, object], node: int = _NODE, hardware: str = "virtual"
) -> tuple[VirtualDrive, str]:
    """The drive of these options (see :func:`_open`) on ``bus``, and its plant's name.   node, hardware : its number, its 1009h."""
    file = load_plant(address or DEFAULT_PLANT)
    start_m = _number(options, "start_position", DEFAULT_START_M)
    given: Mapping[str, Any] = options
    referenced = bool(options.get("referenced", True))
    drive = VirtualDrive(
        bus,
        given.get("plant") or SimulatedPlant(file.model, position_m=start_m),
        profile_name(options) or "reference",
        node_id=node,
        seed=whole_number(options, "seed", 0, 0, 2**63 - 1) or 0,
        counts_per_rev=file.counts_per_rev,
        setpoint_delay_s=file.setpoint_delay_s,
        torque_noise_nm=file.torque_noise_nm,
        zero_rad=-start_m / file.model["transmission.ratio"] if referenced else 0.0,
        referenced=referenced,
        faults=given.get("faults"),
        brake=(file.brake_torque_nm, file.brake_time_s),
        hardware=hardware,
    )
    return drive, file.model.name


class Served:
    """The virtual drive on a CAN interface for other processes; see :class:`beltcomm.drive.Service`.

    on : ``slcan`` (a pseudo-terminal), ``socket:PORT`` (TCP on this computer), or an interface of :class:`beltcomm_adapters.buses.Address`.
    options : as of :func:`_open`, with ``node`` (1).   Without ``realtime`` each SYNC is one period of the drive.
    Raises UsageError, BusError.
    """

    def __init__(self, address: str, on: str, options: Mapping[str, object]) -> None:
        if unknown := sorted(set(options) - {*_OPTIONS, "node"}):
            raise UsageError(f"a served drive has no option {', '.join(unknown)}; leave it out")
        self._realtime = bool(options.get("realtime"))
        node = whole_number(options, "node", _NODE, 1, 126) or _NODE
        given: Mapping[str, Any] = options
        self._bus = LockstepBus()
        self._bus.on_frame = given.get("log")
        self._wire: Any = None
        try:
            hardware = "virtual" if self._realtime else f"virtual, {TIME_BY_SYNC}"
            drive, plant = _attached(self._bus, address, options, node, hardware)
            self._wire, self.reached_as = _wire(on)
        except BaseException:
            self._bus.shutdown()
            raise
        time = "at the wall clock" if self._realtime else "each SYNC is one of its periods"
        profile = profile_name(options) or "reference"
        self.title = f"virtual:{plant}, profile {profile}, node {node}, {time}"
        self._pump = Pump(self._wire, self._bus, drive, MonotonicClock())

    def run(self) -> Mapping[str, int]:
        """See :class:`beltcomm.drive.Service`."""
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
        line: PseudoTerminal | LocalSocket = PseudoTerminal()
    elif kind == "socket":
        if not (port.isdecimal() and int(port) < 1 << 16):
            raise UsageError(f"{on} names no TCP port; write socket:29536, or socket:0 for any free one")
        line = LocalSocket(int(port))
    else:
        return open_bus(Address.parse(on), DEFAULT_BITRATE), on if is_socketcan(on) else f"can:{on}"
    return SlcanAdapter(line), f"slcan:{line.address}"


def _number(options: Mapping[str, object], name: str, default: float) -> float:
    value = options.get(name)
    if value is None:
        return default
    try:
        return float(str(value))
    except ValueError:
        raise UsageError(f"the option {name} must be a number, not {value}") from None


ADAPTER = Adapter(
    name="virtual",
    summary="simulated drive and axis: virtual, virtual:PLANT (a shipped plant's name, or a path to a plant file)",
    schemes=("virtual",),
    open=_open,
    serve=Served,
)
