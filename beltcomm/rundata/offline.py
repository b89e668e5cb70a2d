"""Results from a run folder alone: the fit, and what a drive that was once connected could do."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from beltcomm.control import Cascade, CascadeStructure
from beltcomm.design.feedforward import FeedforwardKind
from beltcomm.encoder.estimators import EstimatorSettings
from beltcomm.errors import DataError, UsageError
from beltcomm.fit.noise.decimation import smallest_step
from beltcomm.foreign.checks import check
from beltcomm.given import pasted
from beltcomm.identify.final import final_model
from beltcomm.identify.friction import slowest_fitted_rad_s
from beltcomm.identify.magnitude_fit import Solver
from beltcomm.identify.standstill import largest
from beltcomm.laboratory.cross_checks import sheet_doubts
from beltcomm.laboratory.run_checks import Checked, check_run
from beltcomm.model import Model
from beltcomm.recording import Recording, common_side
from beltcomm.rundata import analyse
from beltcomm.rundata.delays import measure_delay_and_damping
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.fitted_run import with_remarks_on_rest
from beltcomm.rundata.kept import kept_path
from beltcomm.rundata.revisions import CURRENT, model_named, trusted_model
from beltcomm.rundata.store import cascade_from_dict, saved_design, structure_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

#: The cascade assumed for a run folder that no drive has ever been connected to: the thesis's own, at 1 kHz.
THESIS_STRUCTURE = CascadeStructure("thesis", 1e-3, ("none", "notch", "butterworth"), True, True, True)


def saved_model(folder: RunFolder) -> Model:
    """The run's newest model.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
    """
    return model_named(folder, CURRENT)


def trusted_revision(folder: RunFolder, revision: str = "") -> tuple[Model, str, str]:
    """The model of a revision, or the newest that held-out records do not contradict; its revision and a sentence on it, "" for neither.

    Parameters
    ----------
    folder : RunFolder
    revision : str
        Name; "" for the newest.
    """
    if revision and revision in folder.names("models"):
        return model_named(folder, revision), revision, ""
    current = saved_model(folder)
    model, name, sentence = trusted_model(folder)
    return model or current, name, sentence


def design_model(folder: RunFolder, saved: Mapping[str, Any]) -> Model:
    """The model that a saved design was made for, as :func:`trusted_revision` finds it.

    Parameters
    ----------
    folder : RunFolder
    saved : mapping of str to Any
        Content of ``designs/final.yaml``.
    """
    return trusted_revision(folder, str(saved.get("revision") or ""))[0]


#: What a design says whose recordings do not say where they were made.
ONE_PLACE = (
    "nobody knows where along the travel the axis was measured: the gains are proven for the belt stiffness of that place alone, elsewhere "
    "the belt may be several times softer or stiffer; reference the axis and run `beltcomm commission` before it moves fast"
)


#: Share of the encoder's counts below which an angle was recorded coarser; distance from a whole step that is none, and share of the steps
#: that must be whole: of a fast motion few angles are neighbours.
COARSER, NEARLY_WHOLE, MOSTLY = 0.8, 0.05, 0.98


def structure_of(folder: RunFolder, findings: Findings | None = None) -> CascadeStructure:
    """The cascade of the drive that the run knows; the thesis's own, with a remark to ``findings``, when it knows none.

    Parameters
    ----------
    folder : RunFolder
    findings : Findings or None
        Get the remark; None for none.
    """
    known = folder.load_result("drive")
    if known is not None:
        return structure_from_dict(known)
    if findings is not None:
        findings.remarks.append("no drive is known to this run: designed for the thesis's cascade at 1 kHz")
    return THESIS_STRUCTURE


def cascade_of(
    saved: Mapping[str, Any], model: Model, structure: CascadeStructure, feedforward: FeedforwardKind | None = None
) -> tuple[Cascade, float]:
    """The controller of a saved design and the delay it was proven with, s; with another feedforward of the model when asked for.

    Parameters
    ----------
    saved : mapping of str to Any
        Content of ``designs/final.yaml``.
    model : Model
    structure : CascadeStructure
    feedforward : FeedforwardKind or None
        Kind that is asked for; None for the design's own.

    Raises
    ------
    DataError
        When the design is damaged.
    UsageError
        For a linear feedforward without a frequency response.
    """
    cascade, delay_s = cascade_from_dict(saved), float(saved["dead_time_s"])
    if feedforward is None:
        return cascade, delay_s
    apparent = float(saved.get("apparent_damping_nm_s_rad") or 0.0)
    return analyse.with_feedforward(cascade, model, structure, delay_s, feedforward, apparent), delay_s


def counts_of(folder: RunFolder) -> int:
    """Encoder counts per revolution: the drive's word, else the axis file's.

    Parameters
    ----------
    folder : RunFolder

    Returns
    -------
    int
        Per turn of the motor.

    Raises
    ------
    UsageError
        Where neither tells.
    """
    known = folder.load_result("drive")
    counts = known["counts_per_rev"] if known else folder.axis.motor.encoder_counts_per_rev
    if not counts:
        folder.axis.require("the final fit", "motor.encoder_counts_per_rev")
    return int(counts or 0)


def _coarser(recordings: Sequence[Recording], counts: int) -> int:
    """Steps per turn that all angles are whole multiples of, where they are clearly fewer than the encoder's counts; else 0."""
    step = min(smallest_step(r.position) for r in recordings)
    if not 0.0 < step < math.inf or 2.0 * math.pi / step > COARSER * counts:
        return 0
    gaps = np.concatenate([np.diff(np.unique(r.position)) for r in recordings]) / step
    whole = np.abs(gaps - np.round(gaps)) < NEARLY_WHOLE
    if float(np.mean(whole)) <= MOSTLY:
        return 0
    times = counts * step / (2.0 * math.pi)  # a file rounds its angles: a whole number of the encoder's own steps is likelier
    return round(counts / (round(times) if abs(times - round(times)) < 0.01 * times else times))


