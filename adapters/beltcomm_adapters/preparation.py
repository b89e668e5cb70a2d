"""Before an axis may move: what is asked is checked, and the drive gets its mode, its own limits and a watchdog."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, Literal

import numpy as np

from beltcomm.drive import FOLLOWING_ERROR_S, Array, Capabilities, Limits, Motion
from beltcomm.drive.objects import name_of
from beltcomm.errors import DriveError, ObjectRefused, Refused, UsageError
from beltcomm_adapters.cia402 import StateMachine
from beltcomm_adapters.gains import HOMING
from beltcomm_adapters.host_reaction import heed
from beltcomm_adapters.identification import sync_period_s
from beltcomm_adapters.link import HOST_NODE
from beltcomm_adapters.profiles import Profile
from beltcomm_adapters.scaling import Scaling
from beltcomm_adapters.sdo import Lending, Objects, abort_text
from beltcomm_adapters.setpoints import OFFSET_MODES, POSITION_MODES, TORQUE_MODES, Layout
from beltcomm_adapters.units import RPM

#: The drive's own speed limit stands this far above the host's: the host brakes, the drive switches off and lets the axis
#: coast.
_DRIVE_SPEED_SHARE: Final = 1.2
#: Cycles from a breach to the quick stop at worst: three lost answers, one to notice, one until the command is active.
_REACTION_CYCLES: Final = 5
_LONGEST_SYNC_MS: Final = 20
_QUICK_STOP_AND_DISABLE: Final = 2  # 605Ah
_LINEAR_INTERPOLATION: Final = -2  # 60C0h
_INT32: Final = 2**31 - 1
_BYTE: Final = 255
#: Share by which a number that was read back may differ: what a drive rounds.
_READ_BACK: Final = 0.02
#: s from the speed limit to standstill: no drive is set to a longer quick stop.
_LONGEST_STOP_S: Final = 10.0
#: Rounding of a float period, far below any timer's resolution.
_SAME_S: Final = 1e-9


def check_motion(
    motion: Motion, limits: Limits, capabilities: Capabilities, profile: Profile, here_rad: float, drive_torque_nm: float
) -> None:
    """Refuse a motion that cannot be run inside its limits by this drive from where the axis is.

    Parameters
    ----------
    motion : Motion
        That is asked for.
    limits : Limits
    capabilities : Capabilities
    profile : Profile
    here_rad : float, rad
        Present motor angle.
    drive_torque_nm : float, N m
        The drive's own torque limit, 6072h.

    Raises
    ------
    UsageError
        With what stands against it.
    """
    if motion.kind not in capabilities.kinds:
        offered = ", ".join(sorted(capabilities.kinds)) or "none"
        raise UsageError(f"{capabilities.name} cannot run a motion of kind {motion.kind!r}; it offers {offered}")
    _check_period(motion, capabilities, profile)
    check_room(limits, here_rad)
    for name in ("position_rad", "velocity_rad_s", "torque_nm"):
        if not np.all(np.isfinite(getattr(motion, name))):
            raise UsageError(f"{name} of the motion contains values that are no numbers")
    if motion.lead_rad is not None and (motion.kind != "position" or not np.all(np.isfinite(motion.lead_rad))):
        raise UsageError("a reference leads the axis in a motion of kind 'position' only, by numbers")
    if motion.kind != "torque":
        _check_torque_input(motion, profile)
    peak_nm = max(float(np.abs(motion.torque_nm).max()), abs(motion.rest_nm))
    if peak_nm > limits.torque_nm * (1 + 1e-9):
        raise UsageError(f"the motion asks for {peak_nm:.4g} N m, the limit is {limits.torque_nm:.4g} N m; reduce the amplitude")
    if peak_nm > drive_torque_nm + capabilities.torque_step_nm:
        raise UsageError(
            f"the motion asks for {peak_nm:.4g} N m, the drive's own limit 6072h is {drive_torque_nm:.4g} N m; reduce the "
            "amplitude or raise torque_limit_nm"
        )
    if motion.kind == "velocity":
        check_speed(motion.velocity_rad_s, limits)
    if motion.kind == "position":
        check_path(motion, limits, here_rad)
        check_speed(np.diff(motion.position_rad, prepend=motion.position_rad[0]) / motion.period_s, limits)


def _check_period(motion: Motion, capabilities: Capabilities, profile: Profile) -> None:
    shortest_s, period_s = capabilities.sample_period_s, motion.period_s
    times = round(period_s / shortest_s)
    if times < 1 or abs(times * shortest_s - period_s) > _SAME_S:
        raise UsageError(f"the period {period_s:g} s is no whole multiple of {shortest_s:g} s, the drive's shortest on this bus")
    if profile.sync_change == "at_once" and period_s > _LONGEST_SYNC_MS * 1e-3 + _SAME_S:
        raise UsageError(f"the period {period_s:g} s is longer than {_LONGEST_SYNC_MS} ms; use a shorter one")
    if profile.sync_change == "after_reset" and motion.kind == "position" and times != 1:
        raise UsageError(
            f"this drive interpolates positions at its stored period {shortest_s:g} s (60C2h) only, not at {period_s:g} s; "
            "sample the motion at that period"
        )


def _check_torque_input(motion: Motion, profile: Profile) -> None:
    if motion.torque_nm.any() and not (profile.offsets and profile.modes[motion.kind] in OFFSET_MODES):
        raise UsageError(
            f"{profile.title} takes no feedforward torque in a motion of kind {motion.kind!r}; plan it without (torque_nm = 0)"
        )


def check_room(limits: Limits, here_rad: float) -> None:
    """Refuse limits that leave no room to move, or an axis that stands outside them.

    Parameters
    ----------
    limits : Limits
    here_rad : float, rad
        Present motor angle.

    Raises
    ------
    UsageError
        For either.
    """
    if not (
        limits.position_min_rad < limits.position_max_rad and min(limits.speed_rad_s, limits.torque_nm, limits.deceleration_rad_s2) > 0
    ):
        raise UsageError(f"these limits leave no room to move: {limits}")
    if not limits.position_min_rad <= here_rad <= limits.position_max_rad:
        raise UsageError(
            f"{'the carriage' if limits.ratio_m_rad else 'the motor'} stands at {limits.where(here_rad)}, outside the window "
            f"{limits.where(limits.position_min_rad)} to {limits.where(limits.position_max_rad)}; move the carriage into it first"
        )


def check_path(motion: Motion, limits: Limits, here_rad: float) -> None:
    """Refuse a path that leaves the window, or begins elsewhere than the motor stands.

    Parameters
    ----------
    motion : Motion
        That is asked for.
    limits : Limits
    here_rad : float, rad
        Present motor angle.

    Raises
    ------
    UsageError
        For either.
    """
    path = motion.position_rad
    low, high = float(path.min()), float(path.max())
    if low < limits.position_min_rad or high > limits.position_max_rad:
        raise UsageError(
            f"the motion goes from {limits.where(low)} to {limits.where(high)}, the window is "
            f"{limits.where(limits.position_min_rad)} to {limits.where(limits.position_max_rad)}; shorten it"
        )
    if abs(path[0] - here_rad) > limits.speed_rad_s * motion.period_s:
        raise UsageError(f"the motion starts at {path[0]:.4g} rad, but the motor stands at {here_rad:.4g} rad; start it where the axis is")


def check_speed(velocity_rad_s: Array, limits: Limits) -> None:
    """Refuse velocities above the limit.

    Parameters
    ----------
    velocity_rad_s : ndarray (n,), rad/s
        Motor shaft.
    limits : Limits

    Raises
    ------
    UsageError
        With both.
    """
    fastest = float(np.abs(velocity_rad_s).max())
    if fastest > limits.speed_rad_s * (1 + 1e-9):
        raise UsageError(f"the motion reaches {fastest:.4g} rad/s, the limit is {limits.speed_rad_s:.4g} rad/s; slow it down")


def prepare(
    objects: Objects,
    lending: Lending,
    machine: StateMachine,
    profile: Profile,
    scaling: Scaling,
    layout: Layout,
    period_s: float,
    limits: Limits,
    motion: Motion | None,
) -> None:
    """Mode of operation, setpoints at rest, limits inside the drive, SYNC period; everything but setpoints is lent.

    The drive's own limits are only ever tightened; its following error window is set as asked, and the quick stop's deceleration, for
    the way it takes is counted with.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    machine : StateMachine
        State machine of the drive.
    profile : Profile
    scaling : Scaling
    layout : Layout
        Of the setpoints.
    period_s : float, s
        Of SYNC.
    limits : Limits
    motion : Motion or None
        None for homing; the ramps of one in mode 3 are opened just so far that they do not shape it.
    """
    mode = layout.mode
    lend_mode(objects, lending, machine, mode)
    if mode in TORQUE_MODES:
        objects.write(0x6071, 0, "int16", 0)
        if profile.torque_exit == "velocity":
            objects.write(0x60FF, 0, "int32", 0)
    lend_settings(objects, lending, profile, scaling, mode, period_s, limits, motion)


def lend_settings(
    objects: Objects,
    lending: Lending,
    profile: Profile,
    scaling: Scaling,
    mode: int,
    period_s: float,
    limits: Limits,
    motion: Motion | None = None,
) -> None:
    """Settings of :func:`prepare` that are no mode and no setpoint; limits that the drive does not take are in ``lending.refused``.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    profile : Profile
    scaling : Scaling
    mode : int
        Of operation.
    period_s : float, s
        Of SYNC.
    limits : Limits
    motion : Motion or None
        That is asked for; None for none.
    """
    believed = lend_quick_stop(objects, lending, scaling, limits)
    if profile.sync_change == "at_once" and (sync_period_s(objects) is not None or objects.read_if_there(0x60C2, 1, "uint8") is not None):
        value, power = _interpolation_time(period_s)
        lending.set_if_there(0x60C2, 2, "int8", power)
        lending.set_if_there(0x60C2, 1, "uint8", value)
    if believed and mode in TORQUE_MODES and profile.torque_exit == "velocity" and math.isfinite(limits.deceleration_rad_s2):
        braking = scaling.raw_acceleration(limits.deceleration_rad_s2)
        _limit(objects, lending, 0x6084, 0, "uint32", braking, scaling.acceleration, "rad/s²", harder=True)
    if mode == 4 and profile.torque_slope_permille_s is not None:
        slope = objects.read_if_there(0x6087, 0, "uint32")
        if slope is not None and slope < profile.torque_slope_permille_s:
            lending.set_if_there(0x6087, 0, "uint32", profile.torque_slope_permille_s)
    if mode == 7:
        lending.set_if_there(0x60C0, 0, "int16", _LINEAR_INTERPOLATION)
        lending.set_if_there(0x60C1, 2, "uint8", 0)  # absolute positions; before sub 1 (F1 p195)
    if believed and mode == 3 and motion is not None:
        steepest = float(np.abs(np.diff(motion.velocity_rad_s, prepend=0.0, append=0.0)).max()) / period_s
        ramp = scaling.raw_acceleration(steepest, at_most=False)
        for index in (0x6083, 0x6084):
            _limit(objects, lending, index, 0, "uint32", ramp, scaling.acceleration, "rad/s²")
    tighten_torque_and_speed(objects, lending, profile, scaling, limits)
    if mode in POSITION_MODES:  # 607Dh bounds the target of a position controller
        tighten_window(objects, lending, scaling, limits, period_s, motion.reach_rad if motion is not None else None)
        if limits.lag_rad is not None:
            ahead_rad = motion.ahead_rad if motion is not None else 0.0
            lag = min(math.ceil((limits.lag_rad + ahead_rad) / abs(scaling.position_rad)), _INT32)
            _limit(objects, lending, 0x6065, 0, "uint32", lag, lambda raw: raw * abs(scaling.position_rad), "rad")
            # A dead host's setpoint stands still: the position loop would brake as its gain asks for until the guard time is over.
            lasting_ms = math.ceil(1e3 * max(FOLLOWING_ERROR_S, period_s))
            if (objects.read_if_there(0x6066, 0, "uint16") or 0) > lasting_ms:
                lending.set_if_there(0x6066, 0, "uint16", lasting_ms)


def lend_mode(objects: Objects, lending: Lending, machine: StateMachine, mode: int) -> None:
    """Another mode of operation, 6060h, confirmed by the drive.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    machine : StateMachine
        Of the drive.
    mode : int
        Of operation.
    """
    if objects.read_int(0x6060, 0, "int8"):
        lending.set(0x6060, 0, "int8", mode)
    else:  # "no mode" is where a drive starts and cannot be gone back to
        objects.write(0x6060, 0, "int8", mode)
    machine.confirm_mode(mode)


def lend_quick_stop(objects: Objects, lending: Lending, scaling: Scaling, limits: Limits) -> bool:
    """A quick stop that ends disabled, with the deceleration of the limits; False where the unit of accelerations makes no sense.

    Then nothing is written in that unit, neither a stop nor a ramp.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    scaling : Scaling
    limits : Limits
    """
    lending.set_if_there(0x605A, 0, "int16", _QUICK_STOP_AND_DISABLE)
    believed = believes_ramp(objects, lending, scaling, limits.speed_rad_s)
    if believed and math.isfinite(limits.deceleration_rad_s2):
        braking = scaling.raw_acceleration(limits.deceleration_rad_s2)
        _limit(objects, lending, 0x6085, 0, "uint32", braking, scaling.acceleration, "rad/s²", harder=True)
    return believed


def quick_stop_rad_s2(objects: Objects, scaling: Scaling, limits: Limits) -> float | None:
    """Deceleration of the quick stop that a record with these limits would have, tried and put back; None where nobody can tell.

    That of the limits where the drive takes it; what it makes of it, or is set to where it refuses.

    Parameters
    ----------
    objects : Objects
    scaling : Scaling
    limits : Limits

    Returns
    -------
    float or None, rad/s²
        Motor shaft.

    Raises
    ------
    DriveError
        As :func:`_limit`.
    """
    with objects.lend() as lending:
        if not lend_quick_stop(objects, lending, scaling, limits):
            return None
        raw = objects.read_if_there(0x6085, 0, "uint32")
        return scaling.acceleration(raw) if raw else None


def believes_ramp(objects: Objects, lending: Lending, scaling: Scaling, speed_rad_s: float) -> bool:
    """True if the unit of accelerations is told, or makes a stop of the drive's own 6085h: one that means milliseconds would stop in hours.

    A unit that is not believed is told.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    scaling : Scaling
    speed_rad_s : float, rad/s, motor shaft
        From which it stops.
    """
    own = None if scaling.acceleration_told else objects.read_if_there(0x6085, 0, "uint32")
    if not own or speed_rad_s / scaling.acceleration(own) < _LONGEST_STOP_S:
        return True
    text = (
        f"6085h (quick stop) stays as it is set there, {own}, and ramps with it: in the drive's unit of speed per second that would be a "
        f"stop of {speed_rad_s / scaling.acceleration(own):.3g} s, so it means something else; state acceleration_unit in a profile"
    )
    lending.altered[text] = 0x6085
    return False


def _limit(
    objects: Objects,
    lending: Lending,
    index: int,
    subindex: int,
    kind: str,
    raw: int,
    shown: Callable[[int], float],
    unit: str,
    *,
    harder: bool = False,
) -> None:
    """Lend a limit or a ramp and read it back: what a drive cuts without a word is told, see :attr:`Lending.altered`.

    ``shown`` is its meaning in ``unit``; ``harder``: more of it would be dangerous, so DriveError where the drive has more than was
    written.
    """
    if not lending.set_if_there(index, subindex, kind, raw) or (index, subindex, raw) in objects.taken_as_written:
        return
    found = objects.read_int(index, subindex, kind)
    if found == raw:
        objects.taken_as_written.add((index, subindex, raw))
        return
    meant, has = shown(raw), shown(found)
    text = f"{name_of(index, subindex)} was set to {meant:.4g} {unit}, the drive made {has:.4g} {unit} of it"
    if harder and has > meant * (1.0 + _READ_BACK):
        raise DriveError(
            f"{text}: a stop would load the belt more than planned; check its unit (60AAh) and its bounds with the maker's tool"
        )
    lending.altered[text] = index


def _interpolation_time(period_s: float) -> tuple[int, int]:
    """60C2h, number and power of ten, in ms where these are whole.   Raises UsageError for a period that no byte holds."""
    for power in (-3, -4, -5, -6):
        value = round(period_s * 10.0**-power)
        if 1 <= value <= _BYTE and abs(value * 10.0**power - period_s) <= _SAME_S:
            return value, power
    raise UsageError(
        f"a period of {1e3 * period_s:g} ms cannot be told to the drive (60C2h, a byte and a power of ten); choose another one"
    )


def tighten_torque_and_speed(objects: Objects, lending: Lending, profile: Profile, scaling: Scaling, limits: Limits) -> None:
    """Set 6072h and 6080h to the limits, never above what they are; a drive without them is watched by the host alone.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    profile : Profile
    scaling : Scaling
    limits : Limits
    """
    torque = max(math.ceil(limits.torque_nm / scaling.torque_nm), profile.torque_limit_lowest_permille)
    if torque < (objects.read_if_there(0x6072, 0, "uint16") or 0):
        _limit(objects, lending, 0x6072, 0, "uint16", torque, lambda raw: raw * scaling.torque_nm, "N m")
    if (stored := objects.bytes_if_there(0x6080)) is None:
        return
    speed = math.ceil(_DRIVE_SPEED_SHARE * limits.speed_rad_s / RPM)  # 6080h is in min⁻¹
    if speed < int.from_bytes(stored, "little"):
        _limit(objects, lending, 0x6080, 0, "uint32" if len(stored) == 4 else "uint16", speed, lambda raw: raw * RPM, "rad/s")


def tighten_window(
    objects: Objects, lending: Lending, scaling: Scaling, limits: Limits, period_s: float, reach_rad: tuple[float, float] | None = None
) -> None:
    """Set 607Dh around the window, as far outside as a quick stop from the speed limit goes.

    The drive answers a breach with a fault, which brakes worse than the host's quick stop or not at all.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    scaling : Scaling
    limits : Limits
    period_s : float, s
        Of the setpoints.
    reach_rad : tuple of float or None, rad
        Of a reference that leads the axis, which the drive must let be; None for none.

    Raises
    ------
    DriveError
        Where the drive's own 607Dh would cut that reference.
    """
    stored_low = objects.read_if_there(0x607D, 1, "int32")
    deceleration = objects.read_if_there(0x6085, 0, "uint32")
    if stored_low is None or not (deceleration or reach_rad):
        return
    stored_high = objects.read_int(0x607D, 2, "int32")
    braking_rad = limits.speed_rad_s**2 / (2.0 * scaling.acceleration(deceleration)) if deceleration else math.inf
    margin_rad = limits.speed_rad_s * _REACTION_CYCLES * period_s + braking_rad
    lowest, highest = reach_rad or (math.inf, -math.inf)
    low = math.floor(max(min(limits.position_min_rad - margin_rad, lowest) / scaling.position_rad, -_INT32))
    high = math.ceil(min(max(limits.position_max_rad + margin_rad, highest) / scaling.position_rad, _INT32))
    if stored_low < stored_high:  # otherwise these limits are switched off
        low, high = max(low, stored_low), min(high, stored_high)
        beyond = max(low * scaling.position_rad - lowest, highest - high * scaling.position_rad)
        if beyond > abs(scaling.position_rad):
            raise DriveError(
                f"the reference leads the axis to {_way(limits, beyond)} beyond the drive's own software limits (607Dh), which would cut "
                "it: switch them off or widen them with the maker's tool, or drive the move without a led reference (--feedforward none)"
            )
    if not deceleration:  # of a drive without a quick stop's way nothing is tightened
        return
    steps = [(1, low), (2, high)]
    for part, value in reversed(steps) if low > stored_high else steps:  # never a minimum above its maximum
        _limit(objects, lending, 0x607D, part, "int32", value, lambda raw: raw * scaling.position_rad, "rad")


def _way(limits: Limits, angle_rad: float) -> str:
    """A way in words, of the carriage where its ratio is known."""
    return f"{1e3 * limits.ratio_m_rad * angle_rad:.0f} mm" if limits.ratio_m_rad else f"{angle_rad:.4g} rad"


def guard(objects: Objects, lending: Lending, profile: Profile, guard_s: float) -> Literal["heartbeat", "node_guarding"]:
    """Have the drive watch its host; returns the sign of life it wants.

    Parameters
    ----------
    objects : Objects
    lending : Lending
    profile : Profile
    guard_s : float, s
        After which it must notice that the host is gone.

    Raises
    ------
    DriveError
        When it can do neither: an axis with a torque setpoint must not outlive its host.
    """
    wanted, time_ms = profile.guarding, round(1e3 * guard_s)
    refusals = []
    for kind in (wanted, "node_guarding" if wanted == "heartbeat" else "heartbeat"):
        try:
            if kind == "heartbeat":
                lending.set(0x1016, 1, "uint32", HOST_NODE << 16 | time_ms)
                heed(objects, lending, profile.error_behaviour)
                return "heartbeat"
            lending.set(0x1017, 0, "uint16", 0)  # a heartbeat of the drive would switch node guarding off
            lending.set(0x100D, 0, "uint8", 1)
            lending.set(0x100C, 0, "uint16", time_ms)
            heed(objects, lending, profile.error_behaviour)
            return "node_guarding"
        except ObjectRefused as refused:
            refusals.append(str(refused))
    raise DriveError(
        "this drive watches neither a heartbeat (1016h) nor node guarding (100Ch): it would go on moving when the computer "
        f"dies; beltcomm does not move it ({'; '.join(refusals)})"
    )


def homing_speeds_rad_s(objects: Objects, scaling: Scaling, limits: Limits) -> tuple[float, float]:
    """The two speeds of the drive's homing (6099h), rad/s at the motor.

    Parameters
    ----------
    objects : Objects
    scaling : Scaling
    limits : Limits

    Raises
    ------
    UsageError
        When one is above the limit.
    """
    fast, slow = (objects.read_int(0x6099, part, "uint32") * scaling.speed_rad_s for part in (1, 2))
    if max(fast, slow) > limits.speed_rad_s:
        raise UsageError(
            f"the drive homes at {fast:.4g} and {slow:.4g} rad/s (6099h), the limit is {limits.speed_rad_s:.4g} rad/s; reduce the "
            "homing speeds with the maker's tool or raise the limit"
        )
    return fast, slow


@contextmanager
def homing_method(objects: Objects, profile: Profile) -> Iterator[None]:
    """The method of the profile in 6098h, put back after it.

    Parameters
    ----------
    objects : Objects
    profile : Profile

    Raises
    ------
    Refused
        Where there is none or the drive does not take it.
    """
    if profile.homing_method is None:
        if objects.read_if_there(*HOMING) == 0:
            raise Refused(
                "the drive is set to no method of homing (6098h is 0); set one with the maker's tool, state it in a profile "
                "(homing: {method: 37}), or state where the carriage is with --position"
            )
        yield
        return
    with objects.lend() as lending:
        try:
            lending.set(*HOMING, profile.homing_method)
        except ObjectRefused as error:
            raise Refused(
                f"the drive refuses the homing method {profile.homing_method} of its profile: {abort_text(error.abort_code)}; look in its "
                "manual which it has, and correct homing.method, or state where the carriage is with --position"
            ) from error
        yield
