"""Plan of an identification in closed loop: loop, base speed, strokes and amplitude, worked out on the model before anything moves."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from beltcomm.control import Cascade
from beltcomm.drive import Capabilities
from beltcomm.drive.parameters import LOOP_GAINS
from beltcomm.errors import Refused
from beltcomm.excitation import Choice, choose, visible_band
from beltcomm.excitation.moving import TAIL_S, MovingExcitation, moving_excitation, ramp_s, stroke_m
from beltcomm.experiments import commission as sequence
from beltcomm.experiments import phases
from beltcomm.experiments.bounds import Experiment, gentle_force_n, stroking_nm
from beltcomm.experiments.execute_step import RESPONSE_S
from beltcomm.experiments.plan import MOVE_SECONDS, Plan
from beltcomm.experiments.sign import sign_words
from beltcomm.identify.amplitude import MotionLimits, family_around
from beltcomm.identify.loop_amplitude import (
    ClosedLoop,
    Into,
    LoopStep,
    MovingPrediction,
    largest_moving,
    predict_moving,
    simulate_record,
)
from beltcomm.identify.loop_response import Way
from beltcomm.machine.heat import Thermal
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.rundata import analyse, delays
from beltcomm.rundata.findings import Findings
from beltcomm.schedule.sequences import excitation_travel_m
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
class LoopJob:
    """The record to be made.

    Attributes
    ----------
    way : Way
        By which the response is wanted.
    cascade : Cascade
        As it travels; with ``loop.cascade`` it is excited.
    margin_deg : float
        Smallest phase margin.
    choice : Any
        Signal but for amplitude and length.
    speed_m_s : float
        Base speed, 0 at rest.
    why : str
        Of it.
    ramp, settle : float, s
    periods, strokes : int
        Measured periods of each stroke, and strokes.
    step : LoopStep
        Largest amplitude.
    prediction : MovingPrediction
        Of the record with it.
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
        """The record with this amplitude.

        Parameters
        ----------
        amplitude : float, N m or rad/s at the motor, as the loop takes it
        sign : float
            Of the speed: 1 or -1.
        rising : bool
            One stroke with one measured period.
        """
        signal = replace(self.choice, repeats=1 if rising else self.periods)
        step = self.torque_step_nm if self.loop.into == "torque" else 0.0
        excitation = signal.excitation(amplitude, self.loop.sample_period_s, torque_step_nm=step)
        return moving_excitation(excitation, sign * self.speed_m_s, 1 if rising else self.strokes, self.ramp, self.settle)

    @property
    def unit(self) -> str:
        """Of its amplitude."""
        return "N m" if self.loop.into == "torque" else "rad/s"


