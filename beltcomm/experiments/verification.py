"""The move that proves the result: which one is admissible, and which limits another one would break."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade
from beltcomm.design.led_reference import LedReference, can_lead, led_reference
from beltcomm.drive import Drive
from beltcomm.errors import Refused
from beltcomm.experiments import phases
from beltcomm.experiments.stops_out_of_move import (
    BELT_SWING,
    HOST_LOSS_SWING,
    STOP_SWING,
    StopsOutOfMove,
    allowed_lag_m,
    belt_force_limit_n,
    host_loss_limit_n,
    room_beyond_m,
    stop_limit_n,
    worst_stops,
)
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.quantities import mm
from beltcomm.rundata.store import as_in_drive
from beltcomm.sending import predict_led
from beltcomm.trajectory import Trajectory, load_move, plan_trajectory, with_dwell
from beltcomm.verify import REST_S, Loop, PredictedMove, TrackingError, demand, predict_move, predict_range, tracking_error

#: Where a drive cannot follow the standard move: share of the target that a prediction aims at, longest move named, s, longest one
#: driven, s; slowest short one, m/s, and its ramp to full speed, s.
AIM_SHARE = 0.9
SLOWEST_MOVE_S = 600.0
LONGEST_SLOW_MOVE_S = 8.0
SLOWEST_M_S = 2e-4
RAMP_S = 0.2
#: How often the move that commissioning chooses is slowed down until the belt swings by no more than ``BELT_SWING``.  One that somebody
#: asks for is refused beyond ``BELT_BEYOND`` only, where it would be stopped.
BELT_TRIES = 8
#: Share of its speed down to which a standard move is slowed for the belt.
LEAST_SHARE = 0.3
#: A force that is more times its limit than this tells by how much it is beyond only roughly.
MOST_OVER = 4.0
#: What a stop out of the travel counts as: no force tells how far the move is beyond.
OUTSIDE = 1.5
#: What a move with a led reference is slowed down by at a time.
SLOWER = 0.9
#: m: positioning ends so far beside its goal at most, and the move that was planned from there begins beside it too.
BESIDE_M = 2e-3


@dataclass(frozen=True)
class StandardMove:
    """The move of the targets (0 to 0.5 m with limits T_A unless stated), or what of it travel and limits of this axis allow.

    Attributes
    ----------
    start_m, end_m : float
        Carriage.
    limits : TrajectoryLimits
        Of speed, acceleration, jerk.
    remark : str
        In words what was taken away, or "".
    chosen : bool
        Whether its limits are this program's choice, for axis.yaml states none.
    """

    start_m: float
    end_m: float
    limits: TrajectoryLimits
    remark: str
    chosen: bool = False

    def at(self, share: float, period_s: float) -> Trajectory:
        """The move with its time stretched by 1/share: share of the speed limit, its square of the acceleration, its cube of the jerk."""
        return plan_trajectory(self.start_m, self.end_m, self.limits.slower(share), period_s)


def standard_move(machine: Machine, model: Model) -> StandardMove:
    """The standard move of this axis, admissible for its model.

    Parameters
    ----------
    machine : Machine
    model : Model

    Raises
    ------
    Refused
        When there is none.
    """
    start, end = _way(machine)
    stated = machine.axis.trajectories.get(machine.axis.targets.limits)
    limits = stated or phases.gentle_limits(machine, model, math.inf)
    return StandardMove(start, end, *_admissible(machine, model, start, end, limits), chosen=stated is None)


def _kept_inside(machine: Machine, model: Model, cascade: Cascade, delay_s: float) -> StandardMove:
    """The standard move, slowed down until the belt keeps its limits and the carriage its travel with this controller: as it swings, in a
    stop, and when the host is lost.

    Raises Refused as :func:`standard_move`.
    """
    standard, share, why = standard_move(machine, model), 1.0, ""
    for _ in range(BELT_TRIES):
        move = standard.at(share, machine.drive.capabilities.sample_period_s)
        path, stops = _predicted(machine, model, cascade, delay_s, move), predicted_stops(machine, model, cascade, delay_s, move)
        top = float(np.max(np.abs(move.velocity_m_s)))
        swing, stop = (belt_force_limit_n(machine, model, top, factor) for factor in (BELT_SWING, STOP_SWING))
        beyond, stated = HOST_LOSS_SWING * machine.axis.belt_force_limit_n, (stop_limit_n(machine.axis), host_loss_limit_n(machine.axis))
        over, what = max(
            (path.belt_force_n / swing, f"the swinging belt carries more than {swing:.0f} N"),
            (stops.asked_for.belt_force_n / stop, f"a stop loads the belt to nearly {stated[0]:.0f} N + friction"),
            (stops.host_lost.belt_force_n / beyond, f"a lost PC loads the belt to nearly {stated[1]:.0f} N"),
            (0.0 if stops.inside(machine.envelope().window_m) else OUTSIDE, "a stop or a lost PC takes the carriage out of its travel"),
        )
        if over <= 1.0:
            break
        share *= 0.99 / math.sqrt(min(over, MOST_OVER))
        if share < LEAST_SHARE:  # not for the move to mend: it is refused as it is
            return standard
        why = f"move slowed to {100 * share:.0f} %: above, {what}"
    if not why:
        return standard
    remark = f"{standard.remark}; {why}" if standard.remark else why
    return replace(standard, limits=standard.limits.slower(share), remark=remark)


def slowed_move(machine: Machine, model: Model, cascade: Cascade, delay_s: float) -> StandardMove:
    """The standard move, as fast as belt, a lost host and, where its limits are our choice, the settled error let it be.

    Parameters
    ----------
    machine : Machine
    model : Model
        For which it is predicted.
    cascade : Cascade
    delay_s : float, s
        Of the torque path.

    Returns
    -------
    StandardMove
        With a remark on what bounds it.
    """
    return _settling(machine, model, cascade, delay_s, _kept_inside(machine, model, cascade, delay_s))


def predicted_stops(machine: Machine, model: Model, cascade: Cascade, delay_s: float, trajectory: Trajectory) -> StopsOutOfMove:
    """The worst stops out of a move, with a led reference where the drive gets one.

    Parameters
    ----------
    machine : Machine
    model : Model
        For which they are predicted.
    cascade : Cascade
    delay_s : float, s
        Of the torque path.
    trajectory : Trajectory
        The move, at the carriage.

    Returns
    -------
    StopsOutOfMove
        Way, m, and belt force, N.
    """
    drive, path, running = in_drive(machine, delay_s), with_dwell(trajectory, REST_S), cascade
    sent = path
    if leads := uses_led_reference(machine.drive, machine.axis, cascade):
        running = as_in_drive(machine.folder, cascade)
        led = led_reference(model, path, running, drive.structure, delay_s)
        sent = led.sent

    def predict(on: Model, stretch_m: float) -> PredictedMove:
        if leads:
            return predict_led(on, running, led, drive, stretch_m)
        return predict_move(on, running, path, drive, belt_stretch_m=stretch_m)

    room = room_beyond_m(machine.envelope().window_m, trajectory.position_m)
    return worst_stops(machine, model, running, drive, sent, allowed_lag_m(model, predict, room))


def _way(machine: Machine) -> tuple[float, float]:
    """From 0 over the way of the targets; where travel or a loop that drifts while positioning forbid that, what of it lies well inside."""
    low, high = machine.envelope().window_m
    start, end = phases.stroke_ends(machine)
    spare, way = phases.END_MARGIN_M, machine.axis.targets.way_m
    if machine.stroking() == "position" and low <= -spare and high >= way + spare:
        start = 0.0
    return start, min(start + way, end)


def move_asked_for(
    machine: Machine, model: Model, cascade: Cascade, delay_s: float, file: Path | None, name: str | None
) -> tuple[Trajectory, str]:
    """The user's own move from a file, the 0 to 0.5 m move with limits named in axis.yaml, or the standard move; and a remark.

    Parameters
    ----------
    machine : Machine
    model : Model
        For which the standard move is slowed.
    cascade : Cascade
    delay_s : float, s
        Of the torque path.
    file : Path or None
        Of the user's own move; it goes first.
    name : str or None
        Of limits under ``trajectories`` in axis.yaml.

    Returns
    -------
    tuple of Trajectory and str
        Move at the carriage, and "" where there is nothing to remark.
    """
    period = machine.drive.capabilities.sample_period_s
    if file is not None:
        return load_move(file, period, machine.axis), ""
    if name is None:
        move = slowed_move(machine, model, cascade, delay_s)
        return move.at(1.0, period), move.remark
    return plan_trajectory(*_way(machine), machine.axis.trajectory(name), period), ""


def _admissible(machine: Machine, model: Model, start: float, end: float, limits: TrajectoryLimits) -> tuple[TrajectoryLimits, str]:
    """The limits, or the fastest uniformly slower ones with which the move keeps every limit of the axis, and in words why."""
    period = machine.drive.capabilities.sample_period_s
    window = machine.envelope().window_m
    spare = max(0.0, min(BESIDE_M, 0.5 * (min(start, end) - window[0]), 0.5 * (window[1] - max(start, end))))
    broken = _broken_limits(machine, model, plan_trajectory(start, end, limits, period), spare)
    if not broken:
        return limits, ""
    pace = _fastest_pace(lambda pace: _broken_limits(machine, model, plan_trajectory(start, end, limits.slower(pace), period), spare))
    if pace == 0.0:
        raise Refused(f"no move from {start:g} m to {end:g} m keeps the limits: {'; '.join(broken)}")
    return limits.slower(pace), f"the move was slowed down, because at the speed asked for {'; '.join(broken)}"


def uses_led_reference(drive: Drive, axis: Axis, cascade: Cascade) -> bool:
    """True if the reference is led by the inverse of the drive's cascade: known gains without feedforward, on a level axis.

    Parameters
    ----------
    drive : Drive
    axis : Axis
    cascade : Cascade
        That runs in it.

    Returns
    -------
    bool
        For this axis and drive.
    """
    own = drive.capabilities
    return own.gains != "unknown" and can_lead(own.structure, cascade) and not axis.mounting.tilted


def _predicted(machine: Machine, model: Model, cascade: Cascade, delay_s: float, trajectory: Trajectory) -> PredictedMove:
    """A move and the rest after it, with a led reference where the drive gets one."""
    drive, path = in_drive(machine, delay_s), with_dwell(trajectory, REST_S)
    if not uses_led_reference(machine.drive, machine.axis, cascade):
        return predict_move(model, cascade, path, drive)
    running = as_in_drive(machine.folder, cascade)
    return predict_led(model, running, led_reference(model, path, running, drive.structure, delay_s), drive)


def in_drive(machine: Machine, delay_s: float) -> Loop:
    """Loop of this drive, for the prediction of moves.

    Parameters
    ----------
    machine : Machine
    delay_s : float, s
        Of the torque path.
    """
    capabilities = machine.drive.capabilities
    return Loop(capabilities.structure, delay_s, capabilities.peak_torque_nm, capabilities.counts_per_rev)


def _error_m(machine: Machine, model: Model, cascade: Cascade, delay_s: float, trajectory: Trajectory) -> float:
    """Predicted following error of a move, m: the largest of the places where the targets count."""
    return _largest(machine, _predicted(machine, model, cascade, delay_s, trajectory)).dynamic_m


def _largest(machine: Machine, path: PredictedMove) -> TrackingError:
    """The largest errors of the places where the targets count."""
    targets, at = machine.axis.targets, {"motor": path.read_m, "carriage": path.cart_m}
    errors = [tracking_error(path.t_s, path.reference_m, at[place], targets) for place in targets.places]
    return TrackingError(max(error.dynamic_m for error in errors), max(error.static_m for error in errors))


def fastest(machine: Machine, model: Model, cascade: Cascade, delay_s: float, standard: StandardMove) -> Trajectory | None:
    """The standard move with its time stretched until ``AIM_SHARE`` of the target is predicted; None beyond ``SLOWEST_MOVE_S``.

    A loop without velocity feedforward lags by speed over K_PP, so its error falls with the speed.

    Parameters
    ----------
    machine : Machine
    model : Model
    cascade : Cascade
    delay_s : float
        From setpoint to acting torque.
    standard : StandardMove
    """
    period, aim = machine.drive.capabilities.sample_period_s, AIM_SHARE * machine.axis.targets.following_m
    share = 1.0
    while True:
        move = standard.at(share, period)
        if move.duration_s > SLOWEST_MOVE_S:
            return None
        error = _error_m(machine, model, cascade, delay_s, move)
        if error <= aim:
            return move
        share *= max(0.98 * aim / error, 1e-3)


def within_target(machine: Machine, model: Model, cascade: Cascade, delay_s: float, standard: StandardMove) -> tuple[Trajectory, str]:
    """The standard move, or where that misses its target the :func:`fastest` one that is predicted to meet it, and in words why.

    One that takes longer than ``LONGEST_SLOW_MOVE_S`` is only named; a short one at constant speed takes its place, in which the
    integrator must break friction free within the target.

    Parameters
    ----------
    machine : Machine
    model : Model
        For which the errors are predicted.
    cascade : Cascade
    delay_s : float, s
        Of the torque path.
    standard : StandardMove
        The standard move, slowed for belt and stops.

    Returns
    -------
    tuple of Trajectory and str
        Move at the carriage, and "" where there is nothing to remark.
    """
    if uses_led_reference(machine.drive, machine.axis, cascade):
        return _led_within_target(machine, model, cascade, delay_s, standard)
    period, following_m = machine.drive.capabilities.sample_period_s, machine.axis.targets.following_m
    start, end = standard.start_m, standard.end_m

    def short(speed: float) -> Trajectory:
        limits = TrajectoryLimits(jerk_m_s3=20.0 * speed / RAMP_S**2, acceleration_m_s2=speed / RAMP_S, speed_m_s=speed)
        goal = start + math.copysign(min(abs(end - start), speed * LONGEST_SLOW_MOVE_S), end - start)
        return plan_trajectory(start, goal, limits, period)

    def good(move: Trajectory) -> bool:
        return _error_m(machine, model, cascade, delay_s, move) <= AIM_SHARE * following_m

    whole = standard.at(1.0, period)
    off = _error_m(machine, model, cascade, delay_s, whole)
    if off <= following_m:
        return whole, standard.remark
    text = f"{standard.remark}; " if standard.remark else ""
    text += f"the standard move would have {mm(off)} of following error with this controller"
    target = mm(following_m)
    slow = fastest(machine, model, cascade, delay_s, standard)
    if slow is None:
        text += f", and no move of less than {SLOWEST_MOVE_S:.0f} s stays within {target}"
    else:
        top = 1e3 * float(np.max(np.abs(slow.velocity_m_s)))
        text += f"; the fastest over this way that is safely predicted within {target} takes {slow.duration_s:.3g} s, up to {top:.3g} mm/s"
        if slow.duration_s <= LONGEST_SLOW_MOVE_S:
            return slow, text
    low, high = SLOWEST_M_S, float(np.max(np.abs(whole.velocity_m_s)))
    if good(short(low)):
        for _ in range(10):
            middle = math.sqrt(low * high)
            low, high = (middle, high) if good(short(middle)) else (low, middle)
    move = short(low)
    way = 1e3 * abs(float(move.position_m[-1]) - start)
    return move, f"{text}; too long here, so {way:.2g} mm were driven, at {1e3 * low:.3g} mm/s from the start on"


def _settling(machine: Machine, model: Model, cascade: Cascade, delay_s: float, standard: StandardMove) -> StandardMove:
    """The move; where its limits are our choice and it may come to rest beside the target, the fastest that does not.

    Friction holds what it stands off by until the integral part has overcome it, which takes longer than the axis has; a gentler end of the
    move leaves less.  Where it sticks hangs on the last digits of model and start, so that the range of what is not known counts.
    """
    period, targets, share = machine.drive.capabilities.sample_period_s, machine.axis.targets, 1.0
    if not standard.chosen or uses_led_reference(machine.drive, machine.axis, cascade):
        return standard
    rests = first = _rests_m(machine, model, cascade, delay_s, standard.at(share, period))
    while rests > targets.settled_m:
        share *= SLOWER**2
        move = standard.at(share, period)
        if move.duration_s > LONGEST_SLOW_MOVE_S:
            return standard
        rests = _rests_m(machine, model, cascade, delay_s, move)
    if share == 1.0:
        return standard
    text = f"{standard.remark}; " if standard.remark else ""
    text += f"at its full speed friction may hold it {1e3 * first:.3g} mm off after {targets.after_s:g} s"
    text += f", so it was driven at {100 * share:.0f} % of its speed, in {move.duration_s:.3g} s"
    return replace(standard, limits=standard.limits.slower(share), remark=text)


def _rests_m(machine: Machine, model: Model, cascade: Cascade, delay_s: float, move: Trajectory) -> float:
    """Largest settled error of a move over what is not known of the axis, m."""
    path, drive = with_dwell(move, REST_S), in_drive(machine, delay_s)

    def error(on: Model, stretch_m: float) -> TrackingError:
        return _largest(machine, predict_move(on, cascade, path, drive, belt_stretch_m=stretch_m))

    spread = predict_range(model, error)
    return error(model, 0.0).static_m if spread is None else spread[1].static_m


def _led_error(cascade: Cascade, led: LedReference, drive: Loop, model: Model, stretch_m: float) -> TrackingError:
    """Error at the motor of a model and a stretch of the belt along a led reference."""
    return predict_led(model, cascade, led, drive, stretch_m).error


def _led_within_target(machine: Machine, model: Model, cascade: Cascade, delay_s: float, standard: StandardMove) -> tuple[Trajectory, str]:
    """The standard move with a led reference, as fast as the drive's bounds and what is known of the axis let it stay within the target."""
    period, drive, share = machine.drive.capabilities.sample_period_s, in_drive(machine, delay_s), 1.0
    aim, why = AIM_SHARE * machine.axis.targets.following_m, ""
    while True:
        move = standard.at(share, period)
        path = _predicted(machine, model, cascade, delay_s, move)
        if not (path.saturated or path.error.dynamic_m > aim):
            running = as_in_drive(machine.folder, cascade)
            led = led_reference(model, with_dwell(move, REST_S), running, drive.structure, delay_s)
            spread = predict_range(model, partial(_led_error, running, led, drive))
            if spread is None or spread[1].dynamic_m <= aim or move.duration_s > LONGEST_SLOW_MOVE_S:
                break
            reason = f"what is not known of the axis may make {mm(spread[1].dynamic_m)} of following error of it"
        elif path.saturated:
            reason = f"its reference would reach {' and '.join(path.saturated)}"
        else:
            reason = f"it would have {mm(path.error.dynamic_m)} of following error"
        why = why or reason  # at full speed; slower ones may have others
        if move.duration_s > LONGEST_SLOW_MOVE_S:
            break
        share *= SLOWER
    if share == 1.0:
        return move, standard.remark
    text = f"{standard.remark}; " if standard.remark else ""
    return move, f"{text}at its full speed {why}, so it was driven at {100 * share:.0f} % of its speed, in {move.duration_s:.3g} s"


