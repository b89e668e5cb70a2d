"""Sensitivity of both loops over frequency, over all variants of the model: how much of a disturbance is left, and where it grows."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure

from beltcomm.design.cascade import DesignResult
from beltcomm.report import style

POINTS = 600
#: rad/s, where the picture begins.
LOWEST_RAD_S = 1.0


def sensitivity_figure(design: DesignResult, caption: style.Caption) -> Figure:
    """|S| = 1/|1 + L| in dB, the band of all variants and the worst of them, with the bound of the specification."""
    omega = np.geomspace(LOWEST_RAD_S, 0.999 * math.pi / design.structure.period_s, POINTS)
    pairs = [design.open_loops(i, omega) for i in range(len(design.plants))]
    hz = omega / (2.0 * math.pi)
    with style.styled():
        made = style.figure("Sensitivity: what the loops leave of a disturbance", 3.6, caption)
        for axes, name, loops in zip(
            made.subplots(1, 2, sharey=True), ("velocity loop", "position loop"), zip(*pairs, strict=True), strict=True
        ):
            level = -20.0 * np.log10(np.abs(1.0 + np.array(loops)))
            worst = int(np.argmax(level.max(axis=1)))
            axes.fill_between(hz, level.min(axis=0), level.max(axis=0), color=style.MODEL, alpha=0.35, linewidth=0.0, label="all variants")
            axes.plot(hz, level[worst], color=style.MEASURED, linewidth=1.2, label=f"worst: {level.max():.1f} dB")
            bound = design.specification.sensitivity_db
            axes.axhline(bound, color=style.SEVERE, linewidth=1.0, linestyle=(0, (5, 3)), label=f"allowed: {bound:g} dB")
            axes.set(xscale="log", xlabel="frequency in Hz", ylim=(-40.0, max(12.0, 1.1 * float(level.max()))), title=name)
            style.hertz(axes.xaxis)
            axes.legend(loc="lower right", fontsize=8)
        made.axes[0].set_ylabel("|S| in dB")
    return made
