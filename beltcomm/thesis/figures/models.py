"""Figures 2.4, 2.7 to 2.10, 3.7 and 3.9."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from beltcomm.arrays import ComplexArray, decibels
from beltcomm.report.style import FAINT, HELD_OUT, MEASURED, MODEL, RESIDUAL, SEVERE, Caption, figure, styled
from beltcomm.thesis.models import AVERAGED, FREQ_HZ, LINES_HZ, TRAVEL_M, ModelStudy

COLOURS = (MEASURED, MODEL, RESIDUAL, SEVERE, HELD_OUT)


def figures(study: ModelStudy, caption: Caption) -> Mapping[str, Figure]:
    """The figures by name."""
    with styled():
        springs = figure("Belt springs over the travel (figure 2.4)", 3.2, caption)
        axes = springs.subplots()
        for (name, values), colour in zip(study.springs.items(), (MODEL, RESIDUAL, FAINT, MEASURED), strict=True):
            axes.semilogy(TRAVEL_M, 1e-3 * values, color=colour, label=name)
        axes.set(xlabel="carriage position in m", ylabel="stiffness in kN/m")
        axes.legend(ncols=4)
        noise = figure("Above 500 Hz: one period and the mean of ten (figure 3.7)", 3.2, caption)
        axes = noise.subplots()
        for (n, (freq, h)), colour in zip(study.fine.items(), (FAINT, MODEL), strict=True):
            axes.plot(freq, decibels(h), ".", markersize=2, color=colour, label=f"{n} period{'s' if n > 1 else ''}")
        axes.set(xlabel="frequency in Hz", ylabel="gain in dB, rad/(N m)")
        axes.legend()
        reduced = figure("Lines of a response and those that are fitted (figure 3.9)", 2.0, caption)
        axes = reduced.subplots()
        axes.semilogx(LINES_HZ, np.zeros(len(LINES_HZ)), ".", color=FAINT, markersize=3, label=f"{len(LINES_HZ)} lines")
        axes.semilogx(study.chosen_hz, np.ones(len(study.chosen_hz)), ".", color=MODEL, label=f"{len(study.chosen_hz)} chosen")
        axes.set(xlabel="frequency in Hz", ylim=(-0.5, 1.8))
        axes.set_yticks([])
        axes.legend(ncols=2, loc="upper left")
    return {
        "figure_2_4_springs": springs,
        "figure_2_7_approximations": bode("Approximations on S_A (figure 2.7)", study.approximations, caption),
        "figure_2_8_parameter_sets": bode("Parameter sets S_A, S_B, S_C (figure 2.8)", study.parameter_sets, caption),
        "figure_2_9_places": bode("Three carriage positions (figure 2.9)", {f"{p:g} m": h for p, h in study.places.items()}, caption),
        "figure_2_10_cart": bode("Motor and carriage, S_A (figure 2.10)", study.cart, caption),
        f"figure_3_7_mean_of_{AVERAGED}": noise,
        "figure_3_9_reduction": reduced,
    }


def bode(title: str, curves: Mapping[str, ComplexArray], caption: Caption) -> Figure:
    """Gain and phase of some responses at :data:`FREQ_HZ`.

    Parameters
    ----------
    title : str
        Of the figure.
    curves : mapping of str to ndarray of complex
        By their names in the legend.
    caption : Caption
    """
    with styled():
        shown = figure(title, 4.6, caption)
        gain, phase = shown.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for (name, h), colour in zip(curves.items(), COLOURS, strict=False):
            gain.semilogx(FREQ_HZ, decibels(h), color=colour, label=name)
            phase.semilogx(FREQ_HZ, np.degrees(np.unwrap(np.angle(h))), color=colour)
        gain.set(ylabel="gain in dB")
        gain.legend(ncols=2)
        phase.set(ylabel="phase in degrees", xlabel="frequency in Hz")
    return shown
