"""The machine behind a virtual drive: our own simulation as a :class:`beltcomm.plant.Plant`."""

from __future__ import annotations

import math
from copy import copy

import numpy as np

from beltcomm.arrays import Array
from beltcomm.errors import Refused, UsageError
from beltcomm.model import Model
from beltcomm.model.linear import describes, fastest_rate, operating_point
from beltcomm.simulate.forward import LARGEST_STEP, at_rest, check_step, rigid_force_n
from beltcomm.simulate.imperfect import angle_sensor, is_late, late_torque, memory_s
from beltcomm.simulate.kernels.compose import kernel_for

#: N/m and 1: rubber buffers at both ends; 3 N m on the rig (250 N) press them by 1.3 mm.  They belong to this plant and not to
#: the model: they only keep a virtual axis from leaving the travel its model describes, and nothing identifies them.
_STOP_STIFFNESS_N_M = 2e5
_STOP_DAMPING_RATIO = 0.3


#: Per millisecond, whatever the model.
LEAST_SUBSTEPS = 20
#: m of travel after which the plant looks whether its model still describes the axis (too slow for every step).
_LOOK_EVERY_M = 5e-3


def substeps_needed(model: Model, position_m: float) -> int:
    """Sub-steps per millisecond that resolve a model's fastest motion with a fifth to spare, at least ``LEAST_SUBSTEPS``.

    Parameters
    ----------
    model : Model
        With any effects.
    position_m : float, m
        Carriage on the axis.
    """
    return max(LEAST_SUBSTEPS, math.ceil(1.2 * 1e-3 * fastest_rate(model, operating_point(model, position_m)) / LARGEST_STEP))


