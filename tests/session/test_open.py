"""``beltcomm open`` without a browser: what it opens, what it answers, how it ends."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import beltcomm
from beltcomm import api
from beltcomm.app.design import DesignTab, TunedDesign
from beltcomm.app.serve import RunPage
from beltcomm.axis import Axis, load_axis
from beltcomm.cli.main import cli
from beltcomm.cli.talk import PlainTalk
from beltcomm.errors import DataError, UsageError
from beltcomm.result import Result
from beltcomm.runfolder import RunFolder
from beltcomm.web import server
from beltcomm.web.server import PageFiles, ServedPage

Copy = Callable[..., Path]


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Token and port of every page that was served; each ends at once, as by Ctrl-C."""
    found = []

    @contextmanager
    def serve(page: PageFiles, answers: Any, token: str, port: int = 0) -> Iterator[ServedPage]:
        assert (page.text()[:15], "design-update" in answers) == ("<!DOCTYPE html>", True)
        found.append((token, port))
        yield ServedPage(f"http://127.0.0.1:{port}/{token}/", lambda: None, lambda: None)

    monkeypatch.setattr(server, "serve", serve)
    return found


def call(*words: object) -> Any:
    return CliRunner().invoke(cli, [str(word) for word in words])


def test_ctrl_c_ends_it_with_nothing_saved(copy_of_complete: Copy, served: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    run = copy_of_complete("frf_[2-9]", "sweep*", "amplitude*")
    outcome = call("open", run, "--port", "8123")
    assert (outcome.exit_code, outcome.stdout) == (0, f"No design was saved; that of {run} is as it was.\n")
    silent = call("open", run, "--no-browser")
    assert silent.exit_code == 0
    (first, port), (second, free) = served
    assert (port, free) == (8123, 0)
    assert opened == [f"http://127.0.0.1:8123/{first}/"]
    assert first != second
    assert len(first) >= 20
    assert f"http://127.0.0.1:0/{second}/" in silent.stderr


def test_without_a_design_the_tab_says_what_makes_one(copy_of_complete: Copy) -> None:
    run = copy_of_complete("frf_[2-9]", "sweep*", "amplitude*")
    (run / "designs" / "final.yaml").unlink()
    with pytest.raises(DataError, match=f"make it with `beltcomm design {run}`"):
        DesignTab(run).answers()["begin"]({})


def test_what_is_no_run_opens_no_page(tmp_path: Path, served: list[Any]) -> None:
    assert call("open", tmp_path / "nowhere", "--no-browser").exit_code == 3
    assert served == []


def test_of_a_folder_of_runs_the_newest_is_opened_and_without_one_a_virtual_one_is_offered(
    copy_of_complete: Copy, tmp_path: Path, served: list[Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    run, asked = copy_of_complete("frf_[2-9]", "sweep*", "amplitude*"), list[str]()
    found = call("open", run.parent, "--no-browser")
    assert (found.exit_code, f"Run: {run} (the newest of" in found.stderr, len(served)) == (0, True, 1)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    nobody = call("open", "--no-browser")
    assert (nobody.exit_code, "make one with `beltcomm commission --drive virtual`" in nobody.stderr, len(served)) == (2, True, 1)

    def commission(drive: str, axis: Axis, made: Path, **_: Any) -> Result:
        asked.append(drive)
        shutil.copytree(run, made)
        return Result({}, [])

    monkeypatch.setattr(api, "commission", commission)
    monkeypatch.setattr(PlainTalk, "attended", lambda _: True)
    declined = CliRunner().invoke(cli, ["open", "--no-browser"], input="n\n")
    assert (declined.exit_code, "beltcomm import FILE" in declined.stderr, asked, len(served)) == (1, True, [], 1)
    taken = CliRunner().invoke(cli, ["open", "--no-browser"], input="y\n")
    assert (taken.exit_code, asked, len(served)) == (0, ["virtual"], 2), taken.output


def test_the_page_speaks_the_words_of_its_axis(tmp_path: Path) -> None:
    """A rotary axis: degrees, its own load; a belt axis keeps what stands there."""
    texts = ["From, mm", "within 0.006 mm", "belt force", "the carriage at 120 mm", "Speed, m/s"]
    for name, said in (
        ("torque-table", ["From, °", "within 0.006°", "load torque", "the load at 120°", "Speed, 1000°/s"]),
        ("egc-70-600", texts),
    ):
        page = RunPage(RunFolder.create(tmp_path / name, load_axis(name)).path)
        found = page.answers["words"]({"texts": texts})
        assert found["texts"] == said
        labels = [("From, °", 1.0), ("Speed, °/s", 1000.0)] if said is not texts else [("From, mm", 1.0), ("Speed, m/s", 1.0)]
        assert [found["labels"][0], found["labels"][-1]] == labels  # the numbers along a picture are multiplied
        assert page.begin()["own_words"] is (said is not texts)
        for wrong in (None, {}, {"texts": "mm"}, {"texts": [1]}):
            with pytest.raises(UsageError, match="a list"):
                page.words(wrong)
        page.close()


def test_answers_say_what_is_wrong(copy_of_complete: Copy, tmp_path: Path) -> None:
    """A move of one's own is the one that is predicted; what no page would send is refused in words."""
    move = tmp_path / "shuttle.csv"
    move.write_text("t_s,position_m\n0,0.1\n0.05,0.1\n0.4,0.2\n0.75,0.3\n0.8,0.3\n", encoding="utf-8")
    tuning = TunedDesign(copy_of_complete("frf_[2-9]", "sweep*", "amplitude*"), move=move)
    answers, begun = tuning.answers(), tuning.begin()
    assert begun["move"].startswith("move of shuttle.csv from 100 to 300 mm in 0.80 s")
    setting = begun["setting"]
    assert set(answers["update"](setting)) == {"new", "present", "measured", "binding", "variants", "changes", "sentence"}
    impossible = setting | {"suppression_db": -1.0}
    assert "no integral time" in answers["update"](impossible)["refusal"]
    assert "no integral time" in answers["track"](impossible)["refusal"]
    for name, wrong in (("update", {}), ("preset", {"setting": setting}), ("preset", {"setting": setting, "kind": "rope", "pace": "fast"})):
        with pytest.raises(UsageError):
            answers[name](wrong)
    for wrong, words in (({"end_m": 9.0}, "it must lie within"), ({"speed_m_s": -1.0}, "above zero"), ({"jerk_m_s3": None}, "jerk_m_s3")):
        with pytest.raises(UsageError, match=words):
            answers["move"]({"start_m": 0.1, "end_m": 0.2, "speed_m_s": 0.5, "acceleration_m_s2": 2.0, "jerk_m_s3": 40.0} | wrong)
    before = answers["track"](setting)["present"]["error"]["dynamic_m"]
    answers["move"]({"start_m": 0.1, "end_m": 0.2, "speed_m_s": 0.1, "acceleration_m_s2": 1.0, "jerk_m_s3": 20.0})
    assert answers["track"](setting)["present"]["error"]["dynamic_m"] < before
    start = tuning.bench.start(0.0, 0.1)
    assert tuning.bench.design(replace(start, position_m=0.2)) is tuning.bench.design(start)


@pytest.mark.examination
def test_the_page_predicts_what_the_verdict_predicted(copy_of_complete: Copy) -> None:
    """To the last digit: one move, one function, and the gains as the drive holds them."""
    run = copy_of_complete()
    verdict = RunFolder.open(run).load("results", "verify_move_1")
    for error in (TunedDesign(run).bench.present_tracked(0.0).error, beltcomm.open(run).predict_move().error):
        assert error.dynamic_m == pytest.approx(verdict["predicted"]["dynamic_m"], rel=1e-12)
        assert error.static_m == pytest.approx(verdict["predicted"]["static_m"], rel=1e-12)