def require_offered(capabilities: Capabilities, way: Way, parameters: frozenset[str]) -> tuple[LoopKind, Into]:
    """The loop that is closed and the place where the excitation goes in.

    Parameters
    ----------
    capabilities : Capabilities
    way : Way
        Of identifying in closed loop.
    parameters : frozenset of str
        Names that the drive offers.

    Raises
    ------
    Refused
        With what this drive lacks.
    """
    missing = [name for name in LOOP_GAINS if name not in parameters]
    if missing:
        raise Refused(
            f"{capabilities.name} does not tell its gains {', '.join(missing)} over the bus, so no loop can be set or taken off again: "
            "only --loop open is possible"
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


def plan_job(machine: Machine, findings: Findings, model: Model, way: Way, base_speed_m_s: float | None) -> LoopJob:
    """Loop, base speed, strokes and the largest amplitude, worked out on the model; nothing moves and nothing is written.

    Parameters
    ----------
    machine : Machine
    findings : Findings
        With the delay.
    model : Model
    way : Way
        Of identifying in closed loop.
    base_speed_m_s : float or None
        None is chosen here, 0 stands.

    Raises
    ------
    Refused
        With what binds.
    """
    capabilities = machine.drive.capabilities
    kind, into = require_offered(capabilities, way, frozenset(machine.drive.backup()))
    cascade, margin = sequence.first_cascade(machine, findings, model, sum(machine.envelope().window_m) / 2.0)
    excited = cascade
    if into == "velocity":  # what the drive feeds forward would pass the excitation on beside the controller
        forward = replace(cascade.feedforward, inertia_kg_m2=0.0, viscous_nm_s_rad=0.0, advance_s=0.0)
        excited = replace(cascade, feedforward=forward if base_speed_m_s != 0.0 else replace(forward, coulomb_nm=0.0))
    envelope = machine.envelope()
    structure = capabilities.structure
    drive = LoopDrive(structure.period_s, delays.delay(findings), envelope.torque_nm, capabilities.counts_per_rev)
    loop = ClosedLoop(excited, drive, kind, into, capabilities.sample_period_s)
    band = visible_band(capabilities.sample_period_s, *analyse.characteristic_hz(model, sum(machine.envelope().window_m) / 2.0))
    choice: Choice = choose(machine.excitation, capabilities.sample_period_s, *band, RESPONSE_S)
    choice = machine.asked.of(choice, capabilities.sample_period_s)
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
    most = machine.asked.amplitude_nm or machine.axis.torque_limit_nm
    if into == "velocity":
        most = MOST_SHARE * (speed or phases.EXCITATION_SPEED_M_S) / machine.ratio
    limits = MotionLimits(
        excitation_travel_m(capabilities.sample_period_s),
        min(envelope.speed_m_s, max(speed, 0.0) + phases.EXCITATION_SPEED_M_S),
        envelope.torque_nm,
        phases.BELT_SHARE * machine.axis.belt_force_limit_n,
    )
    signal = cast("Any", choice)
    shape = moving_excitation(replace(signal, repeats=1).excitation(1.0, loop.sample_period_s), speed, 1, ramp, settle)
    shape = shape.louder(1.0 / float(np.max(np.abs(shape.added))))
    family = family_around(model)
    start = near if speed else min(max(machine.position_m, near), far)
    step = largest_moving(family, loop, shape, start, limits, max(most, least), least)
    machine.asked.amplitude_of(step.amplitude, step.binds)
    found = step.prediction
    job = LoopJob(
        way, model, loop, cascade, margin, signal, speed, why, ramp, settle, periods, strokes, step, found, capabilities.torque_step_nm
    )
    prediction = predict_moving(family, loop, job.motion(step.amplitude), start)
    check_inside(machine, prediction)
    _moves(job, step.amplitude, start)
    return replace(job, prediction=prediction)


def plan_of(machine: Machine, job: LoopJob) -> Plan:
    """Plan of a closed-loop record as the user is shown it: short records that rise, and a long one.

    Parameters
    ----------
    machine : Machine
    job : LoopJob
        Loop, signal and predicted motion.
    """
    axis, told, period = machine.axis, job.prediction, job.loop.sample_period_s
    low, high = machine.envelope().window_m
    signal = f"±{job.step.amplitude:.3g} {job.unit} of {'torque' if job.loop.into == 'torque' else 'speed setpoint'}"
    what = f"be excited in place with up to {signal}"
    if job.speed_m_s:
        what = f"travel at {1e3 * job.speed_m_s:.4g} mm/s, there and back, with an excitation of up to {signal}"
    loop = f"closed loop (Kp {job.cascade.kp_nm_s_rad:.3g} N m s/rad)"
    text = (
        f"The carriage of {axis.name or 'the axis'} will {sign_words(axis)}{what}, in {loop}: "
        f"{RISES} short records with rising amplitude and a long one, "
        f"limited by {job.step.binds}. {job.why[0].upper()}{job.why[1:]}."
    )
    short, long = (period * len(job.motion(job.step.amplitude, rising=rising).added) for rising in (True, False))
    travel, torque = told.high_m - told.low_m, machine.envelope().torque_nm
    positioning = Experiment(
        "to an end of the strokes, before each",
        high - low,
        high - low,
        min(phases.POSITIONING_SPEED_M_S, machine.envelope().speed_m_s),
        torque,
        gentle_force_n(axis),
        (1 + RISES) * MOVE_SECONDS,
        stroking_nm(axis, machine.drive.capabilities),
    )
    lines = [
        Experiment(title, travel, high - low, told.speed_m_s, told.torque_nm, told.belt_force_n, seconds)
        for title, seconds in ((TITLES[1], RISES * short), (TITLES[2], long))
    ]
    thermal = Thermal.of(axis, machine.drive.capabilities)
    return Plan(text, (*((positioning,) if job.speed_m_s else ()), *lines), thermal=thermal, verb="identify")


def is_moved(job: LoopJob, amplitude: float, at_m: float) -> bool:
    """True if the model of a standing axis is moved by an excitation.

    Parameters
    ----------
    job : LoopJob
        Loop, signal and predicted motion.
    amplitude : float
        In the unit of the excitation.
    at_m : float, m
        Carriage on the axis.
    """
    run = simulate_record(job.model, job.loop, job.motion(amplitude, rising=True), at_m)
    return float(np.ptp(run.position_rad)) > MOVED_COUNTS * 2.0 * math.pi / job.loop.drive.counts_per_rev


def _moves(job: LoopJob, amplitude: float, at_m: float) -> None:
    """Raise Refused for a standing axis that friction holds against the largest excitation."""
    if not job.speed_m_s and not is_moved(job, amplitude, at_m):
        raise Refused(
            f"friction holds the standing axis against ±{amplitude:.3g} {job.unit}, and {job.step.binds} allows no more; let it travel "
            "(--base-speed)"
        )


def check_inside(machine: Machine, prediction: MovingPrediction) -> None:
    """Refuse a record that with its stops is predicted to leave the travel.

    Parameters
    ----------
    machine : Machine
    prediction : MovingPrediction, m
        Of the record.

    Raises
    ------
    Refused
        With both.
    """
    low, high = machine.envelope().window_m
    if prediction.low_m < low or prediction.high_m > high:
        raise Refused(
            f"the carriage is predicted to go from {prediction.low_m:.4g} to {prediction.high_m:.4g} m with the way of a stop, "
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
                f"a base speed of {1e3 * asked_m_s:g} mm/s cannot be: run-in and one period of {period_s:.3g} s need to fit into a "
                f"stroke of {1e3 * way_m:.0f} mm; give {1e3 * SLOWEST_M_S:g} to {1e3 * min(longest, top_m_s):.0f} mm/s, or 0 to stand"
            )
        return asked_m_s, f"the base speed of {1e3 * asked_m_s:g} mm/s was asked for"
    if fits(USUAL_SPEED_M_S, excited):
        return (
            USUAL_SPEED_M_S,
            f"the base speed is the usual {1e3 * USUAL_SPEED_M_S:g} mm/s, and the amplitude such that the motor does not turn round",
        )
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
            f"at {1e3 * speed:.4g} mm/s this loop needs {settle:.2g} s to settle, and then no period of {period_s:.3g} s with its run-in "
            f"fits into {1e3 * way_m:.0f} mm; travel more slowly (--base-speed)"
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
    path = moving_excitation(
        replace(cast("Any", choice), repeats=1).excitation(1.0, loop.sample_period_s), speed, 2, ramp, LONGEST_SETTLE_S
    )
    held = max(1, round(loop.sample_period_s / loop.drive.period_s))
    run = simulate_record(model, loop, path.louder(0.0), start_m)
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
                f"this loop does not travel evenly at {1e3 * speed:.4g} mm/s: its speed is still more than {100 * SETTLED_SHARE:.0f} % off "
                f"after {LONGEST_SETTLE_S + 2.0 * length:.2g} s; travel faster (--base-speed)"
            )
    return max(SETTLE_S, longest - length)
