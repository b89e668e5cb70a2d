"""Missing parts of a record: its end, or rows between others that the time stamps show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from beltcomm.errors import DamagedRecord, DataError
from beltcomm.laboratory.place_checks import names_of
from beltcomm.recording import Recording
from beltcomm.recording.columns import COMMON

#: s that a record must last up to its first lost sample to be used, and share of all rows that must be left.
UNBROKEN_S, LEFT = 2.0, 0.25


def check_whole(recordings: Sequence[Recording]) -> None:
    """Refuse an excited record that ends before its first measured period does, naming it.

    Parameters
    ----------
    recordings : sequence of Recording

    Raises
    ------
    DamagedRecord
        For one of this program.
    DataError
        For an imported one.
    """
    for recording in recordings:
        note = recording.sidecar.excitation
        if note is None or not note.period_samples:
            continue
        # by time: rows that a bus lost leave gaps, they do not make a record short
        rows = round(recording.duration_s / recording.sample_period_s) + 1
        wanted = (note.first_sample or 0) + note.period_samples
        if rows < wanted:
            if "import" in recording.sidecar.extra:
                raise DataError(
                    f"recording {recording.name} has {rows} samples, by --first-sample {note.first_sample} and --period-samples "
                    f"{note.period_samples} its first period ends at {wanted}: import it again with the period counted in rows of the file "
                    f"({1.0 / recording.sample_period_s:.4g} per second), without --period-samples if it does not repeat, or bring the "
                    "whole file"
                )
            raise DamagedRecord(
                f"recording {recording.name} ends after {rows} samples, its sidecar promises at least {wanted}: the file is cut off; bring "
                "the whole file back, or delete it with its sidecar and record it again with --resume",
                recording.name,
            )


def _gap_words(with_gaps: Sequence[Recording], timed: Sequence[Recording]) -> str:
    count, lost = sum(len(r.gaps) for r in with_gaps), sum(map(_lost_rows, with_gaps))
    share = lost / (sum(len(r.t_s) for r in timed) + lost)
    longest = max(float(np.diff(r.t_s)[r.gaps].max()) for r in with_gaps)
    return (
        f"samples were lost at {count} place{'s' if count > 1 else ''} of {names_of(with_gaps)} (about {lost}, {100.0 * share:.2g} % of "
        f"the rows, the longest gap is {1e3 * longest:.3g} ms)"
    )


def _lost_rows(record: Recording) -> int:
    """Rows that a record lacks."""
    steps = np.diff(record.t_s)[record.gaps] / record.sample_period_s
    return int(np.sum(np.maximum(np.round(steps) - 1.0, 1.0)))


def gap_remarks(timed: Sequence[Recording]) -> list[str]:
    """Remarks on lost samples where each piece counts.

    Parameters
    ----------
    timed : sequence of Recording
        Records over time.
    """
    with_gaps = [r for r in timed if len(r.gaps)]
    return [f"{_gap_words(with_gaps, timed)}: the pieces between them are judged on their own"] if with_gaps else []


def before_gaps(timed: Sequence[Recording], remarks: list[str]) -> list[Recording]:
    """Records up to their first lost sample: behind it nobody knows how the carriage swings on the belt.

    Those that lose one within the first seconds are left out.

    Parameters
    ----------
    timed : sequence of Recording
        Records over time.
    remarks : list of str
        Gets further ones.

    Raises
    ------
    DataError
        When too little is left.
    """
    with_gaps = [r for r in timed if len(r.gaps)]
    if not with_gaps:
        return list(timed)
    kept = [r if not len(r.gaps) else first_rows(r, int(r.gaps[0]) + 1) for r in timed]
    used = [r for r in kept if r is not None]
    rows, left = sum(len(r.t_s) for r in timed), sum(len(r.t_s) for r in used)
    if left < LEFT * rows or all(r.sidecar.held_out for r in used):
        raise DataError(
            f"{_gap_words(with_gaps, timed)}: only {100.0 * left / rows:.0f} % of the rows stand before the first lost one of a record, in "
            f"pieces of at least {UNBROKEN_S:g} s (needed: {100.0 * LEFT:.0f} %). Behind a gap nobody knows how the "
            "carriage swings; record "
            "again with less on the bus, or at a lower rate that it can carry"
        )
    out = [r for r in with_gaps if r.name not in {other.name for other in used}]
    remarks.append(
        f"{_gap_words(with_gaps, timed)}: behind a gap nobody knows how the carriage swings on the belt, so each record counts up to its "
        f"first one{f', and {names_of(out)} not at all' if out else ''}; {100.0 * left / rows:.0f} % of the rows are used"
    )
    return used


def first_rows(record: Recording, rows: int) -> Recording | None:
    """The record's first rows; None where they are too few or show nothing.

    Parameters
    ----------
    record : Recording
        Over time.
    rows : int
        That are kept.
    """
    if rows * record.sample_period_s < UNBROKEN_S:
        return None
    names = ("t_s", "torque", "position", "torque_setpoint", "velocity", "reference_position", "reference_velocity", *COMMON)
    cut: dict[str, Any] = {name: values[:rows] for name in names if (values := getattr(record, name)) is not None}
    try:
        return replace(record, notes=(), **cut)
    except DataError:  # nothing moves there
        return None
