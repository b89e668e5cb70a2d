"""The page of all rows: what it looks up is what the tool computes, and no row stands without its reason."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path
from typing import Any

import click

from beltcomm.cli.main import cli
from beltcomm.jobs.own_thesis import OWN, STUDIES
from beltcomm.thesis import designs

DOCS = Path(__file__).parents[2] / "docs"


def rows_module() -> Any:
    spec = importlib.util.spec_from_file_location("thesis_rows", DOCS / "thesis_rows.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_row_has_a_mark_and_what_differs_a_reason() -> None:
    module = rows_module()
    assert len(module.ROWS) >= 115
    assert {row.mark for row in module.ROWS} <= set(module.MARKS)
    assert [row.what for row in module.ROWS if row.mark == "differs" and not row.why] == []


def test_the_page_holds_the_rows_and_what_is_computed() -> None:
    module, page = rows_module(), (DOCS / "thesis-rows.md").read_text(encoding="utf-8")
    numbers = {one.item: one.ours for one in designs.compare().numbers}
    looked_up = [(row, found) for row in module.ROWS if (found := re.fullmatch(r"\{designs:([^}]+)\}( .*)?", row.ours)) is not None]
    assert len(looked_up) >= 15
    for row, found in looked_up:
        assert f"| {numbers[found[1]]:.5g}{found[2] or ''} |" in page, row.what
    assert sum(line.startswith("| ") and line.split("|")[1].strip().isdigit() for line in page.splitlines()) == len(module.ROWS)


def test_every_command_is_one() -> None:
    """Verbs and options as the command line has them."""
    module = rows_module()
    assert [row.what for row in module.ROWS if not module.on_own_axis(row)] == [], "each works on an axis and a run of one's own"
    for line in {line for row in module.ROWS for line in (row.command, module.on_own_axis(row))}:
        words = line.replace("`", "").split()
        if words[0] == "thesis" and "--run" in words:
            assert words[1] in {**OWN, **STUDIES}, line
        command = cli.get_command(click.Context(cli), words[0])
        assert command is not None, line
        options = {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}
        assert {word for word in words if word.startswith("--")} <= options, line
