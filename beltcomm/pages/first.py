"""The first screen: verdict, three numbers, what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beltcomm.fit.noise_level import error_floor_words
from beltcomm.pages.gather import Gathered
from beltcomm.report.page import Fact, State
from beltcomm.rundata.headline import EXPLAINED, MEANINGS, following, headline_of
from beltcomm.sentences.ladder import error_words


def verdict(run: Gathered) -> tuple[str, State]:
    """The headline, and what it means."""
    found = headline_of(run.folder)
    return found.text, MEANINGS[found.state]


def facts(run: Gathered) -> list[Fact]:
    """Tracking error, model error, margin; each says what is missing where it is not known."""
    return [_tracking(run), _model(run), _margin(run)]


def _tracking(run: Gathered) -> Fact:
    moves = run.verifications
    if not moves:
        return Fact("Following error", "not measured", "beltcomm verify drives a move and measures it", "note")
    last: Mapping[str, Any] = list(moves.values())[-1]
    measured, predicted = last["measured"], last["predicted"]
    words = f"largest while moving; predicted {1e6 * predicted['dynamic_m']:.0f} µm; at rest {1e6 * measured['static_m']:.0f} µm"
    return Fact("Following error, motor", f"{1e6 * measured['dynamic_m']:.0f} µm", words, "good" if last["passed"] else "bad")


def _model(run: Gathered) -> Fact:
    found = run.comparison
    if found is None:
        return Fact("Model error", "not compared", run.remarks[0] if run.remarks else "beltcomm compare says why", "note")
    worst = max(found.ratio, found.held_out or 0.0)
    words = f"{error_words((found.ratio, found.held_out), (found.plain, found.plain_held_out))}; "
    doubt = error_floor_words(found.ratio)
    good = worst <= EXPLAINED and not doubt
    return Fact("Model error", f"{found.ratio:.2f} × noise", words + (doubt or "1.00: nothing is missing"), "good" if good else "bad")


def _margin(run: Gathered) -> Fact:
    margins = run.design.get("margins") or []
    if not margins:
        return Fact("Phase margin", "no design", "beltcomm design makes one of the model", "note")
    least = min(m["phase_margin_deg"] for m in margins)
    asked = run.design["specification"]["phase_margin_deg"]
    words = f"velocity loop, smallest of {len(margins)} variants of the model; {asked:.0f}° were asked for"
    return Fact("Phase margin", f"{least:.0f}°", words, "good" if least >= asked - 0.5 else "note")


def next_steps(run: Gathered, called: str = "") -> list[str]:
    """The command that helps most.

    Parameters
    ----------
    called : str
        The run's folder as a terminal takes it; on a page, :attr:`Gathered.place`.
    """
    found = following(run.folder, headline_of(run.folder), called=called or run.place)
    return [f"{found.command}: {found.why}"]
