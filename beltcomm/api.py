"""The public functions, one per command of the command line.   They raise only :class:`beltcomm.errors.BeltcommError` on purpose.

Each opens what it needs, does one job, saves its results, and returns a :class:`Result`.  An axis is left stopped, its drive restored.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from beltcomm.app.serve import open_page as open_page
from beltcomm.axis import Axis
from beltcomm.control import Cascade
from beltcomm.design.feedforward import compensated_effects
from beltcomm.design.specification import Specification
from beltcomm.drive import Drive, open_drive
from beltcomm.drive.access import able
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.experiments import commission as sequence
from beltcomm.experiments import phases, referencing
from beltcomm.experiments.agreement import Agreement, plan_result
from beltcomm.experiments.detectability import with_detectability
from beltcomm.experiments.options import Options, axis_of, claim, given, new_folder, settings_of
from beltcomm.experiments.plan import commission_plan, identify_plan
from beltcomm.experiments.sign import check_sign
from beltcomm.experiments.supervised import supervise
from beltcomm.foreign.convert import Reading
from beltcomm.foreign.job import check_imports, import_recordings
from beltcomm.given import Place, number, pasted, place
from beltcomm.jobs import calibrate as calibrate_job
from beltcomm.jobs import early_end
from beltcomm.jobs import friction as friction_job
from beltcomm.jobs import move as short_move
from beltcomm.jobs.bundle import bundle as bundle
from beltcomm.jobs.change import add_to_run as add
from beltcomm.jobs.change import remove_from_run as remove
from beltcomm.jobs.convert import convert as convert
from beltcomm.jobs.design import basis_of, delivered
from beltcomm.jobs.doctor import doctor as doctor
from beltcomm.jobs.export import export as export
from beltcomm.jobs.fit import fit as fit
from beltcomm.jobs.follow import follow_plan
from beltcomm.jobs.friction_compare import friction_compare as friction_compare
from beltcomm.jobs.laboratory import compare_run as compare
from beltcomm.jobs.laboratory import diagnose_run as diagnose
from beltcomm.jobs.laboratory import ladder_of_run as ladder
from beltcomm.jobs.loop import identify_in_loop
from beltcomm.jobs.move import ruler as ruler
from beltcomm.jobs.new_profile import new_profile as new_profile
from beltcomm.jobs.serve import serve as serve
from beltcomm.jobs.simulate import run_experiment
from beltcomm.jobs.trajectory import trajectory as trajectory
from beltcomm.jobs.verify import repeats, verify_with
from beltcomm.jobs.watch import watch as watch
from beltcomm.jobs.write import admitted, apply_to, backup_list, roll_back
from beltcomm.machine.machine import Machine
from beltcomm.model import load_plant
from beltcomm.pages import at_the_end
from beltcomm.pages import report as report
from beltcomm.pages import trend as trend
from beltcomm.result import Result, plain
from beltcomm.rundata import analyse, offline
from beltcomm.rundata.backups import choose_backup
from beltcomm.rundata.findings import Findings
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.next_plan import load_plan
from beltcomm.schedule.orders import sweep_orders as wanted_sweeps
from beltcomm.sentences import outcome, words
from beltcomm.sentences.own_words import about_run
from beltcomm.study.job import one_member, study_of
from beltcomm.study.members import Doing
from beltcomm.talk import Silence, Talk
from beltcomm.thesis.topics import thesis as thesis


def _axis_in(run: Path) -> Axis | None:
    """Of a run folder, where it is one; a backup from elsewhere has none."""
    try:
        return RunFolder.open(run).axis
    except BeltcommError:
        return None


@about_run(waits=False)
@early_end.searched
def commission(
    drive: str,
    axis: Axis | Place,
    run: Place,
    *,
    specification: Specification | None = None,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """The whole job: identify, fit, friction, design, verify.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    axis : Axis or Place
        The axis, its ``axis.yaml``, or the name of a shipped one.
    run : Place
        Run folder.
    specification : Specification or None
        What is asked of the design; None for what every axis is asked for.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Verdict, model, gains and predicted errors; exit code 1 for a missed target or a model that does not explain the data.

    Raises
    ------
    UsageError
    Refused
        Also a user's no.
    DataError
    SafetyStop
    DriveError
    """
    options, talk, axis, run = given(options), talk or Silence(), axis_of(axis), place(run)
    referencing.suitable(axis)
    agreed = Agreement(options, talk, partial(commission, axis=axis, specification=specification), goes_on=False)
    with able(open_drive(drive, options.for_drive(axis)), "torque") as opened, supervise(opened, drive, run, options, talk) as connected:
        analyse.require_offered(connected.capabilities.structure, options.prefilter, options.feedforward)
        if options.window_m is not None:
            referencing.refuse_window(connected.capabilities, options.position_m, home=options.home)
            return _identify(connected, drive, axis, run, options, talk, whole=True)
        plan = with_detectability(commission_plan(axis, connected.capabilities, options.extent), axis, connected.capabilities, options)
        if options.dry_run and options.resume:
            RunFolder.create(run, axis, resume=True)  # says whether it could go on
        if options.dry_run:
            return plan_result(plan, connected.capabilities, options, axis)
        folder = new_folder(run, axis, connected, options, talk, drive)
        findings = Findings()
        with Machine(connected, axis, folder, talk) as machine:
            settings = replace(settings_of(options), specification=specification)
            referencing.reference(machine, settings)
            agreed(plan, machine)
            with early_end.kept(machine, findings):
                sequence.commission(machine, settings, findings)
            outcome.keep_text(folder, outcome.commission_text(folder, findings).whole(()))
            machine.begin(sequence.TITLES[8])
            ended = at_the_end(run) if options.report else None
            answer = outcome.commission_text(folder, findings, ended)
            if asked := sequence.asks(machine, settings, findings):
                talk.say(*answer.screen)  # what the question about the gains is about
            sequence.dispose(machine, settings, findings)
    answer = outcome.commission_text(folder, findings, ended)
    closing = outcome.closing(folder, findings, options.reached(drive), ended.line if ended is not None else "")
    outcome.keep_text(folder, answer.whole(closing))
    found = {**outcome.data(folder, findings), "visible": plan.visible, "page": ended.page if ended is not None else None}
    told = len(answer.screen) if asked else 0
    return Result(found, [*answer.screen, *closing], 0 if findings.meets_targets else 1, details=answer.details, told=told)


@about_run(waits=False)
@early_end.searched
def identify(drive: str, axis: Axis | Place, run: Place, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Sign check, rising excitation, one open-loop response here, a first model; without a reference inside ``Options.window_m``.

    With ``Options.loop`` a closed-loop response into an existing run with a model: :mod:`beltcomm.jobs.loop`.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    axis : Axis or Place
        The axis, its ``axis.yaml``, or the name of a shipped one.
    run : Place
        Run folder.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        The frequency response and the first model.
    """
    options, talk, axis, run = given(options), talk or Silence(), axis_of(axis), place(run)
    referencing.suitable(axis)
    closed = options.in_loop
    with able(open_drive(drive, options.for_drive(axis)), "torque") as opened, supervise(opened, drive, run, options, talk) as connected:
        if closed:
            again = Agreement(options, talk, partial(identify, axis=axis))
            return identify_in_loop(connected, axis, run, options, again, talk)
        return _identify(connected, drive, axis, run, options, talk)


