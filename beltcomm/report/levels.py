"""Parts of a frequency response: the linear answer, what repeats with the excitation and is not linear, and noise."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from beltcomm.report import style
from beltcomm.response.distortion import Silent

Array = NDArray[np.float64]
#: Lines per point of a curve that scatters: a median over so many is drawn.
SMOOTHED = 9


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
    """A column for each record; one scale in dB."""
    with style.styled():
        made = style.figure("Linear answer, distortion and noise", 4.2, caption)
        row = made.subplots(1, len(shown), sharey=True, squeeze=False)[0]
        for axes, one in zip(row, shown, strict=True):
            axes.set_title(one.label)
            _curve(axes, one.freq_hz, one.linear, style.MEASURED, "-", "measured")
            if one.odd is None or one.even is None:
                _curve(axes, one.freq_hz, _median(one.repeated), style.SEVERE, "--", "distortion: scatter from line to line")
            else:
                for part, colour, name in ((one.odd, style.SEVERE, "odd lines"), (one.even, style.RESIDUAL, "even lines")):
                    level = np.where(part.level > 0.0, part.level, np.nan) / (2.0 * np.pi * part.freq_hz)
                    _curve(axes, part.freq_hz, _median(level), colour, "--", f"distortion, {name}")
            _curve(axes, one.freq_hz, _median(one.noise), style.MODEL, ":", "noise, 95 %")
            axes.set_xscale("log")
            style.hertz(axes.xaxis)
            axes.set_xlabel("frequency in Hz")
            axes.legend(loc="upper right", fontsize=8)
        row[0].set_ylabel("|angle/torque| in dB re 1 rad/(N m)")
        row[0].set_ylim(-110.0, 20.0)
    return made


def _curve(axes: Axes, freq_hz: Array, level: Array, colour: str, line: str, label: str) -> None:
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
