"""The move that proves a design, driven and compared with its prediction; what the host sends along with its reference."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import Cascade
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.errors import Refused
from beltcomm.experiments import phases
from beltcomm.experiments.stops_out_of_move import (
    HOST_LOSS_BEYOND,
    StopsOutOfMove,
    allowed_lag_m,
    belt_force_limit_n,
    host_loss_limit_n,
    room_beyond_m,
    worst_stops,
)
from beltcomm.experiments.verification import StandardMove, in_drive, refuse_broken
from beltcomm.identify.led_gains import gain_factors
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import BELT_BEYOND
from beltcomm.model import Model
from beltcomm.quantities import mm
from beltcomm.rundata import calibration
from beltcomm.rundata.proof import LEARNT, move_name, proof
from beltcomm.rundata.store import as_in_drive, keep_led_gains, led_gains_of
from beltcomm.sending import Sending, Sent, grid_of, predict_sent, reference_for
from beltcomm.trajectory import Trajectory, with_dwell
from beltcomm.verify import (
    REST_S,
    Demand,
    Driven,
    PredictedMove,
    TrackingError,
    Verdict,
    demand,
    judge,
    predict_move,
    predict_range,
    tracking_error,
)

#: s: the range of a longer move is not predicted, it would take too long.
LONGEST_RANGED_S = 15.0
#: The first move with a led reference shows what the gains in the drive are: at this share of its speed, and by so much of the lead may the
#: axis be off, which gains that are known to some percent allow, or by what their calibration is not sure of.
LEARNING_SHARE, LEARNING_SLACK = 0.25, 0.1


def verify_move(
    machine: Machine,
    model: Model,
    cascade: Cascade,
    delay_s: float,
    trajectory: Trajectory,
    name: str = "move_1",
    payloads_kg: Sequence[float] = (),
    sending: Sending = "nothing",
    learnt: Array | None = None,
    agreed_n: float = 0.0,
) -> tuple[Verdict, Demand]:
    """Phase 7: run the move with the new gains and compare with its prediction.

    Parameters
    ----------
    machine : Machine
    model : Model
    cascade : Cascade
    delay_s : float, s
        Of the torque path.
    trajectory : Trajectory
        The move, at the carriage.
    name : str
        Of the record.
    payloads_kg : sequence of float
        Further ones that the design holds for, noted with the record, see :mod:`beltcomm.rundata.proof`.
    sending : Sending
        Way in which the host leads the move.
    learnt : ndarray (n,) or None, N m
        Torque that repetitions of the move have taught, sent along too; n: samples of the trajectory and its rest.
    agreed_n : float
        Belt force that a lost host may make beyond its limit, because somebody agreed to it, N.

    Raises
    ------
    Refused
        When it would break a limit.
    """
    refuse_broken(machine, model, trajectory)
    running = machine.write_cascade(cascade)
    clock_s = machine.session_time_s
    drive, whole = in_drive(machine, delay_s), with_dwell(trajectory, REST_S)
    taken = running
    if sending == "led":
        running = as_in_drive(machine.folder, running)
    sent = reference_for(model, running, whole, drive, sending, clock_s)
    grid = grid_of(sent.motor, drive)
    if learnt is not None:
        learnt = np.pad(learnt, (0, max(0, len(sent.motor.t_s) - len(learnt))))[: len(sent.motor.t_s)]
        along = learnt if sent.torque_nm is None else sent.torque_nm + learnt
        sent = replace(sent, torque_nm=along, demanded_nm=sent.demanded_nm + float(np.max(np.abs(learnt))))

    def predict(other: Model, stretch_m: float = 0.0) -> PredictedMove:
        return predict_sent(other, running, sent, drive, belt_stretch_m=stretch_m, time_s=clock_s)

    path = predict(model)
    _check_path(machine, path)
    _check_lead(sent, path)
    _check_along(machine, sent)
    _check_belt(machine, model, path, trajectory)
    lag = allowed_lag_m(model, predict, room_beyond_m(machine.envelope().window_m, trajectory.position_m))
    if sent.reference is not None and led_gains_of(machine.folder) is None:
        lag += max(LEARNING_SLACK, calibration.unsure(machine.folder)) * float(np.max(np.abs(sent.reference.lead_m)))
    setpoints = sent.motor if sent.reference is None else sent.reference.sent
    stops = worst_stops(machine, model, running, drive, setpoints, lag, sent.torque_nm)
    _check_stops(machine, stops, _swinging_limit_n(machine, model, trajectory), agreed_n)
    start = float(trajectory.position_m[0])
    if machine.folder.finished(name) is None and abs(machine.position_m - start) > 1e-4:
        top = float(np.max(np.abs(trajectory.velocity_m_s)))  # these gains are about to be driven at that speed, with more force
        phases.move_to(machine, start, model, max(top, phases.POSITIONING_SPEED_M_S))
    # Positioning ends a little beside its goal; a reference that begins elsewhere would be a step, and no part of the move.
    beside = replace(sent.motor, position_m=sent.motor.position_m + machine.position_m - start)
    led_by: str = "" if sent.led is None and sent.reference is None else sending
    led_by = LEARNT if learnt is not None else led_by
    noted = proof(cascade, trajectory, payloads_kg, led_by)
    sidecar = phases.sidecar(machine, "trajectory", held_out=True, controller=noted)
    motion = machine.follow(beside, "position", sent.torque_nm, None if sent.reference is None else sent.reference.lead_m)
    recording = machine.record(name, motion, replace(machine.envelope(), lag_m=lag), sidecar)

    if sent.reference is not None:
        ahead = grid.in_loop(sent.reference.lead_m) / machine.ratio
        if (shown := gain_factors(recording, ahead, taken, drive.structure, delay_s, calibration.unsure(machine.folder))) is not None:
            keep_led_gains(machine.folder, shown)

    def error(other: Model, stretch_m: float) -> TrackingError:
        return predict(other, stretch_m).error_for(machine.axis.targets)

    spread = predict_range(model, error) if sent.motor.duration_s <= LONGEST_RANGED_S else None
    verdict = judge(
        recording,
        machine.ratio,
        path,
        carriage_m=grid.in_loop(sent.carriage.position_m),
        predicted_range=spread,
        targets=machine.axis.targets,
    )
    if learnt is None:
        verdict = replace(verdict, driven=Driven(cascade_to_parameters(running), sending, clock_s))
    if (sent.torque_nm is not None and learnt is None) or sent.reference is not None:
        alone = predict_move(model, running, whole, drive, time_s=clock_s)
        verdict = replace(verdict, reasons=(*verdict.reasons, *_brought(sent, alone)))
    return verdict, demand(trajectory, model)


def learn_gains(
    machine: Machine, model: Model, cascade: Cascade, delay_s: float, standard: StandardMove, payloads_kg: Sequence[float]
) -> None:
    """A slow move with a led reference, which shows what the gains in the drive are; nothing where the run knows it.

    Parameters
    ----------
    machine : Machine
    model : Model
        For which it is predicted.
    cascade : Cascade
        That was written into the drive.
    delay_s : float, s
        Of the torque path.
    standard : StandardMove
    payloads_kg : sequence of float, kg
        Further ones that the design holds for.
    """
    if led_gains_of(machine.folder) is not None:
        return
    slow = standard.at(LEARNING_SHARE, machine.drive.capabilities.sample_period_s)
    name = move_name(machine.folder, proof(cascade, slow, payloads_kg, "led"))
    verify_move(machine, model, cascade, delay_s, slow, name, payloads_kg, "led")


def _brought(sent: Sent, alone: PredictedMove) -> list[str]:
    """In words, what was sent along, and what the same gains are predicted to reach without it."""
    if sent.reference is not None:
        return [
            f"the reference led the motor by up to {1e3 * float(np.max(np.abs(sent.reference.lead_m))):.3g} mm, the inverse of the drive's "
            f"loops; without, the axis is predicted to be off by {mm(alone.error.dynamic_m)}. Whoever drives it later must lead "
            "it too: beltcomm trajectory FILE --led RUN writes such a reference"
        ]
    most = 1e3 * float(np.max(np.abs(sent.torque_nm))) if sent.torque_nm is not None else 0.0
    if sent.led is None:
        without = alone.error
        return [
            f"up to {most:.3g} mN m were sent along with the reference; a controller that sends none is predicted to have "
            f"{mm(without.dynamic_m)} and {mm(without.static_m)} with these gains"
        ]
    without = tracking_error(alone.t_s, alone.reference_m, alone.cart_m)
    return [
        f"the motor led the carriage by up to {1e3 * sent.led.lead_m:.3g} mm, the stretch of the belt, and up to {most:.3g} mN m were sent "
        f"along; without, the carriage is predicted to be off by {mm(without.dynamic_m)} and {mm(without.static_m)}",
        f"friction of the carriage can hide up to {mm(sent.led.held_m)} of its place from the motor",
    ]


def _check_along(machine: Machine, sent: Sent) -> None:
    """Raise Refused when the torque sent along would take the move beyond the torque that axis and drive allow."""
    limit = machine.envelope().torque_nm
    if sent.torque_nm is not None and not sent.demanded_nm <= limit:
        most = float(np.max(np.abs(sent.torque_nm)))
        raise Refused(
            f"the move is refused: with the {most:.3g} N m that the model sends along, the motor torque would be "
            f"{sent.demanded_nm:.4g} N m, limit {limit:.4g} N m; slow the move down, look at the model's effects, "
            "or use --feedforward linear"
        )


def _check_lead(sent: Sent, path: PredictedMove) -> None:
    """Raise Refused when a led reference reaches a bound of the drive: then the axis does not follow it."""
    if sent.reference is not None and path.saturated:
        raise Refused(
            f"the move is refused: its reference leads the axis by up to {1e3 * float(np.max(np.abs(sent.reference.lead_m))):.0f} mm and "
            f"reaches {' and '.join(path.saturated)}, so that the axis would not follow it; slow the move down, raise that bound with the "
            "maker's tool, or drive it without (--feedforward none)"
        )


def _check_path(machine: Machine, path: PredictedMove) -> None:
    """Raise Refused when a loop is predicted to leave the travel, although its reference does not."""
    low, high = machine.envelope().window_m
    for where, places in (("motor", path.motor_m), ("carriage", path.cart_m)):
        if float(np.min(places)) < low or float(np.max(places)) > high:
            raise Refused(
                f"the move is refused: with these gains the {where} is predicted to go from {np.min(places):.4g} m to "
                f"{np.max(places):.4g} m, the travel is {low:g}..{high:g} m; slow the move down or design other gains"
            )


def _swinging_limit_n(machine: Machine, model: Model, trajectory: Trajectory) -> float:
    """Belt force beyond which a move is refused, in it and in a stop out of it, N."""
    return belt_force_limit_n(machine, model, float(np.max(np.abs(trajectory.velocity_m_s))), BELT_BEYOND)


def _check_belt(machine: Machine, model: Model, path: PredictedMove, trajectory: Trajectory) -> None:
    """Raise Refused when the belt is predicted to carry too much as it swings."""
    limit = _swinging_limit_n(machine, model, trajectory)
    if path.belt_force_n > limit:
        raise Refused(
            f"the move is refused: the belt is predicted to carry {path.belt_force_n:.1f} N as it swings, limit {limit:.1f} N "
            f"({BELT_BEYOND:g} times its {machine.axis.belt_force_limit_n:.3g} N and the carriage's friction); stretch the move "
            f"by {path.belt_force_n / limit:.2f}"
        )


def _check_stops(machine: Machine, stops: StopsOutOfMove, limit_n: float, agreed_n: float = 0.0) -> None:
    """Note what stops out of the move do to the belt; raise Refused when that is too much.

    ``limit_n`` bounds a stop that is asked for, ``agreed_n`` either, where somebody agreed to it.
    """
    stop, lost = stops.asked_for, stops.host_lost
    machine.folder.journal(f"a stop out of the move: {stop.belt_force_n:.0f} N in the belt and {1e3 * stop.way_m:.0f} mm at most")
    machine.folder.journal(
        f"PC or bus lost in the move: {lost.belt_force_n:.0f} N in the belt and {1e3 * lost.way_m:.0f} mm to standstill at most"
    )
    low, high = machine.envelope().window_m
    if lost.low_m < low or lost.high_m > high:
        raise Refused(
            f"the move is refused: should the PC or the bus be lost in it, the carriage is predicted to go from {lost.low_m:.4g} m to "
            f"{lost.high_m:.4g} m, the travel is {low:g}..{high:g} m; slow the move down, or end it further from the end of the travel"
        )
    limit = max(limit_n, agreed_n)
    if stop.belt_force_n > limit and not machine.over_belt:
        raise Refused(
            f"the move is refused: the belt is predicted to carry {stop.belt_force_n:.0f} N in a stop out of it, limit {limit:.0f} N; "
            f"stretch the move by {math.sqrt(stop.belt_force_n / limit):.2f}, or design other gains"
        )
    limit = max(host_loss_limit_n(machine.axis), agreed_n)
    of = f" ({HOST_LOSS_BEYOND:g} times its {machine.axis.belt_force_limit_n:.3g} N)" if limit > agreed_n else ""
    if lost.belt_force_n > limit and not machine.over_belt:
        raise Refused(
            f"the move is refused: should the PC or the bus be lost in it, the belt is predicted to carry {lost.belt_force_n:.0f} N until "
            f"the drive has stopped, limit {limit:.0f} N{of}; stretch the move "
            f"by {math.sqrt(lost.belt_force_n / limit):.2f}"
        )
