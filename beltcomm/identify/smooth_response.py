"""The model's frequency response as a smooth curve with its 95 % band, as an excited record would show it.

Friction around standstill is replaced by its describing function for a random motion.  For Coulomb friction F and a Gaussian speed of rms σ
the damping is F √(2/π)/σ, which a sine of amplitude A ω = 4/π √(π/2) σ has, too; that sine stands for it in every law.
Source: Gelb, Vander Velde, Multiple-Input Describing Functions, 1968, chapter 7.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model
from beltcomm.model.linear import Oscillation, operating_point, sampled_response
from beltcomm.model.value import NORMAL_95
from beltcomm.recording import Recording

#: Amplitude of the speed of the sine over the rms of the random one.
SINE = 4.0 / math.pi * math.sqrt(math.pi / 2.0)
#: Draws of the parameters, and points of the curve.
DRAWS, POINTS = 60, 160


@dataclass(frozen=True)
class SmoothResponse:
    """Magnitude of angle over torque, rad/(N m), over frequency.

    Attributes
    ----------
    low, high : ndarray
        95 % of the draws of the parameters, (k,).
    """

    freq_hz: Array
    magnitude: Array
    low: Array
    high: Array


def smooth_response(model: Model, recording: Recording, place_m: float, low_hz: float, high_hz: float) -> SmoothResponse | None:
    """The model's curve at the place and the speeds of a record.

    The parameters are drawn from their intervals, as if these were independent, which makes the band too wide rather than too narrow.

    Parameters
    ----------
    model : Model
        With intervals.
    recording : Recording
        For its speeds and sample period.
    place_m : float, m
        Carriage on the axis.
    low_hz, high_hz : float, Hz
        Ends of the curve; below half the sampling rate.

    Returns
    -------
    SmoothResponse or None
        None where the model has no such thing.
    """
    speed = float(np.std(np.diff(recording.position)) / recording.sample_period_s)
    freq = np.geomspace(low_hz, min(high_hz, 0.49 / recording.sample_period_s), POINTS)
    if not speed > 0.0:
        return None
    omega = 2.0 * math.pi * math.sqrt(float(freq[0] * freq[-1]))
    sine = Oscillation(SINE * speed / omega, omega)

    def magnitude(one: Model) -> Array:
        return np.abs(sampled_response(one, operating_point(one, place_m), freq, recording.sample_period_s, standstill=sine))

    try:
        best = magnitude(model)
    except (UsageError, Refused):
        return None
    random, drawn = np.random.default_rng(0), []
    known = {name: value for name, value in model.parameters.items() if value.interval}
    for _ in range(DRAWS if known else 0):
        values = {
            name: float(np.clip(v.value + v.interval / NORMAL_95 * random.standard_normal(), v.low, v.high))
            for name, v in known.items()
            if v.interval
        }
        try:
            drawn.append(magnitude(model.with_values(values)))
        except (UsageError, Refused):  # a machine that cannot be
            continue
    low, high = np.percentile(drawn, [2.5, 97.5], axis=0) if drawn else (best, best)
    return SmoothResponse(freq, best, np.minimum(low, best), np.maximum(high, best))
