"""Samples with a reversal: friction that turns at one instant is worked out exactly, a motor that may have stuck is told apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from beltcomm.fit.residual.reversals import _find_passages, _reversal_correction, _samples_at
from beltcomm.simulate.inverse import FineMotion
from beltcomm.simulate.kernels.pieces import triangular_mean

SAMPLE_S, SUBSTEPS, RATIO = 1e-3, 16, 0.0125
BEFORE, AFTER = 3000.0, 2000.0  # rad/s²: dry friction helps to stop and hinders to start


def reversal(instant_s: float, samples: int = 9, rest_s: float = 0.0) -> FineMotion:
    """A motor that turns round at an instant, after a rest."""
    t = np.arange((samples - 1) * SUBSTEPS + 1) * SAMPLE_S / SUBSTEPS
    early, late = np.minimum(t - instant_s, 0.0), np.maximum(t - instant_s - rest_s, 0.0)
    theta = 0.5 * (BEFORE * early**2 + AFTER * late**2)
    return FineMotion(theta, BEFORE * early + AFTER * late, samples, SAMPLE_S, SUBSTEPS, 0.0)


@pytest.mark.parametrize("instant_s", [4.013e-3, 4.5e-3, 4.03125e-3, 4.99e-3])
def test_friction_turns_at_the_instant_of_the_reversal(instant_s: float) -> None:
    motion = reversal(instant_s)
    doubtful, instants = _find_passages(motion, 0.3, 1000.0)
    assert not doubtful.any()
    assert instants * SAMPLE_S / SUBSTEPS == pytest.approx([instant_s], abs=1e-9)

    cells, mean = _reversal_correction(motion, instants, RATIO)
    # By quadrature of the sign itself, as the module's head writes the mean: sign(t - t₀) with the weight 1 - |s|.
    for n in range(3, 7):
        low, high = (n - 1) * SAMPLE_S, (n + 1) * SAMPLE_S

        def weighed(t: float, n: int = n) -> float:
            return np.sign(t - instant_s) * (1.0 - abs(t / SAMPLE_S - n)) / SAMPLE_S

        points = [p for p in (instant_s, n * SAMPLE_S) if low < p < high]
        exact = quad(weighed, low, high, points=points)[0]
        by_kernel = triangular_mean(directions(motion), SUBSTEPS)[n]
        assert by_kernel + mean[n] == pytest.approx(exact, abs=2e-3)  # within a fine step the weight is taken as constant
    assert np.count_nonzero(cells) <= 4


def directions(motion: FineMotion) -> np.ndarray:
    """What the kernel makes of it: a bristle that turns round on its way."""
    z, found = 0.0, np.zeros(len(motion.theta))
    for k, way in enumerate(np.diff(motion.theta), start=1):
        z = float(np.clip(z + way * RATIO / motion.bristle_m, -1.0, 1.0))
        found[k] = z
    return found


@pytest.mark.parametrize(
    ("motion", "least"),
    [(reversal(4.2e-3, rest_s=1.5e-3), 1000.0), (reversal(4.2e-3), 2500.0), (reversal(0.02e-3), 1000.0)],
    ids=["rests", "hardly any torque to spare", "at the very start"],
)
def test_a_motor_that_may_have_stuck_does_not_count(motion: FineMotion, least: float) -> None:
    doubtful, instants = _find_passages(motion, 0.3, least)
    assert not len(instants)
    slow = np.abs(motion.omega) < 0.3
    assert np.all(doubtful[slow])
    touched = _samples_at(doubtful, SUBSTEPS)
    for k in np.flatnonzero(doubtful):
        assert touched[k // SUBSTEPS], k
        assert touched[-(-k // SUBSTEPS)], k


def test_a_motor_that_only_slows_down_is_no_reversal() -> None:
    motion = reversal(4.2e-3)
    slowed = FineMotion(motion.theta, np.abs(motion.omega), motion.samples, SAMPLE_S, SUBSTEPS, 0.0)
    doubtful, instants = _find_passages(slowed, 0.3, 1000.0)
    assert not len(instants)
    assert doubtful.any()
