"""Help of the verbs: one screen that names every option, and all of it where it is asked for."""

from __future__ import annotations

import re

import click
import pytest
from click.testing import CliRunner

from beltcomm.cli.help import FURTHER
from beltcomm.cli.main import GROUPS, VERBS, cli


def test_overview_is_one_screen_with_an_example_in_each_group_and_every_verb() -> None:
    short, whole = (CliRunner().invoke(cli, [asked]).stdout.splitlines() for asked in ("--help", "--help-all"))
    assert len(short) <= 22
    assert max(map(len, short)) <= 80
    assert " ".join(short).split().count("beltcomm") >= 1 + len(GROUPS)
    assert set(VERBS) <= set(" ".join(short).split())
    assert all(any(line.startswith(f"  {verb} ") and words in line for line in whole) for verb, words in VERBS.items())


@pytest.mark.parametrize("verb", VERBS)
def test_help_is_a_screen_and_names_every_option(verb: str) -> None:
    short, whole = (CliRunner().invoke(cli, [verb, asked], terminal_width=80).stdout for asked in ("--help", "--help-all"))
    command = cli.get_command(click.Context(cli), verb)
    assert command is not None
    options = {param.opts[-1]: param for param in command.params if isinstance(param, click.Option) and not param.hidden}
    assert short.count("\n") <= 45
    assert [name for name in options if not re.search(rf"{name}(?![\w-])", short)] == []
    named_alone = (" ".join(option.help.split()[:3]) for name, option in options.items() if option.help and name != "--help")
    assert [words for words in named_alone if words not in " ".join(whole.split())] == []


def test_every_option_that_a_help_folds_is_one() -> None:
    known = {name for verb in VERBS for param in cli.get_command(click.Context(cli), verb).params for name in param.opts}
    assert {name for names in FURTHER.values() for name in names} <= known
