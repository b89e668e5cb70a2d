"""The part of a model that the loop sees: bodies and springs for the margins, late torque as dead time; and what it does not see."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import UsageError
from beltcomm.model import Model
from beltcomm.model.linear import matrices, operating_point

#: Slots that move no pole of a loop on an axis in motion: forces by place or angle swing the torque, friction only damps, the torque
#: path and the sensor change gains by per cent.
OUTSIDE_THE_LOOP = frozenset(
    {"friction_level", "friction_onset", "torque_path", "torque_delay", "sensor", "kinematics", "belt_law", "load_of_record"}
)
#: What of these slots and of the forces stays, because the design counts with it by name.
BASE = frozenset({"viscous", "viscous_cart", "coulomb", "cart_friction"})
#: Delays that are counted as dead time: a lag of the first order has the phase of a dead time of its time constant, and less gain.
DELAYS = (("dead_time", "dead_time.time"), ("current_lag", "current_lag.time"))
#: rad/s: a load without compliance swings at this on a held motor, critically damped.
STIFF_RAD_S = 2.0 * math.pi * 2e4
#: rad/s: the linearisation is that of the axis in motion.
MOVING_RAD_S = 1.0


@dataclass(frozen=True)
class Bodies:
    """Equations of motion of more than motor and carriage:  M q'' + D q' + K q = (τ, 0, ..., 0), without friction.

    Attributes
    ----------
    names : tuple of str
        The driven one first.
    mass, damping, stiffness
        Rows, SI; motor in rad, others in m along the belt.
    """

    names: tuple[str, ...]
    mass: tuple[float, ...]
    damping: tuple[tuple[float, ...], ...]
    stiffness: tuple[tuple[float, ...], ...]

    def arrays(self) -> tuple[Array, Array, Array]:
        """M (n,), D (n, n), K (n, n)."""
        return np.array(self.mass), np.array(self.damping), np.array(self.stiffness)

    def with_carriage(self, mass_kg: float) -> Bodies:
        """Bodies with another mass of the carriage, springs and dampers as they were."""
        at = self.names.index("cart")
        return Bodies(self.names, (*self.mass[:at], mass_kg, *self.mass[at + 1 :]), self.damping, self.stiffness)

    def modes_rad_s(self) -> Array:
        """Undamped frequencies of the free axis and of the axis with its motor held, rad/s; (2n - 2,)."""
        mass, _, stiffness = self.arrays()
        scale = 1.0 / np.sqrt(mass)
        symmetric = stiffness * np.outer(scale, scale)
        free = np.sqrt(np.maximum(np.linalg.eigvalsh(symmetric)[1:], 0.0))
        held = np.sqrt(np.maximum(np.linalg.eigvalsh(symmetric[1:, 1:]), 0.0))
        return np.concatenate([free, held])


@dataclass(frozen=True)
class LoopModel:
    """Parameters of the plants of a design, at one place.

    inertia kg m², motor side; transmission m/rad; mass kg; stiffness N/m between motor and carriage, other bodies following without
    inertia; belt_damping N s/m.

    Attributes
    ----------
    bodies : Bodies or None
        None for motor and carriage alone.
    """

    inertia_kg_m2: float
    transmission_m_rad: float
    mass_kg: float
    stiffness_n_m: float
    belt_damping_ns_m: float
    bodies: Bodies | None


def _in_loop(model: Model) -> Model:
    """The model without the effects that move no pole; those of its base stay."""
    for effect in model.effect_list():
        outside = effect.slot in OUTSIDE_THE_LOOP or effect.slot == "force"
        if outside and effect.name not in BASE and effect.name in model.effects:
            model = model.without_effect(effect.name)
    return model


def loop_model(model: Model, position_m: float) -> LoopModel:
    """Bodies and springs of a model with the carriage there.

    Parameters
    ----------
    model : Model
        With motor and carriage, or rigid.
    position_m : float, m
        Carriage on the axis.

    Returns
    -------
    LoopModel
        Linear, while the axis moves.

    Raises
    ------
    UsageError
        For an axis without motor and carriage.
    """
    reduced = _in_loop(model)
    ratio = model["transmission.ratio"]
    if model.rigid:
        return _stiff(model)
    m = matrices(reduced, operating_point(reduced, position_m, MOVING_RAD_S))
    if m.bodies[:1] != ("motor",) or "cart" not in m.bodies:
        raise UsageError(f"model {model.name!r} has no motor and carriage, its bodies are {', '.join(m.bodies)}; no loop can be designed")
    cart = m.bodies.index("cart")
    compliance = float(np.linalg.inv(m.K[1:, 1:])[cart - 1, cart - 1])
    friction = np.zeros_like(m.D)
    for name, body in (("viscous.damping", 0), ("viscous_cart.damping", cart)):
        friction[body, body] = model.get(name)
    damping = m.D - friction
    bodies = None
    if m.bodies != ("motor", "cart"):
        bodies = Bodies(
            m.bodies,
            tuple(float(v) for v in np.diag(m.M)),
            tuple(tuple(map(float, row)) for row in damping),
            tuple(tuple(map(float, row)) for row in m.K),
        )
    return LoopModel(
        float(m.M[0, 0]),
        ratio,
        float(m.M[cart, cart]),
        1.0 / compliance,
        max(0.0, -float(m.D[0, cart]) / ratio),
        bodies,
    )


def _stiff(model: Model) -> LoopModel:
    """A rigid load as one on a spring and damper far above whatever a loop samples: its mode dies out within a sample."""
    inertia, mass, ratio = model["motor.inertia"], model["cart.mass"], model["transmission.ratio"]
    stiffness = mass * STIFF_RAD_S**2
    together = 1.0 / (1.0 / mass + ratio**2 / inertia)
    return LoopModel(inertia, ratio, mass, stiffness, 2.0 * math.sqrt(stiffness * together), None)


def late_s(model: Model) -> float:
    """Dead time that the model's own effects put between reported and acting torque.

    Parameters
    ----------
    model : Model
        With any effects.

    Returns
    -------
    float, s
        A negative one counts as 0.
    """
    return sum(max(0.0, model.get(name)) for effect, name in DELAYS if effect in model.effects)


def neglected_effects(model: Model) -> tuple[str, ...]:
    """Effects that the margins do not know although they change the belt's stiffness with its load.

    Parameters
    ----------
    model : Model
        With any effects.

    Returns
    -------
    tuple of str
        Names, of gaps and slack strands.
    """
    return tuple(e.name for e in model.effect_list() if e.slot == "belt_law")
