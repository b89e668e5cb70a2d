"""``beltcomm friction`` on the machine: sweeps in the orders of 3.6."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.errors import DataError, Refused
from beltcomm.experiments import phases
from beltcomm.experiments.bounds import Experiment, course_before, gentle_force_n, peak_torque_nm, stroking_nm
from beltcomm.experiments.friction_feedforward import learn_friction
from beltcomm.experiments.plan import MOVE_SECONDS, Plan, friction_plan
from beltcomm.experiments.recording_steps import measure_friction
from beltcomm.experiments.sign import sign_words
from beltcomm.given import pasted
from beltcomm.identify.magnitude_fit import MagnitudeFit
from beltcomm.identify.sweeps import SweepNote, note_of
from beltcomm.language import tr
from beltcomm.machine.machine import Machine, stroking
from beltcomm.model import Model
from beltcomm.pages import pictures
from beltcomm.recording.sidecar import Sidecar, load_sidecar
from beltcomm.result import Line, Result, plain
from beltcomm.rundata import friction_study
from beltcomm.runfolder import RunFolder, next_free
from beltcomm.schedule import orders
from beltcomm.schedule.orders import DEFAULT, Stroke, Wanted
from beltcomm.sentences import friction, screens, words
from beltcomm.trajectory import Trajectory

#: s: to bring the carriage to the start of a record and let it rest, at most.
BRING_SECONDS = MOVE_SECONDS + 1.0
#: How their records are called: not as those of a commissioning, which --resume would take for its own.
RECORDS = "orders_"
#: s: longest record of a velocity loop, which drifts along the axis from stroke to stroke.
DRIFTING_RECORD_S = 20.0
#: A payload may weigh this many times what the run's model moves: the model's mass is a little uncertain, and the bare carriage is light.
TOO_HEAVY = 1.05


@dataclass(frozen=True)
class RecordedSweeps:
    """Sweeps recorded.

    Attributes
    ----------
    left_out_m_s : tuple of float
        Speeds without a way, or without one to stop.
    remarks : tuple of str
        On records that were not usable.
    """

    names: tuple[str, ...]
    left_out_m_s: tuple[float, ...] = ()
    remarks: tuple[str, ...] = ()


def check_payload(folder: RunFolder, model: Model, asked: Wanted) -> None:
    """Refuse a payload that is not that of the run's records, or cannot be: its loop was made for another mass.

    Parameters
    ----------
    folder : RunFolder
    model : Model
        With the mass that moves, kg.
    asked : Wanted
        Payload mounted, kg; None is not checked.

    Raises
    ------
    Refused
        For either.
    """
    if asked.mounted_kg is None:
        return
    if asked.mounted_kg > TOO_HEAVY * model["cart.mass"]:
        raise Refused(
            f"{asked.mounted_kg:g} kg are said to be mounted, but the run's model moves {model['cart.mass']:.3g} kg in all: its loop was "
            "not made for that load. Begin a run with the payload (`beltcomm identify`), sweep there, and set both side by side with "
            "`beltcomm friction --compare RUN RUN`"
        )
    stated = {s.payload_kg for s in _sidecars(folder).values() if s.payload_kg is not None}
    if stated - {asked.mounted_kg}:
        known = ", ".join(f"{kg:g} kg" for kg in sorted(stated))
        raise Refused(f"this run's records were made with {known} mounted, now {asked.mounted_kg:g} kg are stated; one run holds one load")


def _sidecars(folder: RunFolder) -> dict[str, Sidecar]:
    """Of the finished records, by name."""
    names = folder.finished_names()
    return {n: load_sidecar(path)[0] for n in names if (path := folder.recordings_folder / f"{n}.yaml").is_file()}


def plan_of(axis: Axis, capabilities: Capabilities, model: Model, asked: Wanted) -> Plan:
    """Plan of the sweeps, with the seconds of each, before anything moves.

    Parameters
    ----------
    axis : Axis
        Data sheets.
    capabilities : Capabilities
        Of the drive.
    model : Model
        Of the axis.
    asked : Wanted
        Orders and repetitions.

    Raises
    ------
    Refused
        For orders where the drive makes the strokes by itself and is polled.
    """
    usual = friction_plan(axis, capabilities)
    if asked.plain:
        return usual
    if stroking(capabilities) == "profile":
        raise Refused(
            f"{capabilities.name} is looked at once in {1e3 * capabilities.sample_period_s:.0f} ms, too seldom for the short plateaus of "
            "the orders; leave --order and --repeat out, or connect the drive's CAN port"
        )
    course = course_before(axis, capabilities, model["cart.mass"])
    whole = course.window_m[1] - course.window_m[0]
    room = course.ends_m[1] - course.ends_m[0] - phases.ARRIVED_M
    torque = peak_torque_nm(axis, capabilities)
    *lines, sweep = usual.experiments
    notes = list[str]()
    for order, repetition in asked.sweeps:
        title = f"{f'order {order}' if order != DEFAULT else 'sweep'}, {repetition}: {orders.WORDS[order]}"[:40]
        if order == DEFAULT:
            lines.append(replace(sweep, title=title))
            continue
        strokes, _ = orders.strokes_for(orders.speeds_of(order, asked.often), room, course.gentle, axis)
        records = orders.records_of(strokes, course.gentle, _record_s(capabilities))
        top, way = max(s.speed_m_s for s in strokes), max(s.length_m for s in strokes)
        seconds = sum(orders.seconds_of(s, course.gentle) for s in strokes) + BRING_SECONDS * len(records)
        lines.append(Experiment(title, way, whole, top, torque, gentle_force_n(axis), seconds, stroking_nm(axis, capabilities)))
    if any(order != DEFAULT for order, _ in asked.sweeps):
        strokes, left_out = orders.strokes_for(orders.speeds_of("I", 1), room, course.gentle, axis)
        notes += friction.stroke_lines(strokes, left_out)
    swept = tr("travel in closed loop at constant speeds, both ways, with a loop designed from the run's model")
    return Plan(
        tr("The carriage of {name} will {what}.", name=axis.name or tr("the axis"), what=sign_words(axis, capabilities.kinds) + swept)
        + tr(" What was recorded when it is stopped is kept."),
        tuple(lines),
        verb="friction",
        notes=tuple(notes),
    )


def _record_s(capabilities: Capabilities) -> float:
    """Longest record of a sweep, s."""
    return DRIFTING_RECORD_S if stroking(capabilities) == "velocity" else orders.RECORD_S


def record(machine: Machine, model: Model, asked: Wanted) -> RecordedSweeps:
    """Drive the sweeps with the loop that is in the drive; finished records stay.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    model : Model
        With the loop's friction and mass.
    asked : Wanted
        Orders and repetitions.

    Returns
    -------
    RecordedSweeps
        Names of the records, speeds left out, m/s, and remarks.

    Raises
    ------
    DataError
        When no sweep could be used.
    BeltcommError
        What the machine raises.
    """
    if asked.plain:
        taken = machine.folder.finished_names()
        name = "sweep" if "sweep" not in taken else next_free("sweep_", taken, 2)
        measure_friction(machine, model, name, held_out=name != "sweep" and _judges(machine.folder))
        return RecordedSweeps((name,))
    machine.begin(machine.titles[-1])
    learn_friction(machine, model)
    measurement = 1 + max([note_of(s, n).measurement for n, s in _sidecars(machine.folder).items()], default=0)
    made, left_out, remarks = list[str](), set[float](), list[str]()
    for order, repetition in asked.sweeps:
        note = SweepNote(measurement, order, repetition)
        machine.detail(f"{'order ' + order if order != DEFAULT else 'sweep'}, {repetition}: {orders.WORDS[order]}")
        if order == DEFAULT:
            phases.move_to(machine, phases.stroke_ends(machine)[0], model)
            made.append(_recorded(machine, phases.sweep(machine, model).trajectory, note, asked))
            continue
        records, without = _possible(machine, model, order, asked)
        left_out |= without
        for strokes in records:
            low, high = phases.stroke_ends(machine)
            phases.move_to(machine, low, model)
            limits, period = phases.gentle_limits(machine, model, np.inf), machine.drive.capabilities.sample_period_s
            path = orders.path_of(strokes, machine.position_m, high, limits, period)
            try:
                made.append(_recorded(machine, path, note, asked))
            except DataError as problem:  # the axis stands; a weak velocity loop does not get it moving at the slowest speeds
                slow, fast = min(s.speed_m_s for s in strokes), max(s.speed_m_s for s in strokes)
                remarks.append(f"order {order}, {repetition}: {slow:g} to {fast:g} m/s could not be used: {problem}")
    if not made:
        raise DataError(f"no sweep could be used: {'; '.join(remarks)}")
    return RecordedSweeps(tuple(made), tuple(sorted(left_out)), tuple(remarks))


def _possible(machine: Machine, model: Model, order: str, asked: Wanted) -> tuple[list[tuple[Stroke, ...]], set[float]]:
    """The strokes of an order whose every stop ends inside the travel, in records, and the speeds that are left out."""
    limits, (low, high) = phases.gentle_limits(machine, model, np.inf), phases.stroke_ends(machine)
    period = machine.drive.capabilities.sample_period_s
    strokes, left_out = orders.strokes_for(orders.speeds_of(order, asked.often), high - low - phases.ARRIVED_M, limits, machine.axis)
    beyond: dict[float, str] = {}
    for stroke in set(strokes):
        path = orders.path_of([stroke], low, high, limits, period)
        beyond[stroke.speed_m_s] = machine.stops_badly(path.position_m, path.velocity_m_s)
    kept = [s for s in strokes if not beyond[s.speed_m_s]]
    if len({s.speed_m_s for s in kept}) < 2:
        raise Refused(f"no sweep is possible: {next(filter(None, beyond.values()))}")
    without = {speed for speed, words_ in beyond.items() if words_}
    return orders.records_of(kept, limits, _record_s(machine.drive.capabilities)), {*left_out, *without}


def _recorded(machine: Machine, path: Trajectory, note: SweepNote, asked: Wanted) -> str:
    """One record; its name."""
    name = next_free(RECORDS, machine.folder.finished_names())
    told = {"held_out": _judges(machine.folder), "payload_kg": asked.mounted_kg, "extra": note.to_dict()}
    sidecar = phases.sidecar(machine, "friction_sweep", **told)
    machine.record(name, machine.follow(path, machine.stroking()), phases.stroke_envelope(machine), sidecar)
    return name


def _judges(folder: RunFolder) -> bool:
    """True if the next sweep is held out: the first of a run is fitted, for a model needs one, and the others contradict or confirm it."""
    return any(s.experiment == "friction_sweep" and not s.held_out for s in _sidecars(folder).values())


def result(
    folder: RunFolder, model: Model, fits: Mapping[str, MagnitudeFit], made: RecordedSweeps, *, drawn: bool = False, command: str = ""
) -> Result:
    """Results of recorded sweeps into the run, and in words and pictures.

    Parameters
    ----------
    folder : RunFolder
    model : Model
        Of the run.
    fits : mapping of str to MagnitudeFit
        Log-magnitude fits of the run's responses, by record.
    made : RecordedSweeps
        Names of the records, speeds left out, m/s, and remarks.
    drawn : bool
        True for pictures.
    command : str
        Kept as provenance.
    """
    found = friction_study.study_of(folder.recordings(), folder.axis, model, fits)
    folder.save("results", "friction", plain(found.friction))
    folder.save("results", "friction_sweeps", friction_study.data_of(found))
    shown, remarks = pictures.friction_pictures(folder, found, command) if drawn else ([], [])
    warnings = [*found.friction.remarks, *made.remarks]
    text = [
        Line(""),
        Line("  ", (tr("SWEPT"), "good"), "   ", (tr("friction over {count} records", count=len(made.names)), "title")),
        Line(""),
        screens.friction_line(found.friction),
        *screens.warning_lines(warnings),
        f"Next: beltcomm design {pasted(folder.path)}   (gains, by a model of all records)",
    ]
    details = [
        "Driven by a loop designed from the run's model:",
        *words.friction_lines(found.friction),
        *friction.study_lines(found.sweeps, found.drifts, made.left_out_m_s),
        *friction.standstill_lines(found.standstill),
        *pictures.lines(folder, shown, remarks),
        *words.remarks_lines(made.remarks),
    ]
    data = {
        "run": str(folder.path),
        "recordings": list(made.names),
        "left_out_m_s": list(made.left_out_m_s),
        "remarks": list(made.remarks),
        "friction": plain(found.friction),
        **friction_study.data_of(found),
        "pictures": shown,
    }
    return Result(data, text, details=details)
