"""A plan of records run on the machine, with a loop designed from the run's own model."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from beltcomm.errors import Refused
from beltcomm.model import Model
from beltcomm.session import commission as sequence
from beltcomm.session import phases, plan
from beltcomm.session.commission import Findings
from beltcomm.session.machine import Machine
from beltcomm.session.next_plan import NextPlan, Step
from beltcomm.session.plan import Experiment, Plan
from beltcomm.sidecar import Sidecar
from beltcomm.trajectory import constant_speed_strokes

#: m: half the way of slow strokes around their place; s: run-in, rest and longest plateau of them.
AROUND_M = 0.05
RUN_IN_S, REST_S, LONGEST_S = 0.1, 0.15, 0.7
#: s: upper bound of a set of slow strokes.
STROKES_SECONDS = 16.0


def motion_plan(machine: Machine, model: Model, wanted: NextPlan) -> Plan:
    """What will happen to the machine, before it happens."""
    limits = phases.gentle_limits(machine, model, np.inf)
    axis, room = machine.axis, machine.full_room()
    low, high = room.window_m
    whole = high - low
    force = axis.belt_force_limit_n
    lines = []
    for number, step in enumerate(wanted.steps, start=1):
        seconds = {
            "response": plan.RESPONSE_SECONDS,
            "strokes": STROKES_SECONDS,
            "sweep": plan.SWEEP_SECONDS,
        }[step.kind] + plan.MOVE_SECONDS
        share = phases.BELT_SHARE if step.kind == "response" else 1.0 / 3.0
        title = f"{number}. {step.kind}" + ("" if step.kind == "sweep" else f" at {low + step.place * whole:.2f} m")
        speed = {
            "response": min(phases.POSITIONING_SPEED_M_S, room.speed_m_s),
            "strokes": max([phases.POSITIONING_SPEED_M_S, *step.speeds_m_s]),
            "sweep": phases.fastest_stroke_m_s(limits.speed_m_s, limits.acceleration_m_s2, whole),
        }[step.kind]
        lines.append(Experiment(title, whole, whole, speed, room.torque_nm, share * force, seconds))
    text = (
        f"The carriage of {axis.name or 'the axis'} will travel between {low:g} m and {high:g} m in closed loop, with a loop designed from "
        "the run's model, and shake where it stands. Keep people and tools out of its travel; Ctrl-C stops it at any time."
    )
    return Plan(text, tuple(lines))


def follow(machine: Machine, model: Model, findings: Findings, wanted: NextPlan) -> list[str]:
    """Run all steps; returns the names of the records.   Raises what the machine raises; what is recorded stays."""
    sequence.close_first_loop(machine, findings, model)
    taken = set(machine.folder.finished_names())
    made = []
    for step, name in zip(wanted.steps, _names(wanted, taken), strict=True):
        machine.talk.say(f"{name}: {step.words()}")
        if step.kind == "sweep":
            sequence.measure_friction(machine, model, name)
        elif step.kind == "response":
            phases.move_to(machine, place_of(machine, step), model)
            phases.frequency_response(machine, name, model, step.share * machine.axis.torque_limit_nm, sequence.RESPONSE_S)
        else:
            slow_strokes(machine, model, step, name)
        made.append(name)
    return made


def slow_strokes(machine: Machine, model: Model, step: Step, name: str) -> None:
    """Short strokes at slow speeds around a place."""
    middle = place_of(machine, step)
    low, high = phases.stroke_ends(machine)
    start, end = max(low, middle - AROUND_M), min(high, middle + AROUND_M)
    if end - start < AROUND_M:
        raise Refused(f"there is no room for slow strokes around {middle:.3f} m: strokes may turn between {low:.3f} m and {high:.3f} m")
    phases.move_to(machine, start, model)
    at = machine.position_m
    limits = phases.gentle_limits(machine, model, np.inf)
    period = machine.drive.capabilities.sample_period_s
    speeds = [min(v, limits.speed_m_s) for v in step.speeds_m_s]
    strokes = constant_speed_strokes(at, end, speeds, limits, period, run_in_s=RUN_IN_S, rest_s=REST_S, longest_plateau_s=LONGEST_S)
    sidecar = Sidecar(
        experiment="friction_sweep",
        start_position_m=at,
        session_time_s=machine.session_time_s,
        closed_loop=True,
        held_out=step.held_out,
    )
    machine.record(name, machine.follow(strokes.trajectory, machine.stroking()), phases.loose_room(machine), sidecar)


def place_of(machine: Machine, step: Step) -> float:
    """Where a step happens, m."""
    low, high = machine.full_room().window_m
    return low + step.place * (high - low)


def _names(wanted: NextPlan, taken: set[str]) -> Iterator[str]:
    """``next_1_response`` and so on, none twice."""
    number = 0
    for step in wanted.steps:
        number += 1
        while any(name.startswith(f"next_{number}_") for name in taken):
            number += 1
        yield f"next_{number}_{step.kind}"
