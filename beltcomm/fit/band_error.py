"""The residual torque in a band that its noise leaves free: what the error of a model in plain units is told by.

    error² = mean (g * e)²,   torque² = mean (g * τ)²        over the samples that count

e : residual torque of :func:`beltcomm.fit.residual.whitened.evaluate`, N m at the motor shaft.   τ : the torque that was reported.
g : Gaussian low-pass without phase, 3 dB at the band's edge, one for both; samples that do not count take no part in it.

Without a band e of a coarse encoder is little but rounding, J times its second difference.  So the band is the widest of
:data:`BANDS_HZ`, at most a quarter of the sample rate, in which torque noise and rounding are predicted to stay below
:data:`QUIET_SHARE` of the torque.  It is the figure that least squares on filtered signals leaves, and that papers quote.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import correlate1d

from beltcomm.arrays import Array, BoolArray
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.noise.whitening import noises
from beltcomm.fit.records import Data
from beltcomm.fit.residual.segment import Segment
from beltcomm.fit.residual.whitened import evaluate, evaluate_each, noise_paths_of, with_observers
from beltcomm.model import Model

#: Hz, from wide to narrow.
BANDS_HZ = (240.0, 120.0, 60.0, 30.0, 15.0, 8.0, 4.0)
#: Largest share of the torque that noise may have in a band, and of the sample rate that a band may have.
QUIET_SHARE, RATE_SHARE = 0.1, 0.25
#: Stretch of the belt at the start that shows how it rings, m.
STRETCH_M = 1e-5
#: Share of the filter's weights that must stand on samples that count.
WEIGHT = 0.98
#: Share of the squares by which an error may rise that nobody reads off: 2 % of the error.
READ_OFF = 0.04
#: Deviations at which the Gaussian ends, and frequencies at which the noise is worked out.
REACH, LINES = 4.0, 400


@dataclass(frozen=True)
class Banded:
    """A segment in the band.

    Attributes
    ----------
    error, torque : ndarray (n,), N m
    keep : ndarray of bool, (n,) bool
        Samples that count.
    noise : float
        Predicted rms, N m.
    sample_s : float, s
    whole : ndarray (n,), N m
        Residual torque before the low-pass, without what a swing at the start adds.
    """

    record: str
    held_out: bool
    error: Array
    torque: Array
    keep: BoolArray
    noise: float
    sample_s: float
    whole: Array


def band_of(data: Data, model: Model) -> float:
    """Edge of the band for the records of a run, Hz.

    Parameters
    ----------
    data : Data
    model : Model
        As a fit has it, for inertia and belt.
    """
    pieces = data.fitted
    rate = min(1.0 / piece.motion.sample_s for piece in pieces)
    bands = [band for band in BANDS_HZ if band <= RATE_SHARE * rate] or [RATE_SHARE * rate]
    spectra = [_noise_spectrum(piece, model) for piece in pieces]
    for band in bands:
        noise = torque = 0.0
        for piece, spectrum in zip(pieces, spectra, strict=True):
            passed, counts = _low_passed(piece.torque, piece.keep, band, piece.motion.sample_s)
            torque += float(np.sum(passed[counts] ** 2))
            noise += np.count_nonzero(counts) * _noise_in(piece, spectrum, band) ** 2
        if noise <= QUIET_SHARE**2 * torque and torque > 0.0:
            return band
    return bands[-1]


def shared_band(*seen: tuple[Data, Model]) -> float:
    """Edge of the band in which several models are held against each other, Hz: the narrowest of theirs.

    One whose inertia has gone to nothing would let the rounding of the others count as their error.

    Parameters
    ----------
    *seen : tuple of Data and Model
        Records, and the model fitted to them.
    """
    return min(band_of(data, model) for data, model in seen)


def band_limited_errors(data: Data, fitted: Fitted, band_hz: float) -> list[Banded]:
    """All segments of the records, those held out last, as a model leaves them in the band.

    Parameters
    ----------
    data : Data
    fitted : Fitted
        The model that is judged.
    band_hz : float, Hz
        Edge of the band.
    """
    pieces = (*data.fitted, *data.held_out)
    vector = fitted.model.vector()
    return [in_band(piece, fitted.model, vector, band_hz) for piece in with_observers(pieces, [fitted.model] * len(pieces))]


def in_band(piece: Segment, model: Model, vector: Array, band_hz: float) -> Banded:
    """Residual torque of one segment in the band.

    What a carriage that was stretched or swung at the start adds to e is no error of the model, and how it was nobody knows: the part of e
    along the answer to a stretch at the start, and along its derivative, is taken off.

    Parameters
    ----------
    piece : Segment
        With its observer, where the model needs one.
    model : Model
        For effects and bodies.
    vector : ndarray, (k,)
        Values of its parameters.
    band_hz : float, Hz
        Edge of the band.

    Returns
    -------
    Banded
        N m at the motor shaft.
    """
    sample = piece.motion.sample_s
    reported, counts = _low_passed(piece.torque, piece.keep, band_hz, sample)
    if piece.observer is not None or piece.offset_m == 0.0:
        whole = evaluate(piece, model, vector)
        error, _ = _low_passed(whole, piece.keep, band_hz, sample)
    else:
        whole, stretched = evaluate_each(piece, model, [vector, vector], [0.0, STRETCH_M])
        swing = stretched - whole
        error, _ = _low_passed(whole, piece.keep, band_hz, sample)
        answer, _ = _low_passed(swing, piece.keep, band_hz, sample)
        ways = np.column_stack((answer, np.gradient(answer)))
        shares = np.linalg.lstsq(ways[counts], error[counts], rcond=None)[0]
        error = error - ways @ shares
        whole = whole - np.column_stack((swing, np.gradient(swing))) @ shares
    noise = _noise_in(piece, _noise_spectrum(piece, model), band_hz)
    return Banded(piece.record, piece.held_out, error, reported, counts, noise, sample, whole)


def changes(data: Data, before: Fitted, after: Fitted, ahead: Data | None = None) -> tuple[tuple[float, float], tuple[float, float]]:
    """:func:`_change` on the fitted records and on those held out, in the band of both models.

    Parameters
    ----------
    data : Data
        Records as that model sees them.
    before : Fitted
        Fit of the one model.
    after : Fitted
        Fit of the other, to the same records.
    ahead : Data or None
        As the model after does; the same without it.
    """
    band = shared_band((data, before.model), (ahead or data, after.model))
    pairs = list(zip(band_limited_errors(data, before, band), band_limited_errors(ahead or data, after, band), strict=True))
    fitted, held = ([pair for pair in pairs if pair[0].held_out is out] for out in (False, True))
    return _change(fitted), _change(held)


def _change(pairs: Sequence[tuple[Banded, Banded]]) -> tuple[float, float]:
    """Sum of the squared errors after less before, N² m², without what their noise is more; and what of a rise nobody reads off,
    :data:`READ_OFF` of the squares.

    Of samples that count in both.  Noise is passed on otherwise by another model, most where the carriage is at its antiresonance; less
    noise, as it is predicted, makes no rise of an error that does not rise.

    An effect that is there lowers it: what a model leaves is the same in both, so that no chance makes a rise of it.

    Where both errors are smaller than the noise that is predicted of them, their difference is none of the models': 0.
    """
    above, before, after, louder = np.zeros(2), 0.0, 0.0, 0.0
    for old, new in pairs:
        both = np.flatnonzero(old.keep & new.keep)
        above += [float(np.sum(one.error[both] ** 2)) - len(both) * one.noise**2 for one in (old, new)]
        louder += len(both) * (new.noise**2 - old.noise**2)
        before += float(np.sum(old.error[both] ** 2))
        after += float(np.sum(new.error[both] ** 2))
    rise = after - before - louder if above.max() > 0.0 else 0.0
    return min(rise, max(after - before, 0.0)), READ_OFF * before


def _low_passed(signal: Array, keep: BoolArray, band_hz: float, sample_s: float) -> tuple[Array, BoolArray]:
    """The signal by a Gaussian low-pass over the samples that count, and where :data:`WEIGHT` of its weights stand on such; (n,) each.

    Beside a standstill, where e says nothing, what is left of the weights no longer takes the differences out of the rounding.
    """
    weights = _gaussian(band_hz, sample_s)
    total = correlate1d(np.where(keep, signal, 0.0), weights, mode="constant")
    share = correlate1d(keep.astype(np.float64), weights, mode="constant")
    return np.asarray(total / np.where(share > 0.0, share, 1.0)), keep & (share >= WEIGHT)


def _gaussian(band_hz: float, sample_s: float) -> Array:
    """Weights of the low-pass with its 3 dB edge at ``band_hz``, centred, their sum 1, (2 k + 1,)."""
    deviation = math.sqrt(math.log(2.0)) / (math.tau * band_hz * sample_s)
    reach = math.ceil(REACH * deviation)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    return np.asarray(weights / weights.sum())


def _noise_spectrum(piece: Segment, model: Model) -> tuple[Array, Array]:
    """Predicted spectrum of the noise in the residual torque: frequencies up to half the sample rate, Hz, (k,), and power there, N² m² a
    sample.
    """
    found = noise_paths_of(piece, model)
    usual = int(np.bincount(found.level).argmax())
    path, variances, _ = noises(found.paths[usual], piece.step_rad, piece.noise_nm, piece.rounding, piece.colour)
    freq = (np.arange(LINES) + 0.5) * 0.5 / LINES / path.sample_s
    z = np.exp(1j * math.tau * freq * path.sample_s)
    answers = np.linalg.solve(z[:, None, None] * np.eye(len(path.H)) - path.F, np.broadcast_to(path.G + 0j, (LINES, *path.G.shape)))
    passed = np.einsum("i,kij->kj", path.H, answers) + path.D
    return freq, np.asarray(np.abs(passed) ** 2 @ variances)


def _noise_in(piece: Segment, spectrum: tuple[Array, Array], band_hz: float) -> float:
    """Noise of a spectrum by :func:`_noise_spectrum` behind the low-pass, N m rms, motor shaft."""
    freq, power = spectrum
    weights = _gaussian(band_hz, piece.motion.sample_s)
    places = np.arange(len(weights)) - len(weights) // 2
    passed = np.cos(math.tau * piece.motion.sample_s * np.outer(freq, places)) @ weights
    return math.sqrt(float(np.mean(power * passed**2)))
