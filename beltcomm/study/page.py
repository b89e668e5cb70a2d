"""The page of a study: verdict, shares, distributions, what drives them, the worst members."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from beltcomm.configfiles import is_number
from beltcomm.report.page import Fact, Page, PageTable, Paragraphs, Picture, Section, State, picture_of, render
from beltcomm.report.study import Against, Distributed, distribution_figure, drivers_figure
from beltcomm.report.style import Caption
from beltcomm.study import words as words
from beltcomm.study.file import Study
from beltcomm.study.summary import DISTANCE, HEADLINE, Driver, Share, Summary

#: Results that are drawn, in this order.
DRAWN = (
    "dynamic_m", "static_m", "dynamic_cart_m", "phase_margin_deg", "position_phase_margin_deg", "gain_margin_db", "misfit", "ratio",
)  # fmt: skip
_MISSES, _LEFT_OUT = "A member without a result counts as one that misses its targets.", "Members without a result are left out."
_DRIVER_WORDS = "Spearman. Drawn parameters that go together show what they do together."
#: From this share on a population is called well served.
GOOD = 0.99

Line = Mapping[str, Any]


def study_page(asked: Study, summary: Summary, lines: Sequence[Line], command: str) -> str:
    """Study as one file of HTML.

    Parameters
    ----------
    asked : Study
    summary : Summary
    lines : sequence of Line
        Of all members that have been computed, by number.
    command : str
        Command line, for caption and next steps.
    """
    caption = Caption(command, f"{summary.done} of {summary.planned} members; base: {asked.base}")
    by_number = {int(line["member"]): line for line in lines}
    share = summary.share(HEADLINE)
    state: State = "" if share is None else "good" if share.low >= GOOD else "bad" if share.high < GOOD else "note"
    worst = [(str(k), words.why(by_number[k], asked.targets), words.values_text(asked, by_number[k]["values"])) for k in summary.worst]
    distributions, drivers = _distributions(asked, summary, lines, caption), _drivers(asked, summary, lines, caption)
    nothing = {
        "shares": "No member has an answer of yes or no.",
        "drivers": "Too few members, or nothing was drawn that could drive them.",
        "worst": "None stands out.",
    }
    sections = [
        Section(key, title, parts, "" if parts else nothing[key])
        for key, title, parts in (
            ("shares", "Shares", _shares(summary)),
            ("distributions", "Distributions", distributions),
            ("drivers", "What drives them", drivers),
            ("worst", "Worst members", [PageTable(("member", "what", "values"), worst)] if worst else []),
        )
    ]
    if summary.failed:
        rows = [(str(k), str(by_number[k]["exit_code"]), sentence) for k, sentence in list(summary.failed.items())[:50]]
        title = f"Without a result: {len(summary.failed)}"
        sections.append(Section("failed", title, [PageTable(("member", "exit code", "why"), rows)]))
    steps = [f"{command} --member {summary.worst[0]}: the worst member again, with its values and its plant"] if summary.worst else []
    notes = [f"Made by: {command}", "Numbers of all members: members.jsonl; of this page: summary.json."]
    if summary.done < summary.planned:
        notes.append(f"{summary.planned - summary.done} members are not computed yet; the same command goes on.")
    return render(Page(f"{asked.name}: study", caption.data, words.headline(summary), state, _facts(summary), steps, sections, notes))


def _shares(summary: Summary) -> list[PageTable | Picture | Paragraphs]:
    told = [(words.share_words(one), words.share_text(one)) for one in summary.shares]
    notes = f"Intervals: Clopper and Pearson. {_MISSES if summary.share(HEADLINE) else _LEFT_OUT}"
    tables: list[PageTable | Picture | Paragraphs] = [PageTable(("what", "share and 95 % interval"), told, notes)] if told else []
    if summary.answers:
        rows = [words.answer_row(one) for one in summary.answers]
        tables.append(PageTable(("members", "named, and of how many"), rows, "What a diagnosis named, by what was hidden."))
    return tables


def _facts(summary: Summary) -> list[Fact]:
    facts = []
    for share in summary.shares[:2]:
        facts.append(Fact(words.share_words(share).capitalize(), f"{words.per_cent(share.share)} %", _interval(share)))
    for spread in summary.spreads:
        if spread.key in ("dynamic_m", "phase_margin_deg", "ratio"):
            name, unit, factor = words.title_of(spread.key)
            low, middle, high = (f"{factor * q:.3g}" for q in spread.quantiles)
            facts.append(Fact(name.capitalize(), f"{middle} {unit}".strip(), f"median; 90 % of the axes: {low} to {high} {unit}".strip()))
    return facts


def _interval(share: Share) -> str:
    return f"95 %: {words.per_cent(share.low)} to {words.per_cent(share.high)} %; {share.count} of {share.of}"


def _distributions(asked: Study, summary: Summary, lines: Sequence[Line], caption: Caption) -> list[PageTable | Picture | Paragraphs]:
    if not summary.spreads:
        return [Paragraphs(["No member has a number for a result."])]
    rows = [words.spread_row(one) for one in summary.spreads]
    table = PageTable(("result", "5 %", "median", "95 %", "worst", "member"), rows, "Quantiles over the members that have the result.")
    known = [key for key in DRAWN if any(one.key == key for one in summary.spreads)]
    shown = []
    for key in known:
        name, unit, factor = words.title_of(key)
        bound = asked.targets.get(key)
        values = np.array([value for line in lines if (value := _value(line, key)) is not None])
        shown.append(Distributed(f"{name} in {unit}" if unit else name, factor * values, None if bound is None else factor * bound))
    return [picture_of(distribution_figure(shown, caption)), table] if shown else [table]


def _drivers(asked: Study, summary: Summary, lines: Sequence[Line], caption: Caption) -> list[PageTable | Picture]:
    if not summary.drivers:
        return []
    drawn = [one for one in words.strongest(summary.drivers) if one.key != HEADLINE]
    parts: list[PageTable | Picture] = (
        [picture_of(drivers_figure([_against(one, asked, lines) for one in drawn], caption))] if drawn else []
    )
    rows = [
        (
            one.parameter,
            "meets its targets" if one.key == HEADLINE else words.title_of(one.key)[0],
            f"{one.rank_correlation:+.2f}",
            f"{one.low:+.2f} to {one.high:+.2f}",
        )
        for one in summary.drivers
        if one.excludes_zero
    ]
    rest = f"{_DRIVER_WORDS} Of {len(summary.drivers) - len(rows)} other pairs it cannot be told: their intervals hold zero."
    return [*parts, PageTable(("parameter", "result", "rank correlation", "95 % interval"), rows, rest)]


def _against(one: Driver, asked: Study, lines: Sequence[Line]) -> Against:
    name, unit, factor = words.title_of(one.key)
    parameter = one.parameter.removeprefix(DISTANCE).strip()  # both are seen over the value itself
    known = [(float(line["values"][parameter]), value, line["exit_code"] == 0) for line in lines
             if parameter in line["values"] and (value := _value(line, one.key)) is not None]  # fmt: skip
    bound = asked.targets.get(one.key)
    drawn, values, kept = (np.array(column) for column in zip(*known, strict=True))
    scale, label = _scaled_label(parameter, asked.units.get(parameter, ""), float(np.abs(drawn).max()))
    how = "" if parameter == one.parameter else "distance from nominal: "
    return Against(
        label,
        f"{name} in {unit}" if unit else name,
        scale * drawn,
        factor * values,
        kept.astype(bool),
        None if bound is None else factor * bound,
        f"{how}rank correlation {one.rank_correlation:+.2f} ({one.low:+.2f} to {one.high:+.2f})",
    )


def _value(line: Line, key: str) -> float | None:
    value = line.get("found", {}).get(key)
    return float(value) if is_number(value) else None


def _scaled_label(name: str, unit: str, largest: float) -> tuple[float, str]:
    """Factor to numbers from 1 to 1000, and the label with the unit that they then have."""
    power = 3 * math.floor(math.log10(largest) / 3.0) if largest > 0.0 else 0
    if not power or unit == "1" or not unit:
        return 1.0, f"{name} in {unit}" if unit not in ("", "1") else name
    if (unit, power) == ("kg", -3):
        return 1e3, f"{name} in g"
    short = {-3: "m", -6: "u"}.get(power) if unit in ("s", "m") else {3: "k"}.get(power) if unit in ("N", "N/m") else None
    return 10.0**-power, f"{name} in {short}{unit}" if short else f"{name} in 1e{power} {unit}"
