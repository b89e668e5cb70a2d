"""Stops out of a move, asked for and after loss of the host: what the belt carries until the axis stands, at the worst instant."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis import Axis
from beltcomm.control import Cascade
from beltcomm.drive import FOLLOWING_ERROR_S, GUARD_S
from beltcomm.errors import Refused
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import SURPRISE
from beltcomm.model import Model
from beltcomm.simulate.setpoints import SetpointGrid
from beltcomm.simulate.stop_out_of_move import NO_STOP, OFF_THE_MODEL, References, StopOutOfMove, StopReaction, predict_stop_out_of_move
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, PredictedMove

#: By how much the belt's force may exceed its limit, for some milliseconds, when the host is lost in the move that commissioning chooses;
#: one that somebody asks for is refused beyond the second.
HOST_LOSS_SWING, HOST_LOSS_BEYOND = 1.4, 1.5
#: Instants of a move at which the host is thought to be lost.
INSTANTS = 48
#: m, beside ``SURPRISE`` times what was predicted: an axis that is further off its reference is stopped, in the drive and on the host.
LAG_SLACK_M = 2e-3


@dataclass(frozen=True)
class StopsOutOfMove:
    """Stops out of a move, the worst of any instant.

    Attributes
    ----------
    asked_for : StopOutOfMove
        Along the drive's ramp at once, by Ctrl-C or by a fault of the drive.
    host_lost : StopOutOfMove
        By the drive itself, as soon as it notices that setpoints stand still.
    """

    asked_for: StopOutOfMove = NO_STOP
    host_lost: StopOutOfMove = NO_STOP


def host_loss_limit_n(axis: Axis) -> float:
    """Belt force that a move may reach when its host is lost, N; infinite where nothing limits it."""
    return HOST_LOSS_BEYOND * axis.belt_force_limit_n


def allowed_lag_m(path: PredictedMove) -> float:
    """Following error beyond which a move is stopped, m."""
    return SURPRISE * float(np.max(np.abs(path.reference_m - path.motor_m))) + LAG_SLACK_M


def worst_stops(
    machine: Machine,
    model: Model,
    running: Cascade,
    drive: Loop,
    sent: Trajectory,
    lag_m: float,
    extra_torque_nm: Array | None = None,
) -> StopsOutOfMove:
    """The worst stops out of a move, over ``INSTANTS`` instants.

    Parameters
    ----------
    running : Cascade
        In the drive.
    sent : Trajectory
        Setpoints, m of the carriage.
    lag_m : float
        Following error that the drive lets pass.
    extra_torque_nm : ndarray (n,) or None
        Sent along with them.
    """
    ratio, grid = machine.ratio, SetpointGrid(sent.sample_period_s, drive.structure.period_s, len(sent.t_s))
    position, speed = grid.on_loop(sent.position_m / ratio), grid.on_loop(sent.velocity_m_s / ratio)
    references = References(position, speed, np.zeros(len(position)) if extra_torque_nm is None else grid.held(extra_torque_nm))
    guard_s = GUARD_S + sent.sample_period_s
    lost = StopReaction(lag_m / ratio, max(FOLLOWING_ERROR_S, sent.sample_period_s), guard_s, machine.deceleration_m_s2)
    moving = np.flatnonzero(speed)
    instants = np.unique(np.linspace(max(1, moving[0]), moving[-1], INSTANTS).astype(int)) if len(moving) else ()

    def worst(reaction: StopReaction) -> StopOutOfMove:
        found = NO_STOP
        for at in instants:
            try:
                found |= predict_stop_out_of_move(model, running, references, int(at), drive.simulated, reaction, float(sent.position_m[0]))
            except Refused:
                found |= OFF_THE_MODEL
        return found

    return StopsOutOfMove(worst(replace(lost, window_rad=math.inf, guard_s=0.0)), worst(lost))
