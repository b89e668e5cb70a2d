"""``beltcomm open``: one page on a run and those beside it, for the browser of this computer."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from beltcomm.app.design import DesignTab
from beltcomm.app.laboratory import LaboratoryTab
from beltcomm.app.live import LiveTab
from beltcomm.app.runs import RunsTab, beside
from beltcomm.app.session import VirtualSession
from beltcomm.errors import BeltcommError, UsageError
from beltcomm.experiments.options import Options
from beltcomm.given import Place, place
from beltcomm.locks import is_occupied
from beltcomm.result import Result, plain
from beltcomm.rundata.headline import MEANINGS, headline_of, next_command
from beltcomm.runfolder import RunFolder
from beltcomm.sentences.screens import warnings
from beltcomm.talk import Silence, Talk

#: Runs beside the first one that are held ready.
MOST_OPEN = 3


class RunPage:
    """All tabs of one run.

    Parameters
    ----------
    move : Path or None
        File with the user's own.
    seed : int
        Of the draws of a proof.
    when : callable
        Date and time, as text.
    """

    def __init__(
        self, run: Path, *, payload_kg: float = 0.0, move: Path | None = None, seed: int = 0, when: Callable[[], str] = str
    ) -> None:
        folder = RunFolder.open(run)  # says what is wrong before a page opens
        self.run, self._terms = run, folder.terms
        self.runs, self.live = RunsTab(run), LiveTab(run)
        self.laboratory = LaboratoryTab(run, when, self.live.running)
        self.design = DesignTab(run, payload_kg=payload_kg, move=move, seed=seed)
        self.answers = self._answers()

    def _answers(self) -> dict[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks, ``TAB-NAME``."""
        tabs = {
            "laboratory": self.laboratory.answers(),
            "design": self.design.answers(),
            "runs": self.runs.answers(),
            "live": self.live.answers(),
        }
        found: dict[str, Callable[[Any], Mapping[str, Any]]] = {"begin": lambda _: self.begin(), "words": self.words}
        for tab, answers in tabs.items():
            found |= {f"{tab}-{name}": answer for name, answer in answers.items()}
        return found

    def begin(self) -> dict[str, Any]:
        """Head of the page."""
        folder = RunFolder.open(self.run)
        try:
            headline = headline_of(folder)
            session, step = folder.load_result(headline.move or "fit") or {}, next_command(folder, headline)
            said = {
                "word": headline.word,
                "sentence": headline.sentence,
                "means": MEANINGS[headline.state],
                "warnings": warnings(session, self.laboratory.sheets),
                "next": {} if step.command.startswith("beltcomm open ") else plain(step),
            }
        except BeltcommError as problem:  # one damaged result hides no record
            said = {"word": "", "sentence": str(problem), "means": "bad", "warnings": [], "next": {}}
        return {
            "run": str(self.run),
            "headline": said,
            "axis": folder.axis.name if folder.has_axis else "",
            "own_words": bool(self._terms),
            "live": self.live.running(),
        }

    def words(self, asked: Any) -> dict[str, Any]:
        """Texts of the page in the words and units of the kind of axis, as text and as label of an axis with its factor.

        Parameters
        ----------
        asked : Any
            ``texts``: a list of str.

        Raises
        ------
        UsageError
            For what is no list of texts.
        """
        texts = asked.get("texts") if isinstance(asked, Mapping) else None
        if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
            raise UsageError("give texts: a list of them")
        return {"texts": [self._terms.said(text) for text in texts], "labels": [self._terms.label(text) for text in texts]}

    def close(self) -> None:
        """End what runs beside it."""
        self.laboratory.close()


class RunPages:
    """The run that is opened, those beside it that the page goes on to, and the virtual session that it may start.

    A question is ``{"run": NAME, "asked": ...}``: the name of a run beside the first one, "" for that one.
    """

    def __init__(self, run: Path, *, when: Callable[[], str] = str, **settings: Any) -> None:
        self._settings = {**settings, "when": when}
        self.first, self.session = RunPage(run, **self._settings), VirtualSession(when)
        self._others: dict[str, RunPage] = {}
        self._lock = threading.Lock()
        #: Designs that were saved, of whatever run.
        self.saved: list[Result] = self.first.design.saved

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks."""
        of_run = {name: lambda asked, name=name: self._of(asked).answers[name](asked["asked"]) for name in self.first.answers}
        return of_run | {
            "session-state": lambda _: self.session.state(),
            "session-offers": lambda asked: self.session.offers(self._of(asked).run),
            "session-start": self._start,
            "session-stop": lambda _: self.session.stop(),
        }

    def close(self) -> None:
        """End what runs beside it."""
        self.session.close()
        for page in (self.first, *self._others.values()):
            page.close()

    def _start(self, asked: Any) -> dict[str, Any]:
        page = self._of(asked)
        busy = [folder.name for folder in sorted(self.first.run.resolve().parent.iterdir()) if is_occupied(folder)]
        if busy and not self.session.running:
            raise UsageError(f"a command is at work in {busy[0]}; wait for its end: a machine that moves may need this computer in time")
        return self.session.start(page.run, asked["asked"])

    def _of(self, asked: Any) -> RunPage:
        """The page of the run that is asked about.   Raises UsageError for none beside the first."""
        if not isinstance(asked, dict) or set(asked) != {"run", "asked"} or not isinstance(asked["run"], str):
            raise UsageError("a question is the name of a run, and what is asked of it")
        name = asked["run"]
        if name in ("", self.first.run.resolve().name):
            return self.first
        with self._lock:
            if (page := self._others.pop(name, None)) is None:
                page = RunPage(beside(self.first.run, name), **self._settings)
                page.design.saved = self.saved
            self._others[name] = page  # the one asked last stands last
            while len(self._others) > MOST_OPEN:
                self._others.pop(next(iter(self._others))).close()
            return page


def open_page(
    run: Place,
    *,
    token: str,
    port: int = 0,
    move: Place | None = None,
    opened: Callable[[str], object] | None = None,
    when: Callable[[], str] = str,
    options: Options | None = None,
    talk: Talk | None = None,
) -> Result:
    """Serve the page of a run on 127.0.0.1 until KeyboardInterrupt.

    Parameters
    ----------
    run : Place
        Run folder.
    token : str
        Secret part of its address.
    port : int
        0 takes a free one.
    move : Place or None
        A file with the reference motion; None for that of the axis.
    opened : callable or None
        Called with the address, as a browser would be.
    when : callable
        Date and time as text, for the models that are made on the page.
    options : Options or None
        Settings beside the main arguments; None for the safe defaults.
    talk : Talk or None
        Hears where the page is; None says nothing.

    Returns
    -------
    Result
        The last design saved; exit code 1 when it is not to be used.

    Raises
    ------
    DataError
        For a folder that is no run.
    UsageError
        For a port that is taken.
    """
    from beltcomm.web.server import PAGE, serve  # no other command needs a web server

    run, options, talk = place(run), options or Options(), talk or Silence()
    move = None if move is None else place(move, "move")
    page = RunPages(run, payload_kg=options.payload_kg or 0.0, move=move, seed=options.seed or 0, when=when)
    try:
        with serve(PAGE, page.answers(), token, port) as served:
            talk.say(f"the page is at {served.address} ; Ctrl-C ends it")
            if opened is not None:
                opened(served.address)
            served.run()
    finally:
        page.close()
    saved = page.saved
    if not saved:
        return Result({"run": str(run), "saved": 0}, [f"No design was saved; that of {run} is as it was."])
    last = saved[-1]
    return Result({**last.data, "saved": len(saved)}, last.text, last.exit_code)
