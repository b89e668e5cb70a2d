"""Torque beyond the drive's own feedforward (4.16) that a known machine needs along a known motion.

    τ(t) = path⁻¹( Σ friction levels · sign ω  -  Σ forces(φ, ω, t) + m_e dω/dt )  -  τ_FF(t)

with the carriage following the motor rigidly.  It holds what depends on place, angle or speed and that the drive's four numbers cannot
say: tight spots, ripple, Stribeck friction, springs, drag, and the torque that a saturated motor lacks.  The host sends it along with
the reference (60B2h); a drive without torque feedforward gets none.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltcomm.control import Feedforward
from beltcomm.linear import acts_on, values_of
from beltcomm.model import Model
from beltcomm.trajectory import Trajectory

Array = NDArray[np.float64]

#: Slots of what can be compensated by a torque.
SLOTS = frozenset({"force", "friction_level", "torque_path"})
#: What the drive's own feedforward says already.
OWN = frozenset({"viscous", "viscous_cart", "coulomb", "cart_friction", "constant_offset", "tilt"})
#: Steps that undo the torque path; each gains at least a digit for a loss of 10 %.
INVERSIONS = 8


def compensated(model: Model) -> tuple[str, ...]:
    """Effects of a model whose torque is sent along; () where the drive's own feedforward says everything."""
    return tuple(e.name for e in model.effect_list() if e.slot in SLOTS and e.name not in OWN)


def compensation(model: Model, feedforward: Feedforward, trajectory: Trajectory, period_s: float, time_s: float = 0.0) -> Array:
    """The torque, N m at the motor shaft, (n,), computed ``feedforward.advance_s`` ahead, as the drive computes its own.

    time_s : session's clock at the start, for friction that warms up.
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
        extra[k] = _beyond(model, float(place[k]), float(speed[k]), time_s + float(ahead[k]), float(known[k]))
    return extra


def _beyond(model: Model, place: float, speed: float, time_s: float, known: float) -> float:
    """One instant: what is needed beside the torque that is known."""
    ratio = model["transmission.ratio"]
    needed = known
    path = []
    for effect in model.effect_list():
        if effect.slot not in SLOTS or effect.law is None or effect.name in OWN:
            continue
        values = values_of(model, effect, place)
        if effect.slot == "torque_path":
            path.append((effect.law, values))
            continue
        i, lever = acts_on(model, effect)
        rotary = model.bodies()[i][1].rotary and lever == 1.0
        arm = 1.0 if rotary else ratio
        own_speed = speed / ratio if rotary else speed
        if effect.slot == "force":
            needed -= arm * effect.law(place / ratio if rotary else place, own_speed, time_s, *values)
        elif speed != 0.0:
            needed += arm * float(np.sign(speed)) * effect.law(abs(own_speed), place, time_s, *values)
    torque = needed
    for law, values in path:
        for _ in range(INVERSIONS):
            torque = needed + torque - law(torque, place / ratio, time_s, *values)
    return torque - known
