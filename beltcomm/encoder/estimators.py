"""Velocity from increments (6.1): high-pass, event counter, gate measurement and their combination, one compiled step per period.

In a loop: take the edges up to the sampling instant (:func:`beltcomm.encoder.quadrature.take_edge`), call one of the four steps with the
decoder's registers, close the period.  :func:`velocities` does that over a record, for all four at once.

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
from numpy.typing import NDArray

from beltcomm.compiled import compiled
from beltcomm.encoder.edges import INCREMENT_M, TICK_S, Edges
from beltcomm.encoder.quadrature import (
    COUNT,
    FIRST_TICK,
    GAP,
    INCREMENTS,
    INVALID,
    LAST_STEP,
    LAST_TICK,
    STEPS,
    close_period,
    new_decoder,
    require_order,
    take_edge,
)
from beltcomm.errors import UsageError

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
Extension = Literal["bounded", "printed", "none"]
Switching = Literal["guarded", "printed"]

_EXTENSIONS: dict[Extension, float] = {"none": 0.0, "printed": 1.0, "bounded": 2.0}
# Places in the state of an estimator.
_COUNT, _VELOCITY, _GATE, _EVENTS = range(4)


@dataclass(frozen=True)
class Settings:
    """Of the estimators.   increment_m : Δξ_min.   tick_s : Δt_min.   period_s : T_s, a whole number of ticks.

    lag_s : T_R of the high-pass (6.1), 0 for the plain difference (6.9).   low_pass_s : time constant of the same first-order lag behind
    gate and event counter in the combination, 0 for none.   timeout_s : T_out, above T_s; infinite freezes the last velocity.
    extension : what the gate says while no increment comes.   switching : of the combination.
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


def coefficients(settings: Settings) -> Array:
    """Numbers of the compiled steps: ndarray (9,).

    Δξ, Δt, T_s, poles of T_R and of the low-pass, T_s and T_out in ticks, extension (0 none, 1 printed, 2 bounded), guarded (0 or 1).
    Raises UsageError for a setting out of its range.
    """
    s = settings
    for name, value in (("increment", s.increment_m), ("tick", s.tick_s), ("period", s.period_s)):
        if not (math.isfinite(value) and value > 0.0):
            raise UsageError(f"the {name} is {value:g}; it must be above 0")
    if s.period_ticks < 1 or abs(s.period_ticks * s.tick_s - s.period_s) > 1e-6 * s.tick_s:
        raise UsageError(f"the sampling period {s.period_s:g} s is not a whole number of ticks of {s.tick_s:g} s; choose one that is")
    for name, value in (("T_R", s.lag_s), ("low-pass time constant", s.low_pass_s)):
        if not (math.isfinite(value) and value >= 0.0):
            raise UsageError(f"the {name} is {value:g} s; it must not be negative")
    if not s.timeout_s > s.period_s:
        raise UsageError(f"the time-out {s.timeout_s:g} s is not above the sampling period {s.period_s:g} s; choose a longer one (6.17)")
    if s.extension not in _EXTENSIONS:
        raise UsageError(f"there is no extension {s.extension!r}; take one of {', '.join(_EXTENSIONS)}")
    if s.switching not in ("guarded", "printed"):
        raise UsageError(f"there is no switching {s.switching!r}; take guarded or printed")
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


def new_estimator(velocity_m_s: float = 0.0) -> Array:
    """State of the estimators at count 0: ndarray (4,).   velocity_m_s : what they read before the first period, m/s.

    Count of the last sampling instant; high-pass velocity, low-passed gate and event velocities, m/s.
    """
    return np.array([0.0, velocity_m_s, velocity_m_s, velocity_m_s])


@compiled
def high_pass_step(c: Array, state: Array, registers: IntArray) -> float:
    """(6.1) by backward differences, of the counted position: (1 − z⁻¹)/(T_R + T_s − T_R z⁻¹).   Returns m/s.

    c, state, registers : ndarray (9,), (4,), (28,).
    """
    difference = (registers[COUNT] - state[_COUNT]) * c[0] / c[2]
    state[_COUNT] = registers[COUNT]
    state[_VELOCITY] = c[3] * state[_VELOCITY] + (1.0 - c[3]) * difference
    return float(state[_VELOCITY])


