"""What an effect is: one physical law, the slot it fills, its parameters, and what a technician should know of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

Slot = Literal["torque_path", "friction_level", "force", "element", "kinematics", "sensor", "body"]
Side = Literal["motor", "cart", "belt", "drive"]
Law = Callable[..., float]

#: Body that the belt's driven end is fixed to: ``DRIVING_BODY`` where a coupling splits it off, else the first body.
DRIVING_END = "driving_end"
DRIVING_BODY = "driving_pulley"


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect or body.

    unit : SI.     side : where it is meant: "motor" (motor shaft), "cart" (carriage), "belt" (at the belt line), "drive".
    start : value used when an effect is added without knowledge.     low, high : physical bounds.
    """

    name: str
    unit: str
    side: Side
    start: float
    low: float
    high: float
    meaning: str


@dataclass(frozen=True)
class Body:
    """A moving mass with its inertia parameter; ``rotary`` bodies move in rad at the motor shaft, others in m."""

    name: str
    inertia: Parameter
    rotary: bool = False


@dataclass(frozen=True)
class Element:
    """A massless connection of two bodies: ``force = law(stretch, rate, x, *own parameters)``.

    stretch = coordinate of ``ends[0]`` minus that of ``ends[1]``; a positive force pulls the first body back and the second
    one on.  Coordinates are m along the belt, or rad at the motor shaft when ``angular``.    x : m, carriage on the axis.
    slope : ``(x, *own parameters) -> (stiffness, damping)``, N/m and N s/m (N m/rad and N m s/rad when angular).
    """

    ends: tuple[str, str]
    law: Law
    slope: Callable[..., tuple[float, float]]
    angular: bool = False


@dataclass(frozen=True)
class Point:
    """Operating point of a linearisation.  ``speed`` of the named bodies, in rad/s or m/s; 0 means standstill.

    position_m : m, carriage on the axis.     time_s : s, session clock.
    """

    position_m: float
    motor_speed_rad_s: float
    transmission_m_rad: float
    time_s: float = 0.0

    def speed(self, rotary: bool) -> float:
        """Speed in the coordinate of a body: rad/s at the motor shaft, or m/s along the belt."""
        return self.motor_speed_rad_s if rotary else self.motor_speed_rad_s * self.transmission_m_rad


@dataclass(frozen=True)
class Effect:
    """One physical effect.

    name : unique.     slot : see docs/effects.md.     law : the law of the slot as a function of plain floats that numba can
    compile; own parameters follow the slot's arguments, then the values of ``uses`` (full names of other parameters).
    body : the body a force or a friction level acts on.     elements, bodies : what an element or body effect brings.
    slope : linearisation; for ``force``: (position, speed, t, *p) -> (d force/d position, d force/d speed); for
    ``friction_level``: (speed, position, t, *p) -> d level/d speed.
    group : effects of one group exclude each other.     seen, check : for the technician.     source : origin of the law.
    """

    name: str
    slot: Slot
    title: str
    parameters: tuple[Parameter, ...]
    seen: str
    check: str
    source: str
    law: Law | None = None
    slope: Callable[..., object] | None = None
    body: str = ""
    uses: tuple[str, ...] = ()
    elements: tuple[Element, ...] = ()
    bodies: tuple[Body, ...] = ()
    group: str = ""
    needs: Mapping[str, str] = field(default_factory=dict)

    def full_names(self) -> tuple[str, ...]:
        """Names of its own parameters as they stand in a model: ``effect.parameter``."""
        return tuple(f"{self.name}.{p.name}" for p in self.parameters)


def body_units(body: str) -> tuple[str, str, Side]:
    """Units of force and of viscous friction on a body, and its side: N m, N m s/rad at the motor; N, N s/m elsewhere."""
    return ("N m", "N m s/rad", "motor") if body == "motor" else ("N", "N s/m", "cart" if body == "cart" else "belt")
