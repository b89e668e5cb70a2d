"""The closed-loop measurements of chapter 5 and figure 6.10 on the virtual drive: prefilter, feedforward, mass, anti-windup."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, CascadeStructure, Prefilter, PrefilterKind
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.feedforward import FeedforwardKind, feedforward_from
from beltcomm.design.loops import closed_loop_poles
from beltcomm.design.thesis import thesis_design
from beltcomm.drive import Drive, Limits, Motion, Row, open_drive
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.errors import SafetyStop
from beltcomm.model import Model, load_plant
from beltcomm.simulate.plant import SimulatedPlant
from beltcomm.thesis.designs import thesis_plants
from beltcomm.trajectory import Trajectory, at_rest, join, plan_trajectory
from beltcomm.verify import Loop, TrackingError, demand, predict_move, tracking_error

#: Rigs of tables A.4 and A.5: 11.2 kg added, and none.
RIGS: Mapping[str, str] = {"g_a": "11.2 kg", "g_b": "0 kg"}
#: Limits of the moves, tables A.8 and A.9.
T_A = TrajectoryLimits(jerk_m_s3=40.0, acceleration_m_s2=45.0, speed_m_s=5.0)
T_B = TrajectoryLimits(jerk_m_s3=50.0, acceleration_m_s2=50.0, speed_m_s=5.0)
FROM_M, TO_M, REST_S, AFTER_S = 0.05, 0.55, 0.1, 1.7
PERIOD_S, DELAY_S, COUNTS, SEED = 1e-3, 1e-3, 65536, 1
#: N m: the motor's peak; and limits at which the anti-windup is shown: reached for a short time, and the axis's driving torque.
PEAK_NM, TIGHT_NM = 3.1, (1.6, 1.24)
FORWARD: tuple[FeedforwardKind, ...] = ("none", "linear", "nonlinear")
#: m, distance from the reference at which a loop is stopped; without any feedforward the axis trails by speed over K_PP, 0.22 m.
LOST_M = 0.3
#: Published gains C_A (notch) and C_B (Butterworth) of tables A.6 and A.7; K_P N m s/rad, K_I N m/rad, K_PP 1/s.
PUBLISHED: Mapping[PrefilterKind, tuple[float, float, float]] = {"notch": (0.08, 1.69, 10.91), "butterworth": (0.12, 1.39, 6.29)}


def _nothing() -> Array:
    """Of a move that was stopped."""
    return np.zeros(0)


@dataclass(frozen=True)
class SimulatedMove:
    """One move.

    Attributes
    ----------
    figure : str
        Of the source.
    motor : TrackingError
        Error as the drive measured it; cart : as the same loop is predicted to leave it there.
    belt_force_n : float
        Predicted.
    torque_nm : float
        Largest measured.
    stopped : str
        In words, where the drive gave up; errors are then nan.
    reference_m, position_m, cart_m, speed_m_s, drive_torque_nm : ndarray (n,)
        Over t_s: reference, motor over i_t as measured, carriage as predicted, speed of the motor as the drive told it, torque.
    """

    figure: str
    rig: str
    name: str
    motor: TrackingError
    cart: TrackingError
    belt_force_n: float
    torque_nm: float
    t_s: Array
    error_m: Array
    stopped: str = ""
    reference_m: Array = field(default_factory=_nothing)
    position_m: Array = field(default_factory=_nothing)
    cart_m: Array = field(default_factory=_nothing)
    speed_m_s: Array = field(default_factory=_nothing)
    drive_torque_nm: Array = field(default_factory=_nothing)


@dataclass(frozen=True)
class Limited:
    """A move with the torque cut off.

    Attributes
    ----------
    error : TrackingError, at the motor
    error_m : ndarray (n,), m
    asked_nm : ndarray
        Of the controller, (n,), N m.
    """

    error: TrackingError
    t_s: Array
    error_m: Array
    asked_nm: Array


@dataclass(frozen=True)
class ClosedLoopStudy:
    """Comparison of the closed loops of the source.

    Attributes
    ----------
    runs : tuple of SimulatedMove
        In the order of the figures.
    unstable : dict of str to float
        Largest |z| of the poles with the filters removed, by prefilter.
    windup : dict of float to tuple of Limited
        Figure 6.10, simulated: by torque limit, the move without and with conditional integration.
    demands : dict of str to float
        Feed force of T_A and T_B on g_a, N.
    """

    runs: tuple[SimulatedMove, ...]
    unstable: Mapping[str, float]
    windup: Mapping[float, tuple[Limited, Limited]]
    demands: Mapping[str, float]


def compare() -> ClosedLoopStudy:
    """All moves of chapter 5, each on a virtual drive behind its bus."""
    runs: list[SimulatedMove] = []
    structures: dict[str, CascadeStructure] = {}
    for rig in RIGS:
        model = load_plant(rig).model
        with open_drive(f"virtual:{rig}", {"seed": SEED, "start_position": FROM_M}) as drive:
            structure = structures[rig] = drive.capabilities.structure
            wanted: list[tuple[str, str, Cascade]] = []
            if rig == "g_a":
                for kind in ("none", "notch", "butterworth"):
                    wanted.append(("5.1", f"prefilter {kind}", _with_feedforward(rig, model, structure, gains(rig, kind), "nonlinear")))
                bare = replace(wanted[-1][2], prefilter=Prefilter())
                wanted.append(("5.1", "Butterworth's gains, filter removed", bare))
            figure = "5.2" if rig == "g_a" else "5.3"
            for forward in FORWARD:
                cascade = _with_feedforward(rig, model, structure, gains(rig, "butterworth"), forward)
                wanted.append((figure, f"feedforward {forward}", cascade))
                if forward == "none":  # the source does not say which of the two it means
                    speed = replace(cascade, feedforward=replace(cascade.feedforward, velocity=1.0))
                    wanted.append((figure, "feedforward of the velocity alone", speed))
            ours = replace(wanted[-1][2], filter_reference=True)
            wanted.append(("5.4", "nonlinear, reference behind the same lag", ours))
            runs += [_one(drive, rig, model, figure, name, cascade) for figure, name, cascade in wanted]
    model = load_plant("g_a").model
    moved = {name: plan_trajectory(FROM_M, TO_M, limits, PERIOD_S) for name, limits in (("T_A", T_A), ("T_B", T_B))}
    unstable = {
        kind: float(np.max(np.abs(closed_loop_poles(_design_plant("g_a"), replace(gains("g_a", kind), prefilter=Prefilter()), PERIOD_S))))
        for kind in ("notch", "butterworth")
    }
    cascade = _with_feedforward("g_a", model, structures["g_a"], gains("g_a", "butterworth"), "nonlinear")
    return ClosedLoopStudy(
        tuple(runs),
        unstable,
        {
            most: (_saturated_move(model, cascade, most, windup=True), _saturated_move(model, cascade, most, windup=False))
            for most in TIGHT_NM
        },
        {name: demand(path, model).feed_force_n for name, path in moved.items()},
    )


def gains(rig: str, kind: PrefilterKind) -> Cascade:
    """Published gains with their prefilter; without one those that solve the same conditions (5.1).   The plain cascade of the source.

    Parameters
    ----------
    rig : str
        Name of the plant.
    kind : PrefilterKind
    """
    solved = thesis_design(_design_plant(rig), kind).cascade
    if kind in PUBLISHED and rig == "g_a":
        kp, ki, kpp = PUBLISHED[kind]
        solved = replace(solved, kp_nm_s_rad=kp, ki_nm_rad=ki, kpp_1_s=kpp)
    return replace(solved, filter_reference=False)


def _design_plant(rig: str) -> DesignPlant:
    """The rig as the source designed for it: with the damping that its frequency response shows around standstill."""
    return next(plant for plant in thesis_plants() if plant.name == rig.upper())


def _apparent_damping(rig: str) -> float:
    """i_t² (d_m + d_c) of that plant, N m s/rad: what the linear feedforward takes for friction."""
    plant = _design_plant(rig)
    return plant.motor_damping_nm_s_rad + plant.transmission_m_rad**2 * plant.cart_damping_ns_m


def _with_feedforward(rig: str, model: Model, structure: CascadeStructure, cascade: Cascade, kind: FeedforwardKind) -> Cascade:
    """The cascade with a feedforward from the rig's own numbers.   Advanced by nothing: the source's is not."""
    ratio = model["transmission.ratio"]
    forward = feedforward_from(
        structure,
        kind,
        inertia_kg_m2=model["motor.inertia"] + ratio**2 * model["cart.mass"],
        viscous_nm_s_rad=model["viscous.damping"],
        coulomb_nm=model["coulomb.level"] + ratio * model["cart_friction.level"],
        apparent_viscous_nm_s_rad=_apparent_damping(rig),
    )
    return replace(cascade, feedforward=replace(forward, advance_s=0.0))


def _one(drive: Drive, rig: str, model: Model, figure: str, name: str, cascade: Cascade) -> SimulatedMove:
    """The move with limits T_A, and back; the way back is not judged."""
    ratio = model["transmission.ratio"]
    drive.write({key: value for key, value in cascade_to_parameters(cascade).items() if key in drive.backup()})
    here = ratio * drive.read(["position_rad"])["position_rad"]
    path = _with_rests(plan_trajectory(here, here + (TO_M - FROM_M), T_A, PERIOD_S))
    expected = predict_move(model, cascade, path, Loop(drive.capabilities.structure, DELAY_S, PEAK_NM, COUNTS))
    cart = tracking_error(path.t_s, path.position_m, expected.cart_m)
    rows: list[Row] = []
    stopped = ""
    try:
        drive.record(_motion(path, ratio), _limits(ratio), rows.append)
    except SafetyStop as stop:
        stopped = str(stop).split(";")[0]
    table = np.array(rows)
    t_s, torque, position, reference = table[:, 0] - table[0, 0], table[:, 1], ratio * table[:, 3], ratio * table[:, 5]
    largest = float(np.max(np.abs(torque)))
    if stopped:
        nothing = TrackingError(math.nan, math.nan)
        return SimulatedMove(figure, rig, name, nothing, nothing, math.nan, largest, t_s, reference - position, stopped)
    motor = tracking_error(t_s, reference, position)
    # back to where it began, by a loop that can: the next one starts from the same place
    safe = _with_feedforward(rig, model, drive.capabilities.structure, gains(rig, "butterworth"), "nonlinear")
    drive.write({key: value for key, value in cascade_to_parameters(safe).items() if key in drive.backup()})
    at = ratio * drive.read(["position_rad"])["position_rad"]
    drive.record(_motion(_with_rests(plan_trajectory(at, here, T_A, PERIOD_S)), ratio), _limits(ratio), lambda _row: None)
    beside = np.interp(t_s, expected.t_s, expected.cart_m)
    shown = (reference, position, beside, ratio * table[:, 4], torque)
    return SimulatedMove(figure, rig, name, motor, cart, expected.belt_force_n, largest, t_s, reference - position, "", *shown)


def _with_rests(path: Trajectory) -> Trajectory:
    """A move with rest before and after it."""
    before, after = at_rest(float(path.position_m[0]), REST_S, PERIOD_S), at_rest(float(path.position_m[-1]), AFTER_S, PERIOD_S)
    return join((before, path, after))


def _motion(path: Trajectory, ratio: float) -> Motion:
    """Motion for the drive's position loop."""
    return Motion("position", PERIOD_S, path.position_m / ratio, path.velocity_m_s / ratio, np.zeros(len(path.t_s)))


