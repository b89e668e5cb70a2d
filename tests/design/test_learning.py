"""The learning filter: what it learns, and where it keeps its hands off."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.design.learning import CONTRACTS, LearningFilter, learning_filter

Array = NDArray[np.float64]
PERIOD_S, SAMPLES = 1e-3, 1500


def answer(stiffness: float, damping: float, inertia: float, late: int = 1) -> Array:
    """Place of a mass on a spring after a sample of force, exactly enough, some samples later."""
    n, x, v = 800, 0.0, 0.0
    found = np.zeros(n)
    for k in range(1, n):
        force = 1.0 if k == 1 + late else 0.0
        v += PERIOD_S * (force - stiffness * x - damping * v) / inertia
        x += PERIOD_S * v
        found[k] = x
    return found


def taught(teacher: LearningFilter, plant: Array, disturbance: Array, times: int) -> list[float]:
    """rms of the error, repetition by repetition, on a plant that is linear."""
    torque, counts, left = np.zeros(SAMPLES), np.ones(SAMPLES), []
    for _ in range(times):
        error = disturbance - np.convolve(torque, plant)[:SAMPLES]
        left.append(float(np.sqrt(np.mean(error**2))))
        torque = teacher.next(torque, error, counts)
    return left


def disturbance(seed: int) -> Array:
    """What repeats, of low frequencies: quiet at both ends."""
    smooth = np.convolve(np.random.default_rng(seed).normal(size=SAMPLES + 200), np.hanning(80) / 40.0, mode="same")[100:-100]
    return np.asarray(1e-3 * smooth * np.hanning(SAMPLES))


@pytest.mark.parametrize("seed", range(3))
def test_what_repeats_is_learnt_on_a_plant_that_is_not_quite_the_model(seed: int) -> None:
    random = np.random.default_rng(seed)
    model = answer(2000.0, 20.0, 0.5)
    around = [answer(2000.0 * a, 20.0 * b, 0.5 * c, late) for a, b, c, late in zip(
        random.uniform(0.8, 1.25, 6), random.uniform(0.7, 1.4, 6), random.uniform(0.9, 1.1, 6), [0, 1, 2, 1, 1, 1], strict=True
    )]  # fmt: skip
    teacher = learning_filter(model, around, PERIOD_S, 1e-7, 0.01, SAMPLES)
    assert np.all(teacher.worst <= CONTRACTS + 1e-9)
    left = taught(teacher, answer(1800.0, 24.0, 0.53), disturbance(seed), 10)
    assert left[-1] < 0.05 * left[0]
    assert all(b < 1.02 * a for a, b in itertools.pairwise(left))


def test_where_the_model_is_wrong_in_sign_nothing_is_learnt_and_nothing_gets_worse() -> None:
    model = answer(2000.0, 20.0, 0.5)
    teacher = learning_filter(model, [-model], PERIOD_S, 1e-7, 0.01, SAMPLES)
    assert teacher.band_hz == 0.0
    left = taught(teacher, -model, disturbance(1), 5)
    assert left[-1] == pytest.approx(left[0], rel=1e-6)


def test_beyond_the_band_the_model_is_not_trusted() -> None:
    """A resonance whose place nobody knows is left out; below it is learnt."""
    model = answer(2000.0, 4.0, 0.5)  # 10 Hz
    around = [answer(2000.0 * share, 4.0, 0.5) for share in (0.6, 0.8, 1.3, 1.7)]
    teacher = learning_filter(model, around, PERIOD_S, 1e-7, 0.01, SAMPLES)
    at = {f: int(np.argmin(np.abs(teacher.freq_hz - f))) for f in (2.0, 10.0)}
    assert teacher.keep[at[2.0]] > 0.5
    assert teacher.keep[at[10.0]] < 0.1
