"""Foreign files as tables: formats recognised, faults said."""

from __future__ import annotations

import gzip
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner
from scipy.io import savemat

from beltcomm.cli.main import cli
from beltcomm.errors import DataError, UsageError
from beltcomm.foreign.files import read_table
from beltcomm.foreign.table import Table
from beltcomm.foreign.textfile import RowSpan
from beltcomm.recording import load_recording
from beltcomm.runfolder import RunFolder
from foreign import makers
from foreign.makers import ANGLE, labview
from foreign.samples import swing, text, write

T, CURRENT, ENCODER = swing()


def the_same(columns: dict[str, Any], names: tuple[str, str, str], time_scale: float = 1.0) -> None:
    for name, expected in zip(names, (T * time_scale, CURRENT, ENCODER), strict=True):
        np.testing.assert_allclose(columns[name], expected, atol=1e-9)


@pytest.mark.parametrize(
    ("content", "encoding", "names"),
    [
        (text(), "utf-8", ("time", "Iq", "enc")),
        (text().replace("\n", "\r\n"), "utf-8-sig", ("time", "Iq", "enc")),
        (text("t;I;x", separator=";", comma=True), "utf-8", ("t", "I", "x")),
        (text("t\tI\tx", separator="\t", comma=True), "utf-8", ("t", "I", "x")),
        (text("t\tI\tx", separator="\t"), "utf-16", ("t", "I", "x")),
        (text("Time [s]  Drive Iq  x", separator="  "), "utf-8", ("Time [s]", "Drive Iq", "x")),
        (text("", separator=" "), "utf-8", ("c1", "c2", "c3")),
        (text("# t, I, x"), "utf-8", ("t", "I", "x")),
        (text("% t I x\n% a remark of some length", separator=" "), "utf-8", ("t", "I", "x")),
        (text("Logger 3\nChannels;3\n\nt;I;x", separator=";"), "utf-8", ("t", "I", "x")),
        (text("t;Strom [A];Lage [°]", separator=";", comma=True), "cp1252", ("t", "Strom [A]", "Lage [°]")),
        (text('"t, s","Iq","x"'), "utf-8", ("t, s", "Iq", "x")),
        (text("I,I,"), "utf-8", ("I", "I_2", "c3")),
        (text() + "End of file\n\n", "utf-8", ("time", "Iq", "enc")),
        (text() + "1.5,0.", "utf-8", ("time", "Iq", "enc")),
    ],
)
def test_text_in_the_shapes_that_loggers_write(tmp_path: Path, content: str, encoding: str, names: tuple[str, str, str]) -> None:
    table = read_table(write(tmp_path / "a.txt", content, encoding))
    assert tuple(table.columns) == names
    the_same(dict(table.columns), names)


def test_a_row_of_units_is_told_from_the_names(tmp_path: Path) -> None:
    table = read_table(write(tmp_path / "a.csv", text("t,I,x\n[ms],A,-", time_scale=1e3)))
    the_same(dict(table.columns), ("t", "I", "x"), 1e3)
    assert [table.unit(name) for name in table.columns] == ["ms", "A", "-"]


def test_a_compressed_file(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(text().encode()))
    the_same(dict(read_table(path).columns), ("time", "Iq", "enc"))
    path.write_bytes(path.read_bytes()[:3000])
    with pytest.raises(DataError, match=r"a\.csv\.gz cannot be read"):
        read_table(path)


def test_missing_values_text_columns_and_damaged_cells(tmp_path: Path) -> None:
    lines = text(samples=200).splitlines()
    rows = [f"{line},{'run' if i > 99 else 'idle'}" for i, line in enumerate(lines[1:])]
    rows[10] = rows[10].replace(rows[10].split(",")[1], "")
    rows[11] = rows[11].replace(rows[11].split(",")[1], "ERR7")
    table = read_table(write(tmp_path / "a.csv", "\n".join([f"{lines[0]},state", *rows, ""])))
    assert np.flatnonzero(np.isnan(table.columns["Iq"])).tolist() == [10, 11]
    assert set(table.columns["state"]) == {"run", "idle"}
    assert "Iq is no number in 1 rows, first 'ERR7' in line 13: taken as missing" in table.notes


def test_torn_lines_are_refused_or_left_out(tmp_path: Path) -> None:
    lines = text(samples=100).splitlines()
    lines[50] = "0.049"
    path = write(tmp_path / "a.csv", "\n".join([*lines, ""]))
    with pytest.raises(DataError, match=r"line 51 has 1 values, the rows have 3; .*--drop-incomplete"):
        read_table(path)
    table = read_table(path, torn_rows=True)
    assert np.flatnonzero(np.isnan(table.columns["time"])).tolist() == [49]  # its place stays: time may be a count of the rows
    assert len(table.columns["time"]) == 100
    assert "1 torn lines left out, the first is line 51" in table.notes


