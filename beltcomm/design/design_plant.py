"""The plant of the design: two masses, or as many as the model has, and a dead time, sampled exactly as the drive samples it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import expm

from beltcomm.arrays import Array, ComplexArray, IntArray
from beltcomm.compiled import in_one_thread
from beltcomm.design.structure import Bodies
from beltcomm.errors import UsageError


@dataclass(frozen=True)
class DesignPlant:
    """Two-mass model (2.25) at one operating point, friction as viscous damping, and the dead time of the torque path.

    Attributes
    ----------
    inertia_kg_m2 : float
        Θ_e, kg m², motor side.
    transmission_m_rad : float
        i_t, m/rad (pulley radius over gear ratio).
    mass_kg : float
        m_c, kg, carriage.
    stiffness_n_m : float
        c, N/m, belt.
    motor_damping_nm_s_rad : float
        d_m, N m s/rad at the motor shaft (the thesis's transfer functions print d_m/i_t², N s/m).
    cart_damping_ns_m : float
        d_c, N s/m, carriage.
    belt_damping_ns_m : float
        d, N s/m, belt.
    dead_time_s : float
        From torque setpoint to acting torque, without the hold of the sampling, s.
    bodies : Bodies or None
        Equations of motion where there are more than motor and carriage; then mass, stiffness and belt damping above are those of the
        two-mass model that stands for it in (2.42) to (2.45), and friction is added to motor and carriage.
    name : str
        For messages, such as "0.55 m, 13.4 kg, no friction".

    Raises
    ------
    UsageError
        For a number that is not finite, a negative damping or dead time, a mass or stiffness not above 0.
    """

    inertia_kg_m2: float
    transmission_m_rad: float
    mass_kg: float
    stiffness_n_m: float
    motor_damping_nm_s_rad: float = 0.0
    cart_damping_ns_m: float = 0.0
    belt_damping_ns_m: float = 0.0
    dead_time_s: float = 0.0
    name: str = ""
    bodies: Bodies | None = None

    def __post_init__(self) -> None:
        for field in ("inertia_kg_m2", "transmission_m_rad", "mass_kg", "stiffness_n_m"):
            value = getattr(self, field)
            if not (value > 0.0 and math.isfinite(value)):
                raise UsageError(f"the design plant's {field} is {value}; it must be a positive, finite number")
        for field in ("motor_damping_nm_s_rad", "cart_damping_ns_m", "belt_damping_ns_m", "dead_time_s"):
            value = getattr(self, field)
            if not (value >= 0.0 and math.isfinite(value)):
                raise UsageError(f"the design plant's {field} is {value}; it must be finite and not negative")

    @property
    def total_inertia_kg_m2(self) -> float:
        """m_e = Θ_e + i_t² m_c, kg m², motor side (4.15)."""
        return self.inertia_kg_m2 + self.transmission_m_rad**2 * self.mass_kg

    @property
    def friction_damping_nm_s_rad(self) -> float:
        """d_v = d_m + i_t² d_c, N m s/rad, motor side (4.15)."""
        return self.motor_damping_nm_s_rad + self.transmission_m_rad**2 * self.cart_damping_ns_m

    @property
    def resonance_rad_s(self) -> float:
        """ω_r = sqrt(c (Θ_e + i_t² m_c)/(Θ_e m_c)), rad/s, undamped (2.44)."""
        return math.sqrt(self.stiffness_n_m * self.total_inertia_kg_m2 / (self.inertia_kg_m2 * self.mass_kg))

    @property
    def antiresonance_rad_s(self) -> float:
        """ω_z = sqrt(c/m_c), rad/s, undamped (2.45)."""
        return math.sqrt(self.stiffness_n_m / self.mass_kg)

    @property
    def resonance_damping(self) -> float:
        """Damping ratio ζ_r of the resonance, to first order in the dampings (projection on the undamped mode).

        2 ζ_r sqrt(c m*) = d + (m_c² d_m i_t² + Θ_e² d_c)/(Θ_e + i_t² m_c)²,   m* = Θ_e m_c/(Θ_e + i_t² m_c).
        """
        total = self.total_inertia_kg_m2
        motor = self.motor_damping_nm_s_rad * (self.transmission_m_rad * self.mass_kg / total) ** 2
        cart = self.cart_damping_ns_m * (self.inertia_kg_m2 / total) ** 2
        relative_mass = self.inertia_kg_m2 * self.mass_kg / total
        return (self.belt_damping_ns_m + motor + cart) / (2.0 * math.sqrt(self.stiffness_n_m * relative_mass))

    @property
    def modes_rad_s(self) -> Array:
        """Frequencies around which a grid must be fine beside ω_r and ω_z, rad/s; none for two masses."""
        return np.zeros(0) if self.bodies is None else self.bodies.modes_rad_s()

    def state_space(self) -> tuple[Array, Array]:
        """A (4, 4) and B (4,) of dx/dt = A x + B τ_m,  x = (φ_m, ω_m, i_t φ_m − x_c, dx_c/dt); SI, (2.25) with d.

        With ``bodies`` (2n, 2n) and (2n,),  x = (φ_m, other positions, ω_m, other speeds).
        """
        if self.bodies is not None:
            return self._many_bodies(self.bodies)
        J, i, m = self.inertia_kg_m2, self.transmission_m_rad, self.mass_kg
        c, d, d_m, d_c = self.stiffness_n_m, self.belt_damping_ns_m, self.motor_damping_nm_s_rad, self.cart_damping_ns_m
        A = np.array(
            [
                [0.0, 1.0, 0.0, 0.0],
                [0.0, -(d_m + i * i * d) / J, -i * c / J, i * d / J],
                [0.0, i, 0.0, -1.0],
                [0.0, i * d / m, c / m, -(d + d_c) / m],
            ]
        )
        return A, np.array([0.0, 1.0 / J, 0.0, 0.0])

    def _many_bodies(self, bodies: Bodies) -> tuple[Array, Array]:
        mass, damping, stiffness = bodies.arrays()
        damping[0, 0] += self.motor_damping_nm_s_rad
        cart = bodies.names.index("cart")
        damping[cart, cart] += self.cart_damping_ns_m
        n = len(mass)
        A, B = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
        A[:n, n:] = np.eye(n)
        A[n:, :n], A[n:, n:] = -stiffness / mass[:, None], -damping / mass[:, None]
        B[n] = 1.0 / mass[0]
        return A, B

    def sampled(self, period_s: float) -> tuple[Array, Array, Array, int]:
        """Exact sampling of the plant with held torque setpoint u and dead time: x[k+1] = Φ x[k] + Γ0 u[k−n] + Γ1 u[k−n−1].

        Parameters
        ----------
        period_s : float, s
            For which the setpoint is held.

        Returns
        -------
        tuple of ndarray (N, N), ndarray (N,), ndarray (N,), int
            Φ, Γ0, Γ1 and n, the whole periods of the dead time, whose fraction Γ1 carries; N is 4, or twice the bodies.

        References
        ----------
        Modified z-transform (hold split at the fraction of the dead time).
        """
        return _sample_cached(self, period_s)

    def sampled_response(self, omega_rad_s: Array, period_s: float) -> ComplexArray:
        """Exact response of the full model (2.38) from torque setpoint to sampled motor angle, rad/(N m).

        Parameters
        ----------
        omega_rad_s : ndarray (n,), rad/s
            Above 0, at most π/T.
        period_s : float
            T, s, hold and sampling of the loop.
        """
        advance, new, old, whole = self.sampled(period_s)
        z = np.exp(1j * omega_rad_s * period_s)
        right = new + old / z[:, None]
        states = np.linalg.solve(z[:, None, None] * np.eye(len(advance)) - advance, right[..., None])
        return np.asarray(states[:, 0, 0] * z**-whole)

    def continuous_response(self, omega_rad_s: Array) -> ComplexArray:
        """The thesis's plant: (2.42) times exp(−s dead time), s = jω; no belt damper, no sampling.

        Parameters
        ----------
        omega_rad_s : ndarray
            Above 0.

        Returns
        -------
        ndarray of complex
            rad/(N m), motor shaft, in the shape of ``omega_rad_s``.
        """
        s = 1j * omega_rad_s
        total = self.total_inertia_kg_m2
        rigid = s * s * total + s * self.friction_damping_nm_s_rad
        inertia = self.inertia_kg_m2 * self.mass_kg / total
        damping = (self.mass_kg * self.motor_damping_nm_s_rad + self.inertia_kg_m2 * self.cart_damping_ns_m) / total
        numerator = self.mass_kg * s * s + self.cart_damping_ns_m * s + self.stiffness_n_m
        return np.asarray(numerator / (inertia * s * s + damping * s + self.stiffness_n_m) / rigid * np.exp(-s * self.dead_time_s))


def with_friction_fractions(plant: DesignPlant, fractions: Sequence[float]) -> list[DesignPlant]:
    """The plant with d_m and d_c scaled by each fraction; the belt damper stays.

    Around standstill Coulomb friction poses as damping, on the moving axis it is gone: a loop must hold for all fractions
    from 0 (constant friction) to 1 (what a frequency response around standstill shows); thesis sheet, 2.7 and 3.

    Parameters
    ----------
    plant : DesignPlant
        As a frequency response around standstill shows it.
    fractions : sequence of float
        0 to 1.

    Returns
    -------
    list of DesignPlant
        One for each, named so.
    """
    return [
        replace(
            plant,
            motor_damping_nm_s_rad=fraction * plant.motor_damping_nm_s_rad,
            cart_damping_ns_m=fraction * plant.cart_damping_ns_m,
            name=f"{plant.name}, {100.0 * fraction:.0f} % of the damping seen at standstill".lstrip(", "),
        )
        for fraction in fractions
    ]


@lru_cache(maxsize=512)
def _sample_cached(plant: DesignPlant, period_s: float) -> tuple[Array, Array, Array, int]:
    """Exact sampling as :meth:`DesignPlant.sampled`; kept, because search, proof and poles ask for the same plants."""
    advance, new, old, whole = sample_plants([plant], period_s)
    result = advance[0], new[0], old[0]
    for array in result:
        array.flags.writeable = False
    return *result, int(whole[0])


@in_one_thread
def sample_plants(plants: Sequence[DesignPlant], period_s: float) -> tuple[Array, Array, Array, IntArray]:
    """Exact sampling of p plants with equally many bodies at once, see :meth:`DesignPlant.sampled`.

    Parameters
    ----------
    plants : sequence of DesignPlant
        Each with its dead time.
    period_s : float, s
        For which the setpoint is held.

    Returns
    -------
    tuple of ndarray (p, n, n), ndarray (p, n), ndarray (p, n), ndarray (p,) of int
        Φ, Γ0, Γ1 and the whole periods of the dead time.
    """
    dead = np.array([plant.dead_time_s for plant in plants])
    whole = np.floor(dead / period_s + 1e-9).astype(np.int64)
    fraction = np.maximum(dead - whole * period_s, 0.0)
    spaces = [plant.state_space() for plant in plants]
    n = len(spaces[0][1])
    block = np.zeros((len(plants), n + 1, n + 1))
    block[:, :n, :n], block[:, :n, n] = np.array([A for A, _ in spaces]), np.array([B for _, B in spaces])
    # exp of the augmented matrix holds exp(A t) and the integral of exp(A s) B over 0 .. t.
    spans = np.stack([np.full(len(plants), period_s), period_s - fraction, fraction])
    whole_period, rest, start = expm(block * spans[:, :, None, None])
    return whole_period[:, :n, :n], rest[:, :n, n], np.einsum("pij,pj->pi", rest[:, :n, :n], start[:, :n, n]), whole
