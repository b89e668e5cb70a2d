"""``beltcomm open``: one page on a run, for the browser of this computer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from beltcomm.app.design import DesignTab
from beltcomm.app.laboratory import LaboratoryTab
from beltcomm.app.live import LiveTab
from beltcomm.app.runs import RunsTab
from beltcomm.experiments.options import Options
from beltcomm.given import Place, place
from beltcomm.result import Result
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence, Talk


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
        RunFolder.open(run)  # says what is wrong before a page opens
        self._run = run
        self.runs, self.live = RunsTab(run), LiveTab(run)
        self.laboratory = LaboratoryTab(run, when, self.live.running)
        self.design = DesignTab(run, payload_kg=payload_kg, move=move, seed=seed)

    def answers(self) -> Mapping[str, Callable[[Any], Mapping[str, Any]]]:
        """By the name under which the page asks, ``TAB-NAME``."""
        tabs = {
            "laboratory": self.laboratory.answers(),
            "design": self.design.answers(),
            "runs": self.runs.answers(),
            "live": self.live.answers(),
        }
        found: dict[str, Callable[[Any], Mapping[str, Any]]] = {"begin": lambda _: self.begin()}
        for tab, answers in tabs.items():
            found |= {f"{tab}-{name}": answer for name, answer in answers.items()}
        return found

    def begin(self) -> dict[str, Any]:
        """Head of the page."""
        folder = RunFolder.open(self._run)
        return {"run": str(self._run), "axis": folder.axis.name if folder.has_axis else "", "live": self.live.running()}

    def close(self) -> None:
        """End what runs beside it."""
        self.laboratory.close()


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
    page = RunPage(run, payload_kg=options.payload_kg or 0.0, move=move, seed=options.seed or 0, when=when)
    try:
        with serve(PAGE, page.answers(), token, port) as served:
            talk.say(f"the page is at {served.address} ; Ctrl-C ends it")
            if opened is not None:
                opened(served.address)
            served.run()
    finally:
        page.close()
    saved = page.design.saved
    if not saved:
        return Result({"run": str(run), "saved": 0}, [f"No design was saved; that of {run} is as it was."])
    last = saved[-1]
    return Result({**last.data, "saved": len(saved)}, last.text, last.exit_code)
