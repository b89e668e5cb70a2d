"""What a session on a drive leaves behind: the bus's log, readable by other tools, and a bundle that names nobody."""

from __future__ import annotations

import gzip
import zipfile
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import can
import pytest
from click.testing import CliRunner, Result

from beltcomm import api
from beltcomm.cli.main import cli
from beltcomm.drive import Drive, open_drive
from beltcomm.errors import UsageError
from beltcomm.jobs.bundle import VERSIONS, _scrubbed, bundle, write_bundle
from beltcomm.rundata import buslog
from beltcomm.rundata.buslog import BusLog, Frame, _is_cyclic
from beltcomm.virtual.faults import Faults
from beltcomm_adapters.canopen import LoggedBus, connect

AXIS = "egc-70-600"


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words], catch_exceptions=False)


def read_back(path: Path, folder: Path) -> list[can.Message]:
    """The log by python-can's own reader of candump files."""
    plain = folder / "plain.log"
    plain.write_bytes(gzip.decompress(path.read_bytes()))
    with can.CanutilsLogReader(plain) as reader:
        return list(reader)


def test_a_log_is_read_by_another_program_frame_by_frame(tmp_path: Path) -> None:
    log = BusLog()
    frames: list[Frame] = [
        (0.001, 0x601, b"\x40\x00\x10\x00\x00\x00\x00\x00", "host"),
        (0.001, 0x181, b"", "node"),
        (0.0125, 0x80, b"", "host"),
    ]
    for frame in frames:
        log(frame)
    log((1234.5, 0x701, b"", "host rtr"))
    seen = read_back(log.write(tmp_path / "bus", "identify", "can0"), tmp_path)
    assert [(m.timestamp, m.arbitration_id, bytes(m.data)) for m in seen[:3]] == [frame[:3] for frame in frames]
    assert (seen[3].timestamp, seen[3].arbitration_id, seen[3].is_remote_frame) == (1234.5, 0x701, True)
    assert {m.channel for m in seen} == {"can0"}
    assert log.write(tmp_path / "bus", "identify", "can0").name == "identify-2.log.gz"  # an earlier one is never overwritten


