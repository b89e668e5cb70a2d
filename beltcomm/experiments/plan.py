"""Plan shown before anything moves: experiments with travel, speed, torque, belt force and seconds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.excitation import AS_CHOSEN, AskedExcitation
from beltcomm.experiments import friction_feedforward, gain_steps, own_strokes, phases, sampling_limits, stop_unit, stops_out_of_move
from beltcomm.experiments.bounds import (
    CREEP_SECONDS,
    Experiment,
    bounds_of,
    course_before,
    fastest_m_s,
    friction_before_nm,
    gentle_force_n,
    has_room,
    held_before_nm,
    lines_of,
    masses_kg,
    peak_torque_nm,
    stroking_nm,
    top_speed_m_s,
)
from beltcomm.experiments.plan_words import Point, commission_points, host_loss, identify_points, point_rows
from beltcomm.experiments.sign import sign_seconds, sign_words
from beltcomm.language import told, tr
from beltcomm.machine import creep
from beltcomm.machine.heat import HeatPlan, Thermal, heat_plan, path_rms_nm
from beltcomm.model import Model
from beltcomm.quantities import three_digits
from beltcomm.result import Row, plain, table
from beltcomm.schedule import record_schedule
from beltcomm.schedule.orders import fastest_stroke_m_s
from beltcomm.schedule.record_schedule import Extent
from beltcomm.schedule.sequences import excitation_travel_m, short_seconds
from beltcomm.schedule.steps import Step
from beltcomm.simulate.stopping import Braking, total_friction
from beltcomm.trajectory import Trajectory, plan_trajectory
from beltcomm.verify import demand

#: Of the points those on what moves and how far.
HOW_FAR = 2


@dataclass(frozen=True)
class Plan:
    """All experiments of a job.

    Attributes
    ----------
    budget_s : float
        Machine time that is kept, whatever the single experiments may take; what does not fit is left out.
    notes : tuple of str
        Lines after the table.
    visible : dict of str to Any or None
        What the records could show, where that was worked out.
    thermal : Thermal or None
        Of motor and drive, for the heat of the plan.
    verb : str
        That it is the plan of.
    window_m : tuple of float or None
        To be kept, from where it stands.
    host_loss : tuple of float or None
        s until the drive stops by itself when its host is silent, and how far it coasts then at most, m.
    host_loss_n : float or None
        Largest belt force until the drive has stopped when the host is lost in a move, N.
    stop_n : float or None
        Largest belt force in a stop that is asked for in a move, N, beside friction of the guide; None where it is in the experiments.
    span_m : tuple of float or None
        Ends of a move on the axis, stopping distance included, m.
    types_gains : bool
        The gains of its drive are set by a person only.
    bare : bool
        The text says no more than every plan does: that the axis moves by itself.
    """

    text: str
    experiments: tuple[Experiment, ...]
    budget_s: float = math.inf
    notes: tuple[str, ...] = ()
    visible: Mapping[str, Any] | None = None
    thermal: Thermal | None = None
    points: tuple[Point, ...] = ()
    verb: str = ""
    window_m: tuple[float, float] | None = None
    host_loss: tuple[float, float] | None = None
    host_loss_n: float | None = None
    stop_n: float | None = None
    span_m: tuple[float, float] | None = None
    types_gains: bool = False
    bare: bool = False

    @property
    def over_budget(self) -> bool:
        """True if some of it is left out when each record takes its longest."""
        return sum(item.seconds for item in self.experiments) > self.budget_s

    def said(self) -> str:
        """Words beside its numbers; empty for a job that needs none."""
        return "" if self.bare else self.text

    def written(self) -> str:
        """Fate of the drive's parameters."""
        if self.types_gains:
            return tr("gains cannot be written on this drive: it moves with those that stand in it")
        if self.verb == "commission":
            return tr("drive parameters: backed up, restored at the end unless you keep the gains")
        return tr("drive parameters: backed up and restored at the end")

    @property
    def seconds(self) -> float:
        """Machine time, s."""
        return min(sum(item.seconds for item in self.experiments), self.budget_s)

    @property
    def heat(self) -> HeatPlan | None:
        """Heat of the whole plan by its upper bounds; None where motor and drive are not known yet."""
        return heat_plan(self.thermal, ((e.heating_nm, e.seconds) for e in self.experiments)) if self.thermal else None

    def heat_fault(self, axis: Axis | None = None) -> str:
        """Reason in words why the motor would not bear the plan; "" when it does.

        Parameters
        ----------
        axis : Axis or None
            Whose file the remedy is looked for in.
        """
        if self.heat is None or self.thermal is None or self.heat.fullest <= 1.0:
            return ""
        hottest = max(self.experiments, key=lambda e: e.heating_nm**2 * e.seconds)
        remedy = (
            "check torque and feed force in axis.yaml, or choose slower motions"
            if axis is None or axis.limits.acceleration_m_s2 is not None
            else "state limits.acceleration_m_s2 in axis.yaml: without it motions are planned with all the torque that there is"
        )
        return (
            f"the motor would be overloaded: {hottest.title} takes up to {hottest.heating_nm:.3g} N m (rms) for {hottest.seconds:.0f} s, "
            f"rated are {self.thermal.rated_nm:.3g} N m, and {self.thermal.peak_nm:.3g} N m for {self.thermal.overload_s:g} s "
            f"({self.thermal.source}); {remedy}"
        )

    def heat_lines(self) -> list[str]:
        """The thermal share of the plan, with what it assumes."""
        heat, thermal = self.heat, self.thermal
        if heat is None or thermal is None:
            return []
        pauses = sum(heat.pauses_s)
        lines = [
            f"Thermal load (I²t): {100.0 * heat.continuous:.0f} % of the continuous rating (S1) on average, "
            f"{100.0 * heat.hottest:.0f} % in the hottest experiment: (rms torque / rated torque of {thermal.rated_nm:.3g} N m)², at most "
            "as in this table.",
            f"Of the short overload of {thermal.peak_nm:.3g} N m for {thermal.overload_s:g} s ({thermal.source}) "
            + (f"up to {100.0 * heat.fullest:.0f} % is used." if heat.fullest > 0.0 else "nothing is used."),
        ]
        return lines + (
            [f"The motor rests for up to {pauses:.0f} s in all between the experiments, so that it cools."] if pauses >= 1.0 else []
        )

    def heat_dict(self) -> dict[str, Any]:
        """For ``--json``; empty where it is not known."""
        return {"heat": plain(self.heat), "thermal": plain(self.thermal)} if self.heat else {}

    def summary(self) -> str:
        """The plan in one line, for the journal."""
        most = {name: max(getattr(e, name) for e in self.experiments) for name in ("reach_m", "speed_m_s", "torque_nm", "belt_force_n")}
        share = f", motor heat {100.0 * self.heat.continuous:.0f} % of continuous" if self.heat else ""
        return (
            f"{len(self.experiments)} experiments in up to {self.seconds:.0f} s, with stops up to {1e3 * most['reach_m']:.0f} mm, "
            f"{most['speed_m_s']:.3g} m/s, {most['torque_nm']:.3g} N m, {three_digits(most['belt_force_n'])} N{share}"
        )

    def lines(self) -> list[str]:
        """The plan as a paragraph, labelled lines, a table and notes."""
        thermal = self.thermal
        columns = ["experiment", ">travel", ">incl. stop", ">speed", ">torque", ">belt", ">time", *([">heat"] if thermal else [])]
        rows = [
            [
                told(e.title),
                f"{1e3 * e.travel_m:.0f} mm",
                f"{1e3 * e.reach_m:.0f} mm",
                f"{e.speed_m_s:.2f} m/s",
                f"{e.torque_nm:.2f} N m",
                f"{three_digits(e.belt_force_n)} N",
                f"{e.seconds:.0f} s",
                *([f"{100.0 * thermal.share(e.heating_nm):.0f} %"] if thermal else []),
            ]
            for e in self.experiments
        ]
        whole = sum(round(item.seconds) for item in self.experiments)  # what the column adds up to
        if whole > self.budget_s:
            rows.append([told("all of them, if each took its longest"), "", "", "", "", "", f"{whole} s"])
        rows.append([told("on the machine, at most"), "", "", "", "", "", f"{self.seconds:.0f} s"])
        return [self.text, *self.table(), "", *table(columns, rows), *self.heat_lines(), *self.notes]

    def table(self) -> list[Row]:
        """The points, and after how far it moves how fast, how hard and how long, by the table."""
        if not self.points:
            return []
        most = {name: max(getattr(e, name) for e in self.experiments) for name in ("speed_m_s", "torque_nm", "belt_force_n")}
        bounds = (
            ("how fast", f"up to {most['speed_m_s']:.3g} m/s"),
            ("how hard", f"up to {most['torque_nm']:.3g} N m at the motor and {three_digits(most['belt_force_n'])} N in the belt"),
            ("how long", f"up to {self.seconds:.0f} s" + ("; what does not fit is left out and named" if self.over_budget else "")),
        )
        return point_rows([*self.points[:HOW_FAR], *bounds, *self.points[HOW_FAR:]])


