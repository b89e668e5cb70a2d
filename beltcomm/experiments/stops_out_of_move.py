"""Stops out of a move, asked for and after loss of the host: what the belt carries until the axis stands, at the worst instant."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import reduce
from operator import or_

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.control import Cascade, Feedforward, feedforward_torque
from beltcomm.drive import FOLLOWING_ERROR_S, GUARD_S, LoopKind
from beltcomm.errors import Refused
from beltcomm.machine.closed_loop_watch import lent_torque_nm
from beltcomm.machine.envelope import Envelope
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import BELT_BEYOND, SURPRISE
from beltcomm.model import Model
from beltcomm.rundata.calibration import at_interval_ends
from beltcomm.simulate.loop import LoopRun, SetpointGrid, close_loop
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.simulate.stopping import NO_STOP, OFF_THE_MODEL, References, StopOutOfMove, StopReaction, predict_stop_out_of_move
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, PredictedMove, TrackingError, predict_range

#: Belt force over its limit, for some milliseconds, when the host is lost: aim of the move that commissioning chooses, and the limit beyond
#: which any is refused, which plan and refusals tell.
HOST_LOSS_SWING, HOST_LOSS_BEYOND = 1.4, 1.5
#: Belt force over its limit in the move that commissioning chooses, and in the worst instant of a stop out of it, which hardly depends on
#: how fast the move is: aims; refused and told is ``BELT_BEYOND``.
BELT_SWING, STOP_SWING = 1.05, 1.15
#: Shares of its speed at which positioning is tried, and instants of it.
POSITIONING_SHARES, POSITIONING_INSTANTS = (1.0, 0.85, 0.7, 0.55, 0.4, 0.3, 0.2), 24
#: Instants of a motion by each model of the family; m, within which all of them follow a loop whose stops need no look.
UNSURE_INSTANTS, FOLLOWS_M = 8, 3e-3
#: Instants around the worst one at which a stop is looked at, too: its force is a narrow peak where the axis speeds up.
FINER = 7
#: Instants of a move at which the host is thought to be lost.
INSTANTS = 48
#: m, beside ``SURPRISE`` times what was predicted: an axis that is further off its reference is stopped, in the drive and on the host.
LAG_SLACK_M = 2e-3
#: Share of the room beyond a move that what is not known of the axis may take.
ROOM_SHARE = 0.5


@dataclass(frozen=True)
class StopsOutOfMove:
    """Stops out of a move, the worst of any instant.

    Attributes
    ----------
    asked_for : StopOutOfMove
        Along the drive's ramp at once, by Ctrl-C or by a fault of the drive.
    host_lost : StopOutOfMove
        By the drive itself, as soon as it notices that setpoints stand still.
    completed : StopOutOfMove
        None: the move to its end, with what it overshoots.
    lag_m : float, m
        Largest following error of the completed move.
    """

    asked_for: StopOutOfMove = NO_STOP
    host_lost: StopOutOfMove = NO_STOP
    completed: StopOutOfMove = NO_STOP
    lag_m: float = 0.0

    @property
    def farthest(self) -> StopOutOfMove:
        """Move and stops together."""
        return self.asked_for | self.host_lost | self.completed

    def inside(self, window_m: tuple[float, float]) -> bool:
        """True if neither the move nor a stop out of it leaves a window of carriage positions, lowest and highest."""
        return window_m[0] <= self.farthest.low_m and self.farthest.high_m <= window_m[1]


def host_loss_limit_n(axis: Axis) -> float:
    """Belt force that a move may reach when its host is lost, N; infinite where nothing limits it.

    Parameters
    ----------
    axis : Axis
    """
    return HOST_LOSS_BEYOND * axis.belt_force_limit_n


def stop_limit_n(axis: Axis) -> float:
    """Belt force that a stop out of a move may reach, N, beside friction of the guide; infinite where nothing limits it.

    Parameters
    ----------
    axis : Axis
    """
    return BELT_BEYOND * axis.belt_force_limit_n


def allowed_lag_m(model: Model, predict: Callable[[Model, float], PredictedMove], room_m: float) -> float:
    """Following error beyond which a move is stopped, m, carriage side:  3 e + 2 mm,  e the largest over what is not known of the axis.

    Beside a weak loop, a per cent of the friction sent along is millimetres.  What is not known takes no more than half of the room: an
    axis that runs ahead is to be stopped inside its travel.

    Parameters
    ----------
    model : Model
        Known so far.
    predict : callable
        Of a model and a stretch of the belt, as of :func:`beltcomm.verify.predict_range`.
    room_m : float, m
        Of :func:`room_beyond_m`.
    """

    def lag(on: Model, stretch_m: float) -> TrackingError:
        path = predict(on, stretch_m)
        return TrackingError(float(np.max(np.abs(path.reference_m - path.motor_m))), 0.0)

    known, spread = lag(model, 0.0), predict_range(model, lag)
    least, most = (SURPRISE * one.dynamic_m + LAG_SLACK_M for one in (known, known if spread is None else spread[1]))
    return max(least, min(most, ROOM_SHARE * room_m))


def room_beyond_m(window_m: tuple[float, float], position_m: Array) -> float:
    """Room that a motion leaves at the end of the travel that it comes nearest to, m; an end that it only sets out from is none.

    Parameters
    ----------
    window_m : tuple of float, m
        Ends of the travel, carriage side.
    position_m : ndarray (n,), m
        Of the carriage.
    """
    (low, high), moved = window_m, np.diff(position_m)
    rooms = [high - position_m[1:][moved > 0.0].max()] if np.any(moved > 0.0) else []
    rooms += [position_m[1:][moved < 0.0].min() - low] if np.any(moved < 0.0) else []
    return max(float(min(rooms, default=0.0)), 0.0)


def belt_force_limit_n(machine: Machine, model: Model, speed_m_s: float, swing: float) -> float:
    """Belt force limit of a move, N: the feed force of the data sheet, which lists friction of the guide apart, and its swing.

    F_max = s (F_feed + F_c + d_c v)

    Parameters
    ----------
    machine : Machine
    model : Model
    speed_m_s : float, m/s
        Largest of the move.
    swing : float
        Times the force that is allowed for a belt that swings.
    """
    friction = model.get("cart_friction.level") + model.get("viscous_cart.damping") * speed_m_s
    return swing * (machine.axis.belt_force_limit_n + friction) - machine.weight_n


def positioning(
    machine: Machine, plan: Callable[[float], Trajectory], within: Callable[[Machine, Trajectory], Envelope]
) -> tuple[Trajectory, Envelope]:
    """A motion that is only a means, by a loop in the drive, and its envelope: as fast as the belt bears stops out of it and the envelope
    what it overshoots; as planned where nobody knows that loop, or the drive makes its strokes by itself.

    Parameters
    ----------
    machine : Machine
    plan : callable
        Of a share of its speed, to the motion with its rest.
    within : callable
        Of the machine and a motion, to the envelope that it is made in.
    """
    sent = plan(1.0)
    if (known := _known_loop(machine)) is None:
        return sent, within(machine, sent)
    model, stops = known
    best: tuple[float, Trajectory, Envelope, StopsOutOfMove] | None = None
    least_m = math.inf
    for share in POSITIONING_SHARES:
        sent = plan(share)
        envelope = within(machine, sent)
        found = stops(model, sent, envelope, POSITIONING_INSTANTS)
        limit = belt_force_limit_n(machine, model, float(np.max(np.abs(sent.velocity_m_s))), STOP_SWING)
        borne = found.asked_for.belt_force_n <= limit and found.host_lost.belt_force_n <= HOST_LOSS_SWING * machine.axis.belt_force_limit_n
        if borne and found.inside(envelope.window_m):
            beyond_m = leaves_by_m(machine, sent, envelope, least_m)
            if beyond_m < least_m:
                best, least_m = (share, sent, envelope, found), beyond_m
            if not beyond_m:
                break
    share, sent, envelope, found = best or (share, sent, envelope, found)
    machine.folder.journal(
        f"positioning: a stop out of it {found.asked_for.belt_force_n:.0f} N in the belt, PC or bus lost in it "
        f"{found.host_lost.belt_force_n:.0f} N" + (f"; at {share:.2g} times its speed for that" if share < 1.0 else "")
    )
    return sent, envelope


def leaves_by_m(machine: Machine, sent: Trajectory, envelope: Envelope, enough_m: float = math.inf) -> float:
    """How far the loop in the drive leaves an envelope in a motion or a stop out of it, m, at worst of the family; 0: not at all.

    A loop that is weak beside the torque sent along goes where that torque drives the axis: a tenth of the friction, or of the mass,
    that is not there is a way.  0 where nobody knows the loop, the drive makes its strokes by itself, or the axis is one known model.

    Parameters
    ----------
    machine : Machine
    sent : Trajectory
        Setpoints, m of the carriage.
    envelope : Envelope
        That the motion is made in.
    enough_m : float, m
        Beyond which nobody asks how far; then at least that.
    """
    known = _known_loop(machine)
    if known is None or len(machine.family) < 2:
        return 0.0
    (_, stops), (low, high) = known, envelope.window_m
    lag_m = math.inf if envelope.lag_m is None or machine.stroking() != "position" else envelope.lag_m
    beyond, behind = 0.0, 0.0
    for instants in (0, UNSURE_INSTANTS):
        if instants and not beyond and behind < FOLLOWS_M:
            break
        for member in machine.family:
            found = stops(member, sent, envelope, instants)
            reached, behind = found.farthest, max(behind, found.lag_m)
            beyond = max(beyond, low - reached.low_m, reached.high_m - high, found.lag_m - lag_m)
            if beyond > enough_m:
                return beyond
    return beyond


def _known_loop(machine: Machine) -> tuple[Model, Callable[[Model, Trajectory, Envelope, int], StopsOutOfMove]] | None:
    """The model, and the worst stops of a model in the loop that is in the drive; None where nobody can predict it."""
    loop, own, kind = machine.cascade, machine.drive.capabilities, machine.stroking()
    if machine.closed is None or loop is None or kind == "profile" or own.gains == "unknown":
        return None
    model, delay_s = machine.closed
    drive = Loop(own.structure, delay_s, own.peak_torque_nm, own.counts_per_rev)
    loop = replace(loop, feedforward=machine.feedforward or loop.feedforward)

    def stops(member: Model, sent: Trajectory, envelope: Envelope, instants: int) -> StopsOutOfMove:
        lag = math.inf if envelope.lag_m is None else envelope.lag_m
        return worst_stops(machine, member, loop, drive, sent, lag, instants=instants, kind=kind)

    return model, stops


def worst_stops(
    machine: Machine,
    model: Model,
    running: Cascade,
    drive: Loop,
    sent: Trajectory,
    lag_m: float,
    extra_torque_nm: Array | None = None,
    instants: int = INSTANTS,
    kind: LoopKind = "position",
) -> StopsOutOfMove:
    """The worst stops out of a move.

    The drive's torque is bounded by the limit that is lent to the move, which holds until it stands.  Around the worst instant the gains
    are also those at the ends of their intervals, where steps have shown what they mean.

    Parameters
    ----------
    machine : Machine
    model : Model
    running : Cascade
        In the drive.
    drive : Loop
        Structure, dead time and limit of the loop.
    sent : Trajectory
        Setpoints, m of the carriage.
    lag_m : float
        Following error that the drive lets pass.
    extra_torque_nm : ndarray (n,) or None
        Sent along with them.
    instants : int
        At which the move is thought to end.
    kind : LoopKind
        Loop that makes it; one of speed lets every following error pass.
    """
    if kind == "velocity":  # the same cascade without its position loop
        running = replace(running, kpp_1_s=0.0, feedforward=replace(running.feedforward, velocity=1.0))
        drive = replace(drive, structure=replace(drive.structure, output_limit_rad_s=math.inf, dead_zone_rad=0.0))
        lag_m = math.inf
    ratio, grid = machine.ratio, SetpointGrid(sent.sample_period_s, drive.structure.period_s, len(sent.t_s))
    position, speed = grid.on_loop(sent.position_m / ratio), grid.on_loop(sent.velocity_m_s / ratio)
    along = np.zeros(len(sent.t_s)) if extra_torque_nm is None else extra_torque_nm
    if machine.sends_feedforward and kind in machine.drive.capabilities.torque_along:  # what the host sends does not end with it
        along = along + feedforward_torque(running.feedforward, sent.velocity_m_s / ratio, sent.sample_period_s)
        running = replace(running, feedforward=Feedforward(velocity=running.feedforward.velocity))
    references = References(position, speed, grid.zero_order_hold(along))
    try:
        resting = SimulatedPlant(model, float(sent.position_m[0]))
        whole = close_loop(resting.copied(), running, drive.simulated, "position", position, speed, references.added_nm)
    except Refused:
        return StopsOutOfMove(OFF_THE_MODEL, OFF_THE_MODEL)
    bounded = replace(drive.simulated, torque_limit_nm=lent_torque_nm(machine, model, whole.asked_nm))
    guard_s = GUARD_S + sent.sample_period_s
    lost = StopReaction(lag_m / ratio, max(FOLLOWING_ERROR_S, sent.sample_period_s), guard_s, machine.deceleration_m_s2)
    losses = [lost] if machine.drive.capabilities.following_error_stops else [lost, replace(lost, window_rad=math.inf)]
    moving = np.flatnonzero(speed)
    ends = np.unique(np.linspace(max(1, moving[0]), moving[-1], instants).astype(int)) if len(moving) else np.zeros(0, dtype=int)
    others = at_interval_ends(machine.folder, running)

    def worst(reaction: StopReaction) -> StopOutOfMove:
        if not len(ends):
            return NO_STOP

        def at(end: int, loop: Cascade) -> StopOutOfMove:
            try:
                return predict_stop_out_of_move(resting, loop, references, end, bounded, reaction)
            except Refused:
                return OFF_THE_MODEL

        found = [at(int(end), running) for end in ends]
        most = max(range(len(found)), key=lambda number: found[number].belt_force_n)
        around = np.linspace(ends[max(most - 1, 0)], ends[min(most + 1, len(ends) - 1)], FINER + 2).astype(int)[1:-1]
        found += [at(int(end), loop) for loop in (running, *others) for end in around]
        return reduce(or_, found)

    behind = float(np.max(np.abs(ratio * (position - position[0] - whole.position_rad))))
    return StopsOutOfMove(
        worst(replace(lost, window_rad=math.inf, guard_s=0.0)), reduce(or_, map(worst, losses)), _completed(resting, whole), behind
    )


def _completed(resting: SimulatedPlant, whole: LoopRun) -> StopOutOfMove:
    """A move to its end, with what it overshoots."""
    places = resting.start_m + whole.cart_m
    return StopOutOfMove(float(np.ptp(places)), float(places.min()), float(places.max()), float(whole.belt_force_n.max()))