def _limits(ratio: float) -> Limits:
    """Limits of the virtual axis."""
    return Limits(-0.05 / ratio, 0.75 / ratio, 3.0 / ratio, PEAK_NM, lag_rad=LOST_M / ratio, ratio_m_rad=ratio)


def _saturated_move(model: Model, cascade: Cascade, most_nm: float, windup: bool) -> Limited:
    """T_B with the torque cut off, simulated.

    ``windup``: the controller does not know the limit, so that its integrator goes on (6.25); else it is set to meet the limit (6.26).
    """
    path = _with_rests(plan_trajectory(FROM_M, TO_M, T_B, PERIOD_S))
    structure = CascadeStructure("simulated", PERIOD_S)
    known = 1e6 if windup else most_nm
    cut = CutOff(model, most_nm)
    moved = predict_move(model, cascade, path, Loop(structure, DELAY_S, known, COUNTS), plant=cut)
    error = tracking_error(path.t_s, path.position_m, moved.motor_m)
    return Limited(error, path.t_s, path.position_m - moved.motor_m, moved.torque_nm)


class CutOff(SimulatedPlant):
    """A plant behind an actuator that gives no more than so much torque, N m."""

    def __init__(self, model: Model, most_nm: float, start_m: float = FROM_M) -> None:
        super().__init__(model, start_m)
        self._most_nm = most_nm

    def step(self, torque_nm: float, duration_s: float) -> None:
        """Step of the plant, with the torque cut off."""
        super().step(min(max(torque_nm, -self._most_nm), self._most_nm), duration_s)


