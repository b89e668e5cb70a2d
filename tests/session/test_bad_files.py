"""Axis files, run folders and move files that are wrong: a sentence with the remedy and the right exit code, nothing moved."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm import api
from beltcomm.cli.main import cli
from beltcomm.configfiles import read_yaml, sealed, to_yaml, unsealed
from beltcomm.errors import DataError
from beltcomm.pages import job
from session.bench import Bench

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
AXIS_FILE = Path(__file__).parents[2] / "configs" / "axes" / "egc-70-600.yaml"
DRIVE = ("--drive", "virtual:g_a", "--yes", "--seed", "1")


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words])


def refuses(outcome: Result, code: int, *words: str) -> None:
    """One sentence on stderr with all these words, nothing on stdout, no traceback."""
    assert outcome.exit_code == code, outcome.output
    assert outcome.stdout == ""
    (sentence,) = [line for line in outcome.stderr.splitlines() if line.startswith("beltcomm: ")]
    assert "Traceback" not in outcome.stderr
    assert "unexpected error" not in sentence
    for word in words:
        assert word in sentence


@pytest.mark.parametrize("verb", ["identify", "commission"])
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            "rated_torque_nm: 1.43",
            "rated_torqe_nm: 1.43",
            ["line 8", "unknown key 'rated_torqe_nm' in motor", "did you mean rated_torque_nm?"],
        ),
        ("peak_torque_nm: 3.10", "peak_torque_nm: -3.10", ["line 9", "motor.peak_torque_nm is -3.1 N m; it must be above 0"]),
        ("feed_force_n: 100.0, ", "", ["needs limits.feed_force_n", "add it from the data sheet"]),
        ("max_m: 0.57", "max_m: -0.57", ["travel.min_m is -0.01 m; it must be below travel.max_m, -0.57 m"]),
        ("rated_torque_nm: 1.43", "rated_torque_nm: [1.43", ["axis.yaml", "line"]),
    ],
)
def test_a_wrong_axis_file(make_bench: MakeBench, tmp_path: Path, verb: str, old: str, new: str, words: list[str]) -> None:
    text = AXIS_FILE.read_text(encoding="utf-8")
    assert old in text
    path, bench = tmp_path / "axis.yaml", make_bench()
    path.write_text(text.replace(old, new), encoding="utf-8")
    refuses(call(verb, *DRIVE, "--axis", path, "--run", tmp_path / "run"), 2, *words)
    assert bench.opened == 0
    assert not (tmp_path / "run").exists()


def test_an_axis_nobody_knows(tmp_path: Path) -> None:
    refuses(call("identify", *DRIVE, "--axis", "egc-70-60", "--run", tmp_path / "run"), 2, "egc-70-60", "egc-70-600")


def test_a_plant_nobody_knows(tmp_path: Path) -> None:
    refuses(call("identify", "--drive", "virtual:g_c", "--yes", "--run", tmp_path / "run"), 2, "g_c", "g_a")
    assert not (tmp_path / "run").exists()


def test_a_drive_no_adapter_knows(tmp_path: Path) -> None:
    words = ("identify", "--drive", "profibus:1", "--yes", "--axis", "egc-70-600", "--run", tmp_path / "run")
    refuses(call(*words), 2, "no adapter understands the drive 'profibus:1'", "virtual")


def test_a_real_drive_needs_an_axis(tmp_path: Path) -> None:
    refuses(call("identify", "--drive", "can0", "--yes", "--run", tmp_path / "run"), 2, "--axis is needed", "beltcomm init")


def test_an_existing_run_is_not_overwritten(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    before = {path: path.read_bytes() for path in run.rglob("*.*")}
    refuses(call("commission", *DRIVE, "--run", run), 2, f"{run} exists", "--resume")
    assert {path: path.read_bytes() for path in run.rglob("*.*")} == before
    assert bench.plant.cart_position_m == 0.0


def test_a_recording_is_gone(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    (run / "recordings" / "frf_2.csv").unlink()
    refuses(call("fit", run), 3, "frf_2.yaml describes a recording, but frf_2.csv is missing; bring it back or delete the sidecar")


def test_a_recording_is_cut_off_in_the_middle_of_a_row(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    path = run / "recordings" / "frf_2.csv"
    rows = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(rows[:3000]) + "\n2.999,0.0", encoding="utf-8")
    refuses(call("fit", run), 3, "frf_2.csv", "row 3000", "cut off")


def test_all_recordings_are_gone(copy_of_complete: Copy) -> None:
    run = copy_of_complete("*")
    refuses(call("fit", run), 3, "no complete recording")


def test_the_axis_file_is_gone(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    (run / "axis.yaml").unlink()
    for verb in ("fit", "design"):
        refuses(call(verb, run), 3, "axis.yaml is missing", "beltcomm init")


def test_the_axis_file_of_the_run_is_gone_when_the_machine_is_to_move(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    (run / "axis.yaml").unlink()
    for verb in ("friction", "verify"):
        refuses(call(verb, *DRIVE, "--run", run), 3, "axis.yaml is missing")
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize("edited", [False, True])
def test_a_fault_of_the_program_is_laid_on_files_that_were_edited_alone(
    copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch, edited: bool
) -> None:
    """A value of the right type may still be an impossible one; the log is named, should it be the program's fault after all."""
    run = copy_of_complete()
    path = run / "results" / "plan.yaml"
    if edited:
        path.write_text(re.sub(r"continuous: .*", "continuous: 5.0e+99", path.read_text(encoding="utf-8"), count=1), encoding="utf-8")
    monkeypatch.setattr(job, "_facts", lambda _: [][0])
    outcome = call("report", run)
    assert (outcome.exit_code, "an unexpected error" in outcome.stderr) == ((3, False) if edited else (1, True))
    assert (f"{path} is not as beltcomm wrote it" in outcome.stderr) == edited
    assert [log.name in outcome.stderr for log in run.glob("beltcomm-error*")] == [True]


