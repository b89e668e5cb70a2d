# ruff: noqa: E501
"""Makes docs/thesis-rows.md: the design source row by row, command, printed figure, ours, mark.

``python docs/thesis_rows.py`` recomputes every topic (minutes); ``python docs/thesis_rows.py FOLDER`` takes TOPIC.json, as
``beltcomm thesis TOPIC --json`` prints it, from a folder.  A figure between braces is looked up there; the others were read off the
commands beside them on runs of the shipped plants.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

PAGE = Path(__file__).parent / "thesis-rows.md"
#: right: within the print's digits or what the source says comes out.   differs: explained beside it.   missing: not there.
MARKS = ("right", "differs", "missing")


class ThesisRow(NamedTuple):
    """source : section, equation, figure.   printed : "" where the source prints no number.   ours : text, with lookups in braces.

    command : what recomputes it; own : what does it on one's own axis and run, where that is another one.
    """

    source: str
    what: str
    command: str
    printed: str
    ours: str
    mark: str
    why: str = ""
    own: str = ""


R, D, M = MARKS
MODELS, DESIGNS, IDENT, CLOSED, ESTIM, FRICTION, DISCRETE = (
    f"thesis {topic}" for topic in ("models", "designs", "identification", "closed-loop", "estimators", "friction", "discretisation")
)
ROWS: tuple[ThesisRow, ...] = (
    # chapter 2
    ThesisRow("(2.1) to (2.8), gearbox", "any ratio, torques and inertias through it", "commission --drive virtual:rack --axis rack", "none on the rig", "ratio 10: within 0.0044 mm; gains with 1/i_g², errors at the carriage the same", R),
    ThesisRow("(2.10) to (2.20), figure 2.3", "three masses, belt sections by position", "simulate egc_70", "", "end pulley 0.1532 kg: 0.1535 ± 0.0007 kg by `fit --model three-mass`", R, own="fit --model three-mass"),
    ThesisRow("(2.21) to (2.25)", "two masses with Coulomb friction", "fit", "", "13.44 ± 0.01 kg and 203.7 ± 0.2 kN/m of 13.44, 203.74 built in", R),
    ThesisRow("(2.26), figure 2.4", "stiffness over position", MODELS, "", "2194 kN/m at 0, 278 kN/m at 0.60 m", R, own="thesis models --run RUN"),
    ThesisRow("(2.26), table A.3", "why 204 and 222 kN/m were identified", MODELS, "203.7 and 222.4 kN/m", "278 kN/m of belt with the coupling in series: 233 kN/m", D, "the source takes the coupling for stiff", own="thesis models --run RUN"),
    ThesisRow("2.1.4, figure 2.5, (2.22)", "tilt: gravity in the balance", "commission --drive virtual:g_a_25deg --axis egc-70-600-25deg", "", "sign as (2.22): + i_t m_c g sin α holds", R, "erratum 11"),
    ThesisRow("(2.31), (2.34), (2.35)", "linear model", "fit", "", "state space at any operating point", R),
    ThesisRow("(2.38), (2.39)", "exact transfer functions", MODELS, "", "coefficients exact with d_m in N s/m", R, "erratum 1", own="thesis models --run RUN"),
    ThesisRow("(2.40) to (2.43)", "approximation (2.42)", MODELS, "small", "within 0.50 dB of (2.39) on S_A, largest at 131 Hz", R, "erratum 2", own="thesis models --run RUN"),
    ThesisRow("(2.44), G_A", "resonance", DESIGNS, "107.11 Hz", "{designs:f_r G_A} Hz", D, "i_t of 78 mm a turn, 12.414 mm, gives the print", own="thesis models --run RUN"),
    ThesisRow("(2.45), G_A", "antiresonance", DESIGNS, "19.59 Hz", "{designs:f_z G_A} Hz", R, own="thesis models --run RUN"),
    ThesisRow("(2.44), G_B", "resonance", DESIGNS, "134.00 Hz", "{designs:f_r G_B} Hz", D, "i_t as above, and two digits of m_c", own="thesis models --run RUN"),
    ThesisRow("(2.45), G_B", "antiresonance", DESIGNS, "76.51 Hz", "{designs:f_z G_B} Hz", D, "two digits of m_c leave 0.4 Hz", own="thesis models --run RUN"),
    ThesisRow("(2.44), S_A", "resonance", DESIGNS, "133.78 Hz", "{designs:f_r S_A} Hz", D, "i_t as above", own="thesis models --run RUN"),
    ThesisRow("(2.45), S_A", "antiresonance", DESIGNS, "22.50 Hz", "{designs:f_z S_A} Hz", R, own="thesis models --run RUN"),
    ThesisRow("(2.44), S_B", "resonance", DESIGNS, "149.85 Hz", "{designs:f_r S_B} Hz", D, "i_t as above", own="thesis models --run RUN"),
    ThesisRow("(2.45), S_B", "antiresonance", DESIGNS, "71.17 Hz", "{designs:f_z S_B} Hz", R, own="thesis models --run RUN"),
    ThesisRow("(2.44), S_C", "resonance", DESIGNS, "423.05 Hz", "{designs:f_r S_C} Hz", D, "i_t as above", own="thesis models --run RUN"),
    ThesisRow("(2.45), S_C", "antiresonance", DESIGNS, "71.17 Hz", "{designs:f_z S_C} Hz", R, own="thesis models --run RUN"),
    ThesisRow("(2.46), (2.47)", "inertia ratio moves resonance and antiresonance apart", MODELS, "", "the five parameter sets beside each other", R, own="thesis models --run RUN"),
    ThesisRow("figure 2.7", "(2.42) and (2.39) as Bode diagrams", "thesis models --pictures", "", "drawn", R, own="thesis models --run RUN --pictures FOLDER"),
    ThesisRow("figure 2.8", "S_A, S_B, S_C as Bode diagrams", "thesis models --pictures", "", "drawn", R, own="report RUN --against OTHER"),
    ThesisRow("figure 2.9", "three places", "thesis models --pictures", "", "f_r 194.8, 135.6, 120.0 Hz at 0.05, 0.30, 0.55 m", R, own="thesis models --run RUN --pictures FOLDER"),
    ThesisRow("(2.48), (2.49), figure 2.10", "torque to carriage: no antiresonance", "thesis models --pictures", "none", "21.4 dB above torque to motor at f_z", R, own="thesis models --run RUN --pictures FOLDER"),
    ThesisRow("2.3", "three masses against two", "fit --model three-mass", "", "refused with the reason where a coupling acts beside the pulley", R),
    # chapter 3.1
    ThesisRow("(3.1) to (3.3)", "PRBS: recursion, length 2^n - 1", "thesis excitations", "", "one primitive polynomial for each order 3 to 16", R, own="identify --drive D --order 9"),
    ThesisRow("(3.4)", "mean and drift of a PRBS", "thesis excitations", "drifts", "mean taken away, begun at mean momentum: no drift", D, "erratum 10: the carriage must not drift", own="identify --drive D"),
    ThesisRow("(3.4), amplitude", "0.3 N m: peak to peak as printed, ± as the rig ran", IDENT, "13.44 kg, 203.7 kN/m (G_A)", "±0.3: 13.00 kg, 200.0 kN/m; ±0.15: 12.87 kg, 179.1 kN/m by the source's fit", D, "the rig probably ran ±0.3; `--amplitude` decides", own="identify --drive D --order 7 --clock 8ms --amplitude 0.3"),
    ThesisRow("(3.4)", "order, clock, amplitude, periods as one likes", "identify --drive D --order 7 --clock 8ms --amplitude 0.3 --periods 4", "7, 128 at 62.5 µs", "made as asked, refused beyond a limit before anything moves", R),
    ThesisRow("(3.5)", "first zero of the spectrum", "thesis excitations --pictures", "1/(P T_s)", "125 Hz for order 7, clock 128 at 62.5 µs", R, own="thesis excitations --run RUN"),
    ThesisRow("(3.6)", "lowest line", "thesis excitations --pictures", "1/((2^n - 1) P T_s)", "0.984 Hz there", R, own="thesis excitations --run RUN"),
    ThesisRow("figure 3.1", "sequences over time", "thesis excitations --pictures", "", "drawn for orders 7 and 9, clocks 128 and 64", R, own="thesis excitations --run RUN --pictures FOLDER"),
    ThesisRow("figure 3.2", "their spectra", "thesis excitations --pictures", "", "lines and envelope drawn, zeros at (3.5)", R, own="thesis excitations --run RUN --pictures FOLDER"),
    ThesisRow("3.1, chirp", "with trapezoidal window", "identify --drive D --excitation chirp", "", "recorded and fitted", R),
    ThesisRow("3.1, generalised PRBS", "no zero, less power below", "identify --drive D --excitation gprbs", "less below", "so in the spectra", R),
    ThesisRow("3.1, choice", "PRBS preferred for repeatable results", "thesis excitations", "PRBS", "smallest errors of four, by no more than six seeds leave open", R, own="thesis excitations --run RUN"),
    # chapter 3.2 to 3.4
    ThesisRow("(3.7)", "empirical transfer function estimate", "identify --drive D", "", "with noise of every line", R),
    ThesisRow("(3.8) to (3.15), figure 3.3", "Clary's method II", "identify --drive D", "", "differences exactly as (3.13), (3.14); `estimate_response`", R),
    ThesisRow("3.2", "highest frequency", MODELS, "2/T_s", "1/(2 T_s)", D, "half the sampling rate, erratum 3", own="identify --drive D"),
    ThesisRow("3.3.1, figure 3.4a", "open loop", "fit --details", "", "62 mN m s/rad standing for 2.53 built in", D, "friction poses as damping, erratum 7"),
    ThesisRow("(3.16) to (3.19)", "direct closed loop", "identify --drive D --run RUN --loop direct", "", "107.01 ± 0.10 Hz, mean of seven runs of ± 0.24 each, 1.9 to 3.1 mN m s/rad at 100 mm/s (107.16 and 2.53 built in; 42 ± 17 standing)", D, "(2.42) knows neither hold nor belt damping: of the exact response it reads 107.06; `fit` counts both"),
    ThesisRow("(3.20) to (3.22)", "indirect closed loop", "identify --drive D --run RUN --loop indirect", "", "107.01 ± 0.19 Hz, 2.54 ± 0.02 mN m s/rad; +0.2 ± 1.2 dB from direct up to 3 Hz", R),
    ThesisRow("(3.21)", "C as printed, continuous", IDENT, "", "+0.02 dB below 3 Hz, 13.29 kg", D, "a sampled loop does something else", own="thesis identification --run RUN"),
    ThesisRow("(3.23), (3.24)", "excitation of the speed setpoint", "identify --drive D --run RUN --loop setpoint", "", "107.38 ± 0.67 Hz, 2.56 ± 0.03 mN m s/rad; +0.03 ± 0.13 dB from direct up to 3 Hz", R),
    ThesisRow("3.3", "gravity: base torque", "identify --drive virtual:g_a_25deg --axis egc-70-600-25deg", "", "692.0 ± 0.5 mN m by half sums of slow creep", R),
    ThesisRow("3.4", "amplitude raised step by step", "identify --drive D", "by hand", "rises inside limits predicted before each step", R),
    ThesisRow("3.4", "averaging of repetitions", IDENT, "1/√n", "0.67, 0.47, 0.32 for 2, 4, 8 periods (0.71, 0.50, 0.35)", R, own="thesis models --run RUN"),
    ThesisRow("(3.25), (3.26)", "current loop in Clary's prefilters", IDENT, "", "dead time as z⁻ⁿ in V_1", R, own="fit"),
    ThesisRow("(3.27)", "dead time from the phases", IDENT, "1 ms", "1.0002 ± 0.0022 ms (1 built in)", R, own="fit --details"),
    ThesisRow("figure 3.5", "influence of the current loop", "thesis identification --pictures", "", "setpoint and acting torque drawn; same size, 1 ms of phase", R, own="thesis identification --run RUN --pictures FOLDER"),
    ThesisRow("figure 3.6", "open loop, direct, indirect", "thesis identification --pictures", "", "drawn with the errors", R, own="compare RUN"),
    ThesisRow("3.4, claim", "open loop and direct show no significant difference", IDENT, "none", "±0.15 N m: 12 % of stiffness; ±0.3: 2 %, but for the damping", D, "friction; holds nearly at the amplitude that the rig probably had", own="identify --drive D --run RUN --loop direct"),
    ThesisRow("3.4, claim", "indirect is biased at low frequency", IDENT, "visible", "0.0 dB with C as it runs; +1.83 dB for a C that is 20 % off, in a strong loop", D, "comes of a controller that is not exactly known", own="identify --drive D --run RUN --loop indirect"),
    ThesisRow("3.4, on a run", "the same on one's own loop", "identify --drive D --run RUN --loop indirect", "", "says the shift that 10 % of the gain make, at which frequency", R),
    ThesisRow("3.4", "closed loop with a crossover below 1 Hz", IDENT, "< 1 Hz", "weak loop of 0.9 Hz, and a strong one of 4 Hz", R, own="thesis identification --run RUN"),
    ThesisRow("figure 3.7", "above 500 Hz", "thesis models --pictures", "poor", "median error 30 % of one period, 10.6 % of ten", R, own="thesis models --run RUN"),
    ThesisRow("figure 3.8", "raw ETFE against the model", "compare RUN", "", "every response with the fitted model", R),
    # 3.5, 3.6
    ThesisRow("(3.28) to (3.31)", "log-magnitude fit", "fit", "", "Levenberg-Marquardt, trust region or Nelder-Mead", R),
    ThesisRow("(3.32), figure 3.9", "subset with nearly logarithmic spacing", MODELS, "", "500 lines reduced to 30", R, own="thesis models --run RUN"),
    ThesisRow("table A.4", "parameters of G_A", "fit --details", "13.44 kg, 203.74 kN/m", "13.44 ± 0.01, 203.7 ± 0.2 on the plant of these numbers", R),
    ThesisRow("table A.4, damping", "d_m, d_c around standstill", "fit --details", "40 mN m s/rad", "62 mN m s/rad seen standing, 2.53 built in", D, "Coulomb friction, 4 M_C/(π Ω): 51 predicted"),
    ThesisRow("table A.5", "parameters of G_B", "fit", "0.96 kg, 222.39 kN/m", "0.96 kg, 222.4 kN/m on the plant of these numbers", R),
    ThesisRow("table A.5", "d_m = 0.01", "fit", "0.01 N s/m", "told as at its bound, with no interval", D, "erratum 8: not identifiable from that record"),
    ThesisRow("3.5, limits", "plausible against the data sheet", "fit", "", "data-sheet value, coupling and 25 %", R),
    ThesisRow("(3.33) to (3.35)", "strokes at constant speed", "friction", "", "both ways, ramps within the belt's limit", R),
    ThesisRow("(3.36), table A.10, G_A", "friction", "friction", "2.53 mN m s/rad, 0.125 N m", "2.53 ± 0.01, 0.1249 ± 0.0002 on the plant of these numbers", R),
    ThesisRow("(3.36), table A.10, G_B", "friction", "friction", "2.23, 0.115", "as printed on the plant of these numbers", R),
    ThesisRow("figure 3.10, (A.1)", "38 speeds in the source's sequence", FRICTION, "", "those whose ramps the belt bears", R, own="friction --order III"),
    ThesisRow("3.6, order I", "slowest first", FRICTION, "", "2.698 ± 0.025 mN m s/rad, 0.1176 N m", R, own="friction --order I"),
    ThesisRow("3.6, order II", "fastest first", FRICTION, "", "2.954 ± 0.031: +9.5 % by the order alone", R, own="friction --order II"),
    ThesisRow("3.6, order III", "shuffled (A.1)", FRICTION, "", "2.808 ± 0.043; drift shows in what is left over", R, own="friction --order III"),
    ThesisRow("3.6, order IV", "ten times", FRICTION, "", "2.196 ± 0.009 of 2.241 then", D, "(3.36) has no Stribeck effect, which reaches beyond 10 mm/s: 2.236 without it", own="friction --order I --repeat 10"),
    ThesisRow("3.6, order V", "after nine months", FRICTION, "less friction", "-9.9 % Coulomb, -15.1 % viscous (-10, -15 built in)", R, own="trend RUN OTHER"),
    ThesisRow("3.6, order VI", "with load", FRICTION, "more friction", "+11.3 %, +10.2 % (+8.7, +13.5 built in)", D, "more, as printed; the sizes by the Stribeck effect: +8.6 %, +13.8 % without it", own="friction --payload-mounted 11.2"),
    ThesisRow("3.6", "Stribeck effect around zero", FRICTION, "small", "+9 mN m below 10 mm/s", R, own="friction"),
    # chapter 4
    ThesisRow("(4.1), (4.2), figure 4.3", "notch", "design --prefilter notch", "d_n 4.60", "{designs:d_n}", D, "-6 dB taken as one half gives 4.598"),
    ThesisRow("(4.3), figure 4.3", "Butterworth", "design --prefilter butterworth", "123.24 rad/s", "{designs:omega_bw} rad/s", R, "f_z 19.59 Hz gives 123.23"),
    ThesisRow("4.2, A_notch, A_bw", "depth as one likes", "design --notch-depth -6 --butterworth-depth -3", "-6, -3 dB", "options of design, commission and page", R),
    ThesisRow("(4.4) to (4.6)", "discrete controller", DISCRETE, "", "gain and phase below closed bounds", R, own="thesis discretisation --run RUN"),
    ThesisRow("(6.1), T_R", "filter of the measured speed", "design --velocity-filter 2ms", "2 ms", "chosen of six, or as asked", R),
    ThesisRow("(4.7) to (4.9), notch", "K_P", DESIGNS, "0.08", "{designs:K_P notch}", D, "the print reaches -9.3 dB of -10", own="thesis designs --run RUN"),
    ThesisRow("(4.7) to (4.9), notch", "K_I", DESIGNS, "1.69", "{designs:K_I notch}", D, "not the exact solution; 60.2 deg", own="thesis designs --run RUN"),
    ThesisRow("(4.13), (4.14), notch", "K_PP", DESIGNS, "10.91", "{designs:K_PP notch}", D, "errata 5, 12: the print has 75 deg of 80", own="thesis designs --run RUN"),
    ThesisRow("(4.7) to (4.9), Butterworth", "K_P", DESIGNS, "0.12", "{designs:K_P Butterworth}", D, "the print reaches -8.7 dB", own="thesis designs --run RUN"),
    ThesisRow("(4.7) to (4.9), Butterworth", "K_I", DESIGNS, "1.39", "{designs:K_I Butterworth}", D, "not the exact solution; 61.7 deg", own="thesis designs --run RUN"),
    ThesisRow("(4.13), (4.14), Butterworth", "K_PP", DESIGNS, "6.29", "{designs:K_PP Butterworth}", D, "the print has 81.5 deg", own="thesis designs --run RUN"),
    ThesisRow("(4.7) to (4.9), no prefilter", "K_P, K_I, K_PP", DESIGNS, "not printed", "0.0034, 0.572, 2.51", R, own="thesis designs --run RUN"),
    ThesisRow("(4.7) to (4.9), own run", "equalities as printed on one's own axis", "thesis designs --run RUN", "", "solved, or refused with the reason, beside the run's gains", R),
    ThesisRow("(4.7) to (4.9), S_A", "roots above the antiresonance", DESIGNS, "found", "none: a wrapped phase is no margin", D, "refused with the reason", own="thesis designs --run RUN"),
    ThesisRow("(4.10), figure 4.6", "closed velocity loop", DESIGNS, "without G_pre", "with it; 7.33 against 7.56", D, "erratum 12", own="thesis designs --run RUN"),
    ThesisRow("figures 4.4, 4.5, 4.7", "loops with notch and Butterworth", "thesis designs --pictures", "", "drawn", R, own="report RUN"),
    ThesisRow("4.2.1", "suppression and phase margins as knobs", "commission --drive D --suppression -10 --phase-margin 45 --position-phase-margin 70", "3 knobs", "on design, commission and page, with presets (--demand)", R),
    ThesisRow("4.2, moving axis", "margins of the printed gains in motion", DESIGNS, "60 deg", "30 and 36 deg", D, "standstill friction posed as damping", own="thesis designs --run RUN"),
    ThesisRow("4.2, lowest resonance", "worst place", "design", "one place", "every place, payload and damping, and draws", R),
    ThesisRow("(4.15), table A.6", "m_e", DESIGNS, "0.02 kg m²", "{designs:m_e} kg m²", D, "erratum 6: printed ten times too large", own="fit"),
    ThesisRow("(4.15)", "linear feedforward", "verify --feedforward linear", "", "inertia and all friction as damping", R),
    ThesisRow("(4.16)", "nonlinear feedforward", "verify --feedforward nonlinear", "", "inertia, viscous, Coulomb", R),
    ThesisRow("(4.17)", "velocity feedforward", "verify", "1", "1", R),
    # chapter 5
    ThesisRow("table A.8, T_A", "the 0.5 m move", CLOSED, "", "0.737 s, 1.36 m/s, 7.37 m/s²; 98.9 N in the belt; slowed to 95 % where a lost PC would load the belt beyond 140 N; by `--trajectory T_A` it is refused (153 N of 150 N then), and the command that slows it stands below", R, own="verify"),
    ThesisRow("table A.9, T_B", "the faster one", "verify --trajectory T_B --over-belt", "", "114.9 N: beyond the axis's 100 N, virtual only", D, "refused on a machine"),
    ThesisRow("figure 5.1, none", "without prefilter: larger errors", "thesis closed-loop --pictures", "larger", "{closed:5.1 prefilter none} mm", R, own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.1, notch", "position, error of carriage and motor, speed, torque", "thesis closed-loop --pictures", "", "{closed:5.1 prefilter notch} mm", R, own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.1, Butterworth", "the same", "thesis closed-loop --pictures", "", "{closed:5.1 prefilter butterworth} mm", R, own="thesis closed-loop --run RUN"),
    ThesisRow("5.1", "filter removed: unstable", CLOSED, "unstable", "|z| 1.12 and 1.18; the drive stops it", R, own="thesis closed-loop --run RUN"),
    ThesisRow("5.1, claim", "Butterworth more robust than the notch", "thesis designs --run RUN", "yes", "on G_A's run: no more margin lost in 3 of 5 variants; unstable with a tenth of the load", D, "holds for a stiffer belt, not for a light carriage"),
    ThesisRow("figure 5.2, none", "worst", "thesis closed-loop --pictures", "worst", "{closed:5.2 feedforward none} mm", R, own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.2, linear", "error changes its sign", "thesis closed-loop --pictures", "yes", "{closed:5.2 feedforward linear} mm, yes", R, own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.2, nonlinear", "smallest", "thesis closed-loop --pictures", "< 1 mm", "{closed:5.2 feedforward nonlinear} mm", D, "reference compared with a velocity that lags by T_R + T/2", own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.3, none", "0 kg", "thesis closed-loop --pictures", "", "{closed:5.3 feedforward none} mm", R, own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.3, linear", "0 kg", "thesis closed-loop --pictures", "", "{closed:5.3 feedforward linear} mm", R, own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.3, nonlinear", "0 kg", "thesis closed-loop --pictures", "< 1 mm", "{closed:5.3 feedforward nonlinear} mm", D, "as figure 5.2", own="thesis closed-loop --run RUN"),
    ThesisRow("figure 5.4", "both masses below 1 mm", "thesis closed-loop --pictures", "< 1 mm", "{closed:5.4 nonlinear, reference behind the same lag} mm", R, "with the reference behind the same lag", own="thesis closed-loop --run RUN"),
    ThesisRow("5.3", "static error", CLOSED, "< 100 µm", "81 and 15 µm", R, own="thesis closed-loop --run RUN"),
    ThesisRow("5.3", "carriage error beside the motor's", "thesis closed-loop --pictures", "larger", "0.59 against 0.15 mm: stretch of the belt", R, own="thesis closed-loop --run RUN"),
    # chapter 6
    ThesisRow("(6.1), (6.9), figure 6.1", "high-pass and difference", ESTIM, "", "worst errors over speed, with bounds", R, own="thesis estimators --run RUN"),
    ThesisRow("figure 6.2", "steps of a discrete high-pass", "thesis estimators --pictures", "", "drawn", R, own="thesis estimators --run RUN --edges FILE"),
    ThesisRow("(6.2), figure 6.3", "state machine S1 to S8", ESTIM, "S_mod(i+1,4)", "cycles S1..S4 and S5..S8", D, "the print has an S_0, erratum 13", own="export RUN --format c --part encoder"),
    ThesisRow("figure 6.4", "debouncing", ESTIM, "", "bounces of an edge count once", R, own="thesis estimators --run RUN --edges FILE"),
    ThesisRow("(6.3) to (6.8)", "event counter", ESTIM, "", "as printed, with its fewest intervals beside it", R, own="thesis estimators --run RUN"),
    ThesisRow("(6.10) to (6.12)", "its error", ESTIM, "bounds", "no bounds: the worst case lies above (6.12)", D, "(C.3) takes the better of two cases", own="thesis estimators --run RUN"),
    ThesisRow("(6.13)", "limit for high speed", ESTIM, "0.001 %", "0.001 % (10 ns of 1 ms)", R, "a limit, no argmin", own="thesis estimators --run RUN"),
    ThesisRow("(6.14) to (6.16), figure 6.6", "gate measurement", ESTIM, "", "as printed", R, own="thesis estimators --run RUN"),
    ThesisRow("(6.17), (6.18), figure 6.7", "time-out", ESTIM, "", "fails as printed; bounded extension in its place", D, "(6.17) jumps", own="export RUN --format c --part encoder"),
    ThesisRow("(6.19), figure 6.5", "where both cross", ESTIM, "2 Δξ/T_s", "5.0 mm/s at 2.5 µm and 1 ms", R, own="thesis estimators --run RUN"),
    ThesisRow("(6.20) to (6.22), figure 6.8", "combination", ESTIM, "", "(6.20) fails as printed; guarded switching in its place", D, "it mixes a value that is not there", own="thesis estimators --run RUN"),
    ThesisRow("6.1, own axis", "choice by resolution and speed", "thesis estimators --run RUN", "", "least worst error and delay at six speeds of the axis", R),
    ThesisRow("6.1, firmware", "export of gate, event counter, combination, state machine", "export RUN --format c --part encoder", "", "C, structured text and YAML give the estimators' own numbers, to 1e-14 in double", R),
    ThesisRow("6.1, own edges", "import of edge times", "thesis estimators --run RUN --edges FILE", "", "time with A and B, direction, count or nothing; the four tried on them; `import --edges` takes the position", R),
    ThesisRow("(6.23) to (6.26), figure 6.9", "anti-windup by conditional integration", "export --format c", "", "in drive, simulation and exported code", R),
    ThesisRow("figure 6.10", "with and without", "thesis closed-loop --pictures", "better", "20.7 to 17.7 mm, at rest 0.96 to 0.24 mm at 1.24 N m", R, own="thesis closed-loop --run RUN"),
    ThesisRow("figure 6.10, own run", "the same on one's own move", "thesis closed-loop --run RUN", "", "at 80 % of the torque 0.68 to 0.13 mm at rest, 1.15 to 0.00 mm beyond", R),
    ThesisRow("6.3, figure 6.11", "jerk-limited, any state at both ends", "trajectory FILE --from 0 --to 0.5 --speed 1 --acceleration 10 --jerk 200", "", "seven phases and ruckig", R),
    # chapter 7, appendices
    ThesisRow("7", "gravity by a slow integrator", "thesis gravity --run RUN", "proposed", "435 and 685 mN m for 560: gravity ± friction; half sums 560", D, "why creep both ways is taken"),
    ThesisRow("7", "tuning by sliders", "open", "proposed", "three knobs with predicted error", R),
    ThesisRow("7", "model running along for diagnosis", "watch --drive D --run RUN", "proposed", "each production move judged ([watch](watch.md))", R),
    ThesisRow("7", "learning of repeated moves", "verify --learn 8", "proposed", "41 to 7.5 µm rms in eight drives; 134 to 37 with an effect that the model lacks", R),
    ThesisRow("(B.1) to (B.8)", "P-PI as PID and back", "convert RUN", "", "both roots, refused where there is none", R),
    ThesisRow("(C.1) to (C.8)", "errors of the estimators", ESTIM, "", "(C.6) with its factor 100", D, "printed without it, erratum 13", own="thesis estimators --run RUN"),
)  # fmt: skip


def on_own_axis(row: ThesisRow) -> str:
    """What does a row on one's own axis and run; "" where only the source's case is recomputed."""
    alone = row.command.startswith("thesis") and "--run" not in row.command
    return row.own or ("" if alone else row.command)


def looked_up(text: str, found: Mapping[str, Mapping[str, Any]]) -> str:
    """A text with its lookups replaced: ``{designs:ITEM}``, ``{closed:FIGURE NAME}`` (mm at the motor and the carriage)."""

    def value(match: re.Match[str]) -> str:
        topic, name = match[1], match[2]
        if topic == "designs":
            return f"{next(one['ours'] for one in found['designs']['numbers'] if one['item'] == name):.5g}"
        figure, _, words = name.partition(" ")
        runs = [run for run in found["closed-loop"]["runs"] if run["figure"] == figure and run["name"] == words]
        return " and ".join(f"{1e3 * run['motor']['dynamic_m']:.3g}/{1e3 * run['cart']['dynamic_m']:.3g}" for run in runs)

    return re.sub(r"\{(\w+):([^}]+)\}", value, text)


def page(found: Mapping[str, Mapping[str, Any]]) -> str:
    """The page."""
    only = sum(not on_own_axis(row) for row in ROWS)
    count = {mark: sum(row.mark == mark for row in ROWS) for mark in MARKS}
    head = [
        "# The design source, row by row",
        "",
        "What it states, plots and proposes, the command that does it on an axis and a run of yours (`beltcomm` left out), what recomputes the source's own",
        "case, the printed figure and ours. *Right*: within the print's digits, or what the source says comes out. *Differs*: why stands beside it. Errors are",
        "at motor/carriage. Made by `python docs/thesis_rows.py`; topics, tests and errata are on the page [design source](thesis.md).",
        "",
        "RUN and OTHER are run folders, D is a drive (`virtual`); `--yes` where nobody sits at the terminal. `python tests/benchmarks/rows.py` types them all.",
        "",
        f"{len(ROWS)} rows: {count['right']} right, {count['differs']} differ and are explained, {count['missing']} missing; {only} rest on a recomputed case alone.",
        "",
        "| # | source | what | on your axis | recomputed | printed | ours | mark | why |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    rows = []
    for number, row in enumerate(ROWS, start=1):
        recomputed = row.command if row.own or not on_own_axis(row) else ""
        own, again = (one if "`" in one or not one else f"`{one}`" for one in (on_own_axis(row), recomputed))
        cells = (str(number), row.source, row.what, own, again, row.printed, looked_up(row.ours, found), row.mark, row.why)
        rows.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join([*head, *rows]) + "\n"


def main() -> None:
    """The command."""
    found = {}
    for topic in ("designs", "closed-loop"):
        if len(sys.argv) > 1:
            found[topic] = json.loads((Path(sys.argv[1]) / f"{topic}.json").read_text(encoding="utf-8"))
        else:
            from beltcomm.thesis.topics import thesis

            found[topic] = dict(thesis(topic).to_json())
    PAGE.write_text(page(found), encoding="utf-8")


if __name__ == "__main__":
    main()
