"""The virtual axis: a simulated drive and machine on a virtual CAN bus, driven by the same adapter as a real one.

The only module of this package that knows :mod:`beltcomm.virtual`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, Final

from beltcomm.drive import Adapter, Drive, Service
from beltcomm.drive_section import DRIVE_KEYS
from beltcomm.errors import UsageError
from beltcomm.finding import Finding
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.motor import EMMS_AS_70
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.canopen import EXAMINATION_OPTIONS, connect, number, profile_name, whole_number
from beltcomm_adapters.examination.can import examine_bus

DEFAULT_PLANT: Final = "g_a"
#: m; the middle of the rig's 0 to 0.5 m.
DEFAULT_START_M: Final = 0.25
NODE: Final = 1
OPTIONS: Final = (
    "seed",
    "profile",
    "realtime",
    "bitrate",
    "sample_period",
    "plant",
    "start_position",
    "referenced",
    "gain_units",
    "faults",
    "bus_faults",
    "log",
    *DRIVE_KEYS,
)


def _playing(address: str, options: Mapping[str, object]) -> tuple[LockstepBus, str]:
    """The bus with the drive on it, and the machine's name.   ``address``: a plant's name or path, "" for g_a.  Options:

    seed : whole number, of the torque noise (0).     profile : "reference" or "cmmp-as".     realtime : run at the wall clock.
    start_position : m, where the carriage stands (0.25).     referenced : the encoder knows the carriage's zero (yes).
    bitrate : that its exchange is planned for, None for a bus that carries any load.     sample_period : s, asked for.
    gain_units : (velocity, position, integral time): what one unit of the drive's gains means, in those of docs/reference-drive.md.
    plant : a :class:`beltcomm.plant.Plant` in place of the plant file's model; its delay and noise stay.
    any key of a plant file's drive section (docs/simulated.md): in place of the file's.
    faults, bus_faults : ``Faults`` and ``BusFaults`` of :mod:`beltcomm.virtual.faults`.     log : called with every frame.
    """
    given: Mapping[str, Any] = options  # objects are handed over by programs only, of the types named above
    bus = LockstepBus(MonotonicClock() if options.get("realtime") else None, given.get("bus_faults"))
    bus.on_frame = given.get("log")
    try:
        _, machine = attached(bus, address, options)
    except BaseException:
        bus.shutdown()
        raise
    return bus, machine


def _open(address: str, options: Mapping[str, object]) -> Drive:
    bus, machine = _playing(address, options)
    bitrate = whole_number(options, "bitrate", None, 10_000, 1_000_000)
    drive = connect(bus, bus.clock, NODE, None, bitrate, bus.shutdown, number(options, "sample_period", None))
    identity = {**drive.capabilities.identity, "plant": machine}  # the machine behind it is part of what a run was made on
    drive.capabilities = replace(drive.capabilities, identity=identity)
    return drive


def attached(
    bus: LockstepBus, address: str, options: Mapping[str, object], node: int = NODE, hardware: str = "virtual"
) -> tuple[VirtualDrive, str]:
    """The drive of these options (see :func:`_playing`) on ``bus``, and its plant's name.   node, hardware : its number, its 1009h.

    Raises UsageError.
    """
    if unknown := sorted(set(options) - set(OPTIONS)):
        raise UsageError(f"the virtual drive has no option {', '.join(unknown)}; leave it out")
    file = load_plant(address or DEFAULT_PLANT, {key: options[key] for key in DRIVE_KEYS if key in options})
    start_m = number(options, "start_position", DEFAULT_START_M)
    assert start_m is not None
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
        motor=replace(EMMS_AS_70, **file.motor),
        zero_rad=-start_m / file.model["transmission.ratio"] if referenced else 0.0,
        referenced=referenced,
        faults=given.get("faults"),
        gain_units=given.get("gain_units") or (1.0, 1.0, 1.0),
        brake=(file.brake_torque_nm, file.brake_time_s),
        hardware=hardware,
        instruments=file.instruments,
    )
    return drive, file.model.name


def _examine(address: str, options: Mapping[str, object]) -> Iterator[Finding]:
    own = {name: value for name, value in options.items() if name not in EXAMINATION_OPTIONS}
    bus, _ = _playing(address, own)
    try:
        yield from examine_bus(bus, bus.clock, NODE, None, None, options)
    finally:
        bus.shutdown()


def _serve(address: str, on: str, options: Mapping[str, object]) -> Service:
    if on == "rs232":
        from beltcomm_adapters.virtual_serial import ServedSerial

        return ServedSerial(address, options)
    from beltcomm_adapters.virtual_service import Served

    return Served(address, on, options)


ADAPTER = Adapter(
    name="virtual",
    summary="simulated drive and axis: virtual, virtual:PLANT (a shipped plant's name, or a path to a plant file)",
    schemes=("virtual",),
    open=_open,
    examine=_examine,
    serve=_serve,
    logs=True,
)
