"""Noise of an angle beside its rounding: how rough it is where nothing moves it, or by what no torque moves."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from beltcomm.arrays import Array, robust_deviation
from beltcomm.fit.noise.decimation import smallest_step
from beltcomm.recording import Recording

#: Samples of a window in which an angle's roughness is taken, and factor from which on it is more than its rounding makes.
CALM_WINDOW, NOISY = 64, 1.3
#: Samples by which the motion may follow a torque.
FOLLOWED = 5
#: Mean change of a torque from sample to sample over its noise up to which nothing but noise changes it: that alone is 2/√π.
CALM = 2.5


def apparent_step(recordings: Sequence[Recording], step_rad: float, noise_nm: float) -> float:
    """Step whose rounding would be as rough as the angle is where the torque is calmest, rad: more than the encoder's where it is noisy.

    Rounding of a step q has the variance q²/12; noise of the angle adds its own.  Where the torque changes by more than its noise does,
    the motion is rough itself.

    Parameters
    ----------
    recordings : sequence of Recording
    step_rad : float, rad
    noise_nm : float
        N m rms.
    """
    windows = [window for recording in recordings for window in _rough_windows(recording, np.diff(recording.position, 4) ** 2 / 70.0)]
    calm = [window for window in windows if window[0] < CALM * noise_nm]
    if not calm:  # a command that follows the angle's own noise never is
        calm = [window for recording in recordings for window in _rough_windows(recording, _unexplained_roughness(recording))]
    if not calm:
        return step_rad
    calm.sort()
    quiet = [variance for _, variance in calm[: max(len(calm) // 10, 1)]]
    shown = math.sqrt(12.0 * max(float(np.median(quiet)), 0.0))
    return shown if shown > NOISY * step_rad else step_rad


def _rough_windows(recording: Recording, variance: Array) -> list[tuple[float, float]]:
    """Mean change of the torque from sample to sample, N m, and mean of a variance, rad², of each window of a record."""
    change = np.abs(np.diff(recording.torque))
    firsts = range(0, len(variance) - CALM_WINDOW + 1, CALM_WINDOW)
    return [(float(np.mean(change[i : i + CALM_WINDOW + 4])), float(np.mean(variance[i : i + CALM_WINDOW]))) for i in firsts]


def _unexplained_roughness(recording: Recording) -> Array:
    """Variance of the angle's own noise, rad², (m,), sample by sample and scattering about it, by what no recorded torque moves; empty for
    a short record.

    What the torque leaves of fourth differences holds 70 times that of the noise and g² times that of a white torque that acts unasked;
    its own fourth differences 12870 times and 66 g² times: as a mean over the period that has next to nothing at half the rate.
    """
    rough, bent = np.diff(recording.position, 4), np.diff(recording.torque, 2)
    number = len(rough) - FOLLOWED
    if number <= CALM_WINDOW:
        return np.zeros(0)
    columns = np.stack([bent[k : k + number] for k in range(FOLLOWED + 2)], axis=1)
    left = rough[FOLLOWED:] - columns @ np.linalg.lstsq(columns, rough[FOLLOWED:], rcond=None)[0]
    return np.asarray((np.diff(left, 4) ** 2 - 66.0 * left[2:-2] ** 2) / (12870.0 - 66.0 * 70.0))


def white_step(position: Array) -> float:
    """Step whose rounding would be as rough as an angle is, rad: less than the encoder's where the drive interpolates between counts.

    Parameters
    ----------
    position : ndarray, (n,), rad
        At one sample period.

    Returns
    -------
    float, rad
        Not below the step in which the angle is read.
    """
    rough = np.diff(position, 4)
    return max(robust_deviation(rough) * math.sqrt(12.0 / 70.0), smallest_step(position))
