"""The thesis's transfer functions of the two-mass model, (2.38) to (2.49), and its characteristic numbers.

Damping: d_m and d_c are in N s/m at the belt here, as the coefficients (2.38b) to (2.43) need (thesis errata 1).  A model
stores d_m in N m s/rad at the motor; :func:`two_mass` converts:  d_m[N s/m] = d_m[N m s/rad] / i_t².
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from beltcomm.arrays import ComplexArray
from beltcomm.effects import Point
from beltcomm.errors import UsageError
from beltcomm.model import Model
from beltcomm.model.linear import Standstill, matrices


@dataclass(frozen=True)
class TransferFunction:
    """G(s) = num(s)/den(s).

    Attributes
    ----------
    num, den : tuple of float
        Coefficients in descending powers of s.
    """

    num: tuple[float, ...]
    den: tuple[float, ...]

    def response(self, freq_hz: ArrayLike) -> ComplexArray:
        """G(j2πf).

        Parameters
        ----------
        freq_hz : ArrayLike, (m,)
            Not at a pole.

        Returns
        -------
        ndarray (m,) of complex
        """
        s = 2j * np.pi * np.atleast_1d(np.asarray(freq_hz, dtype=float))
        result: ComplexArray = np.polyval(self.num, s) / np.polyval(self.den, s)
        return result


@dataclass(frozen=True)
class TwoMass:
    """Parameters of the linear two-mass model (2.25), friction viscous.

    Attributes
    ----------
    inertia_kg_m2 : float
        Θ_e, kg m² at the motor shaft.
    mass_kg : float
        m_c, kg.
    stiffness_n_m : float
        c, N/m at the belt.
    motor_damping_n_s_m, cart_damping_n_s_m : float
        d_m, d_c, N s/m, **both at the belt**.
    belt_damping_n_s_m : float
        d, N s/m.
    transmission_m_rad : float
        i_t, m/rad.
    """

    inertia_kg_m2: float
    mass_kg: float
    stiffness_n_m: float
    motor_damping_n_s_m: float
    cart_damping_n_s_m: float
    belt_damping_n_s_m: float
    transmission_m_rad: float

    @property
    def resonance_hz(self) -> float:
        """f_r = √(c (Θ_e + i_t² m_c)/(Θ_e m_c))/2π, undamped.   Source: (2.44)."""
        return math.sqrt(self.stiffness_n_m * self._total / (self.inertia_kg_m2 * self.mass_kg)) / (2.0 * math.pi)

    @property
    def antiresonance_hz(self) -> float:
        """f_z = √(c/m_c)/2π, undamped.   Source: (2.45)."""
        return math.sqrt(self.stiffness_n_m / self.mass_kg) / (2.0 * math.pi)

    @property
    def inertia_ratio(self) -> float:
        """κ = i_t² m_c/Θ_e.   Source: (2.46)."""
        return self._it2 * self.mass_kg / self.inertia_kg_m2

    @property
    def _it2(self) -> float:
        return self.transmission_m_rad**2

    @property
    def _total(self) -> float:
        """Θ_e + i_t² m_c, kg m² at the motor shaft."""
        return self.inertia_kg_m2 + self._it2 * self.mass_kg

    @property
    def _rigid_damping(self) -> float:
        """i_t² (d_m + d_c), N m s/rad at the motor shaft."""
        return self._it2 * (self.motor_damping_n_s_m + self.cart_damping_n_s_m)

    @property
    def _flexible_damping(self) -> float:
        """i_t² m_c d_m + Θ_e d_c, the coefficient (2.39g)."""
        return self._it2 * self.mass_kg * self.motor_damping_n_s_m + self.inertia_kg_m2 * self.cart_damping_n_s_m

    def torque_to_angle(self) -> TransferFunction:
        """Motor torque to motor angle, rad/(N m), with belt damper.   Source: (2.38)."""
        d, dm, dc = self.belt_damping_n_s_m, self.motor_damping_n_s_m, self.cart_damping_n_s_m
        a1 = self._it2 * self.stiffness_n_m * (dc + dm)
        a2 = self.stiffness_n_m * self._total + self._it2 * (d * dm + d * dc + dm * dc)
        a3 = self._it2 * self.mass_kg * (d + dm) + self.inertia_kg_m2 * (d + dc)
        a4 = self.mass_kg * self.inertia_kg_m2
        return TransferFunction((self.mass_kg, d + dc, self.stiffness_n_m), (a4, a3, a2, a1, 0.0))

    def torque_to_angle_without_belt_damper(self) -> TransferFunction:
        """Motor torque to motor angle, rad/(N m), belt damper left out.   Source: (2.39)."""
        return replace(self, belt_damping_n_s_m=0.0).torque_to_angle()

    def low_frequency(self) -> TransferFunction:
        """Approximation below the resonance, rad/(N m).   Source: (2.40)."""
        c = self.stiffness_n_m
        num = (self.mass_kg / c, self.cart_damping_n_s_m / c, 1.0)
        return TransferFunction(num, (self._total, self._rigid_damping, 0.0))

    def high_frequency(self) -> TransferFunction:
        """Approximation around the resonance and above, rad/(N m).   Source: (2.41)."""
        flexible = (self.mass_kg * self.inertia_kg_m2, self._flexible_damping, self.stiffness_n_m * self._total)
        return TransferFunction((self.mass_kg,), flexible)

    def product_form(self) -> TransferFunction:
        """Rigid times flexible part, rad/(N m): the form that the thesis fits; approximates (2.39).   Source: (2.42)."""
        flexible = (self.mass_kg * self.inertia_kg_m2, self._flexible_damping, self.stiffness_n_m * self._total)
        den = np.polymul((1.0, self._rigid_damping / self._total, 0.0), flexible)
        num = (self.mass_kg, self.cart_damping_n_s_m, self.stiffness_n_m)
        return TransferFunction(num, tuple(float(a) for a in den))

    def torque_to_cart(self) -> TransferFunction:
        """Motor torque to carriage position, m/(N m).

        Source: (2.48), with the denominator of (2.38): the thesis prints that of (2.39), which is exact for d = 0 only.
        """
        i = self.transmission_m_rad
        return TransferFunction((i * self.belt_damping_n_s_m, i * self.stiffness_n_m), self.torque_to_angle().den)

    def angle_to_cart(self) -> TransferFunction:
        """Motor angle to carriage position, m/rad.   Source: (2.49)."""
        i, d, c = self.transmission_m_rad, self.belt_damping_n_s_m, self.stiffness_n_m
        return TransferFunction((i * d, i * c), (self.mass_kg, d + self.cart_damping_n_s_m, c))


def two_mass(model: Model, point: Point, standstill: Standstill = "refuse") -> TwoMass:
    """The two-mass parameters of a model at an operating point.

    Parameters
    ----------
    model : Model
        Of a motor and a carriage.
    point : Point
    standstill : Standstill
        Set-valued friction at speed zero, see ``linear.matrices``.

    Returns
    -------
    TwoMass
        Viscous friction of the motor is converted to N s/m at the belt.

    Raises
    ------
    UsageError
        When the model is not a motor and a carriage on one spring.
    Refused
        As in ``linear.matrices``.
    """
    m = matrices(model, point, standstill)
    i = point.transmission_m_rad
    c = float(m.K[-1, -1]) if m.bodies else 0.0
    spring = c * np.array([[i * i, -i], [-i, 1.0]])
    if m.bodies != ("motor", "cart") or c <= 0.0 or not np.allclose(m.K, spring, rtol=1e-12, atol=0.0):
        raise UsageError(
            f"model {model.name!r} is not a motor and a carriage on one belt spring, its free bodies are "
            f"{', '.join(m.bodies) or 'none'}; use beltcomm.model.linear.state_space, which serves every model"
        )
    d = -float(m.D[0, 1]) / i
    return TwoMass(float(m.M[0, 0]), float(m.M[1, 1]), c, float(m.D[0, 0]) / i**2 - d, float(m.D[1, 1]) - d, d, i)