def _identify(connected: Drive, drive: str, axis: Axis, run: Path, options: Options, talk: Talk, *, whole: bool = False) -> Result:
    """Job of :func:`identify` on a connected drive; ``whole``: the whole job was asked for, so that this is not success."""
    phases.check_asked(options.asked, options.excitation, axis, connected.capabilities)
    if options.dry_run:
        plan = identify_plan(axis, connected.capabilities, options.window_m, options.asked)
        return plan_result(plan, connected.capabilities, options, axis)
    folder = new_folder(run, axis, connected, options, talk, drive)
    findings = Findings()
    with Machine(connected, axis, folder, talk) as machine:
        window = referencing.reference(machine, settings_of(options), needed=False)
        agreed = Agreement(options, talk, partial(identify, axis=axis), goes_on=False)
        agreed(identify_plan(axis, connected.capabilities, window, options.asked), machine)
        machine.titles, machine.excitation, machine.asked = sequence.TITLES[1:4], options.excitation, options.asked
        with early_end.kept(machine, findings):
            sequence.try_stop_here(machine, sequence.identify_here(machine, findings))
        known = machine.place_known
    split = analyse.nonlinearities(folder.recordings())
    text, details = outcome.identify_text(folder, findings, options.reached(drive), known)
    details += words.nonlinearity_lines(split)
    if whole:
        text = ["Only the record at this place was made: the rest of the job needs to know where the carriage stands.", "", *text]
    return Result({**outcome.data(folder, findings), "nonlinearity": plain(split)}, text, int(whole), details=details)


