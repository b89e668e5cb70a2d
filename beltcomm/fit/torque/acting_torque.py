"""Acting torque of recordings, by their torque path, and what a profile states of a reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy

import numpy as np

from beltcomm.drive import StatedReading
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.path import TorquePath
from beltcomm.recording import Recording


def acting_recording(recording: Recording, path: TorquePath | None) -> Recording:
    """The recording with the torque that acts in place of the one that was read.

    Parameters
    ----------
    recording : Recording
        As the drive reported it.
    path : TorquePath or None
        From setpoint and reading to the torque that acts; None takes the reading.

    Returns
    -------
    Recording
        The same one where the reading is the torque that acts.
    """
    if path is None or path.read_as_acts or recording.is_static_map:
        return recording
    parts = []
    for first, last in recording.pieces:
        setpoint = None if recording.torque_setpoint is None else recording.torque_setpoint[first:last]
        parts.append(path.acting_torque(recording.torque[first:last], setpoint, recording.sample_period_s)[0])
    torque = np.concatenate(parts)
    torque.flags.writeable = False
    acting = copy(recording)  # what was read has been checked; a noise-free torque that is worked out would pass for a clipped one
    object.__setattr__(acting, "torque", torque)
    return acting


def acting_recordings(recordings: Sequence[Recording], path: TorquePath | None) -> list[Recording]:
    """Recordings with the torque that acts, see :func:`acting_recording`.

    Parameters
    ----------
    recordings : sequence of Recording
        As the drive reported them.
    path : TorquePath or None
        None takes the reading.
    """
    return [acting_recording(recording, path) for recording in recordings]


#: Share of a time, and of a sampling period, by which a statement may be off without a word.
SHARE, OF_PERIOD = 0.25, 0.2


def stated_remarks(path: TorquePath, stated: StatedReading | None, sample_s: float) -> list[str]:
    """Sentences on a statement that the records contradict; none where they do not.

    Parameters
    ----------
    path : TorquePath
        That a fit has found.
    stated : StatedReading or None
        By the profile.
    sample_s : float, s
    """
    if stated is None:
        return []
    if stated.command is not None and stated.command is not path.commanded:
        both = ("only the command", "a measured torque")
        says, shown = both if stated.command else both[::-1]
        return [f"the profile states that the drive reports {says}, the records show {shown}: correct actual_torque.command"]
    wrong = _off(path, stated, sample_s)
    if wrong and any(not _off(rival, stated, sample_s) for rival in path.rivals):
        return [
            f"{'; '.join(f'{what} is {says} by the profile, {found} by the fit' for _, what, says, found in wrong)}: these records do not "
            "tell the two apart; one excited louder, at a higher frequency, would"
        ]
    return [
        f"the profile states that {what} is {says}; by the records it is {found}, which is taken: correct actual_torque.{field}"
        for field, what, says, found in wrong
    ]


def _off(path: TorquePath, stated: StatedReading, sample_s: float) -> list[tuple[str, str, str, str]]:
    """Statements that a path contradicts: field, what, as stated, as found."""
    if path.commanded or path.instantaneous:  # an instant within a sample is the trace's, not the drive's
        return []
    found = []
    times = [_time_s(lag, sample_s) for lag in path.reading.lags]
    filter_s, interval_s = sum(time for time, _ in times), math.hypot(*(interval for _, interval in times))
    said = (
        ("filter_ms", "the filter of the torque reading", stated.filter_s, filter_s, interval_s),
        ("late_ms", "the age of the torque reading", stated.late_s, path.reading.late * sample_s, 0.0),
    )
    for field, what, says_s, is_s, unsure_s in said:
        if says_s is not None and abs(says_s - is_s) > unsure_s + max(SHARE * max(says_s, is_s), OF_PERIOD * sample_s):
            is_words = f"{1e3 * is_s:.2g}" + (f" ± {1e3 * unsure_s:.1g}" if unsure_s else "")
            found.append((field, what, f"{1e3 * says_s:.3g} ms", f"{is_words} ms"))
    return found


def _time_s(lag: Lag, sample_s: float) -> tuple[float, float]:
    """Time constant of a lag and its interval, s; of a second order the first-order part of its lag."""
    value, interval = lag.values[0], lag.intervals[0] if lag.intervals else 0.0
    if lag.kind == "first order":
        return value, interval
    if lag.kind == "sampled":
        if value >= 1.0 - 1e-9:
            return 0.0, 0.0
        time_s = -sample_s / math.log1p(-value)
        return time_s, time_s**2 / sample_s / (1.0 - value) * interval
    if lag.kind == "second order":
        time_s = lag.values[1] / (math.pi * value)
        return time_s, time_s * interval / value
    return 0.0, 0.0
