"""Machines: random healthy axes, and what their data sheets say.  Two families are drawn here, the others in ``families``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from truth.hidden import layout as at
from truth.hidden.instruments import Instruments
from truth.hidden.layout import Array

#: m, way over which the friction of any real machine builds up (micro-slip).
MICRO_SLIP_M = 1.3e-6
TEETH = 26
PEAK_TORQUE_NM = 3.1
RATED_TORQUE_NM = 1.43
FAMILIES = ("sheet", "rig")


@dataclass(frozen=True)
class Scale:
    """Size of a machine over that of the method sheet's, for the session and the effects.

    torque, force, speed : of the motor, of the belt, of the carriage.   length : of short strokes and of bristles (the motor turns
    by the same angle).   width : of what changes with the place.   sweep_m : longest stroke of a friction sweep.
    acceleration : of the largest that is asked for.
    """

    torque: float = 1.0
    force: float = 1.0
    speed: float = 1.0
    length: float = 1.0
    width: float = 1.0
    sweep_m: float = math.inf
    acceleration: float = 1.0


@dataclass(frozen=True)
class Base:
    """A healthy machine.   Friction at the motor shaft, drag at the carriage, stiffness and damping along the belt.

    radius_m : carriage travel per radian of the motor; the pulley's radius is ``gear`` times that.   teeth : of the pulley.
    counts_per_rev : None for counts of 2.5 um at the belt.   Without a belt the "travel" is the motor's angle, rad (radius 1).
    """

    family: str
    inertia_kg_m2: float
    mass_kg: float
    stiffness_n_m: float
    belt_damping_n_s_m: float
    viscous_nm_s_rad: float
    drag_n_s_m: float
    coulomb_nm: float
    radius_m: float
    micro_slip_m: float
    micro_damping: float
    torque_noise_nm: float
    stroke_m: float
    pulley_distance_m: float
    driven_side_offset_m: float
    belt_force_limit_n: float
    rated_torque_nm: float = RATED_TORQUE_NM
    peak_torque_nm: float = PEAK_TORQUE_NM
    gear: float = 1.0
    teeth: int = TEETH
    counts_per_rev: int | None = None
    scale: Scale = field(default_factory=Scale)

    @property
    def rigid(self) -> bool:
        """Whether the axis has no belt."""
        return self.stiffness_n_m == 0.0

    @property
    def quantum_rad(self) -> float:
        """One encoder count."""
        return 2.5e-6 / self.radius_m if self.counts_per_rev is None else math.tau / self.counts_per_rev

    @property
    def rigid_inertia_kg_m2(self) -> float:
        """Inertia of everything at the motor shaft."""
        return self.inertia_kg_m2 + self.mass_kg * self.radius_m**2

    @property
    def reduced_mass_kg(self) -> float:
        """Mass that swings in the resonance: motor and carriage against each other."""
        return 1.0 / (self.radius_m**2 / self.inertia_kg_m2 + 1.0 / self.mass_kg)

    @property
    def resonance_hz(self) -> float:
        """Both ends free; of a belt axis."""
        return math.sqrt(self.stiffness_n_m / self.reduced_mass_kg) / math.tau

    @property
    def antiresonance_hz(self) -> float:
        """Motor held; of a belt axis."""
        return math.sqrt(self.stiffness_n_m / self.mass_kg) / math.tau

    def vector(self) -> Array:
        """The parameter vector of the kernel, without any effect."""
        p = np.zeros(at.PARAMETERS)
        p[at.J], p[at.M], p[at.LEVER] = self.inertia_kg_m2, self.mass_kg, self.radius_m
        p[at.VISCOUS], p[at.DRAG], p[at.COULOMB] = self.viscous_nm_s_rad, self.drag_n_s_m, self.coulomb_nm
        p[at.PULLEY_TURNS] = 1.0 / self.gear
        if self.rigid:  # a carriage of no weight stands beside the motor, tied by nothing
            p[at.M] = NO_MASS_KG
            set_spans(p, NO_STIFFNESS_N_M, NO_STIFFNESS_N_M, 0.5)
        else:
            set_spans(p, self.stiffness_n_m, self.belt_damping_n_s_m, 0.5)
        set_micro_slip(p, self, self.micro_slip_m, self.micro_damping)
        return p


#: Carriage of an axis without a belt: no division by zero, and less than 1e-9 of any motor's inertia.
NO_MASS_KG, NO_STIFFNESS_N_M = 1e-15, 1e-30


def set_spans(p: Array, stiffness: float, damping: float, return_share: float, idler_at: float = 0.5) -> None:
    """Divide the belt: ``return_share`` of the stiffness goes around the idler, in two springs of which the one at the
    carriage has ``idler_at`` of the compliance.  The whole stays ``stiffness`` and ``damping`` for an idler without mass.
    """
    p[at.K1], p[at.D1] = (1.0 - return_share) * stiffness, (1.0 - return_share) * damping
    p[at.K2], p[at.D2] = return_share * stiffness / idler_at, return_share * damping / idler_at
    p[at.K3], p[at.D3] = return_share * stiffness / (1.0 - idler_at), return_share * damping / (1.0 - idler_at)


def set_micro_slip(p: Array, base: Base, way_m: float, damping_ratio: float) -> None:
    """LuGre bristle of the motor: transition way at the belt (m), and micro-damping by the ratio of the sticking motor."""
    p[at.BRISTLE] = base.coulomb_nm * base.radius_m / way_m
    p[at.MICRO] = 2.0 * damping_ratio * math.sqrt(p[at.BRISTLE] * base.inertia_kg_m2)
    p[at.MICRO_SPEED] = 0.5  # rad/s, above it the micro-damping fades: the bristle stays passive (Olsson, Astrom 1998)


def draw_base(rng: np.random.Generator, family: str) -> Base:
    """A random healthy machine: ``sheet`` (section 6 of the method sheet, 1 m stroke) or ``rig`` (around the EGC-70-600).

    Raises ValueError for another family.
    """
    if family not in FAMILIES:
        raise ValueError(f"family {family!r} is not one of {', '.join(FAMILIES)}")
    u = rng.uniform
    common = {
        "family": family,
        "micro_slip_m": MICRO_SLIP_M * u(0.8, 1.25),
        "micro_damping": u(0.01, 0.04),
        "torque_noise_nm": u(6e-3, 15e-3),
        "drag_n_s_m": u(3.0, 15.0),
    }
    if family == "sheet":
        inertia, mass, stiffness, radius = u(6e-5, 9e-5), 13.0 ** u(0.0, 1.0), u(1.6e5, 2.4e5), round(0.0125 * u(0.99, 1.01), 7)
        reduced = 1.0 / (radius**2 / inertia + 1.0 / mass)
        damping = 2.0 * u(0.015, 0.04) * math.sqrt(stiffness * reduced)
        places = {"stroke_m": 1.0, "pulley_distance_m": 1.25, "driven_side_offset_m": 0.12, "belt_force_limit_n": 1200.0}
        friction = {"viscous_nm_s_rad": u(0.5e-3, 2.5e-3), "coulomb_nm": u(0.08, 0.16)}
    else:
        inertia, mass, stiffness, radius = 71.73e-6 * u(0.9, 1.1), 0.96 * 14.0 ** u(0.0, 1.0), 2.12e5 * u(0.9, 1.1), 0.01242
        damping = u(12.0, 28.0)
        places = {"stroke_m": 0.57, "pulley_distance_m": 0.79, "driven_side_offset_m": 0.05, "belt_force_limit_n": 100.0}
        friction = {"viscous_nm_s_rad": u(1.5e-3, 3.0e-3), "coulomb_nm": u(0.09, 0.15)}
    return Base(
        inertia_kg_m2=inertia,
        mass_kg=mass,
        stiffness_n_m=stiffness,
        belt_damping_n_s_m=damping,
        radius_m=radius,
        **friction,
        **places,
        **common,
    )


def data_sheet(base: Base, rng: np.random.Generator) -> dict[str, Any]:
    """``axis.yaml`` of the machine: inertia within +-10 % of the truth, belt stiffness by its length within +-15 %."""
    inertia = base.inertia_kg_m2 * rng.uniform(0.9, 1.1)
    l1 = base.driven_side_offset_m + 0.5 * base.stroke_m
    per_length = 1.0 / l1 + 1.0 / (2.0 * base.pulley_distance_m - l1)
    specific = base.stiffness_n_m / per_length * rng.uniform(0.87, 1.15)
    rig = base.family == "rig"
    sheet: dict[str, Any] = {
        "name": "EGC-70-600" if rig else "toothed-belt axis, 1 m",
        "motor": {
            "inertia_kg_m2": 0.626 * inertia,
            "torque_constant_nm_a": 0.65,
            "rated_torque_nm": 1.43,
            "peak_torque_nm": PEAK_TORQUE_NM,
            "encoder_counts_per_rev": round(math.tau / base.quantum_rad),
        },
        "coupling": {"inertia_kg_m2": 0.045 * inertia},
        "pulley": {"effective_radius_m": base.radius_m, "inertia_kg_m2": 0.329 * inertia, "teeth": TEETH},
        "belt": {"specific_stiffness_n": specific, "pitch_m": 0.003, "pulley_distance_m": base.pulley_distance_m},
        "travel": {"min_m": -0.01, "max_m": base.stroke_m, "driven_side_offset_m": base.driven_side_offset_m},
        "limits": {"speed_m_s": 5.0 if rig else 3.0, "acceleration_m_s2": 50.0, "feed_force_n": base.belt_force_limit_n},
        "mounting": {"tilt_deg": 0.0},
    }
    if rig:
        sheet["limits"]["pulley_torque_nm"] = 1.24
        sheet["belt"]["preload_n"] = 105.0
    for part in sheet.values():
        if isinstance(part, dict):
            part |= {key: float(f"{value:.6g}") for key, value in part.items() if isinstance(value, float)}
    return sheet


@dataclass(frozen=True)
class Machine:
    """A virtual axis with what is hidden in it.

    effects : names, empty for a healthy machine.   strength : 0.1 to 1.   hidden : parameters by effect, in the units of
    their names.   p, bursts : for the kernel.   sheet : axis.yaml.   seed : of the draw, also of its noise.
    instruments : how it is driven and read.
    """

    seed: int
    base: Base
    effects: tuple[str, ...]
    strength: float
    hidden: Mapping[str, Mapping[str, Any]]
    p: Array
    sheet: Mapping[str, Any]
    bursts: Array = field(default_factory=lambda: np.zeros((0, 3)))
    instruments: Instruments = field(default_factory=Instruments)

    @property
    def moved_mass_kg(self) -> float:
        """Everything that the belt moves, kg: known to whoever commissions the axis from its first move."""
        return float(self.p[at.M] + self.p[at.M2] + self.p[at.ME])

    @property
    def rigid_inertia_kg_m2(self) -> float:
        """Inertia of everything at the motor shaft."""
        return self.base.inertia_kg_m2 + self.moved_mass_kg * self.base.radius_m**2

    def rng(self, purpose: int) -> np.random.Generator:
        """Random numbers of their own for every purpose; equal for equal seeds, whatever effects are drawn."""
        return np.random.default_rng((self.seed, purpose))