def _broken_limits(machine: Machine, model: Model, trajectory: Trajectory, spare_m: float = 0.0) -> list[str]:
    """Limits of axis, motor and drive that a move would break, each with value and limit."""
    asked, axis, envelope = demand(trajectory, model), machine.axis.limits, machine.envelope()
    pairs = [
        ("the speed", asked.speed_m_s, phases.SPEED_SHARE * envelope.speed_m_s, "m/s"),
        ("the acceleration", asked.acceleration_m_s2, axis.acceleration_m_s2 or math.inf, "m/s²"),
        ("the feed force", asked.feed_force_n, math.inf if machine.over_belt else machine.belt_left_n, "N"),
        ("the motor torque", asked.torque_nm, envelope.torque_nm, "N m"),
    ]
    broken = [f"{what} would be {value:.4g} {unit}, limit {limit:.4g} {unit}" for what, value, limit, unit in pairs if value > limit]
    low, high = envelope.window_m
    ends = float(np.min(trajectory.position_m)), float(np.max(trajectory.position_m))
    if ends[0] < low or ends[1] > high:
        broken.append(f"the move goes from {ends[0]:.4g} m to {ends[1]:.4g} m, the travel is {low:g}..{high:g} m")
    elif beyond := machine.stops_badly(trajectory.position_m, trajectory.velocity_m_s, spare_m):
        broken.append(beyond)
    return broken


