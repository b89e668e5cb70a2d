"""``beltcomm apply`` and ``beltcomm rollback`` on a connected drive: what is wanted, the writing, a small move that shows it, saving."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.drive import Drive
from beltcomm.drive.objects import COMMUNICATION, ObjectValue, is_command
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.errors import BeltcommError, Refused, UsageError
from beltcomm.experiments import phases, referencing, verification
from beltcomm.experiments.options import Options, admit_edited, claim, settings_of
from beltcomm.experiments.plan import Plan, verification_plan
from beltcomm.experiments.proving import verify_move
from beltcomm.experiments.sign import check_sign
from beltcomm.foreign.eds import ObjectFile, load_object_file
from beltcomm.given import pasted
from beltcomm.machine import gains, stops
from beltcomm.machine.machine import Machine
from beltcomm.machine.ratings import fault_of, tell_ratings
from beltcomm.machine.writable import Writable, begun_with, titles
from beltcomm.result import Result, plain
from beltcomm.rundata import backups, offline
from beltcomm.rundata.calibration import recall
from beltcomm.rundata.proof import admit
from beltcomm.rundata.store import cascade_from_dict, saved_design
from beltcomm.runfolder import RunFolder, next_free
from beltcomm.sentences import typed_gains, words
from beltcomm.talk import Talk
from beltcomm.trajectory import plan_trajectory
from beltcomm.verify import AS_PREDICTED, SLACK_M, Verdict

#: m and m/s of the move that shows whether the gains do in the drive what they were designed for.
SMALL_M, SMALL_M_S = 0.05, 0.2


def apply_to(
    drive: Drive,
    name: str,
    folder: RunFolder,
    options: Options,
    talk: Talk,
    agree: Callable[[Plan, Machine], None],
    *,
    dcf: Path | None,
    shown: bool,
) -> Result:
    """The run's design, or a file's values, into its drive.

    Parameters
    ----------
    drive : Drive
        Connected.
    name : str
        Of the drive.
    folder : RunFolder
    options : Options
        Settings of the session.
    talk : Talk
    agree : callable
        Shows what will move and raises Refused for a no.
    dcf : Path or None
        File that is written in place of the design; None for none.
    shown : bool
        By a small move, before anything is saved.

    Raises
    ------
    Refused, UsageError, DataError, ObjectLocked, DriveError
        A drive whose move fails has its values from before again.
    """
    claim(folder, drive.capabilities, options, talk)
    if folder.has_axis:
        tell_ratings(folder.axis, drive.capabilities, talk)  # gains count in parts of the rated torque
    recall(drive, folder)
    remarks: list[str] = []
    if dcf is None and drive.capabilities.gains == "unknown":
        typed = "; ".join(line.strip() for line in typed_gains.of_run(folder, cascade_from_dict(saved_design(folder)))[1:])
        raise Refused(
            f"nothing was written: nobody knows where {drive.capabilities.name} has its gains, or what they mean. To be typed into the "
            f"maker's "
            f"tool: {typed}; then `beltcomm verify` drives a move with them"
        )
    if dcf is None:
        found = gains.named_differences(drive, folder, cascade_to_parameters(cascade_from_dict(saved_design(folder))))
    else:
        read = load_object_file(dcf)
        talk.say(*read.lines())
        wanted, left = _of_file(read, drive)
        found = gains.differences(drive, folder, wanted, left)
    if options.dry_run:
        return _planned(folder, found)
    question = "Then the carriage makes a small move, asked for by itself." if shown else "Nothing moves."
    verb = f"apply of {dcf.name}" if dcf is not None else "apply"
    gains.write(drive, folder, found, talk, yes=options.yes, verb=verb, question=question)
    verdict = _show(drive, folder, options, talk, found, agree) if shown else None
    return _done(drive, name, folder, found, options, "applied", remarks, verdict)


def roll_back(drive: Drive, name: str, folder: RunFolder, which: str | None, options: Options, talk: Talk) -> Result:
    """A backup into its drive.

    Parameters
    ----------
    drive : Drive
        Connected.
    name : str
        Of the drive, for what to do next.
    folder : RunFolder
    which : str or None
        Its name or path; None is the one from before the run. Nothing moves.
    options : Options
        Settings of the session.
    talk : Talk
    """
    backup = backups.choose_backup(folder, which)
    claim(folder, drive.capabilities, options, talk)
    backups.same_drive(backup, drive)
    recall(drive, folder)
    if unread := begun_with(folder)[1]:
        talk.say(f"{unread}; limits are held against axis.yaml and what the drive has now")
    if folder.has_axis:  # raw values come back as they were, whatever they count in
        talk.say(*filter(None, (fault_of(folder.axis, drive.capabilities), *drive.capabilities.cautions)))
    found = gains.differences(drive, folder, backups.values_to_restore(backup, drive))
    if options.dry_run:
        return _planned(folder, found)
    admit_edited(str(backup.path), backup.edited and bool(found.changes), options, talk)
    gains.write(drive, folder, found, talk, yes=options.yes, verb=f"rollback to {backup.name}")
    return _done(drive, name, folder, found, options, f"rolled back to {backup.name} of {backup.when} UTC", [], None)


def admitted(folder: RunFolder, options: Options, talk: Talk, dcf: Path | None, shown: bool) -> None:
    """Ask, before a drive is connected, that the run's design may be written.

    Parameters
    ----------
    folder : RunFolder
    options : Options
        Consent and force.
    talk : Talk
    dcf : Path or None
        File that is written in place of the design; None for none.
    shown : bool
        True if a move is to verify what was written.

    Raises
    ------
    Refused
        For a no, or a design that is not to be trusted.
    UsageError
        For a file and a move together.
    DataError
        Without a design.
    """
    if dcf is not None:
        if shown:
            raise UsageError("what a file holds has no prediction that a move could show; apply it without --verify")
        return
    saved = saved_design(folder)
    cascade_from_dict(saved)
    for line in words.remarks_lines(saved.get("remarks") or ()):
        talk.say(line)
    if not options.dry_run:
        admit(folder, talk, yes=options.yes, force=options.force)


def backup_list(folder: RunFolder) -> Result:
    """All backups of a run; no drive is needed.

    Parameters
    ----------
    folder : RunFolder
    """
    found = backups.list_backups(folder)
    data = [{"name": one.name, "file": str(one.path), "when": one.when, "before": one.before} for one in found]
    text = ["Backups of this run:", *backups.list_lines(found)]
    return Result(
        {"run": str(folder.path), "backups": data},
        [*text, f"Next: beltcomm rollback --drive DRIVE --run {pasted(folder.path)} --backup NAME"],
    )


def _of_file(read: ObjectFile, drive: Drive) -> tuple[list[ObjectValue], list[str]]:
    """Entries of a file that are written, and in words those left alone: it may hold a whole drive, for another tool."""
    kept = Writable.of(drive).kinds
    orders = [item for item in read.values if is_command(*item.place)]
    wanted = [item for item in read.values if item.place in kept and item not in orders and item.index not in COMMUNICATION]
    others = [item for item in read.values if item not in orders and item not in wanted]
    left = []
    for why, items in (("they are commands and no settings", orders), ("beltcomm does not back them up", others)):
        if items:
            left.append(f"left alone, for {why}: {titles(item.title for item in items)}")
    return wanted, left


def _planned(folder: RunFolder, found: gains.Differences) -> Result:
    return Result(_data(folder, found, written=False, saved=False), ["Would change:", *found.table(), "Nothing was written (--dry-run)."])


def _data(folder: RunFolder, found: gains.Differences, *, written: bool, saved: bool) -> dict[str, Any]:
    changes = [one.to_dict() for one in found.changes]
    return {"run": str(folder.path), "changes": plain(changes), "left_out": list(found.left_out), "written": written, "saved": saved}


def _done(
    drive: Drive,
    name: str,
    folder: RunFolder,
    found: gains.Differences,
    options: Options,
    verb: str,
    remarks: list[str],
    verdict: Verdict | None,
) -> Result:
    """Save when it was asked for, and say what was done."""
    save = options.apply == "save"
    if save:
        drive.save()
        folder.journal(f"{verb}: saved in the drive for good")
    how = "and saved" if save else "until power-off (--save makes it permanent)"
    nothing = "" if found.changes else " (nothing differed from what the drive had)"
    text = [f"{len(found.changes)} objects {verb}, read back, {how}{nothing}{words.lasting(name)}.", *words.remarks_lines(remarks)]
    data = _data(folder, found, written=True, saved=save)
    if verdict is not None:
        text[:0] = words.verdict_lines(verdict, None)
        data["verdict"] = verdict
    return Result(data, text)


def _show(
    drive: Drive, folder: RunFolder, options: Options, talk: Talk, found: gains.Differences, agree: Callable[[Plan, Machine], None]
) -> Verdict:
    """A small move with what now stands in the drive; otherwise than predicted, and all is put back.   Raises what the move raises."""
    saved = saved_design(folder)
    model = offline.design_model(folder, saved)
    cascade, delay_s = offline.cascade_of(saved, model, drive.capabilities.structure)
    try:
        with Machine(drive, folder.axis, folder, talk) as machine:
            referencing.reference(machine, settings_of(options))
            braking = stops.count_on_loop(machine, [model], cascade, delay_s)
            at = machine.position_m
            low, high = machine.envelope().window_m
            way = math.copysign(min(SMALL_M, 0.25 * (high - low)), 0.5 * (low + high) - at)
            limits = phases.gentle_limits(machine, model, SMALL_M_S)
            path = plan_trajectory(at, at + way, limits, drive.capabilities.sample_period_s)
            verification.refuse_broken(machine, model, path)
            out_of = verification.predicted_stops(machine, model, cascade, delay_s, path)
            agree(verification_plan(machine.axis, model, path, braking, out_of), machine)
            check_sign(machine)
            record = next_free("applied_", folder.finished_names())
            verdict, _ = verify_move(machine, model, cascade, delay_s, path, record)
        off, said = verdict.measured.dynamic_m, verdict.predicted.dynamic_m
        if not (np.isfinite(off) and off <= AS_PREDICTED * said + SLACK_M):
            raise Refused(
                f"the small move was off by {1e3 * off:.3g} mm where {1e3 * said:.3g} mm were predicted: in this drive the gains do not do "
                "what they were designed for, so the values from before were put back; calibrate and identify again"
            )
    except BaseException as error:
        try:
            gains.put_back(drive, found)
            folder.journal("apply: the values from before were put back")
        except BeltcommError as failure:
            error.add_note(f"the values from before could not be put back: {failure}; `beltcomm rollback` writes them again")
        raise
    return verdict
