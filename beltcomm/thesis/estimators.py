"""The velocity estimators of section 6.1 and appendix C: errors over speed, reversal, standstill, time-out, what comes out and what not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from beltcomm.arrays import Array
from beltcomm.encoder import formulas
from beltcomm.encoder.edges import INCREMENT_M, TICK_S, Flaws
from beltcomm.encoder.estimators import EstimatorSettings, Velocities
from beltcomm.thesis import estimator_trials as trials
from beltcomm.thesis.estimator_loop import LoopResult, loop_results

#: s: T_s of our loops, and what the source's identification records suggest (it never states its T_s).
PERIODS_S = (1e-3, 62.5e-6)
#: Increments per period of the sweep around the crossing of the methods, in steps that meet no whole number.
RATIOS = tuple(float(r) for r in np.arange(1.05, 4.5, 0.1))
#: rad/s: crossovers of the source's velocity loops on G_A (notch, Butterworth), and T_R.
CROSSOVERS_RAD_S, LAG_S = (31.0, 42.0), 2e-3
#: m per increment of the second encoder in figure 6.1: 65536 counts per 78 mm (the source does not say which it used).
FINE_INCREMENT_M = 0.078 / 65536


@dataclass(frozen=True)
class Crossing:
    """The methods around ξ_sw.

    Attributes
    ----------
    ratio : ndarray
        ξ T_s/Δξ, (n,).
    gate, event_counter : ndarray
        Worst errors measured, percent, (n,), nan where missing.
    printed_m_s : float
        (6.19).
    better_from_m_s : float
        Lowest speed tried from which the event counter's worst error stays below the gate's.
    """

    period_s: float
    ratio: Array
    gate: Array
    event_counter: Array
    printed_m_s: float
    printed_worst_m_s: float
    better_from_m_s: float


@dataclass(frozen=True)
class EstimatorStudy:
    """All that the topic shows; what each is says the trial of its name."""

    tables: tuple[trials.SpeedTable, ...]
    crossing: Crossing
    saturation_m_s: float
    saturation_read_m_s: float
    shaking: trials.Debouncing
    bouncing: trials.Debouncing
    reversals: tuple[trials.Reversal, ...]
    stop: trials.StopTrial
    extension_speeds_m_s: tuple[float, ...]
    extension: tuple[Mapping[str, trials.MethodErrors], ...]
    switching_ratios: tuple[float, ...]
    switching: Mapping[str, Array]
    lines_rms: float
    lines_speeds_m_s: tuple[float, ...]
    lines_off: tuple[Mapping[str, trials.MethodErrors], ...]
    delay_speeds_m_s: tuple[float, ...]
    delays: tuple[Mapping[str, trials.Delay], ...]
    apart_speeds_m_s: tuple[float, ...]
    apart: Mapping[float, tuple[float, ...]]
    phase_deg: tuple[tuple[float, float], ...]
    loop: Mapping[str, Mapping[str, LoopResult]]
    _states: trials.States
    _fine: Velocities
    _coarse: Velocities
    _bound: Velocities
    _ramp: Velocities


def compare() -> EstimatorStudy:
    """Every trial at 2.5 um per increment, 10 ns per tick and T_R = 2 ms; T_s 1 ms where nothing else is said."""
    settings = EstimatorSettings(lag_s=LAG_S)
    period = settings.period_s
    extension_speeds = (2e-4, 5e-4, 1e-3)
    lines_speeds = (1e-3, 1e-2, 0.1, 1.0)
    delay_speeds = (0.01, 0.1, 1.0)
    apart_speeds = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
    switching_ratios = (1.05, 1.25, 1.5, 1.75, 1.95, 2.5)
    saturated = trials.record_of(lambda t: 249.0 * t, 2.0 * period, settings)
    return EstimatorStudy(
        tables=tuple(trials.speed_table(replace(settings, period_s=p)) for p in PERIODS_S),
        crossing=_crossing_errors(settings),
        saturation_m_s=formulas.highest_speed_m_s(INCREMENT_M, TICK_S),
        saturation_read_m_s=float(np.max(saturated.gate)),
        shaking=trials.standstill_shaking(settings),
        bouncing=trials.debouncing_at_speed(settings),
        reversals=tuple(trials.reversal(settings, a) for a in (0.1, 1.0, 10.0)),
        stop=trials.stop(period),
        extension_speeds_m_s=extension_speeds,
        extension=tuple(trials.extension_errors(settings, v) for v in extension_speeds),
        switching_ratios=switching_ratios,
        switching=trials.switching_errors(settings, switching_ratios),
        lines_rms=0.02,
        lines_speeds_m_s=lines_speeds,
        lines_off=tuple(trials.steady_errors(v, settings, Flaws(line_rms=0.02, seed=1)) for v in lines_speeds),
        delay_speeds_m_s=delay_speeds,
        delays=tuple(trials.delays(settings, v, 10.0 * v) for v in delay_speeds),
        apart_speeds_m_s=apart_speeds,
        apart={p: tuple(trials.apart_rms_percent(v, p) for v in apart_speeds) for p in PERIODS_S},
        phase_deg=tuple(
            (float(np.degrees(w * formulas.high_pass_delay_s(period, LAG_S))), float(np.degrees(w * 0.5 * period)))
            for w in CROSSOVERS_RAD_S
        ),
        loop=loop_results(),
        _states=trials.states(),
        _fine=_signal(FINE_INCREMENT_M),
        _coarse=_signal(INCREMENT_M),
        _bound=_near_resolution(),
        _ramp=_ramp(),
    )


def _crossing_errors(settings: EstimatorSettings) -> Crossing:
    """Worst errors of gate and event counter around 2 Δξ/T_s."""
    step, period = settings.increment_m, settings.period_s
    errors = [trials.steady_errors(r * step / period, settings) for r in RATIOS]
    gate = np.array([e["gate"].worst for e in errors])
    events = np.array([e["event_counter"].worst if e["event_counter"].missing == 0.0 else np.nan for e in errors])
    worse = np.flatnonzero(~(events < 0.98 * gate))
    return Crossing(
        period,
        np.asarray(RATIOS, dtype=np.float64),
        gate,
        events,
        formulas.crossing_speed_m_s(step, settings.tick_s, period),
        formulas.crossing_speed_m_s(step, settings.tick_s, period, sign=-1),
        RATIOS[min(int(worse[-1]) + 1, len(RATIOS) - 1)] * step / period,
    )


def _signal(increment_m: float) -> Velocities:
    """Figure 6.1: constant 0.1 m/s through the high-pass, T_s = 62.5 us, T_R = 2 ms."""
    settings = EstimatorSettings(increment_m=increment_m, period_s=PERIODS_S[1], lag_s=LAG_S)
    return trials.record_of(lambda t: 0.3e-6 + 0.1 * t, 0.03, settings, 0.1)


def _near_resolution() -> Velocities:
    """Figure 6.2: 1.5 and then 0.4 times Δξ/T_s, plain difference, T_s = 1 ms."""
    settings = EstimatorSettings(lag_s=0.0)
    low = formulas.lowest_speed_m_s(INCREMENT_M, settings.period_s)
    return trials.record_of(lambda t: 0.6e-6 + low * np.where(t < 0.015, 1.5 * t, 0.0225 + 0.4 * (t - 0.015)), 0.04, settings, 1.5 * low)


def _ramp() -> Velocities:
    """Figure 6.8: 0 to 0.02 m/s in 0.2 s, no filter behind gate and event counter, plain difference beside them, T_s = 1 ms."""
    return trials.record_of(lambda t: 0.05 * t**2, 0.2, EstimatorSettings(lag_s=0.0))


def lines(study: EstimatorStudy) -> list[str]:
    """The study in words and tables, with the source's statements beside ours."""
    said = [
        "Velocity from an incremental encoder: 2.5 um per increment, edges timed to 10 ns; for each speed eight within 1 % of it.",
        "The source does not state its T_s; 1 ms is that of our loops, 62.5 us what its identification records suggest.",
    ]
    for table in study.tables:
        said += ["", *_table_lines(table)]
    for part in (_crossing_lines, _debouncing_lines, _timeout_lines, _combination_lines, _delay_lines, _loop_lines, _verdict_lines):
        said += ["", *part(study)]
    return said


