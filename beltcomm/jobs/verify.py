"""``beltcomm verify``: the move of a run's design on a connected drive, once, or once for every rung of what the model can bring."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from beltcomm.axis import Axis
from beltcomm.axis.targets import with_targets
from beltcomm.control import Cascade
from beltcomm.design.feedforward import FeedforwardKind
from beltcomm.drive import Drive, simulated
from beltcomm.errors import BeltcommError, Refused, SafetyStop, UsageError
from beltcomm.experiments import referencing, verification
from beltcomm.experiments.learning import Learnt
from beltcomm.experiments.learning import learn as repeat_and_learn
from beltcomm.experiments.options import Options, admit_edited, claim, settings_of
from beltcomm.experiments.plan import Plan, verification_plan
from beltcomm.experiments.proving import verify_move
from beltcomm.experiments.sign import check_sign
from beltcomm.given import pasted, whole
from beltcomm.language import tr
from beltcomm.machine import stops
from beltcomm.machine.machine import Machine
from beltcomm.machine.prediction_watch import BELT_BEYOND
from beltcomm.model import Model
from beltcomm.quantities import in_mm, mm
from beltcomm.recording.signalfile import write_columns
from beltcomm.result import Line, Result, plain
from beltcomm.rundata import analyse, offline
from beltcomm.rundata.headline import NOTED, OF, NextCommand, behind, drive_of, hashes_of, headline_of, next_command
from beltcomm.rundata.proof import LEARNT, proof
from beltcomm.rundata.store import saved_design
from beltcomm.runfolder import RunFolder, next_free
from beltcomm.sending import Sending
from beltcomm.sentences import screens, words
from beltcomm.talk import Talk
from beltcomm.trajectory import Trajectory, torque_of_move, with_dwell
from beltcomm.verify import AS_PREDICTED, REST_S, SLACK_M, Demand, Verdict


@dataclass(frozen=True)
class MoveVariant:
    """One way to drive the same move with the same gains.

    Attributes
    ----------
    change : callable
        Of the design's controller.
    sending : Sending
        What the host adds.
    """

    key: str
    title: str
    change: Callable[[Cascade], Cascade]
    sending: Sending


def _at_once(cascade: Cascade) -> Cascade:
    """The feedforward computed for now and not for when it acts."""
    return replace(cascade, feedforward=replace(cascade.feedforward, advance_s=0.0))


def _plain(cascade: Cascade) -> Cascade:
    """The cascade of figure 4.1."""
    return replace(_at_once(cascade), filter_reference=False)


#: From the cascade of the design source up, each with all of the one before.
RUNGS: tuple[MoveVariant, ...] = (
    MoveVariant("source", "as in the design source: velocity compared with a reference that does not lag", _plain, "nothing"),
    MoveVariant("lag", "the reference behind the lag of the measured velocity", _at_once, "nothing"),
    MoveVariant("delay", "the feedforward computed ahead of the delay", lambda c: c, "nothing"),
    MoveVariant("stretch", "the motor ahead of the carriage by the stretch of the belt", lambda c: c, "stretch"),
    MoveVariant("compliant", "friction of the carriage in that stretch, through start, reversal and stop", lambda c: c, "compliant"),
)


def repeats(learn: int | None, rungs: bool) -> int | None:
    """Number of times that a move is repeated for learning, checked before a drive is opened.

    Parameters
    ----------
    learn : int or None
        As it was asked for; None for none.
    rungs : bool
        True if the move is repeated for the revisions, too.

    Raises
    ------
    UsageError
        For too few, or repetitions of two kinds.
    """
    if learn is not None and whole(learn, "learn") < 2:
        raise UsageError(f"{learn} repetitions teach nothing; give 2 or more")
    if rungs and learn is not None:
        raise UsageError("--rungs and --learn both repeat the move; give one of them")
    return learn


def verify_with(
    drive: Drive,
    name: str,
    run: Path,
    options: Options,
    agree: Callable[[Plan, Machine], None],
    talk: Talk,
    *,
    move: Path | None = None,
    trajectory: str | None = None,
    rungs: bool = False,
    learn: int | None = None,
    over_belt: bool = False,
    planned: Callable[[Plan, Axis], Result] | None = None,
) -> Result:
    """Drive a move with the run's design and compare its error with the prediction.

    Parameters
    ----------
    drive : Drive
        Connected.
    name : str
        Of the drive, for what to do next.
    run : Path
    options : Options
        Settings of the session.
    agree : callable
        Shows what will move and raises Refused for a no.
    talk : Talk
    move, trajectory
        A file, or limits named in axis.yaml. ``options.feedforward`` replaces the design's for this move only.
    rungs : bool
        The move once for each of ``RUNGS``.
    learn : int or None
        The move so many times more, each with the torque that the ones before have taught.
    over_belt : bool
        A virtual belt may carry more than its feed force, as T_B of the design source asks for.
    planned : callable
        Makes the result of a plan that is only shown.

    Returns
    -------
    Result
        Exit code 1 when a target is missed.

    Raises
    ------
    Refused
        For what this drive cannot be sent, and for a no.
    """
    if over_belt and not simulated(name):
        raise Refused("more than the feed force is for virtual belts only; slow the move down, or state another belt in axis.yaml")
    folder, feedforward = RunFolder.open(run), options.feedforward
    axis = with_targets(folder.axis, options.targets)
    saved = saved_design(folder)
    model = offline.design_model(folder, saved)
    claim(folder, drive.capabilities, options, talk)
    if planned is None:
        admit_edited("final.yaml of the run", folder.edited("designs", "final"), options, talk)
    for line in behind(folder):
        talk.say(line)
    structure = drive.capabilities.structure
    leads = rungs or feedforward == "compliant"
    taught = None if move is None else torque_of_move(move, drive.capabilities.sample_period_s)
    if (learn or taught is not None) and "position" not in drive.capabilities.torque_along:
        raise Refused(
            f"{structure.name} takes no torque along with a reference, so nothing that is learnt could be sent to it; "
            "leave --learn out, and the column torque_along_nm of the move"
        )
    if leads and (learn or taught is not None):
        raise Refused(
            "a torque that is learnt belongs to the move itself, and with --rungs or a compliant feedforward the motor makes another one; "
            "choose nonlinear, linear or none"
        )
    if leads and not (structure.torque_feedforward and structure.velocity_feedforward):
        raise Refused(
            f"{structure.name} takes no torque along with a reference, so its motor cannot be led ahead of the carriage; "
            "use nonlinear, linear or none"
        )
    own: FeedforwardKind | None = "nonlinear" if feedforward == "compliant" else None if feedforward == "led" else feedforward
    analyse.require_offered(structure, None, own)
    cascade, delay_s = offline.cascade_of(saved, model, structure, own)
    along = bool(saved.get("compensated")) and structure.torque_feedforward and feedforward in (None, "nonlinear")
    sending: Sending = "compliant" if feedforward == "compliant" else "rigid" if along else "nothing"
    if feedforward == "led" and drive.capabilities.gains == "unknown":
        raise Refused(
            f"the gains of {structure.name} cannot be read, so no reference can be led by the inverse of its loops; leave led out"
        )
    if feedforward == "led" or (feedforward is None and verification.uses_led_reference(drive, axis, cascade)):
        sending = "led"
    driven: list[tuple[str, Verdict, Demand]] = []
    learnt = Learnt()

    def repeated(remark: str = "") -> Result:
        return _learnt_result(folder, drive, model, cascade, learnt, sending, remark)

    with _kept_when_stopped(repeated, learnt, talk), Machine(drive, axis, folder, talk) as machine:
        machine.over_belt = over_belt
        referencing.reference(machine, settings_of(replace(options, feedforward=None)))
        braking = stops.count_on_loop(machine, [model], cascade, delay_s)
        if sending == "led" and move is None and trajectory is None:  # as fast as the drive's bounds let its reference lead
            standard = verification.slowed_move(machine, model, cascade, delay_s)
            path, remark = verification.within_target(machine, model, cascade, delay_s, standard)
        elif feedforward is not None and move is None and trajectory is None:  # another one is compared on the same move
            standard = verification.standard_move(machine, model)
            path, remark = standard.at(1.0, drive.capabilities.sample_period_s), standard.remark
        else:
            path, remark = verification.move_asked_for(machine, model, cascade, delay_s, move, trajectory)
        verification.refuse_broken(machine, model, path)
        out_of = verification.predicted_stops(machine, model, cascade, delay_s, path)
        plan = verification_plan(machine.axis, model, path, braking, out_of, len(RUNGS) if rungs else 1 + (learn or 0))
        agreed_n = 0.0
        if feedforward is not None or rungs:  # one that somebody asks for may load the belt harder, which the plan tells
            agreed_n = BELT_BEYOND * out_of.host_lost.belt_force_n
            plan = replace(plan, host_loss_n=max(agreed_n, plan.host_loss_n or 0.0))
        if planned is not None:
            return planned(plan, folder.axis)
        if drive.capabilities.gains == "unknown":
            plan = replace(plan, host_loss_n=None)  # how hard the loop in it brakes then, nobody knows
            talk.say("This drive's gains can neither be written nor read: the move is planned for those of the design, typed in by hand.")
        agree(plan, machine)
        check_sign(machine)
        if learn:
            repeat_and_learn(machine, model, cascade, delay_s, path, learn, _names(folder), learnt, sending)
            return repeated(remark)
        ways = [(rung.change(cascade), rung.sending) for rung in RUNGS] if rungs else [(cascade, sending)]
        for gains, how in ways:
            record = _names(folder)()
            with _set_by_hand(drive, folder):
                verdict, asked = verify_move(machine, model, gains, delay_s, path, record, sending=how, learnt=taught, agreed_n=agreed_n)
            _keep(folder, drive, model, gains, path, record, verdict, LEARNT if taught is not None else how, remark)
            driven.append((record, verdict, asked))
    if over_belt and asked.feed_force_n > folder.axis.belt_force_limit_n:
        beyond = (
            f"the belt carried up to {asked.feed_force_n:.0f} N, beyond its {folder.axis.belt_force_limit_n:.0f} N: for a virtual belt only"
        )
        remark = f"{remark}; {beyond}" if remark else beyond
    if rungs:
        return _rungs_result(folder, path, driven)
    return _result(folder, options.reached(name), driven[0], feedforward, remark, typed=drive.capabilities.gains == "unknown")


def _names(folder: RunFolder) -> Callable[[], str]:
    """Names of the next moves."""
    return lambda: next_free("move_", folder.finished_names())


def _keep(
    folder: RunFolder,
    drive: Drive,
    model: Model,
    gains: Cascade,
    path: Trajectory,
    record: str,
    verdict: Verdict,
    how: str,
    remark: str = "",
) -> None:
    """The verdict of a move, and what it proves.   how : what the host added."""
    driven_with = proof(gains, path, (), how if how in ("stretch", "compliant", "led", LEARNT) else "")
    shown = {"proof": driven_with, OF: hashes_of(driven_with["gains"], model)}
    if drive.capabilities.gains == "unknown" and not _as_predicted(verdict):
        shown = {}  # what was driven are other gains
    folder.save("results", f"verify_{record}", {**plain(verdict), **shown, NOTED: [remark] if remark else []})


@contextmanager
def _kept_when_stopped(result: Callable[[], Result], learnt: Learnt, talk: Talk) -> Iterator[None]:
    """Keep and say what repetitions have taught when a later one is stopped; the axis is at rest by then."""
    try:
        yield
    except (BeltcommError, KeyboardInterrupt):
        if learnt.repetitions:
            talk.say(*result().text)
        raise


def _learnt_result(folder: RunFolder, drive: Drive, model: Model, gains: Cascade, learnt: Learnt, sending: Sending, remark: str) -> Result:
    """Outcome of the repetitions; the torque stands beside the move, to be driven and exported with it."""
    best, first = learnt.best, learnt.repetitions[0]
    assert learnt.path is not None
    for one in learnt.repetitions:
        _keep(folder, drive, model, gains, learnt.path, one.name, one.verdict, sending if one is first else LEARNT)
    file = folder.path / "designs" / f"{best.name}_learnt.csv"
    path = with_dwell(learnt.path, REST_S)
    columns = {"t_s": path.t_s, "position_m": path.position_m, "velocity_m_s": path.velocity_m_s, "torque_along_nm": best.torque_nm}
    if best is not first:
        file.parent.mkdir(exist_ok=True)
        write_columns(file, {name: np.asarray(column) for name, column in columns.items()})
    data = {
        "run": str(folder.path),
        "repetitions": [
            {"recording": one.name, "rms_m": one.rms_m, "largest_m": one.largest_m, "torque_nm": float(np.max(np.abs(one.torque_nm)))}
            for one in learnt.repetitions
        ],
        "best": best.name,
        "noise_limit_m": None if math.isnan(learnt.limit_m) else learnt.limit_m,
        "band_hz": learnt.band_hz,
        "ended": learnt.ended,
        "file": str(file) if best is not first else None,
    }
    text: list[str] = [f"  {'drive':>8} {'rms error':>12} {'largest':>12} {'learnt torque':>15}"]
    for number, one in enumerate(learnt.repetitions):
        mark = "   <- kept" if one is best else ""
        most = 1e3 * float(np.max(np.abs(one.torque_nm)))
        text.append(f"  {number + 1:8d} {mm(one.rms_m):>12} {mm(one.largest_m):>12} {most:10.1f} mN m{mark}")
    if not math.isnan(learnt.limit_m):
        text.append(f"  noise's limit: two drives with the same torque differ by {mm(learnt.limit_m)} rms, which nothing learns away")
    text.append(f"  learnt up to {learnt.band_hz:.0f} Hz, where the model knows how the axis answers")
    text += words.remarks_lines([note for note in (learnt.ended, remark) if note])
    if best is first:
        text.append("Nothing was learnt that made the move better.")
    else:
        where = f"--drive {pasted(drive_of(folder))} --run {pasted(folder.path)}"
        text.append(f"Next: beltcomm verify {where} --move {pasted(file)}   (the same move with it)")
    return Result(data, text, 0 if best.verdict.passed else 1)


def _result(
    folder: RunFolder, drive: str, one: tuple[str, Verdict, Demand], feedforward: str | None, remark: str, *, typed: bool = False
) -> Result:
    """One move.   typed : a person has set the gains in the drive, so that only the move tells whether they are those of the design."""
    record, verdict, asked = one
    headline = headline_of(folder)
    notes = ([remark] if remark else []) + (
        ["apply writes the gains and the drive's own feedforward; in this move the host led the motor"]
        if feedforward == "compliant"
        else []
    )
    step = next_command(folder, headline, drive)
    first = headline
    if feedforward is not None and not verdict.passed and headline.move != f"verify_{record}":  # the run's own move is another one
        told = tr("this move, with feedforward {kind} in place of the design's, misses its target", kind=feedforward)
        first = replace(headline, state="fail", sentence=told)
    if typed:
        notes.append(_typed_words(verdict))
        if step.writes_gains:
            step = NextCommand(f"beltcomm report {pasted(folder.path)}", tr("save the gains with the maker's tool, and keep this run"))
    text = [
        Line(""),
        *screens.headline_lines(first),
        Line(""),
        *screens.tracking_lines(verdict),
        *screens.warning_lines(notes),
        *screens.next_lines(step),
    ]
    data = {"run": str(folder.path), "recording": record, **plain(verdict), "headline": headline.to_dict()}
    details = [*words.verdict_lines(verdict, asked, feedforward), *words.remarks_lines(notes)]
    return Result(data, text, 0 if verdict.passed else 1, details=details)


@contextmanager
def _set_by_hand(drive: Drive, folder: RunFolder) -> Iterator[None]:
    """Around a move with gains that only a person sets: a stop is first of all a word on those."""
    try:
        yield
    except SafetyStop as problem:
        if drive.capabilities.gains != "unknown" or problem.reason not in ("lag", "resonance", "position"):
            raise
        raise SafetyStop(
            f"{problem.fault_and_remedy[0]}; the axis was stopped. With the gains of the design it would not have been: type them "
            f"in with the maker's tool first (`beltcomm design {pasted(folder.path)} --details` lists them), and look at the unit of each",
            problem.reason,
        ) from problem


def _as_predicted(verdict: Verdict) -> bool:
    """True if a drive behaved, no worse and no better, as it would with the gains of the prediction."""
    off, said = verdict.measured.dynamic_m, verdict.predicted.dynamic_m
    return off <= AS_PREDICTED * said + SLACK_M and said <= AS_PREDICTED * off + SLACK_M


def _typed_words(verdict: Verdict) -> str:
    """Words on a move with gains that a person has typed in, against the prediction."""
    off, said = verdict.measured.dynamic_m, verdict.predicted.dynamic_m
    if _as_predicted(verdict):
        return "The drive did as predicted with the gains of the design: they are in it, as far as this move can tell."
    return (
        f"The drive was off by {mm(off)} where {mm(said)} are predicted with the gains of the design: they are not what "
        "stands in it. Look at each in the maker's tool, at its unit first."
    )


def _rungs_result(folder: RunFolder, path: Trajectory, driven: list[tuple[str, Verdict, Demand]]) -> Result:
    """All rungs: what each brings, mm at the motor as measured, and at the carriage as measured or predicted."""
    text = [
        f"The same move, {path.position_m[0]:.3f} m to {path.position_m[-1]:.3f} m in {path.duration_s:.2f} s, with the same gains; "
        "errors in mm, in brackets what the rung took away",
        f"  {'':74} {'motor, dynamic':>18} {'static':>14} {'carriage, dynamic':>20} {'static':>14}",
    ]
    data = []
    before: tuple[float, ...] | None = None
    for rung, (record, verdict, _) in zip(RUNGS, driven, strict=True):
        cart = verdict.measured_cart or verdict.predicted_cart
        found = (verdict.measured.dynamic_m, verdict.measured.static_m, cart.dynamic_m, cart.static_m)
        taken = (
            [""] * 4 if before is None else [f" ({'+' * (old >= new)}{in_mm(old - new)})" for old, new in zip(before, found, strict=True)]
        )
        shown = [f"{in_mm(value)}{less}" for value, less in zip(found, taken, strict=True)]
        text.append(f"  {rung.title:74} {shown[0]:>18} {shown[1]:>14} {shown[2]:>20} {shown[3]:>14}")
        data.append({"rung": rung.key, "title": rung.title, "recording": record, **plain(verdict)})
        before = found
    last = driven[-1][1]
    where = "measured" if last.measured_cart else "predicted; nothing measures there"
    text += [f"  at the carriage: {where}", f"  {last.reasons[-1]}"]
    if last.measured_cart is None:
        missed = abs(last.measured.dynamic_m - last.predicted.dynamic_m)
        text.append(f"  the prediction knows the model only: at the motor it is {mm(missed)} off, expect no less at the carriage")
    text.append(
        f"Next: beltcomm verify --drive {pasted(drive_of(folder))} --run {pasted(folder.path)} --feedforward compliant --move FILE"
        "   (a move of your own)"
    )
    return Result({"run": str(folder.path), "rungs": data}, text)
