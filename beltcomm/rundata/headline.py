"""Headline of a run, everywhere in the same words: terminal, ``verdict.txt``, report, JSON; and the one command to type next."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from beltcomm.axis.entries import NO_TARGETS, AxisTargets, entries_of
from beltcomm.configfiles import digest_of
from beltcomm.control import Cascade
from beltcomm.drive.parameters import cascade_to_parameters
from beltcomm.errors import BeltcommError
from beltcomm.given import Reached, pasted
from beltcomm.language import tr
from beltcomm.model import Model
from beltcomm.quantities import mm
from beltcomm.rundata.proof import SUSPECT, same_gains, suspect
from beltcomm.rundata.revisions import current_revision, trusted_model, unfitted
from beltcomm.runfolder import RunFolder

State = Literal["pass", "fail", "doubt", "stale", "open"]
#: Each state in the word that stands first.
WORDS: Mapping[State, str] = {
    "pass": "PASS",
    "fail": "FAIL",
    "doubt": "NOT TRUSTED",
    "stale": "OUT OF DATE",
    "open": "NOT PROVEN",
}
#: Where a result of a move keeps what it was driven with.
OF = "verified"
#: Where a result keeps what was noted in its session, in words.
NOTED = "noted"
#: Where it says that the move was driven with gains that a person has set in the drive.
OWN = "own_loop"
#: Error over the noise up to which a record, or a model that was not compared with its records, is told as explained: by size alone.
EXPLAINED = 1.1
#: What each state of a headline means.
MEANINGS: Mapping[str, Literal["good", "bad", "note"]] = {"pass": "good", "fail": "bad", "doubt": "bad", "stale": "note", "open": "note"}


@dataclass(frozen=True)
class Headline:
    """First lines of a result.

    Attributes
    ----------
    state : State
        What the axis is.
    sentence : str
        Without the state's word.
    move : str
        Name of the result it rests on, "" without one.
    errors : dict of str to Any or None
        Following and settled error, m, at motor and carriage.
    targets : AxisTargets
        That count, as stated or by default.
    """

    state: State
    sentence: str
    move: str = ""
    errors: Mapping[str, Any] | None = None
    targets: AxisTargets = NO_TARGETS

    @property
    def word(self) -> str:
        """PASS, FAIL, ..."""
        return WORDS[self.state]

    @property
    def text(self) -> str:
        """Word and sentence, for a file or a page."""
        return f"{tr(self.word)}   {self.sentence}"

    def __str__(self) -> str:
        return self.text

    @property
    def good(self) -> bool:
        """True if the axis does what was asked, by a model that explains it and with nothing that speaks against it."""
        return self.state == "pass"

    def to_dict(self) -> dict[str, Any]:
        """For programs."""
        return {
            "state": self.state,
            "word": self.word,
            "sentence": self.sentence,
            "move": self.move,
            "errors": self.errors,
            "targets": _targets_dict(self.targets),
        }


@dataclass(frozen=True)
class NextCommand:
    """The command to type next.

    Attributes
    ----------
    why : str
        What it does, a few words.
    writes_gains : bool
        Into the drive.
    """

    command: str
    why: str
    writes_gains: bool = False


def _targets_dict(targets: AxisTargets) -> dict[str, Any]:
    """Targets in force, and whether anybody stated them."""
    return {
        "following_error_m": targets.following_m,
        "settled_error_m": targets.settled_m,
        "settled_after_s": targets.after_s,
        "at": list(targets.places),
        "move": targets.limits,
        "distance_m": targets.way_m,
        "stated": targets.stated,
    }


def hashes_of(gains: Mapping[str, float] | Cascade, model: Model | None) -> dict[str, str]:
    """Short hashes of gains and model, to three digits: what a later computation of the same leaves as it is.

    Parameters
    ----------
    gains : mapping of str to float or Cascade, SI
        Of the controller.
    model : Model or None
        None counts as one without effects.

    Returns
    -------
    dict of str to str
        By "gains" and "model".
    """
    values = cascade_to_parameters(gains) if isinstance(gains, Cascade) else gains
    told = {} if model is None else {name: item.value for name, item in model.parameters.items()}
    effects = [] if model is None else list(model.effects)
    return {"gains": _hash({n: f"{v:.3g}" for n, v in values.items()}), "model": _hash([effects, {n: f"{v:.3g}" for n, v in told.items()}])}


def headline_of(folder: RunFolder) -> Headline:
    """First sentence on a run, by the last move that was driven with today's gains on today's model.

    Parameters
    ----------
    folder : RunFolder

    Returns
    -------
    Headline
        Out of date where there is no such move.
    """
    name = (folder.axis.name if folder.has_axis else "") or "the axis"
    asked = folder.axis.targets if folder.has_axis else NO_TARGETS
    moves = {n: folder.load("results", n) for n in folder.names("results") if n.startswith("verify_")}
    design, model = folder.load("designs", "final") if "final" in folder.names("designs") else {}, _model_of(folder)
    if not moves:
        doubt = suspect(folder, designed=False)
        parts = [tr("{name}: no move has been driven with a design of this run yet", name=name)]
        parts += [tr(SUSPECT)] if doubt else []
        parts += [tr("its model is of before {names}", names=", ".join(names))] if (names := _since(folder)) else []
        parts += [tr("the design is of an earlier model")] if _outdated(design, model) else []
        return Headline("doubt" if doubt else "open", "; ".join(parts), targets=asked)
    changed = {n: _changed(moves[n], design.get("parameters"), model) for n in moves}
    today = [n for n in moves if not changed[n]]
    last = today[-1] if today else list(moves)[-1]
    told, targets = moves[last], _targets_of(moves[last], asked)
    errors = {place: _error(told, place) for place in ("motor", "carriage")}
    if not today:
        what = tr(" and ").join(tr(one) for one in changed[last])
        text = tr("{name} was verified with {what} than this run has now: {within} then", name=name, what=what, within=_within(errors))
        return Headline("stale", text, last, errors, targets)
    missed = _missed(errors, targets)
    name = tr("{name}, with the gains that stand in the drive,", name=name) if told.get(OWN) else name
    if missed or not told.get("passed"):
        text = tr("{name} misses its target: {missed}", name=name, missed="; ".join(missed) or _within(errors))
        return Headline("fail", f"{text}; {tr(SUSPECT)}" if suspect(folder) else text, last, errors, targets)
    if suspect(folder):
        text = tr("the model does not explain what was measured, though {name} was within {within}", name=name, within=_within(errors))
        return Headline("doubt", text, last, errors, targets)
    if said := told.get("reservations"):
        return Headline("fail", tr("{name} met its targets in this move, but {why}", name=name, why="; ".join(said)), last, errors, targets)
    return Headline("pass", tr("{name} is within {within}", name=name, within=_within(errors)), last, errors, targets)


def _targets_of(result: Mapping[str, Any], asked: AxisTargets) -> AxisTargets:
    """Targets that a move was judged by; those of the axis for a result that does not tell."""
    if (told := result.get("targets")) is None:
        return asked
    known = {*entries_of(AxisTargets), "at", "move"}
    return AxisTargets(**{key: value for key, value in told.items() if key in known and value is not None})


def next_command(folder: RunFolder, headline: Headline, drive: str = "", *, applied: str = "restore", called: str = "") -> NextCommand:
    """The one command that helps most now.

    Parameters
    ----------
    folder : RunFolder
    headline : Headline
        Of the run.
    drive : str
        That of the run unless told.
    applied : str
        What became of the gains.
    called : str
        The folder as a terminal takes it.
    """
    run = pasted(called or folder.path)
    drive = drive or drive_of(folder)
    with_drive = f"--drive {pasted(drive)} --run {run}"
    if folder.has_axis and not folder.axis.has_transmission:
        return NextCommand(f"beltcomm diagnose {run}", tr("what the model misses"))
    if "final" not in folder.names("models"):
        return NextCommand(f"beltcomm fit {run}", tr("a model of the records"))
    design, model = folder.load("designs", "final") if "final" in folder.names("designs") else {}, _model_of(folder)
    if suspect(folder, designed=not _outdated(design, model)):
        return NextCommand(f"beltcomm improve {run}", tr("names what the model lacks, adds it, designs again"))
    since = bool(_since(folder))
    if not design or _outdated(design, model) or since:
        why = tr("gains with margins, of the model as it is now") if design else tr("gains with margins")
        return NextCommand(f"beltcomm design {run}", tr("gains with margins, by a model of all records") if since else why)
    if headline.state in ("open", "stale"):
        return NextCommand(f"beltcomm verify {with_drive}", tr("a move that proves the gains"))
    if folder.load("results", headline.move).get(OWN):
        if headline.good:
            return NextCommand(f"beltcomm report {run}", tr("nothing has to be typed in: the loop in the drive does"))
        return NextCommand(f"beltcomm verify {with_drive}", tr("when the gains are typed in with the maker's tool"))
    if headline.state == "fail":
        return NextCommand(f"beltcomm open {run}", tr("other gains on a page; or state other targets, or a slower move"))
    if folder.drive.get("hardware") == "virtual":
        return NextCommand(f"beltcomm open {run}", tr("model and other gains on a page; a virtual drive keeps none"))
    if applied == "restore":
        return NextCommand(f"beltcomm apply {with_drive}", tr("writes the gains; --save keeps them beyond power-off"), True)
    if applied == "keep":
        return NextCommand(f"beltcomm apply {with_drive} --save", tr("keeps the gains beyond power-off"), True)
    return NextCommand(f"beltcomm report {run}", tr("the page for the file of this machine"))


def behind(folder: RunFolder) -> list[str]:
    """Sentences on what should be made anew before the run's design is driven.

    Parameters
    ----------
    folder : RunFolder

    Returns
    -------
    list of str
        Empty where nothing is behind.
    """
    found, again = [], tr("`beltcomm design {run}` makes it anew", run=pasted(folder.path))
    if names := _since(folder):
        found.append(tr("The run's model was not fitted to {names}, recorded since; {again}.", names=", ".join(names), again=again))
    if _outdated(folder.load("designs", "final") if "final" in folder.names("designs") else {}, _model_of(folder)):
        found.append(tr("The run's design was made from an earlier model; {again}.", again=again))
    return found


def _since(folder: RunFolder) -> list[str]:
    """Records since the fit of the run's model, by name; none where a revision was fitted to them."""
    return unfitted(folder) if current_revision(folder) is None else []


