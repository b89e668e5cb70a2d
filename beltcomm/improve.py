"""``beltcomm improve``: what a model lacks is named and added, the gains are designed again and proven; before and after.

Each step is the public function behind a command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from beltcomm import api
from beltcomm.effects import effect_named
from beltcomm.errors import BeltcommError, Refused
from beltcomm.experiments.options import Options, given
from beltcomm.given import Place, pasted, place
from beltcomm.language import tr
from beltcomm.quantities import mm
from beltcomm.result import Line, Result
from beltcomm.rundata.headline import NextCommand, headline_of, next_command
from beltcomm.rundata.revisions import Revision, revisions
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import screens
from beltcomm.sentences.laboratory import verdict_state
from beltcomm.sentences.own_words import own_words
from beltcomm.talk import Silence, Talk


@own_words
def improve(
    run: Place, drive: str | None = None, *, options: Options | None = None, command: str = "", when: str = "", talk: Talk | None = None
) -> Result:
    """Diagnose, add what is confirmed, design, with a ``drive`` verify.

    Parameters
    ----------
    run : Place
    drive : str or None
        As of ``--drive``; without one nothing moves and the design is not verified.
    options : Options or None
    command, when : str
        Noted with the revisions.
    talk : Talk or None

    Returns
    -------
    Result
        Exit code 1: nothing was named, or a target is missed.

    Raises
    ------
    Refused
        For a run without a model; else as the single functions.
    """
    options, talk, run = given(options), talk or Silence(), place(run)
    if "final" not in RunFolder.open(run).names("models"):
        raise Refused(f"{run} has no model to improve yet; make one with `beltcomm fit {pasted(run)}`")
    before = headline_of(RunFolder.open(run))
    found = api.diagnose(run, auto=True, command=command, when=when, talk=talk)
    data = dict(found.to_json())
    added = [step["added"] for step in data["steps"] if step["added"]]
    made = data.get("revisions") or []
    if not made:  # what was named is not sure, or not confirmed by records held out
        return _nothing(run, data, found, added)
    designed = api.design(run, command=command, options=options, talk=talk)
    verified, stopped = None, None
    if drive is not None:
        try:
            verified = api.verify(drive, run, options=replace(options, payload_kg=None), talk=talk)
        except BeltcommError as problem:  # what was added and designed stands all the same, and is told first
            stopped = problem
    folder = RunFolder.open(run)
    after = headline_of(folder)
    errors = _errors(before.errors, after.errors if verified is not None else None, data.get("cost"))
    old, new = _ratios(made, revisions(folder))
    told = tr("{names} named and added: error {old:.3g} -> {new:.3g} x the noise", names=", ".join(added), old=old, new=new)
    text = [
        Line(""),
        Line("  ", (tr("IMPROVED"), "good"), "   ", (told, "title")),
        Line(""),
        *_rows(errors),
        *(Line("   ", (f"{tr('check'):<9}", "title"), check) for check in _checks(added)),
        *[line for line in designed.text if isinstance(line, Line) and line.strip().startswith((tr("gains"), tr("loop")))],
        *screens.headline_lines(after),
        *screens.next_lines(next_command(folder, after, drive or "")),
    ]
    if stopped is not None:
        talk.say(*text)
        raise stopped
    result = {
        "run": str(run),
        "added": added,
        "revisions": made,
        "errors": errors,
        "headline_before": before.to_dict(),
        "headline": after.to_dict(),
        "cost": data.get("cost"),
    }
    code = max(designed.exit_code, verified.exit_code if verified is not None else 0)
    return Result(result, text, code, details=[*found.text, *found.details, "", *designed.details, *(verified.details if verified else ())])


def _nothing(run: Any, data: Mapping[str, Any], found: Result, named: list[str]) -> Result:
    """Nothing was confirmed, so nothing is changed: why, and what a person can do who believes it all the same."""
    verdict, names = data["verdict"], ", ".join(named)
    step = NextCommand(f"beltcomm compare {pasted(run)}", tr("where the error sits"))
    if verdict == "nothing missing":
        word, said, style = verdict_state(verdict, ())
        state = (word, style)
        step = NextCommand(f"beltcomm open {pasted(run)}", tr("other gains on a page"))
    elif not named:
        state, said = (tr("NOT IMPROVED"), "note"), tr("no effect was named; what diagnose says of it: --details")
    else:
        judged = any(one["held_out_gain"] is not None for one in data["ranking"] if one["effect"] in named)
        state = (tr("NOT ADDED"), "note")
        said = tr("{names}: these records cannot tell it from another effect", names=names)
        if verdict != "cannot tell":
            against = tr("{names}: held-out records do not confirm it", names=names)
            said = against if judged else tr("{names}: no held-out record confirms it", names=names)
            step = NextCommand(f"beltcomm add {named[0]} {pasted(run)}", tr("fits everything again with it, on your word"))
    text = [Line(""), Line("  ", state, "   ", (said, "title")), Line("")]
    if named and verdict != "cannot tell" and not judged:
        text += [Line("   ", tr("a second sweep (`beltcomm friction`) is held out and would judge it"))]
    text += screens.next_lines(step)
    code = 0 if verdict == "nothing missing" else 1
    return Result({"run": str(run), "added": [], "verdict": verdict}, text, code, details=[*found.text, *found.details])


def _ratios(made: Sequence[Mapping[str, Any]], every: Sequence[Revision]) -> tuple[float, float]:
    """Error over noise before the revisions that were made, and after: the first stands on one of an earlier command, or is the base."""
    known = {rung.name: rung.ratio for rung in every}
    return known.get(made[0]["parent"], made[0]["ratio"]), made[-1]["ratio"]


def _errors(before: Mapping[str, Any] | None, after: Mapping[str, Any] | None, cost: Mapping[str, Any] | None) -> dict[str, Any]:
    """Following error at motor and carriage, m, before and after: measured where both moves were driven, else predicted by the model that
    knows what was missing: what the one before predicts, which lacks it, is no error that the axis had.
    """
    found = {}
    for place_, key in (("motor", "unaware"), ("carriage", "unaware_cart")):
        if before is not None and after is not None and before[place_]["measured"] and after[place_]["measured"]:
            found[place_] = {
                "before_m": before[place_]["following_m"],
                "after_m": after[place_]["following_m"],
                "how": "measured",
            }
        elif cost and cost.get(key):
            aware = key.replace("unaware", "aware")
            found[place_] = {"before_m": cost[key]["dynamic_m"], "after_m": cost[aware]["dynamic_m"], "how": "predicted"}
    return found


def _rows(errors: Mapping[str, Any]) -> list[Line]:
    if not errors:
        return [Line("   ", tr("what it brings in tracking cannot be said without a move"))]
    head = Line(" " * 29, (f"{tr('before'):<11}{tr('after'):<11}", "soft"))
    return [
        head,
        *(
            Line(
                "   ",
                f"{tr('following error')}, {tr(where)}".ljust(26),
                mm(one["before_m"]).ljust(11),
                (mm(one["after_m"]).ljust(11), "good" if one["after_m"] < one["before_m"] else "note"),
                tr(one["how"]),
            )
            for where, one in errors.items()
        ),
    ]


def _checks(added: list[str]) -> list[str]:
    """Checks on the machine for each effect."""
    return list(dict.fromkeys(effect_named(name).check[:68] for name in added))
