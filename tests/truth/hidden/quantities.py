"""What can be held against a fitted model: true values of quantities that a candidate has under the same meaning.

Effects whose law differs in form from the candidate's (Stribeck exponent, tight spot, hardening, unlike springs at the idler …) have no
such value: then only the error that is left counts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from truth.hidden import layout as at
from truth.hidden.machines import Machine

#: Per hidden effect: parameters of the candidate (two: sine and cosine, their amplitude counts) and the name of the true value.
SAME_MEANING: Final[Mapping[str, tuple[tuple[tuple[str, ...], str], ...]]] = {
    "belt_damping": ((("belt_damping.damping",), "damping_n_s_m"),),
    "tilt": ((("constant_offset.torque",), "offset_nm"), (("tilt.angle",), "angle_rad")),  # the angle behind a gap only
    "coulomb_asymmetry": ((("constant_offset.torque",), "offset_nm"),),
    "cogging": ((("cogging.sine", "cogging.cosine"), "amplitude_nm"),),
    "tooth_ripple": ((("tooth_ripple.sine", "tooth_ripple.cosine"), "amplitude_nm"),),
    "pulley_eccentricity": ((("pulley_eccentricity.sine", "pulley_eccentricity.cosine"), "share"),),
    "encoder_eccentricity": ((("encoder_eccentricity.sine", "encoder_eccentricity.cosine"), "amplitude_rad"),),
    "backlash": ((("backlash.gap",), "gap_m"),),
    "payload_mode": ((("payload.mass",), "mass_kg"), (("payload_mode.stiffness",), "stiffness_n_m")),
    "dead_time": ((("dead_time.time",), "time_s"),),
    "current_lag": ((("current_lag.time",), "time_s"),),
    "cart_friction": ((("cart_friction.level",), "coulomb_cart_n"),),
}


#: Candidates that let the torque act later: at low frequency their times add up, and the lag of the truth is of second order.
DELAYS: Final = ("dead_time.time", "current_lag.time")


def true_values(machine: Machine) -> dict[tuple[str, ...], float]:
    """True value of every quantity of the hidden effects that a candidate has as well, by the candidate's parameters."""
    found = {}
    for name in machine.effects:
        for parameters, key in SAME_MEANING.get(name, ()):
            found[parameters] = float(machine.hidden[name][key])
    return found


def true_base(machine: Machine) -> dict[str, float]:
    """The seven parameters of the healthy machine under the names of the model, friction of the carriage apart."""
    base = machine.base
    return {
        "motor.inertia": base.inertia_kg_m2,
        "cart.mass": base.mass_kg,
        "belt_stiffness.stiffness": base.stiffness_n_m,
        "belt_damping.damping": base.belt_damping_n_s_m,
        "viscous.damping": base.viscous_nm_s_rad,
        "viscous_cart.damping": base.drag_n_s_m,
        "coulomb.level": float(machine.p[at.COULOMB]),
    }


def covered(truth: float, values: tuple[float, ...], intervals: tuple[float | None, ...]) -> bool | None:
    """Whether an interval of 95 % holds the true value; of two values the amplitude.   None where there is no interval."""
    if any(width is None for width in intervals):
        return None
    widths = [float(width) for width in intervals if width is not None]
    if len(values) == 1:
        return abs(values[0] - truth) <= widths[0]
    size = math.hypot(*values)
    spread = math.hypot(*(v * w for v, w in zip(values, widths, strict=True))) / max(size, 1e-300)
    return abs(size - abs(truth)) <= spread
