"""A run that is gone on with where no drive is named: that of the run, reached as it was."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import click
import pytest

from beltcomm.axis import load_axis
from beltcomm.cli.friction import command as friction
from beltcomm.cli.newest import told_drive
from beltcomm.cli.verify import command as verify
from beltcomm.runfolder import RunFolder


def run_by(options: str, folder: Path) -> Path:
    """A run whose drive was reached by these options."""
    run = RunFolder.create(folder / "R", load_axis("egc-70-600"))
    structure = {"name": "x", "period_s": 1e-3, "prefilters": []}
    about = {"counts_per_rev": 65536, "peak_torque_nm": 3.1, "max_speed_rad_s": 400.0, "structure": structure}
    run.save("results", "drive", {**about, "name": "CMMP-AS", "reached_as": "virtual", "reached_by": options})
    return run.path


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run that was made with options of its drive."""
    return run_by("--profile cmmp-as --node 3", tmp_path)


def frame() -> Any:
    return SimpleNamespace(json=False, drive="", bus_log=False, details=False, verbose=0)


@pytest.mark.parametrize(
    ("more", "drive", "profile", "node"),
    [
        ([], "virtual", "cmmp-as", 3),
        (["--profile", "reference"], "virtual", "reference", 3),
        (["--drive", "virtual:g_b"], "virtual:g_b", None, None),
    ],
)
def test_the_drive_of_a_run_is_reached_as_it_was(
    more: list[str], drive: str, profile: str | None, node: int | None, run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A run made with --profile cmmp-as went on with the reference drive, and was refused as another one's."""
    given = verify.make_context("verify", ["--run", str(run), *more], obj=frame()).params
    assert (given["drive"], given["profile"], given["node"]) == (drive, profile, node)
    assert ("Drive: virtual --profile cmmp-as --node 3 (that of the run)" in capsys.readouterr().err) == (drive == "virtual")


def test_what_has_no_drive_of_its_own_is_told_how_it_was_reached(run: Path) -> None:
    context = friction.make_context("friction", ["--run", str(run)], obj=frame())
    assert told_drive(context, run) == ("virtual", {"profile": "cmmp-as", "node": 3})
    assert told_drive(context, run / "elsewhere") == (None, {})


@pytest.mark.parametrize(
    "options",
    [
        *("--yes true", "--yes --yes", "--hold-to-run 0 --profile cmmp-as", "--feedforward none", "--save true", "--node"),
        *("--profile 'half", "--node many", "--profile ./acme.yaml", "--profile acme.yml"),
    ],
)
def test_a_run_tells_how_its_drive_is_reached_and_nothing_else(options: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run of somebody else would answer the question whether the axis may move, or say by a profile what is written to its drive."""
    with pytest.raises(click.MissingParameter):
        verify.make_context("verify", ["--run", str(run_by(options, tmp_path))], obj=frame())
    assert f"give --drive and its options: it was reached by virtual {options}" in capsys.readouterr().err
