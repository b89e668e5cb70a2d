"""Compare, diagnose and improve of a whole run in German: no sentence of the screens, nor of their details, stays English."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm import language
from beltcomm.cli.main import cli

#: Words that no German sentence has, and that no name, unit or file holds.
ENGLISH = re.compile(r"\b(the|of|and|is|are|with|which|these|that|for|cannot|nothing|elsewhere|times|both|without|more|less)\b")


@pytest.fixture
def in_german(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("BELTCOMM_LANG", "de")
    yield
    language.use("en")


@pytest.mark.examination
@pytest.mark.parametrize("verb", ["compare", "diagnose", "improve"])
def test_no_sentence_stays_english(in_german: None, copy_of_complete: Callable[..., Path], verb: str) -> None:
    run = str(copy_of_complete())
    result = CliRunner().invoke(cli, [verb, run, "--details"])
    assert result.exit_code in (0, 1), result.output
    assert [line for line in result.output.replace(run, "RUN").splitlines() if ENGLISH.search(line)] == []
