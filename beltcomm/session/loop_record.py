"""Identification in closed loop on the drive (3.3.2): a cautious loop, a base speed that keeps friction constant, an excitation on top."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from beltcomm.control import Cascade
from beltcomm.drive import Capabilities, Motion, Row
from beltcomm.errors import Refused, SafetyStop
from beltcomm.excitation import Choice, choose
from beltcomm.excitation.moving import REST_S, TAIL_S, MovingExcitation, moving, ramp_s, stroke_m
from beltcomm.identify.amplitude import MotionLimits, around
from beltcomm.identify.loop_amplitude import (
    SLOWEST_SHARE,
    ClosedLoop,
    Into,
    LoopStep,
    MovingPrediction,
    largest_moving,
    predict_moving,
    simulated,
)
from beltcomm.identify.loop_response import KnownController, Way
from beltcomm.model import Model
from beltcomm.parameters import GAIN_NAMES
from beltcomm.recording import Recording
from beltcomm.session import commission as sequence
from beltcomm.session import phases
from beltcomm.session.bounds import Experiment
from beltcomm.session.commission import Findings
from beltcomm.session.expectation import SURPRISE, TRAVEL_SLACK_M
from beltcomm.session.machine import Machine, Room
from beltcomm.session.making import RESPONSE_S
from beltcomm.session.plan import MOVE_SECONDS, Plan
from beltcomm.sidecar import ExcitationNote, Sidecar
from beltcomm.simulate.loop import LoopDrive, LoopKind

#: m/s: the thesis's own base speed (3.4); less where the travel is short.
USUAL_SPEED_M_S = 0.1
#: m/s: a drive does not travel evenly more slowly.
SLOWEST_M_S = 1e-3
#: Measured periods of the record, the fewest in one stroke by which the usual speed is chosen, and records before it with rising amplitude.
PERIODS, FEWEST_IN_STROKE, RISES = 6, 2, 2
#: s: shortest ramp to the base speed; settling behind it at least and at most, until the speed is within a share of it.
SHORTEST_RAMP_S, SETTLE_S, LONGEST_SETTLE_S, SETTLED_SHARE = 0.1, 0.1, 2.0, 0.01
#: The least excitation: torque steps of the drive, and share of the base speed; of a standing axis rad/s at the motor.
LEAST_STEPS, LEAST_SHARE, LEAST_RAD_S = 4.0, 0.01, 0.05
#: Largest excitation of the speed setpoint over the base speed: the setpoint must not turn round.
MOST_SHARE = 0.9
#: Counts that a record must move the motor of a standing axis by.
MOVED_COUNTS = 50
TITLES = ("first loop", "excitation, rising", "frequency response in closed loop")


@dataclass(frozen=True, eq=False)
class Job:
    """What will be recorded.   way : by which the response is wanted.   cascade : as it travels; with ``loop.cascade`` it is excited.

    margin_deg : smallest phase margin.   choice : signal but for amplitude and length.   speed_m_s : base speed, 0 at rest.   why : in words.
    ramp, settle : s.   periods, strokes : measured periods of each stroke, and strokes.   step : largest amplitude.   prediction : of the
    record with it.
    """

    way: Way
    model: Model
    loop: ClosedLoop
    cascade: Cascade
    margin_deg: float
    choice: Any
    speed_m_s: float
    why: str
    ramp: float
    settle: float
    periods: int
    strokes: int
    step: LoopStep
    prediction: MovingPrediction
    torque_step_nm: float

    def motion(self, amplitude: float, sign: float = 1.0, *, rising: bool = False) -> MovingExcitation:
        """The record with this amplitude; a rising one is one stroke with one measured period."""
        signal = replace(self.choice, repeats=1 if rising else self.periods)
        step = self.torque_step_nm if self.loop.into == "torque" else 0.0
        excitation = signal.excitation(amplitude, self.loop.sample_period_s, torque_step_nm=step)
        return moving(excitation, sign * self.speed_m_s, 1 if rising else self.strokes, self.ramp, self.settle)

    @property
    def unit(self) -> str:
        """Of its amplitude."""
        return "N m" if self.loop.into == "torque" else "rad/s"


def offered(capabilities: Capabilities, way: Way, parameters: frozenset[str]) -> tuple[LoopKind, Into]:
    """Which loop is closed and where the excitation goes in.   parameters : names that the drive offers.

    Raises Refused with what this drive lacks.
    """
    missing = [name for name in GAIN_NAMES[:4] if name not in parameters]
    if missing:
        raise Refused(
            f"{capabilities.name} does not tell its gains {', '.join(missing)} over the bus, so no loop can be set or taken off again; only "
            "--loop open is possible"
        )
    if way == "setpoint":
        if "velocity" not in capabilities.kinds:
            raise Refused(f"{capabilities.name} takes no speed setpoints (modes 9 or 3); use --loop direct")
        return "velocity", "velocity"
    for kind in cast("tuple[LoopKind, ...]", ("velocity", "position")):
        if kind in capabilities.torque_along and kind in capabilities.kinds:
            return kind, "torque"
    instead = "; --loop setpoint excites its speed setpoint instead" if "velocity" in capabilities.kinds else ""
    raise Refused(f"{capabilities.name} adds no torque to that of its loop (no object 60B2h), so --loop {way} cannot be had{instead}")


def plan_job(machine: Machine, findings: Findings, model: Model, way: Way, base_speed_m_s: float | None) -> Job:
    """Loop, base speed, strokes and the largest amplitude, worked out on the model; nothing moves and nothing is written.

    base_speed_m_s : None is chosen here, 0 stands.   Raises Refused with what binds.
    """
    capabilities = machine.drive.capabilities
    kind, into = offered(capabilities, way, frozenset(machine.drive.backup()))
    cascade, margin = sequence.first_cascade(machine, findings, model, sum(machine.full_room().window_m) / 2.0)
    excited = cascade
    if into == "velocity":  # what the drive feeds forward would pass the excitation on beside the controller
        forward = replace(cascade.feedforward, inertia_kg_m2=0.0, viscous_nm_s_rad=0.0, advance_s=0.0)
        excited = replace(cascade, feedforward=forward if base_speed_m_s != 0.0 else replace(forward, coulomb_nm=0.0))
    room = machine.full_room()
    structure = capabilities.structure
    drive = LoopDrive(structure.period_s, sequence.delay(findings), room.torque_nm, capabilities.counts_per_rev)
    loop = ClosedLoop(excited, drive, kind, into, capabilities.sample_period_s)
    antiresonance, resonance = phases.characteristic_hz(model, sum(machine.full_room().window_m) / 2.0)
    choice: Choice = choose(machine.excitation, capabilities.sample_period_s, antiresonance, resonance, RESPONSE_S)
    period_s = choice.excitation(1.0, capabilities.sample_period_s).period_samples * capabilities.sample_period_s
    near, far = phases.stroke_ends(machine)
    gentle = phases.gentle_limits(machine, model, math.inf)
    settle = SETTLE_S
    for _ in range(2):  # the speed says how long the loop settles, and that how fast it may be
        speed, why = _base_speed(base_speed_m_s, far - near, settle, period_s, gentle.acceleration_m_s2, gentle.speed_m_s)
        ramp = max(SHORTEST_RAMP_S, ramp_s(speed, gentle.acceleration_m_s2))
        settle = _settling(model, loop, choice, speed, ramp, near)
    periods, strokes = _strokes(speed, far - near, ramp, settle, period_s)
    least = LEAST_STEPS * capabilities.torque_step_nm if into == "torque" else max(LEAST_SHARE * speed / machine.ratio, LEAST_RAD_S)
    most = machine.axis.torque_limit_nm
    if into == "velocity":
        most = MOST_SHARE * (speed or phases.EXCITATION_SPEED_M_S) / machine.ratio
    limits = MotionLimits(
        phases.EXCITATION_TRAVEL_M,
        min(room.speed_m_s, max(speed, 0.0) + phases.EXCITATION_SPEED_M_S),
        room.torque_nm,
        phases.BELT_SHARE * machine.axis.belt_force_limit_n,
    )
    signal = cast("Any", choice)
    shape = moving(replace(signal, repeats=1).excitation(1.0, loop.sample_period_s), speed, 1, ramp, settle)
    shape = shape.louder(1.0 / float(np.max(np.abs(shape.added))))
    family = around(model)
    step = largest_moving(family, loop, shape, near, limits, max(most, least), least)
    found = step.prediction
    job = Job(
        way, model, loop, cascade, margin, signal, speed, why, ramp, settle, periods, strokes, step, found, capabilities.torque_step_nm
    )
    prediction = predict_moving(family, loop, job.motion(step.amplitude), near if speed else machine.position_m)
    _inside(machine, prediction)
    _moves(job, step.amplitude, near)
    return replace(job, prediction=prediction)


def plan_of(machine: Machine, job: Job) -> Plan:
    """What the user is shown."""
    axis, told, period = machine.axis, job.prediction, job.loop.sample_period_s
    low, high = machine.full_room().window_m
    signal = f"±{job.step.amplitude:.3g} {job.unit} of {'torque' if job.loop.into == 'torque' else 'speed setpoint'}"
    what = f"travel at {1e3 * job.speed_m_s:.4g} mm/s, there and back, with an excitation of up to {signal}"
    text = (
        f"The carriage of {axis.name or 'the axis'} will {what if job.speed_m_s else f'shake where it stands with up to {signal}'}, in closed "
        f"loop (K_P {job.cascade.kp_nm_s_rad:.3g} N m s/rad): {RISES} short records with rising amplitude and a long one, bound by "
        f"{job.step.binds}. {job.why[0].upper()}{job.why[1:]}. Keep people and tools out of its travel; Ctrl-C stops it at any time, and the "
        "drive gets its own gains back."
    )
    short, long = (period * len(job.motion(job.step.amplitude, rising=rising).added) for rising in (True, False))
    travel, torque = told.high_m - told.low_m, machine.full_room().torque_nm
    positioning = Experiment(
        "to an end of the strokes, before each",
        high - low,
        high - low,
        min(phases.POSITIONING_SPEED_M_S, machine.full_room().speed_m_s),
        torque,
        axis.belt_force_limit_n / 3.0,
        (1 + RISES) * MOVE_SECONDS,
    )
    lines = [
        Experiment(title, travel, high - low, told.speed_m_s, told.torque_nm, told.belt_force_n, seconds)
        for title, seconds in ((TITLES[1], RISES * short), (TITLES[2], long))
    ]
    return Plan(text, (*((positioning,) if job.speed_m_s else ()), *lines))


def record_all(machine: Machine, findings: Findings, job: Job, *, ask: bool) -> Recording:
    """Close the loop, let the amplitude rise, and make the record; returns it.   Raises what the machine raises."""
    machine.titles = TITLES
    machine.begin(TITLES[0])
    sequence.close_loop(machine, findings, job.model, job.cascade, job.margin_deg, ask=ask)
    number = 1 + sum(name.startswith(f"{job.way}_") and "_rise_" not in name for name in machine.folder.finished_names())
    machine.begin(TITLES[1])
    amplitude = job.step.amplitude / phases.GROWTH**RISES
    for rise in range(1, RISES + 1):
        if not job.speed_m_s and not _moved_rad(job, amplitude, machine.position_m):
            amplitude = job.step.amplitude  # what friction holds shows nothing
        recording = _record(machine, job, _free(machine, f"{job.way}_{number}_rise_{rise}"), amplitude, rising=True)
        amplitude = min(phases.GROWTH * amplitude, allowed(recording, amplitude, job.loop.drive.counts_per_rev), job.step.amplitude)
    machine.begin(TITLES[2])
    return _record(machine, job, _free(machine, f"{job.way}_{number}"), amplitude, rising=False)


def _moved_rad(job: Job, amplitude: float, at_m: float) -> bool:
    """Whether the model of a standing axis is moved by an excitation."""
    run = simulated(job.model, job.loop, job.motion(amplitude, rising=True), at_m)
    return float(np.ptp(run.position_rad)) > MOVED_COUNTS * 2.0 * math.pi / job.loop.drive.counts_per_rev


def _moves(job: Job, amplitude: float, at_m: float) -> None:
    """Raise Refused for a standing axis that friction holds against the largest excitation."""
    if not job.speed_m_s and not _moved_rad(job, amplitude, at_m):
        raise Refused(
            f"friction holds the standing axis against ±{amplitude:.3g} {job.unit}, and {job.step.binds} allows no more; let it travel "
            "(--base-speed)"
        )


def slowest_share(recording: Recording, counts_per_rev: int) -> float:
    """Least motor speed over its mean while excited, from differences of the angle less one count; nan where the carriage stood."""
    note = recording.sidecar.excitation
    if note is None or not note.base_speed_m_s or not note.period_starts or not note.period_samples:
        return math.nan
    found, count = math.inf, 2.0 * math.pi / counts_per_rev
    for start in note.period_starts:
        turned = np.diff(recording.position[start : start + note.period_samples])
        mean = float(np.mean(turned))
        found = min(found, (float(np.min(turned * np.sign(mean))) + count) / abs(mean))
    return found


def allowed(recording: Recording, amplitude: float, counts_per_rev: int) -> float:
    """The amplitude at which the motor is slowed down as much as it may, by what a record with a smaller one showed."""
    share = slowest_share(recording, counts_per_rev)
    return amplitude * (1.0 - SLOWEST_SHARE) / max(1.0 - share, 1e-6) if math.isfinite(share) else math.inf


def _free(machine: Machine, name: str) -> str:
    """A name that no finished record has."""
    return name if machine.folder.finished(name) is None else _free(machine, f"{name}b")


def _record(machine: Machine, job: Job, name: str, amplitude: float, *, rising: bool) -> Recording:
    """One record from the nearer end of the travel, predicted before it is made."""
    model, loop = job.model, job.loop
    ends = phases.stroke_ends(machine)
    near, far = ends if abs(machine.position_m - ends[0]) <= abs(machine.position_m - ends[1]) else ends[::-1]
    machine.write_cascade(job.cascade)
    if job.speed_m_s:
        phases.move_to(machine, near, model)
    at = machine.position_m
    motion = job.motion(amplitude, 1.0 if far > near else -1.0, rising=rising)
    running = machine.write_cascade(loop.cascade)
    exactly = replace(loop, cascade=running)
    predicted = predict_moving(around(model), exactly, motion, at, machine.braking)
    _inside(machine, predicted)
    low_word = f", the motor never slower than {100 * predicted.slowest:.0f} % of that" if math.isfinite(predicted.slowest) else ""
    machine.talk.say(
        f"{name}: ±{amplitude:.3g} {job.unit} at {1e3 * job.speed_m_s:.4g} mm/s{low_word}; {predicted.belt_force_n:.0f} N in the belt, "
        f"{predicted.torque_nm:.2f} N m, between {1e3 * predicted.low_m:.0f} and {1e3 * predicted.high_m:.0f} mm with a stop"
    )
    first = simulated(model, exactly, motion, at)
    held = max(1, round(loop.sample_period_s / loop.drive.period_s))
    carriage = first.cart_m[::held]
    base, zero = at + motion.base_m, np.zeros(len(motion.added))
    asked = motion.base_m_s / machine.ratio
    torque, faster = (motion.added, zero) if loop.into == "torque" else (zero, motion.added)
    order = Motion(loop.kind, loop.sample_period_s, machine.origin_rad + base / machine.ratio, asked + faster, torque)
    low, high = machine.full_room().window_m
    slack = SURPRISE * predicted.deviation_m + TRAVEL_SLACK_M + phases.END_MARGIN_M
    window = max(low, float(base.min()) - slack), min(high, float(base.max()) + slack)
    room = Room(window, machine.full_room().speed_m_s, machine.full_room().torque_nm, phases.LOST_M if loop.kind == "position" else None)
    known = KnownController(running, loop.kind, loop.drive.period_s, loop.drive.delay_s)
    note = ExcitationNote(
        kind=job.choice.excitation(1.0, loop.sample_period_s).kind,
        amplitude_nm=float(np.max(np.abs(motion.added))) if loop.into == "torque" else None,
        period_samples=motion.period_samples,
        first_sample=motion.starts[0],
        period_starts=motion.starts,
        amplitude_rad_s=float(np.max(np.abs(motion.added))) if loop.into == "velocity" else None,
        base_speed_m_s=job.speed_m_s or None,
    )
    sidecar = Sidecar("frf", at, machine.session_time_s, closed_loop=True, excitation=note, controller=known.to_dict())
    watch = MovingWatch(base, machine.ratio, machine.origin_rad, loop.sample_period_s, predicted)
    return machine.record(name, order, room, sidecar, watch, (carriage, np.gradient(carriage, loop.sample_period_s)))


class MovingWatch:
    """Call it with every row of a record: the motor stays near the base motion and below the predicted speed.   Raises SafetyStop."""

    def __init__(self, base_m: np.ndarray, ratio: float, zero_rad: float, period_s: float, predicted: MovingPrediction) -> None:
        self.base_m, self.ratio, self.zero_rad, self.period_s = base_m.tolist(), ratio, zero_rad, period_s
        self.farthest_m = SURPRISE * predicted.deviation_m + TRAVEL_SLACK_M
        self.fastest_m_s = SURPRISE * predicted.speed_m_s

    def __call__(self, row: Row) -> None:
        """One row as the drive gives it.   Raises SafetyStop."""
        place = min(round(row[0] / self.period_s), len(self.base_m) - 1)
        off = abs(self.ratio * (row[3] - self.zero_rad) - self.base_m[place])
        speed = abs(self.ratio * row[4])
        if off > self.farthest_m:
            self._stop("position", f"the motor is {1e3 * off:.3g} mm off its base motion, {1e3 * self.farthest_m:.3g} mm")
        if speed > self.fastest_m_s:
            self._stop("speed", f"the motor runs at {speed:.3g} m/s, {self.fastest_m_s:.3g} m/s")

    def _stop(self, reason: str, what: str) -> None:
        raise SafetyStop(
            f"{what} were to be expected at most; the axis was stopped: it is not the one that the run's model describes; "
            "identify it again (beltcomm identify)",
            reason,
        )


def _inside(machine: Machine, prediction: MovingPrediction) -> None:
    """Raise Refused when a record with its stops is predicted to leave the travel."""
    low, high = machine.full_room().window_m
    if prediction.low_m < low or prediction.high_m > high:
        raise Refused(
            f"in this loop the carriage is predicted to go from {prediction.low_m:.4g} to {prediction.high_m:.4g} m with the way of a stop, "
            f"the travel is {low:g}..{high:g} m; travel more slowly (--base-speed)"
        )


def _base_speed(
    asked_m_s: float | None, way_m: float, settle: float, period_s: float, acceleration: float, top_m_s: float
) -> tuple[float, str]:
    """The base speed and why.   Raises Refused for one that the travel does not allow."""
    excited = (1 + FEWEST_IN_STROKE) * period_s

    def fits(speed: float, seconds: float) -> bool:
        ramp = max(SHORTEST_RAMP_S, ramp_s(speed, acceleration))
        return speed <= top_m_s and stroke_m(speed, ramp, settle, seconds) <= way_m

    if asked_m_s == 0.0:
        return 0.0, "it stands, as asked for: friction turns round with it and poses as damping"
    if asked_m_s is not None:
        if asked_m_s < SLOWEST_M_S or not fits(asked_m_s, 2.0 * period_s):
            longest = way_m / (2.0 * period_s + SHORTEST_RAMP_S + settle)
            raise Refused(
                f"a base speed of {1e3 * asked_m_s:g} mm/s cannot be: run-in and one period of {period_s:.3g} s need to fit into a stroke of "
                f"{1e3 * way_m:.0f} mm; give {1e3 * SLOWEST_M_S:g} to {1e3 * min(longest, top_m_s):.0f} mm/s, or 0 to stand"
            )
        return asked_m_s, f"the base speed of {1e3 * asked_m_s:g} mm/s was asked for"
    if fits(USUAL_SPEED_M_S, excited):
        return USUAL_SPEED_M_S, f"the base speed is the usual {1e3 * USUAL_SPEED_M_S:g} mm/s, and the amplitude such that the motor does not turn round"
    shares = np.geomspace(1.0, SLOWEST_M_S / USUAL_SPEED_M_S, 60)
    found = next((float(USUAL_SPEED_M_S * share) for share in shares if fits(float(USUAL_SPEED_M_S * share), excited)), None)
    if found is None:
        raise Refused(f"the strokes of {1e3 * way_m:.0f} mm are too short for {excited:.3g} s at a base speed; --base-speed 0 stands")
    return found, f"the base speed of {1e3 * found:.3g} mm/s is what the travel allows ({1e3 * USUAL_SPEED_M_S:g} mm/s are usual)"


def _strokes(speed: float, way_m: float, ramp: float, settle: float, period_s: float) -> tuple[int, int]:
    """Measured periods of each stroke, and strokes.   Raises Refused when not one fits."""
    if not speed:
        return PERIODS, 1
    fitting = math.floor((way_m / speed - ramp - settle - TAIL_S) / period_s - 1.0 + 1e-9)
    if fitting < 1:
        raise Refused(
            f"at {1e3 * speed:.4g} mm/s this loop needs {settle:.2g} s to settle, and then no period of {period_s:.3g} s with its run-in fits "
            f"into {1e3 * way_m:.0f} mm; travel more slowly (--base-speed)"
        )
    strokes = math.ceil(PERIODS / fitting)
    return math.ceil(PERIODS / strokes), strokes


def _settling(model: Model, loop: ClosedLoop, choice: Choice, speed: float, ramp: float, start_m: float) -> float:
    """Time behind the ramp until the loop travels evenly, s, there and back; the run-in period counts as settling too.

    Raises Refused when it does not.
    """
    if not speed:
        return SETTLE_S
    signal = choice.excitation(1.0, loop.sample_period_s)
    length = signal.period_samples * loop.sample_period_s
    path = moving(replace(cast("Any", choice), repeats=1).excitation(1.0, loop.sample_period_s), speed, 2, ramp, LONGEST_SETTLE_S)
    held = max(1, round(loop.sample_period_s / loop.drive.period_s))
    run = simulated(model, loop, path.louder(0.0), start_m)
    base = np.repeat(path.base_m_s, held)
    steady = np.abs(base) == abs(speed)
    off = np.abs(model["transmission.ratio"] * run.velocity_rad_s - base) > SETTLED_SHARE * speed
    longest = 0.0
    edges = np.flatnonzero(np.diff(steady.astype(int)))
    for begin, end in zip(edges[::2] + 1, edges[1::2] + 1, strict=True):
        late = np.flatnonzero(off[begin:end])
        longest = max(longest, (late[-1] + 1) * loop.drive.period_s if len(late) else 0.0)
        if len(late) and late[-1] >= end - begin - 2:
            raise Refused(
                f"this loop does not travel evenly at {1e3 * speed:.4g} mm/s: its speed is still more than {100 * SETTLED_SHARE:.0f} % off after "
                f"{LONGEST_SETTLE_S + 2.0 * length:.2g} s; travel faster (--base-speed)"
            )
    return max(SETTLE_S, longest - length)
