"""``beltcomm import``: foreign measurements into a run folder, or shown without writing anything."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from beltcomm.axis import Axis, load_axis
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign import store
from beltcomm.foreign.convert import Reading, alignment, line_of_table
from beltcomm.foreign.files import Part, parts_of
from beltcomm.foreign.guess import Ask, completed
from beltcomm.given import Place, pasted, place, places
from beltcomm.locks import changes_run
from beltcomm.outside import in_words
from beltcomm.recording import Sidecar
from beltcomm.result import Result
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Talk

#: Bytes of files above which the time is told that they take, and s for each; packed files take longer.
_LONG_BYTES, _SECONDS_PER_BYTE = 20_000_000, 1.2e-7

_ENTRIES = (
    ("motor.inertia_kg_m2", r"j|jm|j_?(m|mot|motor|rotor)|(motor|rotor)?_?inertia|traegheit(smoment)?"),
    ("motor.torque_constant_nm_a", r"kt|k_t|km|k_m|torque_?const(ant)?|kphi"),
    ("gearbox.ratio", r"gear(box)?(_?ratio)?|gr|ratio|i_?(gear|getriebe)|n_?gear|uebersetzung"),
    ("motor.encoder_counts_per_rev", r"cpr|ppr|counts?(_?per_?rev)?|enc(oder)?_?(counts|resolution|res)"),
    ("pulley.effective_radius_m", r"(pulley_?)?radius|r_?pulley"),
    ("motor.rated_torque_nm", r"(m|t|tau|torque)_?(n|nom|nenn|rated)|rated_?torque"),
)


@changes_run()
def import_recordings(
    files: Place | Sequence[Place],
    run: Place,
    reading: Reading,
    *,
    axis: Axis | str | None = None,
    sidecar: Sidecar | None = None,
    name: str | None = None,
    dry_run: bool = False,
    ask: Ask | None = None,
    talk: Talk | None = None,
) -> Result:
    """Foreign measurements into a run folder, all files or none: of a table one recording, of a log of frames one per move.

    Parameters
    ----------
    files : Place or sequence of Place
        CSV or text (also .gz), .mat, HDF5, MDF, .npz, .npy, logs of CAN frames.
    run : Place
        Run folder.
    reading : Reading
        The mapping and how the files are read.
    axis : Axis or str, or None
        An axis, its file or the name of a shipped one; None takes that of the run, or notes only a name: one rigid mass.
    sidecar : Sidecar or None
        What was done, the same for all files.
    name : str or None
        Of the recording, when it is one file.
    dry_run : bool
        Write nothing.
    ask : Ask or None
        Puts guesses that are not sure to a person; None: NeedsAnswers is raised instead.
    talk : Talk or None
        Hears how long it will take.

    Returns
    -------
    Result
        What was recorded, and how the columns were read.

    Raises
    ------
    UsageError
        For options that contradict each other.
    DataError
        For files that cannot be used; nothing is written then.
    NeedsAnswers
        For guesses that are not sure, without ``ask``; nothing is written then.
    """
    files, run, sidecar = places(files, "file"), place(run), sidecar or Sidecar()
    if not files:
        raise UsageError("no file is given; name the files with the measurements")
    if len(files) > 1 and name is not None:
        raise UsageError(f"--name {name} is for one file, {len(files)} are given; import them one by one")
    if len(files) > 1 and sidecar.session_time_s is not None:
        raise UsageError("--session-time belongs to one record; import the files one by one")
    size = sum(file.stat().st_size for file in files if file.is_file())
    if talk is not None and size > _LONG_BYTES:
        talk.say(f"Reading {in_words(size)} takes about {_SECONDS_PER_BYTE * size:.0f} s.")
    folder, known = store.open_or_plan(run, axis if isinstance(axis, Axis) or axis is None else load_axis(axis))
    noted = replace(sidecar, source=sidecar.source or "imported with beltcomm import")
    found: list[store.Imported] = []
    left_out: list[str] = []
    for file in files:
        found += _parts_imported(file, name or store.recording_name(file), reading, noted, known, ask, left_out)
    there = [item for item in found if folder is not None and store.stands(folder, item)]
    new = [item for item in found if item not in there] or found  # with nothing left to do, it is the command that is wrong
    there = [item for item in there if item not in new]
    store.check_together(folder, new, known)
    if not dry_run:
        store.write(run, folder, known, new)
    described = [_described(item) for item in found]
    about = {"name": known.name, "belt": known.has_transmission, "minimal": folder is None and axis is None}
    data = {"run": str(run), "dry_run": dry_run, "axis": about, "recordings": described}
    text = [line for item, recording in zip(described, found, strict=True) for line in _lines(item, recording)]
    text += ["", *left_out, *(f"{item.recording.name} is in {run} already, the same rows of the same file." for item in there)]
    text += [line for item in found for line in _offered(item.scalars, known)][:1]
    text += _closing(run, folder, known, axis, dry_run)
    if sidecar.experiment != "static_map" and any("record" not in item.recording.sidecar.extra["import"]["reading"] for item in found):
        text.append(alignment(reading, found[0].converted.columns))
    if known.has_transmission and not dry_run:
        text.append(_next(run, folder, found))
    return Result(data, text)


def _next(run: Path, folder: RunFolder | None, found: Sequence[store.Imported]) -> str:
    """The command that follows: a fit begins with an excited record."""
    there = [item.recording for item in found] + ([] if folder is None else folder.recordings())
    if any(record.sidecar.experiment == "frf" for record in there):
        return f"Next: beltcomm fit {pasted(run)}"
    if any(record.sidecar.experiment == "free" for record in there):
        return (
            "Next: if this was an excitation, import it into a new run and say so (--experiment frf --excitation prbs --period-samples N "
            f"--first-sample N), for a fit begins with one; else beltcomm compare {pasted(run)}"
        )
    return f"Next: beltcomm compare {pasted(run)}   (beltcomm fit needs an excited record, --experiment frf)"


def _parts_imported(
    file: Path, name: str, reading: Reading, sidecar: Sidecar, axis: Axis, ask: Ask | None, left_out: list[str]
) -> list[store.Imported]:
    """All recordings of one file; ``left_out`` gets sentences on moves in a log that no method can use."""
    parts = parts_of(file, reading, axis)
    timed = sidecar.experiment != "static_map" and reading.period_s is None
    mapping, guessed = completed(parts[0].table, reading.mapping, axis, timed=timed, ask=ask)
    reading = replace(reading, mapping=mapping)
    found: list[store.Imported] = []
    refused: list[DataError] = []
    first: Part | None = None
    for part in parts:
        own = name if part.number is None or len(parts) == 1 else f"{name}_{part.number}"
        done = _what_was_done(sidecar, part, parts[0], reading, axis)
        # the account of a log is the last note of its first move, which may be one that is left out
        account = tuple(note for note in parts[0].table.notes[-1:] if note not in part.table.notes)
        told = _new(part, first) if first is not None else (*guessed, *part.table.notes, *account)
        noted = replace(part, table=replace(part.table, notes=told))
        try:
            found.append(store.imported(file, own, reading, done, axis, noted))
            first = first or part
        except DataError as error:
            refused.append(error)
            left_out.append(f"Move {part.number} at {part.start_s:.4g} s of the log was left out: {error}")
    if not found:
        raise refused[0]
    return found


def _new(part: Part, first: Part) -> tuple[str, ...]:
    """Notes of a move that the first one that is taken did not have."""
    return tuple(note for note in part.table.notes if note not in first.table.notes)


def _what_was_done(sidecar: Sidecar, part: Part, first: Part, reading: Reading, axis: Axis) -> Sidecar:
    """The user's words, and what a log shows where the user said nothing; moves of one log share its clock and its carriage."""
    if part.number is None:
        return sidecar
    experiment = part.experiment if sidecar.experiment == "free" else sidecar.experiment
    start = sidecar.start_position_m
    if start is not None and first.lost and reading.record is None:
        raise DataError(
            f"{part.table.file}: --start-position is that of the log's first move, which may be among what was not read ({first.lost}); "
            "give it with the move that it belongs to, --record K (1 is the first that was read), or leave it out"
        )
    if start is not None and part is not first:
        here, there = (p.table.columns.get("position_rad") for p in (part, first))
        known = here is not None and there is not None and axis.get("pulley.effective_radius_m") is not None
        turned = -1.0 if "position" in reading.flip else 1.0
        start = start + turned * axis.transmission_m_rad * float(here[0] - there[0]) if known else None  # type: ignore[index]
    return replace(
        sidecar,
        experiment=experiment,
        closed_loop=sidecar.closed_loop or part.closed_loop,
        excitation=sidecar.excitation or (part.excitation if experiment == "frf" else None),
        start_position_m=start,
        session_time_s=(sidecar.session_time_s or 0.0) + part.start_s,
    )


