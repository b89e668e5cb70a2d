"""Learning over moves: a feedforward torque for one move, made better from its repetitions, as far as the model is to be trusted.

    u[k+1] = Q (u[k] + L e[k]),      L = G*/(|G|² + ρ),      ρ = (noise of e / torque that is worth sending)²

G : from a torque sent along to the motor's place, in closed loop, by the model; e : reference less place.   In repetition k the error that
the torque can reach becomes e[k+1] = Q (1 - L G_true) e[k] + (1 - Q) …, so it shrinks at every frequency where |Q (1 - L G)| < 1 for every
plant that the model may stand for: Q, without phase, is 1 where the worst of them contracts, less where it hardly does, 0 beyond.
Source: Bristow, Tharayil, Alleyne, A survey of iterative learning control, IEEE Control Systems 26 (2006); their (17), (19) and (23).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array, ComplexArray

#: |Q (1 - L G)| of the worst plant at most; where |1 - L G| of it is beyond this, the model is not trusted.
CONTRACTS, TRUSTED = 0.9, 0.8
#: Share of the learning that is taken in one repetition: the noise of one is not learnt as a whole.
STEP = 0.7
#: Hz over which Q is smoothed: a sharp edge rings.
EDGE_HZ = 4.0
#: s at the ends over which what is learnt fades in and out.
FADE_S = 0.03


@dataclass(frozen=True)
class LearningFilter:
    """L and Q on the lines of a Fourier transform.

    Attributes
    ----------
    freq_hz : ndarray (m,)
    learn : ndarray (m,), complex
        L, N m per m, at the motor shaft.
    keep : ndarray (m,)
        Q.
    worst : ndarray (m,)
        |Q (1 - L G)| of the worst plant.
    size : int
        Of the transform.
    period_s : float
    """

    freq_hz: Array
    learn: ComplexArray
    keep: Array
    worst: Array
    size: int
    period_s: float

    @property
    def band_hz(self) -> float:
        """Highest frequency up to which half of what is asked is learnt."""
        wide = np.flatnonzero(self.keep > 0.5)
        return float(self.freq_hz[wide[-1]]) if len(wide) else 0.0

    def next(self, torque_nm: Array, error_m: Array, counts: Array) -> Array:
        """Torque of the next repetition, (n,), N m.

        Parameters
        ----------
        torque_nm : ndarray (n,), N m
            Learnt so far.
        error_m : ndarray (n,), m
            Of the repetition that was driven with it.
        counts : ndarray (n,)
            How far each sample counts, 0 to 1: what an axis does at rest is its friction's affair.
        """
        asked = np.fft.rfft(error_m * counts, self.size) * self.learn
        whole = np.fft.rfft(torque_nm, self.size) + asked
        return np.fft.irfft(whole * self.keep, self.size)[: len(torque_nm)] * _faded(counts, self.period_s)


def learning_filter(
    nominal: Array, plants: Sequence[Array], period_s: float, noise_m: float, worth_nm: float, samples: int
) -> LearningFilter:
    """L of the model, and Q by all plants that it may stand for.

    Parameters
    ----------
    nominal : ndarray (k,)
        Place of the motor after one sample of torque, m per N m, sample by sample.
    plants : sequence of ndarray
        The same of each plant.
    period_s : float, s
        Of the samples.
    noise_m : float
        rms of the error's noise, m.
    worth_nm : float
        Torque below which nothing is worth learning, N m.
    samples : int
        Of the move.
    """
    size = 1 << int(np.ceil(np.log2(2 * max(samples, len(nominal)))))
    freq = np.fft.rfftfreq(size, period_s)
    g = np.fft.rfft(nominal, size)
    learn = STEP * np.conj(g) / (np.abs(g) ** 2 + (noise_m / worth_nm) ** 2)
    off = np.max([np.abs(1.0 - learn * np.fft.rfft(plant, size)) for plant in (nominal, *plants)], axis=0)
    # Where the plant hardly answers, L is nearly nothing and 1 - L G nearly one: nothing is learnt there, and nothing kept that was not.
    keep = np.where(off < TRUSTED, np.minimum(1.0, CONTRACTS / np.maximum(off, 1e-9)), 0.0)
    width = max(1, round(EDGE_HZ * size * period_s))
    window = np.ones(2 * width + 1) / (2 * width + 1)
    smooth = np.convolve(np.concatenate((keep[width:0:-1], keep, keep[-2 : -width - 2 : -1])), window, mode="valid")
    keep = np.minimum(smooth, CONTRACTS / np.maximum(off, CONTRACTS))
    return LearningFilter(np.asarray(freq, dtype=np.float64), np.asarray(learn, dtype=np.complex128), keep, keep * off, size, period_s)


def _faded(counts: Array, period_s: float) -> Array:
    """Torque with soft ends, so that what is learnt begins and ends without a step."""
    width = max(1, round(FADE_S / period_s))
    window = np.ones(width) / width
    return np.convolve(np.pad(counts, (width, width), mode="edge"), window, mode="same")[width:-width]
