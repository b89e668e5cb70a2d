"""Controller value objects and their discrete form, shared by design, verification and the virtual drive.

All quantities at the motor shaft.  The loop is the thesis's cascade (figure 4.1): position gain, velocity PI behind a
prefilter, velocity from position by a first-order high-pass (6.1), feedforward (4.16), conditional integration (6.26).

Discrete form, sampling period T, z = exp(jωT):

- measured velocity: (1 − z⁻¹)/(T_R + T − T_R z⁻¹), the backward difference behind a first-order lag with the pole
  T_R/(T_R + T); at low frequencies it lags by T_R + T/2;
- reference velocity, when it is filtered: (1 + z⁻¹)/2 and the same lag, so that it lags by the same T_R + T/2;
- prefilter on the velocity error, and the additional low-pass behind it: bilinear transform (Tustin), prewarped at centre or cutoff;
- PI: K_P + K_I T/(z − 1), the forward-Euler integrator (6.25).

The compiled step (``cascade_step``, ``begin_ramp``, ``measured_speed``, ``velocity_step``, ``new_state``, ``reset_state``)
stands in :mod:`beltcomm.control.cascade_kernel` and is loaded on first use, because numba takes longer to import than ``--help`` may last.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from beltcomm.arrays import Array, ComplexArray
from beltcomm.errors import UsageError

if TYPE_CHECKING:
    from beltcomm.control.cascade_kernel import begin_ramp, cascade_step, measured_speed, new_state, reset_state, velocity_step


__all__ = [
    "Cascade",
    "CascadeStructure",
    "Feedforward",
    "Prefilter",
    "begin_ramp",
    "cascade_step",
    "discrete_coefficients",
    "feedforward_torque",
    "measured_speed",
    "new_state",
    "pi_response",
    "prefilter_coefficients",
    "prefilter_response",
    "reset_state",
    "roll_off_coefficients",
    "velocity_filter_response",
    "velocity_step",
]

_COMPILED = frozenset({"cascade_step", "begin_ramp", "measured_speed", "velocity_step", "new_state", "reset_state"})


PrefilterKind = Literal["none", "notch", "butterworth"]


@dataclass(frozen=True)
class Prefilter:
    """Filter of the velocity control error, in front of the PI controller.

    kind "none"; "notch" (4.1): centre ``omega_rad_s``, width ``d_n``; "butterworth" (4.3): cutoff ``omega_rad_s``.
    ``roll_off_rad_s``: cutoff of a low-pass (4.3) behind it against further resonances (4.2.1), 0 for none.
    """

    kind: PrefilterKind = "none"
    omega_rad_s: float = 0.0
    d_n: float = 0.0
    roll_off_rad_s: float = 0.0


@dataclass(frozen=True)
class Feedforward:
    """Feedforward torque (4.16):  inertia dω_d/dt + viscous ω_d + coulomb sign(ω_d) + offset.

    Attributes
    ----------
    inertia_kg_m2 : float, kg m², motor side
        Motor inertia and carriage mass together.
    viscous_nm_s_rad : float, N m s/rad, motor side
    coulomb_nm : float, N m, motor side
    offset_nm : float, N m, motor side
        Gravity.
    velocity : float
        K_v of (4.17): 1 passes the reference velocity to the velocity loop, 0 leaves all to the position gain.
    advance_s : float, s
        The reference is extrapolated so far ahead for the feedforward torque: dead time and half a loop period, after which that torque
        acts.
    """

    inertia_kg_m2: float = 0.0
    viscous_nm_s_rad: float = 0.0
    coulomb_nm: float = 0.0
    offset_nm: float = 0.0
    velocity: float = 1.0
    advance_s: float = 0.0


@dataclass(frozen=True)
class Cascade:
    """One set of controller gains.

    Attributes
    ----------
    kp_nm_s_rad : float
        K_P.
    ki_nm_rad : float
        K_I.
    kpp_1_s : float
        K_PP.
    velocity_filter_s : float
        T_R of (6.1).
    filter_reference : bool
        The reference velocity passes the same filter as the measured one.
    """

    kp_nm_s_rad: float
    ki_nm_rad: float
    kpp_1_s: float
    velocity_filter_s: float
    prefilter: Prefilter = field(default_factory=Prefilter)
    feedforward: Feedforward = field(default_factory=Feedforward)
    filter_reference: bool = True

    def __str__(self) -> str:
        gains = f"Kp {self.kp_nm_s_rad:.3g} N m s/rad, Ki {self.ki_nm_rad:.3g} N m/rad, Kv {self.kpp_1_s:.3g} 1/s"
        return f"{gains}, T_R {1e3 * self.velocity_filter_s:.3g} ms, prefilter {self.prefilter.kind}"


@dataclass(frozen=True)
class CascadeStructure:
    """Abilities of a drive's built-in cascade, and the quantisation of its gains: the design uses exactly this.

    Names besides the fields of :class:`Cascade`: ``integral_time_s`` for a drive that stores T_N = K_P/K_I in place of K_I.

    Attributes
    ----------
    period_s : float, s
        Sampling period of its loops.
    prefilters : tuple of str
        The kinds available.
    steps : dict of str to float
        Smallest step of each gain in SI by name (``kp_nm_s_rad`` ...), 0 when continuous for our purpose.
    lowest, highest : dict of str to float
        SI bounds.
    roll_off : bool
        It has the additional low-pass behind the prefilter.
    output_limit_rad_s, dead_zone_rad : float
        Bound of the position controller's output, and position errors it does not see; as set in the drive, motor shaft.
    """

    name: str
    period_s: float
    prefilters: tuple[str, ...] = ("none",)
    velocity_feedforward: bool = False
    torque_feedforward: bool = False
    reference_filter: bool = False
    anti_windup: bool = True
    steps: dict[str, float] = field(default_factory=dict)
    lowest: dict[str, float] = field(default_factory=dict)
    highest: dict[str, float] = field(default_factory=dict)
    output_limit_rad_s: float = math.inf
    dead_zone_rad: float = 0.0
    roll_off: bool = False


def discrete_coefficients(cascade: Cascade, period_s: float, torque_limit_nm: float) -> Array:
    """The numbers that the compiled step runs on, in the order that :mod:`beltcomm.control.cascade_kernel` unpacks.

    Parameters
    ----------
    cascade : Cascade
        Gains, prefilter and feedforward.
    period_s : float, s
        > 0, sampling period T of the loops.
    torque_limit_nm : float, N m, motor shaft
        > 0.

    Returns
    -------
    ndarray (23,)
        T, K_P, K_I, K_PP, T_R, filter_reference (0 or 1), prefilter b0 b1 b2 a1 a2, inertia, viscous, Coulomb and offset of the
        feedforward, K_v, torque limit, advance of the feedforward, additional low-pass b0 b1 b2 a1 a2.

    Raises
    ------
    UsageError
        When a number is out of its range, or the prefilter lies at or above the Nyquist frequency π/T.
    """
    if not (period_s > 0.0 and math.isfinite(period_s)):
        raise UsageError(f"the loop period is {period_s} s; give a positive number of seconds")
    if not torque_limit_nm > 0.0:
        raise UsageError(f"the torque limit of the controller is {torque_limit_nm} N m; give a positive torque")
    gains = (cascade.kp_nm_s_rad, cascade.ki_nm_rad, cascade.kpp_1_s, cascade.velocity_filter_s)
    for name, value in zip(("K_P", "K_I", "K_PP", "T_R"), gains, strict=True):
        if not (value >= 0.0 and math.isfinite(value)):
            raise UsageError(f"the controller's {name} is {value}; give a finite number that is not negative")
    forward = cascade.feedforward
    return np.array(
        [
            period_s,
            *gains,
            1.0 if cascade.filter_reference else 0.0,
            *prefilter_coefficients(cascade.prefilter, period_s),
            forward.inertia_kg_m2,
            forward.viscous_nm_s_rad,
            forward.coulomb_nm,
            forward.offset_nm,
            forward.velocity,
            torque_limit_nm,
            forward.advance_s,
            *roll_off_coefficients(cascade.prefilter, period_s),
        ]
    )


def feedforward_torque(feedforward: Feedforward, velocity_rad_s: Array, period_s: float) -> Array:
    """The drive's own feedforward along a sampled reference velocity, as :func:`cascade_step` computes it from a rest.

    J α + d ω + τ_c sign ω + offset, with ω and its difference quotient α carried ``advance_s`` ahead by their own change.

    Parameters
    ----------
    feedforward : Feedforward
        Its parameters, at the motor shaft.
    velocity_rad_s : ndarray (n,), rad/s, motor shaft
    period_s : float, s
        Sampling period of the loops.

    Returns
    -------
    ndarray (n,), N m, motor shaft
    """
    acceleration = np.diff(velocity_rad_s, prepend=velocity_rad_s[0]) / period_s
    advance, ahead = feedforward.advance_s, feedforward.advance_s / period_s
    velocity = velocity_rad_s
    if ahead > 0.0:
        change = np.diff(acceleration, prepend=0.0)
        velocity = velocity + advance * (acceleration + 0.5 * (1.0 + ahead) * change)
        acceleration = acceleration + (0.5 + ahead) * change
    return np.asarray(
        feedforward.inertia_kg_m2 * acceleration
        + feedforward.viscous_nm_s_rad * velocity
        + feedforward.coulomb_nm * np.sign(velocity)
        + feedforward.offset_nm
    )


def velocity_filter_response(omega_rad_s: Array, velocity_filter_s: float, period_s: float) -> ComplexArray:
    """Frequency response from the sampled motor angle to the measured velocity, 1/s.

    (1 − z⁻¹)/(T_R + T − T_R z⁻¹),  z = exp(jωT):  (6.1) by backward differences.

    Parameters
    ----------
    omega_rad_s : ndarray, rad/s
    velocity_filter_s : float
        T_R, s.
    period_s : float
        T, s.

    Returns
    -------
    ComplexArray
        The shape of ``omega_rad_s``.
    """
    delayed = np.exp(-1j * omega_rad_s * period_s)
    return np.asarray((1.0 - delayed) / (velocity_filter_s + period_s - velocity_filter_s * delayed))


def prefilter_response(omega_rad_s: Array, prefilter: Prefilter, period_s: float) -> ComplexArray:
    """Frequency response of the prefilter as the compiled step runs it.

    (b0 + b1 z⁻¹ + b2 z⁻²)/(1 + a1 z⁻¹ + a2 z⁻²),  z = exp(jωT):  (4.1), (4.3) by the prewarped bilinear transform, times the
    additional low-pass where there is one.

    Parameters
    ----------
    omega_rad_s : ndarray, rad/s
    prefilter : Prefilter
        Kind and frequency, with its additional low-pass.
    period_s : float
        T, s.

    Returns
    -------
    ComplexArray
        Shape of ``omega_rad_s``, no unit.

    Raises
    ------
    UsageError
        As :func:`discrete_coefficients`.
    """
    delayed = np.exp(-1j * omega_rad_s * period_s)
    response = np.ones_like(delayed)
    for b0, b1, b2, a1, a2 in (prefilter_coefficients(prefilter, period_s), roll_off_coefficients(prefilter, period_s)):
        response = response * (b0 + (b1 + b2 * delayed) * delayed) / (1.0 + (a1 + a2 * delayed) * delayed)
    return np.asarray(response)


def pi_response(omega_rad_s: Array, kp_nm_s_rad: float, ki_nm_rad: float, period_s: float) -> ComplexArray:
    """Frequency response of the PI velocity controller, N m s/rad.

    K_P + K_I T/(z − 1),  z = exp(jωT):  (4.6) with the integrator (6.25).

    Parameters
    ----------
    omega_rad_s : ndarray, rad/s
        Not 0.
    kp_nm_s_rad : float
        K_P, motor shaft.
    ki_nm_rad : float
        K_I, motor shaft.
    period_s : float, s
        Sampling period T.

    Returns
    -------
    ComplexArray
        Shape of ``omega_rad_s``, N m s/rad.
    """
    return np.asarray(kp_nm_s_rad + ki_nm_rad * period_s / np.expm1(1j * omega_rad_s * period_s))


def prefilter_coefficients(prefilter: Prefilter, period_s: float) -> tuple[float, float, float, float, float]:
    """Discrete coefficients of the prefilter (b0 + b1 z⁻¹ + b2 z⁻²)/(1 + a1 z⁻¹ + a2 z⁻²).

    s/ω0 becomes (1 − z⁻¹)/(1 + z⁻¹)/tan(ω0 T/2), which is exact at ω0.

    Parameters
    ----------
    prefilter : Prefilter
        Kind and frequency.
    period_s : float
        T, s.

    Returns
    -------
    tuple of float
        b0, b1, b2, a1, a2.

    Raises
    ------
    UsageError
        For ω0 outside 0 .. π/T or a notch width not above 0.
    """
    if prefilter.kind == "none":
        return 1.0, 0.0, 0.0, 0.0, 0.0
    omega = prefilter.omega_rad_s
    if not 0.0 < omega < math.pi / period_s:
        raise UsageError(
            f"the {prefilter.kind} prefilter at {omega:.6g} rad/s does not fit a loop of {period_s:g} s: "
            f"choose a frequency above 0 and below {math.pi / period_s:.6g} rad/s"
        )
    k = math.tan(0.5 * omega * period_s)
    if prefilter.kind == "notch":
        if not prefilter.d_n > 0.0:
            raise UsageError(f"the notch width d_n is {prefilter.d_n}; give a positive number (above 1 to attenuate)")
        damping_above, damping_below = k / prefilter.d_n, k * prefilter.d_n
        numerator = (1.0 + 2.0 * damping_above + k * k, 2.0 * (k * k - 1.0), 1.0 - 2.0 * damping_above + k * k)
    else:
        damping_below = k / math.sqrt(2.0)
        numerator = (k * k, 2.0 * k * k, k * k)
    a0 = 1.0 + 2.0 * damping_below + k * k
    b0, b1, b2 = (value / a0 for value in numerator)
    return b0, b1, b2, 2.0 * (k * k - 1.0) / a0, (1.0 - 2.0 * damping_below + k * k) / a0


def roll_off_coefficients(prefilter: Prefilter, period_s: float) -> tuple[float, float, float, float, float]:
    """Discrete coefficients of the additional low-pass (4.2.1).

    Parameters
    ----------
    prefilter : Prefilter
        Holds the low-pass.
    period_s : float, s
        Sampling period T.

    Returns
    -------
    tuple of float
        b0, b1, b2, a1, a2; 1, 0, 0, 0, 0 for none.

    Raises
    ------
    UsageError
        As :func:`prefilter_coefficients`.
    """
    omega = prefilter.roll_off_rad_s
    if omega != 0.0 and not 0.0 < omega < math.pi / period_s:
        raise UsageError(
            f"the additional low-pass at {omega:.6g} rad/s does not fit a loop of {period_s:g} s: "
            f"choose a frequency above 0 and below {math.pi / period_s:.6g} rad/s, or 0 for none"
        )
    return prefilter_coefficients(Prefilter("butterworth", omega) if omega else Prefilter(), period_s)


def __getattr__(name: str) -> Any:
    if name in _COMPILED:
        from beltcomm.control import cascade_kernel

        return getattr(cascade_kernel, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
