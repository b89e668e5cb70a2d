"""The design of a run as text for another controller: ``beltcomm export``.

An MCAP file, for PlotJuggler, Foxglove and whoever reads it, holds a topic of JSON messages for each recording.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from beltcomm import atomic
from beltcomm.configfiles import did_you_mean, write_text
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.drive.objects import object_values
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.encoder.edges import TICK_S
from beltcomm.errors import Refused, UsageError
from beltcomm.experiments.options import Options
from beltcomm.export.dcf import dcf_text
from beltcomm.export.encoder_program import encoder_of
from beltcomm.export.encoder_texts import FORMATS as ENCODER_FORMATS
from beltcomm.export.program import controller_of
from beltcomm.export.texts import FORMATS, text_of
from beltcomm.given import Place, may_write, pasted, place
from beltcomm.recording import Recording
from beltcomm.result import Result
from beltcomm.rundata import offline
from beltcomm.rundata.offline import estimator_settings
from beltcomm.rundata.proof import doubts
from beltcomm.rundata.store import cascade_from_dict, parameters_from_dict, saved_design, structure_from_dict
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.own_words import own_words
from beltcomm.talk import Silence, Talk
from beltcomm.version import __version__


@own_words
def export(
    run: Place,
    format_: str,
    *,
    out: Place | None = None,
    torque_limit_nm: float | None = None,
    part: str = "controller",
    tick_s: float | None = None,
    recording: str | None = None,
    command: str = "",
    when: str = "",
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """The run's design as "yaml", "c" or "st" text, or as "dcf" for its drive; into a file when ``out`` is given; or its records as "mcap".

    Parameters
    ----------
    run : Place
        Run folder.
    format_ : str
        "yaml", "c", "st", "dcf" or "mcap".
    out : Place or None
        File to be written; None only returns the text.
    torque_limit_nm : float or None, N m, motor shaft
        The drive's peak torque when left out, else the motor's.
    part : str
        Of "yaml", "c" and "st": "controller", or "encoder" for velocity from the edges of the encoder.
    tick_s : float or None, s
        Of the encoder: unit in which edges are timed; 10 ns when left out.
    recording : str or None
        Of "mcap": this one alone; None takes all.
    command : str
        Kept as provenance.
    when : str
        Date and time, ISO 8601, for the file.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        The text.

    Raises
    ------
    UsageError
        Unknown format, torque limit neither known nor given.
    DataError
        No design in the run, or a damaged one.
    Refused
        The file exists and ``options.yes`` was not given.
    """
    run, options, talk = place(run), options or Options(), talk or Silence()
    out = None if out is None else place(out, "file")
    if format_ not in (*FORMATS, "dcf", "mcap"):
        raise UsageError(f"there is no format {format_!r}; there are {', '.join(FORMATS)}, dcf, mcap")
    if part not in ("controller", "encoder"):
        raise UsageError(f"there is no part {part!r}; there are controller, encoder")
    if part == "encoder" and (format_ not in FORMATS or torque_limit_nm is not None):
        raise UsageError("--part encoder is text without a torque: --format c, st or yaml, and no --torque-limit")
    if part != "encoder" and tick_s is not None:
        raise UsageError("--tick is the encoder's; give --part encoder")
    folder = RunFolder.open(run)
    if format_ == "mcap":
        return _mcap(folder, recording, out, options, talk)
    if part == "encoder":
        return _encoder(folder, format_, tick_s, out, command, options, talk)
    saved = saved_design(folder)
    if format_ == "dcf":
        return _dcf(folder, saved, out, when, options, talk)
    cascade, structure = cascade_from_dict(saved), structure_from_dict(saved)
    limit = _torque_limit_nm(folder, structure, torque_limit_nm)
    model = offline.design_model(folder, saved)
    command = command or f"beltcomm export {pasted(run)} --format {format_}"
    provenance = _provenance(folder, command, model=model.name, designed=f"for the cascade {structure.name}")
    notes = [*_apart(cascade, structure, saved), *(f"the design is in doubt: {doubt}" for doubt in doubts(folder))]
    controller = controller_of(cascade, structure.period_s, limit, provenance, notes)
    text = text_of(controller, format_)
    data: dict[str, Any] = {"run": str(run), "format": format_, "coefficients": controller.values, "notes": notes}
    said = f"the cascade of {folder.path}, {1e3 * structure.period_s:g} ms, at most {limit:.4g} N m."
    return _written(data, text, out, said, options, talk)


def _provenance(folder: RunFolder, command: str, **more: str) -> dict[str, str]:
    """Origin of a text."""
    return {"run": folder.path.name, **more, "command": command, "made by": f"beltcomm {__version__}"}


def _written(data: dict[str, Any], text: str, out: Path | None, said: str, options: Options, talk: Talk) -> Result:
    """The text to a file, or in the result; notes beside it."""
    if out is None:
        return Result({**data, "file": None, "text": text}, text.splitlines())
    may_write(out, options.yes, talk)
    write_text(out, text)
    return Result({**data, "file": str(out)}, [f"{out} is written: {said}", *(f"Note: {note}" for note in data["notes"])])


def _encoder(folder: RunFolder, format_: str, tick_s: float | None, out: Path | None, command: str, options: Options, talk: Talk) -> Result:
    """Velocity from the edges of the run's encoder at its drive's sampling."""
    settings = estimator_settings(folder, TICK_S if tick_s is None else tick_s)
    slowest = settings.increment_m / settings.timeout_s
    notes = [
        f"below {slowest:.3g} rad/s, one count in {settings.timeout_s:g} s, gate and combination are 0",
        "the counts of axis.yaml or of the drive are taken for the edges of both channels, four to a line",
        "the exported cascade takes the angle and has the high-pass inside",
    ]
    provenance = _provenance(folder, command or f"beltcomm export {pasted(folder.path)} --format {format_} --part encoder")
    controller = encoder_of(settings, provenance, notes)
    data = {"run": str(folder.path), "format": format_, "coefficients": controller.values, "notes": notes}
    timed = f"timed in {1e9 * settings.tick_s:g} ns, every {1e3 * settings.period_s:g} ms"
    said = f"velocity from edges of {settings.increment_m:.4g} rad, {timed}."
    return _written(data, ENCODER_FORMATS[format_](controller), out, said, options, talk)


def _mcap(folder: RunFolder, name: str | None, out: Path | None, options: Options, talk: Talk) -> Result:
    """Recordings in a file that other programs read; `beltcomm import` reads it back."""
    if out is None:
        raise UsageError("an MCAP file is no text: give --out FILE.mcap")
    found = [one for one in folder.recordings() if name in (None, one.name)]
    if not found:
        raise UsageError(f"{folder.path} has no recording {name!r}{did_you_mean(name or '', [one.name for one in folder.recordings()])}")
    may_write(out, options.yes, talk)
    try:
        with atomic.replacing(out) as stream:
            _write_mcap(stream, found)
    except OSError as error:
        raise UsageError(f"{out} cannot be written: {error.strerror or error}; choose another place") from error
    rows = {one.name: len(one.torque) for one in found}
    listed = ", ".join(f"/{topic} ({count} rows)" for topic, count in rows.items())
    data = {"run": str(folder.path), "format": "mcap", "file": str(out), "topics": rows}
    return Result(data, [f"{out} is written, a topic for each recording: {listed}."])


def _dcf(folder: RunFolder, saved: Mapping[str, Any], out: Path | None, when: str, options: Options, talk: Talk) -> Result:
    """Values that the design writes into its drive, as a device configuration file (CiA 306); raises DataError, Refused."""
    known = folder.load_result("drive") or {}
    if known.get("gains") == "unknown":
        raise Refused(
            "nobody knows in which objects this drive has its gains, so there is no DCF of them; `beltcomm design` shows what to type "
            "into the "
            "maker's tool, and --format yaml, c or st hold the design"
        )
    places = parameters_from_dict(known)
    if unknown := known.get("uncalibrated"):
        raise Refused(
            f"what {', '.join(unknown)} mean in this drive is not known, so no raw value can be given; measure it with "
            f"`beltcomm calibrate --drive DRIVE --run {pasted(folder.path)}` first"
        )
    wanted = cascade_to_parameters(cascade_from_dict(saved))
    values = object_values(places, {name: value for name, value in wanted.items() if name in places})
    left = [
        f"this drive has no {name}, which the design sets to {value:.4g}" for name, value in wanted.items() if name not in places and value
    ]
    notes = [*left, *_along(saved, "along with its setpoints"), *(f"the design is in doubt: {doubt}" for doubt in doubts(folder))]
    text = dcf_text(values, {**folder.drive, "when": when}, notes)
    data = {"run": str(folder.path), "format": "dcf", "objects": [item.to_dict() for item in values], "notes": notes}
    return _written(data, text, out, f"{len(values)} objects of {folder.drive.get('device_name', 'the drive')}.", options, talk)


def _torque_limit_nm(folder: RunFolder, structure: CascadeStructure, given: float | None) -> float:
    """Torque limit asked for, else that of the run's drive, else that of its motor, N m."""
    if given is not None:
        if not (given > 0.0 and math.isfinite(given)):
            raise UsageError(f"the torque limit is {given:g} N m; give a positive torque")
        return given
    drive = folder.load_result("drive") or {}
    known = float(drive.get("peak_torque_nm") or folder.axis.motor.peak_torque_nm or 0.0)
    if not known > 0.0:
        raise UsageError(
            f"the largest torque of {structure.name} is known neither from the drive nor from axis.yaml (motor.peak_torque_nm); "
            "give it with --torque-limit"
        )
    return known


