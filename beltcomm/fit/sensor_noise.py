"""The sensor's own share of what the reading differs from its setpoint by: what of it does not move the machine.

    reading - L y = p + s,     residual e = -T s + ...,     E[W e · W T(p + s)] = -σs² |W T|²

p : torque that acts, s : noise of the sensor, T : mean of neighbouring samples, W : whitening.  The residual of a wrong model is no
noise, and hardly goes with p + s, so this is a second opinion on how large an error the noise alone leaves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.fit.estimate import Fitted
from beltcomm.fit.noise_level import robust_rms, torque_step
from beltcomm.fit.records import Data
from beltcomm.fit.segment import Stretch
from beltcomm.recording import Recording

Array = NDArray[np.float64]

#: Least share of the difference that is the sensor's, and deviations by which a share must be known.
LEAST_SHARE, KNOWN = 0.02, 4.0


@dataclass(frozen=True)
class NoiseSplit:
    """sensor_nm, process_nm : N m rms.   deviation_nm : of the first, one standard deviation."""

    sensor_nm: float
    process_nm: float
    deviation_nm: float


def split_noise(data: Data, fitted: Fitted) -> NoiseSplit | None:
    """Noise of the sensor and torque that the drive makes beside its setpoint; None where no setpoint tells."""
    if data.path.drive is None or data.path.commanded:
        return None
    by_name = {r.name: r for r in data.recordings}
    cross = square = fourth = 0.0
    rests = []
    problem = fitted.problem
    weights = problem.weights(fitted.residual) ** 2
    for i, piece in enumerate(problem.pieces):
        here = slice(int(problem.ends[i]), int(problem.ends[i + 1]))
        rest = rest_of(by_name[piece.record], piece, data)
        if rest is None or piece.whitener is None:
            continue
        rests.append(rest)
        mean = np.zeros(len(rest))
        mean[1:-1] = 0.5 * (rest[:-2] + rest[1:-1])
        white, left, weight = piece.white(mean), fitted.residual[here], weights[here]
        cross -= float(np.sum(weight * left * white))
        square += float(np.sum(weight * white**2))
        fourth += float(np.sum((weight * left * white) ** 2))
    if not rests or square <= 0.0:
        return None
    everything = np.concatenate(rests)
    total = robust_rms(everything, max(torque_step(r.torque) for r in by_name.values()))
    share, deviation = cross / square, math.sqrt(fourth) / square
    if deviation * KNOWN > 1.0 and share < KNOWN * deviation:
        return None
    share = min(max(share, LEAST_SHARE), 1.0)
    return NoiseSplit(total * math.sqrt(share), total * math.sqrt(1.0 - share), 0.5 * total * deviation / math.sqrt(share))


def rest_of(recording: Recording, piece: Stretch, data: Data) -> Array | None:
    """What the reading of a stretch differs by from what the setpoint makes of it, (n,), N m; None without setpoint."""
    drive = data.path.drive
    if recording.torque_setpoint is None or drive is None or len(recording.gaps()):
        return None
    shown = data.path.reading.read(drive.cells(recording.torque_setpoint, recording.sample_period_s), recording.sample_period_s)
    rest = recording.torque - shown
    return np.asarray(rest - np.median(rest))
