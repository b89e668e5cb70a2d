"""Answers of the laboratory on one screen, and what ``--details`` adds to them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

from beltcomm.effects import effect_named
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.laboratory.compare import Comparison
from beltcomm.laboratory.diagnosis import NONE_EXPLAINS, Diagnosis
from beltcomm.laboratory.figures import Plain
from beltcomm.language import told, tr
from beltcomm.model import Model
from beltcomm.quantities import read_in
from beltcomm.result import Line, table, with_unit
from beltcomm.rundata.cost import cost_rows
from beltcomm.sentences.ladder import candidate_rows, held_out_words, number_lines
from beltcomm.sentences.screens import WIDE, model_state, state_lines, warning_lines

#: Records, places, candidates and effects that fit on a screen.
RECORDS, PLACES, CANDIDATES, EFFECTS = 4, 3, 3, 2
#: Bound of a parameter over the error of a model: one from 1 N m on is told in N m, as a rating is.
RATING_OVER_ERROR = 50.0
#: Verdict of a diagnosis -> word of its state, and its style.
STATES = {
    "nothing missing": ("NOTHING MISSING", "good"),
    "explained": ("FOUND", "good"),
    "partly explained": ("FOUND IN PART", "note"),
    NONE_EXPLAINS: ("NOT NAMED", "bad"),
    "cannot tell": ("CANNOT TELL", "note"),
}


def comparison_state(comparison: Comparison, doubt: str) -> tuple[str, str, str]:
    """State of a model that was compared with its records, on every screen and page: its word, a sentence, the style of both.

    Parameters
    ----------
    comparison : Comparison
        Of the model.
    doubt : str
        Why the error says nothing; "" where it does.
    """
    if doubt:
        return tr("NOT JUDGED"), doubt, "note"
    word, sentence, style = model_state(comparison.decisive_ratio, missing=comparison.missing)
    return word, tr("the model {does}", does=sentence), style


def comparison_screen(comparison: Comparison, places: Sequence[str], notes: Sequence[str], doubt: str = "") -> list[str]:
    """``beltcomm compare`` but for the command to type next.

    Parameters
    ----------
    comparison : Comparison
        Of the model.
    places : sequence of str
        Sentences on where the error stands out.
    notes : sequence of str
        What else to look at.
    doubt : str
        Why the error says nothing.
    """
    titles, rows = record_table(comparison)
    short = [0, 1, 2, len(titles) - 1] if len(titles) > 3 else range(len(titles))
    ranked = sorted(range(len(rows)), key=lambda number: -comparison.records[number].ratio)
    worst = sorted(ranked[:RECORDS])
    left = len(rows) - len(worst)
    lines: list[str] = [
        *state_lines(*comparison_state(comparison, doubt)),
        _labelled(tr("error"), error_words((comparison.ratio, comparison.held_out), (comparison.plain, comparison.plain_held_out))),
        *table([titles[n] for n in short], [[rows[number][n] for n in short] for number in worst], "   "),
        *(["   " + tr("{count} more below these: --details", count=left)] if left else []),
    ]
    if places:
        lines += [Line("   ", (tr("where it fails most"), "title")), *(Line("     ", place) for place in places[:PLACES])]
    held_out = held_out_words(comparison.ratio, comparison.held_out) if comparison.missing != "held out" else []  # the state says it
    return [*lines, *warning_lines([*held_out, *notes])]


def comparison_details(comparison: Comparison, model: Model) -> list[str]:
    """Model and records of :func:`comparison_screen` in full.

    Parameters
    ----------
    comparison : Comparison
        Of the model.
    model : Model
    """
    first = comparison.plain or comparison.plain_held_out
    apart = ""
    if first:
        unit = _error_unit(first.unit, _largest_error(comparison))[1]
        apart = f"{unit} and % up to {first.band_hz:g} Hz; x noise at all frequencies, by its own noise: no quotient."
    return [f"Model: {', '.join(model.effects)}.", "", *table(*record_table(comparison)), apart, ""]


def diagnosis_screen(
    found: Diagnosis, before: Plain, after: Plain, caveats: Sequence[str], notes: Sequence[str], cost: Mapping[str, Any] | None
) -> list[str]:
    """``beltcomm diagnose`` but for what is next.

    Parameters
    ----------
    found : Diagnosis
    before, after : Plain
        Errors of the first and of the last model in plain units.
    caveats : sequence of str
        What must be known before the answer is believed.
    notes : sequence of str
        What else to look at.
    cost : dict of str to Any or None
        Tracking errors without and with what was found.
    """
    named = found.added_effects
    first, last = found.published_base[1], found.final_fit
    lines: list[str] = [
        *state_lines(*verdict_state(found.verdict, named)),
        _labelled(tr("error"), error_words((first.ratio, first.held_out_ratio), before)),
    ]
    lines += [_labelled(tr("with it"), error_words((last.ratio, last.held_out_ratio), after))] if named else []
    lines += candidate_rows(found, CANDIDATES, "   ")
    model = with_intervals(last)
    for name in named[:EFFECTS]:
        effect = effect_named(name)
        numbers = [line.removeprefix(f"{name}.") for line in number_lines(effect, model)]
        lines += _block(name, ", ".join(numbers)) if len(numbers) else []
        lines += [*(_block(tr("causes"), told(effect.causes)) if effect.causes else []), *_block(tr("check"), told(effect.check))]
    if len(named) > EFFECTS:
        lines.append(f"   and {', '.join(named[EFFECTS:])}: --details")
    if cost:
        moving = ((what.partition(",")[0], old, new) for what, old, _, new, _ in cost_rows(cost) if what.endswith("dynamic"))
        rows = [f"{tr(place)} {old} → {new} mm" for place, old, new in moving]
        lines += _block(told("tracking"), told("; ".join(rows) + ", following error without and with it in the controller"))
    return [*lines, *(Line("   ", (f"! {text}", "note")) for text in caveats), *warning_lines(notes)]


def verdict_state(verdict: str, added: Sequence[str]) -> tuple[str, str, str]:
    """Answer of a diagnosis, on every screen and page: the word of its state, a sentence, the style of both.

    Parameters
    ----------
    verdict : str
        Of a diagnosis.
    added : sequence of str
        Effects that it names.
    """
    word, style = STATES[verdict]
    if added:
        return tr(word), "; ".join(f"{name}: {told(effect_named(name).title)}" for name in added), style
    sentence = {
        "nothing missing": tr("the model explains what was measured"),
        NONE_EXPLAINS: tr("none of the known effects explains this"),
    }.get(verdict, tr("these records cannot tell what the model lacks"))
    return tr(word), sentence, style


def error_words(ratios: tuple[float, float | None], plain: Plain) -> str:
    """An error over the noise and in plain units, of the fitted records and of those held out where there are any.

    Parameters
    ----------
    ratios : tuple of float and float or None
        Error over the noise, fitted and held out.
    plain : Plain
        Error in plain units, fitted and held out.
    """
    (ratio, held), (whole, whole_held) = ratios, plain
    own = ""
    if whole is not None:
        factor, unit = _error_unit(whole.unit, whole.error)
        size = with_unit(f"{factor * whole.error:.3g}", unit)
        own = tr(", {percent:.2g} % of torque ({size})", percent=whole.percent, size=size)
    theirs = "" if whole_held is None else f", {whole_held.percent:.2g} %"
    return tr("{ratio:.2f} x noise", ratio=ratio) + own + ("" if held is None else tr("; held out {held:.2f} x", held=held) + theirs)


def _error_unit(unit: str, largest: float) -> tuple[float, str]:
    """Factor and unit in which errors are told: mN m, of a large machine N m."""
    return read_in(unit, RATING_OVER_ERROR * largest)


def _largest_error(comparison: Comparison) -> float:
    return max((r.plain.error for r in comparison.records if r.plain is not None), default=0.0)


def record_table(comparison: Comparison) -> tuple[list[str], list[list[str]]]:
    """Table of what each record leaves over, over its noise and in plain units.

    Parameters
    ----------
    comparison : Comparison
        Of a model.

    Returns
    -------
    tuple of list of str and list of list of str
        Titles and rows.
    """
    first = comparison.plain or comparison.plain_held_out
    factor, unit = (1.0, "") if first is None else _error_unit(first.unit, _largest_error(comparison))
    titles = [">" + tr("% of torque"), f">{tr('error')} {unit}", f">{tr('noise')} {unit}"] if first is not None else []
    rows = []
    for r in comparison.records:
        own = [] if r.plain is None else [f"{r.plain.percent:.3g}", f"{factor * r.plain.error:.3g}", f"{factor * r.plain.noise:.3g}"]
        rows.append([r.name, f"{r.ratio:.2f}", *(own or [""] * len(titles)), tr("held out") if r.held_out else ""])
    return [tr("record"), ">" + tr("x noise"), *titles, ""], rows


def _labelled(label: str, text: str) -> Line:
    return Line("   ", (f"{label:<9}", "title"), text)


def _block(label: str, text: str) -> list[Line]:
    """A labelled text, broken where it is long."""
    label = f"{label:<9}" if len(label) < 9 else f"{label}  "
    first, *more = wrap(text, WIDE - 4 - max(9, len(label)), break_on_hyphens=False) or [""]
    return [_labelled(label, first), *(Line(" " * 12, part) for part in wrap(" ".join(more), WIDE - 13))]