def fit_run(folder: RunFolder, solver: Solver, talk: Talk, model: Model | None = None) -> Findings:
    """Final fit, log-magnitude fits, dead time and friction from what the run folder holds.

    Parameters
    ----------
    folder : RunFolder
    solver : Solver
        Of the log-magnitude fits.
    talk : Talk
        Hears the progress of the fit.
    model : Model or None
        None fits one; else it is taken as it is.

    Raises
    ------
    DataError
        For records that cannot be fitted.
    """
    findings = Findings(kept_path=kept_path(folder))
    records = fit_for_belt_model(folder)
    recordings = records.recordings
    findings.remarks += records.remarks
    if model is None:
        counts = counts_of(folder)
        if shown := _coarser(recordings, counts):
            findings.remarks.append(
                f"the angles of these records go in steps of 1/{shown} turn, those of an encoder with {counts} counts would be finer: the "
                "counts are wrong (motor.encoder_counts_per_rev), or the angle was recorded coarser; taken as it was recorded"
            )
            counts = shown
        findings.final = final_model(recordings, folder.axis, counts, progress=lambda f: talk.progress(f, None))
        model = findings.final.fit.model
        findings.characteristics = analyse.characteristics(findings.final.fit, folder.axis.travel.middle_m)
        findings.sheets = sheet_doubts(model, math.sqrt(findings.final.fit.misfit), folder.axis, recordings)
    measure_delay_and_damping(findings, [r for r in recordings if r.sidecar.experiment == "frf"], model, solver)
    try:
        findings.friction = analyse.friction_of(
            recordings, slowest_fitted_rad_s(folder.axis.transmission_m_rad), analyse.moved_inertia(model)
        )
    except DataError as problem:
        findings.remarks.append(str(problem))
    findings.standstill = largest(recordings, findings.thesis, model, findings.friction)
    return findings


def fit_for_belt_model(folder: RunFolder) -> Checked:
    """The records over time, checked as for ``compare``.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    UsageError
        For an axis without a belt.
    DataError
        For records without torque or unfit for a model.
    """
    recordings = [item for item in folder.recordings() if not item.is_static_map]
    if not folder.axis.has_transmission:
        raise UsageError(
            f"{folder.axis} has neither belt nor pulley; the fit's model is a motor that drives a carriage by a belt. "
            f"The laboratory takes one rigid mass: `beltcomm diagnose {pasted(folder.path)}`. If there is a belt, state "
            "pulley.effective_radius_m and motor.inertia_kg_m2"
        )
    side = common_side(recordings)
    if side == "ampere":
        folder.axis.require("the fit of records in ampere", "motor.torque_constant_nm_a")
    if side == "volt":
        raise DataError(
            f"the records of {folder.path} hold the motor's voltage; the fit of a belt axis needs torque_nm or current_a. The laboratory "
            f"takes one rigid mass: `beltcomm diagnose {pasted(folder.path)}` of a run without belt and pulley"
        )
    if side == "load":
        raise DataError(
            f"the records of {folder.path} hold force and carriage position; the fit of a belt axis needs torque_nm (or current_a) "
            "and position_rad at the motor, for the belt lies between motor and carriage"
        )
    if not folder.drive:  # a sign or a unit before what is held out: an adapter has them right, whoever writes files by hand may not
        for recording in recordings:
            check(recording)
    return with_remarks_on_rest(folder, check_run(recordings, folder.axis, foreign=False))


def estimator_settings(folder: RunFolder, tick_s: float) -> EstimatorSettings:
    """Settings of the velocity estimators for the drive of a run, at the motor shaft: an increment in rad in the place of metres.

    Parameters
    ----------
    folder : RunFolder
    tick_s : float, s
        Of the timer.

    Returns
    -------
    EstimatorSettings
        T_R of the design, else 2 ms.
    """
    lag_s = EstimatorSettings.lag_s
    if "final" in folder.names("designs"):
        lag_s = float((saved_design(folder).get("parameters") or {}).get("velocity_filter_s") or 0.0)
    return EstimatorSettings(math.tau / counts_of(folder), tick_s, structure_of(folder).period_s, lag_s)
