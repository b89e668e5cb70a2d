"""The same change of a model typed again, as after a power cut that came behind the saving: it shows what it made, and fits nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from beltcomm.jobs import change, rungs
from beltcomm.recording.signalfile import write_columns
from beltcomm.rundata.revisions import revisions
from beltcomm.runfolder import RunFolder
from laboratory.test_loads import INERTIA, MOTOR_ALONE, turning

EFFECT = "quadratic_drag"


class PowerCut(BaseException):
    """Ends a process wherever it is."""


def call(*words: str) -> Result:
    return CliRunner().invoke(cli, words)


def typed(verb: str, run: Path, *more: str) -> dict[str, Any]:
    """What programs are told; it ended as done."""
    outcome = call(verb, EFFECT, str(run), "--no-pictures", "--json", *more)
    assert outcome.exit_code == 0, outcome.output
    return dict(json.loads(outcome.stdout))


def cut(*_: object) -> None:
    raise PowerCut


def changes(run: Path) -> list[str]:
    return [rung.change for rung in revisions(RunFolder.open(run))]


@pytest.fixture
def run(tmp_path: Path) -> Path:
    settings = [part for word in MOTOR_ALONE for part in ("--set", word)]
    for name, seed in (("a", 1), ("held", 2)):
        write_columns(tmp_path / f"{name}.csv", turning(seed, INERTIA, 1500))
        held = ["--held-out"] if name == "held" else settings
        assert call("import", str(tmp_path / f"{name}.csv"), "--run", str(tmp_path / "run"), *held).exit_code == 0
    return tmp_path / "run"


def test_a_change_cut_off_behind_its_saving_is_done_by_typing_it_again(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    undisturbed: dict[str, Any] = {}
    for verb, more, sign in (("add", ("--no-cost",), "+"), ("remove", (), "-")):
        with monkeypatch.context() as patch:
            patch.setattr(change, "_change_result", cut)
            with pytest.raises(PowerCut):
                CliRunner().invoke(cli, [verb, EFFECT, str(run), "--no-pictures", *more], catch_exceptions=False)
        made = changes(run)
        assert made[-1] == f"{sign}{EFFECT}"
        with monkeypatch.context() as patch:
            for name in ("_fit_with", "_fit_without"):
                patch.setattr(change, name, lambda *_: pytest.fail("it was fitted again"))
            undisturbed = typed(verb, run, *more)
            assert undisturbed == typed(verb, run, *more)
        assert changes(run) == made
        assert undisturbed["change"] == made[-1]
        assert undisturbed["before"]["ratio"] != undisturbed["after"]["ratio"]
        assert "nothing was lost" in undisturbed["notes"][0]


def test_it_says_what_it_said_the_first_time(run: Path) -> None:
    first = typed("add", run, "--no-cost")
    again = typed("add", run, "--no-cost")
    assert again.pop("notes")[1:] == first.pop("notes")
    assert again == first


@pytest.mark.parametrize("cut_at", ["keep_fit", "with_intervals"])
def test_wherever_the_cut_falls_the_change_is_there_once(run: Path, cut_at: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(rungs, cut_at, cut)
        with pytest.raises(PowerCut):
            CliRunner().invoke(cli, ["add", EFFECT, str(run), "--no-pictures", "--no-cost"], catch_exceptions=False)
    typed("add", run, "--no-cost")
    assert changes(run) == ["base", f"+{EFFECT}"]


@pytest.mark.parametrize(
    "since",
    [
        lambda _: ("--start", "amount=0.1"),
        lambda run: call("add", "cogging", str(run), "--no-pictures", "--no-cost") and (),
        lambda run: [path.unlink() for path in (run / "recordings").glob("held.*")] and (),
    ],
    ids=["another question", "not the last change", "other records"],
)
def test_another_question_is_refused(run: Path, since: Callable[[Path], tuple[str, ...]]) -> None:
    typed("add", run, "--no-cost")
    more = since(run)
    outcome = call("add", EFFECT, str(run), "--no-pictures", "--no-cost", *more)
    assert outcome.exit_code == 2, outcome.output
    assert f"beltcomm remove {EFFECT}" in outcome.output
