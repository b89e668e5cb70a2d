"""The examples of docs/import.md that need no data of others, run in their order."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.runfolder import RunFolder
from foreign.buslog import candump, logged
from foreign.matfiles import write_v73
from foreign.samples import CONSTANT_NM_A, swing

PAGE = Path(__file__).parents[2] / "docs" / "import.md"


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    t, current, encoder = swing()
    torque = {"Time": t, "Data": CONSTANT_NM_A * current, "Unit": "Nm"}
    write_v73(Path("drive.mat"), {"ActTorque": torque, "ActPosition": {"Time": t, "Data": encoder * 360.0 / 65536, "Unit": "deg"}})
    frames = logged(kinds=("torque",)).frames
    candump(frames, Path("moves.log"))
    start = next(k for k, frame in enumerate(frames) if frame[1] == 0x80)
    end = next(k for k, frame in enumerate(frames) if frame[1] == 0x80 and frame[0] > frames[start][0] + 3.0)
    candump([frame for frame in frames[start:end] if frame[1] not in (0x581, 0x601)], Path("late.log"))
    section = PAGE.read_text(encoding="utf-8").split("## Logs of CAN frames")[1].split("```sh")[1].split("```")[0]
    commands = [line for line in section.splitlines() if line]
    assert len(commands) == 5
    for command in commands:
        outcome = CliRunner().invoke(cli, shlex.split(command)[1:])
        assert outcome.exit_code == 0, f"{command}\n{outcome.output}"
    assert RunFolder.open(Path("runs/mat")).finished_names() == ["drive"]
    assert RunFolder.open(Path("runs/one")).finished_names() == ["excited"]