def _moves_by_itself(axis: Axis) -> str:
    return f"The carriage of {axis.name or 'the axis'} will move by itself."


def identify_plan(
    axis: Axis, capabilities: Capabilities, window_m: tuple[float, float] | None = None, asked: AskedExcitation = AS_CHOSEN
) -> Plan:
    """Sign check, rising excitation and one frequency response at the present place.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    window_m : tuple of float or None
        To be kept, from where it stands.
    asked : AskedExcitation
        Of the response.
    """
    return Plan(
        _moves_by_itself(axis),
        (
            *_here(axis, capabilities, window_m, asked),
            *(() if capabilities.gains == "unknown" else stop_unit.line(axis, capabilities, window_m)),
        ),
        notes=sampling_limits.notes_before(axis, capabilities),
        points=identify_points(axis, capabilities, window_m),
        verb="identify",
        window_m=window_m,
        host_loss=host_loss(axis, capabilities),
        bare=True,
    )


def commission_plan(axis: Axis, capabilities: Capabilities, extent: Extent = "standard") -> Plan:
    """The whole job.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    extent : Extent
        Of the records.

    Returns
    -------
    Plan
        Experiments in their order, with way, speed, torque, force and seconds, and bounds of the whole.
    """
    whole = axis.travel.length_m
    torque = peak_torque_nm(axis, capabilities)
    moved = _move_speed_m_s(axis, capabilities)
    lightest, heaviest = masses_kg(axis)
    course = course_before(axis, capabilities, heaviest)
    possible = [i.step for i in record_schedule.BY_EXTENT[extent] if i.rank == 0 or has_room(i.step, course)]
    steps = lines_of(axis, capabilities, possible)
    force = axis.belt_force_limit_n
    moving = _move_seconds(axis, capabilities) / (3.0 + MOVE_SECONDS)
    share = 1.0 if axis.targets.limits in axis.trajectories else phases.GENTLE_SHARE  # where none is stated the move is a gentle one
    at_rest = stroking_nm(axis, capabilities, 0.0)  # friction may stay wound up
    heating = math.sqrt(moving * stroking_nm(axis, capabilities, share) ** 2 + at_rest**2)
    move = Experiment("verification move", min(whole, axis.targets.way_m), whole, moved, torque, force, 3.0 + MOVE_SECONDS, heating)
    tried = (*stop_unit.line(axis, capabilities), *friction_feedforward.line(axis, capabilities))
    budget = record_schedule.BUDGET_S[extent] + (HOLDING_SECONDS if axis.mounting.tilted else 0.0) + sum(one.seconds for one in tried)
    return Plan(
        _moves_by_itself(axis),
        (*_here(axis, capabilities), *tried, *steps, move),
        budget,
        sampling_limits.notes_before(axis, capabilities),
        points=commission_points(axis, capabilities, lightest, (heaviest, fastest_m_s(axis, capabilities, possible, heaviest))),
        verb="commission",
        types_gains=capabilities.gains == "unknown",
        host_loss=host_loss(axis, capabilities),
        host_loss_n=None if capabilities.gains == "unknown" else stops_out_of_move.host_loss_limit_n(axis),
        stop_n=None if capabilities.gains == "unknown" else stops_out_of_move.stop_limit_n(axis),
        bare=True,
    )


