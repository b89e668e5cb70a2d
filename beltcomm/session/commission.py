"""The whole sequence: connect, check, excite, close a cautious loop, measure, fit, design, verify, keep or restore."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis_entries import TrajectoryLimits
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.cascade import DesignResult
from beltcomm.design.cautious import cautious_cascade
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.feedforward import FeedforwardKind
from beltcomm.design.specification import Infeasible, Specification
from beltcomm.errors import DataError, Refused
from beltcomm.identify.dead_time import DeadTime
from beltcomm.identify.final import FinalModel, final_model
from beltcomm.identify.friction import FrictionFit
from beltcomm.identify.magnitude_fit import MagnitudeFit, Solver
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.session import analyse, phases
from beltcomm.session.machine import Machine
from beltcomm.sidecar import Sidecar
from beltcomm.trajectory import Trajectory, plan_trajectory
from beltcomm.verify import DYNAMIC_TARGET_M, Demand, Verdict, demand, judge, predict_move, tracking_error

Apply = Literal["keep", "restore", "save"]

#: s of machine time per frequency response: rest, one run-in period, three to four measured ones.
RESPONSE_S = 7.0
#: Uncertainty of mass and stiffness that the first loop must bear: as much as the drive's structure allows.
UNCERTAINTIES = (0.3, 0.15, 0.05)
#: Where along the travel the other frequency responses are taken, as shares of it.
PLACES = (0.12, 0.5, 0.88)
#: m: a place already measured nearby is not measured again.
SAME_PLACE_M = 0.08
#: m and s of the verification move: the thesis's 0 to 0.5 m, and the rest in which the static error is read.
MOVE_M = 0.5
REST_S = 1.6
#: Where a drive cannot follow the standard move: slowest speed tried, m/s, longest move, s, and ramp to full speed, s.
SLOWEST_M_S = 2e-4
LONGEST_SLOW_MOVE_S = 8.0
RAMP_S = 0.2
#: Names of the phases, as shown to the user.
TITLES = (
    "connect and check",
    "sign and breakaway",
    "excitation, rising",
    "frequency response here",
    "first loop",
    "other places",
    "friction sweep",
    "fit and design",
    "verification moves",
)


@dataclass(frozen=True)
class Settings:
    """What the user decides.  payloads_kg : further carriage loads the loop must hold for, added to what is mounted now.

    position_m : where the carriage stands, when the drive does not know.   home : run the drive's homing first.
    apply : what becomes of the new gains.   quick : one place only.   feedforward, prefilters : for comparisons; None means what is best.
    move : the user's own reference motion instead of the standard move.
    """

    apply: Apply = "restore"
    position_m: float | None = None
    home: bool = False
    payloads_kg: tuple[float, ...] = ()
    feedforward: FeedforwardKind = "nonlinear"
    specification: Specification | None = None
    quick: bool = False
    move: Trajectory | None = None


@dataclass
class Findings:
    """What is known so far; every phase adds to it, and an interrupted run keeps what it has."""

    breakaway: phases.Breakaway | None = None
    excited: phases.Excited | None = None
    thesis: dict[str, MagnitudeFit] = field(default_factory=dict)
    dead_time: DeadTime | None = None
    final: FinalModel | None = None
    characteristics: Mapping[str, analyse.Characteristic] = field(default_factory=dict)
    friction: FrictionFit | None = None
    design: DesignResult | None = None
    cascade: Cascade | None = None
    demand: Demand | None = None
    verdict: Verdict | None = None
    remarks: list[str] = field(default_factory=list)
    machine_seconds: float = 0.0


def identify_here(machine: Machine, findings: Findings) -> Model:
    """Phases 1 to 3: sign, rising excitation, one open-loop frequency response at the present place; returns a first model."""
    talk = machine.talk
    talk.phase(2, len(TITLES), TITLES[1])
    findings.breakaway = phases.sign_and_scale(machine)
    talk.phase(3, len(TITLES), TITLES[2])
    findings.excited = phases.raise_amplitude(machine, findings.breakaway)
    talk.phase(4, len(TITLES), TITLES[3])
    excited = findings.excited
    phases.frequency_response(machine, "frf_1", excited.model, excited.step.amplitude_nm, RESPONSE_S)
    return first_model(machine, findings)


def first_model(machine: Machine, findings: Findings) -> Model:
    """Model, dead time and apparent damping from the frequency response at one place."""
    recordings = [r for r in machine.folder.recordings() if r.sidecar.experiment == "frf"]
    counts = machine.drive.capabilities.counts_per_rev
    findings.final = final_model(recordings, machine.axis, counts)
    model = findings.final.fit.model
    measure_delay_and_damping(findings, recordings, model)
    return model


def measure_delay_and_damping(findings: Findings, recordings: Sequence[Recording], model: Model, solver: Solver = "lm") -> None:
    """The thesis's fit of every response, and the dead time; both only inform, a failure is a remark."""
    for name, response in analyse.responses(recordings).items():
        try:
            findings.thesis[name] = analyse.thesis_fit(response, model, solver)
        except (DataError, Refused) as problem:
            findings.remarks.append(f"{name}: no log-magnitude fit ({problem})")
    if not recordings:
        return
    _, resonance = phases.characteristic_hz(model, recordings[0].sidecar.start_position_m or 0.0)
    try:
        findings.dead_time = analyse.dead_time_of(recordings, resonance)
    except DataError as problem:
        findings.remarks.append(str(problem))


