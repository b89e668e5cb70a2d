"""Families of machines beside those of the method sheet: belt axes of every size, and axes without a belt."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from truth.hidden import machines
from truth.hidden.machines import MICRO_SLIP_M, PEAK_TORQUE_NM, Base, Scale

#: m/s and m of the method sheet's machine, to which ``Scale`` refers.
SHEET_SPEED_M_S, SHEET_RADIUS_M = 2.0, 0.0125
#: N/m, belts that can be bought and mounted; m, farthest that they may stretch at full acceleration.
STIFFNESS_N_M: Final = (1.5e4, 4e6)
LARGEST_STRETCH_M = 4e-3
#: rad/s, fastest motor.
MOTOR_RAD_S = 450.0
FAMILIES: Final = (*machines.FAMILIES, "wide", "rigid")


def draw_base(rng: np.random.Generator, family: str) -> Base:
    """A random healthy machine of any family.   Raises ValueError for another."""
    if family == "wide":
        return _wide(rng)
    if family == "rigid":
        return _rigid(rng)
    if family not in FAMILIES:
        raise ValueError(f"family {family!r} is not one of {', '.join(FAMILIES)}")
    return machines.draw_base(rng, family)


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    """Uniform in the logarithm."""
    return float(low * (high / low) ** rng.uniform(0.0, 1.0))


def _wide(rng: np.random.Generator) -> Base:
    """A belt axis of any size: radius 8 to 25 mm, carriage 0.4 to 40 kg, travel 0.3 to 3 m, resonance 15 to 150 Hz, gear 1 (four of ten)
    to 10, all but the gear uniform in the logarithm.

    The motor suits the load: carriage 0.5 to 12 times its inertia (which is not below 5e-6 kg m2), full acceleration 6 to 40 m/s2, motor
    not above 450 rad/s.   Friction, noise and belt as shares of rated torque and peak force as on the method sheet.   The resonance
    is moved where no belt could make it: 15 kN/m to 4 MN/m, no more than 4 mm of stretch.
    """
    u = rng.uniform
    pitch = float(rng.choice([0.002, 0.003, 0.005]))
    teeth = round(math.tau * _log(rng, 8.2e-3, 24.6e-3) / pitch)
    gear = 1.0 if rng.random() < 0.4 else round(_log(rng, 1.5, 10.0), 2)
    radius = round(teeth * pitch / math.tau * u(0.99, 1.01) / gear, 9)
    mass, ratio = _log(rng, 0.4, 40.0), _log(rng, 0.5, 12.0)
    inertia = max(mass * radius**2 / ratio, 5e-6)
    rigid = inertia + mass * radius**2
    speed = min(_log(rng, 0.7, 3.0), MOTOR_RAD_S * radius)
    acceleration = _log(rng, 6.0, 40.0)
    peak = 1.5 * rigid * acceleration / radius
    rated = peak * u(0.35, 0.5)
    reduced = 1.0 / (radius**2 / inertia + 1.0 / mass)
    softest = max(STIFFNESS_N_M[0], mass * acceleration / LARGEST_STRETCH_M)
    lowest = max(15.0, math.sqrt(softest / reduced) / math.tau)
    highest = max(min(150.0, math.sqrt(STIFFNESS_N_M[1] / reduced) / math.tau), lowest)
    resonance = min(_log(rng, lowest, highest), 150.0)
    stiffness = reduced * (math.tau * resonance) ** 2
    stroke = round(_log(rng, 0.3, 3.0), 3)
    offset = round(0.06 + 0.05 * stroke, 3)
    length = min(radius / SHEET_RADIUS_M, 2.0 * stroke)
    torque, faster = peak / PEAK_TORQUE_NM, speed / SHEET_SPEED_M_S
    return Base(
        family="wide",
        inertia_kg_m2=inertia,
        mass_kg=mass,
        stiffness_n_m=stiffness,
        belt_damping_n_s_m=2.0 * u(0.015, 0.04) * math.sqrt(stiffness * reduced),
        viscous_nm_s_rad=rated * u(0.03, 0.15) / (speed / radius),
        drag_n_s_m=rated / radius * u(0.02, 0.12) / speed,
        coulomb_nm=rated * u(0.05, 0.12),
        radius_m=radius,
        micro_slip_m=MICRO_SLIP_M * length * u(0.8, 1.25),
        micro_damping=u(0.01, 0.04),
        torque_noise_nm=rated * u(0.004, 0.010),
        stroke_m=stroke,
        pulley_distance_m=round(1.06 * stroke + 2.0 * offset, 3),
        driven_side_offset_m=offset,
        belt_force_limit_n=peak / radius * u(2.0, 5.0),
        rated_torque_nm=rated,
        peak_torque_nm=peak,
        gear=gear,
        teeth=teeth,
        counts_per_rev=65536,
        scale=Scale(torque, torque * SHEET_RADIUS_M / radius, faster, length, stroke, 1.2 * faster),
    )


def _rigid(rng: np.random.Generator) -> Base:
    """An axis without a belt, one inertia with viscous and Coulomb friction: 1e-5 to 1e-2 kg m2, 60 to 300 rad/s, 1e3 to 1e4 rad/s2
    (all uniform in the logarithm), travel 40 to 300 rad, Coulomb friction 4 to 15 % of rated torque.
    """
    u = rng.uniform
    inertia, speed, acceleration = _log(rng, 1e-5, 1e-2), _log(rng, 60.0, 300.0), _log(rng, 1e3, 1e4)
    peak = 1.5 * inertia * acceleration
    rated = peak * u(0.35, 0.5)
    angle = 1.0 / SHEET_RADIUS_M
    return Base(
        family="rigid",
        inertia_kg_m2=inertia,
        mass_kg=0.0,
        stiffness_n_m=0.0,
        belt_damping_n_s_m=0.0,
        viscous_nm_s_rad=rated * u(0.03, 0.2) / speed,
        drag_n_s_m=0.0,
        coulomb_nm=rated * u(0.04, 0.15),
        radius_m=1.0,
        micro_slip_m=MICRO_SLIP_M * angle * u(0.8, 1.25),
        micro_damping=u(0.01, 0.04),
        torque_noise_nm=rated * u(0.004, 0.010),
        stroke_m=_log(rng, 40.0, 300.0),
        pulley_distance_m=0.0,
        driven_side_offset_m=0.0,
        belt_force_limit_n=math.inf,
        rated_torque_nm=rated,
        peak_torque_nm=peak,
        counts_per_rev=65536,
        scale=Scale(peak / PEAK_TORQUE_NM, 1.0, speed / SHEET_SPEED_M_S, angle, 1.0, 0.6 * speed, angle),
    )


def data_sheet(base: Base, rng: np.random.Generator) -> dict[str, Any]:
    """``axis.yaml`` of the machine: inertia within +-10 % of the truth, belt stiffness by its length within +-15 %."""
    if base.family in machines.FAMILIES:
        return machines.data_sheet(base, rng)
    inertia = base.inertia_kg_m2 * rng.uniform(0.9, 1.1)
    motor: dict[str, Any] = {"rated_torque_nm": base.rated_torque_nm, "peak_torque_nm": base.peak_torque_nm}
    if base.rigid:
        return {"name": "axis without a belt", "motor": _rounded({"inertia_kg_m2": inertia} | motor) | _counts(base)}
    l1 = base.driven_side_offset_m + 0.5 * base.stroke_m
    specific = base.stiffness_n_m / (1.0 / l1 + 1.0 / (2.0 * base.pulley_distance_m - l1)) * rng.uniform(0.87, 1.15)
    driven = 0.33 * inertia * base.gear**2  # pulley and gearbox, at the pulley
    radius = base.radius_m * base.gear
    return {
        "name": f"toothed-belt axis, {base.stroke_m:g} m",
        "motor": _rounded({"inertia_kg_m2": 0.63 * inertia} | motor) | _counts(base),
        "gearbox": _rounded({"ratio": base.gear, "inertia_kg_m2": 0.2 * driven if base.gear > 1.0 else 0.0}),
        "coupling": _rounded({"inertia_kg_m2": 0.04 * inertia}),
        "pulley": _rounded({"effective_radius_m": radius, "inertia_kg_m2": driven * (0.8 if base.gear > 1.0 else 1.0)})
        | {"teeth": base.teeth},
        "belt": _rounded({"specific_stiffness_n": specific, "pitch_m": _pitch(base), "pulley_distance_m": base.pulley_distance_m}),
        "travel": _rounded({"min_m": -0.01 * base.stroke_m, "max_m": base.stroke_m, "driven_side_offset_m": base.driven_side_offset_m}),
        "limits": _rounded(
            {
                "speed_m_s": 1.5 * SHEET_SPEED_M_S * base.scale.speed,
                "acceleration_m_s2": 50.0,
                "feed_force_n": base.belt_force_limit_n,
            }
        ),
        "mounting": {"tilt_deg": 0.0},
    }


def _pitch(base: Base) -> float:
    """Pitch of the belt, m: the whole 0.1 mm next to what teeth and radius make."""
    return round(math.tau * base.radius_m * base.gear / base.teeth, 4)


def _counts(base: Base) -> dict[str, int]:
    return {"encoder_counts_per_rev": round(math.tau / base.quantum_rad)}


def _rounded(part: dict[str, float]) -> dict[str, float]:
    """Six digits, as a data sheet."""
    return {key: float(f"{value:.6g}") for key, value in part.items()}
