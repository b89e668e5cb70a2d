"""Next records: the experiments that show what these data could not, or that tell twins apart; a file that a drive can run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from beltcomm.configfiles import read_yaml, unsealed
from beltcomm.effects import EFFECTS, DiscriminatingExperiment, Effect, effect_named
from beltcomm.errors import UsageError
from beltcomm.given import pasted
from beltcomm.laboratory.visible import DetectionLimit
from beltcomm.result import plain
from beltcomm.schedule.steps import PLACES, QUIET, SHORT_S, SLOW_M_S, TRIANGLES_M, Step, checked_step, step_schema

#: Name of the file in ``results/``.
NAME = "next"
#: What shows the effects of a slot, where its name below says nothing else.
BY_SLOT: Mapping[str, tuple[str, ...]] = {
    "element": ("places", "quiet"),
    "body": ("places",),
    "belt_law": ("places", "quiet", "fast"),
    "torque_delay": ("places",),
    "torque_path": ("places", "fast"),
    "friction_level": ("slow", "sweep"),
    "friction_onset": ("reversals", "quiet"),
    "force": ("sweep", "slow"),
    "kinematics": ("sweep", "places"),
    "sensor": ("sweep",),
}
#: Share of the belt's force that fast moves use.
FAST_SHARE = 0.9
#: Steps of one plan: with all sets of records there are some 20.
MOST_STEPS = 100
SETS = ("sweep", "places", "quiet", "slow", "reversals", "fast", "sweep again")
#: The sets of records of an axis without a belt, which no plan of steps moves: what is recorded with its own drive, and imported.
BY_OWN_DRIVE: Mapping[str, str] = {
    "sweep": "speeds held for a second each, six from slow to the fastest, in both directions over the whole range",
    "places": "a torque that changes at random, or a multisine, for 20 s, as fast as the drive takes it",
    "quiet": "the same with a fifth of the torque",
    "slow": "one turn, or the whole travel, each way as slowly as the drive goes, at two places; one more held out",
    "reversals": "triangles of the angle, a hundredth, a tenth and all of a typical move high",
    "fast": "moves at nine tenths of the largest torque; others, half as fast, held out",
    "sweep again": "the held speeds once more when the axis is warm",
}


@dataclass(frozen=True)
class NextPlan:
    """Plan of records.

    Attributes
    ----------
    reasons : dict of str to str
        By effect, why.
    by_hand : tuple of str
        What a person must change on the machine first, or besides.
    left_out : tuple of str
        Steps that would show nothing new, and the record that shows it.
    edited : bool
        Its file is not as beltcomm wrote it.
    own_drive : tuple of str
        Records of an axis without a belt, made with its own drive.
    """

    reasons: Mapping[str, str]
    by_hand: tuple[str, ...]
    steps: tuple[Step, ...]
    left_out: tuple[str, ...] = ()
    edited: bool = False
    own_drive: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Entries of the file."""
        steps = [step.to_dict() for step in self.steps]
        found = {"reasons": dict(self.reasons), "by_hand": list(self.by_hand), "steps": steps, "left_out": list(self.left_out)}
        return {**found, **({"own_drive": list(self.own_drive)} if self.own_drive else {})}

    def lines(self, run: Path) -> list[str]:
        """The plan for people."""
        if not self.reasons:
            return ["Nothing more needs to be recorded: every effect of typical size would have been seen."]
        lines = ["Record next, for " + ", ".join(self.reasons) + ":"]
        out = [f"  left out: {text}" for text in self.left_out]
        if self.own_drive:
            lines += [f"  {number}. {text}" for number, text in enumerate(self.own_drive, start=1)]
            lines += [f"  by hand: {text}" for text in self.by_hand]
            columns = "time, position, torque (or current) and, above all, its setpoint"
            return [
                *lines,
                f"An axis without a belt is moved by its own drive: record {columns}, each row, and `beltcomm import` them here.",
            ]
        if not self.steps:
            why = [f"  {name}: {reason}" for name, reason in self.reasons.items()]
            hand = [f"  by hand: {text}" for text in self.by_hand]
            return ["Nothing that this axis may do would show more; the plan has no record.", *why, *out, *hand]
        lines += [f"  {number}. {step.words()}" for number, step in enumerate(self.steps, start=1)]
        lines += [*out, *(f"  by hand: {text}" for text in self.by_hand)]
        return [*lines, f"The plan is {self.file(run)}; a drive runs it with: {self.command(run)}"]

    def file(self, run: Path) -> Path:
        """Path of the plan in a run folder."""
        return run / "results" / f"{NAME}.yaml"

    def command(self, run: Path) -> str:
        """Command that makes its records; nothing for a plan without a step."""
        return f"beltcomm identify --drive DRIVE --run {pasted(run)} --plan {pasted(self.file(run))}" if self.steps else ""


