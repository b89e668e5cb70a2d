"""Tracking errors of chapter 5, one figure per comparison, on one scale each."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from beltcomm.report.style import FAINT, HELD_OUT, MEASURED, MODEL, SEVERE, Caption, figure, styled
from beltcomm.thesis.closed_loop import RIGS, ClosedLoopStudy, SimulatedMove

COLOURS = (SEVERE, HELD_OUT, MODEL, MEASURED)
TITLES = {
    "5.1": "Prefilter (figure 5.1)",
    "5.2": "Feedforward, 11.2 kg (figure 5.2)",
    "5.3": "Feedforward, 0 kg (figure 5.3)",
    "5.4": "Both masses, reference behind the lag of the measured velocity (figure 5.4)",
}


def figures(study: ClosedLoopStudy, caption: Caption) -> Mapping[str, Figure]:
    """Error at the motor over time; what was stopped is left out, and so is what would hide all others."""
    made = {}
    for number, title in TITLES.items():
        driven: list[SimulatedMove] = [r for r in study.runs if r.figure == number and not r.stopped]
        runs = [r for r in driven if r.motor.dynamic_m < 0.05]
        with styled():
            shown = figure(f"{title}: error at the motor, 0 to 0.5 m with the limits T_A", 3.6, caption)
            axes = shown.subplots()
            for run, colour in zip(runs, COLOURS, strict=False):
                name = f"{run.name}, {RIGS[run.rig]}" if number == "5.4" else run.name
                axes.plot(run.t_s, 1e3 * run.error_m, color=colour, linewidth=1.3, label=f"{name}: {1e3 * run.motor.dynamic_m:.2f} mm")
            for run in (r for r in driven if r not in runs):
                axes.plot([], [], " ", label=f"not shown, {run.name}: {1e3 * run.motor.dynamic_m:.0f} mm")
            axes.axhspan(-1.0, 1.0, color="#EEEEEE", zorder=0, label="below 1 mm")
            axes.set(xlabel="time in s", ylabel="reference - motor in mm", xlim=(0.0, 1.6))
            axes.legend()
        made[f"closed_loop_{number.replace('.', '_')}"] = shown
    return made | {"closed_loop_6_10": _windup(study, caption)}


def _windup(study: ClosedLoopStudy, caption: Caption) -> Figure:
    """Error and torque asked for with and without conditional integration, one column per limit of the torque."""
    with styled():
        made = figure("Anti-windup (figure 6.10): T_B with 11.2 kg, the torque cut off, simulated", 5.2, caption)
        axes = made.subplots(2, len(study.windup), sharex=True, sharey="row", squeeze=False)
        for column, (most, (without, with_it)) in enumerate(study.windup.items()):
            above, below = axes[0, column], axes[1, column]
            for name, run, colour in (("none", without, SEVERE), ("conditional integration", with_it, MODEL)):
                above.plot(run.t_s, 1e3 * run.error_m, color=colour, label=f"{name}: {1e3 * run.error.dynamic_m:.1f} mm")
                below.plot(run.t_s, run.asked_nm, color=colour)
            for limit in (-most, most):
                below.axhline(limit, color=FAINT, linewidth=1.0, zorder=0.5)
            above.set(title=f"cut off at {most:g} N m")
            above.legend()
            below.set(xlabel="time in s", xlim=(0.0, 1.4))
        axes[0, 0].set(ylabel="reference - motor in mm")
        axes[1, 0].set(ylabel="torque asked for in N m")
    return made
