"""The results of a study in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from beltcomm.effects import effect_named
from beltcomm.given import pasted
from beltcomm.study.file import Study
from beltcomm.study.population import NOTHING
from beltcomm.study.summary import MORE_IS_BETTER, Answers, Driver, QuantitySpread, Share, Summary

#: Words, unit and factor from SI of what a member has as a result.
TITLES: Mapping[str, tuple[str, str, float]] = {
    "dynamic_m": ("following error at the motor", "mm", 1e3),
    "static_m": ("settled error at the motor", "mm", 1e3),
    "dynamic_cart_m": ("following error at the carriage", "mm", 1e3),
    "static_cart_m": ("settled error at the carriage", "mm", 1e3),
    "predicted_dynamic_m": ("predicted following error", "mm", 1e3),
    "torque_nm": ("motor torque", "N m", 1.0),
    "belt_force_n": ("belt force", "N", 1.0),
    "phase_margin_deg": ("phase margin, velocity loop", "deg", 1.0),
    "position_phase_margin_deg": ("phase margin, position loop", "deg", 1.0),
    "gain_margin_db": ("gain margin", "dB", 1.0),
    "sensitivity_db": ("sensitivity", "dB", 1.0),
    "misfit": ("misfit of the model, 1 is the noise", "", 1.0),
    "ratio": ("error of the model over noise", "", 1.0),
    "held_out": ("the same on held-out records", "", 1.0),
}
#: Shares in words; "covers X" is said of a parameter.
SHARES = {
    "passed": "meet their targets",
    "stable": "are stable",
    "trusted": "have a model that explains the data",
    "healthy left alone": "of the healthy ones nothing is named",
    "hidden effect named": "of those with a hidden effect it is named",
    "hidden effect named, nothing else": "of those with a hidden effect it alone is named",
}
#: Correlations told of each result.
DRIVERS = 2


def title_of(key: str) -> tuple[str, str, float]:
    """Words of a result, its unit and the factor to it from SI.

    Parameters
    ----------
    key : str
        Of the result.
    """
    if key.startswith("off "):
        return f"{key.removeprefix('off ')} is off by, SI", "", 1.0
    return TITLES.get(key, (key, "", 1.0))


def share_words(share: Share) -> str:
    """Words for a share, such as "meet their targets" or "the interval of cart.mass covers the truth".

    Parameters
    ----------
    share : Share
        Of the members.
    """
    if share.key.startswith("covers "):
        return f"intervals of {share.key.removeprefix('covers ')} cover the truth"
    return SHARES.get(share.key, share.key)


def share_text(share: Share) -> str:
    """A share in per cent with its interval and counts.

    Parameters
    ----------
    share : Share
        Of the members.
    """
    return f"{per_cent(share.share)} % (95 %: {per_cent(share.low)} to {per_cent(share.high)} %; {share.count} of {share.of})"


def per_cent(share: float) -> str:
    """A share in per cent, with as many digits as matter near 0 and 100 %.

    Parameters
    ----------
    share : float
        0 to 1.
    """
    return f"{100.0 * share:.4g}" if share > 0.99 else f"{100.0 * share:.3g}"


def headline(summary: Summary) -> str:
    """First sentence on a study.

    Parameters
    ----------
    summary : Summary
    """
    share = summary.share("passed")
    named, left = summary.share("hidden effect named"), summary.share("healthy left alone")
    if share is not None:
        first = f"{share_text(share)} of the axes meet their targets"
        stable = summary.share("stable")
        return f"{first}; {stable.of - stable.count} loops are unstable." if stable and stable.count < stable.of else f"{first}."
    if named is not None or left is not None:
        parts = [f"{share_words(one)}: {share_text(one)}" for one in (named, left) if one is not None]
        parts += [f"{_without(summary)} no result"] if summary.failed else []
        return "Diagnosis against the truth: " + "; ".join(parts) + "."
    return f"{summary.done} members, {len(summary.failed)} without a result."


def answer_row(one: Answers) -> tuple[str, str]:
    """Hidden effect with its number of members, and the effects named of them.

    Parameters
    ----------
    one : Answers
        Of the diagnoses of one hidden effect.
    """
    hidden = {"": "all", NOTHING: "healthy"}.get(one.hidden, f"hidden {one.hidden}")
    return f"{hidden}, {one.of} member{'s' if one.of > 1 else ''}", ", ".join(f"{named} {count}" for named, count in one.named.items())


def spread_row(one: QuantitySpread) -> tuple[str, str, str, str, str, str]:
    """Words, three quantiles, the worst, its member; each number with its unit.

    Parameters
    ----------
    one : QuantitySpread
        Of one result.
    """
    name, unit, factor = title_of(one.key)
    low, middle, high, worst = (f"{factor * value:.3g} {unit}".rstrip() for value in (*one.quantiles, one.worst))
    return name, low, middle, high, worst, str(one.member)


def strongest(drivers: Sequence[Driver]) -> list[Driver]:
    """The strongest of each result among those that chance does not explain.

    Parameters
    ----------
    drivers : sequence of Driver
        Rank correlations of results and parameters.
    """
    told = [one for one in drivers if one.excludes_zero]
    return [one for key in dict.fromkeys(one.key for one in told) for one in [same for same in told if same.key == key][:DRIVERS]]


def _driver_text(one: Driver) -> str:
    """Direction in which a parameter moves a result."""
    result = "meeting the targets" if one.key == "passed" else title_of(one.key)[0]
    way = "with" if one.rank_correlation > 0.0 else "against"
    numbers = f"{one.rank_correlation:+.2f} (95 %: {one.low:+.2f} to {one.high:+.2f})"
    return f"{result} goes {way} {one.parameter}: rank correlation {numbers}"


def why(line: Mapping[str, Any], targets: Mapping[str, float]) -> str:
    """Fault of a member; of an error the first sentence.

    Parameters
    ----------
    line : mapping of str to Any
        Of the member.
    targets : mapping of str to float, SI
        By result.
    """
    if "error" in line:
        return f"no result: {str(line['error']).split('. ')[0]}"
    found = line["found"]
    parts = [] if found.get("stable", True) else ["unstable loop"]
    for key in targets:
        if isinstance(found.get(key), (int, float)):
            name, unit, factor = title_of(key)
            parts.append(f"{name} {factor * found[key]:.3g} {unit}")
    parts += [f"{key} {_value_words(found[key])}" for key in ("verdict", "named") if key in found]
    return ", ".join(parts)


def values_text(asked: Study, values: Mapping[str, Any]) -> str:
    """Values of a member, short.

    Parameters
    ----------
    asked : Study
    values : mapping of str to Any
        Drawn for the member.
    """
    return ", ".join(f"{name} {_value_words(value, 4)} {_unit(asked, name)}".rstrip() for name, value in values.items())


def summary_lines(asked: Study, summary: Summary, lines: Sequence[Mapping[str, Any]], file: str) -> list[str]:
    """Findings of a whole study in words.

    Parameters
    ----------
    asked : Study
    summary : Summary
    lines : sequence of mapping of str to Any
        Of all members.
    file : str
        Of the study.
    """
    by_number = {int(line["member"]): line for line in lines}
    text = [headline(summary), f"  {summary.done} of {summary.planned} members of {asked.name}; base: {asked.base}"]
    text += [f"  {share_words(one)}: {share_text(one)}" for one in summary.shares]
    if summary.answers:
        text.append("What was named, and of how many:")
        text += [f"  {hidden}: {named}" for hidden, named in map(answer_row, summary.answers)]
    if summary.failed:
        number, sentence = next(iter(summary.failed.items()))
        text.append(f"  {_without(summary)} no result, such as member {number}: {sentence}")
    if summary.spreads:
        text.append("Quantiles 5, 50, 95 %, and the worst:")
        for one in summary.spreads:
            name, *quantiles, worst, member = spread_row(one)
            unit, edge = title_of(one.key)[1], "smallest" if one.key in MORE_IS_BETTER else "largest"
            found = ", ".join(value.removesuffix(f" {unit}") for value in quantiles)
            text.append(f"  {name}: {f'{found} {unit}'.rstrip()}; {edge} {worst} (member {member})")
    told = strongest(summary.drivers)
    if told:
        text.append("What drives it:")
        text += [f"  {_driver_text(one)}" for one in told]
    elif summary.drivers:
        text.append("What drives it: cannot tell, every interval of a rank correlation holds zero")
    if summary.worst:
        text.append("Worst members:")
        text += [f"  {k}: {why(by_number[k], asked.targets)}; {values_text(asked, by_number[k]['values'])}" for k in summary.worst]
        text.append(f"Look at one: beltcomm study {pasted(file)} --member {summary.worst[0]}")
    return text


def member_lines(line: Mapping[str, Any], asked: Study) -> list[str]:
    """One member of a study in words.

    Parameters
    ----------
    line : mapping of str to Any
        Of the member.
    asked : Study
    """
    text = [
        f"Member {line['member']} of {asked.name}:",
        *(f"  {name}: {_value_words(value)} {_unit(asked, name)}".rstrip() for name, value in line["values"].items()),
    ]
    if "error" in line:
        return [*text, f"It has no result (exit code {line['exit_code']}): {line['error']}"]
    text.append("Result:")
    for key, value in line["found"].items():
        name, unit, factor = title_of(key)
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        text.append(f"  {name}: {factor * value:.4g} {unit}".rstrip() if number else f"  {name}: {_value_words(value)}")
    return text


def _without(summary: Summary) -> str:
    return f"{len(summary.failed)} {'member has' if len(summary.failed) == 1 else 'members have'}"


def _unit(asked: Study, name: str) -> str:
    """Of a value, where it has one."""
    effect, _, own = name.partition(".")
    hidden = asked.population is not None and effect in asked.population.hidden
    parameters = effect_named(effect).parameters if hidden else ()
    unit = asked.units.get(name) or next((one.unit for one in parameters if one.name == own), "")
    return "" if unit == "1" else unit.replace("m2", "m²")


def _value_words(value: Any, digits: int = 6) -> str:
    if isinstance(value, float):
        return f"{value:.{digits}g}" if math.isfinite(value) else str(value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return ", ".join(map(str, value)) or "none" if isinstance(value, list) else str(value)
