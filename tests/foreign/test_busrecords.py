"""A log that candump makes while the adapter records: the imported columns are the adapter's own, row by row."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from beltcomm.axis import Axis, load_axis
from beltcomm.cli.main import cli
from beltcomm.errors import DataError
from beltcomm.foreign.busrecords import _whole_rows, records_of
from beltcomm.foreign.framelog import FrameLog, read_frames
from beltcomm.model import load_plant
from beltcomm.runfolder import RunFolder
from foreign.buslog import Logged, candump, logged

AXIS = load_axis("egc-70-600")
RAD = 2.0 * np.pi / 65536
#: Half a step of each column's raw number, and what the position differs by in the last digit of a float.
HALF_STEP = {"t_s": 1e-9, "torque_nm": 0.5 * 1.43e-3, "torque_setpoint_nm": 0.5 * 1.43e-3, "position_rad": 0.5 * RAD}


@pytest.fixture(scope="module")
def reference() -> Logged:
    return logged("reference")


@pytest.fixture(scope="module")
def log(reference: Logged, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return candump(reference.frames, tmp_path_factory.mktemp("log") / "moves.log")


@pytest.fixture(scope="module")
def frames(log: Path) -> FrameLog:
    return read_frames(log)


def place_of(own: Mapping[str, NDArray[np.float64]], found: Mapping[str, NDArray[np.float64]]) -> int:
    """The row of ``found`` at which the adapter's record begins: the only one at which the positions agree."""
    rows = len(own["position_rad"])
    fits = [
        k
        for k in range(len(found["position_rad"]) - rows + 1)
        if np.all(np.abs(found["position_rad"][k : k + rows] - own["position_rad"]) < 0.5 * RAD)
    ]
    assert len(fits) == 1, fits
    return fits[0]


def check_the_same(own: Mapping[str, NDArray[np.float64]], found: Mapping[str, NDArray[np.float64]]) -> None:
    first = place_of(own, found)
    for name, column in own.items():
        part = found[name][first : first + len(column)]
        if name == "t_s":
            part = part - part[0]
        np.testing.assert_allclose(part, column, rtol=0.0, atol=HALF_STEP.get(name, 1e-9), err_msg=name)


def test_every_column_is_the_adapters_own(reference: Logged, frames: FrameLog) -> None:
    found = records_of(frames, AXIS)
    assert [(r.experiment, r.closed_loop) for r in found] == [("frf", False), ("trajectory", True), ("free", True)]
    for own, record in zip(reference.own, found, strict=True):
        assert set(own) <= set(record.table.columns)
        check_the_same(own, record.table.columns)
    note = found[0].excitation
    assert note is not None
    assert (note.kind, note.period_samples) == ("prbs", 512)
    assert note.amplitude_nm == pytest.approx(0.25, abs=0.5 * 1.43e-3)
    torque = found[0].table.columns["torque_setpoint_nm"][note.first_sample :]
    np.testing.assert_array_equal(torque[: 3 * 512], np.tile(torque[:512], 3))


def test_the_factor_group_and_mode_4_of_the_other_profile(tmp_path: Path) -> None:
    made = logged("cmmp-as", ("torque",))
    (record,) = records_of(read_frames(candump(made.frames, tmp_path / "a.log")), Axis(name="bare"))
    check_the_same(made.own[0], record.table.columns)
    assert "drive: Festo CMMP-AS, node 1" in record.table.notes
    assert any("65536 per rev by the factor group 6093h" in note for note in record.table.notes)


def test_a_run_folder_is_made_that_can_be_compared(log: Path, tmp_path: Path) -> None:
    """With the virtual plant's own parameters as the model, what is left is the torque sensor's noise."""
    run = tmp_path / "run"
    words = ["import", str(log), "--run", str(run), "--axis", "egc-70-600", "--start-position", "250mm", "--record", "1"]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 0, outcome.output
    record = RunFolder.open(run).recording("moves")
    assert record.sidecar.experiment == "frf"
    assert record.sidecar.start_position_m == 0.25
    assert outcome.stdout.count("doubt:") == 0
    RunFolder.open(run).save("models", "final", load_plant("g_a").model.to_dict())
    done = CliRunner().invoke(cli, ["compare", str(run), "--no-pictures", "--json"])
    assert done.exit_code == 0, done.output
    (found,) = json.loads(done.stdout)["records"]
    assert found["ratio"] == pytest.approx(1.0, abs=0.15)
    assert "1 of 1 imports" in CliRunner().invoke(cli, ["import", "--check", "--run", str(run)]).stdout


