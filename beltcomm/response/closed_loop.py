"""The plant from records of a closed loop whose controller is known: indirect identification (3.20) to (3.24).

With an excitation torque τ_e added to the controller's, τ = τ_e - C φ, the loop shows S = G/(1 + G C) from τ_e to φ; with an excitation ω_e
added to the speed setpoint it shows S_ω = G C_ω/(1 + G C).  The direct method needs none of this: it takes the torque that was applied.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.control import Cascade, pi_response, prefilter_response, velocity_filter_response
from beltcomm.errors import DataError
from beltcomm.response import FrequencyResponse

Loop = Literal["velocity", "position"]
#: |1 - S C| below which the difference between excitation and what the controller takes away says nothing.
LEAST_DIFFERENCE = 1e-3


def speed_controller(cascade: Cascade, freq_hz: Array, period_s: float) -> ComplexArray:
    """Prefilter and PI, velocity error to torque: C_ω, N m s/rad, (k,).

    Parameters
    ----------
    cascade : Cascade
    freq_hz : ndarray, Hz
        Above 0.
    period_s : float, s
        T of the controller.

    References
    ----------
    (4.1), (4.6).
    """
    omega = 2.0 * np.pi * freq_hz
    pi = pi_response(omega, cascade.kp_nm_s_rad, cascade.ki_nm_rad, period_s)
    return np.asarray(prefilter_response(omega, cascade.prefilter, period_s) * pi)


def feedback(cascade: Cascade, freq_hz: Array, period_s: float, loop: Loop) -> ComplexArray:
    """Controller's answer to the motor angle: C = G_R C_ω or (G_R + K_PP) C_ω.

    Parameters
    ----------
    cascade : Cascade
    freq_hz : ndarray, (k,)
        Above 0.
    period_s : float, s
        Period of the controller.
    loop : {'velocity', 'position'}
        Which of its loops is closed.

    Returns
    -------
    ndarray, (k,) complex
        N m/rad, motor shaft.

    References
    ----------
    Thesis (3.21).
    """
    measured = velocity_filter_response(2.0 * np.pi * freq_hz, cascade.velocity_filter_s, period_s)
    outer = cascade.kpp_1_s if loop == "position" else 0.0
    return np.asarray((measured + outer) * speed_controller(cascade, freq_hz, period_s))


def setpoint_path(cascade: Cascade, freq_hz: Array, period_s: float) -> ComplexArray:
    """From the speed setpoint to the torque: C_ω, behind the filter of the reference where the drive has it.

    Parameters
    ----------
    cascade : Cascade
    freq_hz : ndarray, (k,)
        Above 0.
    period_s : float, s
        Period of the controller.

    Returns
    -------
    ndarray, (k,) complex
        N m s/rad, motor shaft.
    """
    path = speed_controller(cascade, freq_hz, period_s)
    if not cascade.filter_reference:
        return path
    delayed = np.exp(-2j * np.pi * freq_hz * period_s)
    lag = cascade.velocity_filter_s
    return np.asarray(path * 0.5 * (1.0 + delayed) * period_s / (lag + period_s - lag * delayed))


def from_torque_excitation(seen: FrequencyResponse, controller: ComplexArray) -> FrequencyResponse:
    """The plant from the response to an excitation torque:  G = S/(1 - S C),   ΔG = ΔS/(1 - S C)²  (3.22).

    Parameters
    ----------
    seen : FrequencyResponse, rad/(N m)
        S, from excitation torque to motor angle.
    controller : ComplexArray
        C at the lines of ``seen``, N m/rad.

    Raises
    ------
    DataError
        When the loop hides the plant at every line.
    """
    difference = 1.0 - seen.h * controller
    shown = np.abs(difference) > LEAST_DIFFERENCE
    if not shown.any():
        raise DataError(
            f"the loop takes away all but {np.max(np.abs(difference)):.2g} of the excitation at every line, nothing of the plant is seen; "
            "excite with a weaker loop"
        )
    kept, left = seen.lines(shown), difference[shown]
    hidden = int(np.sum(~shown))
    remarks = (f"{hidden} of {len(shown)} lines left out because the loop leaves nothing of the excitation there",) if hidden else ()
    return replace(kept, h=kept.h / left, noise=kept.noise / np.abs(left) ** 2, remarks=(*seen.remarks, *remarks))


def from_setpoint_excitation(seen: FrequencyResponse, controller: ComplexArray, path: ComplexArray) -> FrequencyResponse:
    """The plant from the response to an excitation of the speed setpoint:  G = S_ω/(C_ω - S_ω C),   ΔG = ΔS_ω C_ω/(C_ω - S_ω C)²  (3.24).

    Parameters
    ----------
    seen : FrequencyResponse
        Response from rad/s to rad.
    controller : ComplexArray
        C, N m/rad.
    path : ComplexArray
        C_ω, N m s/rad.

    Raises
    ------
    DataError
        As above.
    """
    scaled = replace(seen, h=seen.h / path, noise=seen.noise / np.abs(path))
    return from_torque_excitation(scaled, controller)
