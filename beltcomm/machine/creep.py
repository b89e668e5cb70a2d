"""Creeping without any loop: the torque rises until the carriage has gone its way, then the axis is stopped."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.axis import Axis
from beltcomm.drive import GUARD_S, Drive, Guarding, Limits, Motion, Row
from beltcomm.errors import DriveError, Refused, SafetyStop
from beltcomm.machine.host_loss import guard_times_s
from beltcomm.rundata.first_motions import MOVED_M, SLIDING_SHARE
from beltcomm.simulate.stopping import Braking, HostLoss, first_deceleration, run_on_distance, unknown_loads_kg

#: Share of the torque that axis and motor allow at which an axis that does not move is given up.
BREAKAWAY_SHARE = 0.6
#: The same share on a tilted axis, where most of the torque may hold the carriage.
HELD_SHARE = 0.9
#: s, in which the torque rises to that share.
RAMP_S = 2.0
#: m/s: a creeping carriage that gets faster is stopped.
CREEP_SPEED_M_S = 0.1
#: m beyond the way asked for, where host and drive stop the axis; near enough; and how many goes it may take.
MARGIN_M = 1e-2
NEAR_M = 5e-4
GOES = 30
#: Share of the way left that one go is to bring: a creeping carriage is not stopped at once.
GO_SHARE = 0.6
#: Share of the ramp's torque below which the torque cannot have moved the carriage.
BY_ITSELF = 0.02
#: s beyond the guard time in which an unproven drive is counted on to notice that its host is gone.
LATE_S = 0.05
#: s, to look whether the axis stays where it was stopped.
STILL_S = 0.1


@dataclass(frozen=True)
class Crept:
    """onset_nm : torque at which the carriage began to move, positive, N m at the motor.   moved_m : how far it went, signed.

    slope_nm_s : how fast the torque rose, N m/s.
    """

    onset_nm: float
    moved_m: float
    slope_nm_s: float


class Enough(SafetyStop):
    """Raised by the watcher inside a record when the motion has shown what it was for; the axis is stopped as for any limit.

    Parameters
    ----------
    answered : bool
        As of :class:`beltcomm.errors.SafetyStop`.
    """

    def __init__(self, answered: bool = False) -> None:
        super().__init__("the motion has shown what it was for", "enough")
        self.answered = answered


def run_on_m(axis: Axis, torque_nm: float, held_s: float) -> float:
    """Way that the lightest carriage runs on when the computer dies just as it breaks away, m.

    ``SLIDING_SHARE`` of that is left as friction, against the torque that is held for ``held_s`` and then alone.

    Parameters
    ----------
    axis : Axis
    torque_nm : float
        Then, N m.
    held_s : float, s
        For which the drive holds the last torque.
    """
    ratio, friction = axis.transmission_m_rad, SLIDING_SHARE * torque_nm
    inertia = axis.motor_side_inertia_kg_m2 + ratio**2 * max(unknown_loads_kg(axis)[0], axis.payload.mass_kg or 0.0)
    loss = HostLoss(held_s, Braking(ratio * friction / inertia, 0.0))
    return float(run_on_distance(np.zeros(1), torque_nm, friction, inertia, ratio, loss)[0])


def creep(drive: Drive, axis: Axis, limits: Limits, by_m: float, reach_m: float, about_nm: float = 0.0, left_m: float = math.inf) -> Crept:
    """Creep by about ``by_m`` (signed), or until it gets fast; check direction and stopping.   Nothing is recorded.

    Parameters
    ----------
    drive : Drive
    axis : Axis
    limits : Limits
        Of torque and speed, at the motor.
    by_m : float, m
        Way of the carriage.
    reach_m : float, m
        Which the carriage must not leave with the way of the stop. The work of the torque is used up by friction: it ends within moved
        τ/τ_friction, so it is stopped while that is less.
    about_nm : float, N m
        What holds a tilted axis: the torque rises and falls from there, it is held before and after, and τ and the onset count from it.
    left_m : float
        m to the end of the travel in that direction, which the carriage must not pass if the computer dies: the torque rises no further
        than that allows.

    Raises
    ------
    Refused
        When nothing moves.
    DriveError
        When torque and motion have opposite signs or the axis does not stop.
    SafetyStop
        When it went further than ``reach_m``.
    """
    ratio, sign = axis.transmission_m_rad, float(np.sign(by_m))
    period = drive.capabilities.sample_period_s
    allowed = min(limits.torque_nm, axis.torque_limit_nm)
    top = HELD_SHARE * allowed - abs(about_nm) if about_nm else BREAKAWAY_SHARE * allowed
    ramp = np.linspace(0.0, top, int(RAMP_S / period))
    # where a stop takes the stage off, nothing is known yet that a drive could brake with: its guarding is on, but not proven
    guarding = Guarding(GUARD_S, GUARD_S + LATE_S, False) if limits.release else drive.prove_guarding(limits, about_nm)
    brake_s = limits.brake_s if about_nm else 0.0
    held = {time: guarding.held_s(time) + period + brake_s for time in guard_times_s(drive.capabilities)}
    guard_s = next((time for time, held_s in held.items() if run_on_m(axis, top, held_s) <= left_m), min(held))
    limits = replace(limits, guard_s=guard_s)
    start = drive.read(["position_rad"])["position_rad"]
    onset: list[float] = []
    before = [0.0]

    def watch(row: Row) -> None:
        moved = sign * ratio * (row[3] - start)
        if not onset and run_on_m(axis, abs(row[2] - about_nm), held[guard_s]) > left_m - moved:
            raise Refused(_no_more(abs(row[2] - about_nm), run_on_m(axis, abs(row[2] - about_nm), held[guard_s]), guard_s, left_m))
        if moved > MOVED_M and not onset:
            onset.append(sign * (row[2] - about_nm))
        if moved < -4.0 * MOVED_M and moved - before[0] < -3.0 * MOVED_M:  # 0.15 m/s out of nothing
            raise DriveError(
                f"the position jumped by {1e3 * (moved - before[0]) * sign:+.2f} mm within one period while the carriage crept: check the "
                "encoder and its cable, then start again"
            )
        if moved < -4.0 * MOVED_M:
            raise DriveError(_not_held(sign, row[2]) if about_nm else _backwards(sign, abs(row[2]), top))
        coasting = onset and moved * sign * (row[2] - about_nm) > SLIDING_SHARE * onset[0] * reach_m
        if moved > abs(by_m) or coasting or (moved > MOVED_M and moved - before[0] > CREEP_SPEED_M_S * period):
            # with the stage cut off a carriage falls until the brake has closed, which then stops it in the belt
            raise Enough(answered=bool(about_nm))
        before[0] = moved

    zero = np.zeros(len(ramp))
    try:
        drive.record(Motion("torque", period, zero, zero, about_nm + sign * ramp, about_nm), limits, watch)
    except Enough:
        pass
    else:
        if not onset:
            scaled = "; or a torque in 6071h is less than the profile says (torque_scale)" if drive.capabilities.torque_scale else ""
            raise Refused(
                f"the axis does not move: {top:.2f} N m, {100 * BREAKAWAY_SHARE:.0f} % of what is allowed, did not shift it by "
                f"{1e6 * MOVED_M:.0f} µm; check brake, clamp and enable inputs, and whether {axis.torque_limit().binds} in axis.yaml is "
                f"right{scaled}"
            )
    drive.clock.sleep_until(drive.clock.now() + STILL_S)  # without torque the stretched belt swings once more
    stopped = drive.read(["position_rad"])["position_rad"]
    drive.clock.sleep_until(drive.clock.now() + STILL_S)
    end = drive.read(["position_rad"])["position_rad"]
    if ratio * abs(end - stopped) > MOVED_M:
        raise DriveError("the axis does not stand still after a stop; check the drive's quick stop (605Ah, 6085h) and its brake")
    moved_m = ratio * (end - start)
    if abs(moved_m) > reach_m:
        raise SafetyStop(
            f"the carriage came to rest {1e3 * abs(moved_m):.1f} mm from where it began to creep, {1e3 * reach_m:.1f} mm were counted "
            "with: friction and the drive's own velocity loop hardly brake it, then set that loop up with the maker's tool first; or its "
            "encoder jumped while it was stopped, then check the encoder's cable",
            "position",
        )
    return Crept(onset[0] if onset else top, moved_m, top / RAMP_S)


def _no_more(torque_nm: float, way_m: float, guard_s: float, left_m: float) -> str:
    """Sentence for more torque being too much so near to an end."""
    return (
        f"the axis does not move under {torque_nm:.3f} N m, and more is too much here: if the computer died as it breaks away, a light "
        f"carriage would run on by {1e3 * way_m:.0f} mm before the drive has noticed ({1e3 * guard_s:.0f} ms) and friction has stopped it, "
        f"{1e3 * left_m:.0f} mm are left to the end; move the carriage further in"
    )


def _not_held(sign: float, torque_nm: float) -> str:
    """Sentence for a carriage that goes against a torque that rises from the one that held it."""
    to = "negative" if sign > 0 else "positive"
    return (
        f"the carriage moves to {to} under {torque_nm:.3f} N m, while the torque goes the other way from what held it: look at its load, "
        "at the drive's polarity (607Eh) and at the direction of its encoder"
    )


def _backwards(sign: float, torque_nm: float, top_nm: float) -> str:
    """Sentence for a carriage that goes against the torque.   torque_nm : at that moment, N m.   top_nm : at the end of the ramp."""
    ways = ("positive", "negative")
    under, to = ways if sign > 0 else ways[::-1]
    if torque_nm < BY_ITSELF * top_nm:
        return (
            f"the carriage moved to {to} by itself, under hardly any torque ({torque_nm:.3f} N m to {under}): a tilt, a hanging load or a "
            "spring moves it as soon as the brake opens. Secure the carriage. For a tilted axis state mounting.tilt_deg, payload and brake "
            "in axis.yaml: then gravity is held from the beginning. Do not change any polarity"
        )
    return (
        f"the carriage moves to {to} under {torque_nm:.3f} N m of {under} torque. On a level axis torque and encoder count in opposite "
        "directions: set the drive's polarity (607Eh) or the direction of its encoder. If the axis is tilted or a load hangs on it, "
        "change nothing: the load moves it"
    )


def move_limits(drive: Drive, axis: Axis, by_m: float, position_m: float | None) -> Limits:
    """Limits of a short move.

    Parameters
    ----------
    drive : Drive
    axis : Axis
    by_m : float, m
        Way of the carriage, either way.
    position_m : float or None, m
        Where the carriage stands, as the operator says; else the drive's own zero counts.

    Raises
    ------
    Refused
        When the move would leave the travel.
    """
    ratio = axis.transmission_m_rad
    here = drive.read(["position_rad"])["position_rad"]
    start = position_m if position_m is not None else ratio * here
    low, high = float(axis.travel.min_m or 0.0), float(axis.travel.max_m or 0.0)
    known = position_m is not None or drive.capabilities.referenced
    if known and not low <= start + by_m <= high:
        raise Refused(f"from {start:.4f} m a move by {1e3 * by_m:+.1f} mm would leave the travel {low:g}..{high:g} m")
    beyond = np.sign(by_m) * MARGIN_M
    ends = sorted((here - beyond / ratio, here + (by_m + beyond) / ratio))
    if known:  # going too far must not lead out of the travel
        ends = [max(ends[0], here + (low - start) / ratio), min(ends[1], here + (high - start) / ratio)]
    speed = (axis.limits.speed_m_s or 1.0) / ratio
    torque = min(axis.torque_limit_nm, drive.capabilities.peak_torque_nm)
    braking = first_deceleration(axis, torque).value_m_s2
    top = min(speed, drive.capabilities.max_speed_rad_s)
    return Limits(ends[0], ends[1], top, torque, braking / ratio, MARGIN_M / ratio, ratio, here - start / ratio)


def small_move(drive: Drive, axis: Axis, by_m: float, position_m: float | None) -> float:
    """Creep to a place ``by_m`` away, in as many goes as it takes; returns how far it went, m.

    Parameters
    ----------
    drive : Drive
    axis : Axis
    by_m : float, m
        Way of the carriage, either way.
    position_m : float or None, m
        Where the carriage stands, as the operator says; without it the drive's own zero counts.

    Raises
    ------
    Refused
        When the move would leave the travel, and as :func:`creep`.
    """
    limits = move_limits(drive, axis, by_m, position_m)
    known = position_m is not None or drive.capabilities.referenced
    moved = 0.0
    for _ in range(GOES):
        if abs(by_m - moved) < NEAR_M or (by_m - moved) * by_m < 0.0:
            break
        go = GO_SHARE * (by_m - moved)
        at = limits.ratio_m_rad * (drive.read(["position_rad"])["position_rad"] - limits.zero_rad)
        end = float((axis.travel.max_m if go > 0.0 else axis.travel.min_m) or 0.0)
        left = abs(end - at) if known else math.inf
        moved += creep(drive, axis, limits, go, abs(go) + MARGIN_M, left_m=left).moved_m
    return moved
