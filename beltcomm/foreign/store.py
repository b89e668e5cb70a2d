"""Foreign measurements into a run folder: checked whole before the first file is written, the originals kept byte for byte.

::

    RUN/originals/FILE          the foreign file as it was
    RUN/recordings/NAME.yaml    its sidecar; the key ``import`` holds the original's SHA-256, the mapping and how it was read

With the original and that key an import can be repeated (:func:`repeated`), and the result must be the same bit by bit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from beltcomm import atomic
from beltcomm.arrays import Array, Column
from beltcomm.axis import Axis
from beltcomm.borders import for_file_name
from beltcomm.configfiles import without_halves
from beltcomm.errors import DataError, MissingColumn, UsageError
from beltcomm.foreign.checks import check
from beltcomm.foreign.convert import Converted, Reading, convert, reading_from_dict, without_time
from beltcomm.foreign.edgetimes import EdgeTimes, read_edges
from beltcomm.foreign.files import Part, parts_of
from beltcomm.foreign.plausibility import Doubt, findings
from beltcomm.locks import link_refused
from beltcomm.outside import opened, sha256_of
from beltcomm.recording import Recording, Sidecar, common_side, load_recording, recording_from_columns
from beltcomm.runfolder import RunFolder, checked_name, is_new
from beltcomm.version import __version__

ORIGINALS = "originals"
#: Files that a reading names beside the one that is imported.
_BESIDE = ("dbc", "edges")
_BETWEEN = "the position of a row lies on a smooth curve through the edges, within the count that holds there"


@dataclass(frozen=True, eq=False)
class Imported:
    """One foreign file as a recording.

    Attributes
    ----------
    source : Path
        The file.
    sha256 : str
        Of its bytes.
    recording : Recording
        As saved, side as in the file.
    converted : Converted
        Where the columns came from.
    notes : tuple of str
        Sentences on how it was read and what looks odd.
    findings : tuple of Doubt
        Doubts whether it can be of this axis.
    scalars : Mapping[str, float]
        Single numbers that stand beside the columns.
    """

    source: Path
    sha256: str
    recording: Recording
    converted: Converted
    notes: tuple[str, ...]
    findings: tuple[Doubt, ...] = ()
    scalars: Mapping[str, float] = field(default_factory=dict)


def imported(path: Path, name: str, reading: Reading, sidecar: Sidecar, axis: Axis, part: Part) -> Imported:
    """One part of a foreign file as a recording, checked against the axis; nothing is written.

    Parameters
    ----------
    path : Path
    name : str
        Of the recording.
    reading : Reading
        Mappings, and what is kept and cut.
    sidecar : Sidecar
        Of the recording.
    axis : Axis
    part : Part
        Of the file.

    Raises
    ------
    UsageError
        For a mapping that does not fit.
    DataError
        For values that cannot be used.
    """
    static = sidecar.experiment == "static_map"
    reading = without_time(reading) if static else reading
    # in a log of frames the torque stands where it acts already
    edges = read_edges(Path(reading.edges)) if reading.edges is not None else None
    converted = convert(
        part.table,
        replace(reading, torque_acts=None) if part.number is not None else reading,
        timed=not static,
        turns=_turns(edges, axis) if edges is not None else None,
    )
    if edges is not None:
        converted = replace(converted, notes=(*converted.notes, *edges.notes, _BETWEEN))
    about = {
        "original": f"{ORIGINALS}/{path.name}",
        "sha256": part.sha256,
        "columns": {column: source.written for column, source in converted.sources.items()},
        "reading": replace(reading, record=part.number).to_dict(),
        "beltcomm": __version__,
    }
    about |= {f"{key}_sha256": sha256_of(Path(beside)) for key in _BESIDE if (beside := getattr(reading, key)) is not None}
    noted = replace(sidecar, position_integrated=converted.integrated, extra={**sidecar.extra, "import": about})
    try:
        recording = recording_from_columns(name, converted.columns, noted, file=str(path))
        checked = recording_from_columns(name, converted.columns, noted, axis, file=str(path))
        odd = check(checked)
    except MissingColumn as error:
        raise _with_the_way_out(error.column, part.table.columns, converted) from error
    doubts = findings(checked, axis)
    return Imported(path, part.sha256, recording, converted, (*converted.notes, *checked.notes, *odd), doubts, part.table.scalars)


def _turns(edges: EdgeTimes, axis: Axis) -> Callable[[Array], Array]:
    """Turns of the motor at given times."""
    axis.require("a position from encoder edges", "motor.encoder_counts_per_rev")
    counts = float(axis.motor.encoder_counts_per_rev or 1)
    return lambda t_s: edges.counts_at(t_s) / counts


def _with_the_way_out(column: str, names: Mapping[str, Any], converted: Converted) -> DataError:
    """A missing column is mapped, not renamed in the file."""
    mapped = ", ".join(f"{column}={source.theirs}" for column, source in converted.sources.items()) or "nothing"
    theirs = ", ".join(list(names)[:30])
    return DataError(
        f"a recording needs torque and position of one side: torque_nm or current_a with position_rad, or force_n with position_m; "
        f"{column} is missing. Mapped is {mapped}; add --map {column}=NAME*SCALE from the file's columns {theirs}"
    )


def open_or_plan(run: Path, axis: Axis | None) -> tuple[RunFolder | None, Axis]:
    """The run that is continued, None for a new one, and the axis that holds.

    Parameters
    ----------
    run : Path
    axis : Axis or None
        What the user gave; None takes that of an existing run, and for a new one nothing but a name is known then.

    Raises
    ------
    UsageError
        When the run was recorded on a drive or has another axis.
    """
    if is_new(run) and not (run / "axis.yaml").is_file():
        return None, axis or Axis(name=run.resolve().name)
    folder = RunFolder.open(run)
    if folder.drive:
        made = ", ".join(f"{key} {value}" for key, value in sorted(folder.drive.items()))
        raise UsageError(f"{run} was recorded on a drive ({made}); import foreign measurements into a run of their own")
    known = folder.axis
    if axis is not None and axis.fingerprint() != known.fingerprint():
        changes = "; ".join(known.changes(axis)[:3])
        raise UsageError(f"{run} is a run of another axis than --axis says ({changes}); one run holds one axis: import into a new run")
    return folder, known


def check_together(folder: RunFolder | None, found: Sequence[Imported], axis: Axis) -> None:
    """Refuse imports that do not go together, or not with what is in the run.

    Parameters
    ----------
    folder : RunFolder or None
        None where the run is made.
    found : sequence of Imported
        Imports of one command.
    axis : Axis

    Raises
    ------
    DataError
        For a name that is taken, two axes in one run or the same rows twice.
    UsageError
        For two files of one name or one that is none.
    """
    names = [item.recording.name for item in found]
    for name in names:
        checked_name(name)
        if names.count(name) > 1:
            raise UsageError(f"two files would become the recording {name}; import them one by one with --name")
        if folder is not None and (folder.recordings_folder / f"{name}.csv").exists():
            raise DataError(f"{folder.path} has a recording {name} already, and recordings are never changed; give another --name")
    existing = folder.recordings() if folder is not None and folder.finished_names() else []
    scaled = [recording_from_columns(item.recording.name, item.recording.columns(), item.recording.sidecar, axis) for item in found]
    common_side([*existing, *scaled])
    for number, new in enumerate(scaled):
        for old in (*existing, *scaled[:number]):
            if np.array_equal(old.torque, new.torque) and np.array_equal(old.position, new.position):
                raise DataError(
                    f"{new.name} is the same measurement as {old.name}, row for row: a record that is there twice confirms itself. To hold "
                    f"{old.name} out set held_out: true in its sidecar"
                )


def stands(folder: RunFolder, item: Imported) -> bool:
    """True for an import that is in the run already, row for row: the same command after one that was cut off goes on behind it.

    Parameters
    ----------
    folder : RunFolder
    item : Imported
        That would be written.
    """
    path = folder.recordings_folder / f"{item.recording.name}.csv"
    if not path.is_file():
        return False
    there = load_recording(path)
    about = there.sidecar.extra.get("import")
    if not isinstance(about, Mapping) or about.get("sha256") != item.sha256:
        return False
    before, after = there.columns(), item.recording.columns()
    return list(before) == list(after) and all(_same(before[column], after[column]) for column in before)


def write(run: Path, folder: RunFolder | None, axis: Axis, found: Sequence[Imported]) -> RunFolder:
    """Write what was imported: originals first, each recording whole.

    Parameters
    ----------
    run : Path
    folder : RunFolder or None
        None makes it.
    axis : Axis
    found : sequence of Imported
        Checked imports.

    Raises
    ------
    UsageError
        When the folder cannot be written.
    """
    folder = folder or RunFolder.create(run, axis)
    for item in found:
        extra = dict(item.recording.sidecar.extra)
        about = {**extra["import"], "original": f"{ORIGINALS}/{_keep_original(folder, item.source, item.sha256).name}"}
        for key in _BESIDE:
            if f"{key}_sha256" in about:
                kept = _keep_original(folder, Path(about["reading"][key]), about[f"{key}_sha256"])
                about["reading"] = {**about["reading"], key: f"{ORIGINALS}/{kept.name}"}
        extra["import"] = about
        folder.add_recording(replace(item.recording, notes=(), sidecar=replace(item.recording.sidecar, extra=extra)))
    return folder


def _keep_original(folder: RunFolder, source: Path, sha256: str) -> Path:
    """Copy the foreign file, unless the run has it already; another file of that name is not touched."""
    target = folder.path / ORIGINALS
    stem, ending = (without_halves(part) for part in _stem_and_ending(source))
    if target.is_symlink():
        raise link_refused(target)
    try:
        target.mkdir(exist_ok=True)
        number = 1
        while (path := target / (f"{stem}{ending}" if number == 1 else f"{stem}-{number}{ending}")).exists():
            if sha256_of(path) == sha256:
                return path
            number += 1
        with opened(source) as file, atomic.replacing(path) as copy:
            digest = hashlib.sha256()
            while block := file.read(1 << 20):
                digest.update(block)
                copy.write(block)
            if digest.hexdigest() != sha256:
                raise DataError(f"{source} changed while it was imported; import it when the recorder has finished")
    except OSError as error:
        raise UsageError(f"{target} cannot be written: {error.strerror or error}; choose another --run folder") from error
    return path


def _stem_and_ending(path: Path) -> tuple[str, str]:
    """``("log", ".csv.gz")`` of ``log.csv.gz``."""
    ending = "".join(path.suffixes[-2:]) if path.suffix.lower() == ".gz" else path.suffix
    return path.name.removesuffix(ending), ending


def recording_name(path: Path) -> str:
    """A name for the recording of a file: letters, digits, '_', '-' and '.' of its own.

    Parameters
    ----------
    path : Path
    """
    return for_file_name(_stem_and_ending(path)[0], "imported", gap="_")


def repeated(folder: RunFolder) -> dict[str, str]:
    """Every import of a run again from its original: recording -> "" when nothing differs, else what does.

    Parameters
    ----------
    folder : RunFolder

    Raises
    ------
    DataError
        When the run holds no imported recording.
    """
    outcome: dict[str, str] = {}
    read: dict[str, list[Part]] = {}
    for name in folder.finished_names():
        recording = load_recording(folder.recordings_folder / f"{name}.csv")
        about = recording.sidecar.extra.get("import")
        if isinstance(about, Mapping):
            outcome[name] = _difference(folder, recording, about, read)
    if not outcome:
        raise DataError(f"{folder.path} holds no imported recording; nothing to repeat")
    return outcome


def _difference(folder: RunFolder, recording: Recording, about: Mapping[str, Any], read: dict[str, list[Part]]) -> str:
    """read : what files have been read for recordings before, so that a log of many moves is read once."""
    try:
        original = _kept(folder, about.get("original"))
        if not original.is_file():
            return f"its original {original} is missing"
        if sha256_of(original) != about.get("sha256"):
            return f"its original {original} was changed since"
        reading = reading_from_dict(about.get("reading") or {})
        if reading.dbc is not None:
            reading = replace(reading, dbc=str(_kept(folder, reading.dbc)))
        if reading.edges is not None:
            reading = replace(reading, edges=str(_kept(folder, reading.edges)))
        everything = replace(reading, record=None)
        key = f"{original} {everything.to_dict()}"
        if key not in read:
            read.clear()
            read[key] = parts_of(original, everything, folder.axis)
        part = _part(read[key], reading.record)
        again = imported(original, recording.name, reading, replace(recording.sidecar, extra={}), folder.axis, part).recording
    except (DataError, UsageError) as error:
        return f"it cannot be imported again: {error}"
    before, after = recording.columns(), again.columns()
    if list(before) != list(after):
        return f"its columns are {', '.join(before)}, imported again {', '.join(after)}"
    differing = [column for column in before if not _same(before[column], after[column])]
    return f"it differs from its original in {', '.join(differing)}" if differing else ""


def _kept(folder: RunFolder, place: object) -> Path:
    """A file among the originals of a run, as a sidecar names it.   Raises DataError for a place elsewhere."""
    path = PurePosixPath(str(place))
    if path.parts[:-1] != (ORIGINALS,) or path.name in {"", ".."}:
        raise DataError(f"its sidecar names {str(place)[:80]!r} as its original, which is not a file in {ORIGINALS}/; import it again")
    kept = folder.path / ORIGINALS / path.name
    if kept.is_symlink() or kept.parent.is_symlink():
        raise DataError(f"its original {kept} is a link; put the file itself there")
    return kept


def _part(parts: Sequence[Part], number: int | None) -> Part:
    found = [part for part in parts if part.number == number]
    if not found:
        raise DataError(f"the original holds no move {number} any more; it was imported by another version")
    return found[0]


def _same(before: Column, after: Column) -> bool:
    return np.array_equal(before, after, equal_nan=before.dtype.kind == "f" and after.dtype.kind == "f")