def test_cyclic_frames_are_kept_for_a_while_and_the_others_for_good(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(buslog, "CYCLIC_KEPT", 10)
    log = BusLog()
    log((0.0, 0x581, b"\x01", "node"))
    for n in range(100):
        log((0.001 * n, 0x181, bytes([n]), "node"))
    log((0.2, 0x81, b"\x10\x43\x09\0\0\0\0\0", "node"))
    lines = list(log.lines("can0"))
    assert lines[0].endswith("581#01")
    assert [line[-2:] for line in lines[1:-1]] == [f"{n:02X}" for n in range(90, 100)]
    assert lines[-1].endswith("081#1043090000000000")
    assert log.dropped == 90


def test_what_is_cyclic_is_told_by_the_identifier() -> None:
    """CiA 301, tables 38 and 39: SYNC 80h, PDOs 180h to 57Fh, NMT error control 700h on."""
    assert all(_is_cyclic(i) for i in (0x80, 0x181, 0x57F, 0x701))
    assert not any(_is_cyclic(i) for i in (0x0, 0x81, 0xFF, 0x581, 0x601, 0x67F))


def test_a_logged_bus_writes_down_all_that_passes_the_hosts_end(tmp_path: Path) -> None:
    wire: list[Frame] = []
    first: Any = open_drive("virtual:g_a", {"log": wire.append})
    bus, log = first._link.bus, list[Frame]()
    wire.clear()
    with connect(LoggedBus(bus, bus.clock, log.append), bus.clock, 1, None, None, lambda: None) as drive:
        drive.read(["position_rad"])
    assert [frame[1:] for frame in log] == [frame[1:] for frame in wire]
    assert len(log) > 50
    first._open = False
    bus.shutdown()


def test_a_virtual_session_keeps_its_log_when_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert call("move", "--drive", "virtual", "--by", "5mm", "--yes").exit_code == 0
    assert not (tmp_path / "runs").exists()
    assert call("move", "--drive", "virtual", "--by", "5mm", "--yes", "--bus-log").exit_code == 0
    (path,) = (tmp_path / "runs").rglob("*.log.gz")
    assert path.parts[-3:-1] == (path.parts[-3], "bus")
    seen = read_back(path, tmp_path)
    kinds = {m.arbitration_id for m in seen}
    assert {0x0, 0x80, 0x181, 0x201, 0x581, 0x601} <= kinds
    assert all(b.timestamp >= a.timestamp for a, b in pairwise(seen))


def test_a_session_on_hardware_that_ends_badly_leaves_log_and_bundle(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A virtual drive that calls itself can0 and faults while it is enabled."""

    def opened(name: str, options: Mapping[str, object] | None = None) -> Drive:
        assert name == "can0"
        return open_drive("virtual:g_a", {**(options or {}), "faults": Faults(emergency_at_s=0.5, emergency_code=0x4210)})

    monkeypatch.setattr(api, "open_drive", opened)
    run = tmp_path / "somebody" / "run"
    run.parent.mkdir()
    ended = call("identify", "--drive", "can0", "--axis", AXIS, "--run", run, "--yes")
    assert ended.exit_code == 5
    assert f"all that somebody who helps needs is in {run / 'bundle.zip'}" in ended.stderr
    emergencies = [m for m in read_back(run / "bus" / "identify.log.gz", tmp_path) if m.arbitration_id == 0x81]
    codes = [bytes(m.data[:2]) for m in emergencies]
    assert codes[:3] == [b"\x30\x81", b"\0\0", b"\x10\x42"]  # its guarding was tried, and acknowledged; then the fault
    with zipfile.ZipFile(run / "bundle.zip") as archive:
        names = set(archive.namelist())
        content = {name: archive.read(name) for name in names}
    assert {"axis.yaml", "run.yaml", "journal.txt", "results/backup.yaml", "results/drive.yaml", "bus/identify.log.gz", VERSIONS} <= names
    assert b"beltcomm reference drive" in content["run.yaml"]  # which drive it was
    assert not any(str(tmp_path).encode() in text for text in content.values())
    # the same folder can be begun again: nothing had been recorded
    monkeypatch.setattr(api, "open_drive", lambda _name, options=None: open_drive("virtual:g_a", options or {}))
    assert call("identify", "--drive", "can0", "--axis", AXIS, "--run", run, "--dry-run").exit_code == 0


def test_a_bundle_names_neither_places_nor_people(tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / "recordings").mkdir(parents=True)
    # built from parts: the sources of this project name no folder of a machine
    home, windows = "/" + "home/marie/axes/left.yaml", "C" + ":\\Users\\marie\\axes\\left.yaml"
    said = f"read {home} and {windows} at marie-desk, drive /dev/ttyUSB0, 3 N m/s and 2 m/s², see docs/import.md"
    (run / "journal.txt").write_text(said, encoding="utf-8")
    (run / "recordings" / "frf_1.csv").write_text("t_s,torque_nm\n0,1\n", encoding="utf-8")
    (run / "recordings" / "frf_1.yaml").write_text("experiment: frf\n", encoding="utf-8")
    (run / "picture.png").write_bytes(b"\x89PNG")
    out = tmp_path / "out.zip"
    names = write_bundle(run, out, private=["marie", "marie-desk"])
    assert sorted(names) == ["journal.txt", "recordings/frf_1.yaml", VERSIONS]
    with zipfile.ZipFile(out) as archive:
        text = archive.read("journal.txt").decode()
        versions = archive.read(VERSIONS).decode()
    assert text == "read .../left.yaml and .../left.yaml at ..., drive /dev/ttyUSB0, 3 N m/s and 2 m/s², see docs/import.md"
    assert "python-can 4" in versions
    assert "python 3" in versions
    assert "recordings/frf_1.csv" in write_bundle(run, out, recordings=True)


def test_a_bundle_of_nothing_or_into_nowhere_is_refused(tmp_path: Path) -> None:
    ended = call("bundle", tmp_path / "none")
    assert ended.exit_code == 3
    assert "does not exist" in ended.stderr
    with pytest.raises(UsageError, match=r"cannot be written.*--out"):
        write_bundle(tmp_path, tmp_path / "missing" / "out.zip")


def test_a_bundle_replaces_nothing_but_a_bundle(tmp_path: Path) -> None:
    run, mine = tmp_path / "run", tmp_path / "mine.zip"
    (run / "recordings").mkdir(parents=True)
    mine.write_text("a letter")
    with pytest.raises(UsageError, match="exists and is no bundle"):
        bundle(run, mine)
    assert mine.read_text() == "a letter"
    for _ in range(2):
        assert bundle(run, tmp_path / "ours.zip").exit_code == 0


def test_units_are_no_paths() -> None:
    assert _scrubbed("1/s, kg/m, N/m/s and 1e-3/2/3", []) == "1/s, kg/m, N/m/s and 1e-3/2/3"
