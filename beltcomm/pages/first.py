"""The first screen: verdict, three numbers, what to do next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from beltcomm.fit.noise_level import error_floor_words
from beltcomm.given import pasted
from beltcomm.pages.gather import Gathered
from beltcomm.report.page import Fact, State
from beltcomm.sentences.ladder import error_words

#: Error over noise up to which a model explains a run.
EXPLAINED = 1.1


def verdict(run: Gathered) -> tuple[str, State]:
    """One sentence on the axis, and what it means."""
    moves = run.verifications
    if not moves:
        return "Not proven yet: no move has been driven with a design of this run.", "note"
    last = list(moves.values())[-1]
    if last["passed"] and not last.get("reservations"):
        return "The axis meets its targets.", "good"
    if last["passed"]:
        return f"The move that was driven met its targets, but the axis does not: {'; '.join(last['reservations'])}.", "bad"
    return "The axis misses its targets.", "bad"


def facts(run: Gathered) -> list[Fact]:
    """Tracking error, model error, margin; each says what is missing where it is not known."""
    return [_tracking(run), _model(run), _margin(run)]


def _tracking(run: Gathered) -> Fact:
    moves = run.verifications
    if not moves:
        return Fact("Tracking error", "not measured", "beltcomm verify drives a move and measures it", "note")
    last: Mapping[str, Any] = list(moves.values())[-1]
    measured, predicted = last["measured"], last["predicted"]
    words = f"largest while moving; predicted {1e6 * predicted['dynamic_m']:.0f} µm; at rest {1e6 * measured['static_m']:.0f} µm"
    return Fact("Tracking error, motor", f"{1e6 * measured['dynamic_m']:.0f} µm", words, "good" if last["passed"] else "bad")


def _model(run: Gathered) -> Fact:
    found = run.comparison
    if found is None:
        return Fact("Model error", "not compared", run.remarks[0] if run.remarks else "beltcomm compare says why", "note")
    ratio = found.ratio if found.held_out is None else max(found.ratio, found.held_out)
    words = f"{error_words((found.ratio, found.held_out), (found.plain, found.plain_held_out))}; "
    doubt = error_floor_words(found.ratio)
    good = ratio <= EXPLAINED and not doubt
    return Fact("Model error", f"{ratio:.2f} × noise", words + (doubt or "1.00: nothing is missing"), "good" if good else "bad")


def _margin(run: Gathered) -> Fact:
    margins = run.design.get("margins") or []
    if not margins:
        return Fact("Phase margin", "no design", "beltcomm design makes one of the model", "note")
    least = min(m["phase_margin_deg"] for m in margins)
    asked = run.design["specification"]["phase_margin_deg"]
    words = f"velocity loop, smallest of {len(margins)} variants of the model; {asked:.0f}° were asked for"
    return Fact("Phase margin", f"{least:.0f}°", words, "good" if least >= asked - 0.5 else "note")


def next_steps(run: Gathered, called: str = "") -> list[str]:
    """Commands in the order in which they help.   called : the run's folder as a terminal takes it; on a page, :attr:`Gathered.place`."""
    name, virtual = called or run.place, run.folder.drive.get("hardware") == "virtual"
    if not run.folder.axis.has_belt:  # the controller is designed for a carriage on a belt
        return [f"beltcomm diagnose {pasted(name)}: what the model misses"]
    if run.model is None:
        return [f"beltcomm fit {pasted(name)}: a model of the records"]
    steps = []
    found = run.comparison
    if found is not None and max(found.ratio, found.held_out or 0.0) > EXPLAINED:
        steps.append(f"beltcomm diagnose {pasted(name)}: the model misses something; this says what, and what to check on the machine")
    if not run.design:
        steps.append(f"beltcomm design {pasted(name)}: gains with margins")
    elif not run.verifications:
        steps.append(f"beltcomm verify --drive DRIVE --run {pasted(name)}: a move that proves the gains")
    elif virtual:
        steps.append(f"beltcomm tune {pasted(name)}: the knobs of the design as sliders; a virtual drive keeps no gains")
    elif list(run.verifications.values())[-1]["passed"]:
        steps.append(f"beltcomm apply --drive DRIVE --run {pasted(name)}: the gains into the drive (--save keeps them beyond power-off)")
    return steps
