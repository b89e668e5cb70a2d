"""Smooth forces of a model from the laws themselves, and where it rests under them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from beltcomm.arrays import Array
from beltcomm.effects import DRIVING_BODY, DRIVING_END, Element, Point
from beltcomm.errors import Refused
from beltcomm.model import Model
from beltcomm.model.linear import acts_on, carriage_of, matrices, operating_point, stretch_of, values_of


@dataclass(frozen=True)
class Equilibrium:
    """The axis at rest under its smooth forces.

    Attributes
    ----------
    positions : ndarray (n,)
        rad or m, all bodies.
    torque_nm : float
        Holds it.
    """

    positions: Array
    torque_nm: float


def _smooth_forces(model: Model, positions: ArrayLike, speeds: ArrayLike, time_s: float = 0.0) -> Array:
    """Smooth forces on all bodies from the laws themselves, (n,), N m or N."""
    q, v = np.asarray(positions, dtype=float), np.asarray(speeds, dtype=float)
    names = tuple(body.name for _, body in model.bodies())
    i = carriage_of(names)
    x = float(q[i]) * (model["transmission.ratio"] if model.bodies()[i][1].rotary else 1.0)
    total = np.zeros(len(names))
    end = _DrivingEnd(model, q, v)
    for effect in model.effect_list():
        values = values_of(model, effect, x)
        if effect.slot == "force" and effect.law is not None:
            j, lever = acts_on(model, effect)
            total[j] += lever * effect.law(lever * float(q[j]), lever * float(v[j]), time_s, *values)
        for element in effect.elements:
            shape = end.shape(element)
            stretch, rate = end.seen(element, float(stretch_of(model, element) @ q), float(shape @ v))
            total -= shape * element.law(stretch, rate, x, *values)
    return total


class _DrivingEnd:
    """Driving end of the belt: run-out of the pulley, gap and slack change what an element sees."""

    def __init__(self, model: Model, q: Array, v: Array) -> None:
        self.model = model
        names = [body.name for _, body in model.bodies()]
        self.place = names.index(DRIVING_BODY) if DRIVING_BODY in names else 0
        self.gain, self.ahead = 1.0, 0.0
        for effect in model.effect_list():
            if effect.slot == "kinematics" and effect.law is not None and effect.slope is not None:
                values = values_of(model, effect, 0.0)
                self.gain += cast(float, effect.slope(float(q[self.place]), *values))
                self.ahead += model["transmission.ratio"] * effect.law(float(q[self.place]), *values)

    def shape(self, element: Element) -> Array:
        """g of :func:`stretch_of` with the lever arm at this angle."""
        shape = stretch_of(self.model, element)
        if DRIVING_END in element.ends:
            shape[self.place] *= self.gain
        return shape

    def seen(self, element: Element, stretch: float, rate: float) -> tuple[float, float]:
        """Stretch and rate that load the element."""
        if DRIVING_END not in element.ends:
            return stretch, rate
        sign = 1.0 if element.ends[0] == DRIVING_END else -1.0
        stretch += sign * self.ahead
        if element.ends != (DRIVING_END, "cart"):
            return stretch, rate
        for effect in self.model.effect_list():
            if effect.slot == "belt_law" and effect.law is not None and effect.slope is not None:
                values = values_of(self.model, effect, 0.0)
                rate *= cast(float, effect.slope(stretch, *values))
                stretch = effect.law(stretch, *values)
        return stretch, rate


def equilibrium(model: Model, position_m: float) -> Equilibrium:
    """Positions of all bodies and the holding torque when the carriage rests at ``position_m`` under the smooth forces.

    0 = f(q) + input · torque,   carriage at position_m   (friction is left out: it can only make holding easier)

    Parameters
    ----------
    model : Model
        With any number of bodies.
    position_m : float, m
        Carriage on the axis.

    Returns
    -------
    Equilibrium
        rad or m of each body, and N m at the motor shaft.

    Raises
    ------
    Refused
        When some body is not held by anything.
    """
    point = operating_point(model, position_m)
    linear = matrices(model, Point(position_m, 1.0, point.transmission_m_rad))
    bodies = model.bodies()
    fixed = carriage_of(linear.bodies)
    free = [i for i in range(len(bodies)) if i != fixed]
    q = np.array([position_m / point.transmission_m_rad if body.rotary else position_m for _, body in bodies])
    rest = np.zeros_like(q)
    jacobian = np.column_stack([-linear.K[:, free], linear.input])
    torque = 0.0
    for _ in range(3):  # elements are linear in their stretch: the first step solves, the others remove rounding
        residual = _smooth_forces(model, q, rest) + linear.input * torque
        try:
            step = np.linalg.solve(jacobian, -residual)
        except np.linalg.LinAlgError as error:
            raise Refused(f"model {model.name!r} cannot rest at {position_m:g} m: a body is connected to nothing") from error
        q[free] += step[:-1]
        torque += float(step[-1])
    return Equilibrium(q, torque)