def close_first_loop(machine: Machine, findings: Findings, model: Model) -> Cascade:
    """Phase 4: a cautious loop for the uncertain first model, written into the drive."""
    machine.talk.phase(5, len(TITLES), TITLES[4])
    structure = machine.drive.capabilities.structure
    at = machine.position_m
    plants = analyse.design_plants(model, [at], [model["cart.mass"]], delay(findings), analyse.apparent_damping(findings.thesis))
    result = _cautious(plants[-1], structure)
    cascade = analyse.with_feedforward(result.cascade, model, structure, delay(findings))
    margin = min(m.phase_margin_deg for m in result.margins)
    machine.talk.say(f"first loop: K_P {cascade.kp_nm_s_rad:.4f} N m s/rad, smallest phase margin {margin:.0f} deg on an uncertain model")
    machine.write_cascade(cascade)
    return cascade


def _cautious(plant: DesignPlant, structure: CascadeStructure) -> DesignResult:
    """The first loop with the largest uncertainty and the best margins that the drive's structure allows.

    Raises Refused (Infeasible) when even a model known to 5 % leaves less than ``LEAST_PHASE_MARGIN_DEG``.
    """
    for uncertainty in UNCERTAINTIES:
        try:
            return cautious_cascade(plant, structure, uncertainty)
        except Infeasible as refusal:
            nearest, last = refusal.nearest, refusal
    if nearest is None or nearest.phase_margin_deg < analyse.LEAST_PHASE_MARGIN_DEG:
        raise last
    return cautious_cascade(plant, structure, UNCERTAINTIES[-1], nearest)


def delay(findings: Findings) -> float:
    """Identified delay from torque setpoint to acting torque, s; 0 before it is known."""
    return max(findings.dead_time.value_s, 0.0) if findings.dead_time else 0.0


def measure_places(machine: Machine, model: Model, amplitude_nm: float) -> None:
    """Phase 5: frequency responses at other places along the travel."""
    machine.talk.phase(6, len(TITLES), TITLES[5])
    low, high = machine.full_room().window_m
    known = [r.sidecar.start_position_m or 0.0 for r in machine.folder.recordings("frf")]
    number = 1
    for share in PLACES:
        place = low + share * (high - low)
        if any(abs(place - other) < SAME_PLACE_M for other in known):
            continue
        number += 1
        name = f"frf_{number}"
        if machine.folder.finished(name) is None:
            phases.move_to(machine, place, model)
        phases.frequency_response(machine, name, model, amplitude_nm, RESPONSE_S)


def measure_friction(machine: Machine, model: Model) -> Recording:
    """Phase 5b: the constant-speed sweep with the loop closed."""
    machine.talk.phase(7, len(TITLES), TITLES[6])
    if machine.folder.finished("sweep") is None:
        phases.move_to(machine, phases.stroke_ends(machine)[0], model)
    strokes = phases.sweep(machine, model)
    sidecar = Sidecar(
        experiment="friction_sweep",
        start_position_m=machine.position_m,
        session_time_s=machine.session_time_s,
        closed_loop=True,
    )
    return machine.record("sweep", machine.follow(strokes.trajectory, machine.stroking()), machine.full_room(), sidecar)


