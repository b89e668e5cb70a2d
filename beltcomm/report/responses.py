"""Frequency responses: those of a run with 95 % bands and resonances, one axis by several ways, the parts of one response,
and the model over a measured one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beltcomm.arrays import Array, decibels
from beltcomm.identify.landmarks import Landmark, Landmarks
from beltcomm.identify.magnitude_fit import LARGEST_NOISE
from beltcomm.identify.smooth_response import SmoothResponse
from beltcomm.report import style
from beltcomm.residuals.responses import ResponsePair, below
from beltcomm.response import FrequencyResponse
from beltcomm.response.distortion import Silent

#: Colours of the records, told apart with any colour vision; a dashed line where they begin again.
COLOURS, LINES = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9"), ("-", (0, (4, 2)), (0, (1, 1)))

#: From this share of h on the band of the noise is as wide as the picture.
WIDEST = 0.95

#: Lines with a narrower band than this share of h set the scale.
CLEAR = 0.5

#: Colours of the ways in the order in which they are given; the open loop, which friction bends, is faint.
WAY_COLOURS = (style.RESIDUAL, style.MODEL, style.SEVERE, style.HELD_OUT, style.MEASURED)
OPEN = "#888888"

#: Lines per point of a curve that scatters: a median over so many is drawn.
SMOOTHED = 9


def responses_figure(
    shown: Sequence[tuple[str, FrequencyResponse, Landmarks | None]],
    sentences: Sequence[str],
    caption: style.Caption,
    models: Sequence[SmoothResponse | None] = (),
) -> Figure:
    """Magnitude and phase over frequency, and below them the landmarks by record where any were looked for.

    Parameters
    ----------
    shown : Sequence[tuple[str, FrequencyResponse, Landmarks or None]]
        Label, response, landmarks.
    sentences : sequence of str
        Below the title.
    caption : Caption
    models : Sequence[SmoothResponse or None]
        For each the model's curve with its band, drawn over the measured magnitude; none where there is none.
    """
    with style.styled():
        marked = 0.6 + 0.28 * len(shown) if any(marks is not None for *_, marks in shown) else 0.0
        made = style.figure("Frequency responses: places, amplitudes, directions", 7.3 + 1.5 * marked, caption, sentences)
        heights = [4.4, 2.4, marked] if marked else [4.4, 2.4]
        upper, middle, *below = made.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        for k, (label, response, marks) in enumerate(shown):
            colour, line = COLOURS[k % len(COLOURS)], LINES[k // len(COLOURS) % len(LINES)]
            _curve(upper, middle, response, label, colour, line)
            if k < len(models) and (smooth := models[k]) is not None:
                low, best, high = (20.0 * np.log10(one) for one in (smooth.low, smooth.magnitude, smooth.high))
                upper.fill_between(smooth.freq_hz, low, high, color=colour, alpha=0.3, lw=0.0, zorder=2.5)
                upper.plot(smooth.freq_hz, best, color=colour, linewidth=2.0, linestyle=line, zorder=3)
            if marks is not None:
                for mark, symbol in ((marks.antiresonance, "v"), (marks.resonance, "^")):
                    _mark(below[0], k, mark, colour, symbol)
        clear = [decibels(r.h[r.error_radius() < CLEAR * np.abs(r.h)]) for _, r, _ in shown]
        upper.set_ylim(min(float(np.min(c, initial=0.0)) for c in clear) - 6.0, max(float(np.max(c, initial=-60.0)) for c in clear) + 6.0)
        upper.set_ylabel("|angle/torque| in dB re 1 rad/(N m)")
        if any(models):
            upper.plot([], [], color="#777777", linewidth=2.0, label="thick: the model, with its 95 % band")
        middle.set_ylabel("phase in degrees")
        style.numbers_at(middle.yaxis, style.DEGREES)
        middle.set_ylim(-400.0, 60.0)
        for axes in below:
            style.numbers_at(axes.yaxis, range(len(shown)), [label.split(",")[0] for label, *_ in shown])
            axes.set_ylim(len(shown) - 0.4, -0.6)
            axes.set_title("antiresonance (down) and resonance (up) with 95 %", fontsize=9, fontweight="normal")
        lower = [middle, *below][-1]
        lower.set_xlabel("frequency in Hz")
        lower.set_xscale("log")
        lower.set_xlim(min(r.freq_hz[0] for _, r, _ in shown), max(r.freq_hz[-1] for _, r, _ in shown))
        style.hertz(lower.xaxis)
        style.legend(upper, title="95 % of the noise shaded")
    return made


def _curve(upper: Axes, middle: Axes, response: FrequencyResponse, label: str, colour: str, line: object) -> None:
    level = np.abs(response.h)
    share = np.minimum(response.error_radius() / level, WIDEST)
    freq = response.freq_hz
    upper.plot(freq, 20.0 * np.log10(level), color=colour, linestyle=line, linewidth=0.8, label=label)
    upper.fill_between(
        freq, 20.0 * np.log10(level * (1.0 - share)), 20.0 * np.log10(level * (1.0 + share)), color=colour, alpha=0.22, lw=0.0
    )
    # Single lines that friction turns by half a turn must not shift all that follow: every phase between -360 and 0, but for its noise.
    phase = np.degrees(np.angle(-response.h)) - 180.0
    half = np.degrees(np.arcsin(share))
    middle.plot(freq, phase, ".", color=colour, markersize=2.2)
    middle.fill_between(freq, phase - half, phase + half, color=colour, alpha=0.12, lw=0.0)


def _mark(axes: Axes, row: int, mark: Landmark | None, colour: str, symbol: str) -> None:
    if mark is not None:
        axes.errorbar([mark.freq_hz], [row], xerr=[mark.interval_hz], fmt=symbol, color=colour, markersize=6, capsize=3, linewidth=1.4)


@dataclass(frozen=True, eq=False)
class ResponseLine:
    """One response.

    Attributes
    ----------
    label : str
        In the legend.
    highest_hz : float
        Up to which it stands above its noise.
    opened : bool
        Of a standing axis.
    """

    label: str
    response: FrequencyResponse
    highest_hz: float
    opened: bool


def ways_figure(shown: Sequence[ResponseLine], caption: style.Caption) -> Figure:
    """Frequency responses of one axis by several ways: magnitude and phase above the noise, and the noise over the magnitude.

    Parameters
    ----------
    shown : sequence of ResponseLine, rad/(N m)
        One line for each way.
    caption : Caption
    """
    with style.styled():
        made = style.figure("The same axis by several ways", 8.2, caption)
        upper, middle, lower = made.subplots(3, 1, sharex=True, height_ratios=[1.7, 1.0, 0.9])
        colours = iter(WAY_COLOURS)
        for line in shown:
            found = line.response.lines(line.response.freq_hz <= line.highest_hz)
            colour = OPEN if line.opened else next(colours, style.FAINT)
            clear = found.noise < LARGEST_NOISE * np.abs(found.h)  # the phase of noise says nothing
            phase = np.where(clear, (np.degrees(np.angle(found.h)) - 10.0) % 360.0 - 350.0, np.nan)
            upper.plot(found.freq_hz, decibels(found.h), color=colour, linewidth=1.1, label=line.label)
            middle.plot(found.freq_hz, phase, color=colour, linewidth=1.0)
            lower.plot(found.freq_hz, 100.0 * found.noise / np.abs(found.h), color=colour, linewidth=0.9)
        upper.set_xscale("log")
        upper.set_ylabel("|angle/torque| in dB re 1 rad/(N m)")
        style.legend(upper)
        middle.set_ylabel("phase in degrees")
        style.numbers_at(middle.yaxis, style.DEGREES)
        middle.set_ylim(-380, 20)
        lower.set_yscale("log")
        lower.set_ylim(0.05, 200.0)
        style.numbers_at(lower.yaxis, [0.1, 1.0, 10.0, 100.0])
        lower.set_ylabel("noise in %")
        lower.set_xlabel("frequency in Hz")
        style.hertz(lower.xaxis)
    return made


@dataclass(frozen=True)
class Levels:
    """One record.   freq_hz (k,).   linear, noise (95 %), repeated : (k,), rad/(N m).

    Attributes
    ----------
    odd, even : Silent or None
        Of a multisine, else None.
    """

    label: str
    freq_hz: Array
    linear: Array
    noise: Array
    repeated: Array
    odd: Silent | None = None
    even: Silent | None = None


def levels_figure(shown: Sequence[Levels], caption: style.Caption) -> Figure:
    """Linear answer, distortion and noise of records, a column for each, on one scale in dB.

    Parameters
    ----------
    shown : sequence of Levels, rad/(N m)
        One for each record.
    caption : Caption
    """
    with style.styled():
        made = style.figure("Linear answer, distortion and noise", 4.2, caption)
        row = made.subplots(1, len(shown), sharey=True, squeeze=False)[0]
        for axes, one in zip(row, shown, strict=True):
            axes.set_title(one.label)
            _level_curve(axes, one.freq_hz, one.linear, style.MEASURED, "-", "measured")
            if one.odd is None or one.even is None:
                _level_curve(axes, one.freq_hz, _median(one.repeated), style.SEVERE, "--", "distortion: scatter from line to line")
            else:
                for part, colour, name in ((one.odd, style.SEVERE, "odd lines"), (one.even, style.RESIDUAL, "even lines")):
                    level = np.where(part.level > 0.0, part.level, np.nan) / (2.0 * np.pi * part.freq_hz)
                    _level_curve(axes, part.freq_hz, _median(level), colour, "--", f"distortion, {name}")
            _level_curve(axes, one.freq_hz, _median(one.noise), style.MODEL, ":", "noise, 95 %")
            axes.set_xscale("log")
            style.hertz(axes.xaxis)
            axes.set_xlabel("frequency in Hz")
        row[0].set_ylabel("|angle/torque| in dB re 1 rad/(N m)")
        row[0].set_ylim(-110.0, 20.0)
        for axes in row:
            style.legend(axes)
    return made


def _level_curve(axes: Axes, freq_hz: Array, level: Array, colour: str, line: str, label: str) -> None:
    with np.errstate(divide="ignore", invalid="ignore"):
        axes.plot(freq_hz, 20.0 * np.log10(level), color=colour, linestyle=line, linewidth=1.2, label=label)


def _median(level: Array) -> Array:
    """Running median, gaps left aside."""
    if len(level) < SMOOTHED:
        return level
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(level, SMOOTHED // 2, mode="edge"), SMOOTHED)
    known = np.isfinite(windows).any(axis=1)
    found = np.full(len(level), np.nan)
    found[known] = np.nanmedian(windows[known], axis=1)
    return found


#: Colours of the records, and the most that one picture shows.
PAIR_COLOURS, MOST = ("#000000", "#0072B2", "#D55E00", "#009E73"), 4


def _apart(pairs: Sequence[ResponsePair]) -> list[ResponsePair]:
    """Up to ``MOST`` responses that differ in place or amplitude, those with several periods first."""
    chosen: dict[tuple[float, float], ResponsePair] = {}
    for pair in sorted(pairs, key=lambda p: p.radius is None):
        chosen.setdefault((round(pair.cart_m, 1), float(f"{pair.amplitude_nm:.1g}")), pair)
    return list(chosen.values())[:MOST]


def bode_figure(pairs: Sequence[ResponsePair], landmarks: Mapping[str, float], caption: style.Caption) -> Figure:
    """Magnitude, phase, model over measurement and coherence, of up to four records that differ.

    Parameters
    ----------
    pairs : sequence of ResponsePair
        Measured and modelled responses of the records.
    landmarks : mapping of str to float, Hz
        Lines by name.
    caption : Caption
    """
    shown = _apart(pairs)
    with style.styled():
        made = style.figure("Frequency response: model over measurement", 9.6, caption)
        upper, middle, lower, strip = made.subplots(4, 1, sharex=True, height_ratios=[1.7, 1.0, 1.0, 0.5])
        for pair, colour in zip(shown, PAIR_COLOURS, strict=False):
            label = f"{pair.record}, {pair.cart_m:.2f} m, ±{pair.amplitude_nm:.3f} {pair.units.force}" + (
                " (held out)" if pair.held_out else ""
            )
            size = decibels(pair.measured)
            upper.plot(pair.freq_hz, size, ".", markersize=3.5, color=colour, label=f"measured: {label}")
            upper.plot(pair.freq_hz, decibels(pair.model), color=colour, linewidth=1.2, alpha=0.8)
            middle.plot(pair.freq_hz, below(pair.measured), ".", markersize=3.5, color=colour)
            phase = below(pair.model)
            broken = np.where(np.abs(np.diff(phase, prepend=phase[0])) > 180.0, np.nan, phase)
            middle.plot(pair.freq_hz, broken, color=colour, linewidth=1.2, alpha=0.8)
            level = np.abs(pair.measured)
            lower.plot(pair.freq_hz, 100.0 * np.abs(pair.model - pair.measured) / level, color=colour, linewidth=1.0)
            if pair.radius is not None:
                lower.plot(pair.freq_hz, 100.0 * pair.radius / level, color=colour, linewidth=0.9, linestyle=":")
            if pair.coherence is not None:
                strip.plot(pair.freq_hz, pair.coherence, ".", markersize=2.5, color=colour)
        upper.plot([], [], color="#777777", label="line: model, for the measured motion")
        lower.plot([], [], color="#777777", label="difference of model and measurement")
        lower.plot([], [], color="#777777", linestyle=":", label="what noise alone makes (95 %)")
        low, high = upper.get_ylim()
        for name, hz in landmarks.items():
            for axes in (upper, middle, lower, strip):
                axes.axvline(hz, color=style.FAINT, linewidth=1.2, zorder=0.5)
            upper.annotate(f" {name} {hz:.1f} Hz", (hz, low + 0.02 * (high - low)), rotation=90, va="bottom", ha="right", fontsize=8)
        upper.set_xscale("log")
        units = shown[0].units
        turned = ("position", "m") if units.force == "N" else ("angle", "rad")
        upper.set_ylabel(f"|{turned[0]}/{units.word}| in dB re 1 {turned[1]}/({units.force})")
        style.legend(upper)
        middle.set_ylabel("phase in degrees")
        lower.set_yscale("log")
        lower.set_ylim(0.1, 1500.0)
        style.numbers_at(lower.yaxis, [0.1, 1.0, 10.0, 100.0, 1000.0])
        lower.set_ylabel("difference in %")
        style.legend(lower, 2)
        middle.set_ylim(-370.0, 10.0)
        style.numbers_at(middle.yaxis, style.DEGREES)
        strip.set(xlabel="frequency in Hz", ylabel="coherence", ylim=(0.0, 1.05))
        style.hertz(strip.xaxis)
    return made
