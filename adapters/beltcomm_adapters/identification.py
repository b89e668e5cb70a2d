"""Identity and capabilities of a connected drive, as read from it or from its profile."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from beltcomm.drive import Capabilities, KnownMotor, StatedReading
from beltcomm.drive.objects import ParameterObject
from beltcomm.drive.parameters import gain_access
from beltcomm.errors import BusError, DriveError, ObjectRefused
from beltcomm_adapters.busload import fullest, plan_exchange
from beltcomm_adapters.gains import structure_of
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import Objects
from beltcomm_adapters.setpoints import OFFSET_MODES
from beltcomm_adapters.units import RPM

HOMING_MODE = 6
#: Velocity and torque offset.
OFFSETS: Final[tuple[tuple[int, int, str], ...]] = ((0x60B1, 0, "int32"), (0x60B2, 0, "int16"))
_MODE_BITS = {1: 0, 2: 1, 3: 2, 4: 3, 6: 5, 7: 6, 8: 7, 9: 8, 10: 9}  # 6502h
#: s: periods are whole numbers of this.   s: no drive's velocity loop is slower, where it does not tell.
_GRID_S = 1e-6
LONGEST_LOOP_S = 1e-3
#: rad/s: what motors do, where nobody tells more.
FASTEST_RAD_S = 1e3
#: s and periods: a host that is no real-time system falls silent for some ms without being dead, and speaks once a period at most.
SHORTEST_GUARD_S, GUARD_PERIODS = 0.02, 5


def read_identity(objects: Objects, where: str) -> dict[str, str]:
    """Identity that tells this drive from others: 1018h, 1008h to 100Ah, as text.

    Parameters
    ----------
    objects : Objects
    where : str
        Interface, bit rate and node, for the sentence.

    Raises
    ------
    BusError
        When nobody answers.
    DriveError
        When two drives do.
    """
    try:
        device_type = objects.read_int(0x1000, 0, "uint32")
    except BusError as error:
        raise BusError(
            f"no drive answers on {where}; check that it is on, its node number and bit rate, the cable and both terminators"
        ) from error
    identity = {"device_type": f"{device_type:08X}h"}
    for subindex, key in enumerate(("vendor_id", "product_code", "revision", "serial_number"), start=1):
        try:
            value = objects.read_if_there(0x1018, subindex, "uint32")
        except ObjectRefused:
            value = None
        if value is not None:
            identity[key] = str(value)
    for index, key in ((0x1008, "device_name"), (0x1009, "hardware"), (0x100A, "firmware")):
        if text := objects.read_text(index):
            identity[key] = text
    if objects.twice:
        raise DriveError(
            f"every question on {where} is answered twice: two drives have this node number, and both would move; switch one of them off, "
            "or give it another number with the maker's tool"
        )
    return identity


def supported_modes(objects: Objects, profile: Profile) -> frozenset[int]:
    """Modes of operation the drive has: 6502h, or the profile's word where the drive does not tell.

    Parameters
    ----------
    objects : Objects
    profile : Profile
    """
    bits = objects.read_if_there(0x6502, 0, "uint32")
    if bits is None:
        return frozenset(profile.supported_modes)
    return frozenset(mode for mode, bit in _MODE_BITS.items() if bits >> bit & 1)


def as_the_drive_is(objects: Objects, profile: Profile) -> Profile:
    """The profile with the modes that the drive has, and without the offsets 60B1h and 60B2h where it lacks one: no motion needs them.

    Parameters
    ----------
    objects : Objects
    profile : Profile
    """
    profile = profile.with_modes(supported_modes(objects, profile))
    if not profile.offsets or all(objects.read_if_there(*offset) is not None for offset in OFFSETS):
        return profile
    return replace(profile, offsets=False, structure={**profile.structure, "velocity_feedforward": False, "torque_feedforward": False})


def sync_period_s(objects: Objects) -> float | None:
    """Period of SYNC by 60C2h, s; None when the drive has no such object or does not use it (0).

    Parameters
    ----------
    objects : Objects
    """
    value = objects.read_if_there(0x60C2, 1, "uint8")
    return value * 10.0 ** objects.read_int(0x60C2, 2, "int8") if value else None


def sync_steps(objects: Objects, profile: Profile) -> tuple[float, float]:
    """Shortest period of SYNC and its step, s: the profile's, in whole runs of the drive's loop where it tells that.

    Where a new period acts after a reset only, the whole cascade is locked to the stored one.

    Parameters
    ----------
    objects : Objects
    profile : Profile
    """
    shortest_s, step_s = profile.shortest_sync_ms * 1e-3, profile.sync_step_ms * 1e-3
    if profile.sync_change == "after_reset":
        stored_s = sync_period_s(objects)
        return (max(stored_s, shortest_s),) * 2 if stored_s else (shortest_s, step_s)
    loop_s = _loop_period_s(objects, profile)
    if loop_s is not None:  # a setpoint becomes active at a run of the loop
        step_s = math.lcm(max(round(step_s / _GRID_S), 1), max(round(loop_s / _GRID_S), 1)) * _GRID_S
        shortest_s = math.ceil(shortest_s / step_s - 1e-6) * step_s
    return shortest_s, step_s


def read_capabilities(
    objects: Objects,
    profile: Profile,
    scaling: Scaling,
    identity: Mapping[str, str],
    bitrate: int | None,
    referenced: bool,
    parameters: Mapping[str, ParameterObject],
    uncalibrated: frozenset[str],
    wanted_s: float | None = None,
    nameplate: KnownMotor | None = None,
) -> Capabilities:
    """Capabilities of the drive.

    Parameters
    ----------
    objects : Objects
    profile : Profile
    scaling : Scaling
    identity : mapping of str to str
        As of :func:`read_identity`.
    bitrate : int or None
        Of the bus, None when it carries any load.
    referenced : bool
        True if the drive knows its zero.
    parameters, uncalibrated
        See :class:`beltcomm_adapters.gains.Parameters`.
    wanted_s : float or None
        Sample period asked for, None for the shortest that fits.
    nameplate : KnownMotor or None
        Motor by axis.yaml; None where it is not known.

    Raises
    ------
    UsageError
        For one that cannot be.
    """
    modes = supported_modes(objects, profile)
    loop_s = _loop_period_s(objects, profile)
    exchange = plan_exchange(bitrate, fullest(profile, modes), *sync_steps(objects, profile), wanted_s)
    period_s = exchange.period_s
    plate, steps = nameplate or KnownMotor(), max(round(math.tau / abs(scaling.position_rad)), 1)
    peak_permille = objects.read_if_there(0x6073, 0, "uint16") or objects.read_if_there(0x6072, 0, "uint16")
    peak_nm = plate.peak_torque_nm or scaling.rated_torque_nm if peak_permille is None else peak_permille * 1e-3 * scaling.rated_torque_nm
    fastest = read_top_speed_rad_s(objects) or plate.max_speed_rad_s or FASTEST_RAD_S
    return Capabilities(
        name=identity.get("device_name", profile.title),
        kinds=frozenset(kind for kind, mode in profile.modes.items() if mode in modes),
        sample_period_s=period_s,
        counts_per_rev=min(scaling.counts_per_rev, steps),
        encoder_counts_per_rev=scaling.counts_per_rev if steps < scaling.counts_per_rev else None,
        torque_step_nm=scaling.torque_nm,
        torque_sampling=profile.torque_sampling,
        torque_along=frozenset(kind for kind, mode in profile.modes.items() if profile.offsets and mode in modes and mode in OFFSET_MODES),
        structure=structure_of(
            profile, loop_s or min(period_s, LONGEST_LOOP_S), *_position_bounds(objects, profile, scaling), parameters=parameters
        ),
        rated_torque_nm=scaling.rated_torque_nm,
        peak_torque_nm=peak_nm,
        rated_current_a=scaling.rated_current_a,
        max_speed_rad_s=fastest,
        can_home=HOMING_MODE in modes,
        referenced=referenced,
        overload_time_s=_overload_time_s(objects, profile),
        identity=dict(identity),
        parameters=dict(parameters),
        uncalibrated=uncalibrated,
        gains=gain_access(parameters, uncalibrated),
        gain_terms=profile.known_gains,
        exchange=exchange.words,
        torque_scale=""
        if profile.torque_scale.confidence in ("read", "simulated")
        and (profile.torque_scale.of == "rated_torque" or profile.torque_scale.nm)
        else _doubt(profile),
        torque_reading=_stated(profile),
        stop_unit=scaling.stop_unit,
        following_error_stops=profile.following_error == "stops",
        units=scaling.told_units(),
        cautions=scaling.said,
        shortest_guard_s=max(SHORTEST_GUARD_S, GUARD_PERIODS * period_s),
    )


def read_top_speed_rad_s(objects: Objects) -> float | None:
    """Largest speed of the motor by 6080h, of four bytes or of two, rad/s; None where the drive has none.

    Parameters
    ----------
    objects : Objects

    Raises
    ------
    ObjectRefused
        When it is there and not told.
    """
    found = objects.bytes_if_there(0x6080)
    return None if found is None else int.from_bytes(found, "little") * RPM


def _stated(profile: Profile) -> StatedReading | None:
    """Statement of a profile on the torque that is reported; None where it states nothing."""
    late, lag, command = profile.actual_torque.late_ms, profile.actual_torque.filter_ms, profile.actual_torque.command
    if late is None and lag is None and command is None:
        return None
    return StatedReading(None if late is None else 1e-3 * late, None if lag is None else 1e-3 * lag, command)


def _doubt(profile: Profile) -> str:
    """In words, that nobody has shown what this drive's torques count in, and what tells."""
    said = {
        "rated_torque": "its rated torque 6076h",
        "rated_current": "its rated current, not its rated torque",
        "drive_peak": "the drive's peak",
        "unknown": "something that its documents contradict each other about",
    }[profile.torque_scale.of]
    return f"{profile.title} is said to count torques in thousandths of {said}, which is not proven; {profile.torque_scale.check}"


def _position_bounds(objects: Objects, profile: Profile, scaling: Scaling) -> tuple[float, float]:
    """Largest output of the position controller, rad/s, and its dead zone, rad, motor shaft; none where the drive tells none."""
    output = objects.read_if_there(*profile.output_limit, "uint32") if profile.output_limit else None
    dead = objects.read_if_there(*profile.dead_zone, "uint32") if profile.dead_zone else None
    return math.inf if output is None else output * abs(scaling.speed_rad_s), (dead or 0) * abs(scaling.position_rad)


def _loop_period_s(objects: Objects, profile: Profile) -> float | None:
    """Period of the velocity loop, told by the drive in us; None where it does not tell."""
    if profile.loop_period is None:
        return None
    return int.from_bytes(objects.read_bytes(*profile.loop_period), "little") * 1e-6


def _overload_time_s(objects: Objects, profile: Profile) -> float | None:
    """For how long the drive lets the motor have its peak torque, told in ms; None where it does not tell."""
    value = objects.read_if_there(*profile.overload_time, "uint16") if profile.overload_time else None
    return value * 1e-3 if value else None
