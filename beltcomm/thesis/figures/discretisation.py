"""Discrete against continuous: error of the parts with its bound over frequency, and the open velocity loop."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from beltcomm.arrays import decibels
from beltcomm.design.loops import open_loops
from beltcomm.design.thesis import velocity_loop
from beltcomm.errors import UsageError
from beltcomm.report import style
from beltcomm.thesis.discretisation import PERIODS_S, Discretisation, ratio

COLOURS = dict(zip(PERIODS_S, (style.RESIDUAL, style.MODEL, style.SEVERE), strict=True))
LOWEST_HZ = 0.5
DASHED = (0, (4, 2))


def figures(study: Discretisation, caption: style.Caption) -> Mapping[str, Figure]:
    """The figures by name."""
    return {"discretisation_parts": _parts(study, caption), "discretisation_velocity_loop": _loop(study, caption)}


def _frequencies(period_s: float) -> np.ndarray:
    return np.geomspace(LOWEST_HZ, 0.4999 / period_s, 400)


def _parts(study: Discretisation, caption: style.Caption) -> Figure:
    panels = (
        ("velocity filter, T_R 2 ms", "velocity filter", study.butterworth),
        ("PI of the Butterworth design", "PI", study.butterworth),
        ("Butterworth filter", "prefilter", study.butterworth),
        ("notch filter", "prefilter", study.notch),
    )
    with style.styled():
        sentences = ["Solid: |discrete/continuous - 1|. Dashed: its bound. Each line ends at half the sampling frequency."]
        made = style.figure("The parts of the cascade, discrete against continuous", 6.6, caption, sentences)
        for axes, (title, part, design) in zip(made.subplots(2, 2, sharex=True, sharey=True).flat, panels, strict=True):
            for period in PERIODS_S:
                hz = _frequencies(period)
                try:
                    values, bounds = ratio(part, design.cascade, 2.0 * np.pi * hz, period)
                except UsageError:  # a notch above half the sampling frequency
                    continue
                axes.plot(hz, np.abs(values - 1.0), color=COLOURS[period], linewidth=1.5, label=f"T {1e3 * period:g} ms")
                axes.plot(hz, bounds, color=COLOURS[period], linewidth=1.0, linestyle=DASHED)
            for omega in (design.crossover_rad_s, study.plant.resonance_rad_s):
                axes.axvline(omega / (2.0 * np.pi), color=style.FAINT, linewidth=1.2, zorder=0.5)
            axes.set_title(title)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_ylim(1e-5, 3.0)
            axes.xaxis.set_major_formatter(style.plain_numbers())
        for axes in made.axes[2:]:
            axes.set_xlabel("frequency in Hz (grey: crossover, resonance)")
        for axes in made.axes[::2]:
            axes.set_ylabel("error, relative")
        made.axes[0].legend(loc="lower right", fontsize=8)
    return made


def _loop(study: Discretisation, caption: style.Caption) -> Figure:
    with style.styled():
        sentences = ["Continuous: plant (2.42). Sampled: plant (2.38) behind its hold, the parts as the drive runs them."]
        made = style.figure("Open velocity loop on G_A, Butterworth design", 6.2, caption, sentences)
        upper, lower = made.subplots(2, 1, sharex=True)
        hz = np.geomspace(LOWEST_HZ, 1000.0, 1200)
        curves = [("continuous", style.MEASURED, hz, velocity_loop(study.plant, study.butterworth.cascade, 2.0 * np.pi * hz))]
        for period in PERIODS_S:
            own = np.geomspace(LOWEST_HZ, min(1000.0, 0.4999 / period), 1200)
            loop = open_loops(study.plant, study.butterworth.cascade, period, 2.0 * np.pi * own)[0]
            curves.append((f"T {1e3 * period:g} ms", COLOURS[period], own, loop))
        for label, colour, at, values in curves:
            upper.plot(at, decibels(values), color=colour, linewidth=1.4, label=label)
            lower.plot(at, np.degrees(np.unwrap(np.angle(values))), color=colour, linewidth=1.4)
        upper.axhline(0.0, color="#777777", linewidth=0.8)
        upper.set_xscale("log")
        upper.set_ylim(-80.0, 30.0)
        lower.set_ylim(-480.0, 0.0)
        lower.axhline(-180.0, color="#777777", linewidth=0.8)
        upper.set_ylabel("magnitude in dB")
        lower.set_ylabel("phase in degrees")
        lower.set_xlabel("frequency in Hz")
        lower.xaxis.set_major_formatter(style.plain_numbers())
        upper.legend(loc="lower left", fontsize=8)
    return made