def check_imports(run: Place) -> Result:
    """Repeat every import of a run from its original and compare bit by bit.

    Parameters
    ----------
    run : Place
        Run folder.

    Returns
    -------
    Result
        What differs; exit code 1 when something does.
    """
    run = place(run)
    outcome = store.repeated(RunFolder.open(run))
    wrong = {name: text for name, text in outcome.items() if text}
    text = [f"{name}: {fault or 'the same, bit by bit'}" for name, fault in outcome.items()]
    text.append(f"{len(outcome) - len(wrong)} of {len(outcome)} imports in {run} can be repeated from their originals.")
    return Result({"run": str(run), "repeated": outcome}, text, 1 if wrong else 0)


def _described(item: store.Imported) -> dict[str, Any]:
    """Everything about one import, for programs."""
    recording = item.recording
    columns = recording.columns()
    found: dict[str, Any] = {
        "name": recording.name,
        "file": str(item.source),
        "sha256": item.sha256,
        "side": recording.side,
        "experiment": recording.sidecar.experiment,
        "held_out": recording.sidecar.held_out,
        "samples": len(recording.torque),
        "columns": [line_of_table(name, column, item.converted.sources.get(name)) for name, column in columns.items()],
        "not_taken": list(item.converted.not_taken),
        "notes": list(item.notes),
        "findings": [asdict(finding) for finding in item.findings],
    }
    if not recording.is_static_map:
        steps, lost = np.diff(recording.t_s), recording.gaps
        period = recording.sample_period_s
        found |= {"period_s": period, "rate_hz": 1.0 / period, "duration_s": recording.duration_s}
        found["gaps"] = [
            {"t_s": float(recording.t_s[i]), "length_s": float(steps[i]), "lost_samples": max(1, round(float(steps[i]) / period) - 1)}
            for i in lost
        ]
    return found


