"""The sensor's own share of what the reading differs from its setpoint by: what of it does not move the machine.

    reading - L y = p + s,     residual e[n] = -(s[n-1] + s[n])/2 + ...,     D_k = -E[e[n] (p + s)[n-k]] = (a_(k-1) + a_k)/2

p : torque that acts, s : noise of the sensor with covariance a_k.  The residual of a wrong model is no noise, and hardly goes with p + s,
so this is a second opinion on how large an error the noise alone leaves.

Where p + s has a colour, or not all of p is read, one share does not hold at all frequencies: then ``torque_noises`` tells both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.noise.decimation import decimate
from beltcomm.fit.noise.level import LEAST_COLOUR, MOST_COLOUR, correlation, robust_rms, torque_step
from beltcomm.fit.noise.process_torque import ProcessTorque, correlation_time
from beltcomm.fit.path_fit.torque_noises import NoisesFit, NoisesProblem, RestPart
from beltcomm.fit.records import Data
from beltcomm.fit.torque.reading_fit import CLEAR
from beltcomm.model import Model
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording

#: Least share of the difference that is the sensor's, and deviations by which a share must be known.
LEAST_SHARE, KNOWN = 0.02, 4.0
#: Deviations of a colour from which on there is one, and neighbours up to which it is looked for.
COLOURED, NEIGHBOURS = 4.0, 8


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
    process : ProcessTorque or None
        What acts, where it has a colour, or where a filtered or late reading misses a part of it.
    """

    sensor_nm: float
    process_nm: float
    deviation_nm: float
    colour: float = 0.0
    process: ProcessTorque | None = None

    @property
    def acts(self) -> float:
        """Share of the difference's variance that acts."""
        return self.process_nm**2 / (self.process_nm**2 + self.sensor_nm**2)


def split_noise(data: Data, fitted: Fitted) -> NoiseSplit | None:
    """Noise of the sensor and torque that the drive makes beside its setpoint; None where no setpoint tells, or no more than is known.

    Parameters
    ----------
    data : Data
    fitted : Fitted
    """
    if data.path.drive is None or data.path.commanded:
        return None
    by_name = {r.name: r for r in data.recordings}
    problem, parts = fitted.problem, list[RestPart]()
    weights = problem.weights(fitted.residual)
    for i, piece in enumerate(problem.pieces):
        recording, here = by_name[piece.record], slice(int(problem.ends[i]), int(problem.ends[i + 1]))
        rest = _rest_of(recording, data)
        if rest is not None and piece.whitener is not None:
            every = round(piece.motion.sample_s / recording.sample_period_s)
            parts.append(RestPart(piece, rest, fitted.residual[here], weights[here], every))
    share, deviation = _one_share(parts)
    if deviation == 0.0:
        return None
    rests = [part.rest for part in parts]
    total = robust_rms(np.concatenate(rests), max(torque_step(r.torque) for r in by_name.values()))
    if deviation * KNOWN > 1.0 and share < KNOWN * deviation:
        # The motion does not tell: all of it may be the sensor's, and more it cannot be.
        return NoiseSplit(total, 0.0, 0.5 * total, _own_colour(rests)) if total < data.noise_nm else None
    told = None if data.path.reading.faithful and _is_white(rests) else _two_noises(data, fitted.model, parts, total)
    if told is not None:
        return told
    share = min(max(share, LEAST_SHARE), 1.0)
    return NoiseSplit(total * math.sqrt(share), total * math.sqrt(1.0 - share), 0.5 * total * deviation / math.sqrt(share))


def _one_share(parts: Sequence[RestPart]) -> tuple[float, float]:
    """The sensor's share of white p + s that are read as they are, and its deviation, 0 where nothing was told."""
    sums = np.zeros(3)
    for part in parts:
        rest = decimate(part.rest, part.every)
        mean = np.zeros(len(rest))
        mean[1:-1] = 0.5 * (rest[:-2] + rest[1:-1])
        white, weight = part.piece.white(mean), part.weights**2
        product = -weight * part.left * white
        sums += [float(np.sum(product)), float(np.sum(weight * white**2)), float(np.sum(product**2))]
    return (sums[0] / sums[1], math.sqrt(sums[2]) / sums[1]) if sums[1] > 0.0 else (0.0, 0.0)


def _two_noises(data: Data, model: Model, parts: Sequence[RestPart], total: float) -> NoiseSplit | None:
    """Both noises with their colours; None where the records are too short, or do not tell whose a colour is."""
    sample_s = data.recordings[0].sample_period_s
    problem = NoisesProblem(parts, data.path.read_pulse(sample_s), total, partial(_between, model, sample_s))
    if not problem.enough:
        return None
    best, *others = problem.likeliest()
    found, spread = best.noises, best.deviations
    if _may_be_other(best, others):
        return None
    sensor_nm = max(found.sensor_nm, math.sqrt(LEAST_SHARE) * total)
    time_s, deviation_s = correlation_time(found.process_pole, spread.process_pole, sample_s)
    process = ProcessTorque(found.process_nm, time_s, NORMAL_95 * spread.process_nm, NORMAL_95 * deviation_s)
    return NoiseSplit(sensor_nm, found.process_nm, spread.sensor_nm, found.sensor_pole, process)


def _between(model: Model, sample_s: float, z: ComplexArray) -> ComplexArray:
    """Response of what a model has between reading and motion, at z⁻¹ = e^(-iωT)."""
    omega = -np.angle(z) / sample_s
    found = np.ones_like(z)
    for effect in model.effect_list():
        if effect.slot == "torque_delay" and effect.slope is not None:
            found = found * np.asarray(effect.slope(omega, *(model[f"{effect.name}.{p.name}"] for p in effect.parameters)))
    return found


def _may_be_other(best: NoisesFit, others: Sequence[NoisesFit]) -> bool:
    """True if a colour of the one noise may as well be the other's."""
    colours = [pole > 0.0 for pole in best.noises[2:]]
    turned = [other for other in others if [pole > 0.0 for pole in other.noises[2:]] == colours[::-1]]
    return colours[0] != colours[1] and any(other.cost < best.cost + CLEAR for other in turned)


def _is_white(rests: Sequence[Array]) -> bool:
    """True if no neighbours of the rows, (n,) each, go with each other."""
    number = sum(len(rest) for rest in rests)
    most = max(abs(correlation(rests, samples)) for samples in range(1, NEIGHBOURS + 1))
    return most < COLOURED / math.sqrt(number)


def _own_colour(rests: list[Array]) -> float:
    """ρ of white noise behind a filter of first order, from neighbours; 0 where it is not clearly above."""
    number, colour = sum(len(rest) for rest in rests), correlation(rests)
    return min(colour, MOST_COLOUR) if colour > max(LEAST_COLOUR, COLOURED / math.sqrt(number)) else 0.0


def _rest_of(recording: Recording, data: Data) -> Array | None:
    """Torque reading less the reading predicted from the setpoint, (n,), N m at the motor; None without setpoint, or with gaps."""
    drive = data.path.drive
    if recording.torque_setpoint is None or drive is None or len(recording.gaps):
        return None
    shown = data.path.reading.read(drive.cells(recording.torque_setpoint, recording.sample_period_s), recording.sample_period_s)
    rest = recording.torque - shown
    return np.asarray(rest - np.median(rest))
