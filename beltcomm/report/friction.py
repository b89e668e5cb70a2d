"""Friction of a run: sweeps in their orders, over the session's clock, against load, and beside what a response shows as damping."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beltcomm.identify.friction import FrictionFit
from beltcomm.identify.standstill import Standstill
from beltcomm.identify.sweeps import Drift, LoadDependence, Sweep
from beltcomm.model.value import Value
from beltcomm.report.style import FAINT, HELD_OUT, MEASURED, MODEL, RESIDUAL, SEVERE, Caption, figure, legend, styled

COLOURS = (MODEL, RESIDUAL, MEASURED, HELD_OUT, SEVERE, FAINT)
#: How far the picture around standstill reaches, in speed amplitudes of the motor; and of torques above the friction's in the other.
AROUND, ABOVE = 2.0, 1.6


def _standstill_figure(found: Standstill, friction: FrictionFit, caption: Caption) -> Figure:
    """The friction curve with the straight line that the damping of the response would mean."""
    with styled():
        shown = figure(f"Friction of the sweep, and the damping that {found.record} shows around standstill", 4.6, caption)
        whole, near = shown.subplots(1, 2)
        speed = np.array([p.speed_rad_s for p in friction.points])
        torque = np.array([p.torque_nm for p in friction.points])
        top, reach = float(np.max(np.abs(speed))), AROUND * found.speed_rad_s[0]
        highest = ABOVE * 1e3 * float(np.max(np.abs(torque)))
        for axes, end in ((whole, top), (near, reach)):
            inside = np.abs(speed) <= end
            axes.plot(speed[inside], 1e3 * torque[inside], ".", color=MEASURED, markersize=5, label="sweep, constant speed")
            for side in (-1.0, 1.0):
                grid = side * np.linspace(1e-3 * end, end, 30)
                label = f"its law, {1e3 * found.sweep.value:.2f} mN m s/rad" if side > 0.0 else None
                axes.plot(grid, 1e3 * friction.torque_nm(grid), color=MODEL, linewidth=1.6, label=label)
            line = np.linspace(-end, end, 200)
            seen = f"response: {1e3 * found.seen.value:.0f} mN m s/rad"
            axes.plot(line, 1e3 * found.seen.value * line, color=SEVERE, linewidth=1.4, linestyle=(0, (5, 3)), label=seen)
            predicted = f"4 M/(π Ω): {1e3 * found.predicted.value:.0f} mN m s/rad"
            axes.plot(line, 1e3 * found.predicted.value * line, color=RESIDUAL, linewidth=1.2, linestyle=":", label=predicted)
            axes.set(ylim=(-highest, highest), xlabel="motor speed in rad/s", ylabel="torque in mN m")
        for amplitude, name in zip(found.speed_rad_s, ("motor", "carriage"), strict=True):
            for side in (-1.0, 1.0):
                near.axvline(side * amplitude, color=FAINT, linewidth=1.2)
            near.text(amplitude, -0.97 * highest, f" Ω {name}", fontsize=8, color="#555555", rotation=90, va="bottom")
        whole.set_title("all speeds")
        near.set_title("around standstill")
        legend(whole)
    return shown


def _orders_figure(sweeps: Sequence[Sweep], caption: Caption) -> Figure:
    """All passes of all sweeps and their laws; below, what each law leaves of its passes.

    One colour for each order, or for each repetition of the only one.
    """
    titles = [_title(s) for s in sweeps]
    if len(set(titles)) == 1:  # repetitions of one order
        titles = [f"{title}, {s.note.repetition}." for title, s in zip(titles, sweeps, strict=True)]
    colours = {name: COLOURS[i % len(COLOURS)] for i, name in enumerate(dict.fromkeys(titles))}
    with styled():
        shown = figure("Friction over speed, sweep by sweep", 5.8, caption)
        top, below = shown.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        for s, title in zip(sweeps, titles, strict=True):
            assert s.fit is not None
            colour = colours[title]
            speed, torque = np.array([(p.speed_rad_s, p.torque_nm) for p in s.plateaus]).T
            top.plot(speed, 1e3 * torque, ".", color=colour, markersize=4)
            for side in (-1.0, 1.0):
                grid = side * np.linspace(0.05, float(np.max(np.abs(speed))), 20)
                top.plot(grid, 1e3 * s.fit.torque_nm(grid), color=colour, linewidth=0.8)
            below.plot(speed, 1e3 * (torque - s.fit.torque_nm(speed)), ".", color=colour, markersize=4)
        for name, colour in colours.items():
            top.plot([], [], ".-", color=colour, label=name)
        top.set(ylabel="torque in mN m")
        legend(top, 2)
        below.axhline(0.0, color=FAINT, linewidth=1.0)
        below.set(ylabel="left by its law in mN m", xlabel="motor speed in rad/s")
    return shown


def _clock_figure(sweeps: Sequence[Sweep], drift: Drift | None, caption: Caption) -> Figure:
    """Coulomb and viscous friction of each sweep of one measurement over the session's clock, and the drift."""
    with styled():
        shown = figure("Friction over the session's clock", 4.8, caption)
        top, below = shown.subplots(2, 1, sharex=True)
        middle = np.array([0.5 * ((s.from_s or 0.0) + (s.to_s or 0.0)) / 60.0 for s in sweeps])
        for axes, name, unit, change in (
            (top, "coulomb", "mN m", drift.coulomb if drift else None),
            (below, "viscous", "mN m s/rad", drift.viscous if drift else None),
        ):
            values: list[Value] = [getattr(s.fit, name) for s in sweeps]
            level = _points(axes, middle, values)
            for s, at, value in zip(sweeps, middle, values, strict=True):
                axes.annotate(
                    f"{_title(s)}, {s.note.repetition}.", (at, 1e3 * value.value), xytext=(5, 5), textcoords="offset points", fontsize=8
                )
            if change is not None:
                time = np.linspace(float(middle.min()), float(middle.max()), 2)
                line = 1e3 * (level + change.value * (time - float(np.mean(middle))))
                half = 1e3 * (change.interval or 0.0)
                label = f"drift from repeated speeds, {1e3 * change.value:+.2g} ± {half:.2g} {unit} per minute"
                axes.plot(time, line, color=MODEL, linewidth=1.4, label=label)
            axes.set(ylabel=f"{'Coulomb' if name == 'coulomb' else 'viscous'}, {unit}")
            axes.margins(0.08, 0.25)
            legend(axes)
        below.set(xlabel="session's clock in min, middle of each sweep")
    return shown


