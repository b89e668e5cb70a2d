"""The move that proves the result: which one is admissible, how it is driven, and what it shows."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np

from beltcomm.axis_entries import TrajectoryLimits
from beltcomm.control import Cascade
from beltcomm.errors import Refused
from beltcomm.model import Model
from beltcomm.session import phases
from beltcomm.session.machine import Machine
from beltcomm.sidecar import Sidecar
from beltcomm.trajectory import Trajectory, load_move, plan_trajectory
from beltcomm.verify import DYNAMIC_TARGET_M, Demand, Verdict, demand, judge, predict_move, tracking_error

#: m and s of the verification move: the thesis's 0 to 0.5 m, and the rest in which the static error is read.
MOVE_M = 0.5
REST_S = 1.6
#: Where a drive cannot follow the standard move: slowest speed tried, m/s, longest move, s, and ramp to full speed, s.
SLOWEST_M_S = 2e-4
LONGEST_SLOW_MOVE_S = 8.0
RAMP_S = 0.2


def standard_move(machine: Machine, model: Model) -> tuple[Trajectory, str]:
    """The move of the thesis, 0 to 0.5 m with limits T_A, or what of it travel and limits of this axis allow."""
    low, high = machine.full_room().window_m
    start, end = phases.stroke_ends(machine)
    if machine.stroking() == "position" and low <= 0.0 and high >= MOVE_M:
        start = 0.0
    end = min(start + MOVE_M, end)
    limits = machine.axis.trajectories.get("T_A") or phases.gentle_limits(machine, model, machine.axis.limits.speed_m_s or 1.0)
    allowed, remark = admissible(machine, model, start, end, limits)
    return plan_trajectory(start, end, allowed, machine.drive.capabilities.sample_period_s), remark


def chosen_move(machine: Machine, model: Model, move: Path | None, name: str | None) -> tuple[Trajectory, str]:
    """The user's own move from a file, the 0 to 0.5 m move with limits of that name, or the standard one and in words why."""
    period = machine.drive.capabilities.sample_period_s
    if move is not None:
        return load_move(move, period, machine.axis), ""
    if name is None:
        return standard_move(machine, model)
    low, high = machine.full_room().window_m
    start = max(0.0, low)
    return plan_trajectory(start, min(start + MOVE_M, high), machine.axis.trajectory(name), period), ""


def admissible(machine: Machine, model: Model, start: float, end: float, limits: TrajectoryLimits) -> tuple[TrajectoryLimits, str]:
    """The limits, or the fastest uniformly slower ones with which the move keeps every limit of the axis, and in words why."""
    period = machine.drive.capabilities.sample_period_s
    broken = broken_limits(machine, model, plan_trajectory(start, end, limits, period))
    if not broken:
        return limits, ""
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        slower = _slower(limits, middle)
        if broken_limits(machine, model, plan_trajectory(start, end, slower, period)):
            high = middle
        else:
            low = middle
    if low == 0.0:
        raise Refused(f"no move from {start:g} m to {end:g} m keeps the limits: {'; '.join(broken)}")
    return _slower(limits, low), f"slowed down, because at the speed asked for {'; '.join(broken)}"


def within_target(machine: Machine, model: Model, cascade: Cascade, delay_s: float, trajectory: Trajectory) -> tuple[Trajectory, str]:
    """The move, or the fastest slower one that is predicted to meet the dynamic target, and in words why.

    A loop without velocity feedforward lags by speed over K_PP; its move is also shortened to ``LONGEST_SLOW_MOVE_S``.
    """
    capabilities = machine.drive.capabilities
    start, end = float(trajectory.position_m[0]), float(trajectory.position_m[-1])

    def error(move: Trajectory) -> float:
        rested = phases.held(move, REST_S)
        predicted = predict_move(
            model,
            cascade,
            rested,
            period_s=capabilities.structure.period_s,
            delay_s=delay_s,
            torque_limit_nm=capabilities.peak_torque_nm,
            counts_per_rev=capabilities.counts_per_rev,
        )
        return tracking_error(predicted.t_s, rested.position_m, predicted.motor_m).dynamic_m

    def at(speed: float) -> Trajectory:
        limits = TrajectoryLimits(jerk_m_s3=20.0 * speed / RAMP_S**2, acceleration_m_s2=speed / RAMP_S, speed_m_s=speed)
        goal = start + math.copysign(min(abs(end - start), speed * LONGEST_SLOW_MOVE_S), end - start)
        return plan_trajectory(start, goal, limits, capabilities.sample_period_s)

    whole = error(trajectory)
    if whole <= DYNAMIC_TARGET_M:
        return trajectory, ""
    low, high = SLOWEST_M_S, float(np.max(np.abs(trajectory.velocity_m_s)))
    if error(at(low)) > DYNAMIC_TARGET_M:
        return at(low), f"no move of {1e3 * low:g} mm/s or more is predicted to stay within {1e3 * DYNAMIC_TARGET_M:g} mm"
    for _ in range(10):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if error(at(middle)) <= DYNAMIC_TARGET_M else (low, middle)
    return at(low), (
        f"the standard move would have {1e3 * whole:.1f} mm of dynamic error with this drive; the fastest move predicted to stay within "
        f"{1e3 * DYNAMIC_TARGET_M:g} mm runs at {1e3 * low:.3g} mm/s and was driven over {1e3 * abs(at(low).position_m[-1] - start):.0f} mm"
    )


