"""Velocity from increments (6.1): high-pass, event counter, gate measurement and their combination, one compiled step per period.

In a loop: take the edges up to the sampling instant (``kernel.take_edge``), call one of the four steps with the decoder's registers,
close the period.  :func:`velocities` does that over a record, for all four at once.

What the source leaves open or what fails as printed is decided here:

- Event counter: below two increments in a period (6.4) has no value; 0 is returned, its numerator.
- Gate: (6.17) as printed replaces Δξ/T_inc by Δξ/τ from τ = T_s on, also while τ is shorter than the time between the last two
  increments, and so reads too fast at any steady speed below Δξ/T_s.  "bounded" takes the smaller of the two, at any τ.
- Time-out: an increment that comes T_out or more after the last one measures the standstill before it; the velocity stays 0.
- Combination: (6.20) is written for positive velocities; here it takes |ξ_l|.  With fewer than two increments in the period ξ_l stands
  in for the ξ_h that does not exist.  ``switching`` "printed" leaves that out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from beltcomm.arrays import Array, IntArray
from beltcomm.encoder.edges import INCREMENT_M, TICK_S, Edges, require_order
from beltcomm.encoder.kernel import INVALID, new_decoder, new_estimator, run_record
from beltcomm.errors import UsageError

Extension = Literal["bounded", "printed", "none"]
Switching = Literal["guarded", "printed"]

_EXTENSIONS: dict[Extension, float] = {"none": 0.0, "printed": 1.0, "bounded": 2.0}


@dataclass(frozen=True)
class EstimatorSettings:
    """Of the estimators.

    Attributes
    ----------
    increment_m : float
        Δξ_min.
    tick_s : float
        Δt_min.
    period_s : float
        T_s, a whole number of ticks.
    lag_s : float
        T_R of the high-pass (6.1), 0 for the plain difference (6.9).
    low_pass_s : float
        Time constant of the same first-order lag behind gate and event counter in the combination, 0 for none.
    timeout_s : float
        T_out, above T_s, infinite for none.
    extension : Extension
        What the gate says while no increment comes.
    switching : Switching
        Of the combination.
    """

    increment_m: float = INCREMENT_M
    tick_s: float = TICK_S
    period_s: float = 1e-3
    lag_s: float = 2e-3
    low_pass_s: float = 0.0
    timeout_s: float = 0.05
    extension: Extension = "bounded"
    switching: Switching = "guarded"

    @property
    def period_ticks(self) -> int:
        """Ticks of a sampling period."""
        return round(self.period_s / self.tick_s)


def checked(settings: EstimatorSettings) -> EstimatorSettings:
    """The settings as they are.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.

    Raises
    ------
    UsageError
        For one out of its range.
    """
    s = settings
    for name, value in (("increment", s.increment_m), ("tick", s.tick_s), ("period", s.period_s)):
        if not (math.isfinite(value) and value > 0.0):
            raise UsageError(f"the {name} is {value:g}; it must be above 0")
    if not s.tick_s < s.period_s:
        raise UsageError(f"the tick of {s.tick_s:g} s is not shorter than the sampling period {s.period_s:g} s; choose a shorter one")
    for name, value in (("T_R", s.lag_s), ("low-pass time constant", s.low_pass_s)):
        if not (math.isfinite(value) and value >= 0.0):
            raise UsageError(f"the {name} is {value:g} s; it must not be negative")
    if not s.timeout_s > s.period_s:
        raise UsageError(f"the time-out {s.timeout_s:g} s is not above the sampling period {s.period_s:g} s; choose a longer one (6.17)")
    if s.extension not in _EXTENSIONS:
        raise UsageError(f"there is no extension {s.extension!r}; take one of {', '.join(_EXTENSIONS)}")
    if s.switching not in ("guarded", "printed"):
        raise UsageError(f"there is no switching {s.switching!r}; take guarded or printed")
    return s


def coefficients(settings: EstimatorSettings) -> Array:
    """Numbers of the compiled steps: ndarray (9,).

    Δξ, Δt, T_s, poles of T_R and of the low-pass, T_s and T_out in ticks, extension (0 none, 1 printed, 2 bounded), guarded (0 or 1).

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.

    Raises
    ------
    UsageError
        For a setting out of its range.
    """
    s = checked(settings)
    if s.period_ticks < 1 or abs(s.period_ticks * s.tick_s - s.period_s) > 1e-6 * s.tick_s:
        raise UsageError(f"the sampling period {s.period_s:g} s is not a whole number of ticks of {s.tick_s:g} s; choose one that is")
    return np.array(
        [
            s.increment_m,
            s.tick_s,
            s.period_s,
            s.lag_s / (s.lag_s + s.period_s),
            s.low_pass_s / (s.low_pass_s + s.period_s),
            s.period_ticks,
            s.timeout_s / s.tick_s,
            _EXTENSIONS[s.extension],
            float(s.switching == "guarded"),
        ]
    )


@dataclass(frozen=True)
class Velocities:
    """A record at its sampling instants, all (n,).   t_s.

    Attributes
    ----------
    position_m : ndarray
        count times increment.
    increments : IntArray
        In the period up to t_s.
    high_pass, event_counter, gate, combined : ndarray, m/s
    invalid : int
        Edges that no motion makes; above 0 nothing here is to be trusted.
    """

    t_s: Array
    position_m: Array
    increments: IntArray
    high_pass: Array
    event_counter: Array
    gate: Array
    combined: Array
    invalid: int


def velocities(
    edges: Edges, settings: EstimatorSettings, duration_s: float, *, debounce: bool = True, start_velocity_m_s: float = 0.0
) -> Velocities:
    """The four estimators over a record, at the multiples of the sampling period up to ``duration_s``.

    Parameters
    ----------
    edges : Edges
        In the order of time.
    settings : EstimatorSettings
        Increment and tick as those of the edges.
    duration_s : float, s
        Of the record.
    debounce : bool
        As of :func:`count_increments`.
    start_velocity_m_s : float
        What the lags read before.

    Raises
    ------
    UsageError
        For a setting out of range or an encoder of other steps.
    DataError
        For edges out of order.
    """
    c = coefficients(settings)
    if (edges.increment_m, edges.tick_s) != (settings.increment_m, settings.tick_s):
        raise UsageError(
            f"the edges have {edges.increment_m:g} m per increment and {edges.tick_s:g} s per tick, "
            f"the settings {settings.increment_m:g} m and {settings.tick_s:g} s; make them equal"
        )
    require_order(edges)
    periods = int(np.floor(duration_s / settings.period_s * (1.0 + 1e-12)))
    registers = new_decoder(edges.level_a, edges.level_b, debounce=debounce)
    table = run_record(c, new_estimator(start_velocity_m_s), registers, edges.tick, edges.channel, edges.level, periods)
    high_pass, event_counter, gate, combined = (table[:, k].copy() for k in range(2, 6))
    return Velocities(
        np.asarray(settings.period_s * np.arange(1, periods + 1), dtype=np.float64),
        settings.increment_m * table[:, 0],
        table[:, 1].astype(np.int64),
        high_pass,
        event_counter,
        gate,
        combined,
        int(registers[INVALID]),
    )