def _along(saved: Mapping[str, Any], where: str) -> list[str]:
    """Torque that the host sends along by the design, which no exported text holds: a sentence or none.   where : it is handed in."""
    effects = ", ".join(str(effect) for effect in saved.get("compensated") or ())
    told = f"torque against {effects} depends on place and speed and is not in this text: the host computes it and hands it in {where}"
    return [told] if effects else []


def _apart(cascade: Cascade, structure: CascadeStructure, saved: Mapping[str, Any]) -> list[str]:
    """Differences between design and exported text, in sentences: left out of the text, or not offered by the drive of the design."""
    name, forward = structure.name, cascade.feedforward
    torque = any((forward.inertia_kg_m2, forward.viscous_nm_s_rad, forward.coulomb_nm, forward.offset_nm))
    found = []
    for has, used, part in (
        (cascade.prefilter.kind == "none" or cascade.prefilter.kind in structure.prefilters, cascade.prefilter.kind != "none", "prefilter"),
        (structure.roll_off, cascade.prefilter.roll_off_rad_s > 0.0, "additional low-pass"),
        (structure.torque_feedforward, torque, "torque feedforward"),
        (structure.velocity_feedforward, forward.velocity != 0.0, "velocity feedforward"),
        (structure.reference_filter, cascade.filter_reference, "filter of the reference velocity"),
        (structure.anti_windup, cascade.ki_nm_rad > 0.0, "conditional integration"),
    ):
        if not has and used:
            found.append(f"the drive {name} has no {part}, which this text has: it behaves differently from that drive")
        elif not has:
            found.append(f"the drive {name} has no {part}: its coefficients are 0 here")
    if structure.prefilters == ("none",):
        found.append(f"the drive {name} has no prefilter: the one here passes the error on as it is")
    if cascade.ki_nm_rad == 0.0:
        found.append("there is no integrator (K_I is 0): a lasting position error stays")
    if math.isfinite(structure.output_limit_rad_s):
        bound = f"{structure.output_limit_rad_s:.6g} rad/s"
        found.append(f"the drive {name} bounds the output of its position controller to {bound}; the text does not")
    if structure.dead_zone_rad > 0.0:
        found.append(f"the drive {name} does not see position errors below {structure.dead_zone_rad:.6g} rad; the text does")
    return [*found, *_along(saved, "as extra_torque_nm"), *(str(remark) for remark in saved.get("remarks") or ())]


