"""Two commands that change a run's model: add, remove.  No machine needed.

Typed again, as after a power cut that came behind the saving, each shows what it made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from beltcomm.effects import effect_named, stands_for
from beltcomm.errors import BeltcommError, Refused, UsageError
from beltcomm.fit.base import NEXT_ITERATIONS, ratio_in_groups_of, refit_with_rebuilt_motion
from beltcomm.fit.estimate import Fitted, fit
from beltcomm.fit.likelihood.free_parameters import free_parameters
from beltcomm.fit.records import Data
from beltcomm.fit.residual.observer import needs_observer
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.given import Place, pasted, place, word
from beltcomm.jobs.rungs import base_revision, change_of, revision_of
from beltcomm.laboratory.acceptance import drop_by
from beltcomm.laboratory.compare import compare, of_run
from beltcomm.laboratory.coupled_bodies import COUPLING, SECTIONS, add_coupling, with_sections
from beltcomm.laboratory.diagnosis import final_refit
from beltcomm.laboratory.gaps import is_replaceable_gap
from beltcomm.laboratory.law_shape import assign_body, fit_law_shapes, fixed_forms
from beltcomm.laboratory.score import ground_of
from beltcomm.laboratory.selection import MISSING, with_effect
from beltcomm.model import Model
from beltcomm.pages import pictures as drawn
from beltcomm.result import Result
from beltcomm.rundata.cost import cost_and_words
from beltcomm.rundata.fitted_run import Opened, open_fitted
from beltcomm.rundata.kept import fit_base
from beltcomm.rundata.revisions import Revision, changed_recordings, current_revision, keep_cost, model_named, recording_hashes, revisions
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import ladder as words
from beltcomm.sentences.diagnosis_data import error_data, values_of
from beltcomm.sentences.own_words import about_run
from beltcomm.talk import Silence, Talk

#: Factor by which the error over the noise may be larger with an effect that was asked for: more is a fit that went astray.
WORSE = 1.05


@about_run()
def add_to_run(
    effect: str,
    run: Place,
    *,
    start: Mapping[str, float] | None = None,
    pictures: bool = True,
    cost: bool = True,
    command: str = "",
    when: str = "",
    talk: Talk | None = None,
) -> Result:
    """Refit everything with one more effect, saved as a new revision.

    Parameters
    ----------
    effect : str
    run : Place
        Run folder.
    start : mapping of str to float, or None
        Own parameters of the effect by bare name, from which the fit begins; None lets it search.
    pictures : bool
        Before and after, into ``RUN/pictures``.
    cost : bool
        Of not knowing it, in tracking error.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Values before and after, and whether the effect is worth its parameters.

    Raises
    ------
    UsageError
        For an effect that the model has already.
    """
    run, asked = place(run), word(effect, "effect")
    _refuse_load(stands_for(asked), run)
    here = open_fitted(run, talk or Silence())
    effect = stands_for(asked, behind_gap=needs_observer(here.fitted.model))
    if effect in here.fitted.model.effects:
        found = _made_already(here, f"+{effect}") if start is None else None
        if found is None:
            raise UsageError(f"the model of {run} has {effect} already; take it out with `beltcomm remove {effect} {pasted(run)}`")
        was, rung = found
        data, after, notes = here.data, here.fitted, words.made_already_notes(rung)
    else:
        was = here
        data, after, rung = _grow(here, effect, start, command, when)
        notes = []
    notes += words.added_notes(asked, effect, is_replaceable_gap(data, after, effect_named(effect)))
    notes += words.narrower_lines(was.fitted, after)
    result = _change_result(was, data, after, rung, notes, command, pictures)
    if not cost:
        return result
    price, lines = cost_and_words(here.folder, was.fitted.model, with_intervals(after), effect)
    keep_cost(here.folder, rung.name, None if price is None else {"of": effect, **price})
    return Result({**result.data, "cost": price}, [*result.text[:-1], *lines, result.text[-1]])


def _grow(here: Opened, effect: str, start: Mapping[str, float] | None, command: str, when: str) -> tuple[Data, Fitted, Revision]:
    """Records and model with an effect, saved as a rung; raises Refused when no values were found with which the error falls."""
    data, named = _fit_with(here, effect, start)
    on_body = assign_body(data, named, effect_named(effect))
    shaped = fit_law_shapes(data, on_body.fitted, here.fitted.model)
    data, after = final_refit(data, shaped.fitted)
    before = ratio_in_groups_of(here.fitted, after)
    if not after.ratio <= WORSE * before:
        raise Refused(
            f"no values of {effect} were found with which the error falls: {before:.2f} times the noise without it, "
            f"{after.ratio:.2f} with the best that were found; nothing was saved. With values that you know: --start NAME=VALUE"
        )
    if current_revision(here.folder) is None:
        base_revision(here.folder, here.data, here.fitted, command, when)
    new = (effect, *on_body.new, *shaped.new)
    change = change_of(new, [name for name in here.fitted.model.effects if name not in (*after.model.effects, *new)])
    return data, after, revision_of(here.folder, (data, after), (here.data, here.fitted), change, command, when)


def _made_already(here: Opened, change: str) -> tuple[Opened, Revision] | None:
    """The run as it was before its model's last change, and the rung, where that change is this one and the records are the same."""
    rung = current_revision(here.folder)
    if rung is None or not rung.parent or change not in rung.change.split() or changed_recordings(here.folder, rung):
        return None
    _, data, fitted = fit_base(here.folder, here.records.recordings, model_named(here.folder, rung.parent))
    return replace(here, data=data, fitted=fitted), rung


