"""Tracking errors of chapter 5, one figure per comparison, on one scale each."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from beltcomm.comparisons.closed_loop import RIGS, Run, Study
from beltcomm.report.style import HELD_OUT, MEASURED, MODEL, SEVERE, Caption, figure, styled

COLOURS = (SEVERE, HELD_OUT, MODEL, MEASURED)
TITLES = {
    "5.1": "Prefilter (figure 5.1)",
    "5.2": "Feedforward, 11.2 kg (figure 5.2)",
    "5.3": "Feedforward, 0 kg (figure 5.3)",
    "5.4": "Both masses, reference behind the lag of the measured velocity (figure 5.4)",
}


def figures(study: Study, caption: Caption) -> Mapping[str, Figure]:
    """Error at the motor over time; what was stopped is left out, and so is what would hide all others."""
    made = {}
    for number, title in TITLES.items():
        runs: list[Run] = [r for r in study.runs if r.figure == number and not r.stopped and r.motor.dynamic_m < 0.05]
        with styled():
            shown = figure(f"{title}: error at the motor, 0 to 0.5 m with the limits T_A", 3.6, caption)
            axes = shown.subplots()
            for run, colour in zip(runs, COLOURS, strict=False):
                name = f"{run.name}, {RIGS[run.rig]}" if number == "5.4" else run.name
                axes.plot(run.t_s, 1e3 * run.error_m, color=colour, linewidth=1.3, label=f"{name}: {1e3 * run.motor.dynamic_m:.2f} mm")
            axes.axhspan(-1.0, 1.0, color="#EEEEEE", zorder=0)
            axes.set(xlabel="time in s", ylabel="reference - motor in mm", xlim=(0.0, 1.6))
            axes.legend()
        made[f"closed_loop_{number.replace('.', '_')}"] = shown
    return made
