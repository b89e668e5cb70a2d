"""What is asked of a design on the command line: knobs at once or one by one, depths and T_R, the same for commission and design."""

from __future__ import annotations

from typing import Any

import click
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.cli.specification import specification_of, specification_options
from beltcomm.design.specification import PRODUCT_SPECIFICATION, Specification
from beltcomm.errors import UsageError


def asked(*words: str) -> Specification | None:
    found: list[Specification | None] = []

    @click.command()
    @specification_options
    def command(**given: Any) -> None:
        found.append(specification_of(given))
        assert given == {}

    outcome = CliRunner().invoke(command, words, catch_exceptions=False)
    assert outcome.exit_code == 0, outcome.output
    return found[0]


def test_nothing_asked_is_what_every_axis_is_asked_for() -> None:
    assert asked() is None


def test_a_demand_turns_three_knobs_and_each_option_its_own() -> None:
    robust = asked("--demand", "robust")
    assert robust is not None
    assert (robust.phase_margin_deg, robust.suppression_db, robust.position_phase_margin_deg) == (60.0, -12.0, 80.0)
    assert robust.velocity_filters_s == PRODUCT_SPECIFICATION.velocity_filters_s
    own = asked("--demand", "fast", "--suppression", "-15", "--velocity-filter", "2ms", "--notch-depth", "-9", "--butterworth-depth", "-6")
    assert own is not None
    assert (own.phase_margin_deg, own.suppression_db, own.position_phase_margin_deg) == (35.0, -15.0, 60.0)
    assert (own.velocity_filters_s, own.notch_db, own.butterworth_db) == ((0.002,), -9.0, -6.0)


@pytest.mark.parametrize(
    "words", [("--phase-margin", "nan"), ("--notch-depth", "3"), ("--velocity-filter=-1ms",), ("--suppression", "-1e9")]
)
def test_what_cannot_be_asked_is_a_sentence(words: tuple[str, ...]) -> None:
    with pytest.raises(UsageError, match=r"must lie between|not negative"):
        asked(*words)


@pytest.mark.parametrize("verb", ["commission", "design"])
def test_both_verbs_ask_the_same(verb: str) -> None:
    said = CliRunner().invoke(cli, [verb, "--help-all"]).output
    for option in (
        "--demand",
        "--phase-margin",
        "--suppression",
        "--position-phase-margin",
        "--notch-depth",
        "--butterworth-depth",
        "--velocity-filter",
    ):
        assert option in said
