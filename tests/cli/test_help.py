"""Help of the verbs: one screen of what is needed most, and every option where all are asked for."""

from __future__ import annotations

import click
import pytest
from click.testing import CliRunner

from beltcomm.cli.help import LINES
from beltcomm.cli.main import GROUPS, VERBS, cli


def test_overview_is_one_screen_with_an_example_in_each_group_and_every_verb() -> None:
    short, whole = (CliRunner().invoke(cli, [asked]).stdout.splitlines() for asked in ("--help", "--help-all"))
    assert len(short) <= 22
    assert max(map(len, short)) <= 80
    assert " ".join(short).split().count("beltcomm") >= 1 + len(GROUPS)
    assert set(VERBS) <= set(" ".join(short).split())
    assert all(any(line.startswith(f"  {verb} ") and words in line for line in whole) for verb, words in VERBS.items())


def options_of(verb: str) -> dict[str, click.Option]:
    command = cli.get_command(click.Context(cli), verb)
    assert command is not None
    return {param.opts[-1]: param for param in command.params if isinstance(param, click.Option)}


def shown(screen: str) -> set[str]:
    """Options that begin a line of a help."""
    return {word for line in screen.splitlines() if line.startswith("  -") for word in line.replace(",", " ").split() if word[:2] == "--"}


@pytest.mark.parametrize("language", ["", "de"])
@pytest.mark.parametrize("verb", VERBS)
def test_help_is_a_screen_and_says_how_to_see_the_rest(verb: str, language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BELTCOMM_LANG", language)
    monkeypatch.setenv("COLUMNS", "80")
    screen = CliRunner().invoke(cli, [verb, "--help"], prog_name="beltcomm").stdout
    assert len(screen.splitlines()) <= LINES < 24, "the next prompt is on the screen, too"
    assert max(map(len, screen.splitlines())) <= 80
    assert f": beltcomm {verb}" in screen  # the example
    options = options_of(verb)
    needed = {name for name, option in options.items() if getattr(option, "topic", None) is None}
    assert needed <= shown(screen)
    assert f": beltcomm {verb} --help-all" in screen or set(options) <= shown(screen)


@pytest.mark.parametrize("verb", VERBS)
def test_help_all_explains_every_option(verb: str) -> None:
    whole = CliRunner().invoke(cli, [verb, "--help-all"], terminal_width=80).stdout
    told = " ".join(whole.split())
    options = options_of(verb)
    assert set(options) <= shown(whole)
    assert [name for name, option in options.items() if not option.help or " ".join(option.help.split()[:3]) not in told] == []


def test_an_option_of_a_topic_is_on_no_screen_that_is_not_whole() -> None:
    screen = CliRunner().invoke(cli, ["commission", "--help"]).stdout
    assert not {name for name, option in options_of("commission").items() if getattr(option, "topic", None)} & shown(screen)
