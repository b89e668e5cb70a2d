"""Figures 4.3 to 4.5 and 4.7 of the thesis, recomputed, the step they lead to, and the three knobs (4.6 is a block diagram)."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from beltcomm.arrays import Array, ComplexArray, decibels
from beltcomm.control import Cascade, PrefilterKind
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.prefilters import continuous_prefilter
from beltcomm.design.thesis import position_loop, thesis_prefilter, velocity_loop
from beltcomm.report import style
from beltcomm.thesis.designs import Designs

#: Colours and lines of the prefilters: solid what is recomputed, dashed what the thesis prints.
COLOURS: Mapping[PrefilterKind, str] = {"notch": style.RESIDUAL, "butterworth": style.SEVERE, "none": "#777777"}
NAMES: Mapping[PrefilterKind, str] = {"notch": "notch", "butterworth": "Butterworth", "none": "no prefilter"}
FILTERS: tuple[PrefilterKind, ...] = ("notch", "butterworth")
DASHED = (0, (4, 2))
HZ = np.geomspace(0.2, 1000.0, 1500)
OMEGA = 2.0 * np.pi * HZ
#: Of the inverse transform of the step: rad/s between lines, and the highest, where a closed loop has long rolled off.
STEP_GRID_RAD_S, STEP_HIGHEST_RAD_S = 0.1, 1500.0
Lines = Sequence[tuple[str, str, object, ComplexArray]]


def figures(study: Designs, caption: style.Caption) -> Mapping[str, Figure]:
    """The figures by name."""
    plant = study.plants[0]
    made = {
        "designs_4_3_prefilters": _prefilters(plant, caption),
        "designs_4_4_controllers": _controllers(study, plant, caption),
        "designs_4_5_velocity_loop": _loops(study, plant, caption, velocity_loop, "velocity", "4.5"),
        "designs_4_7_position_loop": _loops(study, plant, caption, position_loop, "position", "4.7"),
        "designs_steps": _steps(study, plant, caption),
        "designs_knobs": _knobs(study, caption),
    }
    return made


def _bode(
    title: str, caption: style.Caption, curves: Lines, plant: DesignPlant, floor_db: float, sentence: str
) -> tuple[Figure, Axes, Axes]:
    """Magnitude over phase of the curves (label, colour, line, values), ω_z and ω_r marked."""
    made = style.figure(title, 6.4, caption, [sentence])
    upper, lower = made.subplots(2, 1, sharex=True)
    for label, colour, line, values in curves:
        upper.plot(HZ, decibels(values), color=colour, linestyle=line, linewidth=1.5, label=label)
        lower.plot(HZ, np.degrees(np.unwrap(np.angle(values))), color=colour, linestyle=line, linewidth=1.5)
    for name, omega in (("f_z", plant.antiresonance_rad_s), ("f_r", plant.resonance_rad_s)):
        for axes in (upper, lower):
            axes.axvline(omega / math.tau, color=style.FAINT, linewidth=1.2, zorder=0.5)
        upper.annotate(
            f" {name} {omega / math.tau:.1f} Hz",
            (omega / math.tau, 0.02),
            xycoords=("data", "axes fraction"),
            rotation=90,
            ha="right",
            fontsize=8,
        )
    upper.set_xscale("log")
    upper.set_xlim(HZ[0], HZ[-1])
    upper.set_ylim(bottom=floor_db)
    upper.set_ylabel("magnitude in dB")
    lower.set_ylabel("phase in degrees")
    lower.set_xlabel("frequency in Hz")
    lower.xaxis.set_major_formatter(style.plain_numbers())
    upper.legend(loc="best", fontsize=8)
    return made, upper, lower


def _prefilters(plant: DesignPlant, caption: style.Caption) -> Figure:
    with style.styled():
        curves: list[tuple[str, str, object, ComplexArray]] = [
            ("plant G_A with 1 ms of dead time", style.MEASURED, "-", plant.continuous_response(OMEGA))
        ]
        for kind in FILTERS:
            prefilter = thesis_prefilter(plant, kind)
            asked = "-6 dB" if kind == "notch" else "-3 dB"
            curves.append((f"{NAMES[kind]}, {asked} at f_z", COLOURS[kind], "-", continuous_prefilter(OMEGA, prefilter)))
        sentence = "The notch gives its attenuation back above f_r; the Butterworth filter keeps it, for more phase around its cutoff."
        made, _, lower = _bode("Figure 4.3: prefilters and plant", caption, curves, plant, -100.0, sentence)
        lower.set_ylim(-420.0, 100.0)
    return made


def _both(study: Designs) -> list[tuple[str, str, object, Cascade]]:
    """Recomputed and published gains with their label, colour and line."""
    both: list[tuple[str, str, object, Cascade]] = []
    for kind, (name, cascade) in zip(FILTERS, study.published.items(), strict=True):
        design = study.solution(study.plants[0].name, kind)
        if design is not None:
            both.append((f"{NAMES[kind]}, recomputed", COLOURS[kind], "-", design.cascade))
        both.append((f"{name}, published", COLOURS[kind], DASHED, cascade))
    return both


def _controllers(study: Designs, plant: DesignPlant, caption: style.Caption) -> Figure:
    with style.styled():
        curves = []
        for label, colour, line, cascade in _both(study):
            pi = cascade.kp_nm_s_rad + cascade.ki_nm_rad / (1j * OMEGA)
            curves.append((label, colour, line, np.asarray(pi * continuous_prefilter(OMEGA, cascade.prefilter))))
        sentence = "Velocity controller G_pre G_PI, in N m s/rad."
        made, _, _ = _bode("Figure 4.4: velocity controllers", caption, curves, plant, -80.0, sentence)
    return made


def _loops(
    study: Designs,
    plant: DesignPlant,
    caption: style.Caption,
    loop: Callable[[DesignPlant, Cascade, Array], ComplexArray],
    name: str,
    number: str,
) -> Figure:
    with style.styled():
        curves = [(label, colour, line, loop(plant, cascade, OMEGA)) for label, colour, line, cascade in _both(study)]
        none = study.solution(plant.name, "none")
        if none is not None:
            curves.append(("no prefilter, recomputed", COLOURS["none"], "-", loop(plant, none.cascade, OMEGA)))
        asked = "60 deg at 0 dB and -10 dB at f_r" if name == "velocity" else "80 deg at 0 dB"
        sentence = f"Asked: {asked}. Dots: crossovers and the phase there, margin above -180 deg."
        made, upper, lower = _bode(f"Figure {number}: open {name} loop on G_A", caption, curves, plant, -110.0, sentence)
        for _, colour, _, values in curves:
            at = int(np.flatnonzero(np.abs(values) < 1.0)[0])
            upper.plot(HZ[at], 0.0, "o", color=colour, markersize=5)
            lower.plot(HZ[at], np.degrees(np.unwrap(np.angle(values)))[at], "o", color=colour, markersize=5)
        upper.axhline(0.0, color="#777777", linewidth=0.8)
        if name == "velocity":
            upper.axhline(-10.0, color=style.MODEL, linewidth=1.0, linestyle=DASHED)
            upper.annotate("A_sup -10 dB", (0.22, -10.0), va="bottom", fontsize=8)
        lower.axhline(-180.0, color="#777777", linewidth=0.8)
        lower.set_ylim(-480.0, 0.0)
    return made


def _step_response(loop: ComplexArray, omega_rad_s: Array, t_s: Array) -> Array:
    """Step of the closed loop L/(1 + L):  (2/π) ∫ Re T(jω) sin(ωt)/ω dω,  for a stable loop; (len(t),).

    Frequencies are evenly spaced from half a step on, so that the midpoint rule needs no value at 0.
    """
    real = (loop / (1.0 + loop)).real / omega_rad_s
    spacing = omega_rad_s[1] - omega_rad_s[0]
    return np.asarray([2.0 / np.pi * spacing * np.sum(real * np.sin(omega_rad_s * t)) for t in t_s])


def _steps(study: Designs, plant: DesignPlant, caption: style.Caption) -> Figure:
    omega = np.arange(0.5 * STEP_GRID_RAD_S, STEP_HIGHEST_RAD_S, STEP_GRID_RAD_S)
    with style.styled():
        sentences = ["Linear plant, no feedforward. The lower loop is closed around the upper one."]
        made = style.figure("Closed loops on G_A: step of the reference", 6.4, caption, sentences)
        upper, lower = made.subplots(2, 1)
        gains = _both(study)
        none = study.solution(plant.name, "none")
        if none is not None:
            gains.append(("no prefilter, recomputed", COLOURS["none"], "-", none.cascade))
        for axes, loop, end in ((upper, velocity_loop, 0.6), (lower, position_loop, 1.6)):
            t = np.linspace(0.0, end, 120)
            for label, colour, line, cascade in gains:
                axes.plot(
                    1e3 * t, _step_response(loop(plant, cascade, omega), omega, t), color=colour, linestyle=line, linewidth=1.5, label=label
                )
            axes.axhline(1.0, color="#777777", linewidth=0.8)
            axes.set_xlim(0.0, 1e3 * end)
            axes.set_xlabel("time in ms")
        upper.set_ylabel("measured velocity / step")
        lower.set_ylabel("motor angle / step")
        lower.legend(loc="lower right", fontsize=8)
    return made


def _knobs(study: Designs, caption: style.Caption) -> Figure:
    titles = {
        "phase_margin_deg": "velocity phase margin in degrees",
        "position_phase_margin_deg": "position phase margin in degrees",
        "suppression_db": "suppression A_sup in dB",
    }
    with style.styled():
        sentences = ["Gains over those at 60 deg, 80 deg and -10 dB. Each knob alone, the other two as there."]
        made = style.figure("The three knobs on G_A", 6.0, caption, sentences)
        grid = made.subplots(2, 3, sharey=True, sharex="col")
        for column, (knob, title) in enumerate(titles.items()):
            for row, kind in enumerate(FILTERS):
                axes = grid[row][column]
                usual = study.solution(study.plants[0].name, kind)
                turns = next(t.turns for t in study.turned if (t.prefilter, t.knob) == (kind, knob))
                found = [(turn.value, turn.design.cascade) for turn in turns if turn.design is not None]
                if usual is None:
                    continue
                gains = (
                    ("K_P", "kp_nm_s_rad", "D", style.RESIDUAL),
                    ("K_I", "ki_nm_rad", "s", style.SEVERE),
                    ("K_PP", "kpp_1_s", "^", style.MEASURED),
                )
                for name, field, marker, colour in gains:
                    ratio = [getattr(cascade, field) / getattr(usual.cascade, field) for _, cascade in found]
                    size = 9 if name == "K_P" else 5  # where K_P and K_I stay, both markers are seen
                    axes.plot([value for value, _ in found], ratio, marker=marker, color=colour, linewidth=1.3, markersize=size, label=name)
                axes.set_yscale("log")
                axes.set_yticks([0.25, 0.5, 1.0, 2.0, 4.0], ["1/4", "1/2", "1", "2", "4"])
                axes.minorticks_off()
                if column == 0:
                    axes.set_ylabel(f"{NAMES[kind]}: gain ratio")
                if row == 1:
                    axes.set_xlabel(title)
        grid[0][0].legend(loc="lower left", fontsize=8)
    return made