def plan_for(
    twins: Sequence[str],
    blind: Sequence[DetectionLimit],
    named: Sequence[str] = (),
    already: Callable[[Step], str] = lambda _step: "",
    belt: bool = True,
) -> NextPlan:
    """The plan that tells twins apart, or where there are none shows what could not be seen.

    Parameters
    ----------
    twins : sequence of str
        Effects that the motion does not tell apart.
    blind : sequence of DetectionLimit
        Effects that could not be seen.
    named : sequence of str
        Effects that were found.
    already : callable
        The record that shows what a step would, "" for none.
    belt : bool
        Without one no step is planned: what would show it is said in words.
    """
    if twins:
        apart = _plan_apart(twins, already)
        return apart if belt else replace(apart, steps=(), left_out=(), own_drive=tuple(BY_OWN_DRIVE[name] for name in ("sweep", "fast")))
    reasons: dict[str, str] = {}
    by_hand: list[str] = []
    sets = set[str]()
    judged = {name: _new_ones(_steps_of(name), already) for name in SETS}
    for effect in (effect_named(name) for name in named):
        only_by_hand = families(effect)
        if only_by_hand:
            reasons[effect.name] = f"it stands for {', '.join(only_by_hand)}, which no motion of the axis tells apart"
            by_hand += hands_of(only_by_hand)
    for sight in blind:
        seen = f"it would be seen from {sight.hardest:.2g} x a typical one on"
        reasons[sight.effect.name] = "these data say nothing of it" if math.isinf(sight.hardest) else seen
        sets.update(_records_showing(sight.effect))
        if not any(judged[name][0] for name in _records_showing(sight.effect)):
            by_hand.append(f"{sight.effect.name}: such records are here already; it shows only beyond the limits in axis.yaml")
    if not belt:
        hand = tuple(text for text in by_hand if "axis.yaml" not in text)
        return NextPlan(reasons, hand, (), own_drive=tuple(BY_OWN_DRIVE[name] for name in SETS if name in sets))
    chosen = [judged[name] for name in SETS if name in sets]
    return NextPlan(reasons, tuple(by_hand), tuple(s for steps, _ in chosen for s in steps), tuple(t for _, out in chosen for t in out))


def _plan_apart(twins: Sequence[str], already: Callable[[Step], str]) -> NextPlan:
    """The experiment that separates twins, without the steps that the run has."""
    first, other = twins[0], twins[1]
    between = _discriminating_experiment(first, other)
    reasons = {name: f"these data cannot tell it from {', '.join(n for n in twins if n != name)}: {between.shows}" for name in twins}
    records = enumerate(between.records, start=1)
    steps, left_out = _new_ones([checked_step(entry, f"{first} and {other}, record {number}") for number, entry in records], already)
    by_hand = hands_of({other: between})
    if not by_hand and not steps:
        by_hand = [separate for name in twins if (separate := effect_named(name).separate)]
    return NextPlan(reasons, tuple(dict.fromkeys(by_hand)), tuple(steps), tuple(left_out))


def _new_ones(steps: Sequence[Step], already: Callable[[Step], str]) -> tuple[list[Step], list[str]]:
    """The steps that a run has not, and of the others which record shows as much.   A held-out one alone would have nothing to judge."""
    found = {step: already(step) for step in steps}
    new = [step for step in steps if not found[step]]
    left_out = [f"{s.words()}: {name} shows as much, the same once more would show nothing new" for s, name in found.items() if name]
    return ([] if all(step.held_out for step in new) else new), left_out


def _discriminating_experiment(first: str, other: str) -> DiscriminatingExperiment:
    """Experiment that tells two effects apart, whichever of them says so."""
    for one, two in ((first, other), (other, first)):
        said = effect_named(one).apart
        family = two.rpartition("_")  # what is said of a numbered family counts for each of it
        if between := said.get(two) or (said.get(family[0]) if family[2].isdigit() else None):
            return between
    return DiscriminatingExperiment(effect_named(first).separate or effect_named(other).separate)