def test_the_moves_of_one_log_share_clock_and_carriage(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = ["import", str(log), "--run", str(run), "--axis", "egc-70-600", "--start-position", "250mm"]
    assert CliRunner().invoke(cli, words).exit_code == 0
    records = RunFolder.open(run).recordings()
    assert [r.name for r in records] == ["moves_1", "moves_2", "moves_3"]
    ratio = AXIS.transmission_m_rad
    first = records[0]
    for record in records:
        start, at = record.sidecar.start_position_m, record.sidecar.session_time_s
        assert start == pytest.approx(0.25 + ratio * (record.position[0] - first.position[0]), abs=1e-12)
        assert at is not None
    assert records[0].sidecar.session_time_s < records[1].sidecar.session_time_s < records[2].sidecar.session_time_s  # type: ignore[operator]
    assert "3 of 3 imports" in CliRunner().invoke(cli, ["import", "--check", "--run", str(run)]).stdout


def test_lost_answers_cost_rows_and_no_torque_is_moved_across_the_gap(frames: FrameLog) -> None:
    """A lost sample costs its own row and the one before, whose torque it held."""
    lost = np.flatnonzero(frames.identifier == 0x181)[1000]
    kept = np.delete(np.arange(len(frames.t_s)), lost)
    parts = (frames.t_s[kept], frames.identifier[kept], frames.remote[kept], frames.length[kept], frames.data[kept])
    whole = records_of(frames, AXIS)[0].table
    lossy = records_of(FrameLog("lossy.log", *parts), AXIS)[0].table
    assert len(whole.columns["t_s"]) - len(lossy.columns["t_s"]) == 2
    kept = np.isin(np.round(whole.columns["t_s"] / 1e-3), np.round(lossy.columns["t_s"] / 1e-3))
    for name in ("torque_nm", "position_rad", "torque_setpoint_nm"):
        np.testing.assert_array_equal(whole.columns[name][kept], lossy.columns[name])
    assert "1 rows without a torque left out" in lossy.notes


def test_a_log_that_begins_too_late_says_what_is_on_the_bus_and_takes_it_by_hand(reference: Logged, tmp_path: Path) -> None:
    started = next(k for k, frame in enumerate(reference.frames) if frame[1] == 0x80)
    late = [frame for frame in reference.frames[started:] if frame[1] not in (0x581, 0x601)]
    path = candump(late[:9000], tmp_path / "late.log")
    with pytest.raises(
        DataError, match=r"which frames carry the position 6064h cannot be told.*181h \(\d+ frames of 8 bytes.*--signal 6064h=181:0:i32"
    ):
        records_of(read_frames(path), AXIS)
    run = tmp_path / "late"
    mapping = ["--map", "position_rad=6064h*rev/65536", "--map", "torque_nm=6077h*1.43/1000"]
    signals = ["--signal", "6064h=181:0:i32", "--signal", "6077h=181:4:i16"]
    outcome = CliRunner().invoke(
        cli, ["import", str(path), "--run", str(run), *signals, *mapping, "--torque-acts", "before", "--until", "3s"]
    )
    assert outcome.exit_code == 0, outcome.output
    check = RunFolder.open(run).recording("late")
    own = {name: column[:2000] for name, column in reference.own[0].items()}
    check_the_same({name: own[name] for name in ("torque_nm", "position_rad")}, check.columns())


def test_torque_acts_overrules_the_profile(frames: FrameLog) -> None:
    moved, plain = (records_of(frames, AXIS, None, acts)[0].table.columns["torque_nm"] for acts in ("before", "after"))  # type: ignore[arg-type]
    np.testing.assert_array_equal(moved[:-1], plain[1:])


def test_without_syncs_the_rows_are_the_frames_with_the_position(reference: Logged, frames: FrameLog) -> None:
    kept = np.flatnonzero(frames.identifier != 0x80)
    parts = (frames.t_s[kept], frames.identifier[kept], frames.remote[kept], frames.length[kept], frames.data[kept])
    found = records_of(FrameLog("event.log", *parts), AXIS)
    assert len(found) == 3
    own = {name: reference.own[0][name] for name in ("t_s", "torque_nm", "position_rad")}
    check_the_same(own, found[0].table.columns)


def test_an_axis_that_does_not_move_is_no_record(reference: Logged, tmp_path: Path) -> None:
    first = next(k for k, frame in enumerate(reference.frames) if frame[1] == 0x80)
    path = candump(reference.frames[:first], tmp_path / "setup.log")
    with pytest.raises(DataError, match=r"holds no move|cannot be told"):
        records_of(read_frames(path), AXIS)


@pytest.mark.parametrize("missing", [2, 7])
def test_a_signal_that_comes_less_often_costs_itself_and_no_row(missing: int) -> None:
    """Missing in every second row, or in every seventh: the torque beside it is there in all of them."""
    rows = np.arange(200)
    often = np.where(rows % missing == 0, np.nan, 1.0)
    words: list[str] = []
    left = _whole_rows({"t_s": 1e-3 * rows, "torque_nm": np.ones(200), "position_rad": np.ones(200), "velocity_rad_s": often}, words)
    assert list(left) == ["t_s", "torque_nm", "position_rad"]
    assert len(left["t_s"]) == 200
    assert words == [f"velocity_rad_s came in {np.isfinite(often).sum()} of 200 rows and is left out"]