def _table_lines(table: trials.SpeedTable) -> list[str]:
    """Worst and rms error of the methods over speed, percent, and the formulas."""
    s = table.settings
    made = [
        f"Error in % at T_s = {1e3 * s.period_s:g} ms, T_R = {1e3 * s.lag_s:g} ms, T_out = {1e3 * s.timeout_s:g} ms "
        "(bound and exact: ours, see below; the others as printed)",
        "       | high-pass (6.1)            | event counter (6.4)                 | gate (6.14)                | combined (6.21)",
        "  mm/s |    worst      rms    bound |    worst      rms   (6.12)    exact |    worst      rms   (6.16) |    worst      rms",
    ]
    for i, speed in enumerate(table.speed_m_s):
        w, r, b = table.worst, table.rms, table.bounds
        events = (w["event_counter"][i], r["event_counter"][i], b["event_counter"][i], b["event_counter_worst"][i])
        cells = [
            f"{1e3 * speed:6g}",
            _numbers(w["high_pass"][i], r["high_pass"][i], b["high_pass"][i]),
            f"{f'no value in {100.0 * table.missing[i]:.0f} % of the periods':>35}" if table.missing[i] > 0.0 else _numbers(*events),
            _numbers(w["gate"][i], r["gate"][i], b["gate"][i]),
            _numbers(w["combined"][i], r["combined"][i]),
        ]
        made.append(" | ".join(cells))
    return made


