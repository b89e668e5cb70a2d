"""Steps of a plan whose result a record of the run shows already: made again they would tell nothing new."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.experiments.execute_step import EXPERIMENT, RESPONSE_S, SAME_PLACE_M, quieter
from beltcomm.experiments.paths import AROUND_M
from beltcomm.recording import Recording
from beltcomm.schedule.steps import LOUD, Step

#: Share of a length, an amplitude or an acceleration that counts as reached.
REACHED = 0.75
#: s between a first and a last sweep; share of the travel that one goes over: a quick one begins where the carriage stands.
LATER_S, ACROSS = 30.0, 0.3
#: Room for an amplitude, a way or a speed that the drive rounds.
ROUNDED = 1.1
#: Share of a torque's power that lies within its band; share of the largest speed above which a stroke is under way.
IN_BAND, UNDER_WAY = 0.9, 0.02


@dataclass(frozen=True)
class Before:
    """Known quantities of a run.

    Attributes
    ----------
    window_m : tuple of float
        Of the travel.
    ratio : float, m/rad
    friction_nm : float, N m
        Which a quiet excitation lies above.
    """

    recordings: Sequence[Recording]
    window_m: tuple[float, float]
    ratio: float
    friction_nm: float


def record_showing(step: Step, before: Before) -> str:
    """Name of the record that shows what the step would, "" for none.

    Parameters
    ----------
    step : Step
    before : Before
        Records there are, and how they were made.
    """
    return next((r.name for r in before.recordings if _shows(r, step, before)), "")


def _shows(recording: Recording, step: Step, before: Before) -> bool:
    """True if one record has the step's kind, place, size and length.  A longer one would tell more, so a shorter does not count."""
    sidecar = recording.sidecar
    if (
        sidecar.experiment != EXPERIMENT[step.kind]
        or sidecar.held_out != step.held_out
        or (step.here and not _is_there(recording, step, before))
    ):
        return False
    if step.kind == "response":
        return _excitation_suffices(recording, step, before)
    if step.kind == "reversals":
        return abs(before.ratio) * float(np.ptp(recording.position)) <= 2.0 * ROUNDED * max(step.amplitudes_m)
    if step.kind == "moves":
        return _moves_suffice(recording, step, before)
    if step.kind == "sweep" and not _goes_across(recording, before):
        return False
    return _is_later(recording, before) if step.again else _has_speeds(recording, step, before)


def _is_there(recording: Recording, step: Step, before: Before) -> bool:
    """True if a record stays around the place of a step: strokes begin beside theirs, a sweep only passes."""
    start_m = recording.sidecar.start_position_m
    if start_m is None:
        return False
    way_m = before.ratio * (recording.position - recording.position[0])
    at_m = start_m + 0.5 * float(np.min(way_m) + np.max(way_m))
    return float(np.ptp(way_m)) < 2.0 * ROUNDED * AROUND_M and abs(at_m - step.at_m(before.window_m)) < SAME_PLACE_M


def _goes_across(recording: Recording, before: Before) -> bool:
    """True if strokes are a sweep, and not around one place."""
    return abs(before.ratio) * float(np.ptp(recording.position)) > ACROSS * (before.window_m[1] - before.window_m[0])


def _is_later(recording: Recording, before: Before) -> bool:
    """True if strokes came ``LATER_S`` after the first ones, as for what warms up."""
    when = [r.sidecar.session_time_s or 0.0 for r in before.recordings if r.sidecar.experiment == "friction_sweep"]
    return (recording.sidecar.session_time_s or 0.0) - min(when) > LATER_S


def _moves_suffice(recording: Recording, step: Step, before: Before) -> bool:
    """True if moves go on as long as the step asks for; of fast ones, whether they are as hard, the run's hardest being all it may do."""
    if step.seconds:
        return recording.duration_s >= REACHED * step.seconds
    moves = [r for r in before.recordings if r.sidecar.experiment == EXPERIMENT["moves"] and not r.sidecar.held_out]
    hardest, own = max(_hardest_rad_s2(r) for r in moves), _hardest_rad_s2(recording)
    return own > 0.0 and REACHED <= own / (step.share * hardest) <= 1.0 / REACHED


def _excitation_suffices(recording: Recording, step: Step, before: Before) -> bool:
    """True if an excitation is as loud or as quiet, as long and as wide as the step asks for."""
    if recording.duration_s < REACHED * (step.seconds or RESPONSE_S) or _band_hz(recording) < REACHED * step.up_to_hz:
        return False
    excited = [r for r in before.recordings if r.sidecar.experiment == "frf" and not r.sidecar.held_out]
    loudest, own = max(_largest_nm(r) for r in excited), _largest_nm(recording)
    return own >= REACHED * loudest if step.share >= LOUD else own <= ROUNDED * quieter(loudest, before.friction_nm, step.share)


def _has_speeds(recording: Recording, step: Step, before: Before) -> bool:
    """True if strokes are as slow and as fast as the step asks for; of a sweep without speeds any will do."""
    if not step.speeds_m_s:
        return True
    if recording.reference_velocity is None:
        return False
    speed = np.abs(before.ratio * recording.reference_velocity)
    cruising = speed[(np.abs(np.gradient(speed)) < 1e-9) & (speed > UNDER_WAY * min(step.speeds_m_s))]
    return len(cruising) > 0 and bool(
        np.min(cruising) <= ROUNDED * min(step.speeds_m_s) and ROUNDED * np.max(cruising) >= max(step.speeds_m_s)
    )


def _largest_nm(recording: Recording) -> float:
    """Amplitude of an excitation, N m, without what holds the axis."""
    note = recording.sidecar.excitation
    known = note.amplitude_nm if note is not None else None
    return known if known is not None else float(np.max(np.abs(recording.torque)))


def _hardest_rad_s2(recording: Recording) -> float:
    """Largest acceleration that was asked for, rad/s² at the motor; 0 where no speed was."""
    speed = recording.reference_velocity
    return 0.0 if speed is None else float(np.max(np.abs(np.gradient(speed, recording.t_s))))


def _band_hz(recording: Recording) -> float:
    """Hz below which ``IN_BAND`` of the torque's power lies."""
    torque = recording.torque - np.mean(recording.torque)
    power = np.cumsum(np.abs(np.fft.rfft(torque)) ** 2)
    place = int(np.searchsorted(power, IN_BAND * power[-1]))
    return place / (len(torque) * recording.sample_period_s)
