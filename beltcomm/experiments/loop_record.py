"""Identification in closed loop on the drive (3.3.2): a cautious loop, rising amplitude, the record, watched row by row."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from beltcomm.drive import Motion, Row
from beltcomm.errors import SafetyStop
from beltcomm.experiments import commission as sequence
from beltcomm.experiments import phases
from beltcomm.experiments.loop_plan import RISES, TITLES, LoopJob, check_inside, is_moved
from beltcomm.experiments.raising import GROWTH
from beltcomm.identify.amplitude import family_around
from beltcomm.identify.loop_amplitude import (
    SLOWEST_SHARE,
    MovingPrediction,
    predict_moving,
    simulate_record,
)
from beltcomm.identify.loop_response import KnownController
from beltcomm.machine.machine import Envelope, Machine
from beltcomm.machine.prediction_watch import SURPRISE, TRAVEL_SLACK_M
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from beltcomm.rundata.findings import Findings


def record_all(machine: Machine, findings: Findings, job: LoopJob, *, ask: bool) -> Recording:
    """Close the loop, let the amplitude rise, and make the record.

    Parameters
    ----------
    machine : Machine
    findings : Findings
        Filled as it goes.
    job : LoopJob
        Loop, signal and predicted motion.
    ask : bool
        True if a person agrees before the loop is closed.

    Returns
    -------
    Recording
        The long one.

    Raises
    ------
    BeltcommError
        What the machine raises.
    """
    machine.titles = TITLES
    machine.begin(TITLES[0])
    sequence.close_loop(machine, findings, job.model, job.cascade, job.margin_deg, ask=ask)
    number = 1 + sum(name.startswith(f"{job.way}_") and "_rise_" not in name for name in machine.folder.finished_names())
    machine.begin(TITLES[1])
    amplitude = job.step.amplitude / GROWTH**RISES
    for rise in range(1, RISES + 1):
        if not job.speed_m_s and not is_moved(job, amplitude, machine.position_m):
            amplitude = job.step.amplitude  # what friction holds shows nothing
        recording = _record(machine, job, _free(machine, f"{job.way}_{number}_rise_{rise}"), amplitude, rising=True)
        amplitude = min(GROWTH * amplitude, _allowed_gains(recording, amplitude, job.loop.drive.counts_per_rev), job.step.amplitude)
    machine.begin(TITLES[2])
    return _record(machine, job, _free(machine, f"{job.way}_{number}"), amplitude, rising=False)


def slowest_share(recording: Recording, counts_per_rev: int) -> float:
    """Least motor speed over its mean while excited, from differences of the angle less one count; nan where the carriage stood.

    Parameters
    ----------
    recording : Recording
        Excited around a constant speed.
    counts_per_rev : int

    Returns
    -------
    float
        Smallest of all periods; negative where the motor turned back.
    """
    note = recording.sidecar.excitation
    if note is None or not note.base_speed_m_s or not note.period_starts or not note.period_samples:
        return math.nan
    found, count = math.inf, 2.0 * math.pi / counts_per_rev
    for start in note.period_starts:
        turned = np.diff(recording.position[start : start + note.period_samples])
        mean = float(np.mean(turned))
        found = min(found, (float(np.min(turned * np.sign(mean))) + count) / abs(mean))
    return found


def _allowed_gains(recording: Recording, amplitude: float, counts_per_rev: int) -> float:
    """The amplitude at which the motor is slowed down as much as it may, by what a record with a smaller one showed."""
    share = slowest_share(recording, counts_per_rev)
    return amplitude * (1.0 - SLOWEST_SHARE) / max(1.0 - share, 1e-6) if math.isfinite(share) else math.inf


def _free(machine: Machine, name: str) -> str:
    """A name that no finished record has."""
    return name if machine.folder.finished(name) is None else _free(machine, f"{name}b")


def _record(machine: Machine, job: LoopJob, name: str, amplitude: float, *, rising: bool) -> Recording:
    """One record from the nearer end of the travel, predicted before it is made."""
    model, loop = job.model, job.loop
    ends = phases.stroke_ends(machine)
    near, far = ends if abs(machine.position_m - ends[0]) <= abs(machine.position_m - ends[1]) else ends[::-1]
    machine.write_cascade(job.cascade)
    if job.speed_m_s:
        phases.move_to(machine, near, model)
    at = machine.position_m
    motion = job.motion(amplitude, 1.0 if far > near else -1.0, rising=rising)
    running = machine.write_cascade(loop.cascade)
    exactly = replace(loop, cascade=running)
    predicted = predict_moving(family_around(model), exactly, motion, at, machine.braking)
    check_inside(machine, predicted)
    low_word = f", the motor never slower than {100 * predicted.slowest:.0f} % of that" if math.isfinite(predicted.slowest) else ""
    machine.talk.say(
        f"{name}: ±{amplitude:.3g} {job.unit} at {1e3 * job.speed_m_s:.4g} mm/s{low_word}; {predicted.belt_force_n:.0f} N in the belt, "
        f"{predicted.torque_nm:.2f} N m, between {1e3 * predicted.low_m:.0f} and {1e3 * predicted.high_m:.0f} mm with a stop"
    )
    first = simulate_record(model, exactly, motion, at)
    held = max(1, round(loop.sample_period_s / loop.drive.period_s))
    carriage = first.cart_m[::held]
    base, zero = at + motion.base_m, np.zeros(len(motion.added))
    asked = motion.base_m_s / machine.ratio
    torque, faster = (motion.added, zero) if loop.into == "torque" else (zero, motion.added)
    order = Motion(loop.kind, loop.sample_period_s, machine.origin_rad + base / machine.ratio, asked + faster, torque)
    low, high = machine.envelope().window_m
    slack = SURPRISE * predicted.deviation_m + TRAVEL_SLACK_M + phases.END_MARGIN_M
    window = max(low, float(base.min()) - slack), min(high, float(base.max()) + slack)
    envelope = Envelope(
        window, machine.envelope().speed_m_s, machine.envelope().torque_nm, phases.LOST_M if loop.kind == "position" else None
    )
    known = KnownController(running, loop.kind, loop.drive.period_s, loop.drive.delay_s)
    note = ExcitationNote(
        kind=job.choice.excitation(1.0, loop.sample_period_s).kind,
        amplitude_nm=float(np.max(np.abs(motion.added))) if loop.into == "torque" else None,
        period_samples=motion.period_samples,
        first_sample=motion.starts[0],
        period_starts=motion.starts,
        amplitude_rad_s=float(np.max(np.abs(motion.added))) if loop.into == "velocity" else None,
        base_speed_m_s=job.speed_m_s or None,
    )
    sidecar = Sidecar("frf", at, machine.session_time_s, closed_loop=True, excitation=note, controller=known.to_dict())
    watch = MovingWatch(base, machine.ratio, machine.origin_rad, loop.sample_period_s, predicted)
    return machine.record(name, order, envelope, sidecar, watch, (carriage, np.gradient(carriage, loop.sample_period_s)))


class MovingWatch:
    """Call it with every row of a record: the motor stays near the base motion and below the predicted speed.

    Raises
    ------
    SafetyStop
    """

    def __init__(self, base_m: np.ndarray, ratio: float, zero_rad: float, period_s: float, predicted: MovingPrediction) -> None:
        self.base_m, self.ratio, self.zero_rad, self.period_s = base_m.tolist(), ratio, zero_rad, period_s
        self.farthest_m = SURPRISE * predicted.deviation_m + TRAVEL_SLACK_M
        self.fastest_m_s = SURPRISE * predicted.speed_m_s

    def __call__(self, row: Row) -> None:
        """One row as the drive gives it; raises SafetyStop."""
        place = min(round(row[0] / self.period_s), len(self.base_m) - 1)
        off = abs(self.ratio * (row[3] - self.zero_rad) - self.base_m[place])
        speed = abs(self.ratio * row[4])
        if off > self.farthest_m:
            self._stop("position", f"the motor is {1e3 * off:.3g} mm off its base motion, {1e3 * self.farthest_m:.3g} mm")
        if speed > self.fastest_m_s:
            self._stop("speed", f"the motor runs at {speed:.3g} m/s, {self.fastest_m_s:.3g} m/s")

    def _stop(self, reason: str, what: str) -> None:
        raise SafetyStop(
            f"{what} were to be expected at most; the axis was stopped: it is not the one that the run's model describes; "
            "identify it again (beltcomm identify)",
            reason,
        )