def _numbers(*values: float) -> str:
    return " ".join(f"{v:8.3g}" if v >= 1e-3 else f"{v:8.1e}" for v in values)


def _crossing_lines(study: EstimatorStudy) -> list[str]:
    c = study.crossing
    unit = INCREMENT_M / c.period_s
    inside = np.flatnonzero((c.ratio > 2.0) & (c.ratio < 3.0))
    shares, last = c.event_counter[inside] / c.gate[inside], inside[-1]
    envelope = float(formulas.event_counter_envelope_percent(c.ratio[last] * unit, INCREMENT_M, TICK_S, c.period_s))
    return [
        "Where gate and event counter cross, T_s = 1 ms",
        f"  (6.19): {1e3 * c.printed_m_s:.5f} mm/s = 2 Δξ/(T_s − Δt) solves (6.12) = (6.16) for a gate time measured too long; "
        f"too short is worse and gives {1e3 * c.printed_worst_m_s:.5f}.",
        f"  Measured: below {2e3 * unit:g} mm/s the event counter lacks values; up to {3e3 * unit:g} mm/s the worst errors are alike, "
        f"ratio {np.min(shares):.2f} to {np.max(shares):.2f};",
        f"  it is better from {1e3 * c.better_from_m_s:.3g} mm/s on.",
        "  (C.3) counts ⌊r⌋ intervals, r = ξ T_s/Δξ: a lucky period, others have ⌊r⌋ − 1 (column exact), so (6.11), (6.12) are no bounds:",
        f"  at r = {c.ratio[last]:.2f} the worst error is {c.event_counter[last]:.2e} %, the envelope (6.12) {envelope:.2e} %.",
        f"  Saturation of the gate: {study.saturation_m_s:g} m/s (6.15); at 249 m/s it reads {study.saturation_read_m_s:.6g} m/s.  "
        "Faster, two edges share a tick and are counted as invalid.",
    ]


def _debouncing_lines(study: EstimatorStudy) -> list[str]:
    names = {"high_pass": "high-pass", "event_counter": "event counter", "gate": "gate", "combined": "combined"}
    made = [
        "Debouncing, T_s = 1 ms: largest error of the velocity in mm/s, without → with",
        f"  {'':34}{'increments':>14}" + "".join(f"{name:>19}" for name in names.values()),
    ]
    cases = (
        (f"standing, shaking ±0.75 um, {1e3 * study.shaking.true_m_s:.2g} mm/s", study.shaking),
        ("20 us of bounces at 10 mm/s", study.bouncing),
    )
    for title, case in cases:
        cells = "".join(f"{1e3 * case.largest_without[n]:9.3g} → {1e3 * case.largest_with[n]:7.2g}" for n in names)
        made.append(f"  {title:36}{case.increments_without:5d} → {case.increments_with:4d}{cells}")
    made.append("Reversal at a steady deceleration, over 32 places of the turning point; gate measurement")
    for turn in study.reversals:
        made.append(
            f"  {turn.deceleration_m_s2:4g} m/s2: first increment back after {turn.way_with:.2f} increments of way with debouncing, "
            f"{turn.way_without:.2f} without;"
        )
        made.append(
            f"             new sign after {1e3 * turn.late_with_s:.2f}, {1e3 * turn.late_without_s:.2f} ms in the mean; "
            f"largest error {1e3 * turn.wrong_with_m_s:.2f}, {1e3 * turn.wrong_without_m_s:.2f} mm/s"
        )
    made.append(
        f"  On the way back the debounced count stays {study.reversals[0].count_apart} increment above the plain one, never more: "
        "a play, no drift."
    )
    return made


