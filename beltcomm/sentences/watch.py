"""A watch in words: a line for each move, and a sentence for what has changed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from beltcomm.result import Line
from beltcomm.sentences.words import DERIVED, SHOWN, number
from beltcomm.watching.estimates import ERROR, FEWEST, POOL, Standing
from beltcomm.watching.judge import JudgedMove
from beltcomm.watching.places import PLACE, Untold

#: Key -> words, unit shown, factor: as everywhere, and of what no fit by the design source has.
NAMED: Mapping[str, tuple[str, str, float]] = {
    **SHOWN,
    **DERIVED,
    "belt_sections.specific_stiffness": SHOWN["belt_spans.specific_stiffness"],
    "mass": ("moved mass", "kg", 1.0),
    PLACE: ("friction at a place", "mN m", 1e3),
    ERROR: ("error over the noise", "x", 1.0),
}
#: Key -> title of its column, and what it means when it is more or less.
COLUMNS: Mapping[str, tuple[str, str, str]] = {
    "coulomb_total": ("Coulomb", "friction up", "friction down"),
    "viscous_total": ("viscous", "viscous friction up", "viscous friction down"),
    "belt_stiffness.stiffness": ("belt", "belt stiffer", "belt softer"),
    "belt_spans.specific_stiffness": ("belt", "belt stiffer", "belt softer"),
    "belt_sections.specific_stiffness": ("belt", "belt stiffer", "belt softer"),
    "cart.mass": ("load", "load heavier", "load lighter"),
    "mass": ("load", "load heavier", "load lighter"),
    "motor.inertia": ("inertia", "more inertia", "less inertia"),
    PLACE: ("at place", "tight spot", "friction down"),
    ERROR: ("error", "something the model does not know acts on the axis", "less than the noise is left"),
}
#: What has no column of its own: the error has another one, a place is told in a sentence.
APART = (ERROR, PLACE)
_STYLE = {"alarm": "bad", "changed": "note", "steady": "", "few": "soft"}
_MARK = {"alarm": "!", "changed": "*", "steady": " ", "few": " "}


def head_line(standings: Sequence[Standing]) -> Line:
    """Titles of the columns: change since the first moves, %, over the last ones.

    Parameters
    ----------
    standings : sequence of Standing
        One for each quantity.
    """
    cells = "".join(f"{COLUMNS[one.key][0] + ' %':>13}" for one in standings if one.key not in APART)
    return Line((f"{'move':>5} {'time':8} {'mm':>5} {'error':>6}{cells}", "title"))


def move_line(count: int, clock: str, move: JudgedMove, standings: Sequence[Standing]) -> Line:
    """Line on one move; what has changed, in per cent with 95 % intervals, over the last :data:`POOL` moves.

    Parameters
    ----------
    count : int
        Number of the move.
    clock : str
        Time of day.
    move : JudgedMove
        As it was judged.
    standings : sequence of Standing
        One for each quantity.
    """
    parts: list[str | tuple[str, str]] = [f"{count:5d} {clock:8} {1e3 * move.travel_m:5.0f} "]
    error = next(one for one in standings if one.key == ERROR)
    parts.append((f"{move.ratio:5.2f}{_MARK[error.state]}", _STYLE[error.state]))
    for one in standings:
        if one.key not in APART:
            parts.append((f"{_change(one):>12}{_MARK[one.state]}", _STYLE[one.state]))
    return Line(*parts)


def _change(one: Standing) -> str:
    if not math.isfinite(one.value):
        return "."
    half = 100.0 * one.change_interval
    digits = 0 if half >= 10.0 else 1
    return f"{100.0 * one.change:+.{digits}f} ± {half:.{digits}f}"


def event_sentence(one: Standing) -> str:
    """Change of a quantity, from what to what, and the limit.

    Parameters
    ----------
    one : Standing
        That has changed or come back.
    """
    (words, unit, factor), (_, more, less) = NAMED[one.key], COLUMNS[one.key]
    place = "" if one.place_m is None else f" at {1e3 * one.place_m:.0f} mm"
    if one.state == "steady":
        return f"{words} is back{place}: {number(factor * one.value, factor * one.interval, unit)}"
    against, when = one.against, "by the first moves" if one.base is not None else "in the run"
    what = (more if one.value > against.value else less) + place
    was = number(factor * against.value, factor * against.interval, unit)
    text = f"{what}: {words} {number(factor * one.value, factor * one.interval, unit)}, {was} {when}"
    bound = one.high if one.value > against.value else one.low
    if bound is None:
        return text
    if one.state == "alarm":
        return f"{text}; beyond its limit of {factor * bound:.4g} {unit} ({one.why})"
    return f"{text}; limit {factor * bound:.4g} {unit}"


def summary_lines(
    moves: int, left_out: int, why: str, seconds: float, standings: Sequence[Standing], alarms: Sequence[str], changed: Sequence[str]
) -> list[str]:
    """Findings of the whole watch.

    Parameters
    ----------
    moves : int
        That were judged.
    left_out : int
        That were not.
    why : str
        Reason for the last of these.
    seconds : float, s
        Of the whole watch.
    standings : sequence of Standing
        One for each quantity, at the end.
    alarms : sequence of str
        Quantities beyond their limits.
    changed : sequence of str
        Quantities that changed within them.
    """
    if not moves:
        return ["No move was found" + (f" that tells anything; {left_out} were left out: {why}" if left_out else "") + "."]
    span = f"{seconds / 3600.0:.1f} h" if seconds > 5400.0 else f"{seconds:.0f} s"
    beside = f", {left_out} more told nothing" if left_out else ""
    if alarms:
        verdict = f"ALARM in {moves} moves ({span}{beside}): {', '.join(alarms)}."
    elif changed:
        verdict = f"{moves} moves ({span}{beside}): changed, within the limits: {', '.join(changed)}."
    elif moves < FEWEST:
        verdict = f"{moves} moves ({span}{beside}): too few to tell a change, {FEWEST} are needed."
    else:
        verdict = f"{moves} moves ({span}{beside}): nothing has changed that these moves show."
    rows = []
    for one in standings:
        if math.isfinite(one.value):
            words, unit, factor = NAMED[one.key]
            half = factor * one.interval if math.isfinite(one.interval) else None
            was = number(factor * one.reference.value, None, unit)
            noticed = f"; a change is noticed from {100.0 * one.noticed_from:.2g} %" if math.isfinite(one.noticed_from) else ""
            rows.append(f"  {words:36} {number(factor * one.value, half, unit)}, in the run {was}{noticed}")
    return [verdict, *rows, f"  (over the last {min(POOL, moves)} moves)"] if rows else [verdict]


def untold_sentence(untold: Untold) -> str:
    """Sentence on quantities and stretches that the moves do not show, and what would; empty where they show all.

    Parameters
    ----------
    untold : Untold
        By the moves.
    """
    parts = [f"a change of the {NAMED[key][0]}" for key in untold.keys]
    if untold.stretches_m:
        ways = ", ".join(f"{1e3 * low:.0f} mm to {1e3 * high:.0f} mm" for low, high in untold.stretches_m)
        parts.append(f"a tight spot at {ways}")
    if not parts:
        return ""
    return f"These moves cannot show {', nor '.join(parts)}; long and quick ones over the whole way, now and then, do."