def lines(study: ClosedLoopStudy) -> list[str]:
    """The table and what it says."""
    said = ["0.5 m with the limits T_A on the virtual drive; errors in mm: motor as the drive measured it, cart as predicted beside it"]
    said.append(f"{'figure':7} {'mass':8} {'':42} {'motor dyn.':>10} {'static':>8} {'cart dyn.':>9} {'torque':>9} {'belt':>6}")
    for run in study.runs:
        head = f"{run.figure:7} {RIGS[run.rig]:8} {run.name:42}"
        if run.stopped:
            said.append(f"{head} stopped: {run.stopped}")
            continue
        said.append(
            f"{head} {1e3 * run.motor.dynamic_m:10.3f} {1e3 * run.motor.static_m:8.3f} {1e3 * run.cart.dynamic_m:9.3f} "
            f"{run.torque_nm:5.2f} N m {run.belt_force_n:4.0f} N"
        )
    removed = ", ".join(f"{kind} {size:.3f}" for kind, size in study.unstable.items())
    said += [
        f"Filter removed from a filtered design: largest |z| of the loop's poles {removed}; above 1 it is unstable (source: unstable)",
        *(
            f"6.10    T_B with the torque cut off at {most} N m, simulated, dynamic and static error in mm: without anti-windup "
            f"{1e3 * off.error.dynamic_m:.2f} and {1e3 * off.error.static_m:.3f}, with it {1e3 * on.error.dynamic_m:.2f} and "
            f"{1e3 * on.error.static_m:.3f}"
            for most, (off, on) in study.windup.items()
        ),
        f"Feed force on g_a: T_A {study.demands['T_A']:.1f} N, T_B {study.demands['T_B']:.1f} N; the axis bears 100 N, T_B is simulated",
        *_findings(study),
    ]
    return said


