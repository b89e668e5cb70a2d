"""The strokes of a friction sweep: which speeds, over which way."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.identify.friction import SWEEP_SLOWEST_M_S
from beltcomm.trajectory import Strokes, constant_speed_strokes

#: Name of the sweep without an order.
DEFAULT = "default"
Which = Literal["twice", "once", "again"]

#: Friction sweep: number of speeds, run-in left out, shortest and longest plateau that counts.
SWEEP_SPEEDS = 7
SWEEP_RUN_IN_S = 0.2
SWEEP_SHORTEST_S = 0.1
SWEEP_LONGEST_S = 0.6
#: Rows a plateau must hold behind its run-in, for the mean of each of its batches; slowly polled drives need longer ones for that.
PLATEAU_ROWS = 20


def fastest_stroke_m_s(limits: TrajectoryLimits, window_m: float, plateau_s: float = SWEEP_SHORTEST_S) -> float:
    """Fastest stroke of a sweep, m/s, that still has a plateau:  v²/a + v (a/j + plateau) = window,  at most a share of the top speed.

    Two ramps of v (v/a + a/j)/2 each and a plateau with its run-in fill the window.

    Parameters
    ----------
    limits : TrajectoryLimits
        Of the carriage.
    window_m : float, m
        Way there is.
    plateau_s : float, s
        At constant speed, behind the run-in.
    """
    acceleration = limits.acceleration_m_s2
    wait = acceleration / limits.jerk_m_s3 + SWEEP_RUN_IN_S + plateau_s
    filled = 0.5 * acceleration * (np.sqrt(wait**2 + 4.0 * window_m / acceleration) - wait)
    return min(0.8 * limits.speed_m_s, float(filled))


def sweep_strokes(
    at_m: float,
    far_m: float,
    limits: TrajectoryLimits,
    period_s: float,
    which: Which = "twice",
    speeds_m_s: Sequence[float] = (),
    settle_s: float = 0.0,
    longest_s: float = SWEEP_LONGEST_S,
) -> Strokes:
    """Strokes both ways at seven speeds, from a slow creep to the fastest that still has a plateau within the travel.

    Parameters
    ----------
    at_m, far_m : float, m
        Ends of the strokes, the first one's start first.
    limits : TrajectoryLimits
        Of the carriage.
    period_s : float, s
        Of the drive.
    which : Which
        Three of the seven twice, each once, or two of them again, for how well friction repeats.
    speeds_m_s : sequence of float
        Instead of the seven; all slower in proportion where the fastest cannot be had.
    settle_s : float, s
        That the axis takes beside the run-in until it is as fast as its reference.
    longest_s : float, s
        Plateau that counts.
    """
    shortest_s = max(SWEEP_SHORTEST_S, PLATEAU_ROWS * period_s)
    fastest = fastest_stroke_m_s(limits, abs(far_m - at_m), shortest_s + settle_s)
    digit = 10.0 ** (np.floor(np.log10(fastest)) - 1.0)
    fastest = float(np.floor(fastest / digit) * digit)  # the carriage never begins at quite the same place, repeats need equal speeds
    speeds = [float(v) for v in np.geomspace(SWEEP_SLOWEST_M_S, fastest, SWEEP_SPEEDS)]
    speeds = {"twice": speeds + speeds[1::2], "once": speeds, "again": speeds[3::2]}[which]
    if speeds_m_s:
        speeds = [v * min(1.0, fastest / max(speeds_m_s)) for v in speeds_m_s]
    run_in_s = SWEEP_RUN_IN_S + settle_s
    given = {"run_in_s": run_in_s, "rest_s": 0.15, "longest_plateau_s": run_in_s + max(longest_s, 1.5 * shortest_s)}
    return constant_speed_strokes(at_m, far_m, speeds, limits, period_s, **given)
