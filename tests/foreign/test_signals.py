"""Signals by hand and by a DBC file, against struct's idea of the bytes."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.framelog import read_frames
from beltcomm.foreign.signals import by_hand, of_dbc, table_of_signals
from beltcomm.runfolder import RunFolder
from foreign.samples import CONSTANT_NM_A, COUNTS, swing, write

PAYLOADS = np.random.default_rng(5).integers(0, 256, (200, 8), dtype=np.uint8)

DBC = """VERSION ""
NS_ :
BS_:
BU_: DRIVE
BO_ 385 Feedback: 8 DRIVE
 SG_ ActPosition : 0|32@1- (1,0) [0|0] "inc" HOST
 SG_ ActTorque : 39|16@0- (0.00143,0) [0|0] "Nm" HOST
 SG_ Counter : 48|8@1+ (1,0) [0|0] "" HOST
BO_ 2566850560 Slow: 4 DRIVE
 SG_ Temperature : 0|16@1+ (0.1,-40) [0|0] "degC" HOST
"""


def log_of(tmp_path: Path, payloads: np.ndarray, identifier: str = "181") -> Path:
    return write(
        tmp_path / "a.log", "".join(f"({1e-3 * k:.6f}) can0 {identifier}#{row.tobytes().hex()}\n" for k, row in enumerate(payloads))
    )


@pytest.mark.parametrize(
    ("text", "layout", "byte"),
    [
        ("i8", "<b", 3), ("u8", "<B", 7), ("i16", "<h", 1), ("u16be", ">H", 2), ("i32", "<i", 4), ("i32be", ">i", 1), ("u32", "<I", 0),
        ("i64", "<q", 0), ("u64", "<Q", 0), ("u64be", ">Q", 0), ("f32", "<f", 2), ("f32be", ">f", 4), ("f64", "<d", 0),
    ],
)  # fmt: skip
def test_numbers_as_struct_unpacks_them(text: str, layout: str, byte: int) -> None:
    found = by_hand(f"x=181:{byte}:{text}").of(PAYLOADS)
    expected = np.array([struct.unpack_from(layout, row.tobytes(), byte)[0] for row in PAYLOADS], dtype=np.float64)
    np.testing.assert_array_equal(found, np.where(np.isfinite(expected), expected, np.nan))


@pytest.mark.parametrize("text", ["x", "x=181", "x=181:0:i12", "x=181:8:i8", "x=181:6:i32", "x=zz:0:i8", "=181:0:i8"])
def test_what_is_no_signal(text: str) -> None:
    with pytest.raises(UsageError, match="--signal"):
        by_hand(text)


def test_a_dbc_file_names_scales_and_guesses(tmp_path: Path) -> None:
    """Columns, units and kept copy; the same numbers by cantools' own decoder."""
    cantools = pytest.importorskip("cantools", reason="the extra dbc is not installed")
    _, current, encoder = swing(800)
    torque = np.round(CONSTANT_NM_A * current / 0.00143).astype(np.int64)
    rows = [
        struct.pack("<i", int(x)) + struct.pack(">h", int(m)) + bytes([k % 256, 0])
        for k, (x, m) in enumerate(zip(encoder, torque, strict=True))
    ]
    path = log_of(tmp_path, np.array([np.frombuffer(row, dtype=np.uint8) for row in rows]))
    dbc = write(tmp_path / "bus.dbc", DBC)
    table = table_of_signals(read_frames(path), of_dbc(dbc))
    message = cantools.database.load_file(str(dbc)).get_message_by_name("Feedback")
    for k in (0, 17, 799):
        theirs = message.decode(rows[k])
        assert {name: table.columns[name][k] for name in theirs} == pytest.approx(theirs)
    run = tmp_path / "run"
    words = ["import", str(path), "--run", str(run), "--dbc", str(dbc), "--set", f"motor.encoder_counts_per_rev={COUNTS}"]
    assert CliRunner().invoke(cli, words).exit_code == 1  # counts are asked
    done = CliRunner().invoke(cli, [*words, "--map", f"position_rad=ActPosition*rev/{COUNTS}"])
    assert done.exit_code == 0, done.output
    record = RunFolder.open(run).recording("a")
    np.testing.assert_allclose(record.torque, 0.00143 * torque, rtol=1e-12)
    assert sorted(p.name for p in (run / "originals").iterdir()) == ["a.log", "bus.dbc"]
    dbc.unlink()
    assert "1 of 1 imports" in CliRunner().invoke(cli, ["import", "--check", "--run", str(run)]).stdout


def test_faults_of_dbc_files_and_absent_signals(tmp_path: Path) -> None:
    path = log_of(tmp_path, PAYLOADS)
    with pytest.raises(DataError, match=r"has no frames of these signals; on the bus are 181h \(200 frames of 8 bytes, 1.01e\+03 Hz\)"):
        table_of_signals(read_frames(path), [by_hand("x=182:0:i8")])
    with pytest.raises(UsageError, match="does not exist; give the DBC file"):
        of_dbc(tmp_path / "none.dbc")
    pytest.importorskip("cantools", reason="the extra dbc is not installed")
    with pytest.raises(DataError, match="cannot be read as a DBC file"):
        of_dbc(write(tmp_path / "bad.dbc", "BO_ what\n"))


def test_options_of_logs_are_refused_for_tables(tmp_path: Path) -> None:
    csv = write(tmp_path / "a.csv", "t,x\n0,1\n1,2\n")
    for option in (("--record", "2"), ("--signal", "x=181:0:i8"), ("--channel", "can0"), ("--node", "1"), ("--dbc", "x.dbc")):
        outcome = CliRunner().invoke(cli, ["import", str(csv), "--run", str(tmp_path / "r"), *option])
        assert (outcome.exit_code, f"{option[0]} is for logs of CAN frames" in outcome.stderr) == (2, True), outcome.output
