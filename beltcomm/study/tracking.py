"""One design on one axis of a population: tracking error of the move and margins, from values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import Cascade
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.loops import sample_plants
from beltcomm.design.margins import margins_on
from beltcomm.errors import Refused
from beltcomm.model import Model
from beltcomm.study.population import DrawnAxis
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop, predict_move, tracking_error

#: Grid points per plant: a margin is off by less than 0.1 deg or 0.2 dB.
POINTS = 500


@dataclass(frozen=True)
class Targets:
    """Targets of the move at the motor, m."""

    dynamic_m: float
    static_m: float


@dataclass(frozen=True)
class SharedInput:
    """Input that all members share.

    Attributes
    ----------
    model : Model
        Of the base.
    cascade : Cascade
        The design on trial.
    loop : Loop
        What the drive adds, with the base's delay.
    move : Trajectory
        With its rest.
    along_nm : ndarray or None
        Torque sent along with the move, (n,), or None.
    plants : callable
        Of model, places, carriage masses, delay and the apparent damping, every variant that margins are asked for.
    travel_m : tuple of float, of the carriage
    """

    model: Model
    cascade: Cascade
    loop: Loop
    move: Trajectory
    along_nm: Array | None
    apparent_damping_nm_s_rad: float
    plants: Callable[[Model, Sequence[float], Sequence[float], float, float], list[DesignPlant]]
    targets: Targets
    travel_m: tuple[float, float] = (-math.inf, math.inf)

    @property
    def start_m(self) -> float:
        """Start of the base's move, m."""
        return float(self.move.position_m[0])


def track(ground: SharedInput, axis: DrawnAxis) -> dict[str, Any]:
    """Predicted errors, forces and worst margins of the design on this axis.

    Keys end in their unit; ``*_cart`` at the carriage; margins are the worst of both ends of the move and every damping down to none.
    passed : both targets kept, and every loop stable.

    Parameters
    ----------
    ground : SharedInput
        What all members share.
    axis : DrawnAxis
        Of the member.

    Raises
    ------
    Refused
        Where the move leaves the travel, or the carriage what the model describes.
    """
    moved = _replace_start(ground.move, axis.start_m)
    first, last = float(moved.position_m.min()), float(moved.position_m.max())
    if first < ground.travel_m[0] or last > ground.travel_m[1]:
        raise Refused(
            f"the move would go from {first:.4g} m to {last:.4g} m, the travel is {ground.travel_m[0]:g}..{ground.travel_m[1]:g} m; "
            "let move.from end earlier, or give a shorter move"
        )
    period = ground.loop.structure.period_s
    variants = ground.plants(
        axis.model,
        sorted({axis.start_m, axis.start_m + float(ground.move.position_m[-1]) - ground.start_m}),
        [axis.model["cart.mass"]],
        axis.delay_s,
        ground.apparent_damping_nm_s_rad,
    )
    plants = list({replace(plant, name=""): plant for plant in variants}.values())
    margins = margins_on(ground.cascade, sample_plants(plants, period, POINTS))
    stable = all(one.stable and one.velocity_stable for one in margins)
    found: dict[str, Any] = {
        "stable": stable,
        "phase_margin_deg": min(one.phase_margin_deg for one in margins),
        "position_phase_margin_deg": min(one.position_phase_margin_deg for one in margins),
        "gain_margin_db": min(one.least_gain_margin_db for one in margins),
        "sensitivity_db": max(one.most_sensitivity_db for one in margins),
    }
    path = predict_move(axis.model, ground.cascade, moved, replace(ground.loop, delay_s=axis.delay_s), extra_torque_nm=ground.along_nm)
    motor = tracking_error(path.t_s, moved.position_m, path.motor_m)
    cart = tracking_error(path.t_s, moved.position_m, path.cart_m)
    kept = motor.dynamic_m <= ground.targets.dynamic_m and motor.static_m <= ground.targets.static_m
    return {
        "passed": bool(kept and stable),
        "dynamic_m": motor.dynamic_m,
        "static_m": motor.static_m,
        "dynamic_cart_m": cart.dynamic_m,
        "static_cart_m": cart.static_m,
        "torque_nm": float(np.abs(path.torque_nm).max()),
        "belt_force_n": path.belt_force_n,
        "saturated": list(path.saturated),
        **found,
    }


def _replace_start(move: Trajectory, start_m: float) -> Trajectory:
    """Motion shifted to another place."""
    shift = start_m - float(move.position_m[0])
    return replace(move, position_m=move.position_m + shift) if shift else move
