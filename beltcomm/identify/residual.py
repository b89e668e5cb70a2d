"""Recordings as residuals of one equation: what torque is left over when the measured motion goes backwards through a model.

The residual e[n] of ``beltcomm.simulate.inverse`` is a moving average of the torque noise and of the encoder's quantisation, with
known covariances (sample n, n+1, n+2):

    c0 = s²/2 + 6 g²,   c1 = s²/4 - 4 g²,   c2 = g²,      g = J q / (sqrt(12) T²)

s : N m, noise of the torque signal; q : rad, encoder step; J : kg m², motor side; T : s.  A banded Cholesky factor of the kept
samples whitens it exactly, whatever samples are left out.  Because g holds J, the fit is the errors-in-variables likelihood: the
quantised angle in the regressor does not bias the inertia.

Left out are samples next to a reversal or near standstill: a sticking motor carries any torque up to its friction, so the
equation says nothing there.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltcomm.compiled import compiled
from beltcomm.errors import DataError
from beltcomm.identify.whitening import Whitener
from beltcomm.model import Model
from beltcomm.recording import Recording
from beltcomm.simulate.inverse import FineMotion, fine_load, reconstruct, torque_residual

Array = NDArray[np.float64]

#: rad/s at the motor: below this speed anywhere within a sample the motor may be sticking.  Three encoder steps of a 65536-count
#: encoder per millisecond; on simulated axes 0.1 still lets sticking samples through and 0.2 to 0.8 give equal residuals.
STICK_SPEED_RAD_S = 0.3
#: m/s, the same for an axis known at its load side.
STICK_SPEED_M_S = 4e-3
#: m the carriage must have travelled before a stretch counts: until then its belt stretch at the start is unknown.
RUN_IN_TRAVEL_M = 1e-4
#: s after that travel, for the free oscillation of the carriage to die out.
RUN_IN_S = 0.2
#: Fine steps per sample: the carriage's antiresonance is reproduced to (2 pi f h)²/24, 5e-5 at 90 Hz and 1 kHz.
SUBSTEPS = 16
#: The same while start values are refined and nothing is reported yet.
COARSE_SUBSTEPS = 4


@dataclass(frozen=True)
class Stretch:
    """A gapless piece of one recording, ready for evaluation.

    position, torque : ndarray (n,), rad and N m at the motor shaft.   motion : the same on a fine grid.
    keep : ndarray (n,) bool, samples that count.     noise_nm : torque noise, N m rms.    step_rad : encoder step, rad.
    whitener : exact noise of a model near the right one; without it the rounding is taken at the motor alone.
    """

    record: str
    held_out: bool
    position: Array
    torque: Array
    motion: FineMotion
    keep: NDArray[np.bool_]
    noise_nm: float
    step_rad: float
    whitener: Whitener | None = None


def stretches(
    recording: Recording, model: Model, step_rad: float, noise_nm: float, *, fitted: bool = False, substeps: int = SUBSTEPS
) -> list[Stretch]:
    """The gapless pieces of a recording that hold at least 50 samples; ``model`` gives inertia and transmission.

    fitted : the model's load is good enough to say how the motor moves between the samples.   substeps : fine steps then.
    """
    sample = recording.sample_period_s
    cuts = [0, *(int(i) + 1 for i in recording.gaps()), len(recording.t_s)]
    start = recording.sidecar.start_position_m or 0.0
    pieces = []
    for first, last in itertools.pairwise(cuts):
        if last - first < 50:
            continue
        part = slice(first, last)
        ratio = model["transmission.ratio"]
        position, torque = recording.position[part], recording.torque[part]
        place = start / ratio + recording.position[first] - recording.position[0]
        time = (recording.sidecar.session_time_s or 0.0) + recording.t_s[first] - recording.t_s[0]
        inertia = model["motor.inertia"]
        motion = reconstruct(
            position, torque, sample, inertia, start_rad=place, substeps=substeps if fitted else COARSE_SUBSTEPS, time_s=time
        )
        if fitted:
            load, _ = fine_load(model, motion)
            motion = reconstruct(position, torque, sample, inertia, start_rad=place, substeps=substeps, time_s=time, load=load)
        keep = ~resting(motion, STICK_SPEED_M_S if recording.side == "load" else STICK_SPEED_RAD_S)
        if "cart" in model.base_bodies:
            keep &= ran_in(motion, ratio)
        pieces.append(
            Stretch(
                recording.name,
                recording.sidecar.held_out,
                position,
                torque,
                motion,
                keep,
                noise_nm,
                step_rad,
            )
        )
    return pieces


def resting(motion: FineMotion, stick_speed: float) -> NDArray[np.bool_]:
    """Samples whose triangular weight (one period before and after) touches a reversal or a speed below the stick speed."""
    n, m = motion.samples, motion.substeps
    inside = np.lib.stride_tricks.sliding_window_view(motion.omega, m + 1)[::m]
    low, high = inside.min(axis=1), inside.max(axis=1)
    slow = (np.minimum(np.abs(low), np.abs(high)) < stick_speed) | ((low < 0.0) & (high > 0.0))
    touched = np.ones(n, dtype=bool)
    touched[1:-1] = slow[:-1] | slow[1:]
    return touched


def ran_in(motion: FineMotion, ratio: float) -> NDArray[np.bool_]:
    """Samples after the carriage has first moved far enough to have forgotten where it stuck."""
    travel = np.abs(motion.theta[:: motion.substeps] - motion.theta[0]) * ratio
    moved = np.flatnonzero(travel > RUN_IN_TRAVEL_M)
    done = np.zeros(motion.samples, dtype=bool)
    if len(moved):
        done[moved[0] + int(RUN_IN_S / motion.sample_s) :] = True
    return done


def torque_noise(recordings: Sequence[Recording], quiet_nm: float = 1e-3) -> float:
    """Noise of the torque signal, N m rms: what a short filter of the setpoint does not explain; the median over the records.

    Raises DataError when no record has a torque setpoint and the caller must estimate the noise from the fit instead.
    """
    levels = []
    for recording in recordings:
        if recording.torque_setpoint is None:
            continue
        lags = 4
        setpoint = recording.torque_setpoint
        columns = [np.roll(setpoint, k)[lags:] for k in range(lags + 1)]
        regressor = np.stack([*columns, np.ones(len(setpoint) - lags)], axis=1)
        rest = recording.torque[lags:] - regressor @ np.linalg.lstsq(regressor, recording.torque[lags:], rcond=None)[0]
        levels.append(1.4826 * float(np.median(np.abs(rest - np.median(rest)))))
    if not levels:
        raise DataError("no recording has torque_setpoint_nm, so the torque noise cannot be read from the data")
    return max(float(np.median(levels)), quiet_nm)


def evaluate(stretch: Stretch, model: Model, vector: Array, offset_m: float = 0.0) -> Array:
    """Residual e[n], N m at the motor shaft, (n,): all samples, also those not kept.   offset_m : see ``fine_load``."""
    return torque_residual(model, stretch.motion, stretch.torque, vector, offset_m)


def whitened(stretch: Stretch, model: Model, vector: Array, offset_m: float = 0.0) -> Array:
    """Residual of the kept samples in units of its own noise: independent, variance 1 where the model is right."""
    return in_noise(stretch, model, vector, evaluate(stretch, model, vector, offset_m))


def in_noise(stretch: Stretch, model: Model, vector: Array, torque: Array) -> Array:
    """A torque, N m, (n,), of the kept samples in units of the residual's noise; linear in the torque."""
    if stretch.whitener is not None:
        return stretch.whitener(torque, stretch.keep)
    inertia = vector[model.index("motor.inertia")]
    step = inertia * stretch.step_rad / np.sqrt(12.0) / stretch.motion.sample_s**2
    noise = stretch.noise_nm
    return banded_whitening(torque, stretch.keep, 0.5 * noise**2 + 6.0 * step**2, 0.25 * noise**2 - 4.0 * step**2, step**2)


@compiled
def banded_whitening(residual: Array, keep: NDArray[np.bool_], c0: float, c1: float, c2: float) -> Array:
    """Solve L r = e for the kept samples, L L' their covariance with bands c0, c1, c2; (n,) -> (kept,)."""
    out = np.empty(keep.sum())
    place1 = place2 = -10  # sample numbers of the last two kept
    diagonal1 = diagonal2 = 1.0
    off1 = 0.0  # L[previous, the one before]
    white1 = white2 = 0.0
    k = 0
    for n in range(residual.shape[0]):
        if not keep[n]:
            continue
        cov1 = c1 if n - place1 == 1 else (c2 if n - place1 == 2 else 0.0)
        cov2 = c2 if n - place2 == 2 else 0.0
        far = cov2 / diagonal2
        near = (cov1 - far * off1) / diagonal1
        diagonal = np.sqrt(c0 - near * near - far * far)
        white = (residual[n] - near * white1 - far * white2) / diagonal
        out[k] = white
        k += 1
        place2, diagonal2, white2 = place1, diagonal1, white1
        place1, diagonal1, white1, off1 = n, diagonal, white, near
    return out
