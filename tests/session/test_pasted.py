"""Every command that is named for a run can be pasted, also where its folder or its drive has blanks in the name."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli

Copy = Callable[..., Path]
NAME = "first run with spaces"
#: A word in front of a folder whose name has blanks, without the quote that holds both together.
BARE = re.compile(r"beltcomm [a-z]+ [^'`]*" + re.escape(NAME))
CHECKOUT = Path(__file__).parents[2]


@pytest.mark.examination
@pytest.mark.parametrize("verb", ["compare", "design", "report", "ladder", "export --format yaml", "verify --drive virtual --dry-run"])
def test_commands_for_a_folder_with_blanks_can_be_pasted(copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch, verb: str) -> None:
    run = copy_of_complete(name=NAME)
    monkeypatch.chdir(run.parent)
    where = ["--run", NAME] if verb.startswith("verify") else [NAME]
    outcome = CliRunner().invoke(cli, [*verb.split(), *where])
    assert outcome.exit_code in (0, 1, 2), outcome.output
    said = outcome.stdout + outcome.stderr
    assert not BARE.search(said), said
    for line in said.splitlines():
        if line.startswith("    beltcomm") and NAME in line:
            assert NAME in shlex.split(line)


def test_no_sentence_names_a_folder_in_a_command_without_the_quotes() -> None:
    """What the source writes behind ``beltcomm VERB`` and ``--run`` goes through ``given.pasted``."""
    verbs = "fit|design|compare|diagnose|ladder|report|open|bundle|export|remove"
    bare = re.compile(rf"(beltcomm ({verbs}|{{following}})|--run|add \S+) \{{(run|folder\.path|self\.path)\}}")
    found = [
        f"{path.relative_to(CHECKOUT)}:{number}"
        for path in (CHECKOUT / "beltcomm").rglob("*.py")
        if "run = pasted(" not in (text := path.read_text(encoding="utf-8"))
        for number, line in enumerate(text.splitlines(), 1)
        if bare.search(line)
    ]
    assert found == []
