"""Path of a friction sweep from where the carriage stands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from beltcomm.experiments import own_strokes, phases
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.schedule.strokes import SWEEP_LONGEST_S, SWEEP_SHORTEST_S, fastest_stroke_m_s, sweep_strokes
from beltcomm.trajectory import Strokes


def farther_end_m(machine: Machine) -> float:
    """Last turning point of strokes from here, m: of the two ends the farther one."""
    low, high = phases.stroke_ends(machine)
    return high if high - machine.position_m > machine.position_m - low else low


def room_to_sweep(machine: Machine, model: Model, speeds_m_s: Sequence[float]) -> bool:
    """True if strokes at these speeds can begin where the carriage stands; those at the usual seven use the whole travel."""
    limits = phases.gentle_limits(machine, model, np.inf)
    way_m = abs(farther_end_m(machine) - machine.position_m)
    plateau_s = SWEEP_SHORTEST_S + own_strokes.settle_s(machine)
    return bool(speeds_m_s) and fastest_stroke_m_s(limits.speed_m_s, limits.acceleration_m_s2, way_m, plateau_s) >= max(speeds_m_s)


def sweep(machine: Machine, model: Model, speeds_m_s: Sequence[float] = (), longest_s: float = SWEEP_LONGEST_S) -> Strokes:
    """:func:`sweep_strokes` from where the carriage stands to the farther end.

    Parameters
    ----------
    speeds_m_s : sequence of float
        Instead of the usual seven.
    """
    at, period = machine.position_m, machine.drive.capabilities.sample_period_s
    far = farther_end_m(machine)
    limits, settle_s = phases.gentle_limits(machine, model, np.inf), own_strokes.settle_s(machine)
    return phases.stoppable(
        machine, limits, lambda slower_: sweep_strokes(at, far, slower_, period, "twice", speeds_m_s, settle_s, longest_s)
    )