def _outdated(design: Mapping[str, Any], model: Model | None) -> bool:
    return (of := design.get(OF)) is not None and of.get("model") != hashes_of({}, model)["model"]


def drive_of(folder: RunFolder) -> str:
    """Name of a run's drive; DRIVE where it does not tell.

    Parameters
    ----------
    folder : RunFolder

    Returns
    -------
    str
        As for ``--drive``.
    """
    return drive_called(folder) or Reached("DRIVE")


def drive_called(folder: RunFolder) -> Reached | None:
    """Name of a run's drive with the options that it was reached by; None where it does not tell.

    Parameters
    ----------
    folder : RunFolder

    Returns
    -------
    Reached or None
        As for ``--drive``.
    """
    drive = folder.load_result("drive") or {}
    if not drive.get("reached_as"):
        return None
    found = Reached(drive["reached_as"])
    found.options = drive.get("reached_by") or ""
    return found


def _model_of(folder: RunFolder) -> Model | None:
    """The model that a design rests on."""
    try:
        return trusted_model(folder)[0]
    except BeltcommError:
        return None


def _changed(result: Mapping[str, Any], gains: Any, model: Model | None) -> list[str]:
    """Changes since a move was driven."""
    of, driven = result.get(OF), (result.get("proof") or {}).get("gains")
    changed = [] if driven is None or result.get(OWN) or same_gains(driven, gains) else ["other gains"]
    if of is not None and model is not None and of.get("model") != hashes_of({}, model)["model"]:
        changed.append("another model")
    return changed


