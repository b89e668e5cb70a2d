"""Feedforward from the identified numbers: linear, nonlinear or none (4.15) to (4.17), and the torque beyond it that a known machine needs.

    τ(t) = path⁻¹( Σ friction levels · sign ω  -  Σ forces(φ, ω, t) + m_e dω/dt )  -  τ_FF(t)

with the carriage following the motor rigidly.  It holds what depends on place, angle or speed and that the drive's four numbers cannot
say: tight spots, ripple, Stribeck friction, springs, drag, and the torque that a saturated motor lacks.  The host sends it along with
the reference (60B2h); a drive without torque feedforward gets none.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import CascadeStructure, Feedforward
from beltcomm.errors import UsageError
from beltcomm.model import Model
from beltcomm.model.linear import acts_on, values_of
from beltcomm.trajectory import Trajectory

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


#: Slots of what can be compensated by a torque.
SLOTS = frozenset({"force", "friction_level", "torque_path"})
#: What the drive's own feedforward says already.
OWN = frozenset({"viscous", "viscous_cart", "coulomb", "cart_friction", "constant_offset", "tilt"})
#: Steps that undo the torque path; each gains at least a digit for a loss of 10 %.
INVERSIONS = 8


def compensated_effects(model: Model) -> tuple[str, ...]:
    """Effects of a model whose torque is sent along; () where the drive's own feedforward says everything.

    Parameters
    ----------
    model : Model
        With a belt or rigid.

    Returns
    -------
    tuple of str
        In the order of the model.
    """
    return tuple(e.name for e in model.effect_list() if e.slot in SLOTS and e.name not in OWN)


def compensation(model: Model, feedforward: Feedforward, trajectory: Trajectory, period_s: float, time_s: float = 0.0) -> Array:
    """The torque, N m at the motor shaft, (n,), computed ``feedforward.advance_s`` ahead, as the drive computes its own.

    Parameters
    ----------
    model : Model
    feedforward : Feedforward
        Of the drive, with its advance.
    trajectory : Trajectory
        Of the carriage.
    period_s : float, s
        Of the samples of the result.
    time_s : float
        Session's clock at the start, for friction that warms up.
    """
    ratio = model["transmission.ratio"]
    ahead = np.arange(len(trajectory.t_s)) * period_s + feedforward.advance_s
    place, speed, acceleration = (
        np.interp(ahead, trajectory.t_s - trajectory.t_s[0], values)
        for values in (trajectory.position_m, trajectory.velocity_m_s, trajectory.acceleration_m_s2)
    )
    known = (
        feedforward.inertia_kg_m2 * acceleration / ratio
        + feedforward.viscous_nm_s_rad * speed / ratio
        + feedforward.coulomb_nm * np.sign(speed)
        + feedforward.offset_nm
    )
    extra = np.zeros(len(place))
    for k in range(len(place)):
        now = time_s + float(ahead[k])
        torque, force = demand_of_effects(model, float(place[k]), float(speed[k]), now)
        extra[k] = through_path(model, float(known[k]) + torque + ratio * force, float(place[k]), now) - known[k]
    return extra


def demand_of_effects(model: Model, place: float, speed: float, time_s: float) -> tuple[float, float]:
    """Demand of effects beyond (4.16) at an instant.

    Parameters
    ----------
    model : Model
        With a belt or rigid.
    place, speed : float
        m and m/s of the carriage.
    time_s : float, s
        Session clock.

    Returns
    -------
    tuple of float
        Torque at the motor shaft, N m, and force at the carriage, N.
    """
    ratio = model["transmission.ratio"]
    torque = force = 0.0
    for effect in model.effect_list():
        if effect.slot not in ("force", "friction_level") or effect.law is None or effect.name in OWN:
            continue
        values = values_of(model, effect, place)
        i, lever = acts_on(model, effect)
        rotary = model.bodies()[i][1].rotary and lever == 1.0
        own_speed = speed / ratio if rotary else speed
        if effect.slot == "force":
            needed = -effect.law(place / ratio if rotary else place, own_speed, time_s, *values)
        else:
            needed = float(np.sign(speed)) * effect.law(abs(own_speed), place, time_s, *values)
        torque, force = (torque + needed, force) if rotary else (torque, force + needed)
    return torque, force


def through_path(model: Model, needed: float, place: float, time_s: float) -> float:
    """Torque setpoint by which the torque path of a model passes on what is needed.

    Parameters
    ----------
    model : Model
        With its torque path.
    needed : float, N m
        Torque that shall act on the motor.
    place : float, m
        Carriage.
    time_s : float, s
        Session clock.

    Returns
    -------
    float, N m
        By fixed-point iteration.
    """
    path = [(e.law, values_of(model, e, place)) for e in model.effect_list() if e.slot == "torque_path" and e.law is not None]
    torque = needed
    for law, values in path:
        for _ in range(INVERSIONS):
            torque = needed + torque - law(torque, place / model["transmission.ratio"], time_s, *values)
    return torque