@pytest.mark.parametrize("damage", ["parameters: {cart.mass", "name: x\nbodies: [motor]\n", "", "[1, 2]", "\0\0"])
def test_the_model_is_damaged(make_bench: MakeBench, copy_of_complete: Copy, damage: str) -> None:
    run, bench = copy_of_complete(), make_bench()
    (run / "models" / "final.yaml").write_text(damage, encoding="utf-8")
    refuses(call("design", run), 3, "final.yaml", "beltcomm fit")
    refuses(call("verify", *DRIVE, "--run", run), 3, "final.yaml", "beltcomm fit")
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize(
    "damage", ["parameters: {kp_nm_s_rad: 1", "parameters: {kp_nm_s_rad: high}\n", "parameters: {}\n", "dead_time_s: 0\n", ""]
)
def test_the_design_is_damaged(make_bench: MakeBench, copy_of_complete: Copy, damage: str) -> None:
    run, bench = copy_of_complete(), make_bench()
    (run / "designs" / "final.yaml").write_text(damage, encoding="utf-8")
    for verb in ("verify", "apply"):
        refuses(call(verb, *DRIVE, "--run", run), 3, "design")
    assert bench.plant.cart_position_m == 0.0


def test_the_design_lacks_what_the_prediction_needs(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    path = run / "designs" / "final.yaml"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not line.startswith("dead_time_s")), encoding="utf-8")
    refuses(call("verify", *DRIVE, "--force", "--run", run), 3, "final.yaml", "dead_time_s is missing", "beltcomm design")
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize(
    ("verb", "folder", "kind", "remedy"),
    [
        ("design", "models", "model", "beltcomm fit"),
        ("verify", "designs", "design", "beltcomm design"),
        ("apply", "designs", "design", "beltcomm design"),
    ],
)
def test_a_step_was_left_out(make_bench: MakeBench, copy_of_complete: Copy, verb: str, folder: str, kind: str, remedy: str) -> None:
    run = copy_of_complete()
    make_bench()
    (run / folder / "final.yaml").unlink()
    words = (verb, run) if verb == "design" else (verb, *DRIVE, "--run", run)
    refuses(call(*words), 3, f"the {kind} final is not in {run}", remedy)


