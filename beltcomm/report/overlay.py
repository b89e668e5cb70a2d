"""The model laid over one record, torque over time and what is left over in units of the noise; the law of an effect over what a model
without it leaves."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beltcomm.arrays import Array, BoolArray
from beltcomm.laboratory.samples import Units
from beltcomm.report import style
from beltcomm.residuals.law import LawCurve
from beltcomm.residuals.responses import MEAN_S, Trace, running_mean

#: s: what the zoom shows of an excited record and of any other, and the window of the running rms.
EXCITED_S, SLOW_S, RMS_S = 0.3, 2.0, 0.1
#: Residuals beyond this many times the noise are drawn at the edge.
EDGE = 100.0


def _running_rms(trace: Trace) -> tuple[Array, Array]:
    """Middle and rms of the residual in windows that hold enough samples."""
    known = np.isfinite(trace.white)
    number = np.floor(np.where(known, trace.t_s, 0.0) / RMS_S).astype(int)
    count = np.bincount(number[known])
    total = np.bincount(number[known], trace.white[known] ** 2)
    level = np.where(count >= 20, np.sqrt(total / np.maximum(count, 1)), np.nan)
    return np.asarray((np.arange(len(level)) + 0.5) * RMS_S, dtype=np.float64), np.asarray(level, dtype=np.float64)


def overlay_figure(trace: Trace, caption: style.Caption) -> Figure:
    """Residual of the whole record above; model over measurement where it is worst; residual there.

    Parameters
    ----------
    trace : Trace
        Of one record.
    caption : Caption
    """
    kind = "held out" if trace.held_out else "fitted"
    with style.styled():
        title = f"Model over measurement in {trace.record} ({kind}): error {trace.ratio:.2f} times the noise"
        made = style.figure(title, 8.2, caption)
        whole, zoom, rest = made.subplots(3, 1, height_ratios=[1.0, 1.6, 1.0])
        middle, level = _running_rms(trace)
        length = EXCITED_S if trace.excited else SLOW_S
        low = _worst_begin(middle, level, length, float(np.nanmax(trace.t_s)))
        _whole_record(whole, middle, level, low, length)
        near = (trace.t_s >= low) & (trace.t_s <= low + length)
        _torques(zoom, trace, near)
        _residuals(rest, trace, near)
        rest.set_xlabel("time in the record in s")
        for axes in (zoom, rest):
            axes.set_xlim(low, low + length)
    return made


def _worst_begin(middle: Array, level: Array, length: float, end: float) -> float:
    """Begin of the stretch of that length whose rms is largest, among those in which most samples count."""
    count = max(1, round(length / RMS_S))
    known = np.isfinite(level)
    squares = np.convolve(np.where(known, level, 0.0) ** 2, np.ones(count), mode="valid") if len(level) >= count else np.zeros(1)
    covered = np.convolve(known, np.ones(count), mode="valid") if len(level) >= count else np.ones(1)
    worst = int(np.argmax(np.where(covered >= 0.6 * covered.max(), squares / np.maximum(covered, 1.0), 0.0)))
    begin = float(middle[worst]) - 0.5 * RMS_S if len(middle) else 0.0
    return max(0.0, min(begin, end - length))


def _whole_record(axes: Axes, middle: Array, level: Array, low: float, length: float) -> None:
    axes.step(middle, level, where="mid", color=style.RESIDUAL, linewidth=1.4)
    style.floor_line(axes)
    top = style.highest_shown([float(np.nanmax(level))] if np.isfinite(level).any() else [])
    style.ratio_ticks(axes, 0.5, top)
    axes.axvspan(low, low + length, color=style.FAINT, alpha=0.45, linewidth=0.0, label="shown below")
    axes.set_xlim(0.0, float(middle[-1]) + RMS_S if len(middle) else 1.0)
    axes.set_title("Whole record: error over noise (rms of 0.1 s; gaps: near standstill nothing can be said)")
    axes.set_ylabel("error / noise")
    axes.set_xlabel("time in the record in s")
    style.legend(axes, 2)


def _torques(axes: Axes, trace: Trace, near: BoolArray) -> None:
    time, measured, everywhere = trace.t_s[near], trace.measured[near], trace.model[near]
    model = np.where(np.isfinite(trace.white[near]), everywhere, np.nan)
    if trace.excited:
        axes.plot(time, measured, color=style.MEASURED, linewidth=0.8, marker=".", markersize=3, label="measured")
        axes.plot(time, everywhere, color=style.MODEL, linewidth=0.8)
        axes.plot(time, model, color=style.MODEL, linewidth=2.4, label="model, from the measured motion (thin: does not count)")
        shown = [measured, everywhere]
    else:
        width = max(1, round(MEAN_S / float(np.nanmedian(np.diff(trace.t_s)))))
        known = np.isfinite(model)
        shown = [running_mean(np.where(known, measured, np.nan), width), running_mean(model, width)]
        axes.plot(time, measured, ".", markersize=1.5, color=style.FAINT, label="measured, every sample")
        axes.plot(time, shown[0], color=style.MEASURED, linewidth=1.4, label=f"measured, mean of {1e3 * MEAN_S:.0f} ms")
        axes.plot(time, shown[1], color=style.MODEL, linewidth=2.2, alpha=0.9, label=f"model, mean of {1e3 * MEAN_S:.0f} ms")
        shown.append(measured)
    axes.set_ylim(*_wide(np.concatenate(shown)))
    axes.set_title(f"{trace.units.word.capitalize()} where the error is largest")
    axes.set_ylabel(f"{trace.units.word} in {trace.units.force}")
    style.legend(axes, 3)


def _residuals(axes: Axes, trace: Trace, near: BoolArray) -> None:
    shown = np.clip(trace.white[near], -EDGE, EDGE)
    axes.axhspan(-2.0, 2.0, color=style.FAINT, alpha=0.45, linewidth=0.0, label="±2: noise alone stays inside, 95 of 100 times")
    axes.plot(trace.t_s[near], shown, color=style.RESIDUAL, linewidth=0.5, marker=".", markersize=2.5)
    if not trace.excited:
        width = max(1, round(MEAN_S / float(np.nanmedian(np.diff(trace.t_s)))))
        axes.plot(trace.t_s[near], running_mean(shown, width), color=style.MEASURED, linewidth=1.6, label=f"mean of {1e3 * MEAN_S:.0f} ms")
    largest = float(np.nanmax(np.abs(shown))) if np.isfinite(shown).any() else 1.0
    axes.set_ylim(-max(5.0, 1.2 * largest), max(5.0, 1.6 * largest))
    edge = f"; beyond ±{EDGE:.0f} at the edge" if np.nanmax(np.abs(shown), initial=0.0) >= EDGE else ""
    axes.set_title(f"What is left over (model minus measured), in units of the noise{edge}")
    axes.set_ylabel("residual / noise")
    style.legend(axes, 2)


def _wide(values: Array) -> tuple[float, float]:
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    room = 0.15 * max(high - low, 1e-3)
    return low - room, high + 2.5 * room


def law_figure(name: str, curve: LawCurve, units: Units, caption: style.Caption) -> Figure:
    """Dots: what is missing, by direction; lines: the law.

    Parameters
    ----------
    name : str
        Of the effect, in words.
    curve : LawCurve
        Law, and what is missing without it.
    units : Units
    caption : Caption
    """
    unit = {"position": units.length, "speed": f"{units.length}/s", "time": "s", "angle": "rad", "torque": units.force}[curve.along]
    with style.styled():
        made = style.figure(f"{name}: its law over what the records show", 3.6, caption)
        axes = made.subplots()
        both = (
            ("positive direction", curve.missing_forward, curve.forward, style.RESIDUAL),
            ("negative direction", curve.missing_backward, curve.backward, style.SEVERE),
        )
        for words, missing, law, colour in both:
            axes.plot(curve.x, units.factor * missing, ".", color=colour, markersize=6, label=f"measured without it, {words}")
            axes.plot(curve.x, units.factor * law, color=colour, linewidth=1.6, label=f"law, {words}")
        axes.axhline(0.0, color=style.FAINT, linewidth=1.0, zorder=0.5)
        axes.set_xlabel(f"{'motor ' if curve.along in ('angle', 'torque') else ''}{curve.along} in {unit}")
        axes.set_ylabel(f"{units.word} in {units.small}")
        axes.legend(loc="best", fontsize=8)
    return made