def _error(result: Mapping[str, Any], place: str) -> dict[str, Any]:
    """Errors at a place, measured where something measures there."""
    measured = result.get("measured") if place == "motor" else result.get("measured_cart")
    told = measured or result.get("predicted" if place == "motor" else "predicted_cart") or {}
    return {
        "following_m": told.get("dynamic_m", math.nan),
        "settled_m": told.get("static_m", math.nan),
        "measured": bool(measured),
    }


def _within(errors: Mapping[str, Mapping[str, Any]]) -> str:
    return ", ".join(
        f"{mm(one['following_m'])} ({tr(place)}{'' if one['measured'] else ', ' + tr('predicted')})"
        for place, one in errors.items()
        if one["following_m"] == one["following_m"]
    )


def _missed(errors: Mapping[str, Mapping[str, Any]], targets: AxisTargets) -> list[str]:
    """Each target that is missed, with value and limit."""
    found = []
    for place in targets.places:
        one = errors[place]
        how = tr(place) if one["measured"] else f"{tr(place)}, {tr('predicted')}"
        if one["following_m"] > targets.following_m:
            value, limit = mm(one["following_m"]), mm(targets.following_m)
            found.append(tr("following error {value} ({how}), allowed {limit}", value=value, how=how, limit=limit))
        if one["settled_m"] > targets.settled_m:
            value, limit = mm(one["settled_m"]), mm(targets.settled_m)
            found.append(tr("{value} off after {s:g} s ({how}), allowed {limit}", value=value, s=targets.after_s, how=how, limit=limit))
    return found


def _hash(value: Any) -> str:
    return digest_of(value)[:12]