def with_homing(plan: Plan, axis: Axis, capabilities: Capabilities) -> Plan:
    """The plan with the search of the drive's zero before everything else.

    Parameters
    ----------
    plan : Plan
        Of what follows.
    axis : Axis
    capabilities : Capabilities

    Returns
    -------
    Plan
        No longer bare.
    """
    whole = axis.travel.length_m
    torque = peak_torque_nm(axis, capabilities)
    speed = top_speed_m_s(axis, capabilities)
    rms = stroking_nm(axis, capabilities)
    first = Experiment("homing, until the zero is found", whole, whole, speed, torque, axis.belt_force_limit_n, HOMING_SECONDS, rms)
    text = "First the drive searches its zero, along the whole axis if need be, and the carriage creeps off the end where it was found. "
    return replace(plan, text=text + plan.text, bare=False, experiments=(first, *plan.experiments), budget_s=plan.budget_s + HOMING_SECONDS)


#: What a sweep does.
SWEPT = "travel its whole length in closed loop at seven speeds, both ways, with a loop designed from the run's model"


def friction_plan(axis: Axis, capabilities: Capabilities) -> Plan:
    """Plan of the friction sweep alone.

    Parameters
    ----------
    axis : Axis
    capabilities : Capabilities
    """
    kinds = capabilities.kinds
    seconds = SWEEP_SECONDS + MOVE_SECONDS + sign_seconds(axis, kinds) + own_strokes.longest_sweep_s(axis, capabilities)
    return Plan(
        tr("The carriage of {name} will {what}.", name=axis.name or tr("the axis"), what=f"{sign_words(axis, kinds)}{tr(SWEPT)}")
        + f"{own_strokes.unguarded_words(capabilities)}",
        (*friction_feedforward.line(axis, capabilities), _sweep(axis, capabilities, seconds)),
        verb="friction",
    )


