"""What a foreign recording's numbers betray beyond :class:`beltcomm.recording.Recording`'s own checks."""

from __future__ import annotations

import math

import numpy as np

from beltcomm.errors import DataError
from beltcomm.recording import Recording
from beltcomm.recording.checks import Array, opposite_signs
from beltcomm.recording.columns import CHANNELS
from beltcomm.recording.sampling import finest

#: Beyond these no drive train moves: 20 000 rpm; a carriage at 30 m/s.
FASTEST = {"rad": 2100.0, "m": 30.0}
#: Longest way of a linear axis, m.
LONGEST_TRAVEL_M = 100.0
#: Steps of the encoder that a counter has at least: of a motor that moves by one count or a few nobody can tell.
_FEWEST_STEPS = 64.0
#: Below this correlation of successive periods of the torque an excitation does not repeat.
_REPEATS = 0.7


def check(recording: Recording) -> tuple[str, ...]:
    """Sentences on what looks odd.   Raises DataError for a position that wraps, signs that contradict, or an impossible speed."""
    if recording.is_static_map:
        return ()
    channels = CHANNELS[recording.side]
    position, torque, unit = channels["position"], channels["torque"], recording.position_unit
    steps = np.diff(recording.position)
    wrap = _wrap(recording.position)
    if wrap:
        at = int(np.argmax(np.abs(steps)))
        hint = "1rev" if unit == "rad" and abs(wrap / math.tau - 1.0) < 0.1 else f"about {wrap:.6g} {unit}"
        raise DataError(
            f"{recording.file}: {position} jumps by {steps[at]:.6g} {unit} at t = {recording.t_s[at]:.6g} s, against the motion before "
            f"and after: a counter that starts anew. Join it with --unwrap SPAN ({hint}), or cut the record"
        )
    speed = np.abs(steps / np.diff(recording.t_s))
    fastest = float(np.percentile(speed, 99.0))
    if fastest > FASTEST[unit]:
        raise DataError(
            f"{recording.file}: {position} moves at {fastest:.4g} {unit}/s, more than any drive's {FASTEST[unit]:g} {unit}/s; "
            f"it looks like {'mm' if unit == 'm' else 'degrees'} or encoder counts: give the factor, --map {position}=NAME*FACTOR"
        )
    moved = float(np.ptp(recording.position))
    if unit == "m" and moved > LONGEST_TRAVEL_M:
        raise DataError(f"{recording.file}: {position} covers {moved:.6g} m; if that is mm write --map {position}=NAME*mm")
    if opposite_signs(recording.t_s, recording.torque, recording.position):
        raise DataError(
            f"{recording.file}: positive {torque} drives to negative {position} (mass or friction would be negative); turn one sign, "
            f"such as --map {torque}=-NAME, or --flip torque or --flip position"
        )
    return (*_period_note(recording), *_level_note(recording.position, position, unit))


def _wrap(position: Array) -> float:
    """The span by which a position jumps back as a counter does; 0 when it does not.

    A counter that starts anew makes single steps of more than half its range, a hundred times those beside them.
    """
    steps = np.diff(position)
    largest = float(np.abs(steps).max())
    if largest < 0.5 * float(np.ptp(position)) or largest < _FEWEST_STEPS * finest(position):
        return 0.0
    others = np.abs(steps[np.abs(steps) < 0.5 * largest])
    usual = float(np.percentile(others, 99.0)) if len(others) else 0.0
    jumps = steps[np.abs(steps) >= 0.5 * largest]
    return float(np.median(np.abs(jumps))) if largest > 50.0 * usual and len(jumps) < 0.05 * len(steps) else 0.0


def _period_note(recording: Recording) -> list[str]:
    """Notes on an excitation that does not repeat as the sidecar says."""
    note = recording.sidecar.excitation
    if note is None or note.period_samples is None:
        return []
    if len(recording.gaps()):
        return ["rows are missing, so whether the torque repeats as --period-samples says was not looked at"]
    excited = recording.torque[note.first_sample :]
    periods = len(excited) / note.period_samples
    if periods < 2.0:
        return [
            f"the record holds {max(periods, 0.0):.2g} periods of {note.period_samples} samples; two are needed to tell noise from "
            f"response; at {1.0 / recording.sample_period_s:.4g} rows per second, check --period-samples and --first-sample"
        ]
    excited = excited[: int(periods) * note.period_samples]
    likeness = float(np.corrcoef(excited[: -note.period_samples], excited[note.period_samples :])[0, 1])
    if likeness >= _REPEATS:
        return []
    return [f"the torque does not repeat every {note.period_samples} samples (correlation {likeness:.2f}); check --period-samples"]


def _level_note(position: Array, column: str, unit: str) -> list[str]:
    levels = len(np.unique(position))
    if levels > 100:
        return []
    resolution = float(np.ptp(position)) / max(1, levels - 1)
    return [f"{column} has only {levels} levels, {resolution:.3g} {unit} apart: acceleration can hardly be told from it"]
