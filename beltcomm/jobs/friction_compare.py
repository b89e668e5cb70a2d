"""``beltcomm friction --compare``: the sweeps of one run once more, or friction against load over several; no machine needed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from beltcomm.errors import DataError, UsageError
from beltcomm.given import Place, pasted, places
from beltcomm.identify.friction import FrictionFit, fit_friction, slowest_fitted_rad_s
from beltcomm.identify.sweeps import Drift, LoadDependence, Sweep, load_dependence
from beltcomm.model import Model
from beltcomm.pages import pictures as drawing
from beltcomm.result import Result, plain
from beltcomm.rundata import offline
from beltcomm.rundata.delays import measure_delay_and_damping
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.friction_study import FrictionStudy, data_of, study_of
from beltcomm.rundata.kept import kept_path
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import friction, words
from beltcomm.sentences.own_words import own_words
from beltcomm.talk import Silence, Talk

#: Share by which the differences of stated payloads and of identified masses may differ before it is said.
MASS_SHARE = 0.05
#: Entries of axis.yaml that may differ between runs of one axis: what is mounted, how fast it may go, what it is called.
NOT_THE_AXIS = ("payload.", "trajectories.", "limits.", "name ")


@own_words
def friction_compare(runs: Place | Sequence[Place], *, pictures: bool = False, command: str = "", talk: Talk | None = None) -> Result:
    """The sweeps of a run once more, or friction against load over the sweeps of several runs of one axis; no machine needed.

    Parameters
    ----------
    runs : Place or sequence of Place
        One run, or several of one axis with different loads.
    pictures : bool
        Pictures into ``RUN/pictures``.
    command : str
        Command line, kept as provenance.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Friction by run, or over the load.

    Raises
    ------
    UsageError
        Without a run or for runs of different axes.
    DataError
        For a run without a sweep or without a load.
    """
    runs, talk = places(runs), talk or Silence()
    if not runs:
        raise UsageError("nothing to compare: give one run folder to see its sweeps, two or more with different loads to compare them")
    if len({run.resolve() for run in runs}) < len(runs):
        raise UsageError("a run folder is given twice; give each once")
    folders = [RunFolder.open(run) for run in runs]
    for folder in folders:
        if not folder.axis.has_transmission:
            raise UsageError(f"{folder.path} is of an axis without belt and pulley; sweeps are told at the motor of a belt axis only")
    _one_axis(folders)
    studies, text, data = [], list[str](), dict[str, Any]()
    for number, folder in enumerate(folders, start=1):
        talk.phase(number, len(folders), folder.path.name)
        recordings = folder.recordings()
        model = offline.saved_model(folder) if "final" in folder.names("models") else None
        findings = Findings(kept_path=kept_path(folder))
        if model is not None:
            measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model)
        try:
            found = study_of(recordings, folder.axis, model, findings.thesis)
        except DataError as problem:
            raise DataError(f"{folder.path}: {problem}") from problem
        shown, remarks = drawing.friction_pictures(folder, found, command) if pictures else ([], [])
        studies.append((folder, found, model))
        data[str(folder.path)] = {"friction": plain(found.friction), **data_of(found), "pictures": shown}
        text += [f"{folder.path}:"] if len(folders) > 1 else []
        text += [f"Note: {remark}" for remark in folder.remarks]
        text += words.friction_lines(found.friction) + friction.study_lines(found.sweeps, found.drifts, ())
        text += [*friction.standstill_lines(found.standstill), *drawing.lines(folder, shown, remarks), ""]
    payloads = {s.payload_kg for _, found, _ in studies for s in found.sweeps if s.fit is not None}
    if len(folders) < 2 and len(payloads) < 2:
        return Result({"runs": data, "load": None}, text[:-1])
    by, found_load, common = _load_of(studies)
    shown, remarks = drawing.load_picture(folders[0], found_load, by, command) if pictures else ([], [])
    text += friction.load_lines(found_load, by, common) + drawing.lines(folders[0], shown, remarks)
    text += [f"Note: {remark}" for remark in _told_apart(studies)]
    return Result({"runs": data, "load": {**plain(found_load), "by": by, "pictures": shown}}, text)


def _load_of(studies: Sequence[tuple[RunFolder, FrictionStudy, Model | None]]) -> tuple[str, LoadDependence, float]:
    """Friction against load; what the load is, in words, and the fastest speed that all have, rad/s at the motor.

    The stated payload where every sweep has one, else the moving mass of each run's model; raises DataError without either.
    """
    groups: dict[str, tuple[RunFolder, Model | None, float | None, list[Sweep]]] = {}
    alone = len({folder.path.name for folder, _, _ in studies}) == len(studies)
    for folder, found, model in studies:
        for sweep in found.sweeps:
            if sweep.fit is None:
                continue
            run = folder.path.name if alone else str(folder.path)
            name = run if sweep.payload_kg is None else f"{run}, {sweep.payload_kg:g} kg"
            groups.setdefault(name, (folder, model, sweep.payload_kg, []))[3].append(sweep)
    stated = all(payload is not None for _, _, payload, _ in groups.values())
    tops = [max(abs(p.reference_rad_s) for s in sweeps for p in s.plateaus) for *_, sweeps in groups.values()]
    common = min(tops)
    loads: dict[str, tuple[float, Sequence[FrictionFit]]] = {}
    for name, (folder, model, payload, sweeps) in groups.items():
        if not stated and model is None:
            raise DataError(
                f"{folder.path} states no payload and has no model: nobody knows its load; write payload_kg into the sidecars of its "
                f"sweeps, or run `beltcomm fit {pasted(folder.path)}`"
            )
        load = payload if stated else model["cart.mass"] if model is not None else None
        slowest = slowest_fitted_rad_s(folder.axis.transmission_m_rad)
        fits = [fit_friction([p for p in s.plateaus if abs(p.reference_rad_s) <= 1.002 * common], slowest_rad_s=slowest) for s in sweeps]
        loads[name] = (float(load or 0.0), fits)
    return "payload mounted" if stated else "moving mass of the model", load_dependence(loads), common


def _one_axis(folders: Sequence[RunFolder]) -> None:
    """Raise UsageError for runs of different axes."""
    for folder in folders[1:]:
        changes = [c for c in folders[0].axis.changes(folder.axis) if not c.startswith(NOT_THE_AXIS)]
        if changes:
            raise UsageError(
                f"{folders[0].path} and {folder.path} are of different axes ({'; '.join(changes[:3])}): their friction says nothing about "
                "load; compare runs of one axis"
            )


def _told_apart(studies: Sequence[tuple[RunFolder, FrictionStudy, Model | None]]) -> list[str]:
    """Other differences between the runs, in words."""
    remarks = []
    drives = [dict(folder.drive) for folder, _, _ in studies]
    known = [
        (payloads.pop(), model["cart.mass"])
        for _, found, model in studies
        if model is not None and len(payloads := {s.payload_kg for s in found.sweeps if s.fit is not None}) == 1
    ]
    for payload, mass in known[1:]:
        if payload is None or known[0][0] is None:
            continue
        stated, weighed = payload - known[0][0], mass - known[0][1]
        if abs(weighed - stated) > MASS_SHARE * max(abs(stated), abs(weighed)):
            remarks.append(
                f"the payloads stated differ by {stated:.2f} kg, the moving masses of the models by {weighed:.2f} kg; one of them is off"
            )
    if any(drive != drives[0] for drive in drives):
        remarks.append("the runs were made on different drives or plants: what differs there counts as load here")
    if any(isinstance(d, Drift) and friction.drifts(d) for _, found, _ in studies for d in found.drifts.values()):
        remarks.append("friction drifts within a run: sweep each load after the same time in motion, or let the axis warm up first")
    return remarks
