"""The run folder: made by the tool or by hand, half there, resumed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm.axis import Coupling, load_axis, save_axis
from beltcomm.errors import DataError, NoMotion, UsageError
from beltcomm.jobs.design import _keep_replaced
from beltcomm.recording import Recording, Sidecar
from beltcomm.runfolder import RunFolder

RIG = load_axis("egc-70-600")
DRIVE = {"name": "reference", "serial": "1"}


def rows(samples: int = 40) -> list[tuple[float, ...]]:
    t = 1e-3 * np.arange(samples)
    nan = np.full(samples, np.nan)
    return list(zip(*(c.tolist() for c in (t, 0.1 * np.sin(50 * t), nan, np.cos(20 * t), nan, nan, nan, nan)), strict=True))


def record(run: RunFolder, name: str, experiment: str = "frf", finished: bool = True) -> None:
    writer = run.new_recording(name, Sidecar(experiment=experiment))
    for row in rows():
        writer.write(row)
    writer.close(finished=finished)


def test_a_new_run_and_what_it_holds(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "deep" / "R", RIG)
    record(run, "frf_1")
    record(run, "sweep", "friction_sweep")
    record(run, "frf_2", finished=False)
    again = RunFolder.open(run.path)
    assert again.axis == RIG
    assert (again.finished_names(), again.unfinished()) == (["frf_1", "sweep"], ["frf_2"])
    assert [item.name for item in again.recordings()] == ["frf_1", "sweep"]
    assert [item.name for item in again.recordings("friction_sweep")] == ["sweep"]
    assert again.finished("frf_1") == run.path / "recordings" / "frf_1.csv"
    assert again.finished("frf_2") is None


def test_models_and_results_come_back_exactly(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    mapping = {"mass": {"value": 0.1 + 0.2, "interval": None}, "gains": [1e-17, 5.0], "name": "1e-6"}
    for kind in ("models", "results"):
        assert run.save(kind, "first", mapping | {"gains": np.array([1e-17, 5.0])}) == run.path / kind / "first.yaml"
        assert run.load(kind, "first") == mapping
    assert run.load_result("first") == mapping
    assert run.load_result("none") is None
    run.save("models", "second", {})
    assert run.names("models") == ["first", "second"]


STRUCTURE = {"name": "x", "period_s": 1e-3, "prefilters": []}
DESIGN = {"dead_time_s": 1e-3, "structure": STRUCTURE, "specification": {"phase_margin_deg": 45.0}, "margins": []}


def test_a_design_that_is_replaced_takes_the_next_free_name(tmp_path: Path) -> None:
    """Not the one that a count of them gives: somebody may have taken one away."""
    run = RunFolder.create(tmp_path / "R", RIG)
    designs = {f"{k}": DESIGN | {"parameters": {"kpp_1_s": float(k)}} for k in range(1, 5)}
    run.save("designs", "replaced_2", designs["4"])
    for k, name in ((1, "replaced_1"), (2, "replaced_3")):
        run.save("designs", "final", designs[f"{k}"])
        assert _keep_replaced(run, designs["3"]) == f"designs/{name}.yaml"
        assert run.load("designs", name) == designs[f"{k}"]
    assert run.load("designs", "replaced_2") == designs["4"]
    assert _keep_replaced(run, designs["2"]) == ""


def test_missing_models_are_named_with_the_command_that_makes_them(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    run.save("models", "final", {})
    with pytest.raises(DataError, match=r"the model finl is not in .*R, did you mean final\?; make it with `beltcomm fit"):
        run.load("models", "finl")
    with pytest.raises(DataError, match=r"make it with `beltcomm design"):
        run.load("designs", "final")


def test_the_journal_grows_line_by_line(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    run.journal("connected")
    run.journal("wrote\nkp = 3")
    assert (run.path / "journal.txt").read_text(encoding="utf-8") == "connected\nwrote kp = 3\n"


def test_an_existing_folder_is_refused_unless_it_is_resumed(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    RunFolder.create(tmp_path / "empty", RIG)
    run = RunFolder.create(tmp_path / "empty", RIG)  # nothing has happened in it yet
    run.journal("connected to a drive; parameters saved as backup", "connected")
    run = RunFolder.create(tmp_path / "empty", RIG)
    assert not (run.path / "journal.txt").exists()
    record(run, "a", finished=False)
    with pytest.raises(UsageError, match="exists; choose another folder, or go on with that run"):
        RunFolder.create(tmp_path / "empty", RIG)
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="exists"):
        RunFolder.create(tmp_path / "file", RIG)


def test_resume_keeps_what_is_finished_and_repeats_the_rest(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    run.claim_drive(DRIVE)
    record(run, "a")
    record(run, "b", finished=False)
    again = RunFolder.create(tmp_path / "R", replace(RIG, source="elsewhere"), resume=True)
    again.claim_drive(DRIVE)
    assert again.finished_names() == ["a"]
    with pytest.raises(DataError, match="raw recordings are never changed"):
        again.new_recording("a", Sidecar())
    record(again, "b")
    assert (again.finished_names(), again.unfinished()) == (["a", "b"], [])
    assert (again.recordings_folder / "b.unfinished1.csv.part").is_file()
    assert [item.name for item in again.recordings()] == ["a", "b"]


def test_a_run_that_had_no_room_for_its_first_file_is_begun_by_going_on(tmp_path: Path) -> None:
    (tmp_path / "R").mkdir()
    run = RunFolder.create(tmp_path / "R", RIG, resume=True)
    assert run.axis == RIG
    (tmp_path / "others").mkdir()
    (tmp_path / "others" / "letter.txt").write_text("dear", encoding="utf-8")
    with pytest.raises(DataError, match="is no run folder"):
        RunFolder.create(tmp_path / "others", RIG, resume=True)


def test_resume_demands_the_same_axis_and_drive(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    run.claim_drive(DRIVE)
    other = replace(RIG, coupling=Coupling(inertia_kg_m2=3.3e-6, stiffness_nm_rad=168.75))
    with pytest.raises(UsageError, match=r"the axis has changed since .*coupling\.inertia_kg_m2 3\.2e-06 -> 3\.3e-06"):
        RunFolder.create(tmp_path / "R", other, resume=True)
    save_axis(other, run.path / "axis.yaml")
    with pytest.raises(UsageError, match=r"its axis\.yaml was edited"):
        RunFolder.create(tmp_path / "R", other, resume=True)
    save_axis(RIG, run.path / "axis.yaml")
    again = RunFolder.create(tmp_path / "R", RIG, resume=True)
    with pytest.raises(UsageError, match=r"made on another drive \(serial 1 -> 2\); begin a new run"):
        again.claim_drive(DRIVE | {"serial": "2"})
    for silent in ({}, {"serial": ""}):  # a name that was not told says nothing of another drive
        again.claim_drive({key: value for key, value in DRIVE.items() if key != "serial"} | silent)
    with pytest.raises(UsageError, match="does not exist; check --run or leave --resume out"):
        RunFolder.create(tmp_path / "S", RIG, resume=True)


def by_hand(path: Path, *, axis: bool = True, recording: bool = True, sidecar: bool = False) -> Path:
    """A folder as a user makes it from foreign measurements."""
    (path / "recordings").mkdir(parents=True)
    if axis:
        save_axis(RIG, path / "axis.yaml")
    if recording:
        lines = [f"{t!r},{q!r},{x!r}" for t, q, _, x, *_ in rows()]
        (path / "recordings" / "a.csv").write_text("\n".join(["t_s,torque_nm,position_rad", *lines]), encoding="utf-8")
    if sidecar:
        (path / "recordings" / "b.yaml").write_text("experiment: frf\n", encoding="utf-8")
    return path


def test_a_folder_made_by_hand_works(tmp_path: Path) -> None:
    run = RunFolder.open(by_hand(tmp_path / "R"))
    assert [item.sidecar.experiment for item in run.recordings()] == ["free"]
    assert run.axis == RIG


def test_a_record_without_motion_is_left_out_beside_others_and_told(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    writer = run.new_recording("still", Sidecar(experiment="frf"))
    for row in rows():
        writer.write((*row[:3], 3.0, *row[4:]))
    writer.close(finished=True)
    with pytest.raises(NoMotion, match=r"still\.csv: position_rad is 3 rad in every row"):
        run.recordings()
    record(run, "moved")
    assert [item.name for item in run.recordings()] == ["moved"]
    assert len(run.remarks) == 1
    assert run.remarks[0].startswith("left out: ")
    assert "still.csv: position_rad is 3 rad in every row: the axis did not move" in run.remarks[0]


def test_a_folder_half_there_says_what_is_missing(tmp_path: Path) -> None:
    without_axis = RunFolder.open(by_hand(tmp_path / "A", axis=False))
    assert len(without_axis.recordings()) == 1
    with pytest.raises(DataError, match=r"A/axis\.yaml is missing; copy the axis file there or write one with `beltcomm init"):
        _ = without_axis.axis
    with pytest.raises(DataError, match="holds no complete recording"):
        RunFolder.open(by_hand(tmp_path / "B", recording=False)).recordings()
    with pytest.raises(DataError, match=r"b\.yaml describes a recording, but b\.csv is missing"):
        RunFolder.open(by_hand(tmp_path / "C", sidecar=True)).recordings()
    bare = tmp_path / "D"
    bare.mkdir()
    with pytest.raises(DataError, match=r"no run folder: it has neither axis\.yaml nor recordings/"):
        RunFolder.open(bare)
    save_axis(RIG, bare / "axis.yaml")
    with pytest.raises(DataError, match="recordings is missing; record with"):
        RunFolder.open(bare).recordings()
    with pytest.raises(DataError, match="does not exist; give the folder"):
        RunFolder.open(tmp_path / "nowhere")
    with pytest.raises(DataError, match="is a file, not a folder"):
        RunFolder.open(bare / "axis.yaml")


def test_only_broken_off_records_are_named_with_the_remedy(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    record(run, "a", finished=False)
    with pytest.raises(DataError, match="broken off were a: finish them with --resume"):
        run.recordings()
    with pytest.raises(DataError, match=r"the recording a in .* was broken off"):
        run.recording("a")
    with pytest.raises(DataError, match=r"b\.csv does not exist"):
        run.recording("b")


def test_recordings_are_checked_against_the_axis(tmp_path: Path) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    t = 1e-3 * np.arange(100)
    run.add_recording(Recording(name="far", t_s=t, torque=np.sin(t), position=1e3 * t))
    with pytest.raises(DataError, match=r"more than the 0\.58 m"):
        run.recordings()


@pytest.mark.parametrize("name", ["", "../x", "a/b", ".hidden", "a b", "ä"])
def test_names_that_are_no_file_names_are_refused(tmp_path: Path, name: str) -> None:
    run = RunFolder.create(tmp_path / "R", RIG)
    with pytest.raises(UsageError, match="cannot be a name"):
        run.save("models", name, {})
    with pytest.raises(UsageError, match="cannot be a name"):
        run.new_recording(name, Sidecar())


def test_a_place_that_cannot_be_written_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot be made: Not a directory; choose another --run folder"):
        RunFolder.create(tmp_path / "file" / "R", RIG)


def test_a_mistyped_run_folder_is_answered_with_the_one_that_is_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("egc-70-600-20261122-110545", "lift"):
        (tmp_path / "runs" / name / "recordings").mkdir(parents=True)
    for typed in ("runs/egc-70-600-20261122-11054", "egc-70-600-20261122-110545"):
        with pytest.raises(DataError, match=r"did you mean runs/egc-70-600-20261122-110545\?"):
            RunFolder.open(Path(typed))
    with pytest.raises(DataError) as unlike:
        RunFolder.open(Path("runs/zzz"))
    assert "did you mean" not in str(unlike.value)
