"""The answer of before is given again while nothing that it rests on has changed, and never afterwards."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from beltcomm.axis import load_axis
from beltcomm.result import Result, Row
from beltcomm.rundata.kept import kept_or_new
from beltcomm.runfolder import RunFolder

Ask = Callable[..., Result]


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    return RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))


@pytest.fixture
def ask(folder: RunFolder) -> Ask:
    """Asks; the answer counts how often it was worked out."""
    times: list[int] = []

    def make() -> Result:
        times.append(1)
        picture = folder.path / "pictures" / "one.png"
        picture.parent.mkdir(exist_ok=True)
        picture.write_bytes(b"drawn")
        data = {"times": len(times), "worst": float("inf"), "pictures": ["pictures/one.png"]}
        return Result(data, [Row("a  b", ("a", "b"), (False, True)), "c"], 1)

    return lambda *question: kept_or_new(folder, "diagnosis", question, make, drawn=True)


def test_the_same_question_is_answered_as_before(ask: Ask, folder: RunFolder) -> None:
    first, again = ask("quick"), ask("quick")
    assert (again.data, again.text, again.exit_code) == (first.data, first.text, 1)
    assert isinstance(again.text[0], Row)
    assert again.text[0].cells == ("a", "b")
    folder.save("results", "diagnosis", again.data)  # its own place among the results
    folder.journal("a command was called")
    assert ask("quick").data["times"] == 1
    assert ask("thorough").data["times"] == 2


@pytest.mark.parametrize("changed", ["axis.yaml", "recordings/frf_1.csv", "results/fit.yaml", "models/01.yaml"])
def test_a_file_that_changes_asks_anew(ask: Ask, folder: RunFolder, changed: str) -> None:
    ask()
    path = folder.path / changed
    path.parent.mkdir(exist_ok=True)
    path.write_text((path.read_text(encoding="utf-8") if path.exists() else "") + "# another\n", encoding="utf-8")
    assert ask().data["times"] == 2


@pytest.mark.parametrize("damage", ["", "[]", "{", '{"key": 1}', '{"data": {}}'])
def test_what_was_kept_may_be_damaged_or_gone(ask: Ask, folder: RunFolder, damage: str) -> None:
    ask()
    (folder.path / "kept" / "diagnosis.json").write_text(damage, encoding="utf-8")
    assert ask().data["times"] == 2


def test_other_programs_ask_anew(ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    ask()
    monkeypatch.setattr("beltcomm.rundata.kept.source_hash", lambda: "another version")
    assert ask().data["times"] == 2


def test_a_picture_that_is_gone_is_drawn_again(ask: Ask, folder: RunFolder) -> None:
    ask()
    (folder.path / "pictures" / "one.png").unlink()
    assert ask().data["times"] == 2
    assert (folder.path / "pictures" / "one.png").is_file()


def test_a_file_that_cannot_be_read_is_no_reason_to_fail(ask: Ask, folder: RunFolder, monkeypatch: pytest.MonkeyPatch) -> None:
    def unreadable(path: Path) -> str:
        raise PermissionError(13, "not allowed", str(path))

    monkeypatch.setattr("beltcomm.rundata.kept.sha256_of", unreadable)
    assert ask().data["times"] == 1
    assert ask().data["times"] == 2
    assert not (folder.path / "kept").exists()
