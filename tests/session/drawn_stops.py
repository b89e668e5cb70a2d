"""Stops on drawn axes: on the independent simulator, with an axis, a drive and a knowledge of both that are drawn.

Drawn are mass, belt, friction and inertia of the machine, radius of its pulley, counts of its encoder, the SYNC period, dead time and lag
of the torque, and how far what is known of them is off: plan and machine share the feed force that the belt bears, and nothing else.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beltcomm.axis import Axis, load_axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.drive import Limits, Motion, Row, open_drive
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.model import Model
from beltcomm.rundata import analyse
from beltcomm.simulate.stopping import REACTION_PERIODS, braked_by_loop
from beltcomm.trajectory import plan_trajectory
from identify.records import true_model
from session.bench import LoggedPlant
from truth.rigs import Rig

AXIS = load_axis("egc-70-600")
PERIODS_S = (1e-3, 2e-3, 4e-3)
TOP_M_S = 1.3
#: Relative deviations of what a fit knows of an axis, standard: mass, belt, damping, friction; and of the torque's delay.
KNOWN = {"cart.mass": 0.01, "belt_stiffness.stiffness": 0.02, "belt_damping.damping": 0.2, "level": 0.05, "viscous.damping": 0.1}
DELAY_KNOWN = 0.05


@dataclass(frozen=True)
class Drawn:
    """A machine with its drive.   axis : as its file tells.   delay_s : from torque setpoint to torque, with all lags.

    options : of the virtual drive."""

    axis: Axis
    rig: Rig
    period_s: float
    delay_s: float
    options: dict[str, Any]

    @property
    def bears_n(self) -> float:
        """Feed force and the friction that the carriage brings along."""
        return (self.axis.limits.feed_force_n or 0.0) + self.rig.truth()["coulomb_cart_n"]


def drawn(draw: np.random.Generator) -> Drawn:
    """Any axis of a belt that bears the shipped axis' feed force."""
    mass, stiffness, radius = (float(one) for one in np.exp(draw.uniform(np.log([1.0, 5e4, 8e-3]), np.log([20.0, 4e5, 25e-3]))))
    inertia, damping, viscous, coulomb = (float(one) for one in draw.uniform([5e-5, 5.0, 5e-4, 0.05], [1.1e-4, 40.0, 4e-3, 0.2]))
    counts, period_s, dead_s = 2 ** int(draw.integers(13, 21)), float(draw.choice(PERIODS_S)), float(draw.uniform(3e-4, 3e-3))
    lag = {"setpoint_filter_s": float(draw.uniform(1e-4, 1e-3)), "current_loop_s": float(draw.uniform(8e-5, 5e-4))}
    options: dict[str, Any] = {"setpoint_delay_s": dead_s, "counts_per_rev": counts, **(lag if draw.random() < 0.5 else {})}
    sheet = 1.0 + 0.05 * float(draw.standard_normal())
    assert AXIS.pulley is not None
    own = replace(
        AXIS,
        motor=replace(AXIS.motor, inertia_kg_m2=sheet * inertia - 2.7e-5, encoder_counts_per_rev=counts),
        pulley=replace(AXIS.pulley, effective_radius_m=radius, teeth=None),
        belt=replace(AXIS.belt, specific_stiffness_n=0.27 * stiffness),
        limits=replace(AXIS.limits, pulley_torque_nm=100.0 * radius),
    )
    rig = Rig(inertia, mass, stiffness, damping, viscous, coulomb, radius)
    return Drawn(own, rig, period_s, dead_s + sum(lag.values() if "current_loop_s" in options else ()), options)


def as_known(model: Model, draw: np.random.Generator) -> Model:
    """A model as a fit of records finds it."""
    off = {name: next((share for end, share in KNOWN.items() if name.endswith(end)), 0.0) for name in model.parameters}
    return model.with_values({name: model[name] * float(np.exp(share * draw.standard_normal())) for name, share in off.items() if share})


class Enough(Exception):
    """Ends a motion as a Ctrl-C does."""


def out_of_acceleration(seed: int) -> tuple[Drawn, float, float]:
    """Force of the belt after a stop out of near full acceleration, N, and the one that was planned; the instant is drawn too."""
    draw = np.random.default_rng(seed)
    case = drawn(draw)
    plant = LoggedPlant(case.rig.plant())
    model, delay_s = as_known(true_model(plant.plant), draw), case.delay_s * float(1.0 + DELAY_KNOWN * draw.standard_normal())
    ratio = case.rig.transmission_m_rad
    with open_drive(
        "virtual:g_a", {"plant": plant, "start_position": 0.0, "seed": seed, "sample_period": case.period_s, **case.options}
    ) as drive:
        own = drive.capabilities
        loop = analyse.first_loop(model, own.structure, 0.0, delay_s, 0.0).cascade
        cascade = analyse.with_feedforward(loop, model, own.structure, delay_s)
        drive.write({name: value for name, value in cascade_to_parameters(cascade).items() if name in drive.backup()})
        braking, told = braked_by_loop(
            [model],
            cascade,
            case.axis,
            TOP_M_S,
            position_m=0.0,
            period_s=own.structure.period_s,
            reaction_s=REACTION_PERIODS * case.period_s,
            delay_s=delay_s,
            torque_limit_nm=3.1,
            counts_per_rev=own.counts_per_rev,
        )
        hard = braking.acceleration_m_s2
        limits = TrajectoryLimits(jerk_m_s3=10.0 * hard, acceleration_m_s2=hard, speed_m_s=TOP_M_S)
        path = plan_trajectory(0.0, 0.5, limits, case.period_s)
        acceleration = np.gradient(path.velocity_m_s, case.period_s)
        ends = int(draw.choice(np.flatnonzero(acceleration > 0.8 * acceleration.max())))
        rows: list[int] = []

        def sink(_row: Row) -> None:
            rows.append(len(plant.belt_force_n))
            if len(rows) > ends:
                raise Enough

        still = np.zeros(len(path.t_s))
        motion = Motion("position", case.period_s, path.position_m / ratio, path.velocity_m_s / ratio, still)
        with contextlib.suppress(Enough):
            drive.record(motion, Limits(-50.0, 100.0, 600.0, 3.1, braking.deceleration_m_s2 / ratio), sink)
    places, force = plant.cart_m(0, len(plant.torque_nm)), np.abs(plant.belt_force_n)
    braking_tick = rows[-1] + int(np.argmax(np.diff(places[rows[-1] :])))
    return case, float(force[braking_tick:].max()), told.belt_force_n