def _findings(study: ClosedLoopStudy) -> list[str]:
    """Findings of the source that come out, and those that do not."""
    by = {(run.figure, run.rig, run.name): run for run in study.runs}
    none, filtered = by["5.1", "g_a", "prefilter none"], by["5.1", "g_a", "prefilter butterworth"]
    plain, linear = by["5.2", "g_a", "feedforward of the velocity alone"], by["5.2", "g_a", "feedforward linear"]
    nothing = by["5.2", "g_a", "feedforward none"]
    heavy, light = (by[figure, rig, "feedforward nonlinear"] for figure, rig in (("5.2", "g_a"), ("5.3", "g_b")))
    ours = {rig: by["5.4", rig, "nonlinear, reference behind the same lag"] for rig in RIGS}
    crossing = float(np.min(linear.error_m)) < -1e-4 and float(np.max(linear.error_m)) > 1e-4
    below = all(run.motor.dynamic_m < 1e-3 for run in (heavy, light))
    return [
        f"5.1: without a prefilter the dynamic error is {none.motor.dynamic_m / filtered.motor.dynamic_m:.1f} times as large "
        "(source: significantly larger)",
        f"5.2: nothing, velocity alone, linear, nonlinear {1e3 * nothing.motor.dynamic_m:.0f}, {1e3 * plain.motor.dynamic_m:.1f}, "
        f"{1e3 * linear.motor.dynamic_m:.1f}, {1e3 * heavy.motor.dynamic_m:.2f} mm; the error of the linear one changes its sign: "
        f"{'yes' if crossing else 'no'} (source: yes; worst without, best nonlinear)",
        f"5.4: below 1 mm with both masses (source): {'yes' if below else 'no'}, {1e3 * heavy.motor.dynamic_m:.2f} and "
        f"{1e3 * light.motor.dynamic_m:.2f} mm: the reference is compared with a velocity that lags by T_R + T/2;",
        f"     with the reference behind the same lag {1e3 * ours['g_a'].motor.dynamic_m:.2f} and "
        f"{1e3 * ours['g_b'].motor.dynamic_m:.2f} mm at the motor; at the cart the belt adds its stretch",
    ]
