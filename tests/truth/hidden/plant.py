"""A hidden machine behind a virtual drive: an object with a step method, as every plant of the tests."""

from __future__ import annotations

import math

import numpy as np

from truth.hidden import laws, recorder
from truth.hidden import layout as at
from truth.hidden.kernel import advance
from truth.hidden.machines import Machine
from truth.hidden.session import SUBSTEP_S


class HiddenPlant:
    """A machine that a drive turns; starts at rest, belt and friction without force.

    position_rad, velocity_rad_s : motor shaft as its encoder disc shows it, without counts, from where the run began; a
    drive's own encoder rounds it.   cart_position_m : m, from where the run began.   belt_force_n : N, what the driving
    pulley passes to the belt, preload left out.   machine : with the answer, for the examiner.
    start_position_m : m, carriage on the axis at the start.
    """

    def __init__(self, machine: Machine, start_position_m: float, longest_substep_s: float = SUBSTEP_S) -> None:
        self.machine = machine
        self.longest_substep_s = longest_substep_s
        self._p = machine.p
        self._state = np.zeros(at.STATES)
        angle = start_position_m / machine.base.radius_m
        self._state[at.ANGLE] = angle
        self._cart_start = laws.pulley(angle, self._p)[0]
        self._state[[at.CART, at.IDLER, at.PAYLOAD]] = self._cart_start
        self._zero = self._shown()
        self._late: list[tuple[float, float]] = [(-math.inf, 0.0)]  # torques on their way: from when, how much
        self._clock_s = 0.0
        self.position_rad = self.velocity_rad_s = self.cart_position_m = self.belt_force_n = 0.0

    def step(self, torque_nm: float, duration_s: float) -> None:
        """Let ``torque_nm`` (held, at the motor shaft) act for ``duration_s``.

        Raises ValueError for a negative duration, RuntimeError when the state is no longer finite.
        """
        if not duration_s >= 0.0:
            raise ValueError(f"a step of {duration_s} s is not possible")
        self._late.append((self._clock_s + float(self._p[at.DEAD_TIME]), torque_nm))
        end = self._clock_s + duration_s
        while self._clock_s < end:
            while len(self._late) > 1 and self._late[1][0] <= self._clock_s + 1e-12:
                self._late.pop(0)
            until = min(end, self._late[1][0]) if len(self._late) > 1 else end
            advance(self._state, self._p, self.machine.bursts, self._late[0][1], 0.0, until - self._clock_s, self.longest_substep_s)
            self._clock_s = until
        if not np.isfinite(self._state).all():
            raise RuntimeError("the state is no longer finite; torque, duration or parameters are not sensible")
        self._show()

    def _show(self) -> None:
        p, s = self._p, self._state
        self.position_rad = self._shown() - self._zero
        slope = 1.0
        if p[at.DISC] != 0.0:
            slope += p[at.DISC] * math.cos(s[at.ANGLE] + p[at.DISC_PHASE])
            slope += 2.0 * p[at.DISC_OVAL] * math.cos(2.0 * s[at.ANGLE] + p[at.DISC_OVAL_PHASE])
        self.velocity_rad_s = float(s[at.SPEED]) * slope
        self.cart_position_m = float(s[at.CART]) - self._cart_start
        u, lever = laws.pulley(s[at.ANGLE], p)
        motion = (u, lever * s[at.SPEED]), (s[at.CART], s[at.CART_SPEED]), (s[at.IDLER], s[at.IDLER_SPEED])
        self.belt_force_n = float(laws.belt(*motion, p)[0])

    def _shown(self) -> float:
        """What the encoder disc shows, rad; with the codes that stick where the machine has such."""
        angle = float(self._state[at.ANGLE])
        if self._p[at.CODE_PERIOD] > 0.0:
            return recorder.reading(angle, self.machine.base.quantum_rad, self._p)
        return laws.encoder(angle, self._p)
