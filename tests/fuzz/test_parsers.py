"""A share of the fuzz (tests/benchmarks/fuzz.py): damaged files for every parser, a value or a sentence with the file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fuzz.parsers import Parser, case, damaged, parsers

#: Damaged files for each parser, and for those that start a process for each file.
CASES, CASES_APART = 40, 2


@pytest.fixture(scope="module")
def every(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Parser]:
    """All but the readers that may crash: those are met through their process alone."""
    found = parsers(tmp_path_factory.mktemp("good"))
    return {name: parser for name, parser in found.items() if not name.startswith("reader of")}


def test_good_files_are_read(every: dict[str, Parser], tmp_path: Path) -> None:
    assert {name: case(parser, parser.good, tmp_path) for name, parser in every.items()} == dict.fromkeys(every, ("fine", ""))


@pytest.mark.examination
def test_damaged_files_are_read_or_refused_with_a_sentence(every: dict[str, Parser], tmp_path: Path) -> None:
    others = [parser.good for parser in every.values()]
    wrong = []
    refused = 0
    for name, parser in every.items():
        for number in range(CASES_APART if parser.apart else CASES):
            outcome, words = case(parser, damaged(np.random.default_rng([7, number]), parser.good, others), tmp_path)
            refused += outcome == "refused"
            if outcome not in {"fine", "refused"}:
                wrong.append((name, number, outcome, words))
    assert wrong == []
    assert refused > CASES


@given(st.data(), st.binary(max_size=200))
@settings(derandomize=True, deadline=None, max_examples=150, database=None)
def test_any_bytes(every: dict[str, Parser], tmp_path_factory: pytest.TempPathFactory, data: st.DataObject, content: bytes) -> None:
    parser = every[data.draw(st.sampled_from(sorted(name for name, one in every.items() if not one.apart)))]
    outcome, words = case(parser, content, tmp_path_factory.getbasetemp())
    assert outcome in {"fine", "refused"}, words
