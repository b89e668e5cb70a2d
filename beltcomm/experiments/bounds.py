"""Upper bounds of what a step does to the machine, worked out from its own path before anything moves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.drive import Capabilities
from beltcomm.errors import BeltcommError, Refused
from beltcomm.experiments import phases
from beltcomm.experiments.execute_step import RESPONSE_S
from beltcomm.experiments.paths import Course, path_of, start_of
from beltcomm.machine import creep, gravity
from beltcomm.machine.heat import path_rms_nm
from beltcomm.model import Model
from beltcomm.schedule.sequences import excitation_travel_m
from beltcomm.schedule.steps import Step
from beltcomm.simulate.stopping import total_friction, unknown_loads_kg

#: s: ramps both ways, at most; and the rest after bringing the carriage somewhere, with a second try.
CREEP_SECONDS = 2.0 * (creep.RAMP_S + 0.5)
BRING_REST_S = 0.5
#: Share of the travel that lies between two places of a programme, as a rule.
BETWEEN_SHARE = 0.35
#: s: a response that is held out has one measured period.
HELD_RESPONSE_S = 4.0
#: Hz: slowest antiresonance thought of before the carriage is weighed; moves take so much longer to rise.
SLOWEST_HZ = 10.0


@dataclass(frozen=True)
class Experiment:
    """One line of the plan; every number is an upper bound.

    Attributes
    ----------
    travel_m : float
        Either way.
    torque_nm : float, motor shaft
    reach_m : float
        Travel either way with the way of a stop at any moment.
    rms_nm : float or None
        Torque that heats, None for ``torque_nm`` all the time.
    """

    title: str
    travel_m: float
    reach_m: float
    speed_m_s: float
    torque_nm: float
    belt_force_n: float
    seconds: float
    rms_nm: float | None = None

    @property
    def heating_nm(self) -> float:
        """Torque that heats the motor as much, if it acts all the time, N m."""
        return self.torque_nm if self.rms_nm is None else min(self.rms_nm, self.torque_nm)


def peak_torque_nm(axis: Axis, capabilities: Capabilities) -> float:
    """Peak torque that motor and drive both give, N m, motor shaft.

    Parameters
    ----------
    axis : Axis
        Data sheets; a peak that is not stated does not bound.
    capabilities : Capabilities
    """
    return min(axis.motor.peak_torque_nm or math.inf, capabilities.peak_torque_nm)


def friction_before_nm(axis: Axis) -> float:
    """Friction thought of before it is measured, N m at the motor.

    Parameters
    ----------
    axis : Axis
    """
    return gravity.FRICTION_SHARE * axis.torque_limit_nm


def held_before_nm(axis: Axis) -> float:
    """Holding torque of a tilted axis by axis.yaml, N m.

    Parameters
    ----------
    axis : Axis
    """
    return abs(gravity.expected(axis).torque_nm) if axis.mounting.tilted else 0.0


def stroking_nm(axis: Axis, capabilities: Capabilities, share: float = phases.GENTLE_SHARE) -> float:
    """Torque with which a share of the belt's force is used to accelerate the lightest carriage, beside friction and gravity, N m.

    Gentle motions, which nobody asked for, take no more than the motor bears for ever.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    share : float
        Of the belt's force; 0 leaves friction and gravity.

    Returns
    -------
    float, N m
        Motor shaft.
    """
    ratio = axis.transmission_m_rad
    force = share * axis.belt_force_limit_n
    acceleration = min(axis.limits.acceleration_m_s2 or math.inf, force / masses_kg(axis)[0])
    held = held_before_nm(axis)
    torque = ratio * force + axis.motor_side_inertia_kg_m2 / ratio * acceleration + friction_before_nm(axis) + held
    return torque if share > phases.GENTLE_SHARE else min(torque, math.hypot(phases.excitation_torque_nm(axis, capabilities, held), held))


def course_before(axis: Axis, capabilities: Capabilities, mass_kg: float) -> Course:
    """Limits of motions with a carriage of this mass, from the data sheets alone.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    mass_kg : float, kg
        Carriage with payload.

    Returns
    -------
    Course
        Ends of travel and strokes, m, limits of gentle and of fast motions at the carriage, and the sampling period.
    """
    low, high = axis.travel.ends_m
    margin = phases.stroke_share(capabilities) * (high - low)
    top = phases.SPEED_SHARE * top_speed_m_s(axis, capabilities)
    borne = phases.excitation_torque_nm(axis, capabilities, held_before_nm(axis))  # moves that follow each other may heat no more
    by_torque = phases.acceleration_m_s2(axis.motor_side_inertia_kg_m2, axis.transmission_m_rad, mass_kg, borne, friction_before_nm(axis))
    most = min(axis.limits.acceleration_m_s2 or math.inf, axis.belt_force_limit_n / mass_kg, by_torque)
    gentle = min(most, phases.GENTLE_SHARE * axis.belt_force_limit_n / mass_kg)
    return Course(
        (low, high),
        (low + margin, high - margin),
        TrajectoryLimits(jerk_m_s3=20.0 * gentle, acceleration_m_s2=gentle, speed_m_s=top),
        TrajectoryLimits(jerk_m_s3=SLOWEST_HZ * most, acceleration_m_s2=most, speed_m_s=top),
        capabilities.sample_period_s,
    )


def gentle_force_n(axis: Axis) -> float:
    """Belt force of strokes, N: a third of its limit, and on a tilted axis the weight it carries all the time.

    Parameters
    ----------
    axis : Axis
    """
    held = abs(gravity.expected(axis).torque_nm) / axis.transmission_m_rad if axis.mounting.tilted else 0.0
    return phases.GENTLE_SHARE * axis.belt_force_limit_n + held


def top_speed_m_s(axis: Axis, capabilities: Capabilities) -> float:
    """Speed that axis and drive allow, m/s.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    return min(float(axis.limits.speed_m_s or 0.0), capabilities.max_speed_rad_s * axis.transmission_m_rad)


