"""The proof of a design: open loops of all model variants and of the measured responses, beside the disc that the margins keep free.

Above in the plane, below over frequency, with the margins of the variant that has least of them.  And a move that proves it: the path
above, the tracking error on an axis of its own below, measured over predicted.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from beltcomm.arrays import Array, ComplexArray, decibels
from beltcomm.design.cascade import DesignResult
from beltcomm.design.measured import MeasuredLoop
from beltcomm.report import style

#: Colours of the records, told apart with any colour vision; further ones begin again with another marker.
COLOURS, MARKERS = ("#000000", "#0072B2", "#D55E00", "#009E73", "#CC79A7"), (".", "x", "+")

#: Frequencies of the model's curves, and the part of the plane that is shown.
POINTS, PLANE = 900, ((-2.2, 1.0), (-2.0, 1.2))
FLOOR_DB = -60.0
SENSITIVITY_POINTS = 600

#: rad/s, where the picture begins.
LOWEST_RAD_S = 1.0


@dataclass(frozen=True)
class ProvenResponse:
    """One measured response.

    Attributes
    ----------
    label : str
        Record and condition.
    """

    label: str
    loop: MeasuredLoop


def proof_figure(design: DesignResult, shown: Sequence[ProvenResponse], sentences: Sequence[str], caption: style.Caption) -> Figure:
    """Nyquist plots over Bode plots, velocity loop on the left, position loop on the right.

    Parameters
    ----------
    design : DesignResult
        Result with its plants.
    shown : sequence of ProvenResponse
        Loops closed on measured responses.
    sentences : sequence of str
        Above the figure.
    caption : Caption
    """
    nyquist = 0.999 * math.pi / design.structure.period_s
    omega = np.geomspace(1.0, nyquist, POINTS)
    curves = [design.open_loops(i, omega) for i in range(len(design.plants))]
    disc = 10.0 ** (-design.specification.sensitivity_db / 20.0)
    with style.styled():
        rows = 1 + math.ceil((len(shown) + 3) / 3)
        made = style.figure("Open loops by model and as measured: Nyquist and Bode", 10.8 + 0.2 * rows, caption, sentences)
        grid = made.subplots(4, 2, height_ratios=[4.6, 3.1, 2.2, 0.2 * rows])
        for column, name in enumerate(("velocity", "position")):
            loops = [pair[column] for pair in curves]
            measured = [one.loop.velocity if column == 0 else one.loop.position for one in shown]
            _plane(grid[0, column], f"{name} loop", loops, measured, disc, design.specification.sensitivity_db)
            _gain(grid[1, column], omega, loops, shown, measured, name)
            _phase(grid[2, column], omega, loops, shown, measured)
            _margins(grid[1, column], grid[2, column], omega / (2.0 * math.pi), loops)
        handles, labels = grid[1, 0].get_legend_handles_labels()
        top = grid[0, 0].get_legend_handles_labels()
        for axes in grid[3]:
            axes.set_axis_off()
        legend = grid[3, 0].legend(top[0] + handles, top[1] + labels, loc="upper left", bbox_to_anchor=(-0.1, 1.0), ncols=3, fontsize=8)
        legend.set_in_layout(False)  # it spans both columns; its row keeps its height
    return made


def _plane(
    axes: Axes,
    title: str,
    loops: Sequence[ComplexArray],
    measured: Sequence[ComplexArray],
    disc: float,
    sensitivity_db: float,
) -> None:
    for i, loop in enumerate(loops):
        axes.plot(loop.real, loop.imag, color=style.MODEL, linewidth=1.1, alpha=0.8, label="model: all variants" if i == 0 else None)
    for k, loop in enumerate(measured):
        axes.plot(loop.real, loop.imag, _marker(k), color=_colour(k), markersize=4.0)
    free = Circle((-1.0, 0.0), disc, facecolor=style.SEVERE, alpha=0.18, edgecolor=style.SEVERE)
    free.set_label(f"kept free: sensitivity {sensitivity_db:.0f} dB")
    axes.add_patch(free)
    axes.plot([-1.0], [0.0], "+", color=style.SEVERE, markersize=9, markeredgewidth=1.6)
    around = np.linspace(0.0, 2.0 * math.pi, 200)
    axes.plot(np.cos(around), np.sin(around), color=style.FAINT, linewidth=0.9, zorder=0.5)
    axes.set_xlim(*PLANE[0])
    axes.set_ylim(*PLANE[1])
    axes.set_aspect("equal")
    axes.set_title(title)
    axes.set_xlabel("real part")
    axes.set_ylabel("imaginary part")


def _gain(
    axes: Axes,
    omega: Array,
    loops: Sequence[ComplexArray],
    shown: Sequence[ProvenResponse],
    measured: Sequence[ComplexArray],
    name: str,
) -> None:
    levels = 20.0 * np.log10(np.maximum(np.abs(loops), 1e-6))
    hz = omega / (2.0 * math.pi)
    axes.fill_between(hz, levels.min(axis=0), levels.max(axis=0), color=style.MODEL, alpha=0.35, linewidth=0.0, label="model: band of them")
    for k, (one, loop) in enumerate(zip(shown, measured, strict=True)):
        axes.plot(one.loop.freq_hz, decibels(loop), _marker(k), color=_colour(k), markersize=3.0, label=f"measured: {one.label}")
    axes.axhline(0.0, color=style.FAINT, linewidth=1.2, zorder=0.5)
    _over_frequency(axes, hz[-1])
    axes.tick_params(labelbottom=False)
    axes.set_ylim(FLOOR_DB, 30.0)
    axes.set_ylabel(f"open {name} loop in dB")


def _phase(
    axes: Axes,
    omega: Array,
    loops: Sequence[ComplexArray],
    shown: Sequence[ProvenResponse],
    measured: Sequence[ComplexArray],
) -> None:
    hz = omega / (2.0 * math.pi)
    phases = [_unwrapped(loop) for loop in loops]
    axes.fill_between(hz, np.min(phases, axis=0), np.max(phases, axis=0), color=style.MODEL, alpha=0.35, linewidth=0.0)
    for k, (one, loop) in enumerate(zip(shown, measured, strict=True)):
        axes.plot(one.loop.freq_hz, np.degrees(np.angle(-loop)) - 180.0, _marker(k), color=_colour(k), markersize=3.0)
    axes.axhline(-180.0, color=style.FAINT, linewidth=1.2, zorder=0.5)
    _over_frequency(axes, hz[-1])
    axes.set_ylim(-400.0, 20.0)
    style.numbers_at(axes.yaxis, style.DEGREES)
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel("phase in degrees")


def _margins(gain: Axes, phase: Axes, hz: Array, loops: Sequence[ComplexArray]) -> None:
    """The least phase margin and the least gain margin of all variants, where they are met."""
    found = [margin for loop in loops if (margin := _phase_margin(hz, loop)) is not None]
    if found:
        degrees, at = min(found)
        phase.plot([at, at], [-180.0, -180.0 + degrees], color=style.MEASURED, linewidth=1.6)
        phase.annotate(f" {degrees:.0f}° at {at:.2g} Hz", (at, -180.0), xytext=(3, 3), textcoords="offset points", fontsize=8)
        gain.plot([at], [0.0], "o", color=style.MEASURED, markersize=4)
    gains = [margin for loop in loops if (margin := _gain_margin(hz, loop)) is not None]
    if gains:
        decibels, at = min(gains)
        gain.plot([at, at], [-decibels, 0.0], color=style.MEASURED, linewidth=1.6)
        gain.annotate(f" {decibels:.1f} dB at {at:.3g} Hz", (at, 0.0), xytext=(3, 3), textcoords="offset points", fontsize=8)


def _phase_margin(hz: Array, loop: ComplexArray) -> tuple[float, float] | None:
    """Smallest phase margin in degrees over the crossovers, and where, Hz; None without any."""
    level = np.log(np.abs(loop))
    found = []
    for i in np.flatnonzero(np.diff(np.sign(level))):
        share = level[i] / (level[i] - level[i + 1])
        between = loop[i] * (loop[i + 1] / loop[i]) ** share
        found.append((float(np.degrees(np.angle(-between))), float(hz[i] * (hz[i + 1] / hz[i]) ** share)))
    return min(found, key=lambda pair: abs(pair[0])) if found else None


def _gain_margin(hz: Array, loop: ComplexArray) -> tuple[float, float] | None:
    """Smallest gain in dB above 0 to a crossing of the negative axis, and where, Hz; None without any."""
    found = []
    for i in np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[1:] < 0.0)):
        share = loop.imag[i] / (loop.imag[i] - loop.imag[i + 1])
        size = abs(loop[i] + share * (loop[i + 1] - loop[i]))
        if 0.0 < size < 1.0:
            found.append((-20.0 * math.log10(size), float(hz[i] + share * (hz[i + 1] - hz[i]))))
    return min(found) if found else None


def _unwrapped(loop: ComplexArray) -> Array:
    """Phase over frequency without jumps, degrees, beginning between -360 and 0."""
    phase = np.degrees(np.unwrap(np.angle(loop)))
    return np.asarray(phase - 360.0 * math.ceil(phase[0] / 360.0))


def _over_frequency(axes: Axes, highest_hz: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(0.5, highest_hz)
    style.hertz(axes.xaxis)


def _colour(k: int) -> str:
    return COLOURS[k % len(COLOURS)]


def _marker(k: int) -> str:
    return MARKERS[k // len(COLOURS) % len(MARKERS)]


def sensitivity_figure(design: DesignResult, caption: style.Caption) -> Figure:
    """|S| = 1/|1 + L| in dB, the band of all variants and the worst of them, with the bound of the specification.

    Parameters
    ----------
    design : DesignResult
        Result with its plants and specification.
    caption : Caption
    """
    omega = np.geomspace(LOWEST_RAD_S, 0.999 * math.pi / design.structure.period_s, SENSITIVITY_POINTS)
    pairs = [design.open_loops(i, omega) for i in range(len(design.plants))]
    hz = omega / (2.0 * math.pi)
    with style.styled():
        made = style.figure("Sensitivity: what the loops leave of a disturbance", 3.6, caption)
        for axes, name, loops in zip(
            made.subplots(1, 2, sharey=True), ("velocity loop", "position loop"), zip(*pairs, strict=True), strict=True
        ):
            level = -decibels(1.0 + np.array(loops))
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


#: Upper ends of an axis of errors, mm: the same for most pictures, so that two runs compare.
ENDS_MM = (0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)


@dataclass(frozen=True)
class TrackedMove:
    """One move.

    Attributes
    ----------
    t_s, reference_m, error_m : ndarray (n,)
        Error is reference minus motor angle times i_t. predicted_m : the same by the model on its own grid, None where it cannot be
        predicted.
    target_m : float
        That the error must stay below.
    end_s : float
        Of the reference motion.
    """

    name: str
    t_s: Array
    reference_m: Array
    error_m: Array
    predicted: tuple[Array, Array] | None
    target_m: float
    end_s: float


def tracking_figure(moves: Sequence[TrackedMove], caption: style.Caption) -> Figure:
    """Reference and tracking error of moves, a column for each; errors on one scale.

    Parameters
    ----------
    moves : sequence of TrackedMove
        m of the carriage; errors at the motor.
    caption : Caption
    """
    largest = max(1e3 * float(np.max(np.abs(m.error_m))) for m in moves)
    largest = max([largest, *(1e3 * float(np.max(np.abs(m.predicted[1]))) for m in moves if m.predicted is not None)])
    end = next((end for end in ENDS_MM if largest < 0.95 * end), 1.1 * largest)
    with style.styled():
        made = style.figure("Tracking: the path, and how far the motor is off it", 5.4, caption)
        grid = made.subplots(2, len(moves), sharex="col", sharey="row", squeeze=False, height_ratios=(2, 3))
        for column, move in enumerate(moves):
            above, below = grid[0][column], grid[1][column]
            above.set_title(move.name)
            above.plot(move.t_s, 1e3 * move.reference_m, color=style.MODEL, linewidth=1.6, label="reference")
            above.plot(move.t_s, 1e3 * (move.reference_m - move.error_m), color=style.MEASURED, linewidth=0.8, label="measured")
            below.plot(move.t_s, 1e3 * move.error_m, color=style.MEASURED, linewidth=0.9, label="measured")
            if move.predicted is not None:
                t_s, error_m = move.predicted
                below.plot(t_s, 1e3 * error_m, color=style.MODEL, linewidth=1.2, label="predicted")
            below.axvline(move.end_s, color=style.FAINT, linewidth=1.2)
            below.annotate(" end of the motion", (move.end_s, -0.95 * end), fontsize=8, rotation=90, va="bottom")
            if 1e3 * move.target_m <= end:
                for side in (-1.0, 1.0):
                    below.axhline(side * 1e3 * move.target_m, color=style.SEVERE, linewidth=1.0, linestyle=(0, (5, 3)))
            below.set(xlabel="time in s", ylim=(-end, end))
        grid[0][0].set_ylabel("carriage in mm")
        grid[1][0].set_ylabel("reference minus motor in mm")
        style.legend(grid[0][0])
        style.legend(grid[1][0])
    return made