def torn_lvm(path: Path, row: int) -> tuple[Path, int]:
    """LabVIEW's file without stamps, a row of which has lost its last number; and the line before that."""
    lines = labview("No").splitlines()
    at = lines.index("X_Value\tTorque\tPosition\tComment") + 1 + row
    lines[at] = lines[at].rpartition("\t")[0]
    return write(path, "\n".join([*lines, ""])), at


def test_a_torn_line_before_all_rows_is_told_and_no_header(tmp_path: Path) -> None:
    path, at = torn_lvm(tmp_path / "a.lvm", 0)
    table = read_table(path)
    assert f"1 torn lines left out, the first is line {at + 1}" in table.notes
    np.testing.assert_allclose(table.columns["Position"], ANGLE[1:], atol=1e-6)


@pytest.mark.parametrize("torn", [1, 40])
def test_a_torn_line_keeps_its_place_where_the_time_is_a_count_of_rows(torn: int, tmp_path: Path) -> None:
    """In LabVIEW's file without stamps: no later row may move."""
    path, at = torn_lvm(tmp_path / "a.lvm", torn)
    outcome = CliRunner().invoke(cli, ["import", str(path), "--run", str(tmp_path / "run")])
    assert outcome.exit_code == 3
    assert f"line {at + 1} has 2 values, the rows have 3; it is torn" in outcome.output
    outcome = CliRunner().invoke(cli, ["import", str(path), "--run", str(tmp_path / "run"), "--drop-incomplete"])
    assert outcome.exit_code == 0, outcome.output
    record = RunFolder.open(tmp_path / "run").recordings()[0]
    np.testing.assert_allclose(record.t_s, np.delete(makers.T, torn), atol=1e-9)
    np.testing.assert_allclose(record.position, np.delete(ANGLE, torn), atol=1e-6)


def test_two_records_of_labview_in_one_file_are_told_by_their_rows(tmp_path: Path) -> None:
    text = labview("No")
    second = text[text.index("Channels") :]
    path = write(tmp_path / "a.lvm", text + "\n" + second)
    words = ["import", str(path), "--run", str(tmp_path / "run")]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 3
    assert "or begins another record: --rows :1200 or --rows 1201: takes a part" in outcome.output
    outcome = CliRunner().invoke(cli, [*words, "--rows", "1201:"])
    assert outcome.exit_code == 0, outcome.output
    np.testing.assert_allclose(RunFolder.open(tmp_path / "run").recordings()[0].position, ANGLE, atol=1e-6)


def test_what_is_torn_outside_of_the_rows_that_are_wanted_does_not_matter(tmp_path: Path) -> None:
    """Two records below each other, with a line of another length or their header between them."""
    t, *_ = swing(100)
    rows = text(samples=100)
    for between in ("***End***,1\n", rows.splitlines()[0] + "\n"):
        path = write(tmp_path / "a.csv", rows + between + rows.split("\n", 1)[1])
        with pytest.raises(DataError, match=r"--rows :100 or --rows 10[12]:") as refusal:
            read_table(path)
        first = int(re.findall(r"--rows (\d+):", str(refusal.value))[0])
        for part in (RowSpan(1, 100), RowSpan(first)):
            np.testing.assert_allclose(read_table(path, rows=part).columns["time"][part.first - 1 :][:100], t, atol=1e-9)
        with pytest.raises(DataError, match="--rows :100"):
            read_table(path, rows=RowSpan(100, first))


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ("", "is empty"),
        ("\n \n", "is empty"),
        ("time,Iq,enc\n", "holds no rows"),
        ("I\n1.0\n2.0\n3.5\n4\n", "has one column only"),
        ("all work\nand no play\nmakes a dull log, they say\nbut, in, fact, there\nis more\n", "no table of numbers"),
        (text("t,I,x", separator=";", comma=True).replace(";", ","), "line 1 above the first row has 3 names, the rows have"),
        (text() + text(), r"the header stands again in line 1502: a second record .*--rows"),
        ("abc\0\0\0", "not a text file"),
    ],
)
def test_text_that_is_no_table(tmp_path: Path, content: str, sentence: str) -> None:
    with pytest.raises(DataError, match=sentence):
        read_table(write(tmp_path / "a.csv", content))


def test_what_was_said_of_the_format_holds(tmp_path: Path) -> None:
    path = write(tmp_path / "a.csv", "a;b\n1,5;2\n2,5;3\n4,5;4\n5,5;6\n")
    assert read_table(path, separator="semicolon", decimal="comma").columns["a"].tolist() == [1.5, 2.5, 4.5, 5.5]
    assert list(read_table(path, skip_lines=1).columns) == ["c1", "c2"]
    with pytest.raises(DataError, match="under --separator tab; leave it out"):
        read_table(path, separator="tab")


