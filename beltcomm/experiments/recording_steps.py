"""Phase 5 of a commissioning: its records, as many as the time allows, quieter and slower where the machine demands it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from beltcomm.control import Cascade
from beltcomm.errors import DataError, NoMotion, Refused, SafetyStop
from beltcomm.experiments import bounds, execute_step, friction_feedforward, own_strokes, phases
from beltcomm.experiments.recentre import MOST_STOPS, QUIETER, bring_back, lags_behind, may_not_excite
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.rundata.delays import delay
from beltcomm.rundata.findings import Findings
from beltcomm.schedule import record_schedule
from beltcomm.schedule.orders import SWEEP_LONGEST_S
from beltcomm.schedule.record_schedule import Extent

#: s of machine time kept for the move that verifies, with the way to its start.
VERIFYING_S = 4.0
#: The same for a velocity loop, which follows slow moves only and takes several tries to arrive anywhere.
DRIFTING_S = 22.0
#: What follows a path that a first loop was left behind by is driven so many times slower, and no slower than that in all.
SLOWER, SLOWEST_PACE = 0.5, 0.13
#: s of machine time that finding sign and breakaway takes as a rule.
CREPT_S = 2.0


def record_steps(machine: Machine, findings: Findings, model: Model, cascade: Cascade | None, extent: Extent) -> None:
    """Phase 5: the records of the programme, as many as the time allows.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    model : Model
    extent : Extent
        Which programme.
    cascade : Cascade or None
        That is in the drive, None where nobody knows it.
    """
    machine.begin(record_schedule.TITLES[5])
    loop = friction_feedforward.with_friction_of_strokes(machine, execute_step.Closed(model, cascade, delay(findings)))
    course = execute_step.course_of(machine, model)
    items = [
        i
        for i in record_schedule.BY_EXTENT[extent]
        if not execute_step.is_measured(machine, i.step) and (i.rank == 0 or bounds.has_room(i.step, course))
    ]
    for item in record_schedule.BY_EXTENT[extent]:
        if execute_step.is_measured(machine, item.step):
            machine.detail(f"{item.step.title(course.place_m(item.step))}: frf_1 was recorded near there, and stands for it")
    kept = VERIFYING_S
    if machine.stroking() == "velocity":  # which drifts, and does not turn within a millimetre; its last move is a slow one
        items = [item for item in items if item.step.kind != "reversals"]
        kept = DRIFTING_S
    first = [
        machine.folder.recording(n)
        for n in machine.folder.finished_names()
        if n.startswith(("amplitude_", "short_strokes_")) or n == "frf_1"
    ]
    spent = CREPT_S + findings.calibrating_s + sum(r.duration_s for r in first)
    left = record_schedule.BUDGET_S[extent] - spent - kept
    steps, without = record_schedule.fitting_records(items, lambda step: bounds.seconds_of(step, course), left)
    if without:
        names = "; ".join(step.title(course.place_m(step)) for step in without)
        longer = "; --thorough has time for more" if extent == "standard" else ""
        findings.remarks.append(
            f"not recorded, for {record_schedule.BUDGET_S[extent]:.0f} s of machine time are not enough: {names}{longer}"
        )
    loudest = findings.excited.step.amplitude_nm if findings.excited else machine.axis.torque_limit_nm
    share = pace = 1.0
    needed = [item.step for item in items if item.rank == 0]
    for name, step in record_schedule.named_steps(steps, ("frf_1",)):
        left_out = f"{name} ({step.title(course.place_m(step))}) was left out"
        if step.kind == "response" and may_not_excite(machine):
            findings.remarks.append(f"{left_out}: the carriage went too far {MOST_STOPS} times before")
            continue
        while True:
            try:
                execute_step.make(machine, loop, step, name, loudest, share, pace)
            except SafetyStop as problem:
                behind = lags_behind(machine, step.kind, problem)
                if behind and pace > SLOWEST_PACE:
                    pace *= SLOWER
                    findings.remarks.append(f"{name} and what follows are driven at {pace:.2g} times their speed, after this: {problem}")
                    continue  # the model does not quite know how far this machine goes: again, and all that follow, quieter
                if step in needed if behind else not bring_back(machine, model, step, problem):
                    raise
                if not behind and not may_not_excite(machine):
                    share *= QUIETER
                    findings.remarks.append(f"{name} is made with {share:.2g} times the torque, after this: {problem}")
                    continue
                findings.remarks.append(f"{left_out}: {problem}")
            except (DataError, Refused) as problem:  # the result does not rest on this record
                if step in needed and not (isinstance(problem, NoMotion) and step.kind == "response"):
                    raise
                findings.remarks.append(f"{left_out}: {problem}")
            break
        if name == execute_step.SWEEP:
            loop = friction_feedforward.with_measured_friction(machine, findings, loop)


def quick_sweep(machine: Machine, findings: Findings, model: Model) -> None:
    """The sweep of a quick commissioning, slower where the first loop lags behind it.

    Parameters
    ----------
    machine : Machine
    findings : Findings
    model : Model
    """
    speeds = record_schedule.quick_speeds_m_s(phases.gentle_limits(machine, model, np.inf).acceleration_m_s2)
    pace = 1.0
    while True:
        try:
            asked = [pace * speed for speed in speeds]
            measure_friction(machine, model, speeds_m_s=asked, longest_s=record_schedule.QUICK_PLATEAU_S)
            return
        except SafetyStop as problem:
            if not lags_behind(machine, "sweep", problem) or pace <= SLOWEST_PACE:
                raise
            pace *= SLOWER
            findings.remarks.append(f"the sweep is driven at {pace:.2g} times its speeds, after this: {problem}")


def measure_friction(
    machine: Machine,
    model: Model,
    name: str = "sweep",
    speeds_m_s: Sequence[float] = (),
    longest_s: float = SWEEP_LONGEST_S,
    held_out: bool = False,
) -> Recording:
    """The constant-speed sweep alone, three of its speeds twice.

    Parameters
    ----------
    machine : Machine
    model : Model
    name : str
        Of the record.
    speeds_m_s : sequence of float
        Instead of the usual seven, each once.
    longest_s : float, s
        That a plateau counts at most.
    held_out : bool
        It judges, nothing is fitted to it.
    """
    machine.begin(record_schedule.TITLES[5])
    if machine.folder.finished(name) is None:
        friction_feedforward.learn_friction(machine, model)
        first, last = phases.stroke_ends(machine)
        if not phases.room_to_sweep(machine, model, speeds_m_s):
            phases.move_to(machine, first, model)
        elif not first <= machine.position_m <= last:  # where a sweep before it was stopped: nothing is left there for an overshoot
            phases.move_to(machine, min(max(machine.position_m, first), last), model)
    strokes = phases.sweep(machine, model, speeds_m_s, longest_s)
    sidecar = phases.sidecar(machine, "friction_sweep", held_out=held_out, extra=own_strokes.note(machine))
    return machine.record(name, machine.follow(strokes.trajectory, machine.stroking()), phases.stroke_envelope(machine), sidecar)
