"""The process beside the page: it fits, searches and adds while the page goes on answering; one job after the other.

It hears ``(job, given)`` and tells ``("progress", words, share)``, then ``("view", ResidualView)``, ``("candidate", CandidateEffect)``,
``("done", data)`` or ``("failed", sentence)``; ``("free",)`` when it waits for the next job.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from beltcomm.errors import BeltcommError
from beltcomm.talk import Silence


class TellingTalk(Silence):
    """A talk that tells the page how far it is.

    Parameters
    ----------
    what : str
        Words for the job.
    """

    def __init__(self, tell: Callable[[str, float | None], None], what: str) -> None:
        self._tell, self._what = tell, what

    def phase(self, index: int, count: int, title: str) -> None:
        """Told."""
        self._tell(f"{self._what}: {title}", None)

    def progress(self, fraction: float, seconds_left: float | None) -> None:
        """Told."""
        self._tell(self._what, fraction)


def work(run: Path, pipe: Connection) -> None:
    """Do the jobs that a pipe asks for until it is closed.

    Parameters
    ----------
    run : Path
    pipe : Connection
        Jobs in, answers out.
    """
    while True:
        try:
            job, given = pipe.recv()
        except (EOFError, OSError, KeyboardInterrupt):
            return
        try:
            JOBS[job](run, given, pipe)
        except BeltcommError as problem:
            pipe.send(("failed", str(problem)))
        except (KeyboardInterrupt, BrokenPipeError):  # nobody listens any more
            return
        except Exception as problem:  # the page says it, and the next job begins afresh
            pipe.send(("failed", f"{type(problem).__name__}: {problem}; this is a fault of beltcomm, please report it"))
        pipe.send(("free",))


def _look(run: Path, given: Mapping[str, Any], pipe: Connection) -> None:
    """The view of the present model, then what could explain what it leaves; the search gives way to another job."""
    from beltcomm.app.view import stamp_of, view_of
    from beltcomm.residuals.candidates import candidates_of
    from beltcomm.rundata.fitted_run import open_fitted
    from beltcomm.rundata.kept import FILE

    tell = _teller(pipe)
    stamp = stamp_of(run)
    kept, talk = run.joinpath(*FILE), TellingTalk(tell, "reading the records")
    before = kept.stat().st_mtime_ns if kept.is_file() else 0
    here = open_fitted(run, talk)
    if kept.is_file() and kept.stat().st_mtime_ns != before:  # fitted anew: shown as every later command reads it, to the last digit
        here = open_fitted(run, talk)
    tell("comparing model and records", None)
    view = view_of(here, stamp)
    pipe.send(("view", view))
    searched = "weighing what could explain the rest"
    for one in candidates_of(here.fitted, view.cells, here.folder.axis, lambda share: tell(searched, share)):
        pipe.send(("candidate", one))
        if pipe.poll():
            return
    pipe.send(("searched",))


def _add(run: Path, given: Mapping[str, Any], pipe: Connection) -> None:
    """One more effect, then what it costs in tracking not to know it."""
    from beltcomm.jobs.change import add_to_run
    from beltcomm.rundata.cost import cost_and_words
    from beltcomm.rundata.revisions import keep_cost, model_named, revisions
    from beltcomm.runfolder import RunFolder

    effect, tell = given["effect"], _teller(pipe)
    talk = TellingTalk(tell, f"adding {effect}, everything is fitted again")
    result = add_to_run(effect, run, pictures=False, cost=False, command=f"beltcomm open, + {effect}", when=given["when"], talk=talk)
    pipe.send(("done", {"job": "add", "effect": effect, **dict(result.to_json())}))
    _look(run, {}, pipe)
    if pipe.poll():
        return
    tell(f"what {effect} costs in tracking", None)
    folder = RunFolder.open(run)
    newest = {rung.name: rung for rung in revisions(folder)}.get(result.data["revision"])
    if newest is not None and newest.parent:
        price, _ = cost_and_words(folder, model_named(folder, newest.parent), model_named(folder, newest.name), effect)
        keep_cost(folder, newest.name, None if price is None else {"of": effect, **price})
        pipe.send(("done", {"job": "cost", "effect": effect}))


def _remove(run: Path, given: Mapping[str, Any], pipe: Connection) -> None:
    """Everything fitted again without an effect."""
    from beltcomm.jobs.change import remove_from_run

    effect = given["effect"]
    talk = TellingTalk(_teller(pipe), f"taking {effect} out, everything is fitted again")
    result = remove_from_run(effect, run, pictures=False, command=f"beltcomm open, - {effect}", when=given["when"], talk=talk)
    pipe.send(("done", {"job": "remove", "effect": effect, **dict(result.to_json())}))
    _look(run, {}, pipe)


def _evidence(run: Path, given: Mapping[str, Any], pipe: Connection) -> None:
    """The whole search, as ``diagnose --next`` does it: evidence, records held out, runner-up, what would tell them apart."""
    from beltcomm.jobs.laboratory import diagnose_run
    from beltcomm.sentences.laboratory import verdict_state

    talk = TellingTalk(_teller(pipe), "refitting the best effects with everything free")
    result = diagnose_run(run, cost=False, following=True, command="beltcomm open", when=given["when"], talk=talk)
    word, sentence, _ = verdict_state(result.data["verdict"], result.data["named"])
    said = {"state": {"word": word, "sentence": sentence}, "lines": [str(line) for line in result.text]}
    pipe.send(("done", {"job": "evidence", **dict(result.to_json()), **said}))


JOBS: Mapping[str, Callable[[Path, Mapping[str, Any], Connection], None]] = {
    "look": _look,
    "add": _add,
    "remove": _remove,
    "evidence": _evidence,
}


def _teller(pipe: Connection) -> Callable[[str, float | None], None]:
    """Tells of progress in steps of a twentieth."""
    last: list[object] = [None]

    def tell(words: str, share: float | None) -> None:
        step = (words, None if share is None else int(20.0 * share))
        if step != last[0]:
            last[0] = step
            pipe.send(("progress", words, share))

    return tell