def _refuse_load(effect: str, run: Path) -> None:
    """Raise UsageError for an effect that comes with the records, and for none of the catalogue."""
    if effect_named(stands_for(effect)).slot == "load_of_record":
        raise UsageError(
            f"{effect} comes with the records that name another load, and goes with them: write `load: NAME` into their sidecars in "
            f"{run / 'recordings'}, or import them with --load NAME"
        )


@about_run()
def remove_from_run(
    effect: str, run: Place, *, pictures: bool = True, command: str = "", when: str = "", talk: Talk | None = None
) -> Result:
    """Refit everything without an effect, saved as a new revision; a model that the run had already is the one it was.

    Parameters
    ----------
    effect : str
    run : Place
        Run folder.
    pictures : bool
        Pictures into ``RUN/pictures``.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Values before and after.

    Raises
    ------
    UsageError
        For an effect that the model has not.
    """
    run, asked = place(run), word(effect, "effect")
    _refuse_load(asked, run)
    here = open_fitted(run, talk or Silence())
    effect = stands_for(asked, behind_gap=asked in here.fitted.model.effects)
    if effect not in here.fitted.model.effects:
        if (found := _made_already(here, f"-{effect}")) is not None:
            return _change_result(found[0], here.data, here.fitted, found[1], words.made_already_notes(found[1]), command, pictures)
        raise UsageError(f"the model of {run} has no {effect}; it has {', '.join(here.fitted.model.effects)}")
    if current_revision(here.folder) is None:
        base_revision(here.folder, here.data, here.fitted, command, when)
    data, after = _fit_without(here, effect)
    rung = revision_of(here.folder, (data, after), (here.data, here.fitted), f"-{effect}", command, when)
    return _change_result(here, data, after, rung, [], command, pictures)


