"""Two runs of one axis: what changed of it, by name, with intervals; a change within its interval is none that these data show."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from beltcomm.errors import BeltcommError
from beltcomm.identify.friction import FrictionFit
from beltcomm.pages import tracking
from beltcomm.pages.gather import Gathered
from beltcomm.pages.quantities import Quantity, quantities_of
from beltcomm.report import friction, responses
from beltcomm.report.page import PageTable, Paragraphs, Picture, Section, picture_of
from beltcomm.report.proof import tracking_figure
from beltcomm.report.style import Caption
from beltcomm.report.trend import Bar, changes_figure
from beltcomm.rundata.friction_study import study_of
from beltcomm.rundata.revisions import current_revision
from beltcomm.sentences.response_table import ResponseRow, table_of


@dataclass(frozen=True)
class QuantityChange:
    """One quantity before and now.

    Attributes
    ----------
    share : float
        Now over before, less 1.
    interval : float or None
        Of the share, 95 %; None where it is not known.
    state : str
        "changed", "usual" (beyond the interval, but no more than it changes by itself), "none" (within the interval), "unsure".
    """

    before: Quantity
    now: Quantity
    share: float
    interval: float | None
    state: str

    def words(self) -> str:
        """In words."""
        size = f"{100.0 * abs(self.share):.{_digits(self.interval)}f}"
        named = f"{self.now.more if self.share > 0.0 else self.now.less} by {size} %"
        if self.interval is not None:
            named = f"{named[:-2]} ± {100.0 * self.interval:.{_digits(self.interval)}f} %"
        if self.state == "none":
            return f"{self.now.words}: no change that these data show ({100.0 * self.share:+.2g} ± {100.0 * (self.interval or 0.0):.2g} %)"
        if self.state == "usual":
            return f"{named}: no more than by {self.now.why} ({100.0 * self.now.usual:.2g} %)"
        if self.state == "unsure":
            return f"{named}; its interval is not known, so cannot tell from chance ({self.now.why})"
        return named


def _changes_of(before: Mapping[str, Quantity], now: Mapping[str, Quantity]) -> list[QuantityChange]:
    """All that both runs know.   The interval of b/a: relative intervals add as squares."""
    found = []
    for key, new in now.items():
        old = before.get(key)
        if old is None or old.value <= 0.0 or new.value <= 0.0:
            continue
        share, interval = new.value / old.value - 1.0, None
        if old.interval is not None and new.interval is not None:
            interval = new.value / old.value * math.hypot(old.interval / old.value, new.interval / new.value)
        found.append(QuantityChange(old, new, share, interval, _state(share, interval, new.usual)))
    return found


def _state(share: float, interval: float | None, usual: float) -> str:
    if interval is not None and abs(share) <= interval:
        return "none"
    if abs(share) <= usual:
        return "usual"
    return "unsure" if interval is None else "changed"


def _digits(interval: float | None) -> int:
    """Digits behind the point of a share in per cent."""
    if interval is None or interval <= 0.0:
        return 0
    return min(max(0, 1 - math.floor(math.log10(100.0 * interval))), 2)


def named(changes: Sequence[QuantityChange], before: Gathered, now: Gathered) -> list[str]:
    """Changes in words, the largest first, for the first screen.

    Parameters
    ----------
    changes : sequence of QuantityChange
        Of the quantities of both runs.
    before, now : Gathered
    """
    told = [c for c in changes if c.state in ("changed", "unsure")]
    clear = sorted(told, key=lambda c: (c.state == "unsure", -abs(c.share) / c.now.usual))
    lines, effects = [change.words() for change in clear], _effects(before, now)
    if not lines:
        same = "beyond what an axis changes by itself"
        lines = [f"No number changed {same}, but the models differ." if effects else f"Nothing changed that these two runs show {same}."]
    return [*lines, *effects, *_doubts(before, now)]


def _effects(before: Gathered, now: Gathered) -> list[str]:
    """Effects that only one of the two models has."""
    if before.model is None or now.model is None:
        return ["One of the two runs has no model: its parameters cannot be compared."]
    old, new = set(before.model.effects), set(now.model.effects)
    lines = [f"{name} is in the model of {now.name} only" for name in now.model.effects if name not in old]
    return lines + [f"{name} is in the model of {before.name} only" for name in before.model.effects if name not in new]


def _doubts(before: Gathered, now: Gathered) -> list[str]:
    """Differences between the runs other than time."""
    lines = [f"axis.yaml differs: {change}" for change in before.folder.axis.changes(now.folder.axis)[:3]]
    serials = [run.folder.drive.get("serial_number", "") for run in (before, now)]
    if all(serials) and serials[0] != serials[1]:
        lines.append(
            f"another drive: serial number {serials[0]} before, {serials[1]} now; the scale of its torque may differ by some per cent"
        )
    for run in (before, now):
        if (run.results.get("fit") or {}).get("suspect") and current_revision(run.folder) is None:
            lines.append(f"the model of {run.name} does not explain its records: its intervals are too narrow")
    return lines


def section(before: Gathered, now: Gathered, changes: Sequence[QuantityChange]) -> Section:
    """Table of all quantities, changes with intervals, and responses, friction and tracking of both runs on one scale.

    Parameters
    ----------
    before, now : Gathered
    changes : sequence of QuantityChange
        Of their quantities.
    """
    caption = Caption(now.command, f"{before.name} and {now.name}: models, results, recordings")
    rows = [
        (
            c.now.words,
            c.before.shown(),
            c.now.shown(),
            f"{100.0 * c.share:+.{_digits(c.interval)}f}"
            + ("" if c.interval is None else f" ± {100.0 * c.interval:.{_digits(c.interval)}f}"),
            {"changed": "changed", "usual": "small", "none": "no change", "unsure": "cannot tell"}[c.state],
        )
        for c in changes
    ]
    words = (
        "Small: beyond the interval, but no more than the axis changes by itself, with temperature, standstill or the place of a cable. "
        "Intervals are those of each run's fit; how far two runs of an unchanged axis scatter, beltcomm trend shows from three runs on."
    )
    bars = [
        Bar(c.now.words, 100.0 * c.share, None if c.interval is None else 100.0 * c.interval, 100.0 * c.now.usual, c.state) for c in changes
    ]
    parts: list[Paragraphs | PageTable | Picture] = [
        Paragraphs(named(changes, before, now), listed=True),
        PageTable(("quantity", before.name, now.name, "change in %", ""), rows, words),
    ]
    if bars:
        parts.append(picture_of(changes_figure(bars, before.name, now.name, caption)))
    parts += _overlays(before, now, caption)
    return Section("changes", f"What changed since {before.name}", parts)


def _overlays(before: Gathered, now: Gathered, caption: Caption) -> list[Picture]:
    made = []
    rows = [(run, row) for run in (before, now) if (row := _loudest(run)) is not None]
    if len(rows) == 2:
        shown = [(f"{run.name}: {row.condition.record}, {row.condition.words()}", row.response, row.landmarks) for run, row in rows]
        made.append(picture_of(responses.responses_figure(shown, [], caption)))
    curves = [(run.name, fit) for run in (before, now) if (fit := _friction(run)) is not None]
    if len(curves) == 2:
        made.append(picture_of(friction.compared_figure(curves, caption)))
    moves = [replace(move, name=f"{run.name}: {move.name}") for run in (before, now) if (move := tracking.last(run)) is not None]
    if len(moves) == 2:
        made.append(picture_of(tracking_figure(moves, caption)))
    return made


def _loudest(run: Gathered) -> ResponseRow | None:
    if run.model is None:
        return None
    rows = table_of(run.acting, run.model).rows
    return max(rows, key=lambda row: (round(row.condition.amplitude_nm, 3), row.response.n_periods), default=None)


def _friction(run: Gathered) -> FrictionFit | None:
    try:
        return study_of(run.recordings, run.folder.axis, run.model, {}).friction
    except BeltcommError:
        return None


def compared(before: Gathered, now: Gathered) -> list[QuantityChange]:
    """Changes of the quantities of two runs.

    Parameters
    ----------
    before, now : Gathered
    """
    return _changes_of(*(quantities_of(run.model, run.results, run.folder.terms) for run in (before, now)))