def load_figure(found: LoadDependence, by: str, caption: Caption) -> Figure:
    """Coulomb and viscous friction against load with intervals and the straight line.

    Parameters
    ----------
    found : LoadDependence
        N m and N m s/rad at the motor shaft, kg.
    by : str
        Name of the load's axis.
    caption : Caption
    """
    with styled():
        shown = figure("Friction against load", 3.9, caption)
        both = shown.subplots(1, 2)
        load = np.array([g.load_kg for g in found.groups])
        for axes, name, unit, slope in (
            (both[0], "coulomb", "mN m", found.coulomb),
            (both[1], "viscous", "mN m s/rad", found.viscous),
        ):
            level = _points(axes, load, [getattr(g, name) for g in found.groups])
            ends = np.array([load.min(), load.max()])
            label = f"{1e3 * slope.value:+.2g} ± {1e3 * (slope.interval or 0.0):.2g} {unit} per kg"
            axes.plot(ends, 1e3 * (level + slope.value * (ends - load.mean())), color=MODEL, linewidth=1.4, label=label)
            axes.set(xlabel=f"{by} in kg", ylabel=f"{'Coulomb' if name == 'coulomb' else 'viscous'} friction in {unit}")
            axes.margins(0.12, 0.3)
            legend(axes)
    return shown


def _points(axes: Axes, at: np.ndarray, values: Sequence[Value]) -> float:
    """Values with their intervals; their mean."""
    shown = np.array([1e3 * v.value for v in values])
    half = np.array([1e3 * v.interval if v.interval is not None and np.isfinite(v.interval) else 0.0 for v in values])
    axes.errorbar(at, shown, yerr=half, fmt="o", color=MEASURED, markersize=4, capsize=3, linewidth=1.0, label="sweeps, 95 %")
    return float(np.mean(shown)) / 1e3


def _title(sweep: Sweep) -> str:
    """Name of a sweep in pictures: repetitions have one name."""
    if not sweep.note.measurement:
        return sweep.records[0]
    return "sweep" if sweep.note.order == "default" else f"order {sweep.note.order}"


def figures(
    friction: FrictionFit, sweeps: Sequence[Sweep], drifts: Mapping[int, Drift | str], found: Standstill | None, caption: Caption
) -> dict[str, Figure]:
    """The pictures of a friction study, by name, for which there is something to show.

    Parameters
    ----------
    friction : FrictionFit
        Fit of all sweeps.
    sweeps : sequence of Sweep
        With and without a fit of their own.
    drifts : mapping of int to Drift or str
        By measurement; a sentence where there is none.
    found : Standstill or None
        Damping around standstill; None where none was measured.
    caption : Caption
    """
    made: dict[str, Figure] = {}
    fitted = [s for s in sweeps if s.fit is not None]
    if found is not None:
        made["friction_standstill"] = _standstill_figure(found, friction, caption)
    if fitted:
        made["friction_orders"] = _orders_figure(fitted, caption)
    for number, drift in drifts.items():
        of = [s for s in fitted if s.note.measurement == number]
        if len(of) > 1:
            made[f"friction_clock_{number}"] = _clock_figure(of, None if isinstance(drift, str) else drift, caption)
    return made


def compared_figure(runs: Sequence[tuple[str, FrictionFit]], caption: Caption) -> Figure:
    """Friction over speed of several runs on one scale, points with their scatter and laws.

    Parameters
    ----------
    runs : Sequence[tuple[str, FrictionFit]]
        Name, friction.
    caption : Caption
    """
    with styled():
        shown = figure("Friction over speed, run by run", 4.4, caption)
        axes = shown.subplots()
        for (name, fit), colour in zip(runs, (MEASURED, SEVERE, RESIDUAL), strict=False):
            speed = np.array([p.speed_rad_s for p in fit.points])
            torque = np.array([p.torque_nm for p in fit.points])
            scatter = np.array([p.scatter_nm or 0.0 for p in fit.points])
            axes.errorbar(speed, 1e3 * torque, yerr=1e3 * scatter, fmt=".", color=colour, markersize=5, capsize=2, linewidth=1.0)
            for side in (-1.0, 1.0):
                grid = side * np.linspace(0.05, float(np.max(np.abs(speed))), 20)
                axes.plot(grid, 1e3 * fit.torque_nm(grid), color=colour, linewidth=1.0, label=name if side > 0.0 else None)
        axes.set(xlabel="motor speed in rad/s", ylabel="torque in mN m")
        legend(axes)
    return shown
