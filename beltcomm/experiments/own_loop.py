"""A drive whose gains nobody can write: its own loop is tried out by slow strokes, then carries the records and the moves that count.

What a person has set in it is unknown, so nothing is predicted but what a rigid axis takes: strokes begin slow, each is watched against
the one before, and a stop is counted with the lag that they showed.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from beltcomm.control import Cascade
from beltcomm.drive import Row
from beltcomm.errors import DriveFault, Refused, SafetyStop
from beltcomm.experiments import phases, verification
from beltcomm.experiments.recentre import stands
from beltcomm.identify.amplitude import family_around
from beltcomm.machine.machine import Envelope, Machine
from beltcomm.model import Model
from beltcomm.quantities import mm
from beltcomm.rundata.delays import delay
from beltcomm.rundata.findings import Findings
from beltcomm.simulate.stopping import REACTION_PERIODS, SWING, Braking, rigid_deceleration, total_friction, total_viscous
from beltcomm.trajectory import Trajectory, plan_trajectory, with_dwell
from beltcomm.verify import REST_S, Demand, Verdict, demand, judge, predict_move

#: m and m/s of the strokes that try the loop out, in this order; s of rest after each.
TRIAL_M, TRIALS_M_S, TRIAL_REST_S = 0.04, (0.02, 0.08, 0.25), 0.5
#: Largest lag of the first trial, m, and of the others over what the lag before makes of their speed; m besides.
FIRST_LAG_M, LAG_GROWTH, LAG_SLACK_M = 0.02, 3.0, 2e-3
#: m: a loop that ends a trial further beside its goal does not hold the axis.
HELD_M = 2e-3
#: Shares of its speed with which the move that verifies is tried, largest first.
SHARES = (1.0, 0.7, 0.5, 0.35)
#: Reasons of a stop that a loop gives which does not fit its axis.
OF_THE_LOOP = ("lag", "resonance", "belt force", "torque", "speed", "position")
#: Its record.
MOVE = "own_move"


def try_out(machine: Machine, findings: Findings, model: Model) -> bool:
    """Let the loop that stands in the drive follow slow strokes, each faster than the one before; False where it cannot be used.

    What it showed is counted with from then on.   Raises what says more of the axis or the drive than of its loop.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    model : Model
        First model.
    """
    machine.closed = model, delay(findings)
    machine.cascade = None
    family = family_around(model)
    machine.friction = max(map(total_friction, family)), max(map(total_viscous, family))
    try:
        lag_s = _trials(machine, model)
    except (SafetyStop, Refused, DriveFault) as problem:
        if isinstance(problem, SafetyStop) and not (problem.reason in OF_THE_LOOP and stands(machine)):
            raise
        findings.remarks.append(
            f"the drive's own loop was not used: {problem}. Model and gains rest on the records at one place; type the gains in, then "
            "go on with `beltcomm friction` and `beltcomm verify`"
        )
        findings.reservations.append("the drive's own loop could not follow slow strokes")
        return False
    machine.loop_tried = True
    reaction_s = REACTION_PERIODS * machine.drive.capabilities.sample_period_s
    heaviest = max(one["cart.mass"] for one in family)
    accelerated, deceleration = (
        rigid_deceleration(machine.axis, mass, machine.envelope().torque_nm, SWING + 1.0).value_m_s2
        for mass in (model["cart.mass"], heaviest)
    )
    machine.brake_with(Braking(deceleration, LAG_GROWTH * lag_s + reaction_s, reaction_s, acceleration_m_s2=accelerated))
    machine.folder.journal(f"the drive's own loop lags by {1e3 * lag_s:.1f} ms; a stop brakes with {deceleration:.4g} m/s²")
    return True


def _trials(machine: Machine, model: Model) -> float:
    """The lag that the loop showed last, s.   Raises SafetyStop, Refused for a loop that does not hold the axis."""
    low, high = machine.envelope().window_m
    lag_s = math.inf
    for speed in TRIALS_M_S:
        at = machine.position_m
        forth = 1.0 if high - at > at - low else -1.0
        way = forth * min(TRIAL_M, max(high - at, at - low) - 2.0 * phases.END_MARGIN_M)
        if abs(way) < 0.5 * TRIAL_M:
            raise Refused(f"there is no room for strokes of {1e3 * TRIAL_M:.0f} mm from {machine.where(at)}")
        limits = phases.gentle_limits(machine, model, speed)
        limits = replace(limits, acceleration_m_s2=min(limits.acceleration_m_s2, 4.0 * speed**2 / TRIAL_M))
        limits = replace(limits, jerk_m_s3=20.0 * limits.acceleration_m_s2)
        most_m = FIRST_LAG_M if math.isinf(lag_s) else LAG_GROWTH * lag_s * speed + LAG_SLACK_M
        path = with_dwell(plan_trajectory(at, at + way, limits, machine.drive.capabilities.sample_period_s), TRIAL_REST_S)
        top, off = _follow(machine, path, most_m)
        lag_s = off / top
        if machine.stroking() == "position" and abs(machine.position_m - (at + way)) > HELD_M:
            raise Refused(
                f"the loop in the drive ends {1e3 * abs(machine.position_m - at - way):.1f} mm beside the goal of a slow stroke: it does "
                "not hold the axis"
            )
    return lag_s


def _follow(machine: Machine, path: Trajectory, most_m: float) -> tuple[float, float]:
    """Follow a path; its top speed, m/s, and how far the carriage was off it, m.   most_m : what is allowed of that."""
    kind, full = machine.stroking(), machine.envelope()
    rows: list[tuple[float, float]] = []
    reference, period = path.position_m, machine.drive.capabilities.sample_period_s
    begun: list[float] = []

    def watch(row: Row) -> None:
        if not begun:
            begun.append(row[0])
        asked = float(reference[min(round((row[0] - begun[0]) / period), len(reference) - 1)])
        place = machine.ratio * (row[3] - machine.origin_rad)
        rows.append((asked, place))
        if abs(asked - place) > most_m:
            raise SafetyStop(
                f"the loop in the drive is {1e3 * abs(asked - place):.1f} mm off its reference, {1e3 * most_m:.1f} mm were allowed; the "
                "axis was stopped; tune it with the maker's tool, or look for what blocks the carriage",
                "lag",
            )

    low, high = float(np.min(reference)) - most_m, float(np.max(reference)) + most_m
    window = max(low, full.window_m[0]), min(high, full.window_m[1])
    envelope = Envelope(window, full.speed_m_s, full.torque_nm, most_m if kind == "position" else None)
    machine.run(machine.follow(path, kind), envelope, watch)
    off = np.array(rows)
    return float(np.max(np.abs(path.velocity_m_s))), float(np.max(np.abs(off[:, 0] - off[:, 1])))


def verify_own(
    machine: Machine, findings: Findings, model: Model, cascade: Cascade, asked: Trajectory | None
) -> tuple[Verdict, Demand] | None:
    """Drive a move with the loop that stands in the drive; its error, and in place of a prediction what the design is predicted to have.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    model : Model
    cascade : Cascade
    asked : Trajectory or None
        The user's own move, or None for the standard one; None is returned where no share of its speed could be driven.
    """
    if machine.folder.finished(MOVE) is not None:
        machine.folder.withdraw(MOVE)
    standard = None if asked is not None else verification.standard_move(machine, model)
    if standard is not None and standard.remark:
        findings.remarks.append(standard.remark)
    for share in SHARES:
        path = standard.at(share, machine.drive.capabilities.sample_period_s) if standard is not None else asked
        assert path is not None
        try:
            return _verified(machine, findings, model, cascade, path), demand(path, model)
        except (SafetyStop, Refused) as problem:
            if isinstance(problem, SafetyStop) and not (problem.reason in OF_THE_LOOP and stands(machine)):
                raise
            findings.remarks.append(f"the move at {100 * share:.0f} % of its speed was not finished by the drive's own loop: {problem}")
            if standard is None:
                break
    return None


def _verified(machine: Machine, findings: Findings, model: Model, cascade: Cascade, path: Trajectory) -> Verdict:
    verification.refuse_broken(machine, model, path)
    phases.move_to(machine, float(path.position_m[0]), model)
    along = with_dwell(path, REST_S)
    beside = replace(along, position_m=along.position_m + machine.position_m - float(path.position_m[0]))
    sidecar = phases.sidecar(machine, "trajectory", held_out=True)
    recording = machine.record(MOVE, machine.follow(beside, "position"), phases.untuned_envelope(machine), sidecar)
    designed = predict_move(model, cascade, along, verification.in_drive(machine, delay(findings)))
    verdict = judge(recording, machine.ratio, designed)
    said = (
        f"driven with the gains that stand in the drive; with those of the design {mm(verdict.predicted.dynamic_m)} and "
        f"{mm(verdict.predicted.static_m)} are predicted at the motor"
    )
    return replace(verdict, reasons=(*verdict.reasons[:-1], said))
