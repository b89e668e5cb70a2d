"""Load of motor and belt by a motion, and its speed, while it is made: for whoever watches, not for what stops it."""

from __future__ import annotations

import math

from beltcomm.axis import Axis
from beltcomm.drive import Row
from beltcomm.talk import Gauge

#: Rows over which an acceleration is a mean: steps of the encoder must not pass for belt force.
OVER = 10


class Load:
    """Sees the rows of a record; :meth:`gauges` tells the largest since it was last asked.

    Parameters
    ----------
    most_nm : float, N m
        Limit of the torque.
    fastest_m_s : float, m/s
        Limit of the speed.
    """

    def __init__(self, axis: Axis, most_nm: float, fastest_m_s: float) -> None:
        self._ratio, self._inertia = axis.transmission_m_rad, (axis.motor.inertia_kg_m2 and axis.motor_side_inertia_kg_m2) or 0.0
        self._limits = (most_nm, axis.belt_force_limit_n, fastest_m_s)
        self._speeds: list[tuple[float, float]] = []
        self._torque = self._force = self._speed = 0.0

    def see(self, row: Row) -> None:
        """A row as the drive gives it.

        Parameters
        ----------
        row : Row, motor shaft
        """
        t_s, torque, setpoint, _, velocity, *_ = row
        torque = setpoint if math.isnan(torque) else torque
        if math.isnan(torque):
            torque = 0.0
        if abs(torque) > abs(self._torque):
            self._torque = torque
        if math.isnan(velocity):
            return
        self._speed = max(self._speed, abs(velocity) * self._ratio)
        self._speeds.append((t_s, velocity))
        if len(self._speeds) > OVER:
            begun_s, before = self._speeds.pop(0)
            if t_s > begun_s:
                driving = torque - self._inertia * (velocity - before) / (t_s - begun_s)
                self._force = max(self._force, abs(driving) / self._ratio)

    def gauges(self) -> tuple[Gauge, ...]:
        """Torque, belt force (of what the rotor does not take) and speed."""
        values = (self._torque, self._force, self._speed)
        self._torque = self._force = self._speed = 0.0
        names = (("torque", "N m"), ("belt", "N"), ("speed", "m/s"))
        told = zip(names, values, self._limits, strict=True)
        return tuple(Gauge(name, value, limit, unit) for (name, unit), value, limit in told if math.isfinite(limit))
