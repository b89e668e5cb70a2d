"""The same machine once more, for the tests: matrices from an incidence list, scipy's DOP853 with event functions.

Written apart from the kernel: every spring is a row vector over the coordinates, so K = sum c b b^T and D = sum d b b^T.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from truth.plant import Axis, ConstantBelt, ThreeSectionBelt, TwoStrandBelt

Array = NDArray[np.float64]

#: A stuck body lets go this little above its level, so that it is beyond the level wherever the root finder stops.
RELEASE = 1.0 + 1e-10


class Matrices:
    """M q'' + D(x) q' + K(x) q = b torque + gravity - Coulomb.   q : the bodies the machine has, in the order of ``bodies``.

    bodies : numbers of the kernel's bodies (0 motor, 1 carriage, 2 end pulley, 3 driving pulley).   l1 : m, at q = 0.
    """

    def __init__(self, axis: Axis, l1: float) -> None:
        three = axis.belt if isinstance(axis.belt, ThreeSectionBelt) else None
        self.axis, self.l1 = axis, l1
        self.bodies = [0, 1] + ([2] if three else []) + ([3] if axis.coupling else [])
        inertia = {0: axis.inertia_kg_m2, 1: axis.mass_kg}
        viscous = {0: axis.viscous_motor_nm_s_rad, 1: axis.viscous_cart_n_s_m}
        coulomb = {0: axis.coulomb_motor_nm, 1: axis.coulomb_cart_n}
        if three:
            inertia[2], viscous[2], coulomb[2] = (
                three.end_pulley_mass_kg,
                three.end_pulley_viscous_n_s_m,
                three.end_pulley_coulomb_n,
            )
        if axis.coupling:
            inertia[3] = axis.coupling.pulley_inertia_kg_m2
        self.mass = np.array([inertia[i] for i in self.bodies])
        self.viscous = np.array([viscous.get(i, 0.0) for i in self.bodies])
        self.coulomb = np.array([coulomb.get(i, 0.0) for i in self.bodies])
        self.input = self.row({0: 1.0})
        self.gravity = self.row({1: -axis.mass_kg * 9.80665 * np.sin(axis.tilt_rad)})
        drive = self.row({3 if axis.coupling else 0: axis.transmission_m_rad})
        cart, end = self.row({1: 1.0}), self.row({2: 1.0})
        self.rows = [drive - cart, end - cart, drive - end]
        self.coupling_row = self.row({0: 1.0, 3: -1.0})

    def row(self, entries: dict[int, float]) -> Array:
        """A row vector over the bodies there are."""
        return np.array([entries.get(i, 0.0) for i in self.bodies])

    def at(self, cart: float) -> tuple[Array, Array]:
        """K and D with the carriage at ``cart``, m from the start."""
        belt, l1 = self.axis.belt, self.l1 + cart
        if isinstance(belt, ConstantBelt):
            links = [(belt.stiffness_n_m, belt.damping_n_s_m)]
        elif isinstance(belt, TwoStrandBelt):
            ea, l3 = belt.specific_stiffness_n, belt.pulley_distance_m
            c1, c2, c3 = ea / l1, ea / (l3 - l1), ea / l3
            links = [(c1 + c2 * c3 / (c2 + c3), belt.damping_n_s_m)]  # (2.26) as it is printed
        else:
            l3 = belt.pulley_distance_m
            links = [(belt.specific_stiffness_n / length, belt.specific_damping_n_s / length) for length in (l1, l3 - l1, l3)]
        stiffness, damping = np.zeros((2, len(self.bodies), len(self.bodies)))
        for (c, d), b in zip(links, self.rows, strict=False):
            stiffness, damping = stiffness + c * np.outer(b, b), damping + d * np.outer(b, b)
        if self.axis.coupling:
            b = self.coupling_row
            stiffness = stiffness + self.axis.coupling.stiffness_nm_rad * np.outer(b, b)
            damping = damping + self.axis.coupling.damping_nm_s_rad * np.outer(b, b)
        return stiffness, damping + np.diag(self.viscous)


def simulate(axis: Axis, l1: float, torques: Sequence[float], period_s: float) -> tuple[Array, NDArray[np.bool_]]:
    """Coordinates and speeds (n, 2 bodies) after every held torque, and which bodies are stuck then (n, bodies)."""
    m = Matrices(axis, l1)
    n = len(m.bodies)
    q, v = np.zeros(n), np.zeros(n)
    slide = np.where(m.coulomb > 0.0, 0.0, 1.0)
    states, stuck = [], []

    def forces(y: Array, torque: float) -> Array:
        stiffness, damping = m.at(y[1])
        result: Array = m.input * torque + m.gravity - stiffness @ y[:n] - damping @ y[n:]
        return result

    for torque in torques:
        for i in np.flatnonzero((m.coulomb > 0.0) & (v == 0.0)):
            slide[i] = _settled(forces(np.concatenate([q, v]), torque)[i], m.coulomb[i])
        t = 0.0
        while t < period_s:

            def rate(_t: float, y: Array, u: float = torque) -> Array:
                acceleration = np.where(slide == 0.0, 0.0, (forces(y, u) - slide * m.coulomb) / m.mass)
                return np.concatenate([y[n:], acceleration])

            watched = [int(i) for i in np.flatnonzero(m.coulomb > 0.0)]
            events = [_event(i, slide[i], m.coulomb[i], n, torque, forces) for i in watched]
            y0 = np.concatenate([q, v])
            # A first step this short shows a body just released as moving, before it may come to rest again.
            short = min(1e-8, 0.5 * (period_s - t))
            solution = solve_ivp(
                rate,
                (t, period_s),
                y0,
                method="DOP853",
                rtol=1e-11,
                atol=1e-13,
                events=events,
                max_step=2e-4,
                first_step=short,
            )
            if solution.t[-1] <= t:
                raise RuntimeError(f"the reference does not get past {t} s")
            t, y = float(solution.t[-1]), solution.y[:, -1]
            q, v = y[:n].copy(), y[n:].copy()
            if solution.status == 1:
                hits = [len(times) for times in solution.t_events or []]
                body = watched[int(np.argmax(hits))]
                if slide[body] != 0.0:
                    v[body] = 0.0
                    slide[body] = _settled(forces(np.concatenate([q, v]), torque)[body], m.coulomb[body])
                else:
                    slide[body] = np.sign(forces(y, torque)[body])
        states.append(np.concatenate([q, v]))
        stuck.append(slide == 0.0)
    return np.array(states), np.array(stuck)


def _settled(force: float, level: float) -> float:
    return 0.0 if abs(force) <= level else float(np.sign(force))


def _event(
    i: int, slide: float, level: float, n: int, torque: float, forces: Callable[[Array, float], Array]
) -> Callable[[float, Array], float]:
    def event(_t: float, y: Array) -> float:
        return float(slide * y[n + i]) if slide != 0.0 else float(level * RELEASE - abs(forces(y, torque)[i]))

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = -1  # type: ignore[attr-defined]
    return event
