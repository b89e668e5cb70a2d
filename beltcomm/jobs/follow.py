"""``beltcomm identify --plan``: run a plan of records on a connected drive, into the run that it was written for."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

from beltcomm.drive import Drive
from beltcomm.experiments import commission as sequence
from beltcomm.experiments import execute_step, referencing
from beltcomm.experiments.bounds import lines_of
from beltcomm.experiments.options import Options, admit_edited, claim, settings_of
from beltcomm.experiments.plan import Plan
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.experiments.sign import check_sign
from beltcomm.given import pasted
from beltcomm.machine.heat import Thermal
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.result import Result, plain
from beltcomm.rundata import delays, offline
from beltcomm.rundata.findings import Findings
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.next_plan import NextPlan, load_plan
from beltcomm.talk import Silence, Talk


def follow_plan(drive: Drive, run: Path, file: Path, options: Options, agree: Callable[[Plan, Machine], None], talk: Talk) -> Result:
    """Run the records of a plan file into an existing run.

    Parameters
    ----------
    drive : Drive
        Connected.
    run : Path
    file : Path
        Of the plan.
    options : Options
        Settings of the session.
    agree : callable
        Shows what will move, raises Refused for a no, and homes if asked.
    talk : Talk
    """
    wanted = load_plan(file)
    folder = RunFolder.open(run)
    model = offline.trusted_revision(folder)[0]
    claim(folder, drive.capabilities, options, talk)
    if not options.dry_run:
        admit_edited(str(file), wanted.edited, options, talk)
    findings = offline.fit_run(folder, "lm", Silence(), model)
    with Machine(drive, folder.axis, folder, talk) as machine:
        referencing.reference(machine, settings_of(options))
        shown = _motion_plan(machine, model, wanted)
        if options.dry_run:
            return Result(
                {"plan": plain(shown), "seconds": shown.seconds},
                [*plan_screen(shown, folder.axis, drive.capabilities), "", "Nothing was moved (--dry-run)."],
                details=shown.lines(),
            )
        agree(shown, machine)
        check_sign(machine)
        made = _follow(machine, model, findings, wanted)
    text = [f"Recorded {', '.join(made)} in {folder.recordings_folder}.", f"Next: beltcomm diagnose {pasted(run)}"]
    return Result({"run": str(run), "recordings": made, "reasons": dict(wanted.reasons)}, text)


def _motion_plan(machine: Machine, model: Model, wanted: NextPlan) -> Plan:
    """Plan shown before anything moves."""
    axis = machine.axis
    low, high = machine.envelope().window_m
    text = (
        f"The carriage of {axis.name or 'the axis'} will travel between {low:g} m and {high:g} m in closed loop, with a loop designed from "
        "the run's model, and is excited in place."
    )
    own = machine.drive.capabilities
    return Plan(text, tuple(lines_of(axis, own, wanted.steps, model)), thermal=Thermal.of(axis, own), verb="follow")


def _follow(machine: Machine, model: Model, findings: Findings, wanted: NextPlan) -> list[str]:
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
