"""``beltcomm identify --loop``: a closed-loop frequency response on a connected drive, into a run that has a model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from beltcomm.axis import Axis
from beltcomm.drive import Drive
from beltcomm.errors import UsageError
from beltcomm.experiments import loop_plan, loop_record, phases, referencing
from beltcomm.experiments.options import Options, claim, settings_of
from beltcomm.experiments.plan import Plan, with_homing
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.experiments.sign import check_sign
from beltcomm.fit.torque.acting_torque import acting_recordings
from beltcomm.given import pasted
from beltcomm.machine.machine import Machine
from beltcomm.pages import pictures
from beltcomm.recording import Recording
from beltcomm.recording.signalfile import write_columns
from beltcomm.result import Result, plain
from beltcomm.rundata import offline
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import loop_ways
from beltcomm.sentences.loop_ways import LoopReading
from beltcomm.talk import Silence, Talk

#: s: a loop that settles more slowly leaves a transient in what is measured.
SLOW_S = 0.5


def identify_in_loop(drive: Drive, axis: Axis, run: Path, options: Options, agree: Callable[[Plan, Machine], None], talk: Talk) -> Result:
    """Plan, agree, close the loop, record with rising amplitude, and show the response by every way beside the open-loop one.

    Parameters
    ----------
    drive : Drive
        Connected.
    axis : Axis
        As its file states it.
    run : Path
    options : Options
        Settings of the session.
    agree : callable
        Shows what will move, raises Refused for a no, and homes when that is asked for.
    talk : Talk

    Raises
    ------
    UsageError
        For a run that does not exist.
    DataError
        For one without a model.
    Refused
        With what the drive or the axis lacks.
    """
    if not run.is_dir():
        raise UsageError(f"--loop {options.loop} goes on with a run that has a model, and {run} does not exist; make one without --loop")
    folder = RunFolder.create(run, axis, resume=True)
    model = offline.trusted_revision(folder)[0]
    loop_plan.require_offered(drive.capabilities, options.loop, frozenset(drive.backup()))
    if options.periods is not None:
        raise UsageError("a closed way travels, and its periods follow from its strokes: leave --periods out")
    phases.check_asked(options.asked, options.excitation, axis, drive.capabilities)
    if options.amplitude_nm is not None and options.loop == "setpoint":
        raise UsageError("--loop setpoint excites the speed, no torque: leave --amplitude out")
    claim(folder, drive.capabilities, options, talk)
    findings = offline.fit_run(folder, "lm", Silence(), model)
    findings.remarks.clear()  # of other records
    with Machine(drive, axis, folder, talk) as machine:
        machine.excitation, machine.asked = options.excitation, options.asked
        referencing.reference(machine, settings_of(options))
        job = loop_plan.plan_job(machine, findings, model, options.loop, options.base_speed_m_s)
        plan = loop_plan.plan_of(machine, job)
        if options.dry_run:
            plan = with_homing(plan, axis, drive.capabilities) if options.home else plan
            data = {"plan": plain(plan), "seconds": plan.seconds, "base_speed_m_s": job.speed_m_s, "amplitude": job.step.amplitude}
            return Result(
                {**data, "bound_by": job.step.binds},
                [*plan_screen(plan, axis, machine.drive.capabilities), "", "Nothing was moved (--dry-run)."],
                details=plan.lines(),
            )
        agree(plan, machine)
        check_sign(machine)
        if job.settle > SLOW_S:
            findings.remarks.append(
                f"this loop takes {job.settle:.2g} s and a period to settle at its speed: what is left of that moves the lines near the "
                "antiresonance, where the motor answers least, by more than the noise shown; the model of `beltcomm fit` does not mind"
            )
        recording = loop_record.record_all(machine, findings, job, ask=not options.yes)
        seconds = machine.machine_seconds
    slowest = loop_record.slowest_share(recording, drive.capabilities.counts_per_rev)
    ways = loop_ways.all_ways(acting_recordings(folder.recordings(), findings.path), model, recording.name)
    made, remarks = (
        pictures.ways_picture(folder, recording.name, ways, f"beltcomm identify --loop {options.loop}") if options.pictures else ([], [])
    )
    data = {**_saved(folder, recording, ways, slowest), "machine_seconds": seconds, "pictures": made}
    text = [
        f"{recording.name}: the axis in closed loop, {job.why}.",
        *loop_ways.lines(recording, ways, slowest),
        *(f"Note: {remark}" for remark in _remarks(recording, ways, findings.remarks)),
        *pictures.lines(folder, made, remarks),
        f"{seconds:.0f} s on the machine; the drive has its old gains again. Responses are in {folder.path / 'results'}.",
        f"Next: beltcomm fit {pasted(run)}",
    ]
    return Result({"run": str(run), **data}, text)


def _saved(folder: RunFolder, recording: Recording, ways: Sequence[LoopReading], slowest: float) -> dict[str, Any]:
    """``results/NAME.yaml`` with all numbers and ``results/NAME_WAY.csv`` with the lines of each response of the record; as a mapping."""
    bias = loop_ways.bias_by(recording, ways)
    note = recording.sidecar.excitation
    data: dict[str, Any] = {
        "recording": recording.name,
        "excitation": plain(note),
        "slowest_share": slowest,
        "friction_nm": loop_ways.friction_nm(recording),
        "controller": dict(recording.sidecar.controller),
        "wrong_controller": plain(bias),
        "ways": [_numbers(s) for s in ways],
    }
    folder.save("results", recording.name, data)
    for one in ways:
        if one.record == recording.name:
            found = one.response
            columns = {"freq_hz": found.freq_hz, "real_rad_nm": found.h.real, "imag_rad_nm": found.h.imag, "noise_rad_nm": found.noise}
            write_columns(folder.path / "results" / f"{recording.name}_{one.way}.csv", columns)
    return data


def _numbers(one: LoopReading) -> dict[str, Any]:
    """A response's numbers without its lines."""
    kept = (
        "record",
        "way",
        "speed_m_s",
        "resonance",
        "antiresonance",
        "mass",
        "stiffness",
        "damping",
        "noise_share",
        "highest_hz",
        "remarks",
    )
    return {name: plain(getattr(one, name)) for name in kept} | {"periods": one.response.n_periods}


def _remarks(recording: Recording, ways: Sequence[LoopReading], others: Sequence[str]) -> list[str]:
    """Remarks beside the table, of the record just made only."""
    said = [f"{s.way}: {remark}" for s in ways if s.record == recording.name for remark in s.remarks]
    return [*said, *others]
