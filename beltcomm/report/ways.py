"""Frequency responses of one axis by several ways, with their noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from beltcomm.identify.magnitude_fit import LARGEST_NOISE
from beltcomm.report import style
from beltcomm.response import FrequencyResponse

#: Colours of the ways in the order in which they are given; the open loop, which friction bends, is faint.
COLOURS = (style.RESIDUAL, style.MODEL, style.SEVERE, style.HELD_OUT, style.MEASURED)
OPEN = "#888888"


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
    """Magnitude and phase as far as they stand above the noise, and the noise over the magnitude."""
    with style.styled():
        made = style.figure("The same axis by several ways", 8.2, caption)
        upper, middle, lower = made.subplots(3, 1, sharex=True, height_ratios=[1.7, 1.0, 0.9])
        colours = iter(COLOURS)
        for line in shown:
            found = line.response.lines(line.response.freq_hz <= line.highest_hz)
            colour = OPEN if line.opened else next(colours, style.FAINT)
            clear = found.noise < LARGEST_NOISE * np.abs(found.h)  # the phase of noise says nothing
            phase = np.where(clear, (np.degrees(np.angle(found.h)) - 10.0) % 360.0 - 350.0, np.nan)
            upper.plot(found.freq_hz, 20.0 * np.log10(np.abs(found.h)), color=colour, linewidth=1.1, label=line.label)
            middle.plot(found.freq_hz, phase, color=colour, linewidth=1.0)
            lower.plot(found.freq_hz, 100.0 * found.noise / np.abs(found.h), color=colour, linewidth=0.9)
        upper.set_xscale("log")
        upper.set_ylabel("|angle/torque| in dB re 1 rad/(N m)")
        upper.legend(loc="upper right", fontsize=8)
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
