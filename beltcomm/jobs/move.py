"""``beltcomm move``: a short way, crept under torque without any loop, or as a stroke of the drive where no torque can be commanded."""

from __future__ import annotations

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.drive import Capabilities, Drive, Motion
from beltcomm.errors import UsageError
from beltcomm.experiments import own_strokes
from beltcomm.experiments.agreement import agree, plan_result
from beltcomm.experiments.options import Options
from beltcomm.experiments.plan import Plan, move_plan
from beltcomm.language import tr
from beltcomm.machine import gravity, scale
from beltcomm.machine.creep import BREAKAWAY_SHARE, CREEP_SPEED_M_S, MARGIN_M, NEAR_M, RAMP_S, move_limits, small_move
from beltcomm.machine.machine import stroking
from beltcomm.machine.ratings import tell_ratings
from beltcomm.result import Result
from beltcomm.sentences.own_words import own_words
from beltcomm.talk import Talk
from beltcomm.trajectory import at_rest, join, plan_trajectory

#: m: the longest way of ``beltcomm move``.
LONGEST_MOVE_M = 0.1
#: A stroke of the drive, slow and soft: the gains that were found in it are not known.
STROKE = TrajectoryLimits(jerk_m_s3=1.0, acceleration_m_s2=0.1, speed_m_s=0.02)
#: s: rest before and after it, and what it may arrive late.
REST_S, LATE_S = 0.3, 2.0


def admit(axis: Axis, by_m: float) -> None:
    """Refuse a move that is not crept, before anything is asked.

    Parameters
    ----------
    axis : Axis
        Data sheets.
    by_m : float, m
        Way of the carriage, either way.

    Raises
    ------
    UsageError
        For a way that is too long or too short, an axis file that does not say enough, or an axis on which a torque from zero lets the
        carriage fall.
    """
    if not 2.0 * NEAR_M <= abs(by_m) <= LONGEST_MOVE_M:
        ways = f"{2e3 * NEAR_M:g} to {1e3 * LONGEST_MOVE_M:.0f} mm, either way"
        raise UsageError(f"a move by {1e3 * by_m:g} mm cannot be crept: give {ways} (it ends within {1e3 * NEAR_M:g} mm)")
    gravity.not_on_tilted(
        axis, "it is not crept without a loop, for a torque from zero would let it fall; `beltcomm verify --move FILE` moves it"
    )
    axis.require("move", "pulley.effective_radius_m", "travel.min_m", "travel.max_m")


def _by_drive(capabilities: Capabilities) -> bool:
    """True if the drive makes the move by itself."""
    return stroking(capabilities) == "profile"


def _plan_of(axis: Axis, capabilities: Capabilities, by_m: float) -> Plan:
    """Plan of the move, before anything happens."""
    torque = axis.torque_limit_nm if _by_drive(capabilities) else BREAKAWAY_SHARE * axis.torque_limit_nm
    speed, seconds = CREEP_SPEED_M_S, RAMP_S * (1.0 + abs(by_m) / 3e-3)
    what = tr("creep {way:+.1f} mm under slowly rising torque, in several goes", way=1e3 * by_m)
    if _by_drive(capabilities):
        speed, seconds = (
            STROKE.speed_m_s,
            abs(by_m) / STROKE.speed_m_s + STROKE.speed_m_s / STROKE.acceleration_m_s2 + 2.0 * REST_S + LATE_S,
        )
        what = (
            f"go {1e3 * by_m:+.1f} mm in one slow stroke of the drive, with the gains that are in it."
            f"{own_strokes.unguarded_words(capabilities)[:-1]}"
        )
    force = min(axis.belt_force_limit_n, torque / axis.transmission_m_rad)
    return move_plan(axis, abs(by_m), abs(by_m) + MARGIN_M, speed, torque, force, seconds, what)


def _make(drive: Drive, axis: Axis, by_m: float, position_m: float | None) -> float:
    """Move from where the operator says that the carriage stands; returns how far it went, m.  Raises as the drive does."""
    if not _by_drive(drive.capabilities):
        return small_move(drive, axis, by_m, position_m)
    ratio, period_s = axis.transmission_m_rad, drive.capabilities.sample_period_s
    limits = move_limits(drive, axis, by_m, position_m)
    path = join([at_rest(0.0, REST_S, period_s), plan_trajectory(0.0, by_m, STROKE, period_s), at_rest(by_m, REST_S, period_s)])
    here = drive.read(["position_rad"])["position_rad"]
    motion = Motion("profile", period_s, here + path.position_m / ratio, path.velocity_m_s / ratio, np.zeros(len(path.t_s)))
    drive.record(motion, limits, lambda _row: None)
    return ratio * (drive.read(["position_rad"])["position_rad"] - here)


@own_words
def moved(drive: Drive, name: str, axis: Axis, by_m: float, options: Options, talk: Talk) -> Result:
    """The command on a connected drive.

    Parameters
    ----------
    drive : Drive
        Connected.
    name : str
        Of the drive, for what to do next. Exit code 1 for a move that fell short.
    axis : Axis
        As its file states it.
    by_m : float, m
        Way of the carriage, either way.
    options : Options
        Settings of the session.
    talk : Talk
    """
    tell_ratings(axis, drive.capabilities, talk)
    plan = _plan_of(axis, drive.capabilities, by_m)
    if options.dry_run:
        return plan_result(plan)
    agree(plan, options, talk, drive, axis)
    gone, closed = _make(drive, axis, by_m, options.position_m), _by_drive(drive.capabilities)
    reached = abs(gone - by_m) < max(0.2 * abs(by_m), 2e-3)
    how = "the drive closed its loop with the gains that are in it" if closed else "no loop was closed"
    text = [f"The carriage went {1e3 * gone:+.2f} mm, asked were {1e3 * by_m:+.2f} mm; {how}."]
    text += [scale.ruler_line(name, axis, gone)] if abs(gone) >= scale.SHORTEST_M else []
    return Result({"moved_m": gone, "asked_m": by_m}, text, 0 if reached else 1)


#: A creep by the encoder against a ruler, in the words of the axis.
ruler = own_words(scale.ruler)
