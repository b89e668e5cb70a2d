"""Continuous and short-time load of a motor: I²t, before anything moves and while it does.

Torque is proportional to current, so  (τ/τ_rated)²  is the heat of the winding as a share of what it gives off for ever.  Above 1 the
excess  e(t) = ∫ ((τ/τ_rated)² - 1) dt ≥ 0  fills a store of  ((τ_peak/τ_rated)² - 1) T,  with T the time for which the motor bears its
peak torque from cold; at rest it empties by 1 per second.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from beltcomm.arrays import rms
from beltcomm.axis import Axis
from beltcomm.drive import Capabilities
from beltcomm.trajectory import Trajectory

#: s: peak torque from cold, where neither the drive nor axis.yaml tells (the default of 6410h:3 in a CMMP-AS, F1 p98).
USUAL_OVERLOAD_S = 2.0


@dataclass(frozen=True)
class Thermal:
    """rated_nm, peak_nm : N m, motor shaft.   overload_s : for which the peak is borne.   source : of that time, in words."""

    rated_nm: float
    peak_nm: float
    overload_s: float
    source: str

    @classmethod
    def of(cls, axis: Axis, capabilities: Capabilities) -> Thermal:
        """The weaker of motor and drive."""
        motor = axis.motor
        rated = min(motor.rated_torque_nm or math.inf, capabilities.rated_torque_nm)
        peak = min(motor.peak_torque_nm or math.inf, capabilities.peak_torque_nm)
        times = [
            (motor.overload_time_s, "motor.overload_time_s of axis.yaml"),
            (capabilities.overload_time_s, "the drive's own I²t time"),
        ]
        known = [(seconds, words) for seconds, words in times if seconds is not None]
        seconds, words = min(known) if known else (USUAL_OVERLOAD_S, "assumed: neither axis.yaml nor the drive tells")
        return cls(rated, max(peak, rated), seconds, words)

    @property
    def store_s(self) -> float:
        """Excess that the winding takes, s of rated heat."""
        return ((self.peak_nm / self.rated_nm) ** 2 - 1.0) * self.overload_s

    def share(self, torque_nm: float) -> float:
        """Heat of a torque, N m rms, motor shaft, as a share of what is given off for ever; 1 at the rated torque."""
        return (torque_nm / self.rated_nm) ** 2


@dataclass(frozen=True)
class HeatPlan:
    """Heat of a sequence of loads.

    Attributes
    ----------
    continuous : float
        Mean over the whole sequence, pauses included.
    fullest : float
        Largest share of the store.
    pauses_s : tuple of float
        Rests before each load, so that the store is empty when one begins that fills it.
    hottest : float
        Largest share of one load.
    """

    continuous: float
    fullest: float
    hottest: float
    pauses_s: tuple[float, ...]


def heat_plan(thermal: Thermal, loads: Iterable[tuple[float, float]]) -> HeatPlan:
    """Heat of loads (rms torque, N m; seconds) one after the other.

    Parameters
    ----------
    thermal : Thermal
        Rated torque and store of the motor.
    loads : iterable of tuple of float
        In their order; motor shaft.

    Returns
    -------
    HeatPlan
        Mean and largest share of what the motor bears for ever, filling of the store, and the pause before each, s.
    """
    heat = seconds = excess = fullest = hottest = 0.0
    pauses = []
    for torque, duration in loads:
        share = thermal.share(torque)
        more = (share - 1.0) * duration
        pause = excess if more > 0.0 else 0.0
        excess = max(excess - pause + more, 0.0)
        pauses.append(pause)
        heat, seconds = heat + share * duration, seconds + duration + pause
        hottest = max(hottest, share)
        fullest = max(fullest, excess / thermal.store_s if thermal.store_s > 0.0 else math.inf if excess > 0.0 else 0.0)
    return HeatPlan(heat / seconds if seconds else 0.0, fullest, hottest, tuple(pauses))


def path_rms_nm(path: Trajectory, inertia_kg_m2: float, ratio: float, mass_kg: float, friction_nm: float, held_nm: float = 0.0) -> float:
    """Torque of a rigid axis along a path, rms, N m at the motor:  τ = (Θ_e/i_t + i_t m) a + τ_C sign(v) + τ_g.

    Parameters
    ----------
    path : Trajectory
        Of the carriage.
    inertia_kg_m2 : float, kg m²
        Θ_e, motor side.
    ratio : float, m/rad
        i_t.
    mass_kg : float, kg
        Carriage with payload.
    friction_nm : float, N m, motor shaft
        τ_C.
    held_nm : float, N m, motor shaft
        τ_g, counted in the direction that takes more.
    """
    torque = (inertia_kg_m2 / ratio + ratio * mass_kg) * path.acceleration_m_s2 + friction_nm * np.sign(path.velocity_m_s)
    return rms(np.abs(torque) + abs(held_nm))


class HeatStore:
    """The excess of a running session, from the torque that the drive reports.

    Parameters
    ----------
    clock_s : float
        Of the drive, at the beginning.
    """

    def __init__(self, rated_nm: float, clock_s: float) -> None:
        self.rated_nm = rated_nm
        self.excess_s = 0.0
        self._until_s = clock_s
        self._row_s: float | None = None

    def rest_until(self, clock_s: float) -> float:
        """The stage was off until now; excess that is left, which is also how long it takes to go, s."""
        self.excess_s = max(0.0, self.excess_s - max(clock_s - self._until_s, 0.0))
        self._until_s, self._row_s = clock_s, None
        return self.excess_s

    def add(self, t_s: float, torque_nm: float) -> None:
        """One row of a record: the torque from its time, since the begin of the record, on."""
        if self._row_s is not None:
            self.excess_s = max(0.0, self.excess_s + ((torque_nm / self.rated_nm) ** 2 - 1.0) * (t_s - self._row_s))
        self._row_s = t_s

    def moved_until(self, clock_s: float) -> None:
        """A record has ended: its rows have counted its time."""
        self._until_s, self._row_s = clock_s, None
