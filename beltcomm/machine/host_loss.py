"""Death of the computer in torque mode: proven, computed before every record, and watched in it.

A drive in torque mode holds its last torque until it notices that nobody guards it; only then it brakes, or lets the axis coast.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.drive import GUARD_S, Capabilities, Guarding, Row
from beltcomm.errors import SafetyStop
from beltcomm.identify.amplitude import Prediction
from beltcomm.machine.machine import Machine
from beltcomm.machine.stops import Designed, PassiveBraking, braking_of
from beltcomm.model import Model
from beltcomm.simulate.stopping import HostLoss, braked_by_friction, run_on_distance, total_friction, total_inertia

#: s, over which the measured speed is a mean: longer than a swing of a stiff belt, shorter than the carriage takes to get fast.
SPEED_OVER_S = 0.012
#: m, within which an axis must stay while its drive's guarding is tried.
REACH_M = 1e-2
#: Speeds of the watch's table.
GRID = 200
#: Guard times that are tried, s, longest first: a short one makes a fault of every hiccup of the computer.
GUARD_TIMES_S = (GUARD_S, 0.035, 0.025, 0.02)


def prove(machine: Machine, holding_nm: float | None = None) -> Guarding:
    """Reaction of this drive to the silence of its host; seen at standstill when nobody has looked yet.

    Parameters
    ----------
    machine : Machine
    holding_nm : float or None
        What holds the axis meanwhile, N m.

    Raises
    ------
    DriveError
        For a drive that does not react.
    """
    if machine.guarding is None:
        held = machine.holding_nm if holding_nm is None else holding_nm
        # a tilted carriage slips the less, the sooner the drive reacts
        machine.guarding = found = _withhold(
            machine, guard_times_s(machine.drive.capabilities)[-1 if machine.axis.mounting.tilted else 0], held
        )
        then = "braked" if found.brakes else "took its stage off, so that it counts as one that lets the axis coast"
        machine.folder.journal(
            f"guarding was withheld at standstill: the drive noticed {1e3 * found.reaction_s:.0f} ms after the last sign of life (guard "
            f"time {1e3 * found.guard_s:.0f} ms) and {then}"
        )
    return machine.guarding


def _withhold(machine: Machine, guard_s: float, holding_nm: float) -> Guarding:
    """Prove the guarding (:meth:`beltcomm.drive.Drive.prove_guarding`); the axis must stay within ``REACH_M`` of where it stands."""
    machine.let_settle()
    full, at, begun = machine.envelope(), machine.position_m, machine.drive.clock.now()
    window = (max(full.window_m[0], at - REACH_M), min(full.window_m[1], at + REACH_M))
    try:
        return machine.drive.prove_guarding(machine.drive_limits(replace(full, window_m=window, guard_s=guard_s)), holding_nm)
    finally:
        machine.machine_seconds += machine.drive.clock.now() - begun


@dataclass(frozen=True)
class Losses:
    """Consequences of the host's death for a model, by guard time.

    Attributes
    ----------
    held_s : tuple of float, s
        How long the last torque is held with each guard time.
    counted : PassiveBraking or Designed
        What a stop of the drive is counted with.
    brakes : bool
        The drive brakes then; else it takes its stage off, and friction stops the axis, or its brake (torque, N m, and time to close,
        s); holding_nm, which a tilted axis needs, pulls until then.
    """

    held_s: tuple[float, ...]
    counted: PassiveBraking | Designed
    brakes: bool
    brake_nm: float
    brake_s: float
    holding_nm: float

    def __call__(self, model: Model) -> Sequence[HostLoss]:
        """One entry for each guard time."""
        if self.brakes:
            return [HostLoss(time, self.counted(model).by_the_drive) for time in self.held_s]
        friction = total_friction(model)
        if isinstance(self.counted, PassiveBraking) and self.counted.sliding_nm is not None:
            friction = self.counted.sliding_nm(total_inertia(model), model["transmission.ratio"])
        coasting = braked_by_friction(model, friction, 0.0)
        closed = braked_by_friction(model, max(self.brake_nm - self.holding_nm, 0.0), 0.0)
        if not self.holding_nm:
            braking = replace(coasting, besides=replace(closed, lag_s=self.brake_s)) if self.brake_nm else coasting
            return [HostLoss(time, braking) for time in self.held_s]
        left = closed if self.brake_nm else braked_by_friction(model, max(friction - self.holding_nm, 0.0), 0.0)
        return [HostLoss(time + self.brake_s, left, self.holding_nm) for time in self.held_s]


def losses_of(machine: Machine, sliding_nm: Callable[[float, float], float] | None = None) -> Losses:
    """Consequences of the host's death on this machine now.

    Parameters
    ----------
    machine : Machine
    sliding_nm : callable
        As in :func:`braking_of`.
    """
    guarding, own, motor = prove(machine), machine.drive.capabilities, machine.axis.motor
    held = tuple(guarding.held_s(time) + own.sample_period_s for time in guard_times_s(own))
    counted = braking_of(machine, sliding_nm)
    return Losses(held, counted, guarding.brakes, motor.brake_torque_nm or 0.0, machine.brake_s, abs(machine.holding_nm))


def chosen(predicted: Prediction, ends_m: float) -> int:
    """Number of the longest guard time with which the predicted record stays within ``ends_m`` of its start.

    Parameters
    ----------
    predicted : Prediction
        Of the record, for each guard time.
    ends_m : float, m
        Way to the nearer end of the travel.
    """
    fits = [number for number, place in enumerate(predicted.died_m) if place <= ends_m]
    return fits[0] if fits else len(predicted.died_m) - 1


def words(guard_s: float, run_on_m: float) -> str:
    """Sentence on the loss of the host, for a plan or a step of it.

    Parameters
    ----------
    guard_s : float, s
        Guard time.
    run_on_m : float, m
        Way until it stands.
    """
    return f"PC or bus lost: coasts {1e3 * run_on_m:.0f} mm at most ({1e3 * guard_s:.0f} ms of guard time)"


class RunOnWatch:
    """Call it with every row: were the host to die now, under the worst torque, the carriage must stop inside the window.

    Parameters
    ----------
    window_m : tuple[float, float]
        Of the carriage.
    ratio, origin_rad : float
        Carriage = ratio (angle - origin), m.
    family : sequence of Model
        Models it may be, of which the worst counts.
    torque_nm : float
        Largest of the record, N m.
    losses : callable
        Of a model, for the guard time in force.
    top_m_s : float
        Up to which speed the run-on is tabled; a faster carriage is beyond it.

    Raises
    ------
    SafetyStop
    """

    def __init__(
        self,
        window_m: tuple[float, float],
        ratio: float,
        origin_rad: float,
        family: Sequence[Model],
        torque_nm: float,
        losses: Callable[[Model], HostLoss],
        top_m_s: float,
    ) -> None:
        self._low, self._high = window_m
        self._ratio, self._origin = ratio, origin_rad
        self._step = top_m_s / (GRID - 1)
        speeds = np.linspace(0.0, top_m_s, GRID)
        tables = [
            run_on_distance(speeds, torque_nm, total_friction(model), total_inertia(model), model["transmission.ratio"], losses(model))
            for model in family
        ]
        self._ways: list[float] = np.max(tables, axis=0).tolist()
        self._rows: list[tuple[float, float]] = []

    def run_on_m(self, speed_m_s: float) -> float:
        """Way that the carriage would run on from this speed, at the next speed above of the table.

        Parameters
        ----------
        speed_m_s : float, carriage, 0 or above

        Returns
        -------
        float, m
            inf beyond the table.
        """
        number = math.ceil(speed_m_s / self._step)
        return self._ways[number] if number < len(self._ways) else math.inf

    def __call__(self, row: Row) -> None:
        """One row as the drive gives it."""
        rows = self._rows
        rows.append((row[0], row[3]))
        while row[0] - rows[0][0] > SPEED_OVER_S and len(rows) > 2:
            del rows[0]
        time_s = row[0] - rows[0][0]
        if time_s <= 0.0:
            return
        speed = self._ratio * (row[3] - rows[0][1]) / time_s
        place = self._ratio * (row[3] - self._origin)
        way = self.run_on_m(abs(speed))
        left = self._high - place if speed >= 0.0 else place - self._low
        if way > left:
            raise SafetyStop(
                f"at {1e3 * place:.1f} mm and {speed:.3g} m/s the carriage would run on by {1e3 * way:.0f} mm if the computer died now, "
                f"and {1e3 * left:.0f} mm are left to the end; the axis was stopped; reduce the amplitude or start nearer to the middle",
                "position",
            )


def guard_times_s(capabilities: Capabilities) -> tuple[float, ...]:
    """Guard times that drive and bus allow, longest first; the shortest one always.

    Parameters
    ----------
    capabilities : Capabilities

    Returns
    -------
    tuple of float, s
        At least one.
    """
    shortest = capabilities.shortest_guard_s or GUARD_S
    return (*(time for time in GUARD_TIMES_S if time > shortest), shortest)