def _sweep(axis: Axis, capabilities: Capabilities, seconds: float) -> Experiment:
    """The sweep with three of its speeds twice."""
    whole = axis.travel.length_m
    torque = peak_torque_nm(axis, capabilities)
    travel, speed = (1.0 - 2.0 * phases.stroke_share(capabilities)) * whole, _sweep_speed_m_s(axis, capabilities)
    # Where only the motor bounds the force, all of its torque all the time would be far from what a sweep takes.
    heating = stroking_nm(axis, capabilities) if axis.transmission is None else bounds_of(axis, capabilities, Step("sweep")).heating_nm
    return Experiment("constant-speed sweep", travel, whole, speed, torque, gentle_force_n(axis), seconds, heating)


def move_plan(
    axis: Axis,
    travel_m: float,
    reach_m: float,
    speed_m_s: float,
    torque_nm: float,
    force_n: float,
    seconds: float,
    what: str,
    rms_nm: float | None = None,
    verb: str = "move",
) -> Plan:
    """Plan of one move.

    Parameters
    ----------
    axis : Axis
        That is named.
    travel_m : float, m
        Way of the carriage.
    reach_m : float, m
        Largest distance that it may get from where it begins.
    speed_m_s : float, m/s
        Highest.
    torque_nm : float, N m, motor shaft
        Largest.
    force_n : float, N
        Largest belt force.
    seconds : float, s
        How long it takes.
    what : str
        What the carriage will do, as it follows "will".
    rms_nm : float or None, N m, motor shaft
        Torque that heats; None where it is not known.
    verb : str
        Of the command line.
    """
    return Plan(
        tr("The carriage of {name} will {what}.", name=axis.name or tr("the axis"), what=what),
        (Experiment("move", travel_m, reach_m, speed_m_s, torque_nm, force_n, seconds, rms_nm),),
        verb=verb,
    )


def verification_plan(
    axis: Axis, model: Model, path: Trajectory, braking: Braking, stops: stops_out_of_move.StopsOutOfMove, times: int = 1
) -> Plan:
    """The move that verifies a design, with the positioning before it and the rest after it.

    Parameters
    ----------
    axis : Axis
    model : Model
    path : Trajectory
        Of the carriage.
    braking : Braking
        Of its loop.
    stops : StopsOutOfMove
    times : int
        Driven.
    """
    asked = demand(path, model)
    travel = float(np.ptp(path.position_m))
    lowest, highest = braking.span_m(path.position_m, path.velocity_m_s, path.sample_period_s)
    seconds = times * (path.duration_s + REST_SECONDS + MOVE_SECONDS) + sign_seconds(axis)
    what = sign_words(axis) + tr(
        "go to {start:.3f} m and from there to {end:.3f} m in {s:.2f} s with the new gains{times}; a stop at its top speed takes "
        "{way:.0f} mm with {brake:.3g} m/s²",
        start=path.position_m[0],
        end=path.position_m[-1],
        s=path.duration_s,
        times=tr(", {count} times", count=times) if times > 1 else "",
        way=1e3 * braking.way_m(asked.speed_m_s),
        brake=braking.deceleration_m_s2,
    )
    held = held_before_nm(axis)
    ratio, friction = axis.transmission_m_rad, max(total_friction(model), friction_before_nm(axis))
    rms = path_rms_nm(path, model["motor.inertia"], ratio, model["cart.mass"], friction, held)
    at_rest = 1.0 - times * path.duration_s / seconds
    rms = math.sqrt((1.0 - at_rest) * rms**2 + at_rest * (friction + held) ** 2)
    plan = move_plan(axis, travel, highest - lowest, asked.speed_m_s, asked.torque_nm, asked.feed_force_n, seconds, what, rms, "verify")
    lost_n, stop_n = stops_out_of_move.host_loss_limit_n(axis), stops.asked_for.belt_force_n
    return replace(plan, host_loss_n=lost_n, stop_n=stop_n, span_m=(lowest, highest))


