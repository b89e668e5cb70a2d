"""MDF files with groups of different rasters; left out where the extra ``mdf`` is not installed."""

from __future__ import annotations

import importlib.util
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign import apart
from beltcomm.foreign.files import read_table
from beltcomm.foreign.optional_formats import read_mdf
from beltcomm.runfolder import RunFolder
from foreign.makers import mdf_file
from foreign.samples import COUNTS, swing

T, CURRENT, ENCODER = swing(2000)


def test_without_asammdf_it_is_said_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    (tmp_path / "a.mf4").write_bytes(b"MDF     4.10    ")
    with pytest.raises(UsageError, match=r"pip install 'beltcomm\[mdf\]'"):
        read_table(tmp_path / "a.mf4")


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Torque every 2 ms and position every 1 ms in groups of their own, beside a text channel."""
    asammdf = pytest.importorskip("asammdf", reason="the extra mdf is not installed")
    path = tmp_path_factory.mktemp("mdf") / "drive.mf4"
    with asammdf.MDF(version="4.10") as file:
        torque = asammdf.Signal(0.65 * CURRENT[::2], T[::2], unit="Nm", name="ActTorque")
        file.append([torque, asammdf.Signal(np.full(len(T[::2]), b"ok"), T[::2], name="State", encoding="utf-8")])
        file.append([asammdf.Signal(360.0 / COUNTS * ENCODER, T, unit="deg", name="ActPosition")])
        file.save(path)
    return path


def test_groups_keep_their_rasters(measured: Path) -> None:
    table = read_mdf(measured)
    assert table.units == {"time of group 0": "s", "ActTorque": "Nm", "time of group 1": "s", "ActPosition": "deg"}
    np.testing.assert_array_equal(table.columns[table.clocks["ActTorque"]], T[::2])
    np.testing.assert_array_equal(table.columns[table.clocks["ActPosition"]], T)
    assert table.notes == (
        "2 channel groups, each with time stamps of its own",
        "not read, because they are no channels of numbers: State",
    )


def test_a_file_is_imported_without_any_mapping(measured: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    done = CliRunner().invoke(cli, ["import", str(measured), "--run", str(run)])
    assert done.exit_code == 0, done.output
    assert "guessed torque_nm=ActTorque*nm" in done.stdout
    assert "position_rad is of another raster, 'time of group 1': taken at the stamps that both have" in done.stdout
    record = RunFolder.open(run).recording("drive")
    np.testing.assert_allclose(record.position, math.tau / COUNTS * ENCODER[::2], rtol=1e-12)
    np.testing.assert_allclose(record.torque, 0.65 * CURRENT[::2], rtol=1e-12)


def test_a_damaged_file_is_said_to_be_one(measured: Path, tmp_path: Path) -> None:
    (tmp_path / "cut.mf4").write_bytes(measured.read_bytes()[:700])
    with pytest.raises(DataError, match="is it cut off"):
        read_table(tmp_path / "cut.mf4")
    (tmp_path / "no.mf4").write_bytes(b"0123456789")
    with pytest.raises(DataError, match="cannot be read as an MDF file"):
        read_table(tmp_path / "no.mf4")


def test_a_reader_that_does_not_end_is_ended(measured: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(apart, "_LIMIT_S", 0.01)
    monkeypatch.setattr(apart, "_PER_BYTE_S", 0.0)
    with pytest.raises(DataError, match="its reader did not end within 0 s"):
        read_table(measured)


@pytest.mark.parametrize(("rows", "said"), [(2**31, "at most 268435456 values are read"), (10**7, "more than a file of its size can")])
def test_more_rows_than_a_file_can_hold_are_refused_before_they_are_made(tmp_path: Path, rows: int, said: str) -> None:
    """A damaged number of cycles in the channel group, 16 GiB of it, in a file of some kB."""
    path = tmp_path / "a.mf4"
    mdf_file(path)
    content = bytearray(path.read_bytes())
    group = content.index(b"##CG")
    links = int.from_bytes(content[group + 16 : group + 24], "little")
    at = group + 24 + 8 * links + 8
    assert int.from_bytes(content[at : at + 8], "little") > 1
    content[at : at + 8] = rows.to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(DataError, match=said):
        read_mdf(path)
