"""Spectra and travel of the excitations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from beltcomm.excitation import prbs_bits
from beltcomm.report.style import HELD_OUT, MEASURED, MODEL, SEVERE, Caption, figure, styled
from beltcomm.thesis.excitations import MEANT, ExcitationStudy

COLOURS = {"prbs": MEASURED, "gprbs": MODEL, "chirp": HELD_OUT, "multisine": SEVERE}


def figures(study: ExcitationStudy, caption: Caption) -> Mapping[str, Figure]:
    """One figure per axis, by name: torque spectra in third octaves, deviations of the estimates."""
    made = {}
    for plant in dict.fromkeys(row.plant for row in study.rows):
        with styled():
            shown = figure(f"Excitations on {plant}, each as loud as the limits allow, at equal machine time", 4.2, caption)
            left, right = shown.subplots(1, 2, width_ratios=(3, 2))
            for kind, colour in COLOURS.items():
                freq, level = study.spectra[f"{plant} {kind}"]
                edges = np.geomspace(2.0, 500.0, 25)
                power = [np.sqrt(np.sum(level[(freq >= a) & (freq < b)] ** 2)) for a, b in itertools.pairwise(edges)]
                left.stairs(1e3 * np.array(power), edges, color=colour, label=kind, linewidth=1.6)
            left.set(xscale="log", yscale="log", xlabel="frequency in Hz", ylabel="torque per third octave in mN m")
            left.set_ylim(bottom=0.3)
            left.set_title("torque spectrum")
            left.legend()
            rows = [r for r in study.rows if r.plant == plant]
            for i, row in enumerate(rows):
                places = np.arange(len(MEANT)) + 0.2 * (i - 1.5)
                right.bar(places, [100 * row.error[n] for n in MEANT], 0.18, color=COLOURS[row.kind], label=row.kind)
            right.set_xticks(range(len(MEANT)), list(MEANT.values()))
            right.set(ylabel="rms error in %")
            right.set_title("error of the fitted model")
        made[f"excitations_{plant.replace(' ', '_')}"] = shown
    return made | {"excitations_3_1": _sequences(study, caption), "excitations_3_2": _spectra(study, caption)}


def _sequences(study: ExcitationStudy, caption: Caption) -> Figure:
    """(3.4) over time: a longer clock, and a higher order."""
    with styled():
        made = figure(f"PRBS by order and clock, T_s {1e6 * study.clock_s:g} µs (figure 3.1)", 4.2, caption)
        for axes, (order, clock) in zip(
            made.subplots(len(study.sequences), 1, sharex=True, squeeze=False)[:, 0], study.sequences, strict=True
        ):
            one = np.repeat(0.3 * (prbs_bits(order) - 0.5), clock)
            axes.step(study.clock_s * np.arange(len(one)), one, color=MODEL, linewidth=1.0, where="post")
            axes.set(ylabel="N m", title=f"order {order}, clock {clock}: {study.clock_s * len(one):.3g} s", xlim=(0.0, 0.6))
        axes.set(xlabel="time in s")
    return made


def _spectra(study: ExcitationStudy, caption: Caption) -> Figure:
    """Their lines, and the envelope A P T_s |sinc(f P T_s)| whose first zero is (3.5)."""
    with styled():
        made = figure("Spectra of these sequences: lines, and their envelope with the zeros of (3.5) (figure 3.2)", 4.2, caption)
        for axes, (order, clock) in zip(
            made.subplots(len(study.sequences), 1, sharex=True, squeeze=False)[:, 0], study.sequences, strict=True
        ):
            one = np.repeat(0.3 * (prbs_bits(order) - 0.5), clock)
            freq = np.fft.rfftfreq(len(one), study.clock_s)[1:]
            axes.plot(freq, 2e3 * np.abs(np.fft.rfft(one))[1:] / len(one), ".", color=MEASURED, markersize=2, label="lines")
            zero = 1.0 / (clock * study.clock_s)
            size = 2e3 * 0.15 * np.sqrt(2.0**order) / (2.0**order - 1.0)
            axes.plot(freq, size * np.abs(np.sinc(freq / zero)), color=MODEL, linewidth=1.0, label=f"envelope, first zero {zero:.4g} Hz")
            axes.set(
                ylabel="mN m",
                title=f"order {order}, clock {clock}: lines every {freq[0]:.3g} Hz (3.6)",
                xlim=(0.0, min(600.0, 0.5 / study.clock_s)),
            )
            axes.legend(fontsize="small")
        axes.set(xlabel="frequency in Hz")
    return made
