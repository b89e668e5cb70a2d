"""What the recorder writes of a record: noise, process torque, steps of the torque reading, time stamps."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from truth.hidden.instruments import Instruments
from truth.hidden.layout import Array


def coloured(rng: np.random.Generator, n: int, rms: float, pole: float) -> Array:
    """Stationary noise, (n,):  x[n] = pole x[n-1] + w[n]; white for a pole of 0."""
    white = rng.normal(0.0, rms, n)
    if pole == 0.0 or n == 0:
        return white
    white[1:] *= math.sqrt(1.0 - pole**2)
    return np.asarray(lfilter([1.0], [1.0, -pole], white))


def unsteady(rng: np.random.Generator, n: int, instruments: Instruments, rated_torque_nm: float) -> Array:
    """Length of each sample (s), process torque (N m) and noise of the angle (rad), (n, 3)."""
    found = np.zeros((n, 3))
    found[:, 0] = instruments.period_s
    if instruments.sampling_jitter > 0.0:
        late = instruments.sampling_jitter * instruments.period_s * rng.uniform(-1.0, 1.0, n + 1)
        late[[0, -1]] = 0.0
        found[:, 0] += np.diff(late)
    if instruments.process_share > 0.0:
        found[:, 1] = coloured(rng, n, instruments.process_share * rated_torque_nm, instruments.process_colour)
    if instruments.angle_noise_rad > 0.0:
        found[:, 2] = rng.normal(0.0, instruments.angle_noise_rad, n)
    return found


def torque_reading(torque: Array, noise: Array, instruments: Instruments, rated_torque_nm: float) -> Array:
    """The reported torque with its noise and in its steps, N m, (n,).   noise : N m, (n,), of the sensor, held over a sample."""
    if instruments.noise_inside and instruments.reading_filter_s > 0.0:
        keep = math.exp(-instruments.period_s / instruments.reading_filter_s)
        noise = np.asarray(lfilter([1.0 - keep], [1.0, -keep], noise))
    found = torque if instruments.command_only else torque + noise
    if instruments.reading_step > 0.0:
        step = instruments.reading_step * rated_torque_nm
        found = step * np.round(found / step)
    return found


def time_stamps(rng: np.random.Generator, lengths: Array, instruments: Instruments) -> Array:
    """Stamps of a record, s, (n,).   lengths : s, (n,), of its samples."""
    if instruments.sampling_jitter > 0.0:
        return np.concatenate(([0.0], np.cumsum(lengths[:-1])))
    stamps = np.arange(len(lengths)) * instruments.period_s
    if instruments.stamp_jitter > 0.0:
        stamps = stamps + instruments.stamp_jitter * instruments.period_s * rng.uniform(-1.0, 1.0, len(stamps))
    return stamps
