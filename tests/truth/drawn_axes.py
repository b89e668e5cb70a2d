"""Belt axes with their data sheets, drawn at random: size, motor, gearbox, belt, travel, friction and encoder, each independently.

What can be bought: the peak torque accelerates the load with 4 to 80 m/s², and the load is a part of the motor's inertia that can be seen.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from truth.plant import Axis, TwoStrandBelt

#: Rated torque, N m, inertia, kg m², top speed, 1/min, of servo motors; three times the rated torque at most, a fifth of the inertia more
#: for a gearbox.
MOTORS = ((0.32, 5e-6, 6000), (0.64, 25e-6, 6000), (1.27, 45e-6, 6000), (2.39, 130e-6, 5000), (5.4, 600e-6, 4500), (9.5, 1400e-6, 4000))
PEAK, GEARBOX_SHARE, COUPLING = 3.0, 0.2, 1.05
COUNTS = (2000, 4096, 8192, 10_000, 16_384, 65_536, 131_072, 1_048_576)
TORQUE_CONSTANT_NM_A, OFFSET_M, BEYOND_M = 0.6, 0.05, 0.2


@dataclass(frozen=True)
class DrawnAxis:
    """A machine, and what its papers say.

    axis : the truth.   sheet : axis.yaml, right to 5 % in the motor's inertia, 10 % in the pulley's, 20 % in the belt.   drive : of a plant
    file.   resonance_hz : in the middle of the travel.   travel_m : from 0 on.
    """

    axis: Axis
    sheet: dict[str, Any]
    drive: dict[str, float]
    resonance_hz: float
    travel_m: float


def draw_axis(seed: int, highest_hz: float = 200.0) -> DrawnAxis:
    """One axis whose motor swings on its belt at ``highest_hz`` at most."""
    random = np.random.default_rng(seed)
    while True:
        radius, gear = random.uniform(0.008, 0.025), float(random.choice([1, 1, 1, 3, 5, 10]))
        mass = float(np.exp(random.uniform(np.log(0.4), np.log(40.0))))
        rated, motor, rpm = MOTORS[random.integers(len(MOTORS))]
        ratio, pulley = radius / gear, 0.15 * radius**2 * random.uniform(0.2, 1.0) * (radius / 0.012) ** 2
        gearbox = GEARBOX_SHARE * motor if gear > 1.0 else 0.0
        inertia = COUPLING * motor + pulley / gear**2 + gearbox
        most = PEAK * rated * ratio / (inertia + mass * ratio**2)
        coulomb = random.uniform(0.03, 0.15) * rated
        stiffness = mass * (math.tau * float(np.exp(random.uniform(np.log(15.0), np.log(150.0))))) ** 2
        resonance = math.sqrt(stiffness * (ratio**2 / inertia + 1.0 / mass)) / math.tau
        if mass * ratio**2 > 0.1 * inertia and 4.0 < most < 80.0 and resonance < highest_hz and 5e3 < stiffness < 5e6:
            break
    travel = float(np.exp(random.uniform(np.log(0.3), np.log(3.0))))
    distance, middle = travel + BEYOND_M, OFFSET_M + 0.5 * travel
    specific = stiffness / (1.0 / middle + 1.0 / (2.0 * distance - middle))
    share, damping = random.uniform(0.3, 0.9), 2.0 * random.uniform(0.005, 0.03) * math.sqrt(stiffness * mass)
    top_rad_s = rpm * math.pi / 30.0
    viscous, counts = random.uniform(0.02, 0.1) * rated / top_rad_s, int(random.choice(COUNTS))
    axis = Axis(
        inertia_kg_m2=inertia,
        mass_kg=mass,
        transmission_m_rad=ratio,
        belt=TwoStrandBelt(specific, distance, OFFSET_M, damping),
        viscous_motor_nm_s_rad=viscous,
        coulomb_motor_nm=share * coulomb,
        coulomb_cart_n=(1.0 - share) * coulomb / ratio,
    )
    force = random.uniform(0.8, 1.5) * PEAK * rated / ratio * mass * ratio**2 / (inertia + mass * ratio**2) + coulomb / ratio
    sheet: dict[str, Any] = {
        "name": f"drawn {seed}",
        "motor": {
            "name": f"servo motor {rated} N m",
            "inertia_kg_m2": float(motor * random.uniform(0.95, 1.05)),
            "torque_constant_nm_a": TORQUE_CONSTANT_NM_A,
            "rated_torque_nm": rated,
            "peak_torque_nm": PEAK * rated,
            "encoder_counts_per_rev": counts,
        },
        "gearbox": {"ratio": gear, "inertia_kg_m2": float(gearbox * gear**2)},
        "coupling": {"inertia_kg_m2": (COUPLING - 1.0) * motor},
        "pulley": {"effective_radius_m": float(radius), "inertia_kg_m2": float(pulley * random.uniform(0.9, 1.1))},
        "belt": {"specific_stiffness_n": float(specific * random.uniform(0.85, 1.2)), "pulley_distance_m": float(distance)},
        "travel": {"min_m": 0.0, "max_m": travel, "driven_side_offset_m": OFFSET_M},
        "limits": {
            "speed_m_s": float(min(3.0, 0.9 * top_rad_s * ratio)),
            "acceleration_m_s2": float(min(50.0, most)),
            "feed_force_n": float(force),
        },
    }
    drive = {
        "setpoint_delay_s": 1e-3,
        "torque_noise_nm": 0.004 * rated,
        "counts_per_rev": counts,
        "rated_torque_nm": rated,
        "peak_torque_nm": PEAK * rated,
        "rated_current_a": rated / TORQUE_CONSTANT_NM_A,
        "max_speed_rpm": rpm,
    }
    return DrawnAxis(axis, sheet, drive, resonance, travel)
