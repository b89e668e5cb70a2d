"""Frequency responses: model over measurement, with the noise of the measurement and its resonances named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from beltcomm.arrays import decibels
from beltcomm.report import style
from beltcomm.residuals.responses import ResponsePair, below

#: Colours of the records, and the most that one picture shows.
LINES, MOST = ("#000000", "#0072B2", "#D55E00", "#009E73"), 4


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
        for pair, colour in zip(shown, LINES, strict=False):
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