def _sweep_speed_m_s(axis: Axis, capabilities: Capabilities) -> float:
    """Fastest stroke over the whole travel with the lightest carriage that is thought of."""
    return fastest_stroke_m_s(course_before(axis, capabilities, masses_kg(axis)[0]).gentle, axis.travel.length_m)


def _move_seconds(axis: Axis, capabilities: Capabilities) -> float:
    """Least duration of the standard move, s: a longer one takes less torque by more than it takes longer."""
    limits = axis.trajectories.get(axis.targets.limits)
    whole = axis.travel.length_m
    if limits is None or whole <= 0.0:
        return MOVE_SECONDS
    return min(MOVE_SECONDS, plan_trajectory(0.0, min(whole, axis.targets.way_m), limits, capabilities.sample_period_s).duration_s)


def _move_speed_m_s(axis: Axis, capabilities: Capabilities) -> float:
    """Top speed of the standard move, before a heavy carriage slows it down."""
    top, limits = top_speed_m_s(axis, capabilities), axis.trajectories.get(axis.targets.limits)
    whole = axis.travel.length_m
    if limits is None or whole <= 0.0:
        return top
    path = plan_trajectory(0.0, min(whole, axis.targets.way_m), limits, capabilities.sample_period_s)
    return min(top, float(np.max(np.abs(path.velocity_m_s))))


#: s, upper bounds of the parts, from the sequence's own constants: rest, run-in and measured periods; strokes at seven speeds, three of
#: them twice.
RESPONSE_SECONDS = 7.5
MOVE_SECONDS = 2.0
SWEEP_SECONDS = 28.0
REST_SECONDS = 2.0
HOMING_SECONDS = 60.0
#: Of a tilted axis: the torque that holds it is felt for and crept around several times, then found in slow strokes and by an integrator.
HOLDING_CREEP_SECONDS, HOLDING_STROKES_SECONDS = 25.0, 15.0
HOLDING_SECONDS = HOLDING_CREEP_SECONDS + HOLDING_STROKES_SECONDS


def _here(
    axis: Axis, capabilities: Capabilities, window_m: tuple[float, float] | None = None, asked: AskedExcitation = AS_CHOSEN
) -> tuple[Experiment, ...]:
    widest = max(-window_m[0], window_m[1]) if window_m is not None else math.inf
    torque = min(axis.torque_limit_nm, capabilities.peak_torque_nm)
    force = axis.belt_force_limit_n
    shaking = phases.BELT_SHARE * force
    ratio = axis.transmission_m_rad
    tilted = axis.mounting.tilted
    rising = (creep.HELD_SHARE if tilted else creep.BREAKAWAY_SHARE) * torque
    top = top_speed_m_s(axis, capabilities)
    shaken = min(phases.EXCITATION_SPEED_M_S, top)
    shaken_m = excitation_travel_m(capabilities.sample_period_s)
    travel, reach = min(shaken_m, widest), min(shaken_m + phases.END_MARGIN_M, widest)
    held, slow = held_before_nm(axis), stroking_nm(axis, capabilities, 0.0)
    response_s = asked.seconds() or RESPONSE_SECONDS
    binary = math.hypot(phases.excitation_torque_nm(axis, capabilities, held), held)
    return (
        Experiment(
            "direction + breakaway",
            phases.SIGN_TRAVEL_M,
            min(phases.SIGN_REACH_M, widest),
            min(creep.CREEP_SPEED_M_S, top),
            rising,
            min(rising / ratio, force),
            HOLDING_CREEP_SECONDS if tilted else CREEP_SECONDS,
            rising / math.sqrt(3.0) + held,  # rms of a ramp
        ),
        *gain_steps.line(axis, capabilities),
        Experiment("excitation, rising", travel, reach, shaken, torque, shaking, 3 * short_seconds(capabilities.sample_period_s), binary),
        *([Experiment("holding torque, in slow creep", 5e-3, reach, 0.02, torque, force, HOLDING_STROKES_SECONDS, slow)] if tilted else []),
        Experiment("frequency response here", travel, reach, shaken, torque, shaking, response_s, binary),
    )