class SimulatedPlant:
    """A model of an axis behind the motor shaft, starting in static equilibrium at ``position_m``, as a whole at ``speed_m_s``.

    Parameters
    ----------
    position_rad, velocity_rad_s, cart_position_m, belt_force_n
        As in :class:`beltcomm.plant.Plant`; positions are relative to where the run began, the model inside uses the absolute carriage
        position.
    substeps_per_ms : int or None
        Of the integration; None takes :func:`substeps_needed`.
    belt_stretch_m : float
        How far the motor is ahead of the carriage at the start, as friction may have left it, m at the belt.
    end_stops_m : tuple of float or None, (min, max), m
        Absolute carriage positions of two rubber buffers; None leaves the axis without ends.

    Raises
    ------
    UsageError
        When ``substeps_per_ms`` is too small for the model.
    """

    def __init__(
        self,
        model: Model,
        position_m: float = 0.0,
        substeps_per_ms: int | None = None,
        end_stops_m: tuple[float, float] | None = None,
        speed_m_s: float = 0.0,
        belt_stretch_m: float = 0.0,
    ) -> None:
        if substeps_per_ms is None:
            substeps_per_ms = substeps_needed(model, position_m)
        check_step(model, position_m, 1e-3, substeps_per_ms)
        if end_stops_m is not None and not end_stops_m[0] < position_m < end_stops_m[1]:
            low, high = end_stops_m
            raise UsageError(f"the carriage cannot start at {position_m:g} m: its end stops are at {low:g} and {high:g} m")
        kernel = kernel_for(model)
        carriage = kernel.bodies.index("cart") if "cart" in kernel.bodies else 0
        name, body = model.bodies()[carriage]
        self.model, self._known_m = model, 0.0
        self._kernel, self._advance = kernel, kernel.advance
        self._p = model.vector()
        state = at_rest(model, position_m)
        self._q, self._v = state.positions, state.speeds
        if speed_m_s:
            levers = [model["transmission.ratio"] if each.rotary else 1.0 for _, each in model.bodies()]
            self._v = speed_m_s / np.array(levers)
        self._carriage = carriage
        self._lever = model["transmission.ratio"] if body.rotary else 1.0  # m per coordinate of the carriage's body
        if carriage:
            self._q[carriage] -= belt_stretch_m / self._lever
        self._inertia = model.driven_inertia() if model.rigid else model[name]
        self._low, self._high = end_stops_m or (-math.inf, math.inf)
        self._endless = end_stops_m is None
        self._substeps_per_s = 1e3 * substeps_per_ms
        self._measured = angle_sensor(model)
        self._start_rad = self._measured(float(self._q[0]))
        self.start_m = position_m
        self._duration_s, self._count, self._h = 0.0, 1, 0.0
        self._late, self._memory_s = is_late(model), memory_s(model)
        self._reported = np.zeros(0)
        self.time_s = 0.0
        self.position_rad = 0.0
        self.velocity_rad_s = float(self._v[0])
        self.cart_position_m = 0.0
        self.belt_force_n = self._advance(self._q, self._v, self._p, 0.0, 0.0, 0.0, 1)  # a step of no length only reads it

    def copied(self) -> SimulatedPlant:
        """Another one in the same state, which goes its own way."""
        other = copy(self)
        other._q, other._v, other._p = self._q.copy(), self._v.copy(), self._p.copy()
        return other

    def brake(self, torque_nm: float) -> None:
        """Close or release the holding brake: a closed brake is more Coulomb friction of the motor.

        Parameters
        ----------
        torque_nm : float, motor shaft
            0 releases it.

        Raises
        ------
        UsageError
            For a model without such friction.
        """
        if "coulomb" not in self.model.effects:
            raise UsageError(
                f"model {self.model.name!r} has no Coulomb friction at the motor, so it can have no brake; add it with level 0"
            )
        self._p[self.model.index("coulomb.level")] = self.model["coulomb.level"] + torque_nm

    def step(self, torque_nm: float, duration_s: float) -> None:
        """Let a torque act for a time; deterministic.

        Parameters
        ----------
        torque_nm : float, motor shaft
            Held.
        duration_s : float

        Raises
        ------
        Refused
            When the carriage has left what the model describes.
        """
        if duration_s != self._duration_s:
            self._duration_s = duration_s
            self._count = max(1, math.ceil(duration_s * self._substeps_per_s - 1e-6))
            self._h = duration_s / self._count
        q, v = self._q, self._v
        before = v.item(0)
        if self._late:
            self._step_late(torque_nm)
        elif self._endless or self._far_from_stops(duration_s):
            self.belt_force_n = self._advance(q, v, self._p, torque_nm, self.time_s, self._h, self._count)
        else:
            self._step_near_stop(torque_nm)
        self.time_s += duration_s
        if self.model.rigid:
            self.belt_force_n = rigid_force_n(self.model, np.array([before, v.item(0)]), duration_s).item()
        self.position_rad = self._measured(q.item(0)) - self._start_rad
        self.velocity_rad_s = v.item(0)
        self.cart_position_m = q.item(self._carriage) * self._lever - self.start_m
        if abs(self.cart_position_m - self._known_m) > _LOOK_EVERY_M:
            self._look()

    def _far_from_stops(self, duration_s: float) -> bool:
        """True if neither can be reached within one step, in which the speed can hardly double."""
        x = self._q.item(self._carriage) * self._lever
        reach = 2.0 * abs(self._v.item(self._carriage)) * self._lever * duration_s + 1e-3
        return self._low < x - reach and x + reach < self._high

    @property
    def plain(self) -> bool:
        """True if :meth:`follow` can run it: no buffers stand at its ends."""
        return self._endless

    def follow(
        self,
        follows_position: bool,
        coefficients: Array,
        state: Array,
        references: Array,
        sensing: Array,
        waiting: Array,
        period_s: float,
        late_s: float,
    ) -> Array:
        """A drive's loop closed on this plant, compiled; the same as stepping it, period by period.

        Parameters
        ----------
        follows_position : bool
            False for the velocity loop alone.
        coefficients : ndarray
            As in ``pieces.setpoint``.
        state : ndarray
            As in ``pieces.setpoint``, carried on in place.
        references : ndarray (4, n)
            Position, speed, acceleration at the motor shaft, torque added.
        sensing : ndarray
            As in ``pieces.setpoint``.
        waiting : ndarray, N m
            Torques on their way, the next one first.
        period_s : float
        late_s : float
            How much of a period the torque before goes on acting.

        Returns
        -------
        ndarray (6, n)
            At the start of each period motor angle, speed, carriage, m; then torque asked for, torque before, largest belt force, N.

        Raises
        ------
        Refused
            When the carriage leaves what the model describes.
        """
        first, rest_s = max(1, math.ceil(late_s * self._substeps_per_s - 1e-6)), period_s - late_s
        then = max(1, math.ceil(rest_s * self._substeps_per_s - 1e-6))
        timing = np.array([late_s, late_s / first, first, rest_s, rest_s / then, then, self._memory_s])
        out = np.empty((6, references.shape[1]))
        q, v, i = self._q, self._v, self._carriage
        shortest_s = min(rest_s / then, late_s / first if late_s > 0.0 else math.inf)
        kept = np.array([len(self._reported)])
        past = np.zeros(max(len(self._reported), math.ceil(self._memory_s / shortest_s)) + max(first, then))
        past[: len(self._reported)] = self._reported
        loop = (follows_position, coefficients, state, references, sensing, waiting, timing, past, kept, out)
        self._kernel.follow(q, v, self._p, self.time_s, self._start_rad, i, *loop)
        self._reported = past[: int(kept[0])]
        out[2] = out[2] * self._lever - self.start_m
        if self.model.rigid:
            out[5] = rigid_force_n(self.model, np.append(out[1], v.item(0)), period_s)
        self.time_s += period_s * references.shape[1]
        self.position_rad, self.velocity_rad_s = self._measured(q.item(0)) - self._start_rad, v.item(0)
        self.cart_position_m = q.item(i) * self._lever - self.start_m
        for reached in (float(out[2].min()), float(out[2].max()), self.cart_position_m):
            self._look_at(reached)
        return out

    def _look(self) -> None:
        """Raise Refused when the carriage stands where the model means nothing."""
        self._known_m = self.cart_position_m
        self._look_at(self.cart_position_m)

    def _look_at(self, from_start_m: float) -> None:
        reached = self.start_m + from_start_m
        if not describes(self.model, reached):
            raise Refused(f"the carriage ran to {reached:g} m, where model {self.model.name!r} has no belt; give it end stops")

    def _step_late(self, torque_nm: float) -> None:
        """A step with the torque that comes out of the torque path, which remembers what went in."""
        keep = math.ceil(self._memory_s / self._h)
        self._reported = np.concatenate([self._reported[-keep:], np.full(self._count, torque_nm)])
        acting = late_torque(self.model, self._reported, self._h)[-self._count :]
        count, start_s, strand = self._count, self.time_s, 0.0
        for n, torque in enumerate(acting.tolist()):
            self._count = 1
            self.time_s = start_s + n * self._h
            self._step_near_stop(torque)
            strand = max(strand, abs(self.belt_force_n))
        self._count, self.time_s, self.belt_force_n = count, start_s, strand

    def _step_near_stop(self, torque_nm: float) -> None:
        """A step with the buffers' force added to the carriage after each sub-step (operator splitting).

        F = -k s - d s' while the buffer is pressed by s > 0; it never pulls.
        """
        i, lever, h = self._carriage, self._lever, self._h
        mass = self._inertia / lever**2
        damping = 2.0 * _STOP_DAMPING_RATIO * math.sqrt(_STOP_STIFFNESS_N_M * mass)
        for n in range(self._count):
            self.belt_force_n = self._advance(self._q, self._v, self._p, torque_nm, self.time_s + n * h, h, 1)
            x, speed = self._q.item(i) * lever, self._v.item(i) * lever
            side = 1.0 if x > self._high else -1.0
            pressed = max(side * x - (self._high if side > 0.0 else -self._low), 0.0)
            if pressed > 0.0:
                push = max(_STOP_STIFFNESS_N_M * pressed + damping * side * speed, 0.0)
                self._v[i] -= side * np.float64(h * push / mass) / lever
