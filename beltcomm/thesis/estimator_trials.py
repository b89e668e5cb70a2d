"""Trials of the velocity estimators on generated edges: what each reads while the true velocity is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array, IntArray, rms
from beltcomm.encoder import formulas
from beltcomm.encoder.edges import INCREMENT_M, TICK_S, Edges, Flaws, Motion, count_increments, edges_of
from beltcomm.encoder.estimators import EstimatorSettings, Extension, Switching, Velocities, velocities
from beltcomm.encoder.kernel import COUNT, LEVEL_A, LEVEL_B, STATE, new_decoder, take_edge

#: The estimators by the names of their fields in ``Velocities``, and by the source's order.
METHODS = ("high_pass", "event_counter", "gate", "combined")
#: Speeds of the table, m/s.
SPEEDS = (1e-4, 2e-4, 5e-4, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
#: Speeds tried around each, as factors: irrational steps, so that no broken part of a count repeats.
NEARBY = tuple(0.99 + 0.02 * ((k * 0.6180339887498949) % 1.0) for k in range(8))
#: Least periods and increments of a record, and the most increments.
_PERIODS, _INCREMENTS, _MOST = 100, 12, 8_000


@dataclass(frozen=True)
class MethodErrors:
    """Relative errors of one method at constant speed, percent.   worst, rms.

    Attributes
    ----------
    missing : float
        Share of periods in which it reads 0.
    """

    worst: float
    rms: float
    missing: float


def steady_errors(speed_m_s: float, settings: EstimatorSettings, flaws: Flaws | None = None) -> Mapping[str, MethodErrors]:
    """Errors of the four methods at speeds within 1 % of ``speed_m_s``, after three increments.

    Parameters
    ----------
    speed_m_s : float, m/s
        Of the carriage.
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    flaws : Flaws or None
        Of the encoder; None for an ideal one.

    Returns
    -------
    mapping of str to MethodErrors
        By method.
    """
    found: dict[str, list[Array]] = {name: [] for name in METHODS}
    step, period = settings.increment_m, settings.period_s
    for k, factor in enumerate(NEARBY):
        speed = speed_m_s * factor
        duration = max(_PERIODS * period, _INCREMENTS * step / speed)
        duration = max(min(duration, _MOST * step / speed), 20.0 * period)
        start = step * (k + 0.3) / len(NEARBY)
        edges = edges_of(_steady(start, speed), duration, increment_m=step, tick_s=settings.tick_s, scan_s=period, flaws=flaws)
        read = velocities(edges, settings, duration, start_velocity_m_s=speed)
        after = read.t_s > 3.5 * step / speed
        for name in METHODS:
            found[name].append(getattr(read, name)[after] / speed - 1.0)
    return {name: _errors(np.concatenate(parts)) for name, parts in found.items()}


def _steady(start_m: float, speed_m_s: float) -> Motion:
    return lambda t: start_m + speed_m_s * t


def _errors(relative: Array) -> MethodErrors:
    return MethodErrors(
        100.0 * float(np.max(np.abs(relative))),
        100.0 * rms(relative),
        float(np.mean(relative == -1.0)),
    )


@dataclass(frozen=True)
class SpeedTable:
    """Errors over speed at one sampling period, percent, (n,) by method name.

    Attributes
    ----------
    bounds : dict of str to ndarray
        What the formulas say: high_pass (own), event_counter (6.12), event_counter_worst (own), gate (6.16); nan where they have no value.
    missing : ndarray
        Share of periods without an event counter value.
    """

    settings: EstimatorSettings
    speed_m_s: Array
    worst: Mapping[str, Array]
    rms: Mapping[str, Array]
    bounds: Mapping[str, Array]
    missing: Array


def speed_table(settings: EstimatorSettings) -> SpeedTable:
    """Worst and rms error of the methods over speed, and what the formulas say.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    """
    rows = [steady_errors(v, settings) for v in SPEEDS]
    step, tick, period, lag = settings.increment_m, settings.tick_s, settings.period_s, settings.lag_s
    # The speeds tried lie within 1 %; a bound over them is taken where it is loosest.
    v = np.asarray(SPEEDS, dtype=np.float64)
    spread = [v * f for f in (min(NEARBY), 1.0, max(NEARBY))]
    return SpeedTable(
        settings,
        v,
        {name: np.array([row[name].worst for row in rows]) for name in METHODS},
        {name: np.array([row[name].rms for row in rows]) for name in METHODS},
        {
            "high_pass": np.max([formulas.high_pass_worst_percent(s, step, period, lag) for s in spread], axis=0),
            "event_counter": np.max([formulas.event_counter_envelope_percent(s, step, tick, period) for s in spread], axis=0),
            "event_counter_worst": np.max([formulas.event_counter_worst_percent(s, step, tick, period) for s in spread], axis=0),
            "gate": np.max([formulas.gate_error_percent(s, step, tick, sign=-1) for s in spread], axis=0),
        },
        np.array([row["event_counter"].missing for row in rows]),
    )


@dataclass(frozen=True)
class Debouncing:
    """A motion with and without debouncing: largest reading by method, m/s.

    All from the second half of the
    record, so that the direction which the state machine begins with does not matter.

    Attributes
    ----------
    true_m_s : float
        Largest true speed of it.
    increments_with, increments_without : int
        Increments counted.
    """

    true_m_s: float
    increments_with: int
    increments_without: int
    largest_with: Mapping[str, float]
    largest_without: Mapping[str, float]


def standstill_shaking(settings: EstimatorSettings) -> Debouncing:
    """Trial of debouncing: the axis stands and shakes by ±0.3 increments at 200 Hz across a line, at 24 places of it, 0.1 s each.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    """
    size_m, pulse = 0.3 * INCREMENT_M, 2.0 * np.pi * 200.0

    def motion(place: float) -> Motion:
        return lambda t: 10.0 * settings.increment_m + size_m * (np.sin(pulse * t) - place)

    made = [edges_of(motion(p), 0.1) for p in np.linspace(-0.98, 0.98, 24)]
    return _debouncing_trial(made, settings, 0.1, size_m * pulse, 0.0)


def debouncing_at_speed(settings: EstimatorSettings) -> Debouncing:
    """Trial of debouncing at constant speed, up to three contact bounces of 20 µs after each edge: largest deviation, by method.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    """
    speed_m_s, flaws = 0.01, Flaws(bounces=3, bounce_s=2e-5, seed=1)
    edges = edges_of(_steady(0.4 * settings.increment_m, speed_m_s), 0.2, flaws=flaws)
    return _debouncing_trial([edges], settings, 0.2, speed_m_s, speed_m_s)


def _debouncing_trial(
    made: Sequence[Edges], settings: EstimatorSettings, duration_s: float, true_m_s: float, mean_m_s: float
) -> Debouncing:
    counted, largest = [], []
    for debounce in (True, False):
        ticks = [count_increments(edges, debounce=debounce).tick for edges in made]
        counted.append(sum(int(np.count_nonzero(t > 0.5 * duration_s / settings.tick_s)) for t in ticks))
        read = [velocities(edges, settings, duration_s, debounce=debounce, start_velocity_m_s=mean_m_s) for edges in made]
        largest.append({n: float(max(np.max(np.abs(getattr(r, n)[r.t_s > 0.5 * duration_s] - mean_m_s)) for r in read)) for n in METHODS})
    return Debouncing(true_m_s, counted[0], counted[1], largest[0], largest[1])


@dataclass(frozen=True)
class Reversal:
    """An axis that turns at constant deceleration, over 32 places of the turning point between two lines and between two samples.

    Attributes
    ----------
    way_with, way_without : float
        Increments travelled back until the first increment back, mean.
    late_with_s, late_without_s : float
        Time after the turning point until the gate reads the new sign, mean. wrong_with, wrong_without : largest error of the gate's
        readings from the turning point until 10 ms later, m/s.
    count_apart : int
        Increments between the two counts at the end of the way back.
    """

    deceleration_m_s2: float
    way_with: float
    way_without: float
    late_with_s: float
    late_without_s: float
    wrong_with_m_s: float
    wrong_without_m_s: float
    count_apart: int


def reversal(settings: EstimatorSettings, deceleration_m_s2: float = 1.0) -> Reversal:
    """Trial of (6.1): debouncing delays a sign reversal by one increment.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    deceleration_m_s2 : float, m/s²
        Of the carriage.
    """
    early, step = 0.05, settings.increment_m
    ways: dict[bool, list[float]] = {True: [], False: []}
    late: dict[bool, list[float]] = {True: [], False: []}
    wrong: dict[bool, list[float]] = {True: [], False: []}
    apart = set()
    for k in range(32):
        peak, turn_s = (k + 0.5) / 32.0 * step, early + settings.period_s * (k * 0.6180339887 % 1.0)
        duration = 2.0 * early

        def motion(t: Array, peak: float = peak, turn_s: float = turn_s) -> Array:
            return peak - 0.5 * deceleration_m_s2 * (t - turn_s) ** 2

        edges = edges_of(motion, duration)
        counts = []
        for debounce in (True, False):
            counted = count_increments(edges, debounce=debounce)
            first = counted.tick[counted.tick * settings.tick_s > turn_s][0] * settings.tick_s
            ways[debounce].append(0.5 * deceleration_m_s2 * (first - turn_s) ** 2 / step)
            counts.append(counted.count)
            read = velocities(edges, settings, duration, debounce=debounce)
            true = deceleration_m_s2 * (turn_s - read.t_s)
            back = np.flatnonzero((read.t_s > turn_s) & (read.gate < 0.0))
            late[debounce].append(float(read.t_s[back[0]] - turn_s))
            near = (read.t_s > turn_s + 1e-9) & (read.t_s < turn_s + 0.01)
            wrong[debounce].append(float(np.max(np.abs(read.gate - true)[near])))
        apart.add(counts[0] - counts[1])
    (count_apart,) = apart
    return Reversal(
        deceleration_m_s2,
        float(np.mean(ways[True])),
        float(np.mean(ways[False])),
        float(np.mean(late[True])),
        float(np.mean(late[False])),
        max(wrong[True]),
        max(wrong[False]),
        count_apart,
    )


@dataclass(frozen=True)
class StopTrial:
    """Figure 6.7: the velocity falls from Δξ/T_s to 0 at 2 T_s; T_out = 5 T_s.   t_s, true_m_s, and the gate's readings by extension, (n,).

    "frozen" has neither extension nor time-out, "none" the time-out only.
    """

    t_s: Array
    true_m_s: Array
    gate_m_s: Mapping[str, Array]


def stop(period_s: float) -> StopTrial:
    """Trial of a velocity that jumps to zero just after an increment.

    Parameters
    ----------
    period_s : float, s
        T_s.
    """
    speed = INCREMENT_M / period_s
    duration = 12.0 * period_s
    # An increment at -0.5 T_s, 0.5 T_s, 1.5 T_s; a gap must be known when the record begins, so it begins 4 T_s early.
    early = 4.0 * period_s
    edges = edges_of(lambda t: speed * (np.minimum(t - early, 2.0 * period_s) + 0.5 * period_s), duration + early)
    base = EstimatorSettings(period_s=period_s, timeout_s=5.0 * period_s)
    variants: dict[str, EstimatorSettings] = {
        "frozen": replace(base, extension="none", timeout_s=np.inf),
        **{name: replace(base, extension=name) for name in _EXTENSIONS},
    }
    read = {name: velocities(edges, settings, duration + early) for name, settings in variants.items()}
    t = read["frozen"].t_s - early
    shown = t > -0.5 * period_s
    true = np.where(t <= 2.0 * period_s + 1e-12, speed, 0.0)
    return StopTrial(t[shown], true[shown], {name: r.gate[shown] for name, r in read.items()})


_EXTENSIONS: tuple[Extension, ...] = ("none", "printed", "bounded")


def extension_errors(settings: EstimatorSettings, speed_m_s: float) -> Mapping[str, MethodErrors]:
    """Errors of the gate at constant speed below Δξ/T_s by extension.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    speed_m_s : float, m/s
        Of the carriage.
    """
    return {name: steady_errors(speed_m_s, replace(settings, extension=name))["gate"] for name in _EXTENSIONS}


_SWITCHINGS: tuple[Switching, ...] = ("printed", "guarded")


def switching_errors(settings: EstimatorSettings, ratios: Sequence[float]) -> Mapping[str, Array]:
    """Worst errors of the combination, percent, at increments per period ``ratios``, by switching.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    ratios : sequence of float
        Increments per period.
    """
    speeds = [r * settings.increment_m / settings.period_s for r in ratios]
    return {name: np.array([steady_errors(v, replace(settings, switching=name))["combined"].worst for v in speeds]) for name in _SWITCHINGS}


@dataclass(frozen=True)
class Delay:
    """Delay of a method under constant acceleration, s: mean, least, largest, and what the formula says."""

    mean_s: float
    least_s: float
    largest_s: float
    formula_s: tuple[float, float]


def delays(settings: EstimatorSettings, speed_m_s: float, acceleration_m_s2: float) -> Mapping[str, Delay]:
    """Delays of the methods while the axis accelerates from rest through ``speed_m_s`` ± 5 %, and the least and largest of the formulas.

    Parameters
    ----------
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    speed_m_s : float, m/s
        Of the carriage.
    acceleration_m_s2 : float, m/s²
        Of the carriage.
    """
    end = 1.05 * speed_m_s / acceleration_m_s2
    late: dict[str, list[Array]] = {"high_pass": [], "event_counter": [], "gate": []}
    for k in range(16):

        def motion(t: Array, start: float = settings.increment_m * (k + 0.5) / 16.0) -> Array:
            return start + 0.5 * acceleration_m_s2 * t**2

        read = velocities(edges_of(motion, end), settings, end)
        near = read.t_s > 0.95 * speed_m_s / acceleration_m_s2
        for name, parts in late.items():
            parts.append((read.t_s - getattr(read, name) / acceleration_m_s2)[near])
    low, high = formulas.event_counter_delay_s(speed_m_s, settings.increment_m, settings.period_s)
    gate_low, gate_high = formulas.gate_delay_s(speed_m_s, settings.increment_m)
    lag = formulas.high_pass_delay_s(settings.period_s, settings.lag_s)
    expected = {
        "high_pass": (lag, lag),
        "event_counter": (float(low), float(high)),
        "gate": (float(gate_low), float(gate_high)),
    }
    all_late = {name: np.concatenate(parts) for name, parts in late.items()}
    return {n: Delay(float(np.mean(v)), float(np.min(v)), float(np.max(v)), expected[n]) for n, v in all_late.items()}


def record_of(motion: Motion, duration_s: float, settings: EstimatorSettings, start_velocity_m_s: float = 0.0) -> Velocities:
    """A motion seen by the encoder of ``settings`` and read by the four methods.

    Parameters
    ----------
    motion : Motion, m
        Position over time.
    duration_s : float, s
        Of the record.
    settings : EstimatorSettings
        Increment, m, tick, period and lags, s.
    start_velocity_m_s : float, m/s
        That the lags read before.
    """
    edges = edges_of(motion, duration_s, increment_m=settings.increment_m, tick_s=settings.tick_s)
    return velocities(edges, settings, duration_s, start_velocity_m_s=start_velocity_m_s)


@dataclass(frozen=True)
class States:
    """Figure 6.3: after each edge its time in s, levels of A and B, state S1 to S8, debounced count and plain count, (n,)."""

    t_s: Array
    level_a: IntArray
    level_b: IntArray
    state: IntArray
    count: IntArray
    plain: IntArray


def states(speed_m_s: float = 0.02) -> States:
    """States of the decoder during a motion: forward, a bounce, a stop that shakes across a line, and back.

    Parameters
    ----------
    speed_m_s : float, m/s
        Of the carriage.
    """
    gap = INCREMENT_M / speed_m_s

    def motion(t: Array) -> Array:
        way = np.interp(t / gap, [0.0, 6.4, 7.0, 11.0, 11.6, 18.0], [0.3, 6.7, 7.05, 7.05, 6.7, 0.3])
        shake = np.where((t > 7.0 * gap) & (t < 11.0 * gap), 0.2 * np.sin(2.0 * np.pi * (t / gap - 7.0)), 0.0)
        return np.asarray(INCREMENT_M * (way + shake))

    edges = edges_of(motion, 18.0 * gap, scan_s=0.05 * gap)
    registers = [new_decoder(edges.level_a, edges.level_b, debounce=d) for d in (True, False)]
    rows = [(0.0, edges.level_a, edges.level_b, int(registers[0][STATE]), 0, 0)]
    for tick, channel, level in zip(edges.tick, edges.channel, edges.level, strict=True):
        for each in registers:
            take_edge(each, tick, channel, level)
        with_play, plain = registers
        rows.append((tick * edges.tick_s, *(int(with_play[i]) for i in (LEVEL_A, LEVEL_B, STATE, COUNT)), int(plain[COUNT])))
    table = np.array(rows)
    return States(table[:, 0], *(table[:, k].astype(np.int64) for k in range(1, 6)))


def apart_rms_percent(speed_m_s: float, period_s: float) -> float:
    """Rms difference of the event counter from the plain difference (6.9) at constant speed, percent of it.

    Parameters
    ----------
    speed_m_s : float, m/s
        Of the carriage.
    period_s : float, s
        T_s.
    """
    settings = EstimatorSettings(period_s=period_s, lag_s=0.0, tick_s=TICK_S)
    parts = []
    for k, factor in enumerate(NEARBY):
        speed = speed_m_s * factor
        read = record_of(_steady(INCREMENT_M * (k + 0.3) / 8.0, speed), 60.0 * period_s, settings, speed)
        parts.append((read.event_counter - read.high_pass)[1:] / speed)
    return 100.0 * rms(np.concatenate(parts))
