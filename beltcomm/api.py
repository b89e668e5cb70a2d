"""The public functions, one per command of the command line.   They raise only :class:`beltcomm.errors.BeltcommError` on purpose.

Each opens what it needs, does one job, saves its results, and returns a :class:`Result`.  An axis is left stopped, its drive restored.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

from beltcomm.axis import Axis, load_axis
from beltcomm.control import Cascade
from beltcomm.design.compensation import compensated
from beltcomm.design.specification import Specification
from beltcomm.drive import Drive, open_drive
from beltcomm.errors import BeltcommError, Refused, UsageError
from beltcomm.foreign.convert import Reading
from beltcomm.foreign.job import check_imports, import_recordings
from beltcomm.model import load_plant
from beltcomm.parameters import cascade_to_parameters
from beltcomm.result import Result, plain
from beltcomm.runfolder import RunFolder
from beltcomm.session import analyse, friction_job, gains, gravity, offline, outcome, referencing, words
from beltcomm.session import commission as sequence
from beltcomm.session.bundle import bundle as bundle
from beltcomm.session.commission import Findings
from beltcomm.session.convert import convert as convert
from beltcomm.session.creep import BREAKAWAY_SHARE, CREEP_SPEED_M_S, MARGIN_M, NEAR_M, RAMP_S, small_move
from beltcomm.session.design_job import examined
from beltcomm.session.experiment import run_experiment
from beltcomm.session.export import export as export
from beltcomm.session.fit_job import fit as fit
from beltcomm.session.follow_job import follow_plan
from beltcomm.session.foresight import foretold
from beltcomm.session.friction_study import friction_compare as friction_compare
from beltcomm.session.laboratory import add_to_run, compare_run, diagnose_run, ladder_of_run, remove_from_run
from beltcomm.session.loop_job import identify_in_loop
from beltcomm.session.machine import Machine
from beltcomm.session.move_file import trajectory as trajectory
from beltcomm.session.options import Options, settings_of
from beltcomm.session.orders import wanted as wanted_sweeps
from beltcomm.session.plan import Plan, commission_plan, identify_plan, move_plan, with_homing
from beltcomm.session.proof import admit, doubts, thin_margins
from beltcomm.session.sign import check_sign
from beltcomm.session.store import cascade_from_dict, drive_to_dict
from beltcomm.session.thesis import thesis as thesis
from beltcomm.session.verify_job import verify_with
from beltcomm.talk import Silence, Talk

#: The laboratory's commands on a run folder; see :mod:`beltcomm.session.laboratory`.
compare, diagnose, add, remove, ladder = compare_run, diagnose_run, add_to_run, remove_from_run, ladder_of_run

#: Before the plan of a resumed run.
KEPT = "Finished records are kept; what stands below is the most that is driven again, after a check that this is still the machine. "
#: m: the longest way of ``beltcomm move``.
LONGEST_MOVE_M = 0.1


def commission(drive: str, axis: Axis | str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """The whole job: identify, fit, friction, design, verify.   Exit code 1 for a missed target or a model that does not explain the data.

    Raises UsageError, Refused (also a user's no), DataError, SafetyStop, DriveError.
    """
    options, talk, axis = options or Options(), talk or Silence(), _axis(axis)
    referencing.suitable(axis)
    with open_drive(drive, options.for_drive()) as connected:
        analyse.offered(connected.capabilities.structure, options.prefilter, options.feedforward)
        if options.window_m is not None:
            referencing.only_here(connected.capabilities, options.position_m, home=options.home)
            return _identify(connected, drive, axis, run, options, talk, whole=True)
        plan = foretold(commission_plan(axis, connected.capabilities, options.extent), axis, connected.capabilities, options, talk)
        if options.dry_run and options.resume:
            RunFolder.create(run, axis, resume=True)  # says whether it could go on
        if options.dry_run:
            return _planned(plan, connected, options, axis)
        folder = _new_folder(run, axis, connected, options)
        findings = Findings()
        with Machine(connected, axis, folder, talk) as machine:
            settings = settings_of(options)
            machine.check_scaling()
            referencing.reference(machine, settings)
            _agree(plan, options, talk, machine)
            try:
                sequence.commission(machine, settings, findings)
            finally:  # an interrupted run keeps what it found
                outcome.save(folder, findings)
    text = outcome.commission_text(folder, findings, drive)
    outcome.keep_text(folder, text)
    return Result({**outcome.data(folder, findings), "visible": plan.visible}, text, 0 if findings.succeeded else 1)


def identify(drive: str, axis: Axis | str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Sign check, rising excitation, one open-loop response here, a first model; without a reference inside ``Options.window_m``.

    With ``Options.loop`` a closed-loop response into an existing run with a model: :mod:`beltcomm.session.loop_job`.
    """
    options, talk, axis = options or Options(), talk or Silence(), _axis(axis)
    referencing.suitable(axis)
    closed = options.in_loop
    with open_drive(drive, options.for_drive()) as connected:
        if closed:
            return identify_in_loop(connected, axis, run, options, lambda plan, m: _agree(plan, options, talk, m), talk)
        return _identify(connected, drive, axis, run, options, talk)


def _identify(connected: Drive, drive: str, axis: Axis, run: Path, options: Options, talk: Talk, *, whole: bool = False) -> Result:
    """What :func:`identify` does on a connected drive.   whole : the whole job was asked for, so that this is not success."""
    if options.dry_run:
        return _planned(identify_plan(axis, connected.capabilities, options.window_m), connected, options, axis)
    folder = _new_folder(run, axis, connected, options)
    findings = Findings()
    with Machine(connected, axis, folder, talk) as machine:
        machine.check_scaling()
        window = referencing.reference(machine, settings_of(options), needed=False)
        _agree(identify_plan(axis, connected.capabilities, window), options, talk, machine)
        machine.titles, machine.excitation = sequence.TITLES[1:4], options.excitation
        try:
            sequence.identify_here(machine, findings)
            known = machine.place_known
        finally:
            findings.machine_seconds = machine.machine_seconds
            outcome.save(folder, findings)
    split = analyse.nonlinearities(folder.recordings())
    text = outcome.identify_text(folder, findings, drive, known)
    text[-1:] = [*words.nonlinearity_lines(split), text[-1]]
    if whole:
        text = ["Only the record at this place was made: the rest of the job needs to know where the carriage stands.", "", *text]
    return Result({**outcome.data(folder, findings), "nonlinearity": plain(split)}, text, int(whole))


def follow(drive: str, run: Path, plan: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """The records of a plan that ``diagnose`` wrote, into the run that it was written for."""
    options, talk = options or Options(), talk or Silence()
    with open_drive(drive, options.for_drive()) as connected:
        return follow_plan(connected, run, plan, settings_of(options), partial(_agree, options=options, talk=talk), talk, options.dry_run)


def friction(
    drive: str, run: Path, *, options: Options | None = None, pictures: bool = False, command: str = "", talk: Talk | None = None
) -> Result:
    """Constant-speed sweeps with a loop designed from the run's model, in the order of ``options``, and their friction."""
    options, talk = options or Options(), talk or Silence()
    asked = wanted_sweeps(options.order, options.repeat, options.mounted_kg)
    folder = RunFolder.open(run)
    model = offline.saved_model(folder)
    friction_job.check_payload(folder, model, asked)
    with open_drive(drive, options.for_drive()) as connected:
        plan = friction_job.plan_of(folder.axis, connected.capabilities, model, asked)
        if options.dry_run:
            return _planned(plan, connected, options, folder.axis)
        folder.claim_drive(connected.capabilities.identity)
        findings = offline.fitted(folder, "lm", Silence(), model)
        with Machine(connected, folder.axis, folder, talk) as machine:
            referencing.reference(machine, settings_of(options))
            _agree(plan, options, talk, machine)
            check_sign(machine)
            machine.titles = (sequence.TITLES[4], sequence.TITLES[5])
            sequence.close_first_loop(machine, findings, model, ask=not options.yes)
            made = friction_job.record(machine, model, asked)
    return friction_job.result(folder, model, findings.thesis, made, drawn=pictures, command=command)


def design(
    run: Path,
    *,
    specification: Specification | None = None,
    pictures: bool = False,
    command: str = "",
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Gains with margins from the run's model, proven on its measured responses too; nothing is written to a drive.

    pictures : the open loops into ``RUN/pictures``.   Raises Refused with what binds, DataError.
    """
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    model, revision, which = offline.trusted(folder)
    findings = Findings()
    recordings = folder.recordings()
    analyse.check_whole(recordings)
    sequence.measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
    structure = offline.structure_of(folder, findings)
    analyse.offered(structure, options.prefilter, options.feedforward)
    settings = replace(settings_of(options), specification=specification)
    findings.design, findings.cascade = sequence.design_for(folder.axis, model, structure, findings, settings)
    along = compensated(model) if structure.torque_feedforward and settings.feedforward == "nonlinear" else ()
    if not offline.place_known(recordings):
        findings.design = replace(findings.design, remarks=(*findings.design.remarks, offline.ONE_PLACE))
    if (remark := referencing.slow_payload(folder.axis, model["cart.mass"], options.payload_kg)) is not None:
        findings.remarks.append(remark)
    proven = examined(folder, model, revision, findings, settings.payloads_kg, options.seed or 0, pictures, command)
    mapping = {**outcome.design_dict(findings), "revision": revision, "compensated": list(along), "proof": proven.data}
    sound = "final" in folder.names("designs") and not doubts(folder)
    folder.save_design("final", mapping)
    if sound and doubts(folder):
        findings.remarks.append("the gains before were proven by a move and are replaced; these are not proven yet, verify them")
    text = [
        *words.design_lines(findings.design, findings.cascade),
        *words.knowledge_lines(model, along, which),
        *proven.lines,
        *words.remarks_lines(findings.remarks),
        *(f"This design is in doubt: {why}." for why in (*thin_margins(findings.design.margins), *proven.doubts)),
        f"Next: beltcomm verify --drive DRIVE --run {run}",
    ]
    return Result({"run": str(run), **mapping, "pictures": proven.pictures}, text, 1 if findings.design.relaxed or proven.failed else 0)


def verify(
    drive: str,
    run: Path,
    *,
    move: Path | None = None,
    trajectory: str | None = None,
    rungs: bool = False,
    over_belt: bool = False,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Drive a move with the run's design, compare its error with the prediction.   Exit code 1 when a target is missed.

    ``options.feedforward`` replaces the design's for this move only.   rungs : the move once for each step of what the model can bring.
    over_belt : on a virtual drive, the belt may carry more than its feed force.
    """
    options, talk = options or Options(), talk or Silence()
    with open_drive(drive, options.for_drive()) as connected:
        return verify_with(
            connected,
            drive,
            run,
            settings_of(replace(options, feedforward=None)),
            lambda plan, machine: _agree(plan, options, talk, machine),
            talk,
            move=move,
            trajectory=trajectory,
            feedforward=options.feedforward,
            rungs=rungs,
            over_belt=over_belt,
            planned=(lambda plan, axis: _planned(plan, connected, options, axis)) if options.dry_run else None,
        )


def apply(drive: str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Write the run's gains to the drive and read them back; with ``apply="save"`` for good.   Nothing moves.

    Raises Refused for gains in doubt (model not trusted, no verification passed) without a yes to that or ``force``.
    """
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    saved = folder.load("designs", "final")
    wanted = cascade_to_parameters(cascade_from_dict(saved))
    for line in words.remarks_lines(saved.get("remarks") or ()):
        talk.say(line)
    if not options.dry_run:
        admit(folder, talk, yes=options.yes, force=options.force)
    return _written(drive, folder, wanted, options, talk, "applied")


def rollback(drive: str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Write back the parameters that the drive had when the run began.   Nothing moves."""
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    return _written(drive, folder, dict(gains.backed_up(folder)), options, talk, "rolled back")


def move(drive: str, axis: Axis | str, by_m: float, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Move the carriage slowly by a small distance with the gains that are in the drive.   Raises UsageError beyond 100 mm."""
    options, talk, axis = options or Options(), talk or Silence(), _axis(axis)
    if not 2.0 * NEAR_M <= abs(by_m) <= LONGEST_MOVE_M:
        ways = f"{2e3 * NEAR_M:g} to {1e3 * LONGEST_MOVE_M:.0f} mm, either way"
        raise UsageError(f"a move by {1e3 * by_m:g} mm cannot be crept: give {ways} (it ends within {1e3 * NEAR_M:g} mm)")
    gravity.not_on_tilted(
        axis, "it is not crept without a loop, for a torque from zero would let it fall; `beltcomm verify --move FILE` moves it"
    )
    axis.require("move", "pulley.effective_radius_m", "travel.min_m", "travel.max_m")
    plan = move_plan(
        axis,
        abs(by_m),
        abs(by_m) + MARGIN_M,
        CREEP_SPEED_M_S,
        BREAKAWAY_SHARE * axis.torque_limit_nm,
        min(axis.belt_force_limit_n, BREAKAWAY_SHARE * axis.torque_limit_nm / axis.transmission_m_rad),
        RAMP_S * (1.0 + abs(by_m) / 3e-3),
        f"creep {1e3 * by_m:+.1f} mm under slowly rising torque, in several goes",
    )
    if options.dry_run:
        return _planned(plan)
    with open_drive(drive, options.for_drive()) as connected:
        _agree(plan, options, talk)
        moved = small_move(connected, axis, by_m, options.position_m)
    reached = abs(moved - by_m) < max(0.2 * abs(by_m), 2e-3)
    text = [f"The carriage crept {1e3 * moved:+.2f} mm, asked were {1e3 * by_m:+.2f} mm; no loop was closed."]
    return Result({"moved_m": moved, "asked_m": by_m}, text, 0 if reached else 1)


def simulate(
    plant: str,
    axis: Axis | str,
    run: Path,
    *,
    experiment: str = "frf",
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """A virtual experiment on a plant or model file, through the virtual drive, into a new run folder."""
    options, talk, axis = options or Options(), talk or Silence(), _axis(axis)
    if experiment not in ("frf", "friction_sweep", "trajectory"):
        raise UsageError(f"there is no experiment {experiment!r}; there are frf, friction_sweep and trajectory")
    model = load_plant(plant).model
    referencing.same_tilt(axis, model)
    if options.payload_kg:
        model = model.with_values({"cart.mass": model["cart.mass"] + options.payload_kg})
    with open_drive(f"virtual:{plant}", options.for_drive()) as connected:
        folder = _new_folder(run, axis, connected, options)
        with Machine(connected, axis, folder, talk) as machine:
            name = run_experiment(machine, model, experiment)
    return Result(
        {"run": str(run), "recording": name, "plant": plant},
        [
            f"Recorded {name} of plant {plant} in {folder.recordings_folder}.",
            f"Next: beltcomm fit {run}" if experiment == "frf" else f"A fit needs an excited record too: beltcomm simulate {plant}",
        ],
    )


def _axis(axis: Axis | str) -> Axis:
    return axis if isinstance(axis, Axis) else load_axis(axis)


def _new_folder(run: Path, axis: Axis, drive: Drive, options: Options) -> RunFolder:
    folder = RunFolder.create(run, axis, resume=options.resume)
    folder.claim_drive(drive.capabilities.identity)
    folder.save_result("drive", drive_to_dict(drive.capabilities))
    return folder


def _agree(plan: Plan, options: Options, talk: Talk, machine: Machine | None = None) -> None:
    """Say what will happen and ask, unless told not to; then let the drive home if it shall.   Raises Refused for a no."""
    if machine is not None and options.home:
        plan = with_homing(plan, machine.axis, machine.drive.capabilities)
    plan = replace(plan, text=KEPT + plan.text) if options.resume else plan
    talk.say("\n".join(plan.lines()))
    if not options.yes and not talk.confirm("May the axis move like this?"):
        raise Refused("nothing was moved, as you said; --dry-run shows the plan without asking")
    if machine is not None and options.home:
        referencing.home(machine)


def _planned(plan: Plan, drive: Drive | None = None, options: Options | None = None, axis: Axis | None = None) -> Result:
    if drive and axis and options:
        plan = replace(plan, text=KEPT + plan.text) if options.resume else plan
        referencing.inside(axis, options.position_m)
        plan = with_homing(plan, axis, drive.capabilities) if options.home else plan
    return Result(
        {"plan": plain(plan), "seconds": plan.seconds, "visible": plan.visible}, [*plan.lines(), "Nothing was moved (--dry-run)."]
    )


def _written(drive: str, folder: RunFolder, wanted: Mapping[str, float], options: Options, talk: Talk, verb: str) -> Result:
    """Parameters into the drive of a run, or with ``dry_run`` only their differences."""
    save = options.apply == "save"
    with open_drive(drive, options.for_drive()) as connected:
        folder.claim_drive(connected.capabilities.identity)
        write = partial(gains.write, connected, folder, wanted, talk, yes=options.yes, save=save, verb=verb)
        done = gains.differences(connected, wanted) if options.dry_run else write()
    data = {"run": str(folder.path), **plain(done), "written": not options.dry_run, "saved": save and not options.dry_run}
    if options.dry_run:
        return Result(data, ["Would change:", *done.table(), "Nothing was written (--dry-run)."])
    how = "and saved" if save else "until power-off (--save makes it permanent)"
    nothing = "" if done.changes else " (nothing differed from what the drive had)"
    return Result(data, [f"{len(done.changes)} parameters {verb}, read back, {how}{nothing}{words.lasting(drive)}."])


__all__ = [
    "BeltcommError",
    "Cascade",
    "Options",
    "Reading",
    "Result",
    "apply",
    "bundle",
    "check_imports",
    "commission",
    "design",
    "export",
    "fit",
    "follow",
    "friction",
    "identify",
    "import_recordings",
    "move",
    "rollback",
    "simulate",
    "trajectory",
    "verify",
]
