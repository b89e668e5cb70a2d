"""The virtual axis: a simulated drive and machine on a virtual CAN bus, driven by the same adapter as a real one.

The only module of this package that knows :mod:`beltcomm.virtual`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from beltcomm.drive import Adapter, Drive
from beltcomm.errors import UsageError
from beltcomm.model import load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm_adapters.buses import MonotonicClock
from beltcomm_adapters.canopen import connect, profile_name, whole_number

DEFAULT_PLANT: Final = "g_a"
#: m; the middle of the rig's 0 to 0.5 m.
DEFAULT_START_M: Final = 0.25
_NODE: Final = 1
_OPTIONS: Final = ("seed", "profile", "realtime", "plant", "start_position", "referenced", "faults", "bus_faults", "log")


def _open(address: str, options: Mapping[str, object]) -> Drive:
    """``address``: a plant's name or path, "" for g_a.  Options:

    seed : whole number, of the torque noise (0).     profile : "reference" or "cmmp-as".     realtime : run at the wall clock.
    start_position : m, where the carriage stands (0.25).     referenced : the encoder knows the carriage's zero (yes).
    plant : a :class:`beltcomm.plant.Plant` in place of the plant file's model; its delay and noise stay.
    faults, bus_faults : ``Faults`` and ``BusFaults`` of :mod:`beltcomm.virtual.faults`.     log : called with every frame.
    """
    if unknown := sorted(set(options) - set(_OPTIONS)):
        raise UsageError(f"the virtual drive has no option {', '.join(unknown)}; leave it out")
    file = load_plant(address or DEFAULT_PLANT)
    start_m = _number(options, "start_position", DEFAULT_START_M)
    given: Mapping[str, Any] = options  # objects are handed over by programs only, of the types named above
    plant = given.get("plant") or SimulatedPlant(file.model, position_m=start_m)
    referenced = bool(options.get("referenced", True))
    bus = LockstepBus(MonotonicClock() if options.get("realtime") else None, given.get("bus_faults"))
    bus.on_frame = given.get("log")
    try:
        VirtualDrive(
            bus,
            plant,
            profile_name(options) or "reference",
            node_id=_NODE,
            seed=whole_number(options, "seed", 0, 0, 2**63 - 1) or 0,
            counts_per_rev=file.counts_per_rev,
            setpoint_delay_s=file.setpoint_delay_s,
            torque_noise_nm=file.torque_noise_nm,
            zero_rad=-start_m / file.model["transmission.ratio"] if referenced else 0.0,
            referenced=referenced,
            faults=given.get("faults"),
            brake=(file.brake_torque_nm, file.brake_time_s),
        )
    except BaseException:
        bus.shutdown()
        raise
    drive = connect(bus, bus.clock, _NODE, None, None, bus.shutdown)
    identity = {**drive.capabilities.identity, "plant": file.model.name}  # the machine behind it is part of what a run was made on
    drive.capabilities = replace(drive.capabilities, identity=identity)
    return drive


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
)
