"""P-PI cascade and PID controller: the same loop in the other form, exactly (appendix B).

    PID:   τ = G_pre (P (b φ_d − φ) + I ∫(φ_d − φ) + (B ω_d − D ω)) + τ_FF,   ω: φ through the velocity filter (6.1)

Appendix B takes G_R = s for that filter and finds P = K_I + K_P K_PP, I = K_I K_PP, D = K_P (B.6e) to (B.6g), the same from the reference
only for K_v = 1 (B.7).  Both hold further here.  With (6.1) the integral of the filtered velocity is
∫ω = φ − (T_R + T) ω, in the continuous form (T = 0) as in the discrete one of :mod:`beltcomm.control`, so that

    D = K_P − K_I (T_R + T),   and for the way back   K_I² − (P − (T_R + T) I) K_I + D I = 0,   K_P = D + K_I (T_R + T),   K_PP = I/K_I.

With the setpoint weight b = (K_v K_I + K_P K_PP)/P any K_v has its PID; b = 1 is K_v = 1.  The closed loops are the same from
reference and from disturbance as long as the reference's velocity is that of its position (B.1), positions count from where the loop was
closed (b weighs them), no limit is reached (the two integrators hold different numbers, so conditional integration (6.26) lets go of
them at different moments) and the position loop stays closed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from beltcomm.control import Cascade, Feedforward, Prefilter
from beltcomm.errors import Refused, UsageError

#: Relative difference up to which a setpoint weight counts as the one that a cascade has.
SAME_WEIGHT = 1e-6


@dataclass(frozen=True)
class Pid:
    """A PID position controller, motor side.

    Attributes
    ----------
    kp_nm_rad : float
        P.
    ki_nm_rad_s : float
        I.
    kd_nm_s_rad : float
        D, on the measured velocity; below 0 where T_N < T_R + T.
    setpoint_weight : float
        b.
    velocity_nm_s_rad : float or None
        B, on the reference velocity; B − D is the thesis's K_v of the PID (B.6b).
    derivative_filter_s : float
        T_R of (6.1).
    filter_reference : bool
        The reference velocity passes that filter too.
    prefilter : Prefilter
        Of all but the feedforward torque.
    feedforward : Feedforward
        Torque terms as in the cascade, K_a of (B.6a) among them.
    """

    kp_nm_rad: float
    ki_nm_rad_s: float
    kd_nm_s_rad: float
    setpoint_weight: float = 1.0
    velocity_nm_s_rad: float | None = None
    derivative_filter_s: float = 0.0
    filter_reference: bool = True
    prefilter: Prefilter = field(default_factory=Prefilter)
    feedforward: Feedforward = field(default_factory=Feedforward)

    @property
    def reference_gain_nm_s_rad(self) -> float:
        """B; D where none is given: the derivative of the control error."""
        return self.kd_nm_s_rad if self.velocity_nm_s_rad is None else self.velocity_nm_s_rad

    @property
    def velocity_feedforward_nm_s_rad(self) -> float:
        """B − D, the K_v of the PID in (B.6b)."""
        return self.reference_gain_nm_s_rad - self.kd_nm_s_rad


@dataclass(frozen=True)
class Cascades:
    """The cascades of one PID: the same closed position loop, the zeros −K_PP and −K_I/K_P exchanged (T_R = 0).

    Attributes
    ----------
    slow : Cascade
        The smaller K_PP and the larger K_I, as in all gains of the thesis.
    fast : Cascade or None
        The larger K_PP, None where that root has no cascade or is the same.
    discriminant : float
        (P − (T_R + T) I)² − 4 D I, (N m/rad)².
    """

    slow: Cascade
    fast: Cascade | None
    discriminant: float


def to_pid(cascade: Cascade, period_s: float = 0.0) -> Pid:
    """The PID of a cascade; it always exists.

    T_R = T = 0: appendix B, (B.6).

    Parameters
    ----------
    cascade : Cascade
    period_s : float
        T of the discrete loops, s; 0 is the continuous form.

    Raises
    ------
    UsageError
        For a gain that is negative or not finite, and for K_PP = 0, which holds no position.
    """
    _check({"K_P": cascade.kp_nm_s_rad, "K_I": cascade.ki_nm_rad, "K_PP": cascade.kpp_1_s, "T_R": cascade.velocity_filter_s, "T": period_s})
    kp, ki, kpp, kv = cascade.kp_nm_s_rad, cascade.ki_nm_rad, cascade.kpp_1_s, cascade.feedforward.velocity
    proportional = ki + kp * kpp
    if kpp == 0.0 or proportional == 0.0:
        raise UsageError(f"K_PP = {kpp:g} with K_P = {kp:g} and K_I = {ki:g} holds no position and has no PID; give gains above 0")
    derivative = kp - ki * (cascade.velocity_filter_s + period_s)
    return Pid(
        proportional,
        ki * kpp,
        derivative,
        (kv * ki + kp * kpp) / proportional,
        kv * (derivative if cascade.filter_reference else kp),
        cascade.velocity_filter_s,
        cascade.filter_reference,
        cascade.prefilter,
        cascade.feedforward,
    )


def to_cascades(pid: Pid, period_s: float = 0.0) -> Cascades:
    """The one or two cascades of a PID.

    Take ``slow`` unless the other is known to be meant: its velocity loop is the stiffer one, its position loop the slower one, and
    without velocity feedforward it overshoots less; where the velocity loop is also used alone, ``fast`` has the larger phase margin.

    Parameters
    ----------
    pid : Pid
        Gains and weights at the motor shaft.
    period_s : float
        As in :func:`to_pid`.

    Raises
    ------
    Refused
        With the number, where the roots are complex or negative, or where the weights b and B are those of no cascade.
    UsageError
        For gains that are negative or not finite.
    """
    _check({"P": pid.kp_nm_rad, "I": pid.ki_nm_rad_s, "T_R": pid.derivative_filter_s, "T": period_s})
    weights = {"D": pid.kd_nm_s_rad, "setpoint weight b": pid.setpoint_weight, "B": pid.reference_gain_nm_s_rad}
    for name, value in weights.items():
        if not math.isfinite(value):
            raise UsageError(f"{name} is {value}; give a finite number")
    if pid.kp_nm_rad == 0.0:
        raise UsageError("a PID with P = 0 has no cascade: P = K_I + K_P K_PP is above 0 for every cascade that holds a position")
    lag = pid.derivative_filter_s + period_s
    total = pid.kp_nm_rad - lag * pid.ki_nm_rad_s
    discriminant = total * total - 4.0 * pid.kd_nm_s_rad * pid.ki_nm_rad_s
    found = [_cascade(pid, ki, lag) for ki in _roots(pid, total, discriminant, lag)]
    cascades = [cascade for cascade in found if cascade is not None]
    if not cascades:
        raise Refused(
            f"no cascade has P = {pid.kp_nm_rad:.6g} N m/rad, I = {pid.ki_nm_rad_s:.6g} N m/(rad s), D = {pid.kd_nm_s_rad:.6g} N m s/rad: "
            f"its K_I would not be above 0 (P − (T_R + T) I is {total:.6g} N m/rad); raise P or lower I"
        )
    same = [one for cascade in cascades if (one := _with_reference(pid, cascade)) is not None]
    if not same:
        raise Refused(_weights_refusal(pid, cascades[0]))
    distinct = len(same) > 1 and same[1] != same[0]
    return Cascades(same[0], same[1] if distinct else None, discriminant)


def _least_proportional(pid: Pid, period_s: float = 0.0) -> float:
    """P from which on a PID with this I and D ≥ 0 has a cascade:  (T_R + T) I + 2 √(D I), N m/rad at the motor shaft."""
    return (pid.derivative_filter_s + period_s) * pid.ki_nm_rad_s + 2.0 * math.sqrt(pid.kd_nm_s_rad * pid.ki_nm_rad_s)


def _roots(pid: Pid, total: float, discriminant: float, lag: float) -> list[float]:
    """K_I, the larger first.   Raises Refused for complex roots."""
    product = pid.kd_nm_s_rad * pid.ki_nm_rad_s
    # A double root that was rounded is still one: the sum and the product are known to some units in the last place.
    if discriminant < -1e-14 * (total * total + abs(product)):
        damping = 0.5 * abs(total) / math.sqrt(product)
        raise Refused(
            f"P = {pid.kp_nm_rad:.6g}, I = {pid.ki_nm_rad_s:.6g}, D = {pid.kd_nm_s_rad:.6g} is no cascade: "
            f"(P − (T_R + T) I)² − 4 D I = {discriminant:.6g} is negative, its zeros are complex (damping {damping:.3g}) and those of a "
            f"cascade are real; raise P to {_least_proportional(pid, lag - pid.derivative_filter_s):.6g} N m/rad or more, or lower I or D"
        )
    root = math.sqrt(max(discriminant, 0.0))
    # The root of the larger size without cancellation, the other by the product of both.
    far = 0.5 * (total + math.copysign(root, total))
    near = product / far if far != 0.0 else 0.0
    return sorted((far, near), reverse=True)


def _cascade(pid: Pid, ki: float, lag: float) -> Cascade | None:
    """The cascade of one root, K_v left open; None where a gain would be negative or infinite."""
    kp = pid.kd_nm_s_rad + ki * lag
    if ki > 0.0 and pid.ki_nm_rad_s > 0.0:
        kpp = pid.ki_nm_rad_s / ki
    elif ki == 0.0 and pid.ki_nm_rad_s == 0.0 and kp > 0.0:
        kpp = pid.kp_nm_rad / kp
    else:
        return None
    if kp < 0.0:
        return None
    return Cascade(kp, ki, kpp, pid.derivative_filter_s, pid.prefilter, pid.feedforward, pid.filter_reference)


def _with_reference(pid: Pid, cascade: Cascade) -> Cascade | None:
    """The cascade with the K_v that both weights ask for; None when they ask for different ones."""
    weight, gain = _velocity_feedforwards(pid, cascade)
    if weight is None or gain is None:
        found = weight if gain is None else gain
        kv = 1.0 if found is None else found
    elif math.isclose(weight, gain, rel_tol=SAME_WEIGHT, abs_tol=SAME_WEIGHT):
        kv = gain
    else:
        return None
    return replace(cascade, feedforward=replace(cascade.feedforward, velocity=kv))


def _velocity_feedforwards(pid: Pid, cascade: Cascade) -> tuple[float | None, float | None]:
    """K_v by the setpoint weight, and by the gain on the reference velocity; None where any K_v has it."""
    weight = None
    if cascade.ki_nm_rad > 0.0:
        weight = (pid.setpoint_weight * pid.kp_nm_rad - cascade.kp_nm_s_rad * cascade.kpp_1_s) / cascade.ki_nm_rad
    divisor = pid.kd_nm_s_rad if pid.filter_reference else cascade.kp_nm_s_rad
    gain = pid.reference_gain_nm_s_rad / divisor if divisor != 0.0 else None
    return weight, gain


def _weights_refusal(pid: Pid, cascade: Cascade) -> str:
    weight, gain = _velocity_feedforwards(pid, cascade)
    return (
        f"the loop has a cascade, but not with this reference: the setpoint weight b = {pid.setpoint_weight:.6g} needs K_v = {weight:.6g}, "
        f"the gain {pid.reference_gain_nm_s_rad:.6g} N m s/rad on the reference velocity K_v = {gain:.6g} (B.6b), (B.6c); "
        "b = 1 and the derivative of the error belong to K_v = 1"
    )


def _check(values: dict[str, float]) -> None:
    for name, value in values.items():
        if not (value >= 0.0 and math.isfinite(value)):
            raise UsageError(f"{name} is {value}; give a finite number that is not negative")
