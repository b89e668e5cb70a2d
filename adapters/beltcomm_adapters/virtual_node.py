"""The virtual drive with its machine as a node on a bus: what the virtual axis and the drives that are served have in common."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

from beltcomm.errors import UsageError
from beltcomm.model import load_plant
from beltcomm.plant import DRIVE_KEYS
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.virtual.bus import LockstepBus
from beltcomm.virtual.device import VirtualDrive
from beltcomm.virtual.foreign import profile_named
from beltcomm.virtual.profiles import PROFILES
from beltcomm.virtual.stage import EMMS_AS_70
from beltcomm_adapters.options import number, profile_name, whole_number

DEFAULT_PLANT: Final = "g_a"
DEFAULT_PROFILE: Final = "reference"
NODE: Final = 1
#: s: no bus has a shorter period; and cycles of a drive in one, at most.
SHORTEST_S: Final = 2e-4
LONGEST_COUNT: Final = 200
OPTIONS: Final = (
    "seed",
    "profile",
    "as",
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
    "nameplate",
    *DRIVE_KEYS,
)


def played(options: Mapping[str, object]) -> tuple[str, str | None]:
    """Virtual drive that the options ``as`` and ``profile`` play, and the profile that the host reads it by, None to choose by identity.

    A profile that is not played is the host's: of the reference drive, which is an ordinary CiA 402 drive to whoever knows no more of it.

    Parameters
    ----------
    options : mapping of str to object
        Of the adapter.
    """
    named, slave = profile_name(options), options.get("as")
    if slave is not None:
        return str(slave), named
    return (named or DEFAULT_PROFILE, None) if named is None or named in PROFILES else (DEFAULT_PROFILE, named)


def ticks_per_second(options: Mapping[str, object]) -> int:
    """Ticks in a second of a bus for a virtual drive: one per cycle of its loops, which fit a whole number of times into the sample period.

    Parameters
    ----------
    options : mapping of str to object
        Of the adapter, with the sample period asked for.
    """
    cycle_s, asked_s = profile_named(played(options)[0]).cycle_s, number(options, "sample_period", None)
    if not asked_s or asked_s < SHORTEST_S:
        return round(1.0 / cycle_s)
    for count in range(max(1, round(asked_s / cycle_s)), LONGEST_COUNT):
        per_second = count / asked_s
        if abs(per_second - round(per_second)) < 1e-6:
            return round(per_second)
    return round(1.0 / cycle_s)


def attached(
    bus: LockstepBus, address: str, options: Mapping[str, object], node: int = NODE, hardware: str = "virtual"
) -> tuple[VirtualDrive, str]:
    """The drive of these options (see :func:`beltcomm_adapters.virtual._playing`) on ``bus``, and its plant's name.

    Parameters
    ----------
    bus : LockstepBus
        Of virtual time.
    address : str
        Plant, "" for the usual one.
    options : mapping of str to object
        Of the adapter.
    node, hardware
        Its number, its 1009h.

    Raises
    ------
    UsageError
    """
    if unknown := sorted(set(options) - set(OPTIONS)):
        raise UsageError(f"the virtual drive has no option {', '.join(unknown)}; leave it out")
    file = load_plant(address or DEFAULT_PLANT, {key: options[key] for key in DRIVE_KEYS if key in options})
    start_m = number(options, "start_position", file.start_position_m)
    assert start_m is not None
    given: Mapping[str, Any] = options
    referenced = bool(options.get("referenced", True))
    drive = VirtualDrive(
        bus,
        given.get("plant") or SimulatedPlant(file.model, position_m=start_m),
        played(options)[0],
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