@about_run(waits=False)
def follow(drive: str, run: Place, plan: Place, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Record what a plan of ``diagnose`` asks for, into the run that it was written for.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    run : Place
        Run folder.
    plan : Place
        The plan's file.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        The records made.
    """
    options, talk, run, plan = given(options), talk or Silence(), place(run), place(plan, "plan")
    named = RunFolder.open(run).axis
    load_plan(plan)  # one that cannot be read costs the drive nothing
    with able(open_drive(drive, options.for_drive(named)), "torque") as opened, supervise(opened, drive, run, options, talk) as connected:
        agreed = Agreement(options, talk, partial(follow, plan=plan))
        return follow_plan(connected, run, plan, options, agreed, talk)


@about_run(waits=False)
def friction(
    drive: str, run: Place, *, options: Options | None = None, pictures: bool = False, command: str = "", talk: Talk | None = None
) -> Result:
    """Constant-speed sweeps with a loop designed from the run's model, in the order of ``options``, and their friction.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    run : Place
        Run folder.
    options : Options or None
        Order, repetitions and mounted payload of the sweeps; None for the safe defaults.
    pictures : bool
        Pictures into ``RUN/pictures``.
    command : str
        Command line, kept as provenance.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Coulomb and viscous friction at the motor shaft.
    """
    options, talk, run = given(options), talk or Silence(), place(run)
    asked = wanted_sweeps(options.order, options.repeat, options.mounted_kg)
    folder = RunFolder.open(run)
    model = offline.saved_model(folder)
    friction_job.check_payload(folder, model, asked)
    with open_drive(drive, options.for_drive(folder.axis)) as opened, supervise(opened, drive, run, options, talk) as connected:
        plan = friction_job.plan_of(folder.axis, connected.capabilities, model, asked)
        if options.dry_run:
            return plan_result(plan, connected.capabilities, options, folder.axis)
        claim(folder, connected.capabilities, options, talk)
        findings = offline.fit_run(folder, "lm", Silence(), model)
        with Machine(connected, folder.axis, folder, talk) as machine:
            referencing.reference(machine, settings_of(options))
            Agreement(options, talk, friction)(plan, machine)
            check_sign(machine)
            machine.titles = (sequence.TITLES[4], sequence.TITLES[5])
            sequence.closed_for(machine, findings, model, ask=not options.yes)
            made = friction_job.record(machine, model, asked)
    return friction_job.result(folder, model, findings.thesis, made, drawn=pictures, command=command)


@about_run()
def design(
    run: Place,
    *,
    specification: Specification | None = None,
    pictures: bool = False,
    command: str = "",
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Gains with margins from the run's model, proven on its measured responses too; nothing is written to a drive.

    Parameters
    ----------
    run : Place
        Run folder.
    specification : Specification or None
        Margins and targets; None for those of the axis.
    pictures : bool
        The open loops into ``RUN/pictures``.
    command : str
        Command line, kept as provenance.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Gains, margins, and what binds them.

    Raises
    ------
    Refused
        With what binds.
    DataError
    """
    options, talk = given(options), talk or Silence()
    basis = basis_of(place(run), talk)
    analyse.require_offered(basis.structure, options.prefilter, options.feedforward)
    settings = replace(settings_of(options), specification=specification)
    found = basis.findings
    found.design, found.cascade = sequence.design_for(basis.folder.axis, basis.model, basis.structure, found, settings, basis.folder)
    compensating = basis.structure.torque_feedforward and settings.feedforward == "nonlinear"
    along = compensated_effects(basis.model) if compensating else ()
    return delivered(basis, along, options.payload_kg, seed=options.seed or 0, pictures=pictures, command=command)


@about_run(waits=False)
def verify(
    drive: str,
    run: Place,
    *,
    move: Place | None = None,
    trajectory: str | None = None,
    rungs: bool = False,
    learn: int | None = None,
    over_belt: bool = False,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Drive a move with the run's design and compare its tracking error with the prediction.

    ``options.feedforward`` replaces the design's for this move only.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    run : Place
        Run folder.
    move : Place or None
        A file with the reference motion; None for that of ``trajectory``.
    trajectory : str or None
        Name of a reference motion in ``axis.yaml``; None for the axis's own.
    rungs : bool
        The move once for each step of what the model can bring.
    learn : int or None
        The move so many times more, each with a torque that the ones before have taught.
    over_belt : bool
        On a virtual drive, the belt may carry more than its feed force.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Tracking error, measured and predicted; exit code 1 when a target is missed.
    """
    options, talk, run = given(options), talk or Silence(), place(run)
    move = None if move is None else place(move, "move")
    how: dict[str, Any] = {"move": move, "trajectory": trajectory, "rungs": rungs, "learn": repeats(learn, rungs), "over_belt": over_belt}
    with (
        able(open_drive(drive, options.for_drive(_axis_in(run))), "position") as opened,
        supervise(opened, drive, run, options, talk) as connected,
    ):
        return verify_with(
            connected,
            drive,
            run,
            options,
            Agreement(options, talk, partial(verify, **how)),
            talk,
            **how,
            planned=(lambda plan, axis: plan_result(plan, connected.capabilities, options, axis)) if options.dry_run else None,
        )


@about_run(waits=False)
def apply(
    drive: str, run: Place, *, dcf: Place | None = None, shown: bool = False, options: Options | None = None, talk: Talk | None = None
) -> Result:
    """Write the run's gains, or the values of a file, to the drive and read them back; with ``apply="save"`` for good.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    run : Place
        Run folder.
    dcf : Place or None
        A file of object values to write instead of the run's gains.
    shown : bool
        By a small move before anything is saved; else nothing moves.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Gains written, read back and, where asked, shown by a move.

    Raises
    ------
    Refused
        For gains in doubt (model not trusted, no verification passed) without a yes to that or ``force``.
    """
    options, talk, run = given(options), talk or Silence(), place(run)
    dcf, folder = None if dcf is None else place(dcf, "file"), RunFolder.open(run)
    admitted(folder, options, talk, dcf, shown)
    agreed = Agreement(options, talk, partial(apply, dcf=dcf, shown=shown))
    with open_drive(drive, options.for_drive(_axis_in(run))) as opened, supervise(opened, drive, run, options, talk) as connected:
        return apply_to(connected, drive, folder, options, talk, agreed, dcf=dcf, shown=shown)


def backups(run: Place) -> Result:
    """The backups of a run, with dates; no drive is needed.

    Parameters
    ----------
    run : Place
        Run folder.

    Returns
    -------
    Result
        Name, file and date of every backup.
    """
    return backup_list(RunFolder.open(place(run)))


@about_run(waits=False)
def rollback(drive: str, run: Place, *, backup: str | None = None, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Write back what the drive had when the run began, or another backup of the run.

    Nothing moves.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    run : Place
        Run folder.
    backup : str or None
        Name or path of a backup; None for the one from before the run.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        The values that the drive holds now.
    """
    options, talk, run = given(options), talk or Silence(), place(run)
    folder = RunFolder.open(run)
    choose_backup(folder, backup)  # before anything is connected
    # a rollback is what an unfinished session needs: it is not offered one
    with (
        open_drive(drive, options.for_drive(_axis_in(run))) as opened,
        supervise(opened, drive, run, options, talk, settles=False) as connected,
    ):
        return roll_back(connected, drive, folder, backup, options, talk)


@about_run(waits=False)
def calibrate(drive: str, axis: Axis | Place | None, run: Place, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Calibrate the drive's gains by small steps of its setpoints, into a run: a new one for ``axis``, or an existing one without it.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    axis : Axis or Place, or None
        For a new run: the axis, its ``axis.yaml``, or the name of a shipped one; None for an existing run.
    run : Place
        Run folder.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        What one raw unit of each gain means.
    """
    options, talk, run = given(options), talk or Silence(), place(run)
    agreed = Agreement(options, talk, partial(calibrate, axis=axis), goes_on=axis is None)
    of_axis = RunFolder.open(run).axis if axis is None else axis_of(axis)
    with open_drive(drive, options.for_drive(of_axis)) as opened, supervise(opened, drive, run, options, talk) as connected:
        plan = calibrate_job.plan_of(of_axis, connected.capabilities)
        if options.dry_run:
            return plan_result(plan, connected.capabilities, options, of_axis)
        folder = RunFolder.open(run) if axis is None else new_folder(run, of_axis, connected, options, talk, drive)
        return calibrate_job.calibrate_on(connected, drive, folder, settings_of(options), partial(agreed, plan), talk)


def move(drive: str, axis: Axis | Place, by_m: float, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Move the carriage slowly by a small distance with the gains that are in the drive.

    Parameters
    ----------
    drive : str
        Name of the drive, as for ``--drive``: ``virtual``, ``can0``, ``serial:PORT``.
    axis : Axis or Place
        The axis, its ``axis.yaml``, or the name of a shipped one.
    by_m : float
        Distance, m along the axis, signed; at most 0.1.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Distance gone, and asked for.

    Raises
    ------
    UsageError
        Beyond 100 mm.
    """
    options, talk, axis, by_m = given(options), talk or Silence(), axis_of(axis), number(by_m, "by_m", "m")
    short_move.admit(axis, by_m)
    if options.simulate_first:
        raise UsageError(
            "a creep without a loop is not played on a twin: only the axis itself shows where it breaks away; leave --simulate-first out"
        )
    with open_drive(drive, options.for_drive(axis)) as opened, supervise(opened, drive, None, options, talk) as connected:
        return short_move.moved(connected, drive, axis, by_m, options, talk)


@about_run(waits=False)
def simulate(
    plant: str, axis: Axis | Place, run: Place, *, experiment: str = "frf", options: Options | None = None, talk: Talk | None = None
) -> Result:
    """A virtual experiment on a plant or model file, through the virtual drive, into a new run folder.

    Parameters
    ----------
    plant : str
        Name of a shipped plant, or a plant or model file.
    axis : Axis or Place
        The axis, its ``axis.yaml``, or the name of a shipped one.
    run : Place
        Run folder.
    experiment : str
        Name of the experiment.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        The recordings made.

    Raises
    ------
    UsageError
        For another experiment, and for a plant, an axis or a setting that cannot be.
    """
    options, talk, axis, run = given(options), talk or Silence(), axis_of(axis), place(run)
    if experiment not in ("frf", "friction_sweep", "trajectory"):
        raise UsageError(f"there is no experiment {experiment!r}; there are frf, friction_sweep and trajectory")
    model = load_plant(plant).model
    referencing.same_tilt(axis, model)
    if options.payload_kg:
        model = model.with_values({"cart.mass": model["cart.mass"] + options.payload_kg})
    options = replace(options, resume=options.resume or RunFolder.broken_off(run))  # a simulation that was cut off goes on
    with open_drive(f"virtual:{plant}", options.for_drive()) as connected:
        folder = new_folder(run, axis, connected, options, talk)
        with Machine(connected, axis, folder, talk) as machine:
            name = run_experiment(machine, model, experiment)
    return Result(
        {"run": str(run), "recording": name, "plant": plant},
        [
            f"Recorded {name} of plant {plant} in {folder.recordings_folder}.",
            f"Next: beltcomm fit {pasted(run)}"
            if experiment == "frf"
            else f"A fit needs an excited record too: beltcomm simulate {pasted(plant)}",
        ],
    )


def study(
    file: Place,
    out: Place,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    limit: int | None = None,
    report: bool = True,
    talk: Talk | None = None,
) -> Result:
    """A population of axes, or a fleet of runs, member by member, into a folder that a stopped study goes on with.

    See :func:`beltcomm.study.job.study_of`.

    Parameters
    ----------
    file : Place
        The study file.
    out : Place
        Folder of the results.
    workers : int or None
        Processes of this machine; None for one per processor.
    scheduler : str or None
        Address of a Dask cluster that computes in their place.
    limit : int or None
        So many more members at most; None for all, 0 only says what is known.
    report : bool
        Write a page when it is done.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        The spread of every quantity; exit code 1 where some member misses its targets, or has no result.
    """
    return study_of(
        str(place(file, "study")),
        place(out, "folder"),
        doing=Doing(commission),
        workers=workers,
        scheduler=scheduler,
        limit=limit,
        report=report,
        talk=talk,
    )


def study_member(file: Place, number: int, *, out: Place | None = None) -> Result:
    """Compute one member of a study again.

    Parameters
    ----------
    file : Place
        The study file.
    number : int
        Of the member, from 0.
    out : Place or None
        Folder for its plant file, and for the run of one that is commissioned.

    Returns
    -------
    Result
        The member's quantities.
    """
    folder = None if out is None else place(out, "folder")
    return one_member(str(place(file, "study")), number, doing=Doing(commission), out=folder)


__all__ = [
    "BeltcommError",
    "Cascade",
    "Options",
    "Reading",
    "Result",
    "add",
    "apply",
    "backups",
    "bundle",
    "calibrate",
    "check_imports",
    "commission",
    "compare",
    "convert",
    "design",
    "diagnose",
    "doctor",
    "export",
    "fit",
    "follow",
    "friction",
    "friction_compare",
    "identify",
    "import_recordings",
    "ladder",
    "move",
    "open_page",
    "remove",
    "report",
    "rollback",
    "ruler",
    "serve",
    "simulate",
    "study",
    "study_member",
    "thesis",
    "trajectory",
    "trend",
    "verify",
    "watch",
]