def _lines(found: dict[str, Any], item: store.Imported) -> list[str]:
    """Lines for people: a headline, the table of columns, what was left and what looks odd."""
    timed = "rate_hz" in found
    when = f"{found['duration_s']:.6g} s at {found['rate_hz']:.6g} Hz" if timed else "static map, no time"
    held = ", held out" if found["held_out"] else ""
    head = ["column", "from", "scale", "offset", "min", "max", "rms", "unit"]
    rows = [[_cell(line.get(key, "")) for key in head] for line in found["columns"]]
    widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
    table = [
        "  " + "  ".join(_aligned(cell, width, i) for i, (cell, width) in enumerate(zip(row, widths, strict=True))) for row in [head, *rows]
    ]
    lines = [
        f"{found['name']} from {item.source}: {found['samples']} rows, {when} ({found['experiment']}{held})",
        *(t.rstrip() for t in table),
    ]
    if timed:
        lost = sum(gap["lost_samples"] for gap in found["gaps"])
        longest = max((gap["length_s"] for gap in found["gaps"]), default=0.0)
        lines.append(
            f"  gaps: {len(found['gaps'])}, about {lost} samples lost, the longest lasts {1e3 * longest:.4g} ms"
            if found["gaps"]
            else "  gaps: none"
        )
    gaps_told = item.recording.gap_remark if timed else ""  # in the line before
    if found["not_taken"]:
        lines.append(f"  not taken: {', '.join(found['not_taken'])}")
    lines += [f"  note: {note}" for note in found["notes"] if note != gaps_told]
    return lines + [f"  doubt: {finding}" for finding in item.findings]


def _cell(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def _aligned(cell: str, width: int, place: int) -> str:
    return cell.rjust(width) if 2 <= place <= 6 else cell.ljust(width)


def _closing(run: Path, folder: RunFolder | None, axis: Axis, given: Axis | str | None, dry_run: bool) -> list[str]:
    lines = ["Nothing was written (--dry-run)."] if dry_run else [f"Written to {run}; the originals are in {run / store.ORIGINALS}."]
    if folder is None and given is None:
        lines.append(
            f"No --axis was given: {'the run would get' if dry_run else 'the run has'} an axis.yaml with the name {axis.name!r} only, "
            "one rigid mass. A toothed-belt axis needs its axis file: radius and inertia cannot be found from these columns."
        )
    return lines


def _offered(scalars: Mapping[str, float], axis: Axis) -> list[str]:
    """A line for the numbers that look like entries of axis.yaml which are not known; [] when there are none."""
    found = []
    for entry, pattern in _ENTRIES:
        names = [name for name in scalars if re.fullmatch(pattern, name.rpartition(".")[2], re.I) and scalars[name] > 0.0]
        if len(names) == 1 and not _known(axis, entry):
            found.append(f"{names[0]} = {scalars[names[0]]:.6g} (--set {entry}={scalars[names[0]]:.6g} if that is it, in SI)")
    return [f"Beside the columns stand {'; '.join(found)}."] if found else []


def _known(axis: Axis, entry: str) -> bool:
    value = axis.get(entry)
    return value is not None and not (entry == "gearbox.ratio" and value == 1.0)