def _change_result(here: Opened, grown: Data, after: Fitted, rung: Revision, notes: Sequence[str], command: str, pictures: bool) -> Result:
    """Result of ``add`` and ``remove``."""
    run = here.folder.path
    made: list[str] = []
    remarks: list[str] = []
    if pictures:
        made, remarks = drawn.change_picture(here.folder, rung, compare(here.data, here.fitted), compare(grown, after), command)
    model, band = with_intervals(after), rung.plain.band_hz if rung.plain else here.band_hz
    before = of_run(here.data, here.fitted, band)
    data = {
        "run": str(run),
        "revision": rung.name,
        "change": rung.change,
        "confirmed": rung.confirmed,
        "before": error_data(here.fitted, before),
        "after": error_data(after, (rung.plain, rung.plain_held_out)),
        "parameters": values_of(model),
        "pictures": made,
        "notes": list(notes),
        "remarks": list(here.records.remarks),
    }
    text = words.remark_lines(here.records.remarks) + words.change_lines(
        (here.fitted, before), model, after, rung, notes, run, _named_beside(here.folder, model)
    )
    return Result(data, text[:-1] + drawn.lines(here.folder, made, remarks) + text[-1:])


def _named_beside(folder: RunFolder, model: Model) -> list[str]:
    """Effects that the last diagnosis names and a model does not have, without those that `add` tries by itself."""
    try:
        named = [effect_named(name) for name in (folder.load_result("diagnosis") or {}).get("named") or ()]
    except UsageError:  # of another version
        return []
    along = {part for effect in named for part in effect.completed_by}
    return [e.name for e in named if e.name not in model.effects and e.name not in along]


def _fit_with(here: Opened, effect: str, start: Mapping[str, float] | None) -> tuple[Data, Fitted]:
    """Records and model with an effect, whatever speaks for it, from the effect's own parameters by bare name; None lets it search."""
    if effect == COUPLING.name and not start and (found := add_coupling(here.data, here.fitted, here.folder.axis)) is not None:
        return found
    if effect == SECTIONS and not start and (sections := with_sections(here.data, here.fitted)) is not None:
        return refit_with_rebuilt_motion(here.data, sections, NEXT_ITERATIONS)
    ground = ground_of(here.fitted, here.data.fitted, here.folder.axis)
    grown = with_effect(here.data, here.fitted, ground, effect_named(effect), start)
    return refit_with_rebuilt_motion(here.data, _better(here.folder, here.data, here.fitted, grown, effect), NEXT_ITERATIONS)


def _fit_without(here: Opened, effect: str) -> tuple[Data, Fitted]:
    """Records and model without an effect; as they were where the run had this model before, for the same records.

    What was learnt with the effect, noise and rounding above all, would let the same model read another error.
    """
    smaller, now = here.fitted.model.without_effect(effect), recording_hashes(here.folder)
    for rung in reversed(revisions(here.folder)):
        if set(rung.effects) == set(smaller.effects) and rung.data == now:
            model = model_named(here.folder, rung.name)
            if set(free_parameters(model)) == set(free_parameters(smaller)):
                return fit_base(here.folder, here.records.recordings, model)[1:]
    first = fit(here.data, smaller, NEXT_ITERATIONS, offsets=here.fitted.offsets)
    return final_refit(*refit_with_rebuilt_motion(here.data, first, NEXT_ITERATIONS))


def _diagnosis_start(folder: RunFolder, model: Model, effect: str) -> Model | None:
    """The model with the effect and the values that ``results/diagnosis.yaml`` ended with; None where it says nothing of it."""
    after = (folder.load_result("diagnosis") or {}).get("after")
    if after is None or effect not in after["effects"]:
        return None
    grown = model.with_effect(effect)
    fixed = fixed_forms(grown, effect_named(effect))  # these stay the usual ones: they are found after the effect
    told = {name: said["value"] for name, said in after["parameters"].items() if name in grown.parameters and name not in fixed}
    try:
        return grown.with_values(told, "diagnosis")
    except BeltcommError:  # out of their bounds
        return None


def _better(folder: RunFolder, data: Data, base: Fitted, grown: Fitted, effect: str) -> Fitted:
    """The model grown from a base, or the same begun at what the diagnosis found where that leaves less: it may have come another way."""
    if grown.objective < MISSING * grown.problem.samples:
        return grown
    told = _diagnosis_start(folder, base.model, effect)
    if told is None:
        return grown
    again = fit(data, told, NEXT_ITERATIONS, offsets=grown.offsets)
    return again if drop_by(grown, again) > 0.0 else grown