def families(effect: Effect) -> Mapping[str, DiscriminatingExperiment]:
    """Causes that one effect stands for because no motion tells them apart: those of its twins that have no effect to be found as.

    Parameters
    ----------
    effect : Effect
        With what tells its twins apart.

    Returns
    -------
    mapping of str to DiscriminatingExperiment
        By cause.
    """
    found_as = {e.name for e in EFFECTS if e.trials is not None and not e.behind_gap}
    return {name: apart for name, apart in effect.apart.items() if name not in found_as}


def hands_of(apart: Mapping[str, DiscriminatingExperiment]) -> list[str]:
    """Checks by hand, in sentences that begin with the cause.

    Parameters
    ----------
    apart : mapping of str to DiscriminatingExperiment
        By cause.
    """
    return [f"{name}: {hand.words()}" for name, one in apart.items() for hand in one.hands]


def by_hand_of(name: str) -> list[dict[str, Any]]:
    """Checks by hand that tell the causes of an effect apart, where no motion does.

    Parameters
    ----------
    name : str
        Of the effect.
    """
    causes = families(effect_named(name))
    return [{"effect": name, "cause": cause, **plain(hand)} for cause, apart in causes.items() for hand in apart.hands]


def _records_showing(effect: Effect) -> tuple[str, ...]:
    """Sets of records that show an effect."""
    return effect.record_sets or BY_SLOT.get(effect.slot, ("places", "sweep"))


def _steps_of(name: str) -> list[Step]:
    """The records of a set."""
    if name in ("sweep", "sweep again"):
        return [Step("sweep", again=name == "sweep again")]
    if name == "places":
        return [Step("response", place) for place in PLACES]
    if name == "quiet":
        return [Step("response", PLACES[1], QUIET, seconds=SHORT_S)]
    if name == "reversals":
        return [Step("reversals", PLACES[1], amplitudes_m=TRIANGLES_M)]
    if name == "fast":
        return [Step("moves", share=FAST_SHARE), Step("moves", share=0.5, seconds=8.0, seed=2, held_out=True)]
    return [Step("strokes", place, speeds_m_s=SLOW_M_S, held_out=place == PLACES[1]) for place in PLACES]


def load_plan(path: Path) -> NextPlan:
    """A plan from its file, checked.

    Parameters
    ----------
    path : Path

    Raises
    ------
    UsageError
        With the step that is wrong.
    """
    data, whole = unsealed(read_yaml(path))
    steps = []
    entries = data.get("steps")
    if entries == [] and data.get("reasons"):
        by_hand = data.get("by_hand")
        own = data.get("own_drive")
        texts = [*(own if isinstance(own, list) else ()), *(by_hand if isinstance(by_hand, list) else ())]
        text = "; ".join(map(str, texts)) or "what it would record is there already"
        raise UsageError(f"{path} has no steps: no record of this axis would tell more. By hand: {text}")
    if not isinstance(entries, list) or not entries:
        raise UsageError(f"{path} has no steps; write a plan with `beltcomm diagnose RUN --next`")
    if len(entries) > MOST_STEPS:
        raise UsageError(f"{path} has {len(entries)} steps; a plan has at most {MOST_STEPS}, split it")
    for number, entry in enumerate(entries, start=1):
        steps.append(checked_step(entry, f"{path}, step {number}"))
    try:
        reasons = {str(k): str(v) for k, v in (data.get("reasons") or {}).items()}
        by_hand, left_out = (tuple(map(str, data.get(key) or ())) for key in ("by_hand", "left_out"))
    except (AttributeError, TypeError) as error:
        raise UsageError(f"{path}: reasons must hold names and texts, by_hand and left_out lists of texts ({error})") from error
    return NextPlan(reasons, by_hand, tuple(steps), left_out, not whole)


def plan_schema() -> dict[str, Any]:
    """JSON schema of a plan's file."""
    texts = {"type": "array", "items": {"type": "string"}}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "beltcomm plan of records",
        "type": "object",
        "additionalProperties": False,
        "required": ["steps"],
        "properties": {
            "reasons": {"type": "object", "additionalProperties": {"type": "string"}, "description": "by effect, why"},
            "by_hand": {**texts, "description": "what a person changes on the machine"},
            "steps": {"type": "array", "maxItems": MOST_STEPS, "items": step_schema()},
            "left_out": texts,
            "checksum": {"type": "string"},
        },
    }
