"""Figures 6.1, 6.2, 6.3, 6.5, 6.7 and 6.8 of the source with our estimators; 6.4 and 6.6 only sketch what is measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beltcomm.encoder import formulas
from beltcomm.encoder.edges import INCREMENT_M, TICK_S
from beltcomm.report import style
from beltcomm.thesis.estimators import FINE_INCREMENT_M, PERIODS_S, EstimatorStudy

#: Colours of the methods in every figure.
HIGH_PASS, EVENTS, GATE, COMBINED = style.HELD_OUT, style.RESIDUAL, style.SEVERE, style.MEASURED


def figures(study: EstimatorStudy, caption: style.Caption) -> Mapping[str, Figure]:
    """All figures of the topic by file name."""
    with style.styled():
        return {
            "figure_6_1_high_pass": _high_pass(study, caption),
            "figure_6_2_resolution": _resolution(study, caption),
            "figure_6_3_states": _states(study, caption),
            "figure_6_5_errors": _errors(study, caption),
            "figure_6_7_time_out": _time_out(study, caption),
            "figure_6_8_signals": _signals(study, caption),
        }


def _high_pass(study: EstimatorStudy, caption: style.Caption) -> Figure:
    made = style.figure("Figure 6.1: velocity by the high-pass at 0.1 m/s, T_s = 62.5 us, T_R = 2 ms", 4.2, caption)
    axes = made.subplots()
    shown = (study._fine.t_s > 0.015) & (study._fine.t_s < 0.021)
    for read, step, colour in ((study._coarse, INCREMENT_M, style.SEVERE), (study._fine, FINE_INCREMENT_M, style.MEASURED)):
        axes.step(
            1e3 * read.t_s[shown],
            1e3 * read.high_pass[shown],
            where="post",
            color=colour,
            linewidth=1.2,
            label=f"{1e6 * step:.3g} um per increment",
        )
    axes.axhline(100.0, color=style.FAINT, linewidth=1.5, label="true velocity")
    axes.set_xlabel("time in ms")
    axes.set_ylabel("velocity in mm/s")
    axes.legend(loc="upper right", ncols=3)
    axes.set_ylim(99.5, 100.7)
    return made


def _resolution(study: EstimatorStudy, caption: style.Caption) -> Figure:
    made = style.figure("Figure 6.2: plain difference around Δξ/T_s = 2.5 mm/s, T_s = 1 ms", 4.2, caption)
    axes = made.subplots()
    read, low = study._bound, 1e3 * INCREMENT_M / PERIODS_S[0]
    axes.step(1e3 * read.t_s, 1e3 * read.high_pass, where="post", color=style.RESIDUAL, linewidth=1.3, label="plain difference (6.9)")
    axes.step(1e3 * read.t_s, 1e3 * read.combined, where="post", color=COMBINED, linewidth=1.6, label="combined (6.21)")
    axes.plot(
        [0.0, 15.0, 15.0, 40.0], [1.5 * low, 1.5 * low, 0.4 * low, 0.4 * low], color=style.MODEL, linewidth=1.6, label="true velocity"
    )
    axes.axhline(low, color=style.FAINT, linewidth=1.2, linestyle="--", label="Δξ/T_s (6.3)")
    axes.set_xlabel("time in ms")
    axes.set_ylabel("velocity in mm/s")
    axes.set_ylim(-0.3, 7.2)
    axes.legend(loc="upper right", ncols=2)
    return made


def _states(study: EstimatorStudy, caption: style.Caption) -> Figure:
    made = style.figure("Figure 6.3: forward, shaking across a line, back: channels, states and count", 6.0, caption)
    above, middle, below = made.subplots(3, 1, sharex=True, height_ratios=[1.0, 1.6, 1.4])
    s = study._states
    t = 1e3 * np.append(s.t_s, s.t_s[-1] + 5e-5)
    for levels, offset, name in ((s.level_a, 1.4, "A"), (s.level_b, 0.0, "B")):
        above.step(t, offset + np.append(levels, levels[-1]), where="post", color=style.MEASURED, linewidth=1.3)
        above.text(-0.02, offset + 0.5, name, ha="right", va="center")
    above.set_yticks([])
    above.set_ylabel("channels", labelpad=18.0)
    middle.step(t, np.append(s.state, s.state[-1]), where="post", color=style.RESIDUAL, linewidth=1.5)
    middle.set_yticks(range(1, 9), [f"S{k}" for k in range(1, 9)])
    middle.set_ylabel("state")
    below.step(t, np.append(s.plain, s.plain[-1]), where="post", color=style.MODEL, linewidth=1.6, label="every edge")
    below.step(t, np.append(s.count, s.count[-1]), where="post", color=style.MEASURED, linewidth=1.6, label="debounced")
    below.set_ylabel("count in increments")
    below.set_xlabel("time in ms")
    below.legend(loc="lower center")
    return made


def _errors(study: EstimatorStudy, caption: style.Caption) -> Figure:
    made = style.figure(
        "Figure 6.5: worst relative errors at constant speed",
        6.2,
        caption,
        ["Dots: measured on generated edges, 2.5 um, 10 ns, eight speeds within 1 % of each.  Lines: formulas."],
    )
    for axes, table in zip(made.subplots(1, 2, sharey=True), study.tables, strict=True):
        period = table.settings.period_s
        speed = np.geomspace(1e-4, 5.0, 1500)
        crossing = formulas.crossing_speed_m_s(INCREMENT_M, TICK_S, period)
        high_pass = formulas.high_pass_worst_percent(speed, INCREMENT_M, period, table.settings.lag_s)
        axes.plot(speed, high_pass, color=HIGH_PASS, linewidth=1.0, label="high-pass, bound (ours)")
        gate = formulas.gate_error_percent(speed, INCREMENT_M, TICK_S, sign=-1)
        axes.plot(speed, gate, color=GATE, linewidth=1.0, label="gate (6.16)")
        envelope = formulas.event_counter_envelope_percent(speed, INCREMENT_M, TICK_S, period)
        shown = envelope < 0.3
        axes.plot(speed[shown], envelope[shown], color=EVENTS, linewidth=1.0, linestyle="--", label="event counter, envelope (6.12)")
        worst = formulas.event_counter_worst_percent(speed, INCREMENT_M, TICK_S, period)
        axes.plot(speed, worst, color=EVENTS, linewidth=1.0, label="event counter, (C.5) with ⌊r⌋ − 1")
        _measured(axes, table.speed_m_s, table.worst["high_pass"], HIGH_PASS, "s")
        _measured(axes, table.speed_m_s, table.worst["gate"], GATE, "o")
        held = table.missing == 0.0
        _measured(axes, table.speed_m_s[held], table.worst["event_counter"][held], EVENTS, "^", 8)
        axes.plot(
            table.speed_m_s, table.worst["combined"], color=COMBINED, linestyle="none", marker="+", markersize=9, label="combined, measured"
        )
        axes.axvline(crossing, color=style.FAINT, linewidth=1.2, zorder=0.5)
        axes.annotate(f" (6.19): {1e3 * crossing:.3g} mm/s", (crossing, 1.3e-5), fontsize=8)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_ylim(1e-5, 3e3)
        axes.set_title(f"T_s = {1e3 * period:g} ms")
        axes.set_xlabel("speed in m/s")
    made.axes[0].set_ylabel("worst error in %")
    made.axes[1].legend(loc="upper right", fontsize=8)
    return made


def _measured(axes: Axes, speed: Any, error: Any, colour: str, marker: str, size: int = 5) -> None:
    axes.plot(speed, error, color=colour, linestyle="none", marker=marker, markersize=size)


def _time_out(study: EstimatorStudy, caption: style.Caption) -> Figure:
    made = style.figure("Figure 6.7: the velocity falls to zero at 2 T_s; gate measurement with T_out = 5 T_s", 4.2, caption)
    axes = made.subplots()
    t = study.stop.t_s / PERIODS_S[0]
    gate = {name: 1e3 * values for name, values in study.stop.gate_m_s.items()}
    axes.plot([0.0, 2.0, 2.0, 12.0], [2.5, 2.5, 0.0, 0.0], color=style.MODEL, linewidth=2.0, label="true velocity")
    axes.step(t, gate["frozen"], where="post", color=style.FAINT, linewidth=2.0, label="neither time-out nor extension")
    axes.step(t, gate["none"], where="post", color=style.RESIDUAL, linewidth=1.5, label="time-out only")
    axes.step(t, gate["bounded"], where="post", color=style.MEASURED, linewidth=1.5, label="with extension (6.17)")
    axes.set_xlabel("time in T_s")
    axes.set_ylabel("velocity in mm/s")
    axes.set_ylim(-0.1, 3.4)
    axes.legend(loc="upper right", ncols=2)
    return made


def _signals(study: EstimatorStudy, caption: style.Caption) -> Figure:
    made = style.figure("Figure 6.8: accelerating at 0.1 m/s2, T_s = 1 ms: readings and their errors", 6.4, caption)
    above, below = made.subplots(2, 1, sharex=True)
    read = study._ramp
    true = 0.1 * read.t_s
    named = (
        ("plain difference (6.9)", read.high_pass, HIGH_PASS, 1.0),
        ("event counter (6.4)", read.event_counter, EVENTS, 1.2),
        ("gate (6.14)", read.gate, GATE, 1.2),
        ("combined (6.21)", read.combined, COMBINED, 1.0),
    )
    for label, values, colour, width in named:
        above.step(1e3 * read.t_s, 1e3 * values, where="post", color=colour, linewidth=width, label=label)
        below.step(1e3 * read.t_s, 1e3 * (values - true), where="post", color=colour, linewidth=width)
    above.plot(1e3 * read.t_s, 1e3 * true, color=style.MODEL, linewidth=1.0, label="true velocity")
    crossing = 1e4 * formulas.crossing_speed_m_s(INCREMENT_M, TICK_S, PERIODS_S[0])
    for axes in (above, below):
        for share, style_of in ((0.5, ":"), (1.0, "--"), (1.5, ":")):
            axes.axvline(share * crossing, color=style.FAINT, linewidth=1.2, linestyle=style_of, zorder=0.5)
    above.annotate(" ξ_sw/2, ξ_sw, 3 ξ_sw/2", (1.5 * crossing, 0.5), fontsize=8)
    above.set_ylabel("velocity in mm/s")
    above.legend(loc="upper left", ncols=2)
    below.set_ylabel("error in mm/s")
    below.set_ylim(-5.2, 3.0)
    below.set_xlabel("time in ms")
    return made
