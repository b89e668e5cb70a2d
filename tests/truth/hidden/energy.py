"""Mechanical energy of a hidden machine, for the tests: potentials by quadrature of the forces, not by their formulas."""

from __future__ import annotations

import numpy as np

from truth.hidden import kernel, laws
from truth.hidden import layout as at
from truth.hidden.layout import Array
from truth.hidden.machines import Machine


class Energy:
    """Kinetic energy, belt, bristles, second mass and forces of position of a machine in motion, J."""

    def __init__(self, machine: Machine, reach_m: float = 3e-3) -> None:
        self.p = machine.p
        self._grid = np.linspace(-reach_m, reach_m, 24001)
        self._belt = _integral(self._grid, [laws.belt((y, 0.0), (0.0, 0.0), (0.0, 0.0), machine.p)[0] for y in self._grid])
        self._clamp = _integral(self._grid, [y - laws.play(y, machine.p)[0] for y in self._grid])
        self._between = _integral(self._grid, [kernel.payload_force(y, 0.0, machine.p) for y in self._grid])
        self._travel = np.linspace(0.0, machine.base.stroke_m, 4001)
        force = [kernel.cart_forces(x, 0.0, 0.0, np.zeros(at.STATES), machine.p) for x in self._travel]
        self._place = _integral(self._travel, force)

    def __call__(self, s: Array) -> float:
        """Energy of a state, J; zero point arbitrary."""
        p = self.p
        masses = (p[at.J], at.SPEED), (p[at.M], at.CART_SPEED), (p[at.M2], at.PAYLOAD_SPEED), (p[at.ME], at.IDLER_SPEED)
        total = sum(0.5 * mass * float(s[speed]) ** 2 for mass, speed in masses)
        u, x, e = laws.pulley(s[at.ANGLE], p)[0], s[at.CART], s[at.IDLER]
        if p[at.TOPOLOGY] == at.TWO_STRANDS:
            total += np.interp(u - x, self._grid, self._belt) * self._stiffness(x) / self._stiffness(0.0)
        else:
            k1, k2, k3 = laws.spans(x, p)[:3]
            balance = (k1 * u + k2 * e) / (k1 + k2)  # where the clamp would rest; what it is held off by is the belt's stretch
            total += 0.5 * (k1 * k2 / (k1 + k2) + k3) * (u - e) ** 2 + (k1 + k2) * np.interp(balance - x, self._grid, self._clamp)
        total += 0.5 * s[at.Z_MOTOR] ** 2 / p[at.BRISTLE]
        if p[at.COULOMB_CART] > 0.0:
            total += 0.5 * s[at.Z_CART] ** 2 / p[at.BRISTLE_CART]
        if p[at.HYSTERESIS] > 0.0:
            total += 0.5 * s[at.Z_CABLE] ** 2 * p[at.HYSTERESIS_LENGTH] / p[at.HYSTERESIS]
        if p[at.SLIDER_FORCE] > 0.0:
            sliders = s[at.Z_SLIDER :] ** 2 / p[at.SLIDER_STIFFNESS : at.SLIDER_STIFFNESS + at.SLIDERS]
            total += 0.5 * float(np.sum(sliders))
        total += 0.5 * p[at.K_CREEP] * (u - x - s[at.CREEP]) ** 2
        if p[at.M2] > 0.0:
            total += np.interp(s[at.PAYLOAD] - x, self._grid, self._between) - p[at.M2] * p[at.GRAVITY] * s[at.PAYLOAD]
        return float(total - np.interp(x, self._travel, self._place))

    def _stiffness(self, x: float) -> float:
        k1, k2, k3 = laws.spans(x, self.p)[:3]
        return float(k1 + k2 * k3 / (k2 + k3))


def _integral(x: Array, force: list[float]) -> Array:
    """Running integral of a force, zero in the middle of the grid."""
    values = np.asarray(force)
    work = np.concatenate(([0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(x))))
    return work - work[len(work) // 2]
