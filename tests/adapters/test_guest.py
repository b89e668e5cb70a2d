"""The adapter of docs/adapter-guide.md, found as a guest's is, from the command line."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from beltcomm import drive
from beltcomm.cli.main import cli


@pytest.fixture
def guest(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The example's module, whose adapter alone is installed."""
    spec = importlib.util.spec_from_file_location("guest_drive", Path(__file__).parents[2] / "docs" / "example_drive.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(drive, "find_adapters", lambda: [drive.FoundAdapter("guest_drive:ADAPTER", module.ADAPTER)])
    return module


def test_the_command_line_gives_a_guest_no_option_that_it_does_not_know(
    guest: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["commission", "--drive", "example:1", "--axis", "egc-70-600", "--dry-run", "--json"]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 0, outcome.output
    assert json.loads(outcome.stdout)["seconds"] > 0.0


def test_a_bus_is_logged_where_the_adapter_says_that_it_has_one(guest: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[dict[str, object]] = []
    for logs in (False, True):
        adapter = drive.Adapter("bus", "", ("bus",), lambda _address, options: given.append(dict(options)), logs=logs)  # type: ignore[arg-type, return-value]
        monkeypatch.setattr(drive, "find_adapters", lambda adapter=adapter: [drive.FoundAdapter("bus", adapter)])
        drive.open_drive("bus:1", {"node": 1, "log": print})
    assert given == [{"node": 1}, {"node": 1, "log": print}]
