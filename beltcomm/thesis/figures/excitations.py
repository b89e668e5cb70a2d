"""Spectra and travel of the excitations."""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from beltcomm.report.style import HELD_OUT, MEASURED, MODEL, SEVERE, Caption, figure, styled
from beltcomm.thesis.excitations import MEANT, PLANTS, ExcitationStudy

COLOURS = {"prbs": MEASURED, "gprbs": MODEL, "chirp": HELD_OUT, "multisine": SEVERE}


def figures(study: ExcitationStudy, caption: Caption) -> Mapping[str, Figure]:
    """One figure per axis: torque spectra in third octaves, deviations of the estimates."""
    made = {}
    for plant in PLANTS:
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
        made[f"excitations_{plant}"] = shown
    return made