def test_the_backup_is_damaged(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    for damage in ("parameters: [", "drive: {}\n", "parameters: {kp_nm_s_rad: low}\n"):
        (run / "results" / "backup.yaml").write_text(damage, encoding="utf-8")
        refuses(call("rollback", *DRIVE, "--run", run), 3, "backup")
    (run / "results" / "backup.yaml").unlink()
    refuses(call("rollback", *DRIVE, "--run", run), 1, "no backup", "nothing to roll back to")
    assert bench.opened <= 1


def test_what_is_known_of_the_drive_is_damaged(copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    (run / "results" / "drive.yaml").write_text("structure: {period_s: x}\n", encoding="utf-8")
    for verb in ("design", "fit"):
        refuses(call(verb, run), 3, "drive.yaml")


def test_no_run_folder_at_all(tmp_path: Path) -> None:
    refuses(call("fit", tmp_path / "none"), 3, "does not exist")
    refuses(call("design", tmp_path), 3, "is no run folder")
    refuses(call("friction", *DRIVE, "--run", tmp_path), 3, "is no run folder")


def move_file(path: Path, duration_s: float, start_m: float, end_m: float) -> Path:
    """A smooth move (half a cosine) on a grid of its own."""
    t = np.linspace(0.0, duration_s, 201)
    x = start_m + (end_m - start_m) * 0.5 * (1.0 - np.cos(np.pi * t / duration_s))
    path.write_text("t_s,position_m\n" + "\n".join(f"{a:.6f},{b:.9f}" for a, b in zip(t, x, strict=True)), encoding="utf-8")
    return path


@pytest.mark.parametrize("verb", ["fit", "design"])
def test_a_recording_that_was_cut_off_is_named(copy_of_complete: Copy, verb: str) -> None:
    run = copy_of_complete()
    path = run / "recordings" / "frf_1.csv"
    path.write_text("".join(path.read_text(encoding="utf-8").splitlines(keepends=True)[:1200]), encoding="utf-8")
    refuses(call(verb, run), 3, "frf_1", "cut off", "bring the whole file back")


@pytest.mark.parametrize("verb", ["fit", "design"])
def test_a_recording_without_its_sidecar_is_named(copy_of_complete: Copy, verb: str) -> None:
    run = copy_of_complete()
    (run / "recordings" / "frf_1.yaml").unlink()
    refuses(call(verb, run), 3, "frf_1.yaml is missing", "bring it back")


@pytest.mark.usefixtures("fitted")
def test_a_delay_that_nobody_measured_is_never_zero(copy_of_complete: Copy) -> None:
    run = copy_of_complete("frf*", "amplitude*")
    outcome = call("design", run)
    assert outcome.exit_code == 0
    assert "is not known: counted with 2 ms, 2 periods" in " ".join(outcome.stdout.split())
    assert "dead_time_s: 0.002" in (run / "designs" / "final.yaml").read_text(encoding="utf-8")


def test_a_move_that_leaves_the_travel_is_refused(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench = copy_of_complete(), make_bench()
    path = move_file(tmp_path / "far.csv", 2.0, 0.1, 0.7)
    refuses(call("verify", *DRIVE, "--run", run, "--move", path), 2, "far.csv", "goes from 0.1 to 0.7 m", "-0.01..0.57 m", "shorten it")
    assert bench.plant.cart_position_m == 0.0
    assert bench.parameters() == bench.initial


def test_a_move_that_is_too_fast_is_refused_with_the_fastest_admissible_one(
    make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path
) -> None:
    """0.4 m in 0.3 s, half a cosine: a = x π²/(2 T²) = 21.9 m/s², with 13.44 kg 295 N where the pulley allows 1.24 N m or 99.84 N.

    The force falls with the square of the time: T √(295/99.84) = 0.515 s is the fastest.
    """
    run, bench = copy_of_complete(), make_bench()
    path = move_file(tmp_path / "fast.csv", 0.3, 0.1, 0.5)
    outcome = call("verify", *DRIVE, "--run", run, "--move", path)
    refuses(outcome, 1, "the feed force would be", "limit 99.84 N", "the same move stretched from 0.300 s to 0.88", "is admissible")
    assert bench.plant.cart_position_m == 0.0
    assert bench.parameters() == bench.initial


@pytest.mark.parametrize(
    ("content", "code", "words"),
    [
        (None, 3, ["move.csv"]),
        ("t_s,position_mm\n0,1\n1,2\n", 3, ["no column position_m"]),
        ("t_s,position_m\n0,0.1\n1,0.1\n1,0.2\n2,0.2\n3,0.2\n", 3, ["row 3", "time must rise"]),
        ("t_s,position_m\n0,0.1\n1,0.2\n2,0.3\n3,0.4\n", 3, ["does not start at rest"]),
        ("t_s,position_m\n0,0.1\n1,here\n2,0.3\n3,0.4\n", 3, ["position_m", "row 2"]),
    ],
)
def test_a_move_file_that_cannot_be_read(
    make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path, content: str | None, code: int, words: list[str]
) -> None:
    run, bench, path = copy_of_complete(), make_bench(), tmp_path / "move.csv"
    if content is not None:
        path.write_text(content, encoding="utf-8")
    refuses(call("verify", *DRIVE, "--run", run, "--move", path), code, *words)
    assert bench.plant.cart_position_m == 0.0


def test_limits_of_a_move_nobody_knows(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    make_bench()
    refuses(call("verify", *DRIVE, "--run", run, "--trajectory", "T_X"), 2, "no trajectory 'T_X'", "T_A, T_B")


@pytest.mark.parametrize("verb", ["apply", "rollback", "verify", "friction"])
def test_another_drive_than_that_of_the_run_is_refused(make_bench: MakeBench, copy_of_complete: Copy, verb: str) -> None:
    run, bench = copy_of_complete(), make_bench(profile="cmmp-as")
    refuses(call(verb, *DRIVE, "--run", run), 2, "made on another drive", "CMMP-AS")
    assert bench.parameters() == bench.initial
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize("text", ["", "verdict: {}\n"])
def test_a_damaged_result_of_a_move_is_named(copy_of_complete: Copy, text: str) -> None:
    first, second = copy_of_complete(name="one"), copy_of_complete(name="two")
    (file,) = (second / "results").glob("verify_*.yaml")
    file.write_text(text, encoding="utf-8")
    refuses(call("report", second), 3, file.name, "bring it back, or delete it")
    with pytest.raises(DataError, match=file.name):
        api.trend([first, second], dates=["2026-01-01", "2026-02-01"])


@pytest.mark.parametrize("verb", ["compare", "design", "report"])
def test_an_empty_axis_file_of_a_run_is_refused(copy_of_complete: Copy, verb: str) -> None:
    run = copy_of_complete()
    (run / "axis.yaml").write_text("", encoding="utf-8")
    refuses(call(verb, run), 2, "axis.yaml is empty", "beltcomm init")


@pytest.mark.parametrize("verb", ["report", "design", "compare"])
def test_a_truncated_model_is_named(copy_of_complete: Copy, verb: str) -> None:
    run = copy_of_complete()
    file = run / "models" / "final.yaml"
    file.write_text("".join(file.read_text(encoding="utf-8").partition("parameters:")[:1]), encoding="utf-8")
    refuses(call(verb, run), 3, str(file), "beltcomm fit")


@pytest.mark.parametrize(
    ("file", "place", "value", "words"),
    [
        ("results/plan", ("heat", "continuous"), [], ["report", "RUN"]),
        ("results/plan", ("experiments", 0, "travel_m"), "text", ["report", "RUN"]),
        ("results/fit", ("dead_time", "value_s"), None, ["report", "RUN"]),
        ("results/fit", ("torque_path", "rivals"), {}, ["design", "RUN"]),
        ("results/verify_move_1", ("proof", "path"), [0.0, 0.5], ["apply", *DRIVE, "--run", "RUN"]),
        ("results/drive", ("structure", "steps"), None, ["design", "RUN"]),
        ("results/drive", ("peak_torque_nm",), True, ["design", "RUN"]),
        ("results/backup", ("objects", 0, "raw"), "1", ["rollback", *DRIVE, "--run", "RUN"]),
        ("designs/final", ("margins",), {"a": 1}, ["export", "RUN", "--format", "c", "--out", "RUN/a.c", "--yes"]),
        ("designs/final", ("specification", "another"), 1.0, ["report", "RUN"]),
    ],
)
def test_a_value_of_another_type_under_a_right_checksum_is_named(
    make_bench: MakeBench, copy_of_complete: Copy, file: str, place: tuple[str | int, ...], value: object, words: list[str]
) -> None:
    """A forger makes the checksum anew; no command comes as far as a log of an unexpected error, and nothing moves."""
    run, bench = copy_of_complete(), make_bench()
    path = run / f"{file}.yaml"
    content: Any = unsealed(read_yaml(path))[0]
    part = content
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    path.write_text(to_yaml(sealed(content)), encoding="utf-8")
    named = "".join(f"[{key + 1}]" if isinstance(key, int) else f".{key}" for key in place).removeprefix(".")
    refuses(call(*(word.replace("RUN", str(run)) for word in words)), 3, f"{path} is damaged", named)
    assert list(run.glob("beltcomm-error*")) == []
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.parametrize("damage", ["parameters: {cart.mass", "parameters: {kp_nm_s_rad: 1.0}\n"])
def test_a_damaged_design_is_replaced_and_stays(copy_of_complete: Copy, damage: str) -> None:
    run = copy_of_complete()
    (run / "designs" / "final.yaml").write_text(damage, encoding="utf-8")
    assert call("design", run).exit_code == 0
    assert (run / "designs" / "replaced_1.yaml").read_text(encoding="utf-8") == damage


def test_a_run_that_cannot_be_judged_hides_no_other(copy_of_complete: Copy, tmp_path: Path) -> None:
    sound, edited = copy_of_complete(name="sound"), copy_of_complete(name="edited")
    path = next((edited / "results").glob("verify_*.yaml"))
    path.write_text(re.sub(r"measured_cart: .*", "measured_cart: [1]", path.read_text(encoding="utf-8"), count=1), encoding="utf-8")
    outcome = call("runs", tmp_path, "--json")
    assert outcome.exit_code == 0, outcome.output
    told = {Path(one["run"]).name: one["headline"] for one in json.loads(outcome.stdout)["runs"]}
    assert told[sound.name]["state"] == "pass"
    assert told[edited.name]["state"] == "damaged"
    assert f"{path} is damaged: measured_cart is '[1]'" in told[edited.name]["sentence"]
