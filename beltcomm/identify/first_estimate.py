"""A first model from the data sheets, and a first estimate from a second of excitation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.identify.residual import evaluate, stretches, torque_noise
from beltcomm.model import Model, build_model
from beltcomm.recording import Recording

#: The effects that every belt axis gets; what else is needed is found by comparing with measurements.  Viscous friction of the
#: carriage is not among them: seen from the motor it differs from that of the motor only next to the antiresonance.
BASE_EFFECTS = ("belt_stiffness", "belt_damping", "viscous_motor", "coulomb_motor", "coulomb_cart")
#: kg: carriages between these are tried.  N/m: belts between these shares of the data sheet's stiffness are tried.
MASSES_KG = np.geomspace(0.1, 100.0, 25)
STIFFNESS_SHARES = np.geomspace(0.4, 2.5, 12)


def data_sheet_model(axis: Axis, position_m: float, coulomb_nm: float, tilt_rad: float = 0.0) -> Model:
    """The model before anything was measured: inertia, transmission and belt from data sheets, friction from a breakaway test.

    position_m : m, where the stiffness is taken.    coulomb_nm : N m at the motor, of motor and carriage together; the split is not
    known and set to 70 % at the motor.    Raises UsageError when the axis file lacks what the job needs.
    """
    axis.require("identify", "motor.inertia_kg_m2", "pulley.effective_radius_m", "belt.specific_stiffness_n", "belt.pulley_distance_m")
    ratio = axis.transmission_m_rad
    values = {
        "motor.inertia": axis.motor_side_inertia_kg_m2,
        "cart.mass": axis.payload.mass_kg or 2.0,
        "transmission.ratio": ratio,
        "belt_stiffness.stiffness": axis.belt_stiffness_n_m(position_m),
        "coulomb_motor.level": 0.7 * coulomb_nm,
        "coulomb_cart.level": 0.3 * coulomb_nm / ratio,
    }
    effects: tuple[str, ...] = BASE_EFFECTS
    if tilt_rad:
        effects, values = (*effects, "tilt"), {**values, "tilt.angle": tilt_rad}
    return build_model(axis.name, effects, values, origin="data sheet")


def first_estimate(recordings: Sequence[Recording], start: Model, counts_per_rev: int) -> Model:
    """Mass, stiffness and friction from a short excited record, found on a grid, so no start value can mislead it.

    For every mass and stiffness the torque equation is linear in the motor's Coulomb and viscous friction; the smallest rest wins.
    Raises DataError when the axis hardly moved.
    """
    noise = torque_noise(recordings)
    pieces = [p for r in recordings for p in stretches(r, start, 2.0 * np.pi / counts_per_rev, noise)]
    kept = sum(int(p.keep.sum()) for p in pieces)
    if kept < 100:
        raise DataError(
            f"the axis moved in only {kept} of {sum(len(p.keep) for p in pieces)} samples; raise the excitation or look for a brake"
        )
    friction = ("coulomb_motor.level", "viscous_motor.damping")
    stiffness = start["belt_stiffness.stiffness"]
    best, best_rest = start, np.inf
    for mass in MASSES_KG:
        for share in STIFFNESS_SHARES:
            trial = start.with_values({"cart.mass": float(mass), "belt_stiffness.stiffness": float(share * stiffness)})
            base = np.concatenate([evaluate(p, trial, trial.with_values(dict.fromkeys(friction, 0.0)).vector())[p.keep] for p in pieces])
            direction = np.concatenate([np.sign(p.motion.omega[:: p.motion.substeps])[p.keep] for p in pieces])
            speed = np.concatenate([p.motion.omega[:: p.motion.substeps][p.keep] for p in pieces])
            regressor = np.stack([direction, speed], axis=1)
            level, damping = np.maximum(np.linalg.lstsq(regressor, -base, rcond=None)[0], 0.0)
            rest = float(np.mean((base + regressor @ np.array([level, damping])) ** 2))
            if rest < best_rest:
                best_rest = rest
                found = dict(zip(friction, (float(level), float(damping)), strict=True))
                best = trial.with_values(found, "first estimate")
    return best