_STOPS = {"frozen": "neither", "none": "time-out only", "printed": "with (6.17) as printed", "bounded": "with (6.17), only lowering"}


def _timeout_lines(study: EstimatorStudy) -> list[str]:
    return [
        "Time-out and its extension (6.17), T_s = 1 ms",
        "  Figure 6.7: the velocity falls from 2.5 mm/s to 0 at 2 T_s, T_out = 5 T_s; what the gate reads, mm/s, at t/T_s =",
        " " * 30 + "".join(f"{t / study.crossing.period_s:7.0f}" for t in study.stop.t_s),
        *(f"    {_STOPS[name]:26}" + "".join(f"{1e3 * v:7.3f}" for v in study.stop.gate_m_s[name]) for name in _STOPS),
        "  Steady speeds below Δξ/T_s, T_out = 50 ms: worst error of the gate in %",
        *(
            f"    {1e3 * v:4g} mm/s: time-out only {e['none'].worst:.1e}, (6.17) as printed {e['printed'].worst:.0f}, only lowering "
            f"{e['bounded'].worst:.1e}"
            for v, e in zip(study.extension_speeds_m_s, study.extension, strict=True)
        ),
        "  As printed, Δξ/τ replaces the measured velocity from τ = T_s on, also while the next increment is not due yet.",
    ]


def _combination_lines(study: EstimatorStudy) -> list[str]:
    percent = 100.0 * study.lines_rms
    made = [
        "Combination (6.20), (6.21), T_s = 1 ms: worst error in %",
        "  increments per period            " + "".join(f"{r:9g}" for r in study.switching_ratios),
        "  as printed                       " + "".join(f"{v:9.3g}" for v in study.switching["printed"]),
        "  ξ_l for ξ_h where n_inc < 2      " + "".join(f"{v:9.2g}" for v in study.switching["guarded"]),
        "  (6.20) weighs the event counter from one increment per period on, where (6.4) often has no value; it also needs |ξ_l|.",
        f"Lines of the scale off by {percent:g} % of an increment (rms): rms error in %; expected of the gate √2 · {percent:g} = "
        f"{np.sqrt(2.0) * percent:.1f} at any speed",
    ]
    for v, e in zip(study.lines_speeds_m_s, study.lines_off, strict=True):
        events = "  no value" if e["event_counter"].missing > 0.0 else f"{e['event_counter'].rms:10.2g}"
        made.append(
            f"  {1e3 * v:6g} mm/s: high-pass {e['high_pass'].rms:7.3g}   event counter {events}   gate {e['gate'].rms:7.2g}"
            f"   combined {e['combined'].rms:7.2g}"
        )
    made += [
        "Event counter and plain difference (6.9): rms apart in %; the source: diminishes above approximately 0.1 m/s",
        "  mm/s           " + "".join(f"{1e3 * v:8g}" for v in study.apart_speeds_m_s),
        *(f"  T_s {1e3 * p:7g} ms" + "".join(f"{v:8.3g}" for v in values) for p, values in study.apart.items()),
    ]
    return made


def _delay_lines(study: EstimatorStudy) -> list[str]:
    made = ["Delay in ms behind a steady acceleration of ten times the speed per second, T_s = 1 ms: mean, least to largest [our formula]"]
    for v, by_name in zip(study.delay_speeds_m_s, study.delays, strict=True):
        cells = [
            f"{name.replace('_', ' ')} {1e3 * d.mean_s:.3f}, {1e3 * d.least_s:.3f} to {1e3 * d.largest_s:.3f} "
            f"[{1e3 * d.formula_s[0]:.3f}" + (f" to {1e3 * d.formula_s[1]:.3f}]" if d.formula_s[1] > d.formula_s[0] else "]")
            for name, d in by_name.items()
        ]
        made.append(f"  {1e3 * v:5g} mm/s: " + "; ".join(cells))
    made.append("  The spread of the high-pass is its rounding; the gate at 1 m/s: a tick in its time is worth more than its delay.")
    return made


