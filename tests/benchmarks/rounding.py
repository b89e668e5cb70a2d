"""What the encoder's rounding costs an estimate when the periods of an excitation are rounded alike.

    python tests/benchmarks/rounding.py [linear | friction]      # some minutes, 2 GB

``speeds/bound`` takes the rounding for white noise.  It is not where the motion repeats: what stands at the same place of two counts is
rounded alike, and over all places at which a motion may begin

    E q[i] q[j] = c(θ[i] - θ[j]),      c(d) = 1/12 - f (1 - f)/2 counts²,    f = d - floor(d)    (the sawtooth with itself).

With D and M the innovations of the parameters and of a unit of rounding at each sample, by the filter for white rounding of variance s,

    C = I + M (R - s I) Mᵀ,    weights for white rounding:  A C Aᵀ, A = (DᵀD)⁻¹Dᵀ,    the best:  (Dᵀ C⁻¹ D)⁻¹.

R : s I (white);   c between the same samples of different periods, else 0 (repeats: whatever the motion is);   c between all (the
motion as it is; its best weights need the motion to a fraction of a count, which the noise of the torque forbids).
To first order: errors by the noise in the regressor are not in it.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.sparse import csr_array, diags_array

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from beltcomm.simulate.forward import simulate_torque
from beltcomm.thesis.excitations import COUNTS, NOISE_NM, PERIOD_S, PLACE_M
from benchmarks.speeds.bound import gains, innovations, linearised
from benchmarks.speeds.estimation import axis, free, given, signal_of

Array = NDArray[np.float64]
COUNT = 2.0 * math.pi / COUNTS


def alike(apart_counts: Array) -> Array:
    """c of the module's head, counts²."""
    f = apart_counts - np.floor(apart_counts)
    return 1.0 / 12.0 - 0.5 * f * (1.0 - f)


def repeats(angle_counts: Array, period: int) -> csr_array:
    """R without its diagonal, counts², (n, n): between the same samples of different periods."""
    n = len(angle_counts)
    lags = range(period, n, period)
    sides = [alike(angle_counts[lag:] - angle_counts[:-lag]) for lag in lags]
    return csr_array(diags_array([*sides, *sides], offsets=[*(-lag for lag in lags), *lags], shape=(n, n)))


def everywhere(angle_counts: Array) -> Array:
    """R without its diagonal, counts², (n, n): between all samples."""
    R = alike(angle_counts[:, None] - angle_counts[None, :])
    np.fill_diagonal(R, 0.0)
    return R


def responses(Phi: Array, K: Array, S: Array) -> Array:
    """M of the module's head, (n, n), per rad."""
    M, x = np.zeros((len(Phi), len(Phi))), np.zeros((Phi.shape[1], len(Phi)))
    for k in range(len(Phi)):
        M[k] = -x[0]
        M[k, k] += 1.0
        x = Phi[k] @ (x + np.outer(K[k], M[k]))
        M[k] /= math.sqrt(S[k])
    return M


def deviations(D: Array, M: Array, excess: Array | csr_array) -> tuple[Array, Array]:
    """Standard deviations of the parameters, (k,) each: by the weights for white rounding, by the best.

    D : (n, k).   M : (n, n).   excess : R - s I, (n, n), in the square of M's unit.
    """
    C = M @ (excess @ M.T)
    C[np.diag_indices(len(C))] += 1.0
    A = np.linalg.solve(D.T @ D, D.T)
    usual = np.sqrt(np.diag(A @ C @ A.T))
    W = solve_triangular(cholesky(C, lower=True, overwrite_a=True), D, lower=True)
    return usual, np.sqrt(np.diag(np.linalg.inv(W.T @ W)))


def lines(condition: str) -> Iterator[str]:
    """The table of one axis."""
    model = axis(condition)
    signal, names = signal_of(model, "prbs"), free(model)
    Phi, Gamma, g = linearised(model, signal, names)
    D = innovations(Phi, Gamma, g, NOISE_NM, COUNT)
    least = np.sqrt(np.diag(np.linalg.inv(D.T @ D)))
    M = responses(Phi, *gains(Phi, Gamma, NOISE_NM, COUNT))
    share = COUNT**2 / 12.0 * np.sum((np.linalg.solve(D.T @ D, D.T) @ M) ** 2, axis=1) / least**2
    yield f"{condition}, PRBS of {signal.repeats + 1} periods, over the bound with white rounding".ljust(70) + "".join(
        f"{n:>26}" for n in names
    )
    yield "white: share of the rounding in the variance".ljust(70) + "".join(f"{v:26.3f}" for v in share)
    cases = (
        ("the same torque in every period, repeats", signal, lambda angle: repeats(angle, signal.period_samples)),
        ("the same torque in every period, the motion as it is", signal, everywhere),
        ("no period quite like another, repeats", given(signal, 1), lambda angle: repeats(angle, signal.period_samples)),
    )
    for title, motion, excess in cases:
        angle = simulate_torque(model, motion.torque, PERIOD_S, PLACE_M).position_rad / COUNT
        for how, found in zip(("usual weights", "best"), deviations(D, M, COUNT**2 * excess(angle)), strict=True):
            yield f"{title}: {how}".ljust(70) + "".join(f"{v:26.3f}" for v in found / least)


if __name__ == "__main__":
    for chosen in sys.argv[1:] or ("linear", "friction"):
        for line in lines(chosen):
            print(line, flush=True)
