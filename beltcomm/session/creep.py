"""A small, slow move with whatever gains are in the drive."""

from __future__ import annotations

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis_entries import TrajectoryLimits
from beltcomm.drive import Drive, Limits, Motion
from beltcomm.errors import Refused
from beltcomm.trajectory import at_rest, join, plan_trajectory

#: m/s² and m/s³: a tenth of a second to full speed.
ACCELERATION_M_S2 = 0.5
JERK_M_S3 = 10.0
#: m beyond the way asked for: where the drive and the host stop the axis.
MARGIN_M = 5e-3
#: s, for weak factory gains to catch up.
WAIT_S = 1.5


def small_move(drive: Drive, axis: Axis, by_m: float, speed_m_s: float, position_m: float | None) -> tuple[float, float]:
    """Move by ``by_m``; returns carriage position before and after, m (relative to ``position_m`` or the drive's zero).

    Raises Refused when the move would leave the travel, SafetyStop, DriveError.
    """
    ratio = axis.transmission_m_rad
    here = drive.read(["position_rad"])["position_rad"]
    start = position_m if position_m is not None else ratio * here
    known = position_m is not None or drive.capabilities.referenced
    low, high = float(axis.travel.min_m or 0.0), float(axis.travel.max_m or 0.0)
    if known and not low <= start + by_m <= high:
        raise Refused(f"from {start:.4f} m a move by {1e3 * by_m:+.1f} mm would leave the travel {low:g}..{high:g} m")
    limits = TrajectoryLimits(jerk_m_s3=JERK_M_S3, acceleration_m_s2=ACCELERATION_M_S2, speed_m_s=speed_m_s)
    period = drive.capabilities.sample_period_s
    path = plan_trajectory(0.0, by_m, limits, period)
    path = join([path, at_rest(by_m, WAIT_S, period)])
    kind = "position" if "position" in drive.capabilities.kinds else "velocity"
    motion = Motion(
        kind,  # type: ignore[arg-type]
        period,
        here + path.position_m / ratio,
        path.velocity_m_s / ratio,
        np.zeros(len(path.t_s)),
    )
    ends = sorted((here - np.sign(by_m) * MARGIN_M / ratio, here + (by_m + np.sign(by_m) * MARGIN_M) / ratio))
    torque = min(axis.torque_limit_nm, drive.capabilities.peak_torque_nm)
    drive.record(motion, Limits(ends[0], ends[1], 3.0 * speed_m_s / ratio, torque), lambda _row: None)
    return start, start + ratio * (drive.read(["position_rad"])["position_rad"] - here)
