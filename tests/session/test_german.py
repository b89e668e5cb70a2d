"""Compare, diagnose and improve of a whole run in German: no sentence of the screens, nor of their details, stays English."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli

#: Words that no German sentence has, and that no name, unit or file holds.
ENGLISH = re.compile(r"\b(the|of|and|is|are|with|which|these|that|for|cannot|nothing|elsewhere|times|both|without|more|less)\b")


def english(output: str) -> list[str]:
    """Lines of an output that are not German, but for commands."""
    return [line for line in output.splitlines() if ENGLISH.search(re.sub(r"`[^`]*`", "", line))]


@pytest.fixture
def in_german(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BELTCOMM_LANG", "de")


@pytest.mark.examination
@pytest.mark.parametrize("verb", ["compare", "report", "diagnose", "improve"])
def test_no_sentence_stays_english(in_german: None, copy_of_complete: Callable[..., Path], verb: str) -> None:
    run = str(copy_of_complete())
    result = CliRunner().invoke(cli, [verb, run, "--details"])
    assert (Path(run) / "report.html").exists() == (verb == "report"), result.output
    assert result.exit_code in (0, 1), result.output
    assert english(result.output.replace(run, "RUN")) == []


@pytest.mark.parametrize(
    "words",
    [
        *((verb, "--drive", "virtual", "--dry-run", "--details") for verb in ("commission", "identify")),
        ("move", "--drive", "virtual", "--axis", "egc-70-600", "--by", "5mm", "--dry-run"),
    ],
)
def test_no_line_of_a_plan_stays_english(in_german: None, tmp_path: Path, words: tuple[str, ...]) -> None:
    where = () if words[0] == "move" else ("--run", str(tmp_path / "R"))
    result = CliRunner().invoke(cli, [*words, *where])
    assert result.exit_code == 0, result.output
    assert english(result.output) == []


@pytest.mark.examination
def test_the_demonstration_speaks_german(in_german: None, tmp_path: Path) -> None:
    result = CliRunner().invoke(cli, ["demo", "--seed", "607", "--run", str(tmp_path / "R")])
    assert result.exit_code == 0, result.output
    assert english(result.output.replace(str(tmp_path), "TMP")) == []
