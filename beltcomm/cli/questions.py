"""Questions and answers in the units of data sheets."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import click

from beltcomm.axis.answers import in_words, usual, usual_words
from beltcomm.axis.entries import COMMISSION_NEEDS
from beltcomm.cli.talk import NO, YES
from beltcomm.cli.terminal import fitted
from beltcomm.errors import UsageError
from beltcomm.language import told, tr
from beltcomm.quantities import parse_quantity, unit_of

if TYPE_CHECKING:
    from beltcomm.axis.entries import AxisEntry

#: What may be written instead of a number, by entry, beside other units.
_OTHERWISE = {
    "inertia_kg_m2": "or 0.449 kg cm2",
    "encoder_counts_per_rev": "or bits: 20 bit",
    "effective_radius_m": "or teeth x pitch: 24 x 5 mm; or travel per turn: 120 mm/rev",
    "max_speed_rad_s": "or 3000 rpm",
    "speed_deg_s": "or 300 rpm",
    "lead_m": "or 10 mm/rev",
    "pole_pair_m": "or 32 mm",
    "pinion_radius_m": "or teeth x module: 20 x 2 mm; or travel per turn: 200 mm/rev",
}
#: Answers that mean: there is none; the question before; the rest is left out.
NONE = ("none", "no", "-", "keine", "keiner", "keins", "kein")
_BACK, _DONE = ("back", "<", "zurück"), ("done", "fertig")
_TEETH = re.compile(r"(\d+)\s*(?:teeth)?\s*[x×*]\s*(.+)", re.IGNORECASE)
_TRAVEL_PER_TURN = ("lead_m", "pole_pair_m")
_MODULE = re.compile(r"(\d+)\s*(?:teeth)?\s*[x×*]\s*(?:module|m)?\s*(.+)", re.IGNORECASE)


def with_key(key: str, name: str, text: str) -> float:
    """A number with its unit; a wrong one is named by its whole key.

    Parameters
    ----------
    key : str
        ``SECTION.NAME``.
    name : str
        Last part of the key, with its unit as suffix.
    text : str
        As it was typed.

    Raises
    ------
    UsageError
        For text that is no such number.
    """
    try:
        return parse_quantity(text, name)
    except UsageError as error:
        raise UsageError(f"{key.removesuffix(name)}{error}") from error


class Back(Exception):
    """The question before is asked again."""


class Done(Exception):
    """Of the questions that are left only those are asked that commissioning needs an answer to."""


def ask_number(
    key: str, name: str, entry: AxisEntry, default: float | None, contradicts: Callable[[float | None], str], where: str, kind: str
) -> tuple[float | None, str]:
    """A number, and how it was written; what it means is said, and an unusual one asked for again.

    Parameters
    ----------
    key : str
        ``SECTION.NAME``.
    name : str
        Last part of the key, with its unit as suffix.
    entry : AxisEntry
        Meaning and bounds.
    default : float or None, SI
        For an empty answer; None for none.
    contradicts : callable
        In words.
    where : str
        Number of the question.
    kind : str
        Of the axis; "" for a belt.
    """
    from beltcomm.axis.kinds import KINDS
    from beltcomm.axis.terms import terms

    own, terms_ = KINDS.get(kind), terms(kind)
    needs = COMMISSION_NEEDS if own is None else own.needs
    said = entry.meaning if own is not None and key in own.renamed else terms_.said(entry.meaning)
    unit, needed, meaning = unit_of(name), needs.get(key, ""), tr(said)
    shown = ", ".join(filter(None, [unit or tr("number"), tr(_OTHERWISE.get(name, ""))]))
    kept, given = "" if default is None else f"{default:.10g}", ""
    known = "" if default is None else in_words(name, default)
    while True:
        text = given or reply(f"{where}{meaning[0].upper()}{meaning[1:]} [{shown}]", kept, known, back=True)
        given = ""
        if not text and needed:
            tell(f"    {key} is needed for {needed}; without it commissioning refuses to begin. Enter once more: not known yet")
            needed = ""
            continue
        if not text or text.lower() in NONE:
            if wrong := contradicts(None):
                tell(f"    {wrong}; give another value, or 'back' to change what was answered before")
                continue
            return None, ""
        try:
            value = otherwise(name, text)
            value = with_key(key, name, text) if value is None else value
        except UsageError as error:
            tell(f"    {error}")
            continue
        if wrong := entry.fault(value):
            tell(f"    {key} is {value:g}{unit and f' {unit}'}; {wrong}")
        elif wrong := contradicts(value):
            tell(f"    {wrong}; give another value, or 'back' to change what was answered before")
        elif text == kept:
            return default, text
        elif not usual(key, value, kind) and (other := _really(key, name, value, kind)) is not None:
            given = other
        else:
            tell(f"    = {in_words(name, value)}")
            return value, text


def _really(key: str, name: str, value: float, kind: str) -> str | None:
    """Of an unusual value: None to keep it, else another answer to the same question, "" to be asked it again."""
    usual_are = f"{tr('usual are')} {usual_words(key, kind)}"
    asked = f"    = {in_words(name, value)}: {tr('really?')} {usual_are}; {tr('Enter keeps it, or give another')}"
    answer = reply(asked, "")
    return None if answer.lower() in ("", *YES) else "" if answer.lower() in (*_BACK, *NO) else answer


def ask_word(question: str, known: Sequence[str], default: str) -> str:
    """One of some words, or nothing.

    Parameters
    ----------
    question : str
        A sentence.
    known : sequence of str
        Words that count.
    default : str
        For an empty answer.
    """
    while True:
        answer = reply(question, default, back=True).lower()
        answer = next((word for word in known if tr(word).lower() == answer), answer)
        if answer in {"", *known}:
            return answer
        tell(f"    {answer!r}: {', '.join(map(tr, known))}")


def toothed(text: str) -> dict[tuple[str, str], float]:
    """Teeth and pitch, m, that ``22 x 8 mm`` states beside the radius; nothing for a radius that was written otherwise.

    Parameters
    ----------
    text : str
        As it was typed.
    """
    found = _TEETH.fullmatch(text)
    if not found:
        return {}
    return {("pulley", "teeth"): int(found[1]), ("belt", "pitch_m"): parse_quantity(found[2], "pitch_m")}


def otherwise(name: str, text: str) -> float | None:
    """A number written as data sheets have it, None for any other text.   2^n of n bits;  r = z p/2π of z teeth;  r = s/2π of the way s.

    Parameters
    ----------
    name : str
        Of the entry, with its unit as suffix.
    text : str
        As it was typed.
    """
    bits = re.fullmatch(r"(\d+)\s*-?\s*bits?", text, re.IGNORECASE)
    if name in ("encoder_counts_per_rev", "counts_per_pole_pair") and bits:
        return float(2 ** int(bits[1]))
    if name not in ("effective_radius_m", "pinion_radius_m", *_TRAVEL_PER_TURN):
        return None
    if name == "pinion_radius_m" and (teeth := _MODULE.fullmatch(text)):
        return 0.5 * int(teeth[1]) * parse_quantity(teeth[2], "pitch_m")
    if name == "effective_radius_m" and (teeth := _TEETH.fullmatch(text)):
        return int(teeth[1]) * parse_quantity(teeth[2], "pitch_m") / math.tau
    turn = re.fullmatch(r"(.+?)\s*(?:/|per)\s*(?:rev|turn|revolution|u)", text, re.IGNORECASE)
    per_turn = 1.0 if name in _TRAVEL_PER_TURN else math.tau
    return parse_quantity(turn[1], "travel_m") / per_turn if turn else None


def tell(line: str) -> None:
    """One or more lines beside the answers, broken between words.

    Parameters
    ----------
    line : str
        With or without line breaks.
    """
    for part in line.split("\n"):
        words = part.lstrip()
        click.echo(fitted(part[: len(part) - len(words)] + told(words), sys.stderr), err=True)


def reply(question: str, default: str, shown: str = "", *, back: bool = False) -> str:
    """One line from stdin; the default for an empty one.

    Parameters
    ----------
    question : str
        A sentence.
    default : str
        For an empty answer.
    shown : str
        The default as people write it.
    back : bool
        True if Back and Done are answers.

    Raises
    ------
    UsageError
        When stdin is closed, Back and Done for those words.
    """
    kept = f" ({tr('Enter keeps')} {shown or default})" if default else ""
    click.echo(fitted(f"{question}{kept}:", sys.stderr) + " ", nl=False, err=True)
    line = sys.stdin.readline() if sys.stdin is not None else ""
    if not line:
        click.echo("", err=True)
        raise UsageError("nobody answers (stdin is closed); give the values with --set KEY=VALUE, or --yes for none")
    if back and line.strip().lower() in _BACK:
        raise Back
    if back and line.strip().lower() in _DONE:
        raise Done
    return line.strip() or default
