"""``beltcomm import`` from the command line: a run folder made, continued, checked; nothing half-written."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.configfiles import read_yaml
from beltcomm.recording import load_recording
from beltcomm.runfolder import RunFolder
from foreign.samples import options, swing, text, write

MAPPED = options()


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, ["import", *map(str, words)])


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return write(tmp_path / "log 1.csv", text())


def files_of(run: Path) -> dict[str, bytes]:
    return {path.relative_to(run).as_posix(): path.read_bytes() for path in run.rglob("*") if path.is_file()}


def refused(outcome: Result, code: int, *words: str) -> None:
    assert (outcome.exit_code, outcome.stdout) == (code, ""), outcome.output
    assert "Traceback" not in outcome.stderr
    assert all(word in outcome.stderr for word in words), outcome.stderr


def test_a_run_folder_is_made_and_the_original_kept(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    done = ("--experiment", "frf", "--start-position", "50mm", "--held-out", "--closed-loop", "--payload", "3kg", "--session-time", "12s")
    excitation = ("--excitation", "multisine", "--amplitude", "0.3", "--period-samples", "500", "--first-sample", "100")
    outcome = call(log, "--run", run, "--axis", "egc-70-600", *MAPPED, *done, *excitation, "--source", "lab")
    assert outcome.exit_code == 0, outcome.output
    assert "torque_nm     Iq           0.65" in outcome.stdout
    assert "no data can tell this error of 1 ms from a real dead time" in outcome.stdout
    assert outcome.stdout.strip().endswith(f"beltcomm fit {run}")
    folder = RunFolder.open(run)
    assert folder.axis.fingerprint() == load_axis("egc-70-600").fingerprint()
    record = folder.recording("log_1")
    _, current, encoder = swing()
    np.testing.assert_allclose(record.torque, 0.65 * current, rtol=1e-14)
    np.testing.assert_allclose(record.position, 2.0 * np.pi / 65536 * encoder, rtol=1e-14)
    side = record.sidecar
    assert (side.experiment, side.start_position_m, side.held_out, side.closed_loop) == ("frf", 0.05, True, True)
    assert (side.payload_kg, side.session_time_s, side.source) == (3.0, 12.0, "lab")
    assert side.excitation is not None
    assert (side.excitation.kind, side.excitation.period_samples, side.excitation.first_sample) == ("multisine", 500, 100)
    original = run / "originals" / "log 1.csv"
    assert original.read_bytes() == log.read_bytes()
    noted = side.extra["import"]
    assert noted["sha256"] == hashlib.sha256(log.read_bytes()).hexdigest()
    assert noted["columns"] == {"t_s": "time", "torque_nm": "Iq*0.65", "position_rad": "enc*rev/65536"}


def test_further_files_join_a_run_of_the_same_axis_only(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert call(log, "--run", run, "--axis", "egc-70-600", *MAPPED).exit_code == 0
    second = write(tmp_path / "other.csv", text(samples=900))
    assert call(second, "--run", run, *MAPPED).exit_code == 0
    assert RunFolder.open(run).finished_names() == ["log_1", "other"]
    before = files_of(run)
    other = write(tmp_path / "axis.yaml", (run / "axis.yaml").read_text(encoding="utf-8").replace("0.01242", "0.0125"))
    third = write(tmp_path / "third.csv", text(samples=800))
    refused(
        call(third, "--run", run, "--axis", other, *MAPPED),
        2,
        "of another axis than --axis says (pulley.effective_radius_m 0.01242 -> 0.0125)",
    )
    refused(call(third, "--run", run, "--set", "name=mine", *MAPPED), 2, "of another axis")
    linear = ("--map", "t_s=time", "--map", "force_n=Iq*10", "--map", "position_m=enc/1e7")
    refused(call(third, "--run", run, *linear), 3, "not of one axis", "in N m and rad", "in N and m")
    refused(call(log, "--run", run, *MAPPED), 3, "has a recording log_1 already", "--name")
    assert files_of(run) == before
    assert call(log, "--run", run, "--name", "again", "--until", "1s", *MAPPED).exit_code == 0
    assert sorted(path.name for path in (run / "originals").iterdir()) == ["log 1.csv", "other.csv"]  # the same file is kept once
    (tmp_path / "new").mkdir()
    assert call(write(tmp_path / "new" / "log 1.csv", text(samples=700)), "--run", run, "--name", "b", *MAPPED).exit_code == 0
    assert read_yaml(run / "recordings" / "b.yaml")["import"]["original"] == "originals/log 1-2.csv"


def test_the_same_measurement_is_taken_once(log: Path, tmp_path: Path) -> None:
    run, again = tmp_path / "run", write(tmp_path / "again.csv", text())
    assert call(log, "--run", run, "--axis", "egc-70-600", *MAPPED).exit_code == 0
    before = files_of(run)
    refused(call(again, "--run", run, *MAPPED, "--held-out"), 3, "again is the same measurement as log_1", "held_out: true")
    assert files_of(run) == before
    refused(call(log, again, "--run", tmp_path / "other", "--axis", "egc-70-600", *MAPPED), 3, "again is the same measurement as log_1")


def test_a_fault_in_one_of_several_files_leaves_nothing_behind(log: Path, tmp_path: Path) -> None:
    run, bad = tmp_path / "run", write(tmp_path / "bad.csv", text("time,Id,enc"))
    refused(call(log, bad, "--run", run, *MAPPED), 2, "bad.csv has no column 'Iq', did you mean Id?")
    refused(call(log, log, "--run", run, *MAPPED), 2, "two files would become the recording log_1")
    refused(call(log, bad, "--run", run, "--name", "a", *MAPPED), 2, "--name a is for one file")
    refused(call(log, bad, "--run", run, "--session-time", "3s", *MAPPED), 2, "--session-time belongs to one record")
    assert not run.exists()


def test_a_dry_run_shows_everything_and_writes_nothing(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    outcome = call(log, "--run", run, "--dry-run", "--json", *MAPPED)
    assert outcome.exit_code == 0, outcome.output
    assert not run.exists()
    data = json.loads(outcome.stdout)
    assert (data["dry_run"], data["axis"]) == (True, {"name": "run", "belt": False, "minimal": True})
    (record,) = data["recordings"]
    assert (record["name"], record["samples"], record["rate_hz"], record["gaps"]) == ("log_1", 1500, pytest.approx(1e3), [])
    torque = record["columns"][1]
    assert (torque["column"], torque["from"], torque["scale"], torque["unit"]) == ("torque_nm", "Iq", 0.65, "N m")
    assert torque["rms"] == pytest.approx(0.65 * np.sqrt(np.mean(swing()[1] ** 2)))


def test_gaps_and_jitter_are_reported(tmp_path: Path) -> None:
    lines = text().splitlines()
    del lines[501:521], lines[901]
    outcome = call(write(tmp_path / "a.csv", "\n".join([*lines, ""])), "--run", tmp_path / "run", "--dry-run", *MAPPED)
    assert "gaps: 2, about 21 samples lost, the longest lasts 21 ms" in outcome.stdout
    lines = [f"{float(line.split(',')[0]) + 2e-4 * (i % 2):.4f},{line.split(',', 1)[1]}" for i, line in enumerate(text().splitlines()[1:])]
    jittering = write(tmp_path / "b.csv", "\n".join(["time,Iq,enc", *lines, ""]))
    outcome = call(jittering, "--run", tmp_path / "run", "--dry-run", *MAPPED)
    assert "note: the time steps deviate by up to" in outcome.stdout
    assert "gaps: none" in outcome.stdout


def test_without_an_axis_the_run_is_one_rigid_mass(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "lathe"
    outcome = call(log, "--run", run, "--set", "limits.speed_m_s=200mm/s", *MAPPED)
    assert outcome.exit_code == 0, outcome.output
    axis = RunFolder.open(run).axis
    assert (axis.name, axis.has_transmission, axis.limits.speed_m_s, axis.transmission_m_rad) == ("lathe", False, 0.2, 1.0)
    outcome = call(log, "--run", tmp_path / "plain", *MAPPED)
    assert "No --axis was given: the run has an axis.yaml with the name 'plain' only, one rigid mass." in outcome.stdout
    assert (tmp_path / "plain" / "axis.yaml").is_file()


def test_current_is_kept_as_such_and_scaled_by_the_axis(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    mapping = options(("t_s=time", "current_a=Iq", "position_rad=enc*rev/65536"))
    assert call(log, "--run", run, "--set", "motor.torque_constant_nm_a=0.65", *mapping).exit_code == 0
    assert load_recording(run / "recordings" / "log_1.csv").side == "ampere"
    record = RunFolder.open(run).recording("log_1")
    assert record.side == "motor"
    np.testing.assert_allclose(record.torque, 0.65 * swing()[1], rtol=1e-14)


def test_a_static_map_needs_no_time(tmp_path: Path) -> None:
    path = write(tmp_path / "map.csv", "pos,I\n" + "".join(f"{0.1 * i:.1f},{0.3 + 0.1 * (i % 5):.1f}\n" for i in range(50)))
    mapping = options(("position_rad=pos", "current_a=I"))
    assert call(path, "--run", tmp_path / "run", "--experiment", "static_map", *mapping).exit_code == 0
    assert RunFolder.open(tmp_path / "run").recording("map").is_static_map
    refused(call(path, "--run", tmp_path / "b", "--experiment", "static_map", "--rate", "1kHz", *mapping), 2, "a static map has no time")


def test_an_import_can_be_repeated_and_says_when_it_cannot(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert call(log, "--run", run, "--from", "0.1s", "--torque-acts", "before", "--keep", "all", *MAPPED).exit_code == 0
    assert "1 of 1 imports" in call("--check", "--run", run).stdout
    record = run / "recordings" / "log_1.csv"
    record.write_text(record.read_text(encoding="utf-8").replace("0.3", "0.4", 1), encoding="utf-8")
    outcome = call("--check", "--run", run)
    assert outcome.exit_code == 1
    assert "log_1: it differs from its original in" in outcome.stdout
    original = run / "originals" / "log 1.csv"
    original.write_text("changed\n", encoding="utf-8")
    assert "was changed since" in call("--check", "--run", run).stdout
    original.unlink()
    assert "is missing" in call("--check", "--run", run).stdout
    refused(call("--check", log, "--run", run), 2, "--check takes --run RUN and no FILE")
    refused(call("--check", "--run", tmp_path / "none"), 3, "does not exist")


def test_a_run_that_was_recorded_on_a_drive_takes_no_foreign_files(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    RunFolder.create(run, load_axis("egc-70-600")).claim_drive({"vendor": "acme", "serial": "7"})
    before = files_of(run)
    refused(call(log, "--run", run, *MAPPED), 2, "was recorded on a drive (serial 7, vendor acme)", "a run of their own")
    assert files_of(run) == before


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        ((), 2, "no file is given"),
        (("nothing.csv", *MAPPED), 2, "nothing.csv does not exist"),
        (("LOG", "--rate", "0", *MAPPED), 2, "--rate is 0 Hz; it must be positive"),
        (("LOG", "--rate", "1kHz", "--period", "1ms", *MAPPED), 2, "say the same; give one"),
        (("LOG", "--rows", "5-7", *MAPPED), 2, "write FIRST:LAST"),
        (("LOG", "--period-samples", "500", *MAPPED), 2, "give its kind with --excitation"),
        (("LOG", "--axis", "egc-70-60", *MAPPED), 2, "did you mean egc-70-600?"),
        (("LOG", "--map", "t_s=time", "--map", "torque_nm=Iq*0.65"), 1, "not sure which column is which"),
        (("LOG", "--dry-run", "--map", "t_s=time", "--map", "torque_nm=Iq*0.65"), 1, "or leave --dry-run out to get a file"),
        (("LOG", "--map", "t_s=time", "--map", "torque_nm=-0.65*Iq", "--map", "position_rad=enc*rev/65536"), 3, "turn one sign"),
        (
            ("LOG", "--axis", "egc-70-600", *options(("t_s=time", "torque_nm=Iq*650", "position_rad=enc*rev/65536"))),
            3,
            "motor.peak_torque_nm",
        ),
        (("LOG", "--name", "a/b", *MAPPED), 2, "cannot be a name"),
    ],
)
def test_what_is_wrong_is_said(log: Path, tmp_path: Path, words: tuple[str, ...], code: int, sentence: str) -> None:
    run = tmp_path / "run"
    refused(call(*(log if word == "LOG" else word for word in words), "--run", run), code, sentence)
    assert not run.exists()


def test_the_api_does_the_same(log: Path, tmp_path: Path) -> None:
    reading = api.Reading(mapping=("t_s=time", "torque_nm=Iq*0.65", "position_rad=enc*rev/65536"))
    result = api.import_recordings([log], tmp_path / "run", reading, axis="egc-70-600")
    assert result.to_json()["recordings"][0]["name"] == "log_1"
    assert api.check_imports(tmp_path / "run").exit_code == 0


def test_an_axis_without_a_belt_has_a_report_and_no_design(log: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    assert call(log, "--run", run, *MAPPED).exit_code == 0
    for words, code, said in (
        (("report", run), 0, ("Report:", "no design (none is made of an axis without belt and pulley)")),
        (("design", run), 2, ("neither belt nor pulley",)),
        (("fit", run), 2, ("diagnose",)),
    ):
        outcome = CliRunner().invoke(cli, [*map(str, words)])
        assert outcome.exit_code == code, outcome.output
        assert all(words in outcome.output for words in said), outcome.output
        assert "Traceback" not in outcome.output


def test_what_is_written_can_be_read_back_whatever_it_is_called(tmp_path: Path) -> None:
    time, current, encoder = (values.tolist() for values in swing(900))
    angle = [2.0 * np.pi / 65536 * value for value in encoder]
    odd = {"bad\ud800name": time, "new\nline": time, 'quote"x,y': time, "\u2028": time}
    log = tmp_path / b"\xff\xfelog.json".decode("utf-8", "surrogateescape")
    log.write_text(json.dumps({"t_s": time, "torque_nm": current, "position_rad": angle, **odd}), encoding="utf-8")
    run = tmp_path / "run"
    outcome = call(log, "--run", run, "--keep", "all", "--source", "from \udcff")
    assert outcome.exit_code == 0, outcome.output
    assert call("--check", "--run", run).stdout.count("the same, bit by bit") == 1
    (name,) = RunFolder.open(run).finished_names()
    assert {"bad\ufffdname", "new line", 'quote"x,y'} <= set(RunFolder.open(run).recording(name).extra)


LONG = 4_000_000


def test_a_field_of_any_length_and_any_end_of_line_in_it_is_data(tmp_path: Path) -> None:
    """Beyond the 131 072 characters at which the csv module stops by itself; as wide a place in every row would take 10 GB."""
    rows = text(header="time,Iq,enc,note").splitlines()
    said = ["x" * LONG if k == 7 else "a\u2028b\x0cc" for k in range(len(rows) - 1)]
    rows[1:] = [f'{row},"{words}"' for row, words in zip(rows[1:], said, strict=True)]
    log = write(tmp_path / "log.csv", "\n".join(rows) + "\n")
    outcome = call(log, "--run", tmp_path / "run", *MAPPED, "--keep", "note")
    assert outcome.exit_code == 0, outcome.output
    notes = RunFolder.open(tmp_path / "run").recording("log").extra["note"]
    assert (len(notes[7]), notes[8]) == (LONG, "a\u2028b\x0cc")
