"""Moves of chapter 5, one figure per comparison: position, errors of motor and carriage, speed, torque."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.figure import Figure

from beltcomm.arrays import Array
from beltcomm.report.style import FAINT, HELD_OUT, MEASURED, MODEL, SEVERE, Caption, figure, styled
from beltcomm.thesis.closed_loop import RIGS, ClosedLoopStudy, SimulatedMove

COLOURS = (SEVERE, HELD_OUT, MODEL, MEASURED, FAINT)
TITLES = {
    "5.1": "Prefilter (figure 5.1)",
    "5.2": "Feedforward, 11.2 kg (figure 5.2)",
    "5.3": "Feedforward, 0 kg (figure 5.3)",
    "5.4": "Both masses, reference behind the lag of the measured velocity (figure 5.4)",
}
LABELS = ("position in mm", "reference - motor\nin mm", "reference - carriage\nin mm", "speed in m/s", "torque in N m")


def _drawn(run: SimulatedMove) -> tuple[Array, ...]:
    """Panels of a move."""
    off = 1e3 * (run.reference_m - run.cart_m)
    return 1e3 * run.position_m, 1e3 * run.error_m, off, run.speed_m_s, run.drive_torque_nm


def figures(study: ClosedLoopStudy, caption: Caption) -> Mapping[str, Figure]:
    """Five panels one above the other, by name; what was stopped is left out.   Errors are linear within 1 mm and logarithmic beyond."""
    made = {}
    for number, title in TITLES.items():
        runs: list[SimulatedMove] = [r for r in study.runs if r.figure == number and not r.stopped]
        with styled():
            shown = figure(f"{title}: 0 to 0.5 m with the limits T_A", 9.0, caption)
            panels = shown.subplots(5, 1, sharex=True, height_ratios=(3, 3, 3, 3, 3))
            for run, colour in zip(runs, COLOURS, strict=False):
                name = f"{run.name}, {RIGS[run.rig]}" if number == "5.4" else run.name
                told = f"{name}: {1e3 * run.motor.dynamic_m:.2f} and {1e3 * run.cart.dynamic_m:.2f} mm"
                for axes, values in zip(panels, _drawn(run), strict=True):
                    axes.plot(run.t_s, values, color=colour, linewidth=1.2, label=told)
            first = runs[0]
            panels[0].plot(first.t_s, 1e3 * first.reference_m, color=FAINT, linestyle="--", label="reference")
            for axes in panels[1:3]:
                axes.set_yscale("symlog", linthresh=1.0)
                axes.axhspan(-1.0, 1.0, color="#EEEEEE", zorder=0)
            for axes, label in zip(panels, LABELS, strict=True):
                axes.set_ylabel(label)
            panels[-1].set(xlabel="time in s", xlim=(0.0, 1.9))
            panels[0].legend(title="largest error at motor and carriage", fontsize="small")
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
