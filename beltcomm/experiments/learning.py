"""A move over and over: the torque sent along with it learnt from what is left of its error, within the limits, as long as that gets on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from beltcomm.arrays import Array, BoolArray, rms
from beltcomm.control import Cascade
from beltcomm.design.compliant import with_rest_before
from beltcomm.design.learning import LearningFilter, learning_filter
from beltcomm.errors import Refused
from beltcomm.experiments.proving import verify_move
from beltcomm.experiments.verification import in_drive
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95
from beltcomm.quantities import mm
from beltcomm.recording import Recording
from beltcomm.sending import Sending
from beltcomm.simulate.stopping import total_friction
from beltcomm.trajectory import Trajectory, at_rest
from beltcomm.verify import REST_S, Loop, Verdict, predict_move

#: s of rest before the move, in which what is learnt may begin, and after its end for which is still learnt.
BEFORE_S, AFTER_S = 0.05, 0.05
#: s of an answer, its place in them, and the torque of the sample that asks for it, N m.
ANSWER_S, ASKED_AT, ASKED_NM = 0.8, 4, 0.05
#: Counts of an encoder that rounds nothing.
FINE = 1 << 30
#: Plants that the model may stand for: draws from its intervals, with so much beside them for what intervals do not know, as shares.
PLANTS, STIFFNESS, MASS, DAMPING = 10, 0.15, 0.05, 0.5
#: Share of the friction below which no torque is worth learning.
WORTH = 0.02
#: Times the least error so far, from which on the learning is stopped.
DIVERGES = 1.3


@dataclass(frozen=True, eq=False)
class Repetition:
    """One drive of the move.

    Attributes
    ----------
    name : str
        Of its recording.
    rms_m, largest_m : float
        Of the motor's error while the reference moves.
    torque_nm : ndarray (n,), N m, motor shaft
        That had been learnt by then.
    error_m : ndarray (n,), m
        Of the motor, at the samples of the torque.
    """

    name: str
    rms_m: float
    largest_m: float
    torque_nm: Array
    error_m: Array
    verdict: Verdict


@dataclass(eq=False)
class Learnt:
    """The repetitions so far; all of them when :func:`learn` has come back, those that were driven when it was stopped.

    Attributes
    ----------
    path : Trajectory or None
        The move, with the rest before it that belongs to the torque; None before it was made.
    ended : str
        Why it was stopped before its time, or "".
    """

    path: Trajectory | None = None
    repetitions: list[Repetition] = field(default_factory=list)
    band_hz: float = 0.0
    ended: str = ""

    @property
    def best(self) -> Repetition:
        """The one with the least error; there must be one."""
        return min(self.repetitions, key=lambda one: one.rms_m)

    @property
    def limit_m(self) -> float:
        """rms of what differs between two drives with the same torque: no learning takes that away; nan where there are no two."""
        best, path = self.best, self.path
        same = [one for one in self.repetitions if one is not best and np.array_equal(one.torque_nm, best.torque_nm)]
        if path is None or not same:
            return math.nan
        return float(np.sqrt(np.mean((same[-1].error_m - best.error_m)[_moving(path, len(best.error_m))] ** 2) / 2.0))


def learn(
    machine: Machine,
    model: Model,
    cascade: Cascade,
    delay_s: float,
    trajectory: Trajectory,
    count: int,
    name_of: Callable[[], str],
    learnt: Learnt,
    sending: Sending = "nothing",
) -> None:
    """Drive a move, then ``count`` times more with what the ones before have taught; the last one repeats the best.

    Parameters
    ----------
    machine : Machine
    model : Model
    cascade : Cascade
    delay_s : float, s
        Of the torque path.
    trajectory : Trajectory
        The move, at the carriage.
    count : int
        Repetitions.
    name_of : callable
        A free name for the next recording.
    learnt : Learnt
        Gets each repetition as soon as it is driven, so that what stops a later one loses none.
    sending : Sending
        Way in which the host leads the move.

    Raises
    ------
    Refused
        When the move itself would break a limit.
    """
    period = trajectory.sample_period_s
    path = with_rest_before(trajectory, round(BEFORE_S / period))
    samples = len(path.t_s) + len(at_rest(0.0, REST_S, period).t_s) - 1
    learnt.path, done = path, learnt.repetitions
    torque = np.zeros(samples)
    teacher: LearningFilter | None = None
    for number in range(count + 1):
        last = number == count and number > 0
        if last or learnt.ended:
            torque = learnt.best.torque_nm
        name = name_of()
        try:
            verdict, _ = verify_move(machine, model, cascade, delay_s, path, name, sending=sending, learnt=torque if done else None)
        except Refused as refusal:
            if not done:
                raise
            learnt.ended = f"what was learnt next would break a limit ({str(refusal).removeprefix('the move is refused: ')})"
            continue
        one = _repetition(name, machine.folder.recording(name), machine.ratio, torque, verdict, period)
        done.append(one)
        if last or (learnt.ended and number > 0 and len(done) > 1):
            break
        best = learnt.best
        if one.rms_m > DIVERGES * best.rms_m:
            learnt.ended = f"the error grew from {mm(best.rms_m)} to {mm(one.rms_m)}: the model does not tell how to learn this move"
            continue
        if teacher is None:
            worth = max(machine.drive.capabilities.torque_step_nm, WORTH * total_friction(model))
            noise = machine.ratio * 2.0 * np.pi / machine.drive.capabilities.counts_per_rev / np.sqrt(12.0)
            answers = _answers(machine, model, cascade, delay_s, path)
            teacher = learning_filter(answers[0], answers[1:], period, noise, worth, samples)
            learnt.band_hz = teacher.band_hz
        if teacher.band_hz == 0.0:
            learnt.ended = "the model is not sure enough of how this axis answers to a torque: nothing can be learnt from it"
            break
        counts = _counts(path, samples)
        torque = teacher.next(one.torque_nm, one.error_m, counts)


def _repetition(name: str, recording: Recording, ratio: float, torque: Array, verdict: Verdict, period_s: float) -> Repetition:
    """A repetition by its record, whose lost rows are filled from their neighbours: error and torque stay sample by sample."""
    assert recording.reference_position is not None
    error = ratio * (recording.reference_position - recording.position)
    moving = np.abs(np.gradient(recording.reference_position)) > 0.0
    largest = float(np.max(np.abs(error[moving])))
    at = np.rint((recording.t_s - recording.t_s[0]) / period_s)
    return Repetition(name, rms(error[moving]), largest, torque, np.interp(np.arange(len(torque)), at, error), verdict)


def _moving(path: Trajectory, samples: int) -> BoolArray:
    found = np.zeros(samples, dtype=bool)
    found[: len(path.t_s)] = np.abs(path.velocity_m_s) > 0.0
    return found


def _counts(path: Trajectory, samples: int) -> Array:
    """1 while the reference moves and somewhat after it, 0 elsewhere but in the rest before."""
    moving = np.flatnonzero(_moving(path, samples))
    found = np.zeros(samples)
    found[: moving[-1] + round(AFTER_S / path.sample_period_s)] = 1.0
    return found


def _answers(machine: Machine, model: Model, cascade: Cascade, delay_s: float, path: Trajectory) -> list[Array]:
    """Place of the motor after one sample of torque, m per N m: of the model first, then of plants that it may stand for."""
    random, drive = np.random.default_rng(0), in_drive(machine, delay_s)
    low, high = float(np.min(path.position_m)), float(np.max(path.position_m))
    found = [_answer(model, cascade, drive, 0.5 * (low + high), path.sample_period_s)]
    for number in range(PLANTS):
        place = (low, high, 0.5 * (low + high))[number % 3]
        late = replace(drive, delay_s=max(0.0, drive.delay_s + random.uniform(-0.5, 0.5) * path.sample_period_s))
        found.append(_answer(_drawn(model, random), cascade, late, place, path.sample_period_s))
    return found


def _drawn(model: Model, random: np.random.Generator) -> Model:
    """A plant that the model may stand for."""
    values = {}
    for name, one in model.parameters.items():
        if one.interval is None or name == "transmission.ratio":
            continue
        beside = (
            STIFFNESS if "stiffness" in name else MASS if name in ("cart.mass", "motor.inertia") else DAMPING if "damping" in name else 0.0
        )
        value = (
            one.value * (1.0 + random.uniform(-beside, beside))
            + min(one.interval, 0.5 * abs(one.value)) * random.standard_normal() / NORMAL_95
        )
        values[name] = float(np.clip(value, one.low, one.high))
    return model.with_values(values)


def _answer(model: Model, cascade: Cascade, drive: Loop, place_m: float, period_s: float) -> Array:
    """By two simulations at rest, without the friction that would hold the axis: there a move is not at rest."""
    free = model.with_values({name: one.low for name, one in model.parameters.items() if name.endswith(".level") and one.low >= 0.0})
    rest = at_rest(place_m, ANSWER_S, period_s)
    pulse = np.zeros(len(rest.t_s))
    pulse[ASKED_AT] = ASKED_NM
    ideal = replace(drive, torque_limit_nm=1e3, counts_per_rev=FINE)
    asked, left = (predict_move(free, cascade, rest, ideal, extra_torque_nm=along).motor_m for along in (pulse, np.zeros(len(pulse))))
    return np.asarray((asked - left)[ASKED_AT:] / ASKED_NM)
