"""The move of a run: the one that verified it, or the standard one of its axis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.runfolder import RunFolder
from beltcomm.trajectory import Trajectory, load_move, plan_trajectory

#: m/s, m/s²; of an axis that states no reference motion.
GENTLE = (0.5, 2.0)


def move_of(folder: RunFolder, period_s: float, file: Path | None) -> Trajectory:
    """The user's own move from a file, the one that verified the run, or the standard one of its axis."""
    axis = folder.axis
    if file is not None:
        return load_move(file, period_s, axis)
    limits, path = limits_of(folder, period_s), _proof(folder).get("path")
    if path:
        return plan_trajectory(path[0], path[1], limits, period_s)
    low, high = axis.travel.ends_m
    start = max(low + 0.05 * (high - low), min(0.0, high))
    return plan_trajectory(start, min(start + axis.targets.way_m, high - 0.05 * (high - low)), limits, period_s)


def limits_of(folder: RunFolder, period_s: float) -> TrajectoryLimits:
    """Limits of the standard move, as slow as the one that verified the run; gentle ones where the axis states none."""
    axis, proven = folder.axis, _proof(folder)
    if kept := proven.get("limits"):
        return TrajectoryLimits(**kept)
    top, fastest = axis.limits.speed_m_s or GENTLE[0], axis.limits.acceleration_m_s2 or GENTLE[1]
    gentle = TrajectoryLimits(speed_m_s=min(top, GENTLE[0]), acceleration_m_s2=min(fastest, GENTLE[1]), jerk_m_s3=20.0 * GENTLE[1])
    limits = axis.trajectories.get(axis.targets.limits) or gentle
    if not (path := proven.get("path")):
        return limits
    start, end, duration = path  # of a run from before limits were kept with it
    return limits.slower(plan_trajectory(start, end, limits, period_s).duration_s / duration)


def verified(folder: RunFolder) -> Mapping[str, Any]:
    """Verdict of the move that verified the run last, as it was kept; empty without one."""
    names = [name for name in folder.names("results") if name.startswith("verify_")]
    return folder.load("results", names[-1]) if names else {}


def _proof(folder: RunFolder) -> Mapping[str, Any]:
    """Path of that move, start and end, m, and seconds, and its limits."""
    return verified(folder).get("proof") or {}
