"""The public functions, one per command of the command line.

Each opens what it needs, does one job, saves its results in the run folder, and returns a :class:`Result`.  They raise only
:class:`beltcomm.errors.BeltcommError` on purpose.  Functions that move an axis leave it stopped and its drive restored.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from beltcomm import words
from beltcomm.axis import Axis, load_axis
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.specification import Specification
from beltcomm.drive import Drive, open_drive
from beltcomm.errors import BeltcommError, DataError, Refused, UsageError
from beltcomm.identify.final import FinalModel, final_model
from beltcomm.identify.magnitude_fit import Solver
from beltcomm.model import Model, load_model, load_plant
from beltcomm.parameters import GAIN_NAMES, cascade_to_parameters
from beltcomm.runfolder import RunFolder
from beltcomm.session import analyse, phases
from beltcomm.session import commission as sequence
from beltcomm.session.commission import Apply, Findings, Settings
from beltcomm.session.machine import Machine, backed_up
from beltcomm.session.plan import Plan, commission_plan, friction_plan, identify_plan, move_plan
from beltcomm.session.store import (
    cascade_from_dict,
    design_to_dict,
    drive_to_dict,
    fit_to_dict,
    plain,
    structure_from_dict,
    verdict_to_dict,
)
from beltcomm.talk import Silence, Talk
from beltcomm.trajectory import Trajectory, load_move, plan_trajectory
from beltcomm.verify import demand

#: m: the longest way of ``beltcomm move``, and its speed.
LONGEST_MOVE_M = 0.1
MOVE_SPEED_M_S = 0.05
#: The cascade assumed for a run folder that no drive has ever been connected to: the thesis's own, at 1 kHz.
THESIS_STRUCTURE = CascadeStructure("thesis", 1e-3, ("none", "notch", "butterworth"), True, True, True)


@dataclass(frozen=True)
class Options:
    """What a command line gives beside its main arguments; every default is the safe choice.

    yes : no questions.   seed : of everything random in a virtual drive.   dry_run : plan only.   resume : go on with a run.
    position_m : where the carriage stands.   home : let the drive find its zero.   payload_kg : heaviest further load.
    apply : "keep", "restore" or "save" the new gains.   quick : one place only.   profile, node, bitrate, realtime : of the drive.
    drive : further options for the adapter, by name.
    """

    yes: bool = False
    seed: int | None = None
    dry_run: bool = False
    resume: bool = False
    position_m: float | None = None
    home: bool = False
    payload_kg: float | None = None
    apply: Apply = "restore"
    quick: bool = False
    profile: str | None = None
    node: int | None = None
    bitrate: int | None = None
    realtime: bool = False
    drive: Mapping[str, object] = field(default_factory=dict)

    def for_drive(self) -> dict[str, object]:
        """The adapter's options: those that were given."""
        given = {"seed": self.seed, "profile": self.profile, "node": self.node, "bitrate": self.bitrate}
        found: dict[str, object] = {name: value for name, value in given.items() if value is not None}
        if self.realtime:
            found["realtime"] = True
        return {**found, **self.drive}


@dataclass(frozen=True)
class Result:
    """What a command did.   data : everything, for programs.   text : the same for people.   exit_code : 0, or 1 for a missed target."""

    data: Mapping[str, Any]
    text: Sequence[str]
    exit_code: int = 0

    def to_json(self) -> Mapping[str, Any]:
        """Everything as a mapping of plain values."""
        return dict(plain(self.data))

    def lines(self) -> Iterable[str]:
        """The result for people."""
        return self.text


