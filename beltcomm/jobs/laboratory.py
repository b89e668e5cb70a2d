"""The laboratory's commands that read a run folder: compare, diagnose, ladder.  No machine needed.

Effects that the data tell apart badly, although each has evidence of its own (two delays, lines beside a ripple), are named as such.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import takewhile
from pathlib import Path
from typing import Any

from beltcomm.errors import UsageError
from beltcomm.experiments.redundant_steps import Before, record_showing
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.torque.acting_torque import acting_recordings, stated_remarks
from beltcomm.fit.uncertainty.intervals import parameter_spread, with_intervals
from beltcomm.given import Place, pasted, place
from beltcomm.jobs.effect_search import search_of
from beltcomm.jobs.rungs import base_revision, change_of, confirms, plain_of, revision_of
from beltcomm.laboratory.acceptance import DELAYS, undetermined_effects
from beltcomm.laboratory.compare import Comparison, compare, landmarks, unexplained_words, worst
from beltcomm.laboratory.diagnosis import Diagnosis, Stage
from beltcomm.laboratory.place_words import in_words
from beltcomm.laboratory.scope import missing_records, not_named, reservation
from beltcomm.laboratory.score import ground_of
from beltcomm.laboratory.visible import detection_limits
from beltcomm.pages import pictures as drawn
from beltcomm.recording import Recording
from beltcomm.result import Result, plain
from beltcomm.rundata.cost import cost_and_words, with_costs
from beltcomm.rundata.fitted_run import explainable, open_fitted
from beltcomm.rundata.headline import NextCommand, headline_of
from beltcomm.rundata.headline import next_command as best_step
from beltcomm.rundata.kept import KEY, kept_or_new
from beltcomm.rundata.revisions import (
    Revision,
    as_mapping,
    changed_recordings,
    current_model,
    current_revision,
    revisions,
)
from beltcomm.rundata.store import stated_reading
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.next_plan import NAME, plan_for
from beltcomm.sentences import laboratory as screens
from beltcomm.sentences import ladder as words
from beltcomm.sentences.cross_checks import as_data, check_lines, cross_checked, sensed, sensor_data, sensor_lines, sheet_lines
from beltcomm.sentences.diagnosis_data import diagnosis_data, seen_as, values_of
from beltcomm.sentences.own_words import about_run
from beltcomm.sentences.response_table import table_lines, table_of
from beltcomm.sentences.screens import next_lines, sheet_words
from beltcomm.sentences.torque_path import path_data, path_sentences, period_of, whole_sentences
from beltcomm.simulate.stopping import total_friction
from beltcomm.talk import Silence, Talk


@about_run()
def compare_run(run: Place, *, pictures: bool = True, command: str = "", talk: Talk | None = None) -> Result:
    """Compare model and measurement: ratios to the noise per record, and where the model fails.

    Parameters
    ----------
    run : Place
        Run folder.
    pictures : bool
        Into ``RUN/pictures``.
    command : str
        Command line, kept as provenance.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        Ratios and places.
    """
    run = place(run)
    folder, question = RunFolder.open(run), (pictures, command)
    return kept_or_new(folder, "comparison", question, lambda: _compared(run, pictures, command, talk or Silence()), drawn=pictures)


def _compared(run: Path, pictures: bool, command: str, talk: Talk) -> Result:
    """:func:`compare_run` with everything worked out."""
    here = open_fitted(run, talk)
    comparison = compare(here.data, here.fitted, here.band_hz)
    explainable(comparison.ratio, run)
    chosen = worst(comparison)
    doubt = reservation(comparison, here.fitted, here.records.recordings)
    if doubt and (left := unexplained_words({one.name: one.plain for one in comparison.records})):
        doubt += f" {left}"
    named = landmarks(here.fitted.model, here.folder.axis.travel.middle_m)
    table = table_of(acting_recordings(here.records.recordings, here.data.path), here.fitted.model)
    sensor = sensed(here.fitted.model, here.records.recordings)
    stated = stated_remarks(here.data.path, stated_reading(here.folder), period_of(here.data.recordings))
    made, remarks = drawn.comparison_pictures(here.folder, here.data, here.fitted, comparison, command) if pictures else ([], [])
    made += drawn.responses_picture(here.folder, table, command)[0] if pictures and not remarks else []
    data = {
        "run": str(run),
        "model": {"effects": list(here.fitted.model.effects), "parameters": values_of(with_intervals(here.fitted))},
        **_ratios(comparison),
        KEY: path_data(here.data.path, period_of(here.data.recordings)),
        "records": [plain(r) for r in comparison.records],
        "worst": [
            {
                "dimension": p.dimension,
                "low": p.low,
                "high": p.high,
                "unit": p.unit,
                "ratio": p.ratio,
                "share": p.share,
                "elsewhere": p.elsewhere,
                "text": in_words(p, named),
            }
            for p in chosen
        ],
        "responses": table.to_dict(),
        "pictures": made,
        "remarks": list(here.records.remarks),
        "doubts": [doubt] if doubt else [],
        "data_sheet": [plain(doubt) for doubt in here.sheets],
        "second_sensor": sensor_data(sensor),
    }
    explained = not (doubt or comparison.missing)
    notes = [
        *here.records.remarks,
        # a model that explains these records has what differs between them: its friction does it
        *(f"responses differ by {d.cause}: {d.first}, {d.second} (--details)" for d in table.differences if not explained),
        *sheet_words(data["data_sheet"]),
        *sensor_lines(sensor),
    ]
    text = screens.comparison_screen(comparison, [in_words(p, named) for p in chosen], notes, doubt)
    details = [
        *screens.comparison_details(comparison, here.fitted.model),
        *words.remark_lines(here.records.remarks),
        *(f"It fails at {in_words(p, named)}" for p in chosen[screens.PLACES :]),
        *path_sentences(here.data.path, here.data.recordings),
        *whole_sentences(stated),
        *table_lines(table),
        *(["  The model explains these records: what differs between them is in it."] if explained and table.differences else []),
        *sheet_lines(here.sheets),
        *drawn.lines(here.folder, made, remarks),
    ]
    return Result(data, [*text, *next_lines(_after_comparison(here.folder, comparison, bool(doubt)))], details=details)


def _after_comparison(folder: RunFolder, comparison: Comparison, doubted: bool) -> NextCommand:
    """The command to type next: a search only where something is left to be found."""
    run = pasted(folder.path)
    if doubted or comparison.missing:
        return NextCommand(f"beltcomm diagnose {run}", "names what the model lacks")
    if not folder.axis.has_transmission:
        return NextCommand(f"beltcomm report {run}", "everything known of the axis on one page")
    return best_step(folder, headline_of(folder))


@about_run()
def diagnose_run(
    run: Place,
    *,
    auto: bool = False,
    cost: bool = True,
    following: bool = False,
    command: str = "",
    when: str = "",
    talk: Talk | None = None,
) -> Result:
    """Find which effect is missing.

    Parameters
    ----------
    run : Place
        Run folder.
    auto : bool
        Add what is found and confirmed, step by step.
    cost : bool
        Say what it costs, see ``rundata.cost``.
    following : bool
        Write the plan of what to record next.
    command : str
        Command line, kept as provenance.
    when : str
        Date and time, kept as provenance.
    talk : Talk or None
        Hears progress and answers questions; None says nothing and agrees to nothing.

    Returns
    -------
    Result
        The evidence for each effect, and what to check.
    """
    run, talk = place(run), talk or Silence()
    folder = RunFolder.open(run)
    if auto or following:
        return _diagnosed(folder, run, auto, cost, following, command, when, talk)
    result = kept_or_new(folder, "diagnosis", (cost,), lambda: _diagnosed(folder, run, auto, cost, following, command, when, talk))
    return _with_lines(result, _unkept(folder, result.data))


def _diagnosed(folder: RunFolder, run: Path, auto: bool, cost: bool, following: bool, command: str, when: str, talk: Talk) -> Result:
    """:func:`diagnose_run` with everything worked out."""
    model = current_model(folder)
    records, found, doubts = search_of(folder, talk)
    recordings = records.recordings
    crossed = cross_checked(found, recordings, folder.axis)
    before, after = plain_of(found, revisions(folder))
    data: dict[str, Any] = {
        "run": str(run),
        **diagnosis_data(found, before, after),
        **as_data(crossed),
        KEY: path_data(found.data.path, period_of(recordings)),
        "remarks": list(records.remarks),
        "doubts": doubts,
    }
    belonging = _find_confounded(found.final_fit, found.added_effects)
    data["together"] = [plain(one) for one in belonging]
    stated = stated_remarks(found.data.path, stated_reading(folder), period_of(recordings))
    details = [*words.remark_lines(records.remarks), *words.diagnosis_lines(found)]
    details += [*path_sentences(found.data.path, recordings), *whole_sentences(stated), *check_lines(crossed)]
    if cost and found.added_effects:
        talk.phase(1, 1, "what it costs in tracking")
        data["cost"], lines = cost_and_words(folder, found.base.model, with_intervals(found.final_fit), " and ".join(found.added_effects))
        details += lines
    seen, sights, planned = _sight(folder, found, recordings, following)
    data |= seen
    warned = [*doubts, *words.caveats(found), *(one.text for one in belonging)]
    notes = [*records.remarks, *sheet_words(data["data_sheet"]), *sensor_lines(crossed.sensor), *sights.notes]
    text = screens.diagnosis_screen(found, before, after, warned, notes, data.get("cost"))
    details += sights.lines
    text += sights.planned
    text += _unkept(folder, plain(data)) if auto or following else []
    if not auto:
        designs = folder.axis.has_transmission and "final" in folder.names("models")
        return Result(data, text + words.after_diagnosis(found, run, planned, designs), details=details)
    added = _climb(folder, found, model is not None, command, when)
    if cost and added:
        added = with_costs(folder, found, added, data.get("cost"))
    data["revisions"] = [as_mapping(r) for r in added]
    unknown = _undetermined_in(found.final_fit, found.base)
    climbed = words.climb_lines(added, found.added_effects, found.final_fit.held_out_ratio is not None, run, unknown)
    step = f"Next: beltcomm {'design' if folder.axis.has_transmission else 'report'} {pasted(run)}"
    return Result(data, [*text, *climbed, step], details=details)


def _undetermined_in(fitted: Fitted, base: Fitted) -> list[str]:
    """Added effects of which no number is known."""
    return undetermined_effects(with_intervals(fitted), base.model)


def _unkept(folder: RunFolder, found: Mapping[str, Any]) -> list[str]:
    """Keep a diagnosis; in a folder that cannot be written, what was found is shown all the same, with a line that says so."""
    try:
        folder.save("results", "diagnosis", found)
    except UsageError as problem:
        return [f"Not kept: {problem}."]
    return []


def _with_lines(result: Result, lines: Sequence[str]) -> Result:
    """The result with further lines before its last, which says what is next."""
    return replace(result, text=[*result.text[:-1], *lines, *result.text[-1:]]) if lines else result


@dataclass(frozen=True)
class _Sights:
    """Detection limits in words: as notes of a screen, as its details, and the plan of further records."""

    notes: Sequence[str]
    lines: Sequence[str]
    planned: Sequence[str]


def _sight(folder: RunFolder, found: Diagnosis, recordings: Sequence[Recording], following: bool) -> tuple[dict[str, Any], _Sights, str]:
    """Detection limits of these data, and with ``following`` the saved plan of further records and the command that makes them."""
    planned = ""
    sights = detection_limits(found.scorer, ground_of(found.base, found.base.problem.pieces, folder.axis))
    data: dict[str, Any] = {"visible": [seen_as(one) for one in sights]}
    model = found.base.model
    missing = missing_records(recordings, model["transmission.ratio"]) if "cart" in model.base_bodies else []
    data["lacking"] = missing
    unnamed, told = not_named(model, recordings), list[str]()
    lines = [*words.lacking_lines(missing), *words.sight_lines(sights, folder.path, unnamed, planned=following)]
    if following:
        window = (float(folder.axis.travel.min_m or 0.0), float(folder.axis.travel.max_m or 1.0))
        before = Before(recordings, window, model["transmission.ratio"], total_friction(model))
        blind = [one for one in sights if not one.is_detectable]
        wanted = plan_for(found.twins, blind, found.added_effects, lambda step: record_showing(step, before), "cart" in model.base_bodies)
        data["next"] = wanted.to_dict()
        folder.save("results", NAME, plain(wanted.to_dict()))
        told = wanted.lines(folder.path)
        planned = wanted.command(folder.path)
    return data, _Sights([] if following else words.blind_words(sights, unnamed), lines, told), planned


def _climb(folder: RunFolder, found: Diagnosis, known: bool, command: str, when: str) -> list[Revision]:
    """Save every confirmed step of a diagnosis as a revision, one that is not together with the next ones if all of them are.

    So it is with an effect of which no number is known: it is a suggestion, and no part of a model.

    What comes after the last that is confirmed is not added. Where the run has a model and none is confirmed, nothing is saved.
    """
    made = []
    if not known:
        made.append(base_revision(folder, *found.published_base, command, when))
    old, parts = found.published_base, list[Stage]()
    for number, step in enumerate(found.steps):
        if not step.added:
            continue
        # Forms belong to what was named before them, as with ``add``.
        parts += [step, *takewhile(lambda other: not other.added, found.steps[number + 1 :])]
        new = (parts[-1].data or found.data, parts[-1].after)
        if confirms(folder, new, old) and not _undetermined_in(new[1], found.base):
            change = change_of([name for s in parts for name in (s.added, *s.forms) if name], [name for s in parts for name in s.removed])
            if not made and not current_revision(folder):
                made.append(base_revision(folder, *found.published_base, command, when))
            made.append(revision_of(folder, new, old, change, command, when))
            old, parts = new, []
    return made


@about_run()
def ladder_of_run(run: Place, *, pictures: bool = True, command: str = "") -> Result:
    """Show all revisions of the model as a staircase.

    Parameters
    ----------
    run : Place
        Run folder.
    pictures : bool
        It into ``RUN/pictures``.
    command : str
        Command line, kept as provenance.

    Returns
    -------
    Result
        The steps, with their gain.

    Raises
    ------
    UsageError
        For a run without revisions.
    """
    run = place(run)
    folder = RunFolder.open(run)
    rungs = revisions(folder)
    if not rungs:
        raise UsageError(
            f"{run} has no revisions yet: nothing was added to its model; `beltcomm diagnose {pasted(run)}` says what is missing"
        )
    changed = changed_recordings(folder, rungs[-1])
    made, remarks = drawn.ladder_picture(folder, rungs, command) if pictures else ([], [])
    data = {"run": str(run), "revisions": [as_mapping(r) for r in rungs], "changed_recordings": changed, "pictures": made}
    return Result(data, words.ladder_lines(rungs, changed) + drawn.lines(folder, made, remarks))


def _ratios(comparison: Comparison) -> dict[str, Any]:
    """``ratio`` and ``plain`` : overall and held out.   ``missing`` : by what it is seen that something is left."""
    return {
        "missing": comparison.missing,
        "ratio": {"overall": comparison.ratio, "held_out": comparison.held_out},
        "plain": {"overall": plain(comparison.plain), "held_out": plain(comparison.plain_held_out)},
    }


#: Share of a lag up to which a dead time beside it may be the lag's own second pole.
SECOND_POLE = 0.25
#: Periods per turn by which a line may lie beside a ripple whose amplitude changes once per turn, and room for rounding.
BESIDE, ROUNDED = 1.0, 0.05
#: A size that changes by all of itself writes lines of half of it.
MOST = 0.5


@dataclass(frozen=True)
class ConfoundedEffects:
    """effects : which.   parameter : what of them is known together, "" where nothing is summed.   value, interval : in ``unit``.
    text : a sentence.
    """

    effects: tuple[str, ...]
    parameter: str
    value: float | None
    interval: float | None
    unit: str
    text: str


def _find_confounded(fitted: Fitted, named: Sequence[str]) -> list[ConfoundedEffects]:
    """All that is to be said of effects that were named side by side."""
    return [*_delays_of(fitted, named), *_ripples_of(fitted, named)]


def _delays_of(fitted: Fitted, named: Sequence[str]) -> list[ConfoundedEffects]:
    """Two or three delays of which one at least was named: their sum."""
    model = fitted.model
    present = [name for name in DELAYS if f"{name}.time" in fitted.problem.free]
    if len(present) < 2 or not set(present) & set(named):
        return []
    value = sum(model[f"{name}.time"] for name in present)
    width = parameter_spread(fitted).half_width({f"{name}.time": 1.0 for name in present})
    known = f"{1e6 * value:.0f}" + ("" if width is None else f" ± {1e6 * width:.0f}")
    alone = " and ".join(f"{name} ({1e6 * model[f'{name}.time']:.0f} us)" for name in present)
    text = f"The sum of the delays is known to be {known} us; each alone is not, whatever its interval says: {alone}."
    lag = max((name for name in present if name != "dead_time"), key=lambda name: model[f"{name}.time"])
    if "dead_time" in present and 0.0 < model["dead_time.time"] < SECOND_POLE * model[f"{lag}.time"]:
        text += f" A dead time as short as this may be a second pole of the {lag}, and no cause of its own."
    return [ConfoundedEffects(tuple(present), "time", value, width, "s", text)]


def _ripples_of(fitted: Fitted, named: Sequence[str]) -> list[ConfoundedEffects]:
    """A line of the motor one period per turn beside the ripple of the teeth, and weaker: the teeth's own, where pulley or belt wobble."""
    model = fitted.model
    if "tooth_ripple" not in model.effects:
        return []
    teeth, mesh = model["tooth_ripple.teeth"], _amplitude(fitted, "tooth_ripple")
    found = []
    for name in named:
        if not name.startswith("cogging"):
            continue
        beside = abs(model[f"{name}.order"] - teeth)
        if _amplitude(fitted, name) < MOST * mesh and abs(beside - BESIDE) < ROUNDED:
            text = (
                f"{name} of order {model[f'{name}.order']:g} lies one period per turn beside the {teeth:g} teeth: that is what a tooth "
                "ripple writes whose size changes once per turn (pulley out of true). It may be part of the tooth_ripple and no cause of "
                "its own."
            )
            found.append(ConfoundedEffects((name, "tooth_ripple"), "", None, None, "", text))
    return found


def _amplitude(fitted: Fitted, name: str) -> float:
    """Of a ripple, N m."""
    return float((fitted.model[f"{name}.sine"] ** 2 + fitted.model[f"{name}.cosine"] ** 2) ** 0.5)
