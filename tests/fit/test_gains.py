"""The gains of the whitening filter against the textbook's recursion, sample by sample."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from beltcomm.fit.noise.colour import WHITE_NOISE, NoiseColour
from beltcomm.fit.noise.propagation import noise_schedule
from beltcomm.fit.noise.whitening import gains_of, noises
from beltcomm.model import load_plant

STEP_RAD, NOISE_NM, SAMPLE_S = 6.28 / 4096, 0.01, 1e-3
#: Gains that change by less than 1e-8 from one sample to the next stay, of a belt that swings on for a thousand.
STAYS = 1e-8 * 1e3


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(
    "colour", [WHITE_NOISE, NoiseColour(pole=0.6), NoiseColour(numerator=(0.6, 0.2, 0.1, 0.05), denominator=(1.0, -0.3, 0.1, 0.0))]
)
def test_gains_are_the_textbook_s_whatever_samples_are_left_out(seed: int, colour: NoiseColour) -> None:
    """Anderson, Moore, section 5.3:  K = (F P Hᵀ + G V Dᵀ)/σ²,  P ← F P Fᵀ + G V Gᵀ - K σ² Kᵀ, the last term where a sample is kept."""
    random = np.random.default_rng(seed)
    keep = np.repeat(random.random(60) < 0.6, random.integers(1, 40, size=60))
    way = noise_schedule(load_plant("g_a").model, np.full(len(keep), 0.2), SAMPLE_S, None)
    level = np.zeros(len(keep), dtype=np.int64)
    path, variances, start = noises(way.paths[0], STEP_RAD, NOISE_NM, (1.0, 0.0), colour)
    found, deviations = gains_of(keep, [path], level, variances, start)
    f, g, h, d = (np.asarray(getattr(path, name)) for name in "FGHD")
    v, p = np.diag(variances), start.copy()
    wanted: list[Any] = []
    for kept in keep:
        variance = float(h @ p @ h + d @ v @ d)
        gain = (f @ p @ h + g @ v @ d) / variance if kept else np.zeros(len(h))
        wanted.append((*gain, variance**0.5 if kept else 1.0))
        p = f @ p @ f.T + g @ v @ g.T - variance * np.outer(gain, gain)
    expected = np.array(wanted)
    assert np.abs(found - expected[:, :-1]).max() < STAYS * np.abs(expected[:, :-1]).max()
    assert np.abs(deviations / expected[:, -1] - 1.0).max() < STAYS