def refuse_broken(machine: Machine, model: Model, trajectory: Trajectory) -> None:
    """Refuse a move that would break a limit of the axis.

    Parameters
    ----------
    machine : Machine
    model : Model
        For which the limits are asked.
    trajectory : Trajectory
        At the carriage.

    Raises
    ------
    Refused
        With the limits, and the fastest version of it that is admitted.
    """
    broken = _broken_limits(machine, model, trajectory)
    if broken:
        raise Refused("the move is refused: " + "; ".join(broken) + _fastest(machine, model, trajectory))


def _fastest(machine: Machine, model: Model, trajectory: Trajectory) -> str:
    """Uniformly slower version of a refused move that would be admissible, in words."""
    one = trajectory

    def broken(pace: float) -> list[str]:
        slower = Trajectory(one.t_s / pace, one.position_m, one.velocity_m_s * pace, one.acceleration_m_s2 * pace**2)
        return _broken_limits(machine, model, slower)

    pace = _fastest_pace(broken)
    return f"; the same move stretched from {one.duration_s:.3f} s to {one.duration_s / pace:.3f} s is admissible" if pace else ""


def _fastest_pace(broken: Callable[[float], list[str]]) -> float:
    """Largest share of the pace with which nothing is broken, to a millionth; 0 for none."""
    low, high = 0.0, 1.0
    for _ in range(20):
        middle = 0.5 * (low + high)
        if broken(middle):
            high = middle
        else:
            low = middle
    return low
