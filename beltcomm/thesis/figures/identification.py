"""Frequency responses of all ways on one axis, and what averaging gains (figures 3.5 to 3.7)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from beltcomm.arrays import decibels
from beltcomm.report.style import FAINT, HELD_OUT, MEASURED, MODEL, RESIDUAL, SEVERE, Caption, figure, styled
from beltcomm.thesis.identification import IdentificationStudy

#: Ways that are drawn, with their colours.
SHOWN = {
    "open loop, standing": FAINT,
    "direct": MODEL,
    "indirect, C as it runs": RESIDUAL,
    "strong, C 20 % off": SEVERE,
    "speed setpoint": HELD_OUT,
}


def figures(study: IdentificationStudy, caption: Caption) -> Mapping[str, Figure]:
    """Magnitudes with the true one and the controller, their errors below; scatter over averaged periods.  By name."""
    with styled():
        ways = figure("Open loop, direct, indirect, speed setpoint: the same axis (figure 3.6)", 6.0, caption)
        top, below = ways.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        top.semilogx(study.freq_hz, decibels(study.true), color=MEASURED, linewidth=1.8, label="true, moving")
        top.semilogx(study.freq_hz, decibels(study.controller), color=MEASURED, linestyle=":", label="controller C (weak), N m/rad")
        for way in study.ways:
            if way.name in SHOWN:
                found = way.response
                top.semilogx(found.freq_hz, decibels(found.h), color=SHOWN[way.name], linewidth=1.0, label=way.name)
                true = np.interp(found.freq_hz, study.freq_hz, np.abs(study.true))
                below.semilogx(found.freq_hz, 20 * np.log10(np.abs(found.h) / true), color=SHOWN[way.name], linewidth=1.0)
        top.set(ylabel="gain in dB, rad/(N m)")
        top.legend(ncols=2)
        below.set(ylabel="error in dB", xlabel="frequency in Hz", ylim=(-6, 6), xlim=(0.9, 400))
        gain = figure("Averaging n periods", 3.2, caption)
        axes = gain.subplots()
        counts = np.array(list(study.averaging))
        axes.loglog(counts, list(study.averaging.values()), "o", color=MODEL, label="scatter of the mean, measured")
        axes.loglog(counts, 1 / np.sqrt(counts), color=MEASURED, label="1/√n")
        axes.set(xlabel="periods averaged", ylabel="relative to one period")
        axes.set_xticks(counts, [str(n) for n in counts])
        axes.minorticks_off()
        axes.legend()
    return {"identification_ways": ways, "identification_averaging": gain, "identification_3_5": _current_loop(study, caption)}


def _current_loop(study: IdentificationStudy, caption: Caption) -> Figure:
    """Effect of the current loop on the direct estimate: nothing to its size, a dead time to its phase."""
    with styled():
        made = figure("Influence of the current loop on the direct estimate (figure 3.5)", 4.6, caption)
        top, below = made.subplots(2, 1, sharex=True)
        for name, found, colour in (("from the setpoint", study.by_setpoint, SEVERE), ("from the acting torque", study.by_torque, MODEL)):
            top.semilogx(found.freq_hz, decibels(found.h), color=colour, linewidth=1.0, label=name)
            below.semilogx(found.freq_hz, np.rad2deg(np.unwrap(np.angle(found.h))), color=colour, linewidth=1.0)
        freq = study.by_torque.freq_hz
        late = np.rad2deg(np.unwrap(np.angle(study.by_torque.h))) - 360.0 * freq * study.dead_time.value_s
        label = f"acting torque, {1e3 * study.dead_time.value_s:.3g} ms later (3.27)"
        below.semilogx(freq, late, color=MEASURED, linestyle=":", label=label)
        top.set(ylabel="gain in dB, rad/(N m)")
        top.legend()
        below.set(ylabel="phase in deg", xlabel="frequency in Hz", xlim=(0.9, 400))
        below.legend()
    return made
