"""What an observer learns at a sample, against the same in numpy, for states that fill one register and such that need two."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from beltcomm.compiled import in_lanes
from beltcomm.simulate.kernels.learning import WIDEST, learn, with_memory
from beltcomm.simulate.kernels.observer import idle


@pytest.mark.parametrize(("size", "noises"), [(6, 3), (8, 5), (10, 4), (14, 6)])
def test_gain_and_covariance_at_any_share_of_a_closed_gap(size: int, noises: int) -> None:
    rng = np.random.default_rng(size)
    samples, cart, behind = 12, 1, 1
    F, G = 0.3 * rng.normal(size=(2, size, size)), rng.normal(size=(2, size, noises))
    F[:, :, -2:] = 0.0
    H, D = rng.normal(size=(2, size)), rng.normal(size=(2, noises))
    P = np.eye(size)
    shares, keep = rng.random(samples), rng.random(samples) < 0.8
    gains, deviations, lost = np.zeros((samples, size)), np.ones(samples), np.zeros(samples, dtype=np.bool_)
    forgets = np.zeros(samples, dtype=np.bool_)
    forgets[5] = True
    watch = with_memory(idle()._replace(F=F, G=G, H=H, D=D, variances=np.linspace(0.5, 2.0, noises), P=P, s=np.zeros(size), gains=gains))
    spread = np.array([0.3, 0.7])
    kernel: Any = in_lanes(learn)  # as the kernels that call it are compiled
    for n in range(samples):
        kernel(n, 0.0, keep, watch.variances, gains, deviations, shares, lost, forgets, watch.room, cart, behind, spread)
    for n in range(samples):
        f, g, h, d = (pair[0] + shares[n] * (pair[1] - pair[0]) for pair in (F, G, H, D))
        noise = np.diag(watch.variances)
        variance, gain = h @ P @ h + d @ noise @ d, f @ P @ h + g @ noise @ d
        P = f @ P @ f.T + g @ noise @ g.T - (np.outer(gain, gain) / variance if keep[n] else 0.0)
        if keep[n]:
            assert deviations[n] == pytest.approx(np.sqrt(variance), rel=1e-9)
            np.testing.assert_allclose(gains[n], gain / variance, rtol=1e-9, atol=1e-12)
        else:  # nothing is seen of the carriage, which the gap holds
            for place, widest in zip((cart, cart + behind), WIDEST * spread, strict=True):
                factor = np.sqrt(min(1.0, widest / P[place, place]))
                P[place, :] *= factor
                P[:, place] *= factor
        if forgets[n]:
            P[cart, cart] += spread[0]
            P[cart + behind, cart + behind] += spread[1]
