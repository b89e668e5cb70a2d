"""Checks of a foreign recording's numbers beyond :class:`beltcomm.recording.Recording`'s own checks."""

from __future__ import annotations

import math

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import DataError
from beltcomm.recording import Recording
from beltcomm.recording.belonging import belonging, moves_before_torque
from beltcomm.recording.checks import ACTIVE, backwards, opposite_signs, slow_work_share
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
#: Deviation of a range from one turn by which it is one.
_A_TURN = 0.1
#: Share of the time that a motion goes either way at least; by how much a sign explains a magnitude better.
_BOTH_WAYS, _BETTER = 0.1, 0.1


class DrivesItsMotor(DataError):
    """Motion feeds a record's torque, where friction should take it up."""


def check(recording: Recording) -> tuple[str, ...]:
    """Sentences on what looks odd in a recording from elsewhere.

    Parameters
    ----------
    recording : Recording
        In SI units.

    Returns
    -------
    tuple of str
        What was accepted first.

    Raises
    ------
    DataError
        For a position that wraps, signs that contradict, or an impossible speed.
    DrivesItsMotor
        For a record whose load drives its motor, and nobody has said why.
    """
    if recording.is_static_map:
        return ()
    channels = CHANNELS[recording.side]
    position, unit = channels["position"], recording.position_unit
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
    contradiction = _judgement(recording)
    judged = contradiction or _driven(recording)
    if judged and not recording.sidecar.accepted:
        raise (DataError if contradiction else DrivesItsMotor)(
            f"{recording.file}: {judged}; if it is right all the same, say why: --accept REASON"
        )
    accepted = [f"{judged}: accepted, {recording.sidecar.accepted}"] if judged else []
    return (*accepted, *_period_note(recording), *_level_note(recording.position, position, unit))


def _judgement(recording: Recording) -> str:
    """Why torque and motion cannot belong together as they stand, in words; "" when they can."""
    channels = CHANNELS[recording.side]
    position, torque = channels["position"], channels["torque"]
    found = belonging(recording.t_s, recording.torque, recording.position)
    if found is not None and found.swapped:
        return f"{torque} and {position} look swapped: {torque} moves smoothly, and {position} explains itself as what drives it"
    if found is not None and _without_sign(recording, found.explained):
        return (
            f"{torque} is never below 0 while the axis moves both ways, and with the sign of the motion it would fit: a magnitude (rms), "
            "which tells no torque; record the value with its sign (the q component of the current)"
        )
    if found is not None and not found.consistent:
        return (
            f"{torque} and {position} do not belong together: the motion explains {100.0 * max(found.explained, 0.0):.2g} % of the torque, "
            "as of one of another time; look for the columns of one axis and one record, for rows that were sorted apart, and for other "
            "joints or a hand that moved the load along"
        )
    if backwards(recording.t_s, recording.torque, recording.position):
        return (
            "time seems to run backwards: the mass is positive and the friction drives; turn the order of the rows, or, where it is right, "
            f"look at the signs of {torque} and {position}, and for other joints that moved along"
        )
    if not recording.sidecar.closed_loop and moves_before_torque(recording.t_s, recording.torque, recording.position):
        return (
            f"time seems to run backwards: the motion goes before {torque}, as what swings goes on after its cause; turn the order of the "
            "rows, or, where a controller or a hand moved the axis and this is right, import with --closed-loop"
        )
    if opposite_signs(recording.t_s, recording.torque, recording.position):
        return (
            f"positive {torque} drives to negative {position} (mass or friction would be negative); turn one sign, such as --map "
            f"{torque}=-NAME, or --flip torque or --flip position"
        )
    return ""


def _driven(recording: Recording) -> str:
    """That the axis drives its motor, in words; "" where it does not."""
    share = slow_work_share(recording.t_s, recording.torque, recording.position)
    if share < -ACTIVE:
        return (
            f"the axis drives its motor: {-100.0 * share:.0f} % of the work of {CHANNELS[recording.side]['torque']} is taken out of the "
            "motion, where friction takes it up; the sign of one of the two is wrong (--flip torque), or the rows stand in the wrong order "
            "of time"
        )
    return ""


def _without_sign(recording: Recording, explained: float) -> bool:
    torque, direction = recording.torque, np.sign(np.gradient(recording.position))
    both = min(float(np.mean(direction > 0.0)), float(np.mean(direction < 0.0)))
    if float(torque.min()) < 0.0 or both < _BOTH_WAYS:
        return False
    signed = belonging(recording.t_s, torque * direction, recording.position)
    return signed is not None and signed.explained > explained + _BETTER


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
    joined = np.abs(np.diff(np.unwrap(position)))
    if abs(float(np.ptp(position)) / math.tau - 1.0) < _A_TURN and len(jumps) > 1 and float(joined.max()) < 0.5 * largest:
        return math.tau  # of a motor that turns fast, each turn
    return float(np.median(np.abs(jumps))) if largest > 50.0 * usual and len(jumps) < 0.05 * len(steps) else 0.0


def _period_note(recording: Recording) -> list[str]:
    """Notes on an excitation that does not repeat as the sidecar says."""
    note = recording.sidecar.excitation
    if note is None or note.period_samples is None:
        return []
    if len(recording.gaps):
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