@compiled
def event_counter_step(c: Array, registers: IntArray) -> float:
    """(6.4): increments after the first of the period over the time from first to last; 0 below two increments.   Returns m/s.

    c, registers : ndarray (9,), (28,).
    """
    if registers[INCREMENTS] < 2:
        return 0.0
    return float(registers[STEPS] * c[0] / ((registers[LAST_TICK] - registers[FIRST_TICK]) * c[1]))


@compiled
def gate_step(c: Array, registers: IntArray, now_tick: int) -> float:
    """(6.14) with (6.17): one increment over the time between the last two, less while no new one comes, 0 from T_out on.   Returns m/s.

    c, registers : ndarray (9,), (28,).   now_tick : the sampling instant, in ticks.   0 as long as two increments in a row are not known.
    """
    waited = now_tick - registers[LAST_TICK]
    if registers[GAP] == 0 or registers[GAP] >= c[6] or waited >= c[6]:
        return 0.0
    ticks = float(registers[GAP])
    if c[7] == 2.0:
        ticks = max(ticks, float(waited))
    elif c[7] == 1.0 and waited > c[5]:
        ticks = float(waited)
    return float(registers[LAST_STEP] * c[0] / (ticks * c[1]))


@compiled
def switching_weight(speed: float, crossing: float) -> float:
    """(6.20): share of the event counter, 0 up to half the crossing of the methods, 1 from one and a half on.   Both m/s, speed ≥ 0."""
    if speed <= 0.5 * crossing:
        return 0.0
    if speed >= 1.5 * crossing:
        return 1.0
    return float(0.5 * (1.0 - np.sin(np.pi * speed / crossing)))


@compiled
def combined_step(c: Array, state: Array, registers: IntArray, now_tick: int) -> float:
    """(6.21): gate measurement and event counter, low-passed alike, then weighted by (6.20) with |ξ_l|.   Returns m/s.

    c, state, registers : ndarray (9,), (4,), (28,).   now_tick : the sampling instant, in ticks.
    """
    gate = gate_step(c, registers, now_tick)
    events = event_counter_step(c, registers)
    if registers[INCREMENTS] < 2 and c[8] != 0.0:
        events = gate
    state[_GATE] = c[4] * state[_GATE] + (1.0 - c[4]) * gate
    state[_EVENTS] = c[4] * state[_EVENTS] + (1.0 - c[4]) * events
    weight = switching_weight(abs(state[_GATE]), 2.0 * c[0] / (c[2] - c[1]))
    return float((1.0 - weight) * state[_GATE] + weight * state[_EVENTS])


@dataclass(frozen=True)
class Velocities:
    """A record at its sampling instants, all (n,).   t_s.   position_m : count times increment.   increments : in the period up to t_s.

    high_pass, event_counter, gate, combined : m/s.   invalid : edges that no motion makes; above 0 nothing here is to be trusted.
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
    edges: Edges, settings: Settings, duration_s: float, *, debounce: bool = True, start_velocity_m_s: float = 0.0
) -> Velocities:
    """The four estimators over a record, at the multiples of the sampling period up to ``duration_s``.

    start_velocity_m_s : what the lags read before.   Raises UsageError for a setting out of range or an encoder of other steps, DataError
    for edges out of order.
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
    table = _run(c, new_estimator(start_velocity_m_s), registers, edges.tick, edges.channel, edges.level, periods)
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


@compiled
def _run(c: Array, state: Array, registers: IntArray, tick: IntArray, channel: IntArray, level: IntArray, periods: int) -> Array:
    """Count, increments, and the four velocities at each sampling instant: ndarray (periods, 6)."""
    table = np.zeros((periods, 6))
    i = 0
    for k in range(periods):
        now = int((k + 1) * c[5])
        while i < len(tick) and tick[i] <= now:
            take_edge(registers, tick[i], channel[i], level[i])
            i += 1
        table[k, 0] = registers[COUNT]
        table[k, 1] = registers[INCREMENTS]
        table[k, 2] = high_pass_step(c, state, registers)
        table[k, 3] = event_counter_step(c, registers)
        table[k, 4] = gate_step(c, registers, now)
        table[k, 5] = combined_step(c, state, registers, now)
        close_period(registers)
    return table
