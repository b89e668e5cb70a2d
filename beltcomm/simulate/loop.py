"""A closed loop on a plant: the drive's cascade along a reference, with a torque added to its own.

Setpoints may come more seldom than the loop runs; what it makes of them:

A drive in a cyclic position or velocity mode goes from setpoint to setpoint on a straight line (60C2h, interpolation time period) and
reaches each in the last loop before the next one comes.  So its reference is the host's, later by

    lag = T_setpoint - T_loop,

and none where the two periods are one.  A torque that comes along (60B2h) is not interpolated: it acts at once, until the next comes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from beltcomm.arrays import Array
from beltcomm.control import Cascade, discrete_coefficients, new_state, reset_state
from beltcomm.model import Model
from beltcomm.plant import Plant
from beltcomm.simulate.kernels.pieces import setpoint
from beltcomm.simulate.plant import SimulatedPlant

#: Of a loop's period: rounding of a time on its grid.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class SetpointGrid:
    """``count`` setpoints, one every ``period_s``, and the loop of the drive, one run every ``loop_s``; s."""

    period_s: float
    loop_s: float
    count: int

    @property
    def lag_s(self) -> float:
        """By which the loop's reference is later than the host's, s."""
        return max(self.period_s - self.loop_s, 0.0)

    @property
    def _same(self) -> bool:
        return abs(self.period_s - self.loop_s) <= _ROUNDING * self.loop_s

    def _sent_s(self) -> Array:
        return np.asarray(self.period_s * np.arange(self.count), dtype=np.float64)

    def _loops_s(self) -> Array:
        last = int(np.ceil((self.count - 1) * self.period_s / self.loop_s - _ROUNDING))
        return np.asarray(self.loop_s * np.arange(last + 1), dtype=np.float64)

    def on_loop(self, values: Array) -> Array:
        """Setpoints, (count,), as the loop has them: one entry per run of it."""
        return values if self._same else np.asarray(np.interp(self._loops_s() - self.lag_s, self._sent_s(), values))

    def zero_order_hold(self, values: Array) -> Array:
        """Values, one per setpoint, that act from their setpoint to the next: one entry per run of the loop."""
        if self._same:
            return values
        latest = np.floor(self._loops_s() / self.period_s + _ROUNDING).astype(int)
        return np.asarray(values[np.minimum(latest, self.count - 1)])

    def in_loop(self, values: Array) -> Array:
        """Setpoints as the loop has them when the drive samples, (count,)."""
        return values if self._same else np.asarray(np.interp(self._sent_s() - self.lag_s, self._sent_s(), values))

    def at_samples(self, values: Array) -> Array:
        """Values of each run of the loop, at the samples that go with the setpoints, (count,)."""
        return values if self._same else np.asarray(np.interp(self._sent_s(), self._loops_s(), values))

    def latest(self, values: Array) -> Array:
        """Latest of the values of each run of the loop that was decided when the drive samples, (count,)."""
        if self._same:
            return values
        return np.asarray(values[np.floor(self._sent_s() / self.loop_s + _ROUNDING).astype(int)])

    def along(self, values: Array) -> Array:
        """A torque that fits the host's reference, as it must be sent to fit the loop's, N m, (count,).

        Held for a period, it stands for the middle of that, where it came with each run of the loop for the middle of one; the reference is
        late by ``lag_s``: half of this is left.
        """
        return values if self._same else np.asarray(np.interp(self._sent_s() - 0.5 * self.lag_s, self._sent_s(), values))


LoopKind = Literal["velocity", "position"]
#: s: a part of a period shorter than this is none.
_NO_TIME_S = 1e-9


@dataclass(frozen=True)
class LoopDrive:
    """A drive around its controller.

    Attributes
    ----------
    period_s : float
        Of its loops.
    delay_s : float
        Torque setpoint to acting torque.
    torque_limit_nm : float, motor shaft
    counts_per_rev : int
        Of the encoder.
    dead_zone_rad : float
        Position error that does not count.
    output_limit_rad_s : float
        Of the position controller.
    """

    period_s: float
    delay_s: float
    torque_limit_nm: float
    counts_per_rev: int
    dead_zone_rad: float = 0.0
    output_limit_rad_s: float = math.inf


@dataclass(frozen=True)
class LoopRun:
    """Motion of the plant, (n,), at the start of each loop period.

    Attributes
    ----------
    position_rad, velocity_rad_s : ndarray, motor shaft
        From where the plant began.
    cart_m : ndarray
        Carriage, from where it began.
    asked_nm, torque_nm : ndarray
        Torque setpoint and acting torque, motor shaft.
    belt_force_n : ndarray
        Largest within the period.
    """

    position_rad: Array
    velocity_rad_s: Array
    cart_m: Array
    asked_nm: Array
    torque_nm: Array
    belt_force_n: Array


def waiting_torque(cascade: Cascade, drive: LoopDrive) -> Array:
    """Torque setpoints that do not act yet, N m: those that held the axis before.

    Parameters
    ----------
    cascade : Cascade
        With the torque that holds the axis.
    drive : LoopDrive
        With delay and period.
    """
    return np.full(math.floor(drive.delay_s / drive.period_s + _NO_TIME_S) + 1, cascade.feedforward.offset_nm)


def close_loop(
    plant: Plant,
    cascade: Cascade,
    drive: LoopDrive,
    kind: LoopKind,
    position_rad: Array,
    velocity_rad_s: Array,
    added_nm: Array,
    *,
    acceleration_rad_s2: Array | None = None,
    speed_rad_s: float = 0.0,
    state: Array | None = None,
    waiting_nm: Array | None = None,
) -> LoopRun:
    """The drive's own loop on a plant, one reference per loop period.

    Parameters
    ----------
    plant : Plant
        It is moved on.
    cascade : Cascade
    drive : LoopDrive
        Limits and steps of the drive.
    kind : LoopKind
        Which loop is closed; "velocity" leaves the position free.
    position_rad, velocity_rad_s, added_nm : ndarray (n,)
        References at the motor shaft and torque added to the controller's; the plant stands at the first position.
    acceleration_rad_s2 : ndarray (n,) or None
        That the feedforward knows of; when left out the reference's own.
    speed_rad_s : float
        At which the loop finds the motor.
    state : ndarray (10,) or None
        Of a loop that was closed before, which goes on; see :func:`beltcomm.control.new_state`.  It is moved on.
    waiting_nm : ndarray or None
        Torque setpoints of that loop that do not act yet, of :func:`waiting_torque`.  They are moved on.
    """
    coefficients, start_rad = discrete_coefficients(cascade, drive.period_s, drive.torque_limit_nm), float(position_rad[0])
    if state is None:
        state = new_state()
        reset_state(state, start_rad - speed_rad_s * drive.period_s, speed_rad_s)
    if acceleration_rad_s2 is None:
        acceleration_rad_s2 = np.diff(velocity_rad_s, prepend=velocity_rad_s[0]) / drive.period_s
    references = np.stack([position_rad, velocity_rad_s, acceleration_rad_s2, added_nm])
    bound = drive.output_limit_rad_s / cascade.kpp_1_s if cascade.kpp_1_s > 0.0 else math.inf
    sensing = np.array([start_rad - plant.position_rad, 2.0 * math.pi / drive.counts_per_rev, drive.dead_zone_rad, bound])
    whole = math.floor(drive.delay_s / drive.period_s + _NO_TIME_S)
    late_s = max(drive.delay_s - whole * drive.period_s, 0.0)
    late_s = late_s if late_s > _NO_TIME_S else 0.0
    waiting = waiting_torque(cascade, drive) if waiting_nm is None else waiting_nm
    if type(plant) is SimulatedPlant and plant.plain:  # one that is derived may step otherwise
        out = plant.follow(kind == "position", coefficients, state, references, sensing, waiting, drive.period_s, late_s)
    else:
        out = _step_loop(plant, kind == "position", coefficients, state, references, sensing, waiting, drive.period_s, late_s)
    angle, speed, cart, asked, before, belt = out
    acting = (late_s * before + (drive.period_s - late_s) * np.append(before[1:], waiting[0])) / drive.period_s
    return LoopRun(angle, speed, cart, asked, acting, belt)


def _step_loop(
    plant: Plant,
    follows_position: bool,
    coefficients: Array,
    state: Array,
    references: Array,
    sensing: Array,
    waiting: Array,
    period_s: float,
    late_s: float,
) -> Array:
    """As :meth:`SimulatedPlant.follow`, for any plant."""
    out = np.empty((6, references.shape[1]))
    for k in range(references.shape[1]):
        out[:3, k] = plant.position_rad, plant.velocity_rad_s, plant.cart_position_m
        asked = setpoint(follows_position, coefficients, state, references, k, plant.position_rad, sensing)
        before = float(waiting[0])
        waiting[:-1] = waiting[1:]
        waiting[-1] = asked
        peak = 0.0
        if late_s > 0.0:
            plant.step(before, late_s)
            peak = abs(plant.belt_force_n)
        plant.step(float(waiting[0]), period_s - late_s)
        out[3:, k] = asked, before, max(peak, abs(plant.belt_force_n))
    return out


def simulate_loop(
    model: Model,
    cascade: Cascade,
    drive: LoopDrive,
    kind: LoopKind,
    start_m: float,
    reference_rad: Array,
    reference_rad_s: Array,
    added_nm: Array,
) -> LoopRun:
    """A closed loop as of :func:`close_loop`, on a model that begins at rest.

    Parameters
    ----------
    model : Model
        With any effects.
    cascade : Cascade
        That runs in the drive.
    drive : LoopDrive
        Limits and steps of the drive.
    kind : LoopKind
        Of the setpoints.
    start_m : float, m
        Carriage on the axis.
    reference_rad : ndarray (n,), rad
        Of the motor.
    reference_rad_s : ndarray (n,), rad/s
        Of the motor.
    added_nm : ndarray (n,), N m, motor shaft
        Torque sent along.

    Returns
    -------
    LoopRun
        With ``cart_m`` as it stands on the axis.
    """
    plant = SimulatedPlant(model, start_m)
    found = close_loop(plant, cascade, drive, kind, reference_rad, reference_rad_s, added_nm)
    return replace(found, cart_m=start_m + found.cart_m)
