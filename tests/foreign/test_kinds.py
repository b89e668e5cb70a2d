"""Every kind of file in :mod:`foreign.kinds`: read right without a question, or refused with what it is and what to do.

``pytest tests/foreign/test_kinds.py -s`` prints the table.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.errors import UsageError
from beltcomm.foreign.files import read_table
from beltcomm.recording import load_recording
from foreign.kinds import KINDS
from foreign.makers import ANGLE, TORQUE, Kind, T
from foreign.samples import text


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_a_kind_of_file_is_read_right_or_called_what_it_is(kind: Kind, tmp_path: Path) -> None:
    file = kind.make(tmp_path)
    run = tmp_path / "run"
    outcome = CliRunner().invoke(cli, ["import", str(file), "--run", str(run), *kind.words])
    said = outcome.output
    told = "read" if outcome.exit_code == 0 else said.strip().splitlines()[-1].replace(str(tmp_path), "")
    sys.stdout.write(f"{kind.name:50s} {told}\n")
    assert not any(word in said for word in ("Traceback", "--separator")), said
    if kind.says:
        assert outcome.exit_code in (2, 3), said
        assert kind.says in said, said
        assert not run.exists()
        return
    assert outcome.exit_code == 0, said
    assert kind.shown in said, said
    (path,) = (run / "recordings").glob("*.csv")
    record = load_recording(path)
    rows = slice(None, len(record.torque))  # a last row may be at the end of a file that was cut off
    for found, expected in ((record.t_s - record.t_s[0], T - T[0]), (record.torque, TORQUE), (record.position, ANGLE)):
        wanted = expected[kind.rows][rows]
        assert len(found) >= len(expected[kind.rows]) - 1
        if expected is TORQUE and kind.rows.step:  # the mean over the slower step
            step = kind.rows.step
            wanted = TORQUE[: len(found) * step].reshape(-1, step).mean(axis=1)[: len(found)]
            found = found[: len(wanted)]
        np.testing.assert_allclose(
            found, wanted[: len(found)], atol=max(kind.tolerance, 2e-6) if expected is not T else max(kind.tolerance, 1e-6)
        )


@pytest.mark.parametrize(
    ("content", "refused"),
    [(text("t [s],MZ,enc").encode(), False), (b"MZ;t;enc\n" + b"1;2;3\n" * 20, False), (b"MZ\x90\0\x03" + bytes(60), True)],
)
def test_a_column_called_as_programs_begin_is_a_column(tmp_path: Path, content: bytes, refused: bool) -> None:
    (path := tmp_path / "a.csv").write_bytes(content)
    if refused:
        with pytest.raises(UsageError, match="is a program"):
            read_table(path)
    else:
        assert "MZ" in read_table(path).columns


OWN_CLOCKS = [kind for kind in KINDS if kind.name.startswith(("TwinCAT", "LabVIEW .lvm, ", "Rigol", "Tektronix"))]


@pytest.mark.parametrize("kind", OWN_CLOCKS, ids=lambda kind: kind.name)
def test_rows_that_changed_places_or_stand_twice_are_never_taken_in_silence(kind: Kind, tmp_path: Path) -> None:
    """The sample time that such a file states must not stand for stamps that contradict it."""
    file = kind.make(tmp_path)
    lines = file.read_text(encoding="utf-8").splitlines()
    at = len(lines) // 2
    changed = [*lines[:at], lines[at + 40], *lines[at + 1 : at + 40], lines[at], *lines[at + 41 :]]
    for rows, refused in ((changed, True), ([*lines[:at], lines[at], *lines[at:]], False)):
        file.write_text("\n".join(rows) + "\n", encoding="utf-8")
        outcome = CliRunner().invoke(cli, ["import", str(file), "--run", str(tmp_path / "run"), *kind.words])
        assert outcome.exit_code == (3 if refused else 0), outcome.output
        assert ("of its signals goes back by" if refused else "that repeat the ones before left out") in outcome.output or (
            refused and "miss a value" in outcome.output  # the stamp of a slower signal stands where it has none
        ), outcome.output
