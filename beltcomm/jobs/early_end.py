"""A session that cannot go on: what it found is kept, and its records are searched for what is wrong with the axis."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import wraps
from typing import Any, ParamSpec

from beltcomm import caches
from beltcomm.caches import source_hash
from beltcomm.effects import effect_named
from beltcomm.errors import BeltcommError, Declined, DriveError, SafetyStop
from beltcomm.experiments.options import Options
from beltcomm.given import pasted
from beltcomm.machine.machine import Machine
from beltcomm.result import Result, with_unit
from beltcomm.rundata.findings import Findings
from beltcomm.rundata.kept import hashes
from beltcomm.runfolder import RunFolder
from beltcomm.sentences import outcome
from beltcomm.talk import Silence, Talk

P = ParamSpec("P")

#: Effects that the search names at most: the first ones are what stopped the session, and somebody waits at the machine.
MOST_NAMED = 2
#: Where it stands in a run folder: nothing that anybody must keep.
FILE = ("kept", "early_end.json")
#: Reasons of a stop that say nothing of the axis.
NOT_THE_AXIS = ("interrupted", "lost_frames", "heat")


@contextmanager
def kept(machine: Machine, findings: Findings) -> Iterator[None]:
    """Around the phases of a session: whatever ends them, what was found is saved, and an error knows the run that it ended.

    Parameters
    ----------
    machine : Machine
        The axis behind its drive.
    findings : Findings
        Filled by the phases.
    """
    try:
        yield
    except BeltcommError as problem:
        problem.run = machine.folder.path
        raise
    finally:
        findings.machine_seconds = machine.machine_seconds
        findings.remarks += machine.remarks
        outcome.save(machine.folder, findings)


def searched(job: Callable[P, Result]) -> Callable[P, Result]:
    """A job on a machine with ``options`` and ``talk``; where its phases end early, the error gets a :attr:`BeltcommError.diagnosis`.

    With :attr:`Options.search` only.   The axis is stopped and the drive restored before the search begins.

    Parameters
    ----------
    job : callable
        From arguments to a result.
    """

    @wraps(job)
    def wrapper(*args: P.args, **kwargs: P.kwargs) -> Result:
        try:
            return job(*args, **kwargs)
        except BeltcommError as problem:
            options, talk = kwargs.get("options"), kwargs.get("talk")
            if problem.run is not None and isinstance(options, Options) and options.search and _by_the_axis(problem):
                problem.diagnosis = _early_end(RunFolder.open(problem.run), problem, talk or Silence())  # type: ignore[arg-type]
            raise

    return wrapper


def _by_the_axis(problem: BeltcommError) -> bool:
    """True if an error can come from the axis: not from a no, from drive and bus, or from whoever stopped it."""
    if isinstance(problem, SafetyStop):
        return problem.reason not in NOT_THE_AXIS
    return not isinstance(problem, (Declined, DriveError))


def _early_end(folder: RunFolder, problem: BeltcommError, talk: Talk) -> Mapping[str, object] | None:
    """Diagnosis of the complete records of a run that ended early; None without any, or where the search was broken off.

    ``found``, ``check`` : sentences.   ``verdict``, ``named`` : of the search.   ``repeated`` : the session before ended with the same
    records, so that going on leads nowhere.   Searched once per set of records; whatever is wrong with the search, ``problem`` stands.
    """
    command = {"command": f"beltcomm diagnose {pasted(folder.path)}"}
    try:
        names = folder.finished_names()
        key = _key(folder)
        if not names:
            return None
        known = _known(folder, key)
        if known is None:
            talk.say(
                f"This session ends here. Its {len(names)} record{' is' if len(names) == 1 else 's are'} searched for what is wrong with "
                "the axis, 10 to 60 s; nothing moves (Ctrl-C skips it)."
            )
            known = {**_search(folder, talk), "repeated": False}
        told = {**known, **command}
        _keep(folder, key, {**known, "repeated": True})
        outcome.keep_text(folder, [f"Not finished: {problem}", *_lines(told)])
        return told
    except KeyboardInterrupt:  # one who waits for nothing has still to hear why the session ended
        return None
    except Exception as trouble:  # the error that ended the session must be shown, whatever is wrong with the search
        return {"found": f"cannot tell ({trouble})", "check": "", "verdict": "", "named": [], "repeated": False, **command}


def _lines(told: Mapping[str, object]) -> list[str]:
    """For people."""
    check = [f"Check: {told['check']}"] if told["check"] else []
    return [f"Found: {told['found']}", *check, f"Next: {told['command']}   (shows all of it)"]


def _search(folder: RunFolder, talk: Talk) -> dict[str, Any]:
    """The search itself.   Raises DataError for records that nothing can be said of."""
    from beltcomm.fit.uncertainty.intervals import with_intervals
    from beltcomm.jobs.effect_search import search_of
    from beltcomm.laboratory.cross_checks import doubts_of
    from beltcomm.sentences.cross_checks import sheet_lines

    try:
        records, found, remarks = search_of(folder, talk, MOST_NAMED)
    except BeltcommError as trouble:
        return {"found": f"cannot tell: {trouble}", "check": "", "verdict": "", "named": []}
    model = with_intervals(found.final_fit)
    sheets = () if found.added_effects else doubts_of(found.final_fit, folder.axis, records.recordings)
    odd = [str(line) for line in sheet_lines(sheets)]
    error = f"the error falls from {found.published_base[1].ratio:.3g} to {found.final_fit.ratio:.3g} times the noise"
    if found.added_effects:
        said = []
        for name in found.added_effects:
            effect = effect_named(name)
            first = effect.full_names()[0]
            item = model.parameters[first]
            width = "" if item.interval is None else f" ± {item.interval:.2g}"
            said.append(f"{effect.title} ({with_unit(f'{first} {item.value:.3g}{width}', item.unit)})")
        twin = f"; or {effect_named(found.twins[1]).title}, which these records cannot tell from it" if found.twins else ""
        text = f"{' and '.join(said)}: {found.verdict}, {error}{twin}"
        checks = list(dict.fromkeys(effect_named(name).check for name in found.added_effects))
    else:
        text = f"{found.verdict}, the error is {found.published_base[1].ratio:.3g} times the noise"
        if found.verdict == "nothing missing":
            text = f"the records up to here are those of a sound axis ({text})"
        checks = remarks[:1]
    if odd:
        text += f". {odd[0]}"
        checks += [line.strip() for line in odd if line.strip().startswith("Check")]
    return {
        "found": text,
        "check": "; ".join(check.rstrip(".") for check in checks),
        "verdict": found.verdict,
        "named": found.added_effects,
    }


def _key(folder: RunFolder) -> str:
    """Equal only for the same records, axis file and programs."""
    text = json.dumps([sorted(hashes(folder).items()), folder.axis.fingerprint(), source_hash()])
    return hashlib.sha256(text.encode()).hexdigest()


def _known(folder: RunFolder, key: str) -> dict[str, Any] | None:
    path = folder.path.joinpath(*FILE)
    found = caches.found(path, key)
    try:
        return dict(found["told"]) if found else None
    except (ValueError, KeyError, TypeError):
        caches.damaged(path)
        return None


def _keep(folder: RunFolder, key: str, told: Mapping[str, Any]) -> None:
    caches.keep(folder.path.joinpath(*FILE), key, {"told": told})
