"""``beltcomm identify --plan``: run a plan of records on a connected drive, into the run that it was written for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from beltcomm.drive import Drive
from beltcomm.experiments import referencing
from beltcomm.experiments.options import Options, admit_edited, claim, settings_of
from beltcomm.experiments.plan import Plan
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.experiments.run_plan import follow, motion_plan
from beltcomm.experiments.sign import check_sign
from beltcomm.given import pasted
from beltcomm.machine.machine import Machine
from beltcomm.result import Result, plain
from beltcomm.rundata import offline
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.next_plan import load_plan
from beltcomm.talk import Silence, Talk


def follow_plan(drive: Drive, run: Path, file: Path, options: Options, agree: Callable[[Plan, Machine], None], talk: Talk) -> Result:
    """Run the records of a plan file into an existing run.

    Parameters
    ----------
    agree : callable
        Shows what will move, raises Refused for a no, and homes if asked.
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
        shown = motion_plan(machine, model, wanted)
        if options.dry_run:
            return Result(
                {"plan": plain(shown), "seconds": shown.seconds},
                [*plan_screen(shown, folder.axis, drive.capabilities), "", "Nothing was moved (--dry-run)."],
                details=shown.lines(),
            )
        agree(shown, machine)
        check_sign(machine)
        made = follow(machine, model, findings, wanted)
    text = [f"Recorded {', '.join(made)} in {folder.recordings_folder}.", f"Next: beltcomm diagnose {pasted(run)}"]
    return Result({"run": str(run), "recordings": made, "reasons": dict(wanted.reasons)}, text)
