"""The model a diagnosis begins with: seven parameters of a belt axis, or one rigid inertia with friction where there is no belt."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from beltcomm.axis import Axis
from beltcomm.errors import DataError
from beltcomm.identify.first_estimate import first_estimate
from beltcomm.model import Model, build_model
from beltcomm.recording import Recording

#: J, m, c, d, d_m, d_c and the Coulomb friction of the motor: what every belt axis has.
BELT_BASE = ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb")
#: Without a belt: one inertia with friction.
RIGID_BASE = ("viscous", "coulomb")
#: Values where the axis file says nothing.
USUAL = {"belt_stiffness.stiffness": 2e5, "cart.mass": 4.0, "motor.inertia": 7e-5}
#: rad: an excitation that moves the motor less than this shows no carriage.
LEAST_MOTION_RAD = 0.05


def start_model(axis: Axis, recordings: Sequence[Recording]) -> Model:
    """The base model with start values found from the records to be fitted.   Raises DataError when none can be used."""
    usable = [r for r in recordings if not (r.is_static_map or r.sidecar.held_out)]
    if not usable:
        raise DataError("no recording is left to fit: all are held out or static maps")
    if not is_belt_axis(axis, usable):
        return rigid_start(axis, usable)
    ratio = axis.transmission_m_rad
    middle = float(np.median([r.sidecar.start_position_m or 0.0 for r in usable]))
    known_belt = axis.get("belt.specific_stiffness_n") is not None and axis.get("belt.pulley_distance_m") is not None
    values = {
        "motor.inertia": axis.motor_side_inertia_kg_m2 if axis.get("motor.inertia_kg_m2") else USUAL["motor.inertia"],
        "cart.mass": axis.payload.mass_kg or USUAL["cart.mass"],
        "belt_stiffness.stiffness": axis.belt_stiffness_n_m(middle) if known_belt else USUAL["belt_stiffness.stiffness"],
        "transmission.ratio": ratio,
        "coulomb.level": 0.1,
    }
    sheet = build_model(axis.name, (*BELT_BASE, "cart_friction"), values, origin="data sheet")
    excited = [r for r in usable if r.sidecar.experiment == "frf"] or usable
    loudest = max(excited, key=lambda r: float(np.std(r.torque)) * np.sqrt(len(r.t_s)))
    counts = axis.get("motor.encoder_counts_per_rev") or 65536
    found = first_estimate([loudest], sheet, int(counts))
    friction = found["coulomb.level"] + ratio * found["cart_friction.level"]
    return found.without_effect("cart_friction").with_values({"coulomb.level": friction}, "first estimate")


def is_belt_axis(axis: Axis, recordings: Sequence[Recording]) -> bool:
    """Whether the records are taken at a motor that drives a belt."""
    return axis.get("pulley.effective_radius_m") is not None and all(r.side == "motor" for r in recordings)


def rigid_start(axis: Axis, recordings: Sequence[Recording]) -> Model:
    """Inertia, viscous and Coulomb friction by least squares over all records; N m and rad, or N and m, or A and rad."""
    if len({record.side for record in recordings}) > 1:
        raise DataError("the recordings of this run are taken on different sides (motor, load, ampere); put them into runs of their own")
    left, right = [], []
    for record in recordings:
        omega = np.gradient(record.position, record.t_s)
        width = max(1, round(0.01 / record.sample_period_s))
        smooth = np.convolve(omega, np.ones(width) / width, mode="same")
        acceleration = np.gradient(smooth, record.t_s)
        moving = np.abs(smooth) > 0.02 * np.abs(smooth).max()
        left.append(np.stack([acceleration, smooth, np.sign(smooth)], axis=1)[moving])
        right.append(record.torque[moving])
    inertia, viscous, coulomb = np.linalg.lstsq(np.concatenate(left), np.concatenate(right), rcond=None)[0]
    sheet = axis.get("motor.inertia_kg_m2") if recordings[0].side == "motor" else None
    values = {
        "motor.inertia": float(inertia) if inertia > 0.0 else float(sheet or USUAL["motor.inertia"]),
        "viscous.damping": max(float(viscous), 0.0),
        "coulomb.level": max(float(coulomb), 0.0),
        "transmission.ratio": 1.0,
    }
    return build_model(axis.name, RIGID_BASE, values, base_bodies=("motor",), origin="data sheet", side=recordings[0].side)