def fit_and_design(machine: Machine, findings: Findings, settings: Settings) -> Cascade:
    """Phase 6: final fit over all records, final design; returns what goes into the drive."""
    machine.talk.phase(8, len(TITLES), TITLES[7])
    recordings = machine.folder.recordings()
    counts = machine.drive.capabilities.counts_per_rev
    first = findings.final.fit.model if findings.final else None
    findings.final = final_model(recordings, machine.axis, counts, start=first, progress=lambda f: machine.talk.progress(f, None))
    model = findings.final.fit.model
    measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
    findings.characteristics = analyse.characteristics(findings.final.fit, sum(machine.full_room().window_m) / 2)
    try:
        findings.friction = analyse.friction_of(recordings)
    except DataError as problem:
        findings.remarks.append(f"friction sweep: {problem}")
    findings.design, findings.cascade = design_for(machine.axis, model, machine.drive.capabilities.structure, findings, settings)
    return findings.cascade


def design_for(
    axis: Axis, model: Model, structure: CascadeStructure, findings: Findings, settings: Settings
) -> tuple[DesignResult, Cascade]:
    """The final design: both ends of the travel, the payload mounted now and the further ones stated."""
    masses = [model["cart.mass"], *(model["cart.mass"] + extra for extra in settings.payloads_kg)]
    return analyse.design(
        model,
        structure,
        positions_m=(float(axis.travel.min_m or 0.0), float(axis.travel.max_m or 0.0)),
        masses_kg=masses,
        dead_time_s=delay(findings),
        apparent_damping_nm_s_rad=analyse.apparent_damping(findings.thesis),
        feedforward=settings.feedforward,
        specification=settings.specification,
    )


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


def known_model(findings: Findings) -> Model:
    """The model so far.   Raises Refused when nothing was fitted yet."""
    if findings.final is None:
        raise Refused("there is no model yet; run `beltcomm fit` first")
    return findings.final.fit.model


def commission(machine: Machine, settings: Settings, findings: Findings) -> Findings:
    """The whole job on a connected, referenced axis.  ``findings`` is filled as it goes, so an interruption loses nothing."""
    machine.talk.phase(1, len(TITLES), TITLES[0])
    try:
        model = identify_here(machine, findings)
        close_first_loop(machine, findings, model)
        if not settings.quick:
            measure_places(machine, model, findings.excited.step.amplitude_nm if findings.excited else 0.0)
        measure_friction(machine, model)
        cascade = fit_and_design(machine, findings, settings)
        machine.talk.phase(9, len(TITLES), TITLES[8])
        model = known_model(findings)
        if settings.move is not None:
            trajectory = settings.move
        else:
            trajectory, remark = standard_move(machine, model)
            if remark:
                findings.remarks.append(f"verification move {remark}")
            trajectory, remark = within_target(machine, model, cascade, delay(findings), trajectory)
            if remark:
                findings.remarks.append(remark)
        verdict, findings.demand = verify_move(machine, model, cascade, delay(findings), trajectory)
        findings.verdict = verdict
        machine.keep_gains = settings.apply in ("keep", "save") and verdict.passed
        if settings.apply in ("keep", "save") and not verdict.passed:
            findings.remarks.append("the new gains were not kept, because the verification missed its target")
        if settings.apply == "save" and verdict.passed:
            machine.write_cascade(cascade)
            machine.drive.save()
    finally:
        findings.machine_seconds = machine.machine_seconds
    return findings


def reference(machine: Machine, settings: Settings) -> None:
    """Make the zero of the axis known: the drive knows it, or homing, or the operator's word.   Raises Refused without any."""
    if settings.position_m is not None:
        machine.reference_at(settings.position_m)
    elif settings.home:
        if not machine.drive.capabilities.can_home:
            raise Refused("this drive cannot home by itself; measure where the carriage stands and give --position")
        machine.drive.home(machine.drive_limits(machine.full_room()))
        machine.origin_rad = 0.0
    elif not machine.drive.capabilities.referenced:
        raise Refused("the drive does not know where the carriage stands; give --position METRES, or --home to let the drive find its zero")


def suitable(axis: Axis) -> None:
    """Raise UsageError unless the axis file has what the whole job needs."""
    axis.require(
        "commission",
        "motor.inertia_kg_m2",
        "pulley.effective_radius_m",
        "belt.specific_stiffness_n",
        "belt.pulley_distance_m",
        "travel.min_m",
        "travel.max_m",
        "limits.speed_m_s",
        "limits.feed_force_n",
    )
