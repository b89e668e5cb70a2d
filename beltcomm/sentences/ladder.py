"""The laboratory's results as sentences."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path

from beltcomm.effects import Effect, effect_named
from beltcomm.effects.tilt import GRAVITY_M_S2
from beltcomm.fit.base import ratio_in_groups_of
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.start.model import BELT_BASE, RIGID_BASE
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.given import pasted
from beltcomm.laboratory.acceptance import KNOWN, implausible_effects, undetermined_effects
from beltcomm.laboratory.compare import GIVEN_UP, NOISE_KNOWN
from beltcomm.laboratory.diagnosis import NONE_EXPLAINS, Diagnosis, structures
from beltcomm.laboratory.figures import Plain, PlainError
from beltcomm.laboratory.selection import Candidate
from beltcomm.laboratory.visible import DetectionLimit
from beltcomm.language import told, tr
from beltcomm.model import Model, effect_parameters
from beltcomm.quantities import read_in
from beltcomm.result import Row, table, with_unit
from beltcomm.rundata.cost import cost_rows
from beltcomm.rundata.headline import EXPLAINED
from beltcomm.rundata.revisions import Revision
from beltcomm.schedule.next_plan import families, hands_of

#: Characters of the longest bar of a staircase.
BAR = 12

#: What is left over and goes with something, in words.
LEFT_WORDS = {
    "speed": "goes with the speed",
    "position": "goes with the position",
    "time": "changes in the course of the session",
    "record": "differs from record to record",
}


def remark_lines(remarks: Sequence[str]) -> list[str]:
    """Oddities of the records, before anything else on a screen.

    Parameters
    ----------
    remarks : sequence of str
        Sentences.
    """
    return ["Of the records:", *(f"  {remark}" for remark in remarks), ""] if remarks else []


def trial_line(candidate: Candidate) -> str:
    """Line on a trial while a diagnosis goes on.

    Parameters
    ----------
    candidate : Candidate
        Kept or taken back.
    """
    if candidate.grows or candidate.unneeded or candidate.idle:
        return f"{candidate.effect.name} taken back, {candidate.against}; the next best is asked"
    share = 100.0 * min(1.0, candidate.explained)
    together = f" together with {candidate.beside}, which hides it" if candidate.beside else ""
    return f"{candidate.effect.name} on trial: it explains {share:.0f} %{together}; all is fitted with it, then looked at for more"


def candidate_rows(found: Diagnosis, most: int, indent: str = "") -> list[Row]:
    """Table of the effects that were on trial first, best first.

    Parameters
    ----------
    found : Diagnosis
    most : int
        Rows.
    indent : str
        Before each line.
    """
    shown = [c for c in (found.steps[0].candidates if found.steps else ()) if c.fitted is not None][:most]
    rows = [
        [
            c.effect.name,
            f"{c.evidence:.0f}",
            f"{100.0 * min(max(0.0, c.explained), 1.0):.0f}%",
            f"{c.held_out_gain:.0f}" if found.base.held_out_residuals else "none",
            f"not accepted, {c.against}" if c.against else f"together with {c.beside}" if c.beside else "",
        ]
        for c in shown
    ]
    return table(["effect", ">evidence", ">explains", ">held out", ""], rows, indent) if rows else []


def diagnosis_lines(found: Diagnosis) -> list[str]:
    """Details of a diagnosis behind its answer, as lines: effects of the base, candidates of every trial, laws that were added.

    Parameters
    ----------
    found : Diagnosis
    """
    known = [name for name in found.base.model.effects if name not in (*BELT_BASE, *RIGID_BASE)]
    lines = [f"The model has already: {', '.join(known)}."] if known else []
    lines += candidate_rows(found, 5)
    lines += [
        f"{' and '.join(step.detour)} came first on trial and became superfluous beside {step.added}, which explains more."
        for step in found.steps
        if step.detour
    ]
    model = with_intervals(found.final_fit)
    for name in found.added_effects:
        lines += ["", *_effect_lines(effect_named(name), model)]
    return [*lines, ""] if lines else []


def held_out_words(ratio: float, held_out: float | None) -> list[str]:
    """That records which were not fitted are not explained, where those fitted are.

    Parameters
    ----------
    ratio, held_out
        Error over the noise, of the fitted records and of the others; None without any.
    """
    if held_out is None or held_out < EXPLAINED or ratio > EXPLAINED:
        return []
    told = "records that were held out leave {held:.2f} x the noise, those fitted {ratio:.2f}: look at where they were made"
    return [tr(told, held=held_out, ratio=ratio)]


def caveats(found: Diagnosis) -> list[str]:
    """Reservations about a diagnosis, as sentences: what records held out, parameters left open, values beyond a machine and twins say.

    Parameters
    ----------
    found : Diagnosis
    """
    lines, model = held_out_words(found.final_fit.ratio, found.final_fit.held_out_ratio), with_intervals(found.final_fit)
    if found.added_effects:
        lines += narrower_lines(found.published_base[1], found.final_fit)
        held, then = found.published_base[1].held_out_ratio, found.final_fit.held_out_ratio
        if held is not None and then is not None and then >= held:
            lines.append(f"Not confirmed: on records that were not fitted the error was {held:.2f} without it.")
    if open_ := undetermined_effects(model, found.base.model):
        lines.append(
            f"But these data say nothing certain of {' and '.join(open_)}: every number of it is open by more than {100 * KNOWN:.0f} %, so "
            "it may stand for a cause that the catalogue does not hold."
        )
    if found.verdict == NONE_EXPLAINS and found.final_fit.objective < NOISE_KNOWN * found.final_fit.problem.samples:
        if found.final_fit.ratio >= GIVEN_UP:
            lines.append("All but a few stretches of the records are explained: `beltcomm compare` shows which.")
        elif (found.final_fit.held_out_ratio or 0.0) < GIVEN_UP:
            left = structures(found.data, found.final_fit)
            most = max(left, key=lambda name: left[name])
            lines.append(f"As a whole what is left is no more than the noise, but its mean {LEFT_WORDS[most]}.")
    if odd := implausible_effects(model, found.base.model):
        lines.append(f"But it takes {' and '.join(odd)}: that stands for another cause, which the catalogue does not hold.")
    if found.twins:
        effect = effect_named(found.twins[0])
        lines.append(f"These data cannot tell {' from '.join(found.twins)}: {effect.separate}.")
    return lines


def narrower_lines(before: Fitted, after: Fitted) -> list[str]:
    """Sentence on a model for which only part of the frequencies counts, with the error of the one before it there; none where all count.

    Parameters
    ----------
    before : Fitted
        Fit of the model before.
    after : Fitted
        Fit of the model, to the same records.
    """
    pairs = [(piece, other) for piece, other in zip(before.problem.pieces, after.problem.pieces, strict=False) if other.group > piece.group]
    if not pairs:
        return []
    highest_hz = max(0.5 / (other.group * other.motion.sample_s) for _, other in pairs)
    return [
        f"With it only motion up to {highest_hz:.0f} Hz counts, for between the samples the motor swings unseen: counted so, the error was "
        f"{ratio_in_groups_of(before, after):.2f} before."
    ]


def after_diagnosis(found: Diagnosis, run: Path, planned: str = "", designs: bool = True) -> list[str]:
    """Next steps.

    Parameters
    ----------
    found : Diagnosis
    run : Path
    planned : str
        The command that makes the records that were planned.
    designs : bool
        The run has gains that can be designed again.
    """
    if planned:
        return [f"Next: {planned}"]
    open_ = undetermined_effects(with_intervals(found.final_fit), found.base.model) if found.added_effects else []
    parts = {name: effect_named(name).completed_by for name in found.added_effects}
    along = {part for of_one in parts.values() for part in of_one}  # `add` tries them by itself
    sure = {name for name in found.added_effects if name not in open_}
    certain = [name for name in found.added_effects if name not in along and sure & {name, *parts[name]}]
    if certain and found.verdict != NONE_EXPLAINS:
        if len(certain) > 1 and not designs:
            return [f"Next: beltcomm diagnose {pasted(run)} --auto   (adds of {' and '.join(certain)} what records held out confirm)"]
        if len(certain) > 1:
            return [f"Next: beltcomm improve {pasted(run)}   (adds {' and '.join(certain)}, and designs again)"]
        return [f"Next: beltcomm add {certain[0]} {pasted(run)}   ({tr('fits everything again with it')})"]
    if found.verdict != "nothing missing":
        return [f"Next: beltcomm compare {pasted(run)}   ({tr('shows where the error sits; look there on the machine')})"]
    return [f"Next: beltcomm report {pasted(run)}   ({tr('nothing is missing in the model: everything known of the axis on one page')})"]


def lacking_lines(missing: Sequence[str]) -> list[str]:
    """Records that are not there, and so hide things.

    Parameters
    ----------
    missing : sequence of str
        Sentences.
    """
    return ["Little can be seen here of some things:", *(f"  {line}" for line in missing)] if missing else []


def sight_lines(sights: Sequence[DetectionLimit], run: Path, unnamed: Collection[str], planned: bool) -> list[str]:
    """Detection limits of these data.

    Parameters
    ----------
    sights : sequence of DetectionLimit
    run : Path
    unnamed : Collection[str]
        Effects that are not named from them, whatever they show.
    planned : bool
        What to record next is said beside it.
    """
    blind = [sight for sight in sights if not sight.is_detectable and sight.effect.name not in unnamed]
    if not blind:
        return [f"Every {'other ' if unnamed else ''}effect of the catalogue, of typical size, would have been seen in these data."]
    lines = ["Could not have been seen here at its typical size:"]
    for sight in blind:
        if math.isinf(sight.hardest) or _beyond_bounds(sight):
            lines.append(f"  {sight.effect.name:24} these data say nothing of it")
            continue
        factor, unit = read_in(sight.unit, max((p.high for p in sight.effect.parameters if p.name == sight.parameter), default=0.0))
        size = f" ({with_unit(f'{sight.parameter} {_digits(factor * sight.hardest * sight.size, 2)}', unit)})" if unit else ""
        lines.append(f"  {sight.effect.name:24} only from {sight.hardest:.2g} x a typical one on{size}")
    return (
        lines if planned else [*lines, f"  `beltcomm diagnose {pasted(run)} --next` writes the plan of the records that would show them."]
    )


def blind_words(sights: Sequence[DetectionLimit], unnamed: Collection[str]) -> list[str]:
    """:func:`sight_lines` as one note.

    Parameters
    ----------
    sights : sequence of DetectionLimit
    unnamed : collection of str
        Effects that are left out.
    """
    blind = [sight.effect.name for sight in sights if not sight.is_detectable and sight.effect.name not in unnamed]
    return [tr("not seen by these records (--next plans some that would): {names}", names=", ".join(blind))] if blind else []


def _beyond_bounds(sight: DetectionLimit) -> bool:
    """True if an effect that could be seen would be larger than any."""
    highs = [p.high for p in sight.effect.parameters if p.name == sight.parameter]
    return bool(highs) and sight.hardest * sight.size > highs[0]


def _effect_lines(effect: Effect, model: Model) -> list[str]:
    """Effect, its numbers, causes and what to check."""
    lines = [f"{effect.name}: {effect.title}.", *(f"  {line}" for line in number_lines(effect, model)), *_body_lines(effect, model)]
    if effect.causes:
        lines.append(f"  Usual causes: {effect.causes}.")
    lines.append(f"  Check: {effect.check}.")
    if effect.twins:
        lines.append(
            f"  Looks alike: {', '.join(effect.twins)}" + (f"; to tell them apart: {effect.separate}." if effect.separate else ".")
        )
    lines += _family_lines(effect, model)
    return lines


def number_lines(effect: Effect, model: Model) -> list[str]:
    """Parameters of an effect with their intervals, a line each.

    Parameters
    ----------
    effect : Effect
    model : Model
        With the effect and its intervals.
    """
    lines, elsewhere = [], _body_lines(effect, model)
    for name, parameter in effect_parameters(effect).items():
        item = model.parameters[name]
        if parameter.form and item.low == item.high:
            continue  # the usual form, which nothing spoke against
        if item.interval is not None and item.interval > item.high - item.low > 0.0:  # a number would pretend to be one
            lines.append(f"{name}: these records do not tell it")
            continue
        factor, unit = read_in(item.unit, item.high)
        width = "" if item.interval is None else f" ± {_digits(factor * item.interval, 2)}"
        held = item.low == item.high
        bound = item.interval is None and not parameter.form and not elsewhere and not item.low < item.value < item.high
        doubt = ", as it was: no fit moves it" if held else ", at the bound of what is possible: hardly the cause" if bound else ""
        usual = f" (its form; usual is {factor * parameter.start:g})" if parameter.form else ""
        lines.append(f"{with_unit(f'{name} = {_digits(factor * item.value, 4)}{width}', unit)}{doubt}{usual}")
    return lines


def _digits(value: float, count: int) -> str:
    """A number with so many digits, without powers of ten for a large one."""
    return f"{value:.0f}" if 10.0**count <= abs(value) < 1e7 else f"{value:.{count}g}"


def _body_lines(effect: Effect, model: Model) -> list[str]:
    """That an effect acts on the carriage, where the part of it that does is in the model, and what is left of it at the motor."""
    behind = [name for name in effect.completed_by if name in model.effects and effect_named(name).body == "cart"]
    own = model.parameters[effect.full_names()[0]] if behind else None
    left = own is not None and own.interval is not None and own.interval < abs(own.value)
    return [f"  It acts on the carriage{' and at the motor' if left else ', nothing of it is seen at the motor'}: {n}." for n in behind]


def _family_lines(effect: Effect, model: Model) -> list[str]:
    """Checks that tell the causes apart that an effect stands for, where no motion does; as which tilt a constant torque would be."""
    causes = families(effect)
    if not causes:
        return []
    lines = [f"  No motion of the axis tells {', '.join(causes)} apart. By hand:", *(f"    {text}" for text in hands_of(causes))]
    if "tilt" in causes and "cart.mass" in model.parameters:
        sine = model[f"{effect.name}.torque"] / (model["transmission.ratio"] * model["cart.mass"] * GRAVITY_M_S2)
        stated = (
            f"would be {math.degrees(math.asin(sine)):.2g}°"
            if abs(sine) <= 1.0
            else "is more than gravity has: it is none, or not tilt alone"
        )
        lines.append(f"    All of it by tilt {stated}, with the {model['cart.mass']:.3g} kg that move.")
    return [*lines, f"    Compare with what the catalogue says: {', '.join(f'beltcomm effects {n}' for n in ('tilt', effect.name))}."]


def made_already_notes(rung: Revision) -> list[str]:
    """Note beside a change that the model has already.

    Parameters
    ----------
    rung : Revision
        That made it.
    """
    return [f"The model has this change already, {rung.name}{f' of {rung.when}' if rung.when else ''}: nothing was lost or fitted again."]


def added_notes(asked: str, effect: str, strays: bool) -> list[str]:
    """Notes beside an effect that was asked for.

    Parameters
    ----------
    asked : str
        Name that was given.
    effect : str
        Name of the effect that was added.
    strays : bool
        It is a gap that a carriage which strays can do without.
    """
    notes = []
    if asked != effect:
        notes.append(f"{asked}, friction by direction and an offset of the current look alike on this axis: added as {effect}")
    if strays:
        notes.append(
            f"Doubt: a carriage that strays as far explains as much without {effect}. What follows the carriage through a gap follows "
            "whatever else pushes it, friction that changes by chance for one; held-out records cannot contradict that."
        )
    return notes


def change_lines(
    was: tuple[Fitted, Plain], model: Model, after: Fitted, rung: Revision, notes: Sequence[str], run: Path, beside: Sequence[str]
) -> list[str]:
    """``beltcomm add`` and ``beltcomm remove``.

    Parameters
    ----------
    was : tuple[Fitted, Plain]
        The model before, and what it left in plain units.
    model : Model
    after : Fitted
        Fit with the change.
    rung : Revision
        Revision that was made.
    notes : sequence of str
        Sentences before all else.
    run : Path
    beside : sequence of str
        Effects that the last diagnosis names and the model does not have yet.
    """
    lines, (before, (plain, plain_held)) = list(notes), was
    lines.append(f"{rung.change}: error {before.ratio:.2f} → {after.ratio:.2f} times the noise{_fall(plain, rung.plain, 'of the torque')}")
    if before.held_out_ratio is not None and after.held_out_ratio is not None:
        held = _fall(plain_held, rung.plain_held_out)
        lines.append(f"  on records that were not fitted {before.held_out_ratio:.2f} → {after.held_out_ratio:.2f}{held}")
    if rung.change.startswith("+"):
        for name in (word[1:] for word in rung.change.split() if word.startswith("+")):
            lines += _effect_lines(effect_named(name), model)
        if rung.confirmed is False:
            lines.append("Warning: not confirmed. The error on records that were not fitted did not fall; this may not be the cause.")
            lines += [f"The diagnosis names {name} beside it: `beltcomm add {name} {pasted(run)}`, then judge both." for name in beside[:1]]
        elif rung.confirmed is None:
            lines.append("Not confirmed: no record is held out, so nothing could contradict it.")
    elif before.held_out_ratio is not None and after.held_out_ratio is not None and after.held_out_ratio > before.held_out_ratio:
        lines.append(
            "Warning: without it records that were not fitted fit worse. It is out all the same, and `design` rests on this model."
        )
    belt = "cart" in model.base_bodies
    following = ("design", "gains of the model as it is now") if belt else ("diagnose", "what is still missing")
    lines += [f"Saved as {rung.name}.", f"Next: beltcomm {following[0]} {pasted(run)}   ({following[1]})"]
    return lines


def _staircase(rungs: Sequence[Revision]) -> list[Row]:
    """Revisions as a falling staircase down to the noise."""
    highest = max(1.0, *(rung.ratio for rung in rungs))
    rows = [
        [
            rung.name,
            rung.change,
            f"{rung.ratio:.2f}",
            "" if rung.held_out is None else f"{rung.held_out:.2f}",
            " / ".join(f"{one.percent:.3g}" for one in (rung.plain, rung.plain_held_out) if one is not None),
            "█" * max(1, round(BAR * rung.ratio / highest)),
            told("not confirmed")
            if rung.confirmed is False
            else told("nothing held out")
            if rung.confirmed is None and rung.change[0] == "+"
            else "",
        ]
        for rung in rungs
    ]
    rows.append([tr("noise"), "", "1.00", "", "", "█" * max(1, round(BAR / highest)), ""])
    wide = 7 if any(row[-1] for row in rows) else 6  # a column that holds nothing makes no table wider than a screen
    return table(["revision", "change", ">error", ">held out", ">% of torque", "", ""][:wide], [row[:wide] for row in rows])


def ladder_lines(rungs: Sequence[Revision], changed: Sequence[str]) -> list[str]:
    """Revisions of a model as a staircase, and where its steps come from.

    Parameters
    ----------
    rungs : sequence of Revision
        In their order.
    changed : sequence of str
        Names of recordings.
    """
    first = next((rung.plain for rung in rungs if rung.bands and rung.plain is not None), None)
    apart = [f"% of torque up to {first.band_hz:g} Hz in every row; error and held out over each model's own noise."] if first else []
    lines: list[str] = [*_staircase(rungs), *apart, "", "Where they come from:"]
    for rung in rungs:
        lines += _provenance_lines(rung)
    if changed:
        lines.append(f"Since the last revision these recordings changed: {', '.join(changed)}.")
    return lines


def _provenance_lines(rung: Revision) -> list[str]:
    """Date, data and command of a revision; what not knowing its effects costs."""
    number = f"{len(rung.data)} recording{'' if len(rung.data) == 1 else 's'}"
    lines = [f"  {rung.name}  {', '.join(filter(None, [rung.when, f'{number}, data {rung.data_hash}']))}"]
    lines += [f"    {rung.command}"] if rung.command else []
    if rung.cost is not None:
        lines.append(f"    error in mm without {rung.cost['of']} → with it ({rung.cost['move']}):")
        for what, *errors in cost_rows(rung.cost):
            without, aware = (f"{error} ({spread})" if spread else error for error, spread in zip(errors[::2], errors[1::2], strict=True))
            lines.append(f"      {what:17} {without} → {aware}")
    return lines


def climb_lines(made: Sequence[Revision], named: Sequence[str], held_out: bool, run: Path, undetermined: Collection[str] = ()) -> list[str]:
    """Steps that ``diagnose --auto`` saved, and why it ended before the last that was named.

    Parameters
    ----------
    made : sequence of Revision
        Revisions, in their order.
    named : sequence of str
        Effects that the diagnosis names.
    held_out : bool
        Whether any record is.
    run : Path
    undetermined : Collection[str]
        Effects of which no number is known.
    """
    added = [rung for rung in made if rung.change.startswith("+")]
    lines: list[str] = [*_staircase(made)] if added else ["Nothing was added."]
    left = [name for name in named if not any(name in rung.effects for rung in added)]
    if left and left[0] in undetermined:
        lines.append(
            f"Not added: {' and '.join(left)}. No number of {left[0]} is known to {100 * KNOWN:.0f} % of itself: it is a suggestion,"
        )
        lines.append(
            f"which `beltcomm add {left[0]} {pasted(run)}` follows. Records that show more of it: `beltcomm diagnose {pasted(run)} --next`."
        )
    elif left and held_out:
        lines.append(f"Not added: {' and '.join(left)}. With {left[0]} the error on records that were not fitted did not fall.")
    elif left:
        lines.append(f"Not added: {' and '.join(left)}. No record is held out, so nothing could confirm it; `held_out: true` in a sidecar")
        lines.append(f"makes one, and `beltcomm add {left[0]} {pasted(run)}` adds it as it is.")
    return lines


def _fall(before: PlainError | None, after: PlainError | None, of: str = "") -> str:
    """By how much a plain error changes, in per cent; nothing where it is not known."""
    return "" if before is None or after is None else f", {before.percent:.3g} → {after.percent:.3g} %{of and f' {of}'}"
