"""Dead time of the torque loop, from the phase between torque setpoint and acting torque.

The closed current loop answers in the mechanical range like a dead time (thesis figure 3.5), so its phase is a straight line.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from beltcomm.arrays import Array, ComplexArray
from beltcomm.errors import DataError
from beltcomm.response import FrequencyResponse

#: Lines without which a slope and its interval mean little.
FEWEST_LINES = 5
#: Phase noise below which a line gets no more weight, rad: no setpoint is repeated to better than this part of a turn.
LEAST_PHASE_NOISE_RAD = 1e-3

#: Dead times from minus to plus this are considered, s.
LONGEST_S = 20e-3


@dataclass(frozen=True, eq=False)
class DeadTime:
    """A dead time and how well a dead time explains the phase.

    Attributes
    ----------
    value_s : float
        t_T, s.
    interval_s : float
        Half width at 95 %, from the scatter about the straight line.
    samples : float
        n_T = t_T/T_s.
    freq_hz : ndarray (n,), Hz
        Lines that it was found from.
    remarks : tuple of str
        Sentences on what else the phase shows.
    """

    value_s: float
    interval_s: float
    samples: float
    freq_hz: Array
    remarks: tuple[str, ...] = ()


def dead_time_between(
    setpoint: FrequencyResponse,
    torque: FrequencyResponse,
    *,
    lowest_hz: float = 0.0,
    highest_hz: float = np.inf,
) -> DeadTime:
    """Dead time by which the response to the setpoint lags the response to the acting torque, at their common lines.

    J(n_T) = Σ w_i (arg Ĝ_τi,φm(f_i) - arg Ĝ_τm,φm(f_i) + 2π f_i n_T T_s)²  →  min

    Parameters
    ----------
    setpoint, torque : FrequencyResponse
        Responses to torque setpoint and to acting torque, of one record.
    lowest_hz, highest_hz : float, Hz
        The range of interest, in general up to the resonance.

    Raises
    ------
    DataError
        When the responses share too few lines.

    References
    ----------
    Thesis (3.25) to (3.30).
    """
    common, at_setpoint, at_torque = np.intersect1d(np.rint(setpoint.freq_hz * 1e6), np.rint(torque.freq_hz * 1e6), return_indices=True)
    if len(common) == 0:
        raise DataError("the two responses have no line in common; estimate both from the same record and period")
    return _dead_time_against(
        setpoint.lines(at_setpoint),
        torque.h[at_torque],
        model_noise=torque.noise[at_torque],
        lowest_hz=lowest_hz,
        highest_hz=highest_hz,
    )


def _dead_time_against(
    response: FrequencyResponse,
    model_h: ComplexArray,
    *,
    model_noise: Array | None = None,
    lowest_hz: float = 0.0,
    highest_hz: float = np.inf,
) -> DeadTime:
    """Dead time by which a response lags another one, or a model, given at the same lines, (k,), rad/(N m), thesis (3.25) to (3.30).

    Arguments as :func:`dead_time_between`; ``model_noise`` is a standard deviation, None for a model.  A model must be the *sampled*
    response to a held torque: against a continuous one half a sample more is found, the delay of the hold.

    Raises DataError when lengths differ or too few lines lie within.
    """
    if model_h.shape != response.h.shape:
        raise DataError(f"the model has {len(model_h)} values, the response {len(response.h)} lines; evaluate it at these lines")
    noise = np.zeros(len(model_h)) if model_noise is None else model_noise
    within = (response.freq_hz >= lowest_hz) & (response.freq_hz <= highest_hz) & (np.abs(model_h) > 0) & (np.abs(response.h) > 0)
    if int(within.sum()) < FEWEST_LINES:
        raise DataError(
            f"{int(within.sum())} common lines lie between {lowest_hz:.4g} and {highest_hz:.4g} Hz, {FEWEST_LINES} are needed for "
            "a dead time; widen the range or raise the amplitude"
        )
    freq, h, other = response.freq_hz[within], response.h[within], model_h[within]
    # A phase has half the relative variance of its complex number; this holds for both.
    variance = 0.5 * ((response.noise[within] / np.abs(h)) ** 2 + (noise[within] / np.abs(other)) ** 2)
    weight = 1.0 / (variance + LEAST_PHASE_NOISE_RAD**2)
    omega = 2 * np.pi * freq
    turn = h / other / np.abs(h / other)

    value_s = _coarse(turn, omega, weight)
    for _ in range(3):  # once more after each unwrapping about the better line; it does not change any more after that
        residual = np.angle(turn * np.exp(1j * omega * value_s))
        value_s -= float(np.sum(weight * omega * residual) / np.sum(weight * omega**2))
    residual = np.angle(turn * np.exp(1j * omega * value_s))
    freedom = len(freq) - 1
    spread = np.sum(weight * residual**2) / freedom
    interval_s = float(stdtrit(freedom, 0.975) * np.sqrt(spread / np.sum(weight * omega**2)))
    return DeadTime(
        value_s=value_s,
        interval_s=interval_s,
        samples=value_s / response.sample_period_s,
        freq_hz=freq,
        remarks=_remarks(value_s, interval_s, residual, omega, weight, freedom),
    )


def _coarse(turn: ComplexArray, omega: Array, weight: Array) -> float:
    """The dead time on a grid that turns all phases best into line; phases need not be unwrapped for it."""
    step_s = 0.1 * 2 * np.pi / omega[-1]
    grid_s = np.arange(-LONGEST_S, LONGEST_S + step_s, step_s)
    in_line = np.real(np.exp(1j * np.outer(grid_s, omega)) @ (weight * turn))
    return float(grid_s[int(np.argmax(in_line))])


def _remarks(value_s: float, interval_s: float, residual: Array, omega: Array, weight: Array, freedom: int) -> tuple[str, ...]:
    remarks = []
    # A second slope, ω³, is what a lag has and a dead time has not: tested like any regression coefficient.
    basis = np.stack([omega, omega**3 / omega[-1] ** 2], axis=1) * np.sqrt(weight)[:, None]
    coefficient, rest, *_ = np.linalg.lstsq(basis, np.sqrt(weight) * residual, rcond=None)
    if freedom > 2 and len(rest):
        deviation = np.sqrt(rest[0] / (freedom - 1) * np.linalg.inv(basis.T @ basis)[1, 1])
        bend = abs(float(coefficient[1])) * omega[-1]
        if abs(coefficient[1]) > float(stdtrit(freedom - 1, 0.995)) * deviation and bend > 0.05:
            remarks.append(
                f"the phase is bent by {np.degrees(bend):.2g}° up to {omega[-1] / (2 * np.pi):.4g} Hz: a lag or a filter, "
                "not a dead time alone"
            )
    if abs(value_s) <= interval_s:
        remarks.append(f"no dead time is seen: {1e3 * value_s:.3g} ± {1e3 * interval_s:.2g} ms")
    elif value_s < 0:
        remarks.append(
            f"the dead time is negative ({1e3 * value_s:.3g} ms): torque and position of the record are not aligned, or the two "
            "responses are exchanged"
        )
    return tuple(remarks)