_LOOPS = {
    "high_pass": "high-pass, T_R = 2 ms",
    "high_pass_reference": "  and the reference behind it too",
    "event_counter": "event counter",
    "gate": "gate measurement",
    "combined": "combined",
}


def _loop_lines(study: EstimatorStudy) -> list[str]:
    made = [
        "In the loop: G_A with its published Butterworth gains, nonlinear feedforward with exact parameters, T_s = 1 ms, dead time 1 ms",
        " " * 36 + "".join(f"{name:>42}" for name in study.loop),
        " " * 36 + f"{'motor     cart  torque step  estimate':>42}" * len(study.loop),
        " " * 36 + f"{'um       um     mN m rms  mm/s rms':>42}" * len(study.loop),
    ]
    for name, words in _LOOPS.items():
        cells = (
            f"{1e6 * r.error_m:10.0f}{1e6 * r.cart_error_m:9.0f}{1e3 * r.torque_step_nm:13.2f}{1e3 * r.estimate_rms_m_s:10.2f}"
            for r in (moves[name] for moves in study.loop.values())
        )
        made.append(f"  {words:34}" + "".join(cells))
    for crossover, (with_lag, without) in zip(CROSSOVERS_RAD_S, study.phase_deg, strict=True):
        made.append(f"  Phase lost at the crossover of {crossover:g} rad/s: high-pass {with_lag:.1f} deg, event counter {without:.1f} deg.")
    return made


def _verdict_lines(study: EstimatorStudy) -> list[str]:
    fast = next(iter(study.loop.values()))
    plain, filtered, combined = (1e3 * fast[n].error_m for n in ("high_pass", "high_pass_reference", "combined"))
    slow, turn = study.tables[0], study.reversals[1]
    at = {v: i for i, v in enumerate(slow.speed_m_s)}
    limit = formulas.event_counter_limit_percent(TICK_S, slow.settings.period_s)
    won = [a - b for a, b in study.phase_deg]
    apart = dict(zip(study.apart_speeds_m_s, study.apart[PERIODS_S[1]], strict=True))
    return [
        "What comes out of the source's findings",
        "  The gate is better at low, the event counter at high speed; errors as (6.16) and (C.5) say; they cross at 2 to 3 Δξ/T_s.",
        f"  The event counter tends to 100 Δt/T_s = {limit:g} % (6.13): {slow.worst['event_counter'][at[5.0]]:.2g} % at 5 m/s.",
        "  Below Δξ/T_s each increment is a spike in the high-pass: worst error at 1 mm/s "
        f"{slow.worst['high_pass'][at[1e-3]]:.0f} %; of the combination {slow.worst['combined'][at[1e-3]]:.1e} %.",
        "  Debouncing removes false velocities at rest and delays a reversal by one increment; without time-out the gate never reads zero.",
        "What does not",
        "  (6.11) and (6.12) as bounds; (6.17) and (6.20) as printed; a tick as what limits the gate, once lines are off by a percent;",
        "  S_mod(i+1,4), which has an S_0: the states cycle S1 to S4, in reverse S5 to S8; (C.6), which lacks a factor 100 (erratum 13).",
        f"  Debouncing is not free: at {turn.deceleration_m_s2:g} m/s2 the gate errs by up to {1e3 * turn.wrong_with_m_s:.1f} mm/s after "
        f"the turn, without it by {1e3 * turn.wrong_without_m_s:.1f}.",
        "  'Diminishes for velocities above approximately 0.1 m/s': no knee at T_s = 1 ms; at 62.5 us the difference falls from",
        f"  {apart[0.1]:.0f} % at 0.1 to {apart[0.2]:.0f} % at 0.2 m/s, just above 2 Δξ/T_s = 80 mm/s: the sentence fits such a T_s.",
        f"  'Nearly an equivalent control performance' holds for margins ({won[0]:.1f} to {won[1]:.1f} degrees) and torque noise,",
        f"  and where the reference passes the same lag ({filtered:.2f} mm).  Against a reference that does not, the high-pass errs by",
        f"  {plain:.2f} mm in the 0.5 m move, the combination by {combined:.2f} mm: its lag does that, not its noise.",
        "  (The source measured below 1 mm in this move on its rig with the high-pass.)",
    ]
