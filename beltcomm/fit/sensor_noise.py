"""The sensor's own share of what the reading differs from its setpoint by: what of it does not move the machine.

    reading - L y = p + s,     residual e[n] = -(s[n-1] + s[n])/2 + ...,     D_k = -E[e[n] (p + s)[n-k]] = (a_(k-1) + a_k)/2

p : torque that acts, s : noise of the sensor with covariance a_k.  The residual of a wrong model is no noise, and hardly goes with p + s,
so this is a second opinion on how large an error the noise alone leaves.  Coloured noise a_k = ρ^k a_0 has D_2/D_1 = ρ.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.fit.decimation import decimate
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.noise_level import LEAST_COLOUR, MOST_COLOUR, correlation, robust_rms, torque_step
from beltcomm.fit.records import Data
from beltcomm.fit.segment import Segment
from beltcomm.fit.torque_path import TorquePath
from beltcomm.recording import Recording
from beltcomm.simulate.intersample import CELLS

Array = NDArray[np.float64]

#: Least share of the difference that is the sensor's, and deviations by which a share must be known.
LEAST_SHARE, KNOWN = 0.02, 4.0
#: Share of the sensor from which on nearly all is its.
MOSTLY = 0.8
#: Samples before a pulse, and of its answer until it has died away.
BEFORE, SETTLED = 4, 400
#: Deviations of a colour from which on there is one.
COLOURED = 4.0


@dataclass(frozen=True)
class NoiseSplit:
    """Split of the torque's noise by its sources.

    Attributes
    ----------
    sensor_nm, process_nm : float
        N m rms.
    deviation_nm : float
        Of the first, one standard deviation.
    colour : float
        ρ of the sensor's noise.
    most_nm : float
        N m rms, of the sensor and of torque that acts unread, behind a reading that is filtered or late.
    """

    sensor_nm: float
    process_nm: float
    deviation_nm: float
    colour: float = 0.0
    most_nm: float = 0.0


def split_noise(data: Data, fitted: Fitted) -> NoiseSplit | None:
    """Noise of the sensor and torque that the drive makes beside its setpoint; None where no setpoint tells, or no more than is known."""
    if data.path.drive is None or data.path.commanded:
        return None
    by_name = {r.name: r for r in data.recordings}
    problem, sums = fitted.problem, np.zeros(3)
    weights = problem.weights(fitted.residual) ** 2
    rests, colours = [], np.zeros(4)
    for i, piece in enumerate(problem.pieces):
        here = slice(int(problem.ends[i]), int(problem.ends[i + 1]))
        rest = rest_of(by_name[piece.record], data)
        if rest is None or piece.whitener is None:
            continue
        rests.append(rest)
        every = round(piece.motion.sample_s / by_name[piece.record].sample_period_s)
        rest = decimate(rest, every)
        mean = np.zeros(len(rest))
        mean[1:-1] = 0.5 * (rest[:-2] + rest[1:-1])
        white, left, weight = piece.white(mean), fitted.residual[here], weights[here]
        product = -weight * left * white
        sums += [float(np.sum(product)), float(np.sum(weight * white**2)), float(np.sum(product**2))]
        colours += _covariances(piece, problem.balance(i, fitted.x, 0.0).residual, rest)
    if not rests or sums[1] <= 0.0:
        return None
    total = robust_rms(np.concatenate(rests), max(torque_step(r.torque) for r in by_name.values()))
    share, deviation = sums[0] / sums[1], math.sqrt(sums[2]) / sums[1]
    if deviation * KNOWN > 1.0 and share < KNOWN * deviation:
        # The motion does not tell: all of it may be the sensor's, and more it cannot be.
        return NoiseSplit(total, 0.0, 0.5 * total, _own_colour(rests)) if total < data.noise_nm else None
    share = min(max(share, LEAST_SHARE), 1.0)
    # Where nearly all is the sensor's, its colour is that of the difference, which no rounding hides.
    colour = _own_colour(rests) if share > MOSTLY else _colour(colours)
    sensor, process = total * math.sqrt(share), total * math.sqrt(1.0 - share)
    most = math.hypot(sensor, process * _unread(data.path, data.recordings[0].sample_period_s))
    return NoiseSplit(sensor, process, 0.5 * total * deviation / math.sqrt(share), colour, most)


def _unread(path: TorquePath, sample_s: float) -> float:
    """White torque that acts unread over what is read of it:  √(Σ (δ_k - l_k)²/Σ l_k²),  l the reading's answer to a sample."""
    if path.reading.faithful:
        return 0.0
    pulse = np.zeros(SETTLED)
    pulse[BEFORE] = 1.0
    read = path.reading.read(np.repeat(pulse[:, None], CELLS, axis=1), sample_s)
    return float(np.linalg.norm(pulse - read) / np.linalg.norm(read))


def _own_colour(rests: list[Array]) -> float:
    """ρ of white noise behind a filter of first order, from neighbours; 0 where it is not clearly above."""
    number, colour = sum(len(rest) for rest in rests), correlation(rests)
    return min(colour, MOST_COLOUR) if colour > max(LEAST_COLOUR, COLOURED / math.sqrt(number)) else 0.0


def _covariances(piece: Segment, residual: Array, rest: Array) -> Array:
    """Sums over the kept samples:  -e (rest now and before)/2,  -e times two before,  their product's squares,  number."""
    inside = np.flatnonzero(piece.keep)
    inside = inside[inside >= 2]
    e, r = residual[inside], rest
    near, far = -0.5 * e * (r[inside] + r[inside - 1]), -e * r[inside - 2]
    return np.array([float(np.sum(near)), float(np.sum(far)), float(np.sum(far**2)), float(len(inside))])


def _colour(sums: Array) -> float:
    """ρ from the covariances; 0 where it is not clearly above."""
    near, far, squares, number = sums
    if number < 1.0 or near <= 0.0:
        return 0.0
    deviation = math.sqrt(squares) / near
    # far = (a_1 + a_2)/2 and near = (a_0 + a_1)/2
    colour = far / near
    return min(float(colour), MOST_COLOUR) if colour > max(LEAST_COLOUR, COLOURED * deviation) else 0.0


def rest_of(recording: Recording, data: Data) -> Array | None:
    """Torque reading less the reading predicted from the setpoint, (n,), N m at the motor; None without setpoint, or with gaps."""
    drive = data.path.drive
    if recording.torque_setpoint is None or drive is None or len(recording.gaps):
        return None
    shown = data.path.reading.read(drive.cells(recording.torque_setpoint, recording.sample_period_s), recording.sample_period_s)
    rest = recording.torque - shown
    return np.asarray(rest - np.median(rest))
