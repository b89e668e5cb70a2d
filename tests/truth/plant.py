"""A belt axis with set-valued Coulomb friction that steps like the product's plants and shares no code with them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from truth import kernel as k

#: m/s², standard gravity (CGPM 1901).
STANDARD_GRAVITY_M_S2 = 9.80665

_OUTCOMES = {
    k.CHATTER: "more than {events} stick-slip events fell into one sub-step; check the friction levels",
    k.OFF_BELT: "the carriage left the belt between the pulleys; give the plant end stops or keep the torque lower",
    k.NOT_A_NUMBER: "the state is no longer finite; torque, duration or parameters are not sensible",
}


@dataclass(frozen=True)
class ConstantBelt:
    """One spring and one damper between motor and carriage, (2.25).   stiffness_n_m : N/m.   damping_n_s_m : N s/m."""

    stiffness_n_m: float
    damping_n_s_m: float = 0.0


@dataclass(frozen=True)
class TwoStrandBelt:
    """The spring follows the carriage:  c(l1) = EA/l1 + EA/(2 l3 - l1), (2.26); constant damper; no end pulley mass.

    l1 = offset_m + carriage position on the axis.   specific_stiffness_n : EA, N.   pulley_distance_m : l3, m.
    """

    specific_stiffness_n: float
    pulley_distance_m: float
    offset_m: float
    damping_n_s_m: float = 0.0


@dataclass(frozen=True)
class ThreeSectionBelt:
    """Three belt sections and the end pulley, (2.11) to (2.20), all along the belt.

    c_i = EA/l_i and d_i = DA/l_i with l1 = offset_m + carriage position, l2 = l3 - l1.
    specific_damping_n_s : DA, N s.   end_pulley_mass_kg : Theta_r/r², kg.
    end_pulley_viscous_n_s_m : N s/m.   end_pulley_coulomb_n : N.
    """

    specific_stiffness_n: float
    pulley_distance_m: float
    offset_m: float
    end_pulley_mass_kg: float
    specific_damping_n_s: float = 0.0
    end_pulley_viscous_n_s_m: float = 0.0
    end_pulley_coulomb_n: float = 0.0


@dataclass(frozen=True)
class Coupling:
    """A compliant coupling between motor and driving pulley, all at the motor shaft.

    stiffness_nm_rad : N m/rad.   damping_nm_s_rad : N m s/rad.   pulley_inertia_kg_m2 : what turns behind it, kg m².
    """

    stiffness_nm_rad: float
    pulley_inertia_kg_m2: float
    damping_nm_s_rad: float = 0.0


@dataclass(frozen=True)
class EndStops:
    """Buffers the carriage runs into:  force = stiffness depth (1 + loss speed into the buffer), never pulling.

    low_m, high_m : m, positions on the axis.   stiffness_n_m : N/m.   loss_s_m : s/m.   Source: Hunt, Crossley 1975, (12).
    """

    low_m: float
    high_m: float
    stiffness_n_m: float = 1e6
    loss_s_m: float = 0.0


@dataclass(frozen=True)
class Axis:
    """Everything the simulator knows about a machine.

    inertia_kg_m2 : Theta_e at the motor shaft; with a coupling only what turns before it.   mass_kg : carriage.
    transmission_m_rad : i_t of (2.16).   viscous_motor_nm_s_rad, coulomb_motor_nm : (2.21), motor shaft.
    viscous_cart_n_s_m, coulomb_cart_n : (2.23).   tilt_rad : alpha of (2.22), positive rises.
    Raises ValueError for a value that no machine has.
    """

    inertia_kg_m2: float
    mass_kg: float
    transmission_m_rad: float
    belt: ConstantBelt | TwoStrandBelt | ThreeSectionBelt
    viscous_motor_nm_s_rad: float = 0.0
    coulomb_motor_nm: float = 0.0
    viscous_cart_n_s_m: float = 0.0
    coulomb_cart_n: float = 0.0
    tilt_rad: float = 0.0
    coupling: Coupling | None = None
    stops: EndStops | None = None

    def __post_init__(self) -> None:
        parts = [p for p in (self, self.belt, self.coupling, self.stops) if p is not None]
        signed = {"tilt_rad", "offset_m", "low_m", "high_m"}
        positive = {"inertia_kg_m2", "mass_kg", "transmission_m_rad", "pulley_inertia_kg_m2", "end_pulley_mass_kg"}
        for part in parts:
            for name, value in vars(part).items():
                if not isinstance(value, (int, float)):
                    continue
                low = -math.inf if name in signed else 0.0
                if not math.isfinite(value) or value < low or (name in positive and value == 0.0):
                    raise ValueError(f"{type(part).__name__}.{name} = {value} is not possible")


class TruthPlant:
    """An axis in motion; implements the product's plant protocol.

    Starts at position 0, at rest, with the belt unstretched.  Whether a body then sticks or moves off, under tilt or
    torque, is decided by the set-valued friction law.   start_position_m : m, carriage on the axis at position 0.
    truth : values by name, for whoever judges a result.   longest_substep_s : s, of the integration.

    position_rad, velocity_rad_s : motor shaft.   cart_position_m : m, from where the run began.
    belt_force_n : N, -tau_1/r of (2.17): what the driving pulley passes to the belt, both strands; preload left out.
    """

    def __init__(
        self,
        axis: Axis,
        *,
        start_position_m: float = 0.0,
        truth: Mapping[str, float] | None = None,
        longest_substep_s: float = 62.5e-6,
    ) -> None:
        self.axis = axis
        self.truth = dict(truth or {})
        self.longest_substep_s = longest_substep_s
        self._start_position_m = start_position_m
        self._parameters = _parameters(axis, start_position_m)
        self._state = np.zeros(3 * k.BODIES)
        self.place((0.0,) * k.BODIES, (0.0,) * k.BODIES)

    def place(self, coordinates: Sequence[float], speeds: Sequence[float]) -> None:
        """Put the bodies somewhere: motor (rad), carriage (m), end pulley (m along the belt), driving pulley (rad)."""
        for i in range(k.BODIES):
            self._state[i], self._state[k.BODIES + i] = coordinates[i], speeds[i]
            # A body without Coulomb friction never sticks: any direction makes it slide, at a level of zero.
            rests = speeds[i] == 0.0 and self._parameters[k.COULOMB + i] > 0.0
            self._state[2 * k.BODIES + i] = 0.0 if rests else math.copysign(1.0, speeds[i])
        self.step(0.0, 0.0)

    def step(self, torque_nm: float, duration_s: float) -> None:
        """Let ``torque_nm`` (held, at the motor shaft) act for ``duration_s``; deterministic.

        Raises ValueError for a negative duration, RuntimeError where the machine or the integration came to its end.
        """
        if duration_s < 0.0:
            raise ValueError(f"a step of {duration_s} s is not possible")
        self.position_rad, self.velocity_rad_s, self.cart_position_m, self.belt_force_n, outcome = k.advance(
            self._state, self._parameters, torque_nm, duration_s, self.longest_substep_s
        )
        if outcome != k.FINE:
            raise RuntimeError(_OUTCOMES[outcome].format(events=k.MOST_EVENTS))

    def brake(self, torque_nm: float) -> None:
        """A holding brake that presses with this torque: Coulomb friction of the motor beside its own."""
        self._parameters[k.COULOMB + k.MOTOR] = self.axis.coulomb_motor_nm + torque_nm

    @property
    def stuck(self) -> tuple[bool, bool, bool]:
        """Whether motor, carriage and end pulley are held by their friction."""
        motor, cart, end_pulley, _ = self._state[2 * k.BODIES :] == 0.0
        return bool(motor), bool(cart), bool(end_pulley)

    @property
    def coordinates(self) -> tuple[float, ...]:
        """Motor (rad), carriage (m), end pulley (m along the belt), driving pulley (rad)."""
        return tuple(map(float, self._state[: k.BODIES]))

    @property
    def speeds(self) -> tuple[float, ...]:
        """The rates of :attr:`coordinates`."""
        return tuple(map(float, self._state[k.BODIES : 2 * k.BODIES]))


def _parameters(axis: Axis, start_position_m: float) -> k.Array:
    """The axis as the vector that the compiled kernel reads."""
    p = np.zeros(k.PARAMETERS)
    p[k.INVERSE_INERTIA + k.MOTOR] = 1.0 / axis.inertia_kg_m2
    p[k.INVERSE_INERTIA + k.CART] = 1.0 / axis.mass_kg
    p[k.VISCOUS + k.MOTOR], p[k.COULOMB + k.MOTOR] = axis.viscous_motor_nm_s_rad, axis.coulomb_motor_nm
    p[k.VISCOUS + k.CART], p[k.COULOMB + k.CART] = axis.viscous_cart_n_s_m, axis.coulomb_cart_n
    p[k.TRANSMISSION] = axis.transmission_m_rad
    p[k.GRAVITY_FORCE] = -axis.mass_kg * STANDARD_GRAVITY_M_S2 * math.sin(axis.tilt_rad)
    p[k.STOP_LOW], p[k.STOP_HIGH] = -math.inf, math.inf
    belt = axis.belt
    if isinstance(belt, ConstantBelt):
        p[k.BELT_KIND] = k.CONSTANT
        p[k.STIFFNESS], p[k.DAMPING] = belt.stiffness_n_m, belt.damping_n_s_m
    else:
        p[k.SPECIFIC_STIFFNESS], p[k.PULLEY_DISTANCE] = belt.specific_stiffness_n, belt.pulley_distance_m
        p[k.LENGTH_AT_START] = belt.offset_m + start_position_m
        if not 0.0 < p[k.LENGTH_AT_START] < belt.pulley_distance_m:
            raise ValueError(f"l1 = {p[k.LENGTH_AT_START]} m at the start is outside 0 to {belt.pulley_distance_m} m")
    if isinstance(belt, TwoStrandBelt):
        p[k.BELT_KIND], p[k.DAMPING] = k.TWO_STRANDS, belt.damping_n_s_m
    elif isinstance(belt, ThreeSectionBelt):
        p[k.BELT_KIND], p[k.SPECIFIC_DAMPING] = k.THREE_SECTIONS, belt.specific_damping_n_s
        p[k.INVERSE_INERTIA + k.END_PULLEY] = 1.0 / belt.end_pulley_mass_kg
        p[k.VISCOUS + k.END_PULLEY] = belt.end_pulley_viscous_n_s_m
        p[k.COULOMB + k.END_PULLEY] = belt.end_pulley_coulomb_n
    if axis.coupling is not None:
        p[k.COUPLED] = 1.0
        p[k.INVERSE_INERTIA + k.DRIVING_PULLEY] = 1.0 / axis.coupling.pulley_inertia_kg_m2
        p[k.COUPLING_STIFFNESS], p[k.COUPLING_DAMPING] = axis.coupling.stiffness_nm_rad, axis.coupling.damping_nm_s_rad
    if axis.stops is not None:
        # The state counts from where the run began, the buffers stand on the axis.
        p[k.STOP_LOW], p[k.STOP_HIGH] = axis.stops.low_m - start_position_m, axis.stops.high_m - start_position_m
        p[k.STOP_STIFFNESS], p[k.STOP_LOSS] = axis.stops.stiffness_n_m, axis.stops.loss_s_m
    return p
