"""A virtual session that the page starts: which drives it may have, one at a time, stopped by a button, and the run that it makes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest

from beltcomm import isolation
from beltcomm.app.serve import RunPages
from beltcomm.app.session import VirtualSession
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.errors import UsageError
from beltcomm.locks import occupied
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence

Copy = Callable[..., Path]
STAMP = "2026-11-26T18:02:03"


class Ended:
    """A process that has ended and said nothing."""

    def __init__(self) -> None:
        self.stdout = BytesIO(b"")

    def poll(self) -> int:
        return 0


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """Words of every command that would have been started."""
    found: list[list[str]] = []

    def session(command: list[str]) -> Ended:
        found.append(command[command.index("beltcomm") + 1 :])
        return Ended()

    monkeypatch.setattr(isolation, "session", session)
    return found


@pytest.fixture
def pages(copy_of_complete: Copy) -> Iterator[RunPages]:
    opened = RunPages(copy_of_complete("frf_[2-9]", "sweep*", "amplitude*"), when=lambda: STAMP)
    yield opened
    opened.close()


def reached(run: Path, called: object, by: object) -> None:
    """Say in a run folder how its drive was reached, as a stranger could."""
    folder = RunFolder.open(run)
    write_text(folder.file("results", "drive"), to_yaml({**(folder.load_result("drive") or {}), "reached_as": called, "reached_by": by}))


def asked(pages: RunPages, name: str, data: object = None, run: str = "") -> Any:
    return pages.answers()[name]({"run": run, "asked": data or {}})


START = {"kind": "identify", "drive": "own", "realtime": False}


@pytest.mark.parametrize("called", ["can0", "slcan:virtual", "can:virtual", "serial:virtual", "Virtual", "", None])
def test_a_drive_that_may_be_real_is_not_started(pages: RunPages, typed: list[list[str]], called: object) -> None:
    run = pages.first.run
    reached(run, called, "--as epos4")
    assert set(asked(pages, "session-offers")["drives"]) == {"model", "shipped"}
    for drive in ("own", "can0", "virtual", "shipped --drive can0", None, ["own"]):
        with pytest.raises(UsageError, match="only a virtual drive"):
            asked(pages, "session-start", {**START, "drive": drive})
    assert typed == []
    asked(pages, "session-start", {**START, "drive": "shipped"})
    assert typed[0][: typed[0].index("--axis")] == ["identify", "--drive", "virtual"]


def test_of_a_strangers_folder_two_options_reach_the_command(pages: RunPages, typed: list[list[str]]) -> None:
    reached(pages.first.run, "virtual:g_b", "--as epos4 --drive can0 --run /elsewhere --profile -x")
    state = asked(pages, "session-start", START | {"kind": "quick", "realtime": True})
    folder = pages.first.run.parent / "egc-70-600-20261126-180203"
    axis = str(pages.first.run / "axis.yaml")
    options = ["--as=epos4", "--profile=-x", "--axis", axis, "--run", str(folder), "--yes", "--realtime"]
    assert typed == [["commission", "--quick", "--drive", "virtual:g_b", *options]]
    assert (state["name"], state["made"]) == (folder.name, False)


def test_what_no_page_asks_is_refused(pages: RunPages, typed: list[list[str]]) -> None:
    for wrong in ({}, {**START, "kind": "apply"}, {**START, "realtime": 1}, {**START, "force": True}, None, []):
        with pytest.raises(UsageError):
            asked(pages, "session-start", wrong)
    for name in ("..", ".", "../..", "elsewhere", "/etc", "a/b"):
        with pytest.raises(UsageError, match="there is no run"):
            asked(pages, "begin", run=name)
    with pytest.raises(UsageError, match="a question is"):
        pages.answers()["begin"]({"asked": {}})
    assert typed == []


@pytest.mark.examination
def test_it_makes_a_run_of_its_own_and_stops_at_the_button(pages: RunPages) -> None:
    """On the machine that is the run's model; another one beside it is refused, and so is one beside a session on a machine."""
    before = asked(pages, "runs-list")["runs"]
    asked(pages, "session-start", {**START, "drive": "model"})
    with pytest.raises(UsageError, match="one virtual session at a time"):
        asked(pages, "session-start", {**START, "drive": "model"})
    ended(pages.session)
    state = asked(pages, "session-state")
    assert (state["running"], state["code"], state["made"]) == (False, 0, True)
    assert any("MEASURED" in line for line in state["lines"])
    assert {one["name"] for one in asked(pages, "runs-list")["runs"]} - {one["name"] for one in before} == {state["name"]}
    shown = asked(pages, "live-state", run=state["name"])
    assert (shown["done"][-1], shown["phase"]["title"], shown["running"]) == ("frf_1", "frequency response here", False)
    assert shown["planned_s"] > 10.0
    asked(pages, "session-start", {**START, "kind": "commission", "drive": "model", "realtime": True})
    second = pages.session.run
    assert second is not None
    assert second.name == f"{state['name']}-2"
    while not (second / "journal.txt").is_file():
        assert pages.session.running
        time.sleep(0.05)
    assert asked(pages, "session-stop")["stopping"]
    ended(pages.session)
    assert asked(pages, "session-state")["code"] == 4
    assert not (second / ".lock").exists()


def ended(session: VirtualSession) -> None:
    """Wait for its end, and until all that it said is heard."""
    assert session._process is not None
    session._process.wait(300.0)
    session._listener.join(10.0)


def test_none_beside_a_command_at_work(pages: RunPages, typed: list[list[str]]) -> None:
    """In this run or in one beside it: it may move a machine, which needs the computer in time.   A lock that a killed one left is none."""
    other = pages.first.run.parent / "other"
    other.mkdir()
    (other / ".lock").touch()
    asked(pages, "session-start", START | {"drive": "shipped"})
    assert len(typed) == 1
    with occupied(other, Silence()), pytest.raises(UsageError, match="a command is at work in other"):
        asked(pages, "session-start", START | {"drive": "shipped"})
    assert len(typed) == 1
