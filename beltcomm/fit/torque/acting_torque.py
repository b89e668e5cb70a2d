"""Recordings whose torque is the one that acts, for whatever takes the torque of a recording as it stands."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy

import numpy as np

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

    Returns
    -------
    list of Recording
        In their order.
    """
    return [acting_recording(recording, path) for recording in recordings]
