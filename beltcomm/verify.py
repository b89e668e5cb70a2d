"""Prediction against a new recording: how well does the tuned axis follow a move, and does the model know it beforehand?"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis.entries import NO_TARGETS, AxisTargets
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.errors import DataError, Refused, UsageError
from beltcomm.fit.uncertainty.draws import machines_like
from beltcomm.model import Model
from beltcomm.quantities import mm
from beltcomm.recording import Recording
from beltcomm.simulate.loop import LoopDrive, SetpointGrid, close_loop
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.simulate.stopping import total_friction, total_inertia, total_viscous
from beltcomm.trajectory import Trajectory

#: Machines in the range of a prediction: among 40 alike one more lies between the least and the largest 39 in 41 times (95 %); share of
#: them that must be machines.
RANGE_DRAWS, LEAST_DRAWN = 39, 0.5
#: A drive does as predicted when its error is within this factor of the predicted one, and this many m.
AS_PREDICTED, SLACK_M = 1.5, 2e-4
#: s after the end of the reference motion until which the settled error is read.
STATIC_TO_S = 1.5
#: s of rest after the verification move in which the settled error is read.
REST_S = 1.6


@dataclass(frozen=True)
class Demand:
    """Demand of a move on the axis, rigid carriage.

    Attributes
    ----------
    speed_m_s, acceleration_m_s2 : float
        Largest values.
    feed_force_n : float
        m_c (a + g sin tilt), the net force of data sheets, which list guide friction apart.
    torque_nm : float, motor shaft
        With inertia and all friction (4.15).
    """

    speed_m_s: float
    acceleration_m_s2: float
    feed_force_n: float
    torque_nm: float


@dataclass(frozen=True)
class TrackingError:
    """Tracking error of a move.

    Attributes
    ----------
    dynamic_m : float
        Following error, the largest |reference - position| while the reference moves.
    static_m : float
        The largest once settled.
    overshoot_m : float
        How far the position went beyond its goal, or beyond its rest where that lies past the goal.
    settling_s : float or None
        From the end of the reference until the error stays within the settled target; None where it never does.
    """

    dynamic_m: float
    static_m: float
    overshoot_m: float = 0.0
    settling_s: float | None = None


@dataclass(frozen=True)
class Driven:
    """Gains and setpoints that a move was driven and predicted with.

    Attributes
    ----------
    gains : dict of str to float
        As they ran in the drive, which holds them to its own digits.
    sending : str
        What the host sent along.
    time_s : float
        Session's clock at its start.
    """

    gains: Mapping[str, float]
    sending: str
    time_s: float


@dataclass(frozen=True)
class Verdict:
    """Measured against predicted, at the motor and, where something measures it, at the carriage; with reasons in words.

    Attributes
    ----------
    predicted_range : tuple of TrackingError or None
        Smallest and largest error at the motor for what is not known beforehand, see :func:`predict_range`.
    targets : AxisTargets
        That it was judged by.
    driven : Driven or None
        What was driven; None where no prediction tells it.
    """

    passed: bool
    measured: TrackingError
    predicted: TrackingError
    measured_cart: TrackingError | None
    predicted_cart: TrackingError
    reasons: tuple[str, ...]
    predicted_range: tuple[TrackingError, TrackingError] | None = None
    targets: AxisTargets = NO_TARGETS
    driven: Driven | None = None


@dataclass(frozen=True)
class Loop:
    """Parts that a drive adds to the controller in it.

    Attributes
    ----------
    delay_s : float
        From torque setpoint to acting torque.
    """

    structure: CascadeStructure
    delay_s: float
    torque_limit_nm: float
    counts_per_rev: int

    @property
    def simulated(self) -> LoopDrive:
        """The drive as a simulation has it."""
        own = self.structure
        return LoopDrive(own.period_s, self.delay_s, self.torque_limit_nm, self.counts_per_rev, own.dead_zone_rad, own.output_limit_rad_s)


@dataclass(frozen=True)
class PredictedMove:
    """Simulated closed loop at the samples of its reference: motor position over i_t and carriage, m; torque N m; largest belt force, N.

    Attributes
    ----------
    reference_m : ndarray
        That the loop had at these samples.
    read_m : ndarray
        Motor position as the drive reads it, in counts.
    saturated : tuple of str
        In words, which bounds of the drive were reached.
    """

    t_s: Array
    reference_m: Array
    motor_m: Array
    read_m: Array
    cart_m: Array
    torque_nm: Array
    belt_force_n: float
    saturated: tuple[str, ...] = ()

    @property
    def error(self) -> TrackingError:
        """At the motor."""
        return self.error_for(NO_TARGETS)

    def error_for(self, targets: AxisTargets) -> TrackingError:
        """Tracking error at the motor, as it is read.

        Parameters
        ----------
        targets : AxisTargets
            That say from when on a move counts as settled.

        Returns
        -------
        TrackingError
            In m at the carriage.
        """
        return tracking_error(self.t_s, self.reference_m, self.read_m, targets)


def demand(trajectory: Trajectory, model: Model) -> Demand:
    """Largest speed, acceleration, feed force and motor torque of a move.   Source: (4.15), (2.22).

    Parameters
    ----------
    trajectory : Trajectory
        Of the carriage.
    model : Model
        With a carriage.

    Returns
    -------
    Demand
        Carriage side; its torque at the motor shaft.
    """
    ratio, mass = model["transmission.ratio"], model["cart.mass"]
    a, v = trajectory.acceleration_m_s2, trajectory.velocity_m_s
    gravity = mass * GRAVITY_M_S2 * math.sin(model.get("tilt.angle"))
    viscous, coulomb, inertia = total_viscous(model), total_friction(model), total_inertia(model)
    torque = inertia * a / ratio + viscous * v / ratio + coulomb * np.sign(v) + ratio * gravity + model.get("constant_offset.torque")
    return Demand(
        float(np.max(np.abs(v))),
        float(np.max(np.abs(a))),
        float(np.max(np.abs(mass * a + gravity))),
        float(np.max(np.abs(torque))),
    )


def predict_move(
    model: Model,
    cascade: Cascade,
    trajectory: Trajectory,
    drive: Loop,
    *,
    belt_stretch_m: float = 0.0,
    extra_torque_nm: Array | None = None,
    time_s: float = 0.0,
    plant: SimulatedPlant | None = None,
) -> PredictedMove:
    """Simulate the drive's own cascade on the model along a reference motion, which the drive interpolates for its loop.

    The encoder counts as the drive sees them, and setpoints are whole counts; the measurement noise of the torque signal does not enter
    the loop.

    Parameters
    ----------
    model : Model
    cascade : Cascade
    trajectory : Trajectory
        At whatever period it is sent.
    drive : Loop
        Loop of the drive, with dead time and limits.
    belt_stretch_m : float
        At the start.
    extra_torque_nm : ndarray (n,) or None
        Sent along with the reference and added to the drive's torque, held until the next comes.
    time_s : float
        Session's clock.
    plant : SimulatedPlant or None
        That the loop is closed on, not the model's.
    """
    ratio, structure = model["transmission.ratio"], drive.structure
    start_m = float(trajectory.position_m[0])
    plant = plant or SimulatedPlant(model, start_m, belt_stretch_m=belt_stretch_m)
    plant.time_s = time_s
    sent = SetpointGrid(trajectory.sample_period_s, structure.period_s, len(trajectory.t_s))
    step = 2.0 * math.pi / drive.counts_per_rev
    asked = (start_m / ratio) + np.round((trajectory.position_m - start_m) / (ratio * step)) * step  # a setpoint is a count as well
    reference, speed = sent.on_loop(asked), sent.on_loop(trajectory.velocity_m_s / ratio)
    added = np.zeros(len(reference)) if extra_torque_nm is None else sent.zero_order_hold(extra_torque_nm)
    run = close_loop(plant, cascade, drive.simulated, "position", reference, speed, added)
    read = np.floor(run.position_rad / step + 0.5) * step
    error = reference - (reference[0] + read)
    fastest = cascade.kpp_1_s * max(float(np.abs(error).max()) - structure.dead_zone_rad, 0.0)
    saturated = []
    if float(np.max(np.abs(run.asked_nm))) >= drive.torque_limit_nm:
        saturated.append(f"the torque limit of {drive.torque_limit_nm:.3g} N m")
    if fastest >= structure.output_limit_rad_s * (1.0 - 1e-9):
        saturated.append(f"the bound of the position controller's output, {ratio * structure.output_limit_rad_s:.3g} m/s")
    t_s = trajectory.sample_period_s * np.arange(len(trajectory.t_s), dtype=np.float64)
    motor, seen = (start_m + ratio * sent.at_samples(angle) for angle in (run.position_rad, read))
    cart, known = start_m + sent.at_samples(run.cart_m), sent.in_loop(ratio * asked)
    return PredictedMove(t_s, known, motor, seen, cart, sent.latest(run.asked_nm), float(run.belt_force_n.max()), tuple(saturated))


def predict_range(model: Model, predict: Callable[[Model, float], TrackingError]) -> tuple[TrackingError, TrackingError] | None:
    """Smallest and largest error over the model and ``RANGE_DRAWS`` machines it may stand for; None where it stands for hardly any.

    Machines are drawn by :func:`beltcomm.fit.uncertainty.draws.machines_like`, and the belt's stretch at the start from what friction can
    hold, min(F_c, τ_c/i_t)/c either way: the move before leaves it so, and no motor encoder sees it.

    Parameters
    ----------
    model : Model
    predict : callable
        Of a model and a stretch.
    """
    random = np.random.default_rng(0)
    held = _held_stretch_m(model)
    errors = []
    for drawn in machines_like(model, RANGE_DRAWS, seed=0):
        stretch = float(random.uniform(-held, held))
        # A law that hardly anything is known of may hold nothing at some place, or let the carriage fly off.
        with suppress(ZeroDivisionError, UsageError, Refused):
            errors.append(predict(drawn, stretch))
    if len(errors) < LEAST_DRAWN * RANGE_DRAWS:
        return None
    with suppress(ZeroDivisionError, UsageError, Refused):  # what is predicted lies within its own range: draws may all miss it
        errors.append(predict(model, 0.0))
    dynamic, static = [e.dynamic_m for e in errors], [e.static_m for e in errors]
    return TrackingError(min(dynamic), min(static)), TrackingError(max(dynamic), max(static))


def _held_stretch_m(model: Model) -> float:
    """Largest stretch of the belt that friction holds at rest, m; 0 for a model without a belt."""
    if "belt_stiffness.stiffness" in model.parameters:
        stiffness = model["belt_stiffness.stiffness"]
    else:
        law = next((e for e in ("belt_spans", "belt_sections") if e in model.effects), None)
        if law is None:
            return 0.0
        stiffness = 2.0 * model[f"{law}.specific_stiffness"] / model[f"{law}.pulley_distance"]  # softest where both strands are equal
    return min(model.get("cart_friction.level"), model.get("coulomb.level") / model["transmission.ratio"]) / stiffness


def tracking_error(t_s: Array, reference_m: Array, position_m: Array, targets: AxisTargets = NO_TARGETS) -> TrackingError:
    """Errors of one move, with its overshoot and settling time by the ``targets``.

    The reference moves from its first to its last change.

    Parameters
    ----------
    t_s : ndarray (n,), s
        Time stamps.
    reference_m : ndarray (n,), m
        Of motor or carriage.
    position_m : ndarray (n,), m
        Measured or predicted.
    targets : AxisTargets
        With the settling time.

    Raises
    ------
    DataError
        When the record ends too early for the settled error.
    """
    moving = np.flatnonzero(np.diff(reference_m) != 0.0)
    if len(moving) == 0:
        raise DataError("the reference does not move in this record, so there is no tracking error; record a move")
    error = np.abs(reference_m - position_m)
    first, last = moving[0], moving[-1] + 1
    end, after_s = t_s[last], targets.after_s
    still = (t_s >= end + after_s) & (t_s <= end + STATIC_TO_S)
    if t_s[-1] < end + STATIC_TO_S - 2e-3 or not np.any(still):
        raise DataError(f"the record ends {t_s[-1] - end:.2f} s after the move; the settled error is read until {STATIC_TO_S} s after it")
    ahead = math.copysign(1.0, reference_m[last] - reference_m[last - 1])  # by the last step: a move there and back ends where it began
    past = ahead * (position_m - reference_m)
    beyond = float(np.max(past[last:])) - max(0.0, float(np.median(past[still])))  # what it rests past its goal is the settled error
    outside = np.flatnonzero(error[last:] > targets.settled_m)
    settled = 0.0 if not len(outside) else None if outside[-1] + 1 >= len(t_s) - last else float(t_s[last + outside[-1] + 1] - end)
    return TrackingError(float(np.max(error[first : last + 1])), float(np.max(error[still])), max(0.0, beyond), settled)


def _against(measured_m: float, expected_m: float) -> str:
    """The measured following error beside the predicted one, in words."""
    share = measured_m / expected_m - 1.0
    if abs(share) < 0.005:
        how = "as much as"
    elif share < 1.0:
        how = f"{100 * abs(share):.0f} % {'more' if share > 0.0 else 'less'} than"
    else:
        how = f"{measured_m / expected_m:.3g} times"
    return f"the measured following error at the motor is {how} the predicted {1e3 * expected_m:.3g} mm"


def judge(
    recording: Recording,
    ratio: float,
    predicted: PredictedMove,
    *,
    carriage_m: Array | None = None,
    predicted_range: tuple[TrackingError, TrackingError] | None = None,
    targets: AxisTargets = NO_TARGETS,
) -> Verdict:
    """Measured tracking against the prediction and the targets, which count at the carriage as predicted where nothing measures there.

    Parameters
    ----------
    recording : Recording
    ratio : float
        i_t, m/rad.
    predicted : PredictedMove
        The same move.
    carriage_m : ndarray (n,) or None
        Where the carriage should be at the samples of the prediction, m, when that is not the motor's reference.
    predicted_range : tuple of TrackingError or None
        Smallest and largest error; None where it is not known.
    targets : AxisTargets

    Raises
    ------
    DataError
        When the recording has no reference position.
    """
    if recording.reference_position is None:
        raise DataError(f"recording {recording.name!r} has no reference_position_rad; tracking cannot be judged")
    reference = ratio * recording.reference_position
    measured = tracking_error(recording.t_s, reference, ratio * recording.position, targets)
    expected = predicted.error_for(targets)
    wanted = predicted.reference_m if carriage_m is None else carriage_m
    expected_cart = tracking_error(predicted.t_s, wanted, predicted.cart_m, targets)
    measured_cart = None
    if recording.cart_position_m is not None:
        followed = reference + np.interp(recording.t_s - recording.t_s[0], predicted.t_s, wanted - predicted.reference_m)
        offset = followed[0] - recording.cart_position_m[0]
        measured_cart = tracking_error(recording.t_s, followed, recording.cart_position_m + offset, targets)
    judged = {"motor": measured, "carriage": measured_cart or expected_cart}
    reasons, passed = [], True
    for place in targets.places:
        error, how = judged[place], ", predicted" if place == "carriage" and measured_cart is None else ""
        for what, value, target in (
            ("following error", error.dynamic_m, targets.following_m),
            (f"position error after {targets.after_s:g} s", error.static_m, targets.settled_m),
        ):
            passed &= value <= target
            word = "meets" if value <= target else "misses"
            reasons.append(f"{what} at the {place}{how}: {mm(value)}, {word} the target of {mm(target)}")
    if predicted.saturated:
        reasons.append(f"the controller reaches {' and '.join(predicted.saturated)}")
    reasons.append(_against(measured.dynamic_m, expected.dynamic_m))
    return Verdict(passed, measured, expected, measured_cart, expected_cart, tuple(reasons), predicted_range, targets)