_ROWS = 10_000


def _write_mcap(stream: IO[bytes], recordings: Sequence[Recording]) -> None:
    """All columns of each recording as a message per row, stamped by the session's clock where one is known.

    Every number stands in the message as it is, t_s too: a stamp is whole nanoseconds.   Raises UsageError without the package that writes
    such files, or for stamps before the session's clock.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise UsageError("an MCAP file needs a further package: pip install 'beltcomm[mcap]'") from error
    writer = Writer(stream)
    writer.start(library=f"beltcomm {__version__}")
    for recording in recordings:
        columns = recording.columns()
        schema = {"type": "object", "properties": {name: {"type": "number"} for name in columns}}
        schema_id = writer.register_schema(f"beltcomm.{recording.side}", "jsonschema", json.dumps(schema).encode())
        told = {"held_out": str(recording.sidecar.held_out), "experiment": recording.sidecar.experiment}
        channel = writer.register_channel(f"/{recording.name}", "json", schema_id, metadata=told)
        times = columns.get("t_s")
        if times is None:
            times = np.arange(len(recording.torque), dtype=np.float64)
        stamps = np.round(1e9 * (times - min(float(times[0]), 0.0) + (recording.sidecar.session_time_s or 0.0))).astype(np.int64)
        for first in range(0, len(stamps), _ROWS):
            rows = zip(*(column[first : first + _ROWS].tolist() for column in columns.values()), strict=True)
            for number, row in enumerate(rows, start=first):
                message = json.dumps(dict(zip(columns, row, strict=True)), allow_nan=True).encode()
                writer.add_message(channel, int(stamps[number]), message, int(stamps[number]), number)
    writer.finish()
