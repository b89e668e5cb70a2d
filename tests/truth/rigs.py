"""The thesis's two identified rigs, and random machines around them.

Inertia, mass and stiffness: tables A.4, A.5.  Friction: table A.10, all of the viscous and 70 % of the Coulomb part at the
motor, 30 % at the carriage.  Belt damping: 20 N s/m, as in table A.11.  No end pulley, no gearbox: i_t = r = 12.42 mm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from truth.plant import Axis, ConstantBelt, TruthPlant

#: m/rad, table A.2: 78 mm feed per revolution.
TRANSMISSION_M_RAD = 0.01242
#: Share of the Coulomb friction that acts at the motor.
MOTOR_SHARE = 0.7


@dataclass(frozen=True)
class Rig:
    """The six independent parameters of a rig; friction at the motor shaft, mass, stiffness and damping along the belt."""

    inertia_kg_m2: float
    mass_kg: float
    stiffness_n_m: float
    belt_damping_n_s_m: float
    viscous_nm_s_rad: float
    coulomb_total_nm: float

    def truth(self) -> dict[str, float]:
        """All values by name: the parameters, the friction of each side, resonance (2.44) and antiresonance (2.45) in Hz."""
        values = {f.name: float(getattr(self, f.name)) for f in fields(self)}
        reduced = 1.0 / (TRANSMISSION_M_RAD**2 / self.inertia_kg_m2 + 1.0 / self.mass_kg)
        return values | {
            "coulomb_motor_nm": MOTOR_SHARE * self.coulomb_total_nm,
            "coulomb_cart_n": (1.0 - MOTOR_SHARE) * self.coulomb_total_nm / TRANSMISSION_M_RAD,
            "resonance_hz": math.sqrt(self.stiffness_n_m / reduced) / (2.0 * math.pi),
            "antiresonance_hz": math.sqrt(self.stiffness_n_m / self.mass_kg) / (2.0 * math.pi),
        }

    def plant(self) -> TruthPlant:
        """The machine, at rest at position 0."""
        truth = self.truth()
        axis = Axis(
            inertia_kg_m2=self.inertia_kg_m2,
            mass_kg=self.mass_kg,
            transmission_m_rad=TRANSMISSION_M_RAD,
            belt=ConstantBelt(self.stiffness_n_m, self.belt_damping_n_s_m),
            viscous_motor_nm_s_rad=self.viscous_nm_s_rad,
            coulomb_motor_nm=truth["coulomb_motor_nm"],
            coulomb_cart_n=truth["coulomb_cart_n"],
        )
        return TruthPlant(axis, truth=truth)


RIGS = {
    "g_a": Rig(71.73e-6, 13.44, 203.74e3, 20.0, 2.530e-3, 0.125),
    "g_b": Rig(71.73e-6, 0.96, 222.39e3, 20.0, 2.230e-3, 0.115),
}


def nominal(name: str) -> TruthPlant:
    """The rig ``g_a`` or ``g_b`` as the thesis has it.   Raises KeyError for another name."""
    return RIGS[name].plant()


def draw(name: str, rng: np.random.Generator, spread: float = 0.2) -> TruthPlant:
    """A random machine around a rig: every parameter independently uniform within ``1 - spread`` to ``1 + spread``.

    Raises KeyError for an unknown rig.
    """
    rig = RIGS[name]
    factors = rng.uniform(1.0 - spread, 1.0 + spread, len(fields(rig)))
    values = {f.name: float(getattr(rig, f.name) * factor) for f, factor in zip(fields(rig), factors, strict=True)}
    return Rig(**values).plant()
