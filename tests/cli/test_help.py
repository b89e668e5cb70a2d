"""Help of the verbs: one screen that names every option, and all of it where it is asked for."""

from __future__ import annotations

import re

import click
import pytest
from click.testing import CliRunner

from beltcomm.cli.help import FURTHER
from beltcomm.cli.main import VERBS, cli


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
