"""A plan of records run on the machine, with a loop designed from the run's own model."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import count

from beltcomm.experiments import commission as sequence
from beltcomm.experiments import execute_step
from beltcomm.experiments.bounds import lines_of
from beltcomm.experiments.plan import Plan
from beltcomm.machine.heat import Thermal
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.rundata import delays
from beltcomm.rundata.findings import Findings
from beltcomm.schedule.next_plan import NextPlan


def motion_plan(machine: Machine, model: Model, wanted: NextPlan) -> Plan:
    """Plan shown before anything moves."""
    axis = machine.axis
    low, high = machine.envelope().window_m
    text = (
        f"The carriage of {axis.name or 'the axis'} will travel between {low:g} m and {high:g} m in closed loop, with a loop designed from "
        "the run's model, and is excited in place."
    )
    own = machine.drive.capabilities
    return Plan(text, tuple(lines_of(axis, own, wanted.steps, model)), thermal=Thermal.of(axis, own), verb="follow")


def follow(machine: Machine, model: Model, findings: Findings, wanted: NextPlan) -> list[str]:
    """Run all steps; returns the names of the records.   Raises what the machine raises; what is recorded stays."""
    machine.holding_nm = model.get("constant_offset.torque")
    cascade = sequence.close_first_loop(machine, findings, model)
    loop = execute_step.Closed(model, cascade, delays.delay(findings))
    taken = set(machine.folder.finished_names())
    made = []
    for step, name in zip(wanted.steps, _names(wanted, taken), strict=True):
        execute_step.make(machine, loop, step, name, machine.axis.torque_limit_nm)
        made.append(name)
    return made


def _names(wanted: NextPlan, taken: set[str]) -> Iterator[str]:
    """``next_1_response`` and so on, none twice."""
    numbers = count(1)
    for step in wanted.steps:
        number = next(n for n in numbers if not any(name.startswith(f"next_{n}_") for name in taken))
        yield f"next_{number}_{step.kind}"