def _slower(limits: TrajectoryLimits, share: float) -> TrajectoryLimits:
    """Time stretched by 1/share: speed, acceleration and jerk fall with its powers."""
    return replace(
        limits,
        jerk_m_s3=limits.jerk_m_s3 * share**3,
        acceleration_m_s2=limits.acceleration_m_s2 * share**2,
        speed_m_s=limits.speed_m_s * share,
    )


def broken_limits(machine: Machine, model: Model, trajectory: Trajectory) -> list[str]:
    """Limits of axis, motor and drive that a move would break, each with value and limit."""
    asked, axis, room = demand(trajectory, model), machine.axis.limits, machine.full_room()
    top = machine.drive.capabilities.max_speed_rad_s * machine.ratio
    pairs = [
        ("the speed", asked.speed_m_s, min(axis.speed_m_s or math.inf, top), "m/s"),
        ("the acceleration", asked.acceleration_m_s2, axis.acceleration_m_s2 or math.inf, "m/s²"),
        ("the feed force", asked.feed_force_n, axis.feed_force_n or math.inf, "N"),
        ("the motor torque", asked.torque_nm, room.torque_nm, "N m"),
    ]
    broken = [f"{what} would be {value:.4g} {unit}, limit {limit:.4g} {unit}" for what, value, limit, unit in pairs if value > limit]
    low, high = room.window_m
    ends = float(np.min(trajectory.position_m)), float(np.max(trajectory.position_m))
    if ends[0] < low or ends[1] > high:
        broken.append(f"the move goes from {ends[0]:.4g} m to {ends[1]:.4g} m, the travel is {low:g}..{high:g} m")
    elif beyond := machine.stops_beyond(trajectory.position_m, trajectory.velocity_m_s):
        broken.append(beyond)
    return broken


def verify_move(
    machine: Machine, model: Model, cascade: Cascade, delay_s: float, trajectory: Trajectory, name: str = "move_1"
) -> tuple[Verdict, Demand]:
    """Phase 7: run the move with the new gains and compare with its prediction.   Raises Refused when it would break a limit."""
    broken = broken_limits(machine, model, trajectory)
    if broken:
        raise Refused("the move is refused: " + "; ".join(broken) + _fastest(machine, model, trajectory))
    running = machine.write_cascade(cascade)
    start = float(trajectory.position_m[0])
    if machine.folder.finished(name) is None and abs(machine.position_m - start) > 1e-4:
        phases.move_to(machine, start, model)
    # Positioning ends a little beside its goal; a reference that begins elsewhere would be a step, and no part of the move.
    trajectory = replace(trajectory, position_m=trajectory.position_m + machine.position_m - start)
    rested = phases.held(trajectory, REST_S)
    capabilities = machine.drive.capabilities
    sidecar = Sidecar(
        experiment="trajectory",
        start_position_m=machine.position_m,
        session_time_s=machine.session_time_s,
        closed_loop=True,
        held_out=True,
    )
    recording = machine.record(name, machine.follow(rested, "position"), machine.full_room(), sidecar)
    predicted = predict_move(
        model,
        running,
        rested,
        period_s=capabilities.structure.period_s,
        delay_s=delay_s,
        torque_limit_nm=capabilities.peak_torque_nm,
        counts_per_rev=capabilities.counts_per_rev,
    )
    return judge(recording, machine.ratio, predicted, rested.position_m), demand(trajectory, model)


def _fastest(machine: Machine, model: Model, trajectory: Trajectory) -> str:
    """Which uniformly slower version of a refused move would be admissible, in words."""
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        slower = Trajectory(
            trajectory.t_s / middle,
            trajectory.position_m,
            trajectory.velocity_m_s * middle,
            trajectory.acceleration_m_s2 * middle**2,
        )
        if broken_limits(machine, model, slower):
            high = middle
        else:
            low = middle
    if low == 0.0:
        return ""
    return f"; the same move stretched from {trajectory.duration_s:.3f} s to {trajectory.duration_s / low:.3f} s is admissible"
