"""Answers on one screen: the headline, errors against targets, axis, model, gains, loop, what to look at, and the command to type next.

Each function makes the lines of one part; a verb shows the parts that it has.  Three digits: more belongs into the files.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from textwrap import shorten, wrap
from typing import TYPE_CHECKING, Any

from beltcomm.control import Cascade
from beltcomm.design.cascade import DesignResult
from beltcomm.design.margins import Margins, worst_of
from beltcomm.errors import BeltcommError
from beltcomm.fit.model_fit import SUSPECT_MISFIT
from beltcomm.fit.noise.level import error_floor_words
from beltcomm.identify.friction import FrictionFit
from beltcomm.language import told, tr
from beltcomm.model import Model
from beltcomm.quantities import in_mm, mm, three_digits
from beltcomm.result import Line, command_lines
from beltcomm.rundata import analyse
from beltcomm.rundata.design_proof import DesignProof
from beltcomm.rundata.headline import EXPLAINED, MEANINGS, NOTED, Headline, NextCommand
from beltcomm.simulate.stopping import total_friction, total_viscous
from beltcomm.verify import TrackingError, Verdict

if TYPE_CHECKING:
    from beltcomm.laboratory.compare import Missing

#: Columns of a screen; warnings that it shows.
WIDE, MOST_WARNINGS = 80, 3
#: s, below which a move has settled with its end.
AT_ONCE_S = 5e-4
#: How a note begins that nobody has to act on.
UNHURRIED = "not recorded, for "
#: What of a data sheet is off, in the words of a screen: entry -> (found less, found more).
OFF = {
    "belt.specific_stiffness_n": (
        "belt {share:.0f} % softer than its data sheet: its teeth, radius, tension?",
        "belt {share:.0f} % stiffer than its data sheet: check axis.yaml",
    ),
    "motor.inertia_kg_m2": (
        "motor side {share:.0f} % lighter than its data sheet: check axis.yaml",
        "motor side {share:.0f} % heavier than its data sheet: check axis.yaml",
    ),
}


def headline_lines(headline: Headline) -> list[Line]:
    """State in colour and word, then the sentence, broken where it is long.

    Parameters
    ----------
    headline : Headline
        Of the run.
    """
    return state_lines(tr(headline.word), headline.sentence, MEANINGS[headline.state])


def state_lines(word: str, sentence: str, style: str) -> list[Line]:
    """First lines of an answer: its state, and a sentence that is broken where it is long.

    Parameters
    ----------
    word : str
        Of the state.
    sentence : str
        Beside it.
    style : str
        Of the word.
    """
    first, *more = wrap(sentence, WIDE - len(word) - 5, break_on_hyphens=False) or [""]
    return [
        Line("  ", (word, style), "   ", (first, "title")),
        *(Line(" " * (len(word) + 5), (part, "title")) for part in more),
    ]


def tracking_lines(verdict: Verdict) -> list[Line]:
    """Errors measured and predicted, each against its target, at the motor and at the carriage.

    Parameters
    ----------
    verdict : Verdict, m
        Of a move.
    """
    targets = verdict.targets
    title = tr("your target") if targets.stated else tr("default target")
    rows = [Line(" " * 29, (f"{tr('measured'):<11}{tr('predicted'):<18}{title}", "soft"))]
    for place, measured, predicted, spread in (
        ("motor", verdict.measured, verdict.predicted, verdict.predicted_range),
        ("carriage", verdict.measured_cart, verdict.predicted_cart, None),
    ):
        judged = place in targets.places
        rows.append(_error_row(tr("following error"), place, "dynamic_m", measured, predicted, spread, targets.following_m, judged))
        if judged:
            label = tr("after {s:g} s", s=targets.after_s)
            rows.append(_error_row(label, place, "static_m", measured, predicted, spread, targets.settled_m, judged))
    place, one = ("carriage", verdict.measured_cart) if verdict.measured_cart else ("motor", verdict.measured)
    settled = (
        tr("never settles")
        if one.settling_s is None
        else tr("settled when the move ends")
        if one.settling_s < AT_ONCE_S
        else tr("settles in {ms:.0f} ms", ms=1e3 * one.settling_s)
    )
    return [*rows, Line("   ", f"{tr('overshoot')}, {tr(place)}".ljust(26), f"{mm(one.overshoot_m)}".ljust(11), settled)]


def _error_row(
    label: str,
    place: str,
    key: str,
    measured: TrackingError | None,
    predicted: TrackingError,
    spread: tuple[TrackingError, TrackingError] | None,
    limit_m: float,
    judged: bool,
) -> Line:
    """One error with its target; what is not judged is still compared."""
    value = float(getattr(predicted if measured is None else measured, key))
    guess = mm(getattr(predicted, key)) if spread is None else "..".join(in_mm(getattr(end, key)) for end in spread)
    word = tr("ok") if value <= limit_m else tr("MISSED") if judged else tr("beyond")
    style = "good" if value <= limit_m else "bad" if judged else "note"
    shown = "-" if measured is None else mm(value)
    wanted = mm(limit_m) if judged else f"({mm(limit_m)})"
    return Line(
        "   ", f"{label}, {tr(place)}".ljust(26), shown.ljust(11), guess.ljust(18), wanted.ljust(11), (word, style if judged else "soft")
    )


def axis_lines(model: Model, at_m: float, delay_s: float | None) -> list[Line]:
    """Axis in lines: mass, belt, friction at the carriage, resonances for a place.

    Parameters
    ----------
    model : Model
    at_m : float, m
        Carriage on the axis.
    delay_s : float or None, s
        Of the torque path; None leaves it out.
    """
    ratio = model["transmission.ratio"]
    coulomb, viscous = total_friction(model) / ratio, total_viscous(model) / ratio**2
    belt = f"   {tr('rigid')}" if model.rigid else ""
    if "belt_stiffness.stiffness" in model.parameters:
        belt = f"   {tr('belt')} {three_digits(model['belt_stiffness.stiffness'] / 1e3)} kN/m"
    elif "belt_spans.specific_stiffness" in model.parameters:
        belt = f"   {tr('belt')} EA {three_digits(model['belt_spans.specific_stiffness'] / 1e3)} kN"
    friction = f"{tr('friction')} {three_digits(coulomb)} N + {three_digits(viscous)} N s/m"
    first = f"{tr('mass')} {three_digits(model['cart.mass'])} kg{belt}   {friction}"
    second = []
    try:
        low, high = analyse.characteristic_hz(model, at_m)
        second = [] if model.rigid else [f"{tr('antiresonance')} {three_digits(low)} Hz", f"{tr('resonance')} {three_digits(high)} Hz"]
    except BeltcommError:
        pass
    second += [f"{tr('delay')} {1e3 * delay_s:.3g} ms"] if delay_s else []
    rows = [Line("   ", (f"{tr('axis'):<9}", "title"), first)]
    return [*rows, *([Line(" " * 12, "   ".join(second))] if second else [])]


def model_state(level: float, suspect: bool | None = None, judged: bool = True, missing: Missing | None = None) -> tuple[str, str, str]:
    """Verdict on the model against what was measured: the word of its state, a sentence, the style of both.

    Parameters
    ----------
    level : float
        Error over the noise.
    suspect : bool or None
        None judges by the level alone.
    judged : bool
        Of the fit: whether the level tells that nothing is missing.
    missing : Missing or None
        Of a comparison; None judges the size alone.
    """
    if error_floor_words(level):
        return tr("NOT JUDGED"), tr("leaves {level:.2f} x the noise, less than noise can leave: not judged", level=level), "note"
    if suspect if suspect is not None else level**2 > SUSPECT_MISFIT:
        return tr("DOES NOT FIT"), tr("does NOT explain what was measured ({level:.2f} x the noise)", level=level), "bad"
    if not judged:
        return tr("NOT JUDGED"), tr("follows the rows ({level:.2f} x the noise); not judged between them", level=level), "note"
    if missing or (missing is None and level > EXPLAINED):
        told = {
            "stretches": tr("leaves {level:.2f} x the noise, in a few stretches alone", level=level),
            "held out": tr("leaves {level:.2f} x the noise of records held out", level=level),
            "structure": tr("leaves {level:.2f} x the noise, but not at random: something is missing", level=level),
        }
        return tr("FITS IN PART"), told.get(missing or "", tr("leaves {level:.2f} x the noise: something is missing", level=level)), "note"
    if missing is None:
        return tr("FITS"), tr("its error is {level:.2f} x the noise", level=level), "good"
    return tr("FITS"), tr("explains everything above the noise ({level:.2f} x)", level=level), "good"


def model_line(level: float, suspect: bool | None, judged: bool = True, missing: Missing | None = None) -> Line:
    """:func:`model_state` as a line of a screen.

    Parameters
    ----------
    level : float
        Error over the noise.
    suspect : bool or None
        None judges by the level alone.
    judged, missing
        As of :func:`model_state`.
    """
    _, sentence, style = model_state(level, suspect, judged, missing)
    label = ("   ", ""), (f"{tr('model'):<9}", "title")
    return Line(*label, sentence.ljust(56), (tr("ok"), style)) if style == "good" else Line(*label, (sentence, style))


def _gain_lines(cascade: Cascade) -> list[Line]:
    """The gains, prefilter and feedforward."""
    gains = f"Kp {cascade.kp_nm_s_rad:.3g} N m s/rad   Ki {cascade.ki_nm_rad:.3g} N m/rad   Kv {cascade.kpp_1_s:.3g} 1/s"
    filters = {
        "none": tr("no prefilter"),
        "notch": tr("notch {hz:.3g} Hz", hz=cascade.prefilter.omega_rad_s / math.tau),
        "butterworth": tr("low-pass {hz:.3g} Hz", hz=cascade.prefilter.omega_rad_s / math.tau),
    }[cascade.prefilter.kind]
    sent = cascade.feedforward
    parts = [
        word
        for word, value in (
            (tr("inertia"), sent.inertia_kg_m2),
            *(
                [(tr("friction"), sent.coulomb_nm)]
                if sent.viscous_nm_s_rad and sent.coulomb_nm
                else [(tr("viscous"), sent.viscous_nm_s_rad), (tr("Coulomb"), sent.coulomb_nm)]
            ),
            (tr("offset"), sent.offset_nm),
            (tr("velocity"), sent.velocity),
        )
        if value
    ]
    forward = f"{tr('feedforward')}: {', '.join(parts)}" if parts else tr("no feedforward")
    return [
        Line("   ", (f"{tr('gains'):<9}", "title"), gains),
        Line(" " * 12, f"{filters}   {forward}"),
    ]


def _loop_lines(margins: Sequence[Margins], binding: Sequence[str]) -> list[Line]:
    """Bandwidths (crossovers: in motion, and with the friction at rest) with what limits them; margins, of all variants the worst."""
    worst = worst_of(margins)
    velocity, position, still, resting = (
        worst.bandwidth_hz,
        worst.position_bandwidth_hz,
        worst.bandwidth_at_rest_hz,
        worst.position_bandwidth_at_rest_hz,
    )
    first = f"{tr('bandwidth')}: {tr('velocity')} {three_digits(velocity)} Hz, {tr('position')} {three_digits(position)} Hz"
    if (still, resting) != (velocity, position):
        first += " " + tr("(at rest {velocity}, {position})", velocity=f"{still:.2g}", position=f"{resting:.2g}")
    told = f"{worst.gain_margin_db:.3g} dB" if math.isfinite(worst.gain_margin_db) else tr("unlimited")
    phases = f"{tr('phase margin')} {worst.phase_margin_deg:.0f}°, {tr('position')} {worst.position_phase_margin_deg:.0f}°"
    second = f"{phases}   {tr('gain margin')} {told}   Ms {worst.sensitivity_db:.2g} dB"
    rows = [Line("   ", (f"{tr('loop'):<9}", "title"), first), Line(" " * 12, second)]
    limits = list(dict.fromkeys(_limit(reason) for reason in binding))
    return rows + ([Line(" " * 12, shorten(f"{tr('limited by')} {', '.join(limits)}", WIDE - 12, placeholder=" ..."))] if limits else [])


def friction_line(friction: FrictionFit) -> Line:
    """Coulomb and viscous friction of the sweep at the motor, with their intervals.

    Parameters
    ----------
    friction : FrictionFit, N m, N m s/rad, motor shaft
        Of the sweep.
    """
    coulomb, viscous = friction.coulomb, friction.viscous
    text = f"Coulomb {three_digits(1e3 * coulomb.value)}{_half(coulomb.interval)} mN m   "
    text += f"{tr('viscous')} {three_digits(1e3 * viscous.value)}{_half(viscous.interval)} mN m s/rad"
    return Line("   ", (f"{tr('friction'):<9}", "title"), text)


def _half(interval: float | None) -> str:
    return "" if interval is None else f" ± {1e3 * interval:.2g}"


def design_screen(design: DesignResult, cascade: Cascade) -> list[Line]:
    """Gains and loop of a design on a screen.

    Parameters
    ----------
    design : DesignResult
        Result with its margins.
    cascade : Cascade
        That was designed.
    """
    return [*_gain_lines(cascade), *_loop_lines(design.margins, design.binding)]


def proof_lines(proof: DesignProof) -> list[Line]:
    """Lines on how many measured responses and drawn models the loop holds, and the worst of them.

    Parameters
    ----------
    proof : DesignProof
        Of the design.
    """
    unstable = [m.record for m in proof.measured if m.stable is False]
    bad = bool(unstable) or proof.spread.unstable > 0
    count = len(proof.measured)
    text = tr("1 measured response") if count == 1 else tr("{count} measured responses", count=count)
    text += f", {tr('UNSTABLE on')} {', '.join(unstable)}" if unstable else ""
    text += "; " + tr("{count} drawn models, {bad} unstable", count=proof.spread.draws, bad=proof.spread.unstable or tr("none"))
    label = ("   ", ""), (f"{tr('proof'):<9}", "title")
    return [Line(*label, (text, "bad"))] if bad else [Line(*label, text.ljust(56), (tr("ok"), "good"))]


def sheet_words(doubts: Iterable[Mapping[str, Any]]) -> list[str]:
    """Contradictions between data sheets and model, a line each.

    Parameters
    ----------
    doubts : iterable of mapping of str to Any
        As the run keeps them.
    """
    told = []
    for doubt in doubts:
        less, more = OFF.get(str(doubt["entry"]), ("{share:.0f} % less than in axis.yaml", "{share:.0f} % more than in axis.yaml"))
        factor = float(doubt["factor"])
        text = tr(less if factor < 1.0 else more, share=100.0 * abs(factor - 1.0))
        told.append(text if str(doubt["entry"]) in OFF else f"{doubt['entry']}: {text}")
    return told


def warnings(session: Mapping[str, Any], sheets: Iterable[Mapping[str, Any]]) -> list[str]:
    """Warnings below a headline: reservations and notes of the session that it rests on, and what of the data sheets is off.

    Parameters
    ----------
    session : mapping of str to Any
        Result of a move or a design, as the run keeps it.
    sheets : iterable of mapping of str to Any
        Contradictions, as the run keeps them.
    """
    notes = (note for note in session.get(NOTED) or () if not note.startswith(UNHURRIED))
    return [*map(told, session.get("reservations") or ()), *sheet_words(sheets), *map(told, notes)]


def warning_lines(texts: Sequence[str]) -> list[Line]:
    """Warnings, a line each; how many more there are.

    Parameters
    ----------
    texts : sequence of str
        Sentences; :data:`MOST_WARNINGS` are shown.
    """
    lines = [Line("   ", (shorten(f"! {told(text)}", WIDE - 4, placeholder=" ..."), "note")) for text in texts[:MOST_WARNINGS]]
    left = len(texts) - MOST_WARNINGS
    return lines + ([Line("   ", (f"! {tr('{count} more notes', count=left)}: --details", "note"))] if left > 0 else [])


def next_lines(step: NextCommand) -> list[Line]:
    """The command to type next.

    Parameters
    ----------
    step : NextCommand
        Command, and why.
    """
    return command_lines(step.command, step.why)


def _limit(reason: str) -> str:
    """Binding limit without its value: ``velocity phase margin``."""
    return tr(re.split(r" -?[\d.]", reason.partition(" (")[0])[0])
