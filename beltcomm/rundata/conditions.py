"""Under which conditions a frequency response was measured: place, amplitude, direction of travel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from beltcomm.recording import Recording

#: m/s: a carriage that gets on less than this on average stands, but for its drift; so does one that swings faster than it gets on.
MOVING_M_S = 0.01

Direction = Literal["standing", "forward", "backward", "both ways"]


@dataclass(frozen=True)
class Condition:
    """One excited record.

    Attributes
    ----------
    place_m : float or None
        None where nobody knows it, the middle of the way for a moving one.
    amplitude_nm : float
        Largest torque of the excitation.
    base_speed_m_s : float
        Mean speed over its periods, 0 for a standing one.
    to_and_fro : bool
        Strokes at that speed each way.
    """

    record: str
    place_m: float | None
    amplitude_nm: float
    base_speed_m_s: float
    held_out: bool
    to_and_fro: bool = False

    @property
    def direction(self) -> Direction:
        """Sign of the base speed."""
        if self.to_and_fro:
            return "both ways"
        return "standing" if self.base_speed_m_s == 0.0 else "forward" if self.base_speed_m_s > 0.0 else "backward"

    def words(self) -> str:
        """For tables and legends: ``0.06 m, ±0.232 N m``."""
        place = "place unknown" if self.place_m is None else f"{self.place_m:.2f} m"
        travel = "" if self.direction == "standing" else f", {self.direction} at {abs(self.base_speed_m_s):.2f} m/s"
        return f"{place}, ±{self.amplitude_nm:.3f} N m{travel}"


def condition_of(recording: Recording, ratio_m_rad: float) -> Condition:
    """The condition of an excited record.

    Parameters
    ----------
    recording : Recording
    ratio_m_rad : float
        i_t.
    """
    note = recording.sidecar.excitation
    first = min(note.first_sample if note else 0, len(recording.t_s) - 2)
    path = ratio_m_rad * (recording.position - recording.position[0])
    start = recording.sidecar.start_position_m
    if note is not None and note.base_speed_m_s:  # strokes there and back, which come to nothing in the mean
        middle = None if start is None else start + 0.5 * float(path.min() + path.max())
        return Condition(
            recording.name, middle, _amplitude_of(recording, first), note.base_speed_m_s, recording.sidecar.held_out, to_and_fro=True
        )
    speed = float(path[-1] - path[first]) / float(recording.t_s[-1] - recording.t_s[first])
    swing = float(np.std(np.diff(path[first:]) / np.diff(recording.t_s[first:])))
    speed = speed if abs(speed) >= max(MOVING_M_S, swing) else 0.0
    middle = 0.5 * float(path[first] + path[-1]) if speed else 0.0
    place = None if start is None else start + middle
    return Condition(recording.name, place, _amplitude_of(recording, first), speed, recording.sidecar.held_out)


def _amplitude_of(recording: Recording, first: int) -> float:
    """Largest torque of the excitation, N m: as noted, else what the record shows from a sample on."""
    note = recording.sidecar.excitation
    if note is not None and note.amplitude_nm is not None:
        return note.amplitude_nm
    torque = recording.torque[first:]
    return float(np.max(np.abs(torque - np.mean(torque))))
