"""Feedforward from the identified numbers: linear, nonlinear or none (4.15) to (4.17)."""

from __future__ import annotations

import math
from typing import Literal

from beltcomm.control import CascadeStructure, Feedforward
from beltcomm.errors import UsageError

FeedforwardKind = Literal["nonlinear", "linear", "none"]
#: With what the host can add: the motor led ahead of the carriage (``beltcomm.design.compliant``).
SentFeedforward = Literal["nonlinear", "linear", "none", "compliant", "led"]


def feedforward_from(
    structure: CascadeStructure,
    kind: FeedforwardKind = "nonlinear",
    *,
    inertia_kg_m2: float,
    viscous_nm_s_rad: float,
    coulomb_nm: float,
    apparent_viscous_nm_s_rad: float | None = None,
    offset_nm: float = 0.0,
    dead_time_s: float = 0.0,
) -> Feedforward:
    """Feedforward (4.16) of the kind asked for, as far as the drive has the terms.

    nonlinear: m_e dω_d/dt + d_v ω_d + τ_c sign(ω_d) + offset, friction from the sweep (3.36);
    linear:    m_e dω_d/dt + d_a ω_d + offset, with the damping d_a that a frequency response around standstill shows, which
               over-compensates on the moving axis (thesis 5.2; sheet, errata 7);
    none:      the offset alone, which holds a tilted axis, and no velocity feedforward.

    All at the motor shaft.   Terms the drive lacks are 0: torque terms without ``structure.torque_feedforward``, K_v without
    ``structure.velocity_feedforward``.

    Parameters
    ----------
    structure : CascadeStructure
        Terms that the drive has.
    kind : FeedforwardKind
        "nonlinear", "linear" or "none".
    inertia_kg_m2 : float
        m_e = Θ_e + i_t² m_c, kg m².
    viscous_nm_s_rad, coulomb_nm : float
        Friction of the moving axis, motor and carriage together.
    apparent_viscous_nm_s_rad : float or None
        d_a, needed for "linear".
    offset_nm : float
        + i_t m_c g sin(tilt).
    dead_time_s : float
        From torque setpoint to acting torque; the feedforward is computed that much and half a period ahead.

    Raises
    ------
    UsageError
        For a number that is not finite, a negative inertia or friction, or a linear kind without d_a.
    """
    if kind == "linear":
        if apparent_viscous_nm_s_rad is None:
            raise UsageError("a linear feedforward needs the apparent damping of a frequency response; fit one, or use nonlinear")
        viscous_nm_s_rad, coulomb_nm = apparent_viscous_nm_s_rad, 0.0
    elif kind == "none":
        inertia_kg_m2, viscous_nm_s_rad, coulomb_nm = 0.0, 0.0, 0.0
    elif kind != "nonlinear":
        raise UsageError(f"the feedforward kind is {kind!r}; choose nonlinear, linear or none")
    for name, value in (("inertia", inertia_kg_m2), ("viscous friction", viscous_nm_s_rad), ("Coulomb friction", coulomb_nm)):
        if not (value >= 0.0 and math.isfinite(value)):
            raise UsageError(f"the {name} of the feedforward is {value}; it must be finite and not negative")
    if not math.isfinite(offset_nm):
        raise UsageError(f"the offset of the feedforward is {offset_nm}; it must be finite")
    velocity = 1.0 if structure.velocity_feedforward and kind != "none" else 0.0
    if not structure.torque_feedforward:
        return Feedforward(velocity=velocity)
    advance = dead_time_s + 0.5 * structure.period_s if kind != "none" else 0.0
    return Feedforward(inertia_kg_m2, viscous_nm_s_rad, coulomb_nm, offset_nm, velocity, advance)