def commission(drive: str, axis: Axis | str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """The whole job: identify, fit, friction, design, verify.   Exit code 1 when the verification missed its target.

    Raises UsageError, Refused (also a user's no), DataError, SafetyStop, DriveError.
    """
    options, talk, axis = options or Options(), talk or Silence(), _axis(axis)
    sequence.suitable(axis)
    with open_drive(drive, options.for_drive()) as connected:
        plan = commission_plan(axis, connected.capabilities, options.quick)
        if options.dry_run:
            return _planned(plan)
        folder = _new_folder(run, axis, connected, options)
        findings = Findings()
        with Machine(connected, axis, folder, talk) as machine:
            settings = _settings(options)
            machine.check_scaling()
            sequence.reference(machine, settings)
            _agree(plan, options, talk)
            sequence.commission(machine, replace(settings, quick=options.quick), findings)
        _save(folder, findings)
    return _commissioned(folder, findings, options)


def identify(drive: str, axis: Axis | str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Sign check, rising excitation and one open-loop frequency response at the present place; then a first model."""
    options, talk, axis = options or Options(), talk or Silence(), _axis(axis)
    sequence.suitable(axis)
    with open_drive(drive, options.for_drive()) as connected:
        plan = identify_plan(axis, connected.capabilities)
        if options.dry_run:
            return _planned(plan)
        folder = _new_folder(run, axis, connected, options)
        findings = Findings()
        with Machine(connected, axis, folder, talk) as machine:
            machine.check_scaling()
            sequence.reference(machine, _settings(options))
            _agree(plan, options, talk)
            sequence.identify_here(machine, findings)
            findings.machine_seconds = machine.machine_seconds
        _save(folder, findings)
    text = [
        *_model_text(findings),
        f"Recordings are in {folder.recordings_folder}.",
        f"Next: beltcomm friction --drive {drive} --run {run}",
    ]
    return Result(_data(folder, findings), text)


def fit(run: Path, *, solver: Solver | None = None, options: Options | None = None, talk: Talk | None = None) -> Result:
    """The model from all recordings of a run; no machine needed.   Raises DataError."""
    del options
    talk = talk or Silence()
    folder = RunFolder.open(run)
    talk.phase(1, 1, "fit")
    findings = _fitted(folder, solver or "lm", talk)
    _save(folder, findings)
    friction = words.friction_lines(findings.friction) if findings.friction else []
    text = [*_model_text(findings), *friction, *words.remarks_lines(findings.remarks), f"Next: beltcomm design {run}"]
    return Result(_data(folder, findings), text)


def friction(drive: str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """The constant-speed sweep with a loop designed from the run's model, and its friction."""
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    model = _saved_model(folder)
    with open_drive(drive, options.for_drive()) as connected:
        plan = friction_plan(folder.axis, connected.capabilities)
        if options.dry_run:
            return _planned(plan)
        folder.claim_drive(connected.capabilities.identity)
        findings = _fitted(folder, "lm", Silence(), model)
        with Machine(connected, folder.axis, folder, talk) as machine:
            sequence.reference(machine, _settings(options))
            _agree(plan, options, talk)
            sequence.close_first_loop(machine, findings, model)
            sequence.measure_friction(machine, model)
        findings.friction = analyse.friction_of(folder.recordings())
    folder.save_result("friction", plain(findings.friction))
    text = [
        "The strokes were driven by a loop designed from the run's model.",
        *words.friction_lines(findings.friction),
        f"Next: beltcomm fit {run}",
    ]
    return Result({"run": str(run), "friction": plain(findings.friction)}, text)


def design(
    run: Path,
    *,
    prefilter: str | None = None,
    specification: Specification | None = None,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Gains with margins from the run's model; nothing is written to a drive.   Raises Refused with what binds, DataError."""
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    model = _saved_model(folder)
    findings = Findings()
    recordings = folder.recordings()
    sequence.measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
    structure = _structure(folder, findings)
    if prefilter is not None:
        if prefilter not in structure.prefilters:
            raise Refused(f"the drive of this run has no {prefilter} prefilter; it has {', '.join(structure.prefilters)}")
        specification = replace(specification or analyse.PRODUCT_SPECIFICATION, prefilters=(prefilter,))  # type: ignore[arg-type]
    settings = replace(_settings(options), specification=specification)
    findings.design, findings.cascade = sequence.design_for(folder.axis, model, structure, findings, settings)
    mapping = _design_dict(findings)
    folder.save_design("final", mapping)
    text = [
        *words.design_lines(findings.design, findings.cascade),
        *words.remarks_lines(findings.remarks),
        f"Next: beltcomm verify --drive DRIVE --run {run}, or beltcomm apply --drive DRIVE --run {run}",
    ]
    return Result({"run": str(run), **mapping}, text)


def verify(
    drive: str,
    run: Path,
    *,
    move: Path | None = None,
    trajectory: str | None = None,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Drive a move with the run's design, compare its error with the prediction.   Exit code 1 when a target is missed."""
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    model, saved = _saved_model(folder), folder.load("designs", "final")
    cascade = cascade_from_dict(saved)
    with open_drive(drive, options.for_drive()) as connected:
        folder.claim_drive(connected.capabilities.identity)
        with Machine(connected, folder.axis, folder, talk) as machine:
            sequence.reference(machine, _settings(options))
            path, remark = _verification_path(machine, model, move, trajectory)
            plan = _plan_of(machine, model, path)
            if options.dry_run:
                return _planned(plan)
            _agree(plan, options, talk)
            name = f"move_{1 + sum(n.startswith('move_') for n in folder.finished_names())}"
            verdict, asked = sequence.verify_move(machine, model, cascade, float(saved["dead_time_s"]), path, name)
    folder.save_result(f"verify_{name}", verdict_to_dict(verdict))
    text = words.verdict_lines(verdict, asked) + words.remarks_lines([remark] if remark else [])
    text.append(f"Next: beltcomm apply --drive {drive} --run {run} --save" if verdict.passed else f"Next: beltcomm design {run}")
    return Result({"run": str(run), "recording": name, **verdict_to_dict(verdict)}, text, 0 if verdict.passed else 1)


def apply(drive: str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Write the run's gains to the drive and read them back; with ``apply="save"`` for good.   Nothing moves."""
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    return _written(drive, folder, cascade_to_parameters(cascade_from_dict(folder.load("designs", "final"))), options, talk, "applied")


def rollback(drive: str, run: Path, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Write back the parameters that the drive had when the run began.   Nothing moves."""
    options, talk = options or Options(), talk or Silence()
    folder = RunFolder.open(run)
    return _written(drive, folder, dict(backed_up(folder)), options, talk, "rolled back")


def move(drive: str, axis: Axis | str, by_m: float, *, options: Options | None = None, talk: Talk | None = None) -> Result:
    """Move the carriage slowly by a small distance with the gains that are in the drive.   Raises UsageError beyond 100 mm."""
    options, talk, axis = options or Options(), talk or Silence(), _axis(axis)
    if not 0.0 < abs(by_m) <= LONGEST_MOVE_M:
        raise UsageError(f"a move by {1e3 * by_m:g} mm is not a small one; give 0 to {1e3 * LONGEST_MOVE_M:.0f} mm, either way")
    axis.require("move", "pulley.effective_radius_m", "travel.min_m", "travel.max_m")
    with open_drive(drive, options.for_drive()) as connected:
        outcome = _small_move(connected, axis, by_m, options, talk)
    return outcome


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
    if options.payload_kg:
        model = model.with_values({"cart.mass": model["cart.mass"] + options.payload_kg})
    with open_drive(f"virtual:{plant}", options.for_drive()) as connected:
        folder = _new_folder(run, axis, connected, options)
        with Machine(connected, axis, folder, talk) as machine:
            name = _experiment(machine, model, experiment)
    return Result(
        {"run": str(run), "recording": name, "plant": plant},
        [f"Recorded {name} of plant {plant} in {folder.recordings_folder}.", f"Next: beltcomm fit {run}"],
    )


def _experiment(machine: Machine, model: Model, experiment: str) -> str:
    """Run one experiment with everything known; returns the name of its recording."""
    if experiment == "frf":
        phases.frequency_response(machine, "frf_1", model, machine.axis.torque_limit_nm, sequence.RESPONSE_S)
        return "frf_1"
    findings = Findings()
    sequence.close_first_loop(machine, findings, model)
    if experiment == "friction_sweep":
        sequence.measure_friction(machine, model)
        return "sweep"
    structure = machine.drive.capabilities.structure
    _, cascade = sequence.design_for(machine.axis, model, structure, findings, Settings())
    path, _ = sequence.standard_move(machine, model)
    sequence.verify_move(machine, model, cascade, 0.0, path)
    return "move_1"


def _axis(axis: Axis | str) -> Axis:
    return axis if isinstance(axis, Axis) else load_axis(axis)


def _settings(options: Options) -> Settings:
    payloads = (options.payload_kg,) if options.payload_kg else ()
    return Settings(apply=options.apply, position_m=options.position_m, home=options.home, payloads_kg=payloads)


def _new_folder(run: Path, axis: Axis, drive: Drive, options: Options) -> RunFolder:
    folder = RunFolder.create(run, axis, resume=options.resume)
    folder.claim_drive(drive.capabilities.identity)
    folder.save_result("drive", drive_to_dict(drive.capabilities))
    return folder


def _agree(plan: Plan, options: Options, talk: Talk) -> None:
    """Say what will happen and ask, unless told not to.   Raises Refused for a no."""
    talk.say("\n".join(plan.lines()))
    if not options.yes and not talk.confirm("May the axis move like this?"):
        raise Refused("nothing was moved, as you said; --dry-run shows the plan without asking")


def _planned(plan: Plan) -> Result:
    return Result({"plan": plain(plan), "seconds": plan.seconds}, [*plan.lines(), "Nothing was moved (--dry-run)."])


def _structure(folder: RunFolder, findings: Findings) -> CascadeStructure:
    known = folder.load_result("drive")
    if known is not None:
        return structure_from_dict(known)
    findings.remarks.append("no drive is known to this run: designed for the thesis's cascade at 1 kHz")
    return THESIS_STRUCTURE


def _counts(folder: RunFolder) -> int:
    """Encoder counts per revolution: the drive's word, else the axis file's."""
    known = folder.load_result("drive")
    counts = int(known["counts_per_rev"]) if known else folder.axis.motor.encoder_counts_per_rev
    if not counts:
        folder.axis.require("the final fit", "motor.encoder_counts_per_rev")
    return int(counts or 0)


def _fitted(folder: RunFolder, solver: Solver, talk: Talk, model: Model | None = None) -> Findings:
    """Final fit, log-magnitude fits, dead time and friction from what the run folder holds."""
    findings = Findings()
    recordings = folder.recordings()
    if model is None:
        findings.final = final_model(recordings, folder.axis, _counts(folder), progress=lambda f: talk.progress(f, None))
        model = findings.final.fit.model
        findings.characteristics = analyse.characteristics(findings.final.fit, _middle(folder.axis))
    sequence.measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model, solver)
    try:
        findings.friction = analyse.friction_of(recordings)
    except DataError as problem:
        findings.remarks.append(str(problem))
    return findings


def _middle(axis: Axis) -> float:
    return 0.5 * (float(axis.travel.min_m or 0.0) + float(axis.travel.max_m or 0.0))


def _saved_model(folder: RunFolder) -> Model:
    return load_model(folder.file("models", "final"))


def _save(folder: RunFolder, findings: Findings) -> None:
    """Everything known into the run folder."""
    if findings.final is not None:
        folder.save_model("final", findings.final.fit.model.to_dict())
        folder.save_result("fit", _fit_dict(findings.final, findings))
    if findings.friction is not None:
        folder.save_result("friction", plain(findings.friction))
    if findings.design is not None:
        folder.save_design("final", _design_dict(findings))
    if findings.verdict is not None:
        folder.save_result("verify_move_1", verdict_to_dict(findings.verdict))


def _fit_dict(final: FinalModel, findings: Findings) -> dict[str, Any]:
    return {
        **fit_to_dict(final.fit),
        "reason": final.reason,
        "rejected": fit_to_dict(final.rejected) if final.rejected else None,
        "characteristics": plain(findings.characteristics),
        "log_magnitude": {name: plain(one.parameters) for name, one in findings.thesis.items()},
        "dead_time": {"value_s": findings.dead_time.value_s, "interval_s": findings.dead_time.interval_s} if findings.dead_time else None,
    }


def _design_dict(findings: Findings) -> dict[str, Any]:
    if findings.design is None or findings.cascade is None:
        return {}
    apparent = analyse.apparent_damping(findings.thesis)
    return design_to_dict(findings.design, findings.cascade, sequence.delay(findings), apparent)


def _model_text(findings: Findings) -> list[str]:
    if findings.final is None:
        return []
    lines = words.model_lines(findings.final.fit, findings.characteristics)
    lines.append(f"  {findings.final.reason}")
    if findings.dead_time is not None:
        interval = 1e3 * findings.dead_time.interval_s
        lines.append(f"  delay from torque setpoint to torque: {words.number(1e3 * findings.dead_time.value_s, interval, 'ms')}")
    return lines + words.thesis_lines(findings.thesis)


def _data(folder: RunFolder, findings: Findings) -> dict[str, Any]:
    data: dict[str, Any] = {"run": str(folder.path), "machine_seconds": findings.machine_seconds, "remarks": findings.remarks}
    if findings.final is not None:
        data["model"] = findings.final.fit.model.to_dict()
        data["fit"] = _fit_dict(findings.final, findings)
    if findings.friction is not None:
        data["friction"] = findings.friction
    if findings.design is not None:
        data["design"] = _design_dict(findings)
    if findings.verdict is not None:
        data["verdict"] = findings.verdict
    return data


def _commissioned(folder: RunFolder, findings: Findings, options: Options) -> Result:
    passed = findings.verdict is not None and findings.verdict.passed
    kept = {"restore": "The drive has its old gains again", "keep": "The new gains are in the drive until power-off"}
    state = kept.get(options.apply, "The new gains are saved in the drive") if passed else kept["restore"]
    text = [
        "The axis meets its targets." if passed else "The axis misses its targets.",
        "",
        *_model_text(findings),
        *(words.friction_lines(findings.friction) if findings.friction else []),
        *(words.design_lines(findings.design, findings.cascade) if findings.design and findings.cascade else []),
        *(words.verdict_lines(findings.verdict, findings.demand) if findings.verdict else []),
        *words.remarks_lines(findings.remarks),
        "",
        f"{findings.machine_seconds:.0f} s on the machine. Everything is in {folder.path}.",
        f"{state}. Next: "
        + (
            f"beltcomm apply --drive DRIVE --run {folder.path} --save"
            if passed and options.apply == "restore"
            else f"beltcomm rollback --drive DRIVE --run {folder.path} undoes it"
            if passed
            else f"look at the remarks above, then beltcomm design {folder.path} and beltcomm verify --drive DRIVE --run {folder.path}"
        ),
    ]
    return Result(_data(folder, findings), text, 0 if passed else 1)


def _verification_path(machine: Machine, model: Model, move: Path | None, name: str | None) -> tuple[Trajectory, str]:
    if move is not None:
        return load_move(move, machine.drive.capabilities.sample_period_s, machine.axis), ""
    if name is None:
        return sequence.standard_move(machine, model)
    limits = machine.axis.trajectory(name)
    low, high = machine.full_room().window_m
    start = max(0.0, low)
    return plan_trajectory(start, min(start + sequence.MOVE_M, high), limits, machine.drive.capabilities.sample_period_s), ""


def _plan_of(machine: Machine, model: Model, path: Trajectory) -> Plan:
    asked = demand(path, model)
    travel = float(abs(path.position_m[-1] - path.position_m[0]))
    seconds = path.duration_s + sequence.REST_S + 3.0
    what = f"go to {path.position_m[0]:.3f} m and from there to {path.position_m[-1]:.3f} m in {path.duration_s:.2f} s with the new gains"
    return move_plan(machine.axis, travel, asked.speed_m_s, asked.torque_nm, asked.feed_force_n, seconds, what)


def _written(drive: str, folder: RunFolder, wanted: Mapping[str, float], options: Options, talk: Talk, done: str) -> Result:
    """Table of differences, question, write with read-back, save when asked."""
    with open_drive(drive, options.for_drive()) as connected:
        folder.claim_drive(connected.capabilities.identity)
        present = connected.backup()
        values = {name: value for name, value in wanted.items() if name in present}
        left_out = [name for name in wanted if name not in present and wanted[name]]
        changes = {n: (present[n], v) for n, v in values.items() if not math.isclose(present[n], v, rel_tol=1e-6, abs_tol=1e-12)}
        table = [f"  {n:24} {old:>12.6g} -> {new:.6g}" for n, (old, new) in changes.items()] or ["  nothing differs"]
        if left_out:
            table.append(f"  the drive has no {', '.join(left_out)}")
        data: dict[str, Any] = {"run": str(folder.path), "changes": {n: list(pair) for n, pair in changes.items()}, "left_out": left_out}
        if options.dry_run:
            return Result({**data, "written": False}, ["Would change:", *table, "Nothing was written (--dry-run)."])
        talk.say("\n".join(["Parameters of the drive, now -> then:", *table]))
        if changes and not options.yes and not talk.confirm("Write these to the drive? Nothing moves."):
            raise Refused("nothing was written, as you said")
        if folder.load_result("backup") is None:
            folder.save_result("backup", {"drive": dict(connected.capabilities.identity), "parameters": present})
        stored = connected.write(values)
        if options.apply == "save":
            connected.save()
        folder.journal(f"{done}: " + ", ".join(f"{n}={v:.6g}" for n, v in stored.items()))
    saved = "and saved" if options.apply == "save" else "until power-off (--save makes it permanent)"
    gains = sum(name in GAIN_NAMES for name in changes)
    return Result(
        {**data, "written": True, "saved": options.apply == "save", "stored": stored},
        [f"{len(changes)} parameters {done} ({gains} of them gains), read back, {saved}:", *table],
    )


def _small_move(drive: Drive, axis: Axis, by_m: float, options: Options, talk: Talk) -> Result:
    from beltcomm.session.creep import small_move

    plan = move_plan(
        axis,
        abs(by_m),
        MOVE_SPEED_M_S,
        axis.torque_limit_nm,
        float(axis.limits.feed_force_n or 0.0),
        4.0,
        f"move {1e3 * by_m:+.1f} mm slowly",
    )
    if options.dry_run:
        return _planned(plan)
    _agree(plan, options, talk)
    start, end = small_move(drive, axis, by_m, MOVE_SPEED_M_S, options.position_m)
    reached = abs(end - start - by_m) < 0.2 * abs(by_m)
    text = [f"The carriage moved {1e3 * (end - start):+.2f} mm, asked were {1e3 * by_m:+.2f} mm."]
    if not reached:
        text.append("The gains in the drive do not bring it there; beltcomm commission finds better ones.")
    return Result({"moved_m": end - start, "asked_m": by_m}, text, 0 if reached else 1)


__all__ = [
    "BeltcommError",
    "Cascade",
    "Options",
    "Result",
    "apply",
    "commission",
    "design",
    "fit",
    "friction",
    "identify",
    "move",
    "rollback",
    "simulate",
    "verify",
]
