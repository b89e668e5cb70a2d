"""The thesis's two identified rigs, random machines around them, and the same behind a gearbox.

Inertia, mass and stiffness: tables A.4, A.5.  Friction: table A.10, all of the viscous and 70 % of the Coulomb part at the
motor, 30 % at the carriage.  Belt damping: 20 N s/m, as in table A.11.  No end pulley, no gearbox: i_t = r = 12.42 mm.
"""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, fields, replace

import numpy as np

from truth.plant import Axis, ConstantBelt, TruthPlant

#: m/rad, table A.2: 78 mm feed per revolution.
TRANSMISSION_M_RAD = 0.01242
#: kg m², tables A.1 to A.3: motor and coupling, driving pulley.  Of a planetary gearbox, at its output; friction of its seals at the
#: motor, N m and N m s/rad: usual numbers of this size.
MOTOR_KG_M2, PULLEY_KG_M2, GEARBOX_KG_M2 = 48.10e-6, 23.63e-6, 60e-6
SEALS_NM, SEALS_NM_S_RAD = 0.010, 0.1e-3
#: Share of the Coulomb friction that acts at the motor.
MOTOR_SHARE = 0.7


@dataclass(frozen=True)
class Rig:
    """The parameters of a rig; inertia and friction at the motor shaft, mass, stiffness and damping along the belt.

    motor_share : of the Coulomb friction, at the motor; the rest acts at the carriage.
    """

    inertia_kg_m2: float
    mass_kg: float
    stiffness_n_m: float
    belt_damping_n_s_m: float
    viscous_nm_s_rad: float
    coulomb_total_nm: float
    transmission_m_rad: float = TRANSMISSION_M_RAD
    motor_share: float = MOTOR_SHARE

    def truth(self) -> dict[str, float]:
        """All values by name: the parameters, the friction of each side, resonance (2.44) and antiresonance (2.45) in Hz."""
        values = {f.name: float(getattr(self, f.name)) for f in fields(self)}
        reduced = 1.0 / (self.transmission_m_rad**2 / self.inertia_kg_m2 + 1.0 / self.mass_kg)
        return values | {
            "coulomb_motor_nm": self.motor_share * self.coulomb_total_nm,
            "coulomb_cart_n": (1.0 - self.motor_share) * self.coulomb_total_nm / self.transmission_m_rad,
            "resonance_hz": math.sqrt(self.stiffness_n_m / reduced) / (2.0 * math.pi),
            "antiresonance_hz": math.sqrt(self.stiffness_n_m / self.mass_kg) / (2.0 * math.pi),
        }

    def plant(self) -> TruthPlant:
        """The machine, at rest at position 0."""
        truth = self.truth()
        axis = Axis(
            inertia_kg_m2=self.inertia_kg_m2,
            mass_kg=self.mass_kg,
            transmission_m_rad=self.transmission_m_rad,
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
    names = [f.name for f in fields(rig) if f.default is MISSING]
    factors = rng.uniform(1.0 - spread, 1.0 + spread, len(names))
    return replace(rig, **{n: float(getattr(rig, n) * factor) for n, factor in zip(names, factors, strict=True)}).plant()


def geared(name: str, ratio: float) -> TruthPlant:
    """A rig with a gearbox between its motor, with the coupling on it, and its pulley; (2.7), (2.8), (2.16).

    What turns with the pulley, its own inertia, the gearbox's and all friction of the rig, counts at the motor by the ratio
    (torques) or its square (inertia, damping); the gearbox's seals brake the motor itself.  The carriage's friction stays.
    """
    rig = RIGS[name]
    coulomb = rig.coulomb_total_nm / ratio + SEALS_NM
    return replace(
        rig,
        inertia_kg_m2=MOTOR_KG_M2 + (PULLEY_KG_M2 + GEARBOX_KG_M2) / ratio**2,
        viscous_nm_s_rad=rig.viscous_nm_s_rad / ratio**2 + SEALS_NM_S_RAD,
        coulomb_total_nm=coulomb,
        transmission_m_rad=TRANSMISSION_M_RAD / ratio,
        motor_share=1.0 - (1.0 - MOTOR_SHARE) * rig.coulomb_total_nm / ratio / coulomb,
    ).plant()