def test_matlab_and_numpy_files(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"log": {"t": T, "I": CURRENT}, "M": np.column_stack([T, CURRENT, ENCODER]), "gain": 3.0, "who": "me"})
    table = read_table(tmp_path / "a.mat")
    the_same(dict(table.columns), ("M1", "M2", "M3"))
    assert set(table.columns) == {"log.t", "log.I", "M1", "M2", "M3"}
    assert table.notes == ("not read, because they are no vectors of numbers: gain, who",)
    np.savez(tmp_path / "a.npz", t=T, I=CURRENT, x=ENCODER.astype(np.int32))
    the_same(dict(read_table(tmp_path / "a.npz").columns), ("t", "I", "x"))
    np.save(tmp_path / "a.npy", np.stack([T, CURRENT, ENCODER]))
    the_same(dict(read_table(tmp_path / "a.npy").columns), ("c1", "c2", "c3"))


def test_matlab_and_numpy_files_that_cannot_be_read(tmp_path: Path) -> None:
    savemat(tmp_path / "cut.mat", {"t": T})
    (tmp_path / "cut.mat").write_bytes((tmp_path / "cut.mat").read_bytes()[:5000])
    (tmp_path / "new.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\x89HDF\r\n\x1a\n" + bytes(512))
    savemat(tmp_path / "none.mat", {"gain": 3.0})
    np.savez(tmp_path / "objects.npz", a=np.array([None, 1], dtype=object))
    (tmp_path / "no.npy").write_bytes(b"1,2,3\n")
    for name, sentence in {
        "cut.mat": "is it cut off",
        "new.mat": r"MATLAB 7\.3 or HDF5 file",
        "none.mat": "holds no vectors of numbers",
        "objects.npz": "does it hold objects",
        "no.npy": "cannot be read as a NumPy file",
    }.items():
        with pytest.raises(DataError, match=sentence):
            read_table(tmp_path / name)


def test_files_that_are_not_there_or_of_another_kind(tmp_path: Path) -> None:
    (tmp_path / "a.xls").write_bytes(b"\xd0\xcf\x11\xe0" + bytes(600))
    for path, sentence in {
        tmp_path / "b.csv": "does not exist",
        Path("/dev/null"): "is no file",
        tmp_path: "is a folder",
        tmp_path / "a.xls": "save its sheet as CSV",
    }.items():
        with pytest.raises(UsageError, match=re.escape(str(path)) + r".*" + sentence):
            read_table(path)


@pytest.mark.parametrize(
    ("name", "bare", "unit"),
    [
        ("t/s", "t", "s"),
        ("Istmoment/Nm", "Istmoment", "Nm"),
        ("Istposition/inc", "Istposition", "inc"),
        ("Drehzahl/U/min", "Drehzahl", "U/min"),
        ("Lage / rad", "Lage", "rad"),
        ("Lage/mm_2", "Lage_2", "mm"),
        ("Moment/%", "Moment", "%"),
        *((name, name, "") for name in ("m/s", "rad/s", "1/min", "Drehzahl 1/min", "Speed rad/s", "v_rad/s")),
        *((name, name, "") for name in ("N/A", "kg/s", "I/O", "in/out")),
    ],
)
def test_a_name_over_its_unit_as_din_1313_writes_it(name: str, bare: str, unit: str) -> None:
    table = Table("a.csv", {name: np.zeros(1)})
    assert (Table.bare(name), table.unit(name)) == (bare, unit)


@pytest.mark.parametrize(
    ("unit", "factor", "says"),
    [
        ("V", 1.0, "it is in volts; 1 N m per volt is only an example"),
        ("MNm", 1e-6, "its unit 'MNm' is not known for it, write the factor"),
        ("kgf cm", 10.19716213, ""),
        ("daNm", 0.1, ""),
        ("oz-in", 141.6119327, ""),
    ],
)
def test_units_of_torque_that_strangers_bring(unit: str, factor: float, says: str, tmp_path: Path) -> None:
    """Read by their factor, or asked for; mega is never taken for milli."""
    t = np.arange(600) * 1e-3
    torque = 0.3 * np.sin(30 * t)
    rows = "".join(f"{a:.3f},{b:.12g},{c:.6f}\n" for a, b, c in zip(t, factor * torque, np.cos(30 * t) - t, strict=True))
    (path := tmp_path / "a.csv").write_text(f"Time [s],Torque [{unit}],Position [rad]\n{rows}")
    outcome = CliRunner().invoke(cli, ["import", str(path), "--run", str(tmp_path / "run")])
    assert outcome.exit_code == (1 if says else 0), outcome.output
    assert says in outcome.output
    if not says:
        found = load_recording(tmp_path / "run" / "recordings" / "a.csv").torque
        np.testing.assert_allclose(found, torque[: len(found)], atol=1e-9)
