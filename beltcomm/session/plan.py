"""What will happen to the machine, before it happens: experiments with travel, speed, torque, belt force and seconds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.model import Model
from beltcomm.session import creep, phases
from beltcomm.trajectory import Trajectory
from beltcomm.verify import demand


@dataclass(frozen=True)
class Experiment:
    """One line of the plan; every number is an upper bound.   travel_m : either way.   torque_nm : motor shaft."""

    title: str
    travel_m: float
    speed_m_s: float
    torque_nm: float
    belt_force_n: float
    seconds: float


@dataclass(frozen=True)
class Plan:
    """All experiments of a job.   text : one paragraph on what the machine will do."""

    text: str
    experiments: tuple[Experiment, ...]

    @property
    def seconds(self) -> float:
        """Machine time, s."""
        return sum(item.seconds for item in self.experiments)

    def lines(self) -> list[str]:
        """The plan as a table in plain text."""
        head = f"{'experiment':34} {'travel':>9} {'speed':>10} {'torque':>9} {'belt':>7} {'time':>6}"
        rows = [
            f"{e.title:34} {1e3 * e.travel_m:6.0f} mm {e.speed_m_s:6.2f} m/s {e.torque_nm:5.2f} N m "
            f"{e.belt_force_n:5.0f} N {e.seconds:4.0f} s"
            for e in self.experiments
        ]
        return [self.text, "", head, *rows, f"{'on the machine, at most':34} {self.seconds:47.0f} s"]


def identify_plan(axis: Axis, capabilities: Capabilities) -> Plan:
    """Sign check, rising excitation and one frequency response at the present place."""
    return Plan(
        f"The carriage of {axis.name or 'the axis'} will creep some millimetres both ways, then shake around where it stands with rising "
        "torque. No loop is closed by beltcomm. Keep people and tools out of its travel; Ctrl-C stops it at any time.",
        _here(axis, capabilities),
    )


def commission_plan(axis: Axis, capabilities: Capabilities, quick: bool = False) -> Plan:
    """The whole job."""
    travel = axis.travel
    whole = float(travel.max_m or 0.0) - float(travel.min_m or 0.0)
    speed, force = _top_speed_m_s(axis, capabilities), axis.belt_force_limit_n
    torque = min(axis.motor.peak_torque_nm or math.inf, capabilities.peak_torque_nm)
    gentle = force / 3.0
    shaking = phases.BELT_SHARE * force
    places = 0 if quick else 2
    experiments = [
        *_here(axis, capabilities),
        Experiment(
            f"frequency response, {places} places" if places else "positioning",
            whole,
            0.5,
            torque,
            shaking,
            places * (RESPONSE_SECONDS + MOVE_SECONDS),
        ),
        Experiment("constant-speed sweep", whole, 0.8 * speed, torque, gentle, SWEEP_SECONDS),
        Experiment("move that verifies the result", min(whole, 0.5), speed, torque, force, 3.0 + MOVE_SECONDS),
    ]
    return Plan(
        f"The carriage of {axis.name or 'the axis'} will creep some millimetres both ways, shake around where it stands with rising "
        f"torque, then travel between {travel.min_m:g} m and {travel.max_m:g} m in closed loop: slow and fast strokes, and one fast "
        "move. Keep people, tools and cables out of its travel; Ctrl-C stops it at any time, and at the end the drive is left as it "
        "was found unless you keep the new gains.",
        tuple(e for e in experiments if e.seconds > 0.0),
    )


def friction_plan(axis: Axis, capabilities: Capabilities) -> Plan:
    """The sweep alone."""
    whole = float(axis.travel.max_m or 0.0) - float(axis.travel.min_m or 0.0)
    torque = min(axis.motor.peak_torque_nm or math.inf, capabilities.peak_torque_nm)
    force = axis.belt_force_limit_n / 3.0
    return Plan(
        f"The carriage of {axis.name or 'the axis'} will travel its whole length in closed loop at seven speeds, both ways, with a loop "
        "designed from the run's model. Ctrl-C stops it at any time.",
        (Experiment("constant-speed sweep", whole, 0.8 * _top_speed_m_s(axis, capabilities), torque, force, SWEEP_SECONDS + MOVE_SECONDS),),
    )


def move_plan(axis: Axis, travel_m: float, speed_m_s: float, torque_nm: float, force_n: float, seconds: float, what: str) -> Plan:
    """One move."""
    return Plan(
        f"The carriage of {axis.name or 'the axis'} will {what}. Ctrl-C stops it at any time.",
        (Experiment("move", travel_m, speed_m_s, torque_nm, force_n, seconds),),
    )


def verification_plan(axis: Axis, model: Model, path: Trajectory) -> Plan:
    """The move that verifies a design, with the positioning before it and the rest after it."""
    asked = demand(path, model)
    travel = float(np.ptp(path.position_m))
    seconds = path.duration_s + REST_SECONDS + MOVE_SECONDS
    what = f"go to {path.position_m[0]:.3f} m and from there to {path.position_m[-1]:.3f} m in {path.duration_s:.2f} s with the new gains"
    return move_plan(axis, travel, asked.speed_m_s, asked.torque_nm, asked.feed_force_n, seconds, what)


def _top_speed_m_s(axis: Axis, capabilities: Capabilities) -> float:
    return min(float(axis.limits.speed_m_s or 0.0), capabilities.max_speed_rad_s * axis.transmission_m_rad)


#: s, upper bounds of the parts, from the sequence's own constants: ramps both ways; five rising steps of 2.8 s; rest, run-in and
#: measured periods; strokes at seven speeds, three of them twice.
CREEP_SECONDS = 2.0 * (creep.RAMP_S + 0.5)
STEP_SECONDS = 3.0
RESPONSE_SECONDS = 7.5
MOVE_SECONDS = 2.0
SWEEP_SECONDS = 28.0
REST_SECONDS = 2.0


def _here(axis: Axis, capabilities: Capabilities) -> tuple[Experiment, ...]:
    torque = min(axis.torque_limit_nm, capabilities.peak_torque_nm)
    force = axis.belt_force_limit_n
    shaking = phases.BELT_SHARE * force
    ratio = axis.transmission_m_rad
    rising = creep.BREAKAWAY_SHARE * torque
    return (
        Experiment("sign and breakaway", phases.SIGN_TRAVEL_M, creep.CREEP_SPEED_M_S, rising, min(rising / ratio, force), CREEP_SECONDS),
        Experiment("excitation, rising in steps", phases.EXCITATION_TRAVEL_M, 0.5, torque, shaking, 3 * STEP_SECONDS),
        Experiment("frequency response here", phases.EXCITATION_TRAVEL_M, 0.5, torque, shaking, RESPONSE_SECONDS),
    )