def masses_kg(axis: Axis, model: Model | None = None) -> tuple[float, float]:
    """Lightest and heaviest carriage to count with.

    Parameters
    ----------
    axis : Axis
    model : Model or None
        None while none is known.
    """
    if model is not None:
        return model["cart.mass"], model["cart.mass"]
    stated = axis.payload.mass_kg or 0.0
    loads = unknown_loads_kg(axis)
    return max(loads[0], stated), max(loads[-1], stated)


def seconds_of(step: Step, course: Course) -> float:
    """Duration of a step with these limits, bringing the carriage there from the step before included, s.

    Parameters
    ----------
    step : Step
    course : Course

    Raises
    ------
    Refused
        For a step that cannot be made.
    """
    low, high = course.window_m
    speed = min(phases.POSITIONING_SPEED_M_S, course.gentle.speed_m_s)
    bring = BETWEEN_SHARE * (high - low) / speed + speed / course.gentle.acceleration_m_s2 + BRING_REST_S
    if step.kind == "response":
        return bring + (HELD_RESPONSE_S if step.held_out else step.seconds or RESPONSE_S)
    return bring + path_of(step, course, start_of(step, course)).duration_s


def has_room(step: Step, course: Course) -> bool:
    """True if a step can be made within a travel at all.

    Parameters
    ----------
    step : Step
    course : Course
    """
    try:
        seconds_of(step, course)
    except Refused:
        return False
    return True


def bounds_of(axis: Axis, capabilities: Capabilities, step: Step, model: Model | None = None) -> Experiment:
    """One line of the plan.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    step : Step
    model : Model or None
        Of the axis; without one the slowest and the fastest carriage that is thought of count.
    """
    light, heavy = (course_before(axis, capabilities, mass) for mass in masses_kg(axis, model))
    whole = heavy.window_m[1] - heavy.window_m[0]
    torque = peak_torque_nm(axis, capabilities)
    force = axis.belt_force_limit_n
    top = top_speed_m_s(axis, capabilities)
    share = {"response": phases.BELT_SHARE, "moves": step.share}.get(step.kind, phases.GENTLE_SHARE)
    paths = []
    friction, held = (total_friction(model) if model is not None else friction_before_nm(axis)), held_before_nm(axis)
    heating = phases.excitation_torque_nm(axis, capabilities, held) if step.kind == "response" else 0.0
    for course, mass in zip((light, heavy), masses_kg(axis, model), strict=True):
        if step.kind != "response":
            path = path_of(step, course, start_of(step, course))
            paths.append(path)
            own = path_rms_nm(path, axis.motor_side_inertia_kg_m2, axis.transmission_m_rad, mass, friction, held)
            heating = max(heating, own)
    fastest = max([float(np.max(np.abs(p.velocity_m_s))) for p in paths], default=phases.EXCITATION_SPEED_M_S)
    speed = min(max(fastest, phases.POSITIONING_SPEED_M_S), top)
    travel = max([float(np.ptp(p.position_m)) for p in paths], default=excitation_travel_m(capabilities.sample_period_s))
    seconds = max(seconds_of(step, course) for course in (light, heavy)) + BRING_REST_S
    return Experiment(step.title(heavy.place_m(step)), travel, whole, speed, torque, share * force, seconds, heating)


def fastest_m_s(axis: Axis, capabilities: Capabilities, steps: Sequence[Step], mass_kg: float) -> float:
    """Fastest motion of several steps with a carriage of this mass, m/s.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    steps : sequence of Step
        Of a record schedule.
    mass_kg : float, kg
        Carriage with payload.
    """
    course = course_before(axis, capabilities, mass_kg)
    paths = [path_of(step, course, start_of(step, course)) for step in steps if step.kind != "response"]
    return max((float(np.max(np.abs(path.velocity_m_s))) for path in paths), default=0.0)


def lines_of(axis: Axis, capabilities: Capabilities, steps: Sequence[Step], model: Model | None = None) -> list[Experiment]:
    """The plan's lines of several steps.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    steps : sequence of Step
        In their order.
    model : Model or None
        Of the axis; None while none is known.

    Raises
    ------
    BeltcommError
        Naming the step that cannot be.
    """
    lines = []
    for number, step in enumerate(steps, start=1):
        try:
            lines.append(bounds_of(axis, capabilities, step, model))
        except BeltcommError as problem:
            raise type(problem)(f"step {number} ({step.kind}): {problem}") from problem
    return lines
