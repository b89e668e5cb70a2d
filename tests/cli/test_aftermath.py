"""What a failed command says of its folder, of the drive and of the command to type next."""

from __future__ import annotations

from pathlib import Path

from beltcomm.cli.aftermath import aftermath
from beltcomm.cli.frame import Invocation
from beltcomm.errors import Declined, DriveError, Refused, SafetyStop
from beltcomm.journal import append


def test_how_an_earlier_command_left_the_drive_is_not_told_as_todays_state(tmp_path: Path) -> None:
    append(tmp_path, "connected", "connected", "")
    append(tmp_path, "all parameters restored", "restored", "")
    frame = Invocation(["verify", "--drive", "can0", "--run", str(tmp_path)])
    frame.run = tmp_path
    assert frame._aftermath(DriveError("no answer"))["drive"] == "nothing was written to it"
    append(tmp_path, "connected", "connected", "")
    append(tmp_path, "restoring the drive failed: no answer", "not restored", "")
    assert frame._aftermath(DriveError("no answer"))["drive"].startswith("NOT restored: `beltcomm rollback --drive")


def test_a_run_without_a_record_is_begun_anew(tmp_path: Path) -> None:
    """The folder is there, so the same command would be refused; its axis file is a copy, so what was mended would not count."""
    words = ["commission", "--drive", "can0", "--run", str(tmp_path), "--resume", "--yes"]
    assert aftermath(words, tmp_path, [], "can0", Refused("no"), resumes=True)["next"].startswith(
        "beltcomm commission --drive can0 --yes   (when"
    )
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "frf_1.csv").touch()
    assert f"--run {tmp_path} --resume" in aftermath(words, tmp_path, [], "can0", Refused("no"), resumes=True)["next"]
    words = ["verify", "--drive", "can0", "--run", str(tmp_path)]
    assert f"--run {tmp_path}   (when" in aftermath(words, tmp_path, [], "can0", Refused("no"), resumes=False)["next"]


def test_limits_that_a_move_cannot_have_are_those_of_the_target_then(tmp_path: Path) -> None:
    """A move that is asked for by name is driven as it is; that of the targets is slowed down."""
    refusal = Refused("the move is refused: should the PC or the bus be lost in it, the belt is predicted to carry 153 N")
    for words in (["--trajectory", "T_A"], ["--trajectory=T_A"]):
        told = aftermath(["verify", "--drive", "can0", *words, "--yes"], tmp_path, [], "can0", refusal, resumes=False)["next"]
        assert told.startswith(f"beltcomm verify --drive can0 --target move=T_A --yes --run {tmp_path}   (slowed")
    for words in (["--trajectory", "T_A", "--feedforward", "none"], ["--move", "a.csv"]):
        assert "--target" not in aftermath(["verify", "--drive", "can0", *words], tmp_path, [], "can0", refusal, resumes=False)["next"]


def with_record(run: Path) -> Path:
    (run / "recordings").mkdir(parents=True)
    (run / "recordings" / "frf_1.csv").touch()
    return run


def test_a_run_whose_axis_file_is_in_doubt_is_begun_anew(tmp_path: Path) -> None:
    """A run goes on with the axis that it was begun with only: to resume it with a mended file would be refused."""
    run = with_record(tmp_path / "a run")
    words = ["commission", "--drive", "virtual", "--axis", "mine.yaml", "--yes", "--run", str(run)]
    doubt = "by axis.yaml the inertia is 0.000162 kg m²"
    new = aftermath(words, run, [], "virtual", Refused(doubt), resumes=True)["next"]
    assert new.startswith("beltcomm commission --drive virtual --axis mine.yaml --yes   (a new run, when axis.yaml is mended)")
    assert new.endswith(f"when it is right and the machine is mended: beltcomm {' '.join(words[:-1])} '{run}' --resume")
    unnamed = aftermath(["commission", "--drive", "virtual"], run, [], "virtual", Refused(doubt), resumes=True)["next"]
    assert unnamed.startswith(f"beltcomm commission --drive virtual --axis '{run}/axis.yaml'   (a new run")
    gap = aftermath(words, run, [], "virtual", SafetyStop(f"{doubt}; `beltcomm diagnose RUN` looks for it"), resumes=True)["next"]
    assert gap.startswith(f"beltcomm diagnose '{run}'   (says what these records show); then beltcomm commission")


def test_after_a_no_nothing_is_to_be_mended(tmp_path: Path) -> None:
    words = ["commission", "--drive", "virtual", "--run", str(tmp_path)]
    left = aftermath(words, tmp_path, [], "virtual", Declined("no"), resumes=True)
    assert left["next"].endswith("(asks again)")
    assert left["folder"].endswith("(nothing recorded yet; --run takes it again, or delete it)")


def test_what_was_found_stands_above_and_a_run_that_got_no_further_is_not_resumed(tmp_path: Path) -> None:
    run = with_record(tmp_path / "run")
    words = ["commission", "--drive", "virtual", "--run", str(run), "--resume"]
    problem = Refused("the loop would not hold")
    told = {"found": "backlash", "check": "hold the motor", "named": ["backlash"], "repeated": False, "command": "beltcomm diagnose RUN"}
    problem.diagnosis = told
    left = aftermath(words, run, [], "virtual", problem, resumes=True)
    assert list(left)[:2] == ["found", "check"]
    assert left["next"].startswith("beltcomm diagnose RUN   (shows all of it); then beltcomm commission --drive virtual   (a new run")
    problem.diagnosis = {**told, "named": [], "check": ""}
    assert "--resume" in aftermath(words, run, [], "virtual", problem, resumes=True)["next"]
    problem.diagnosis = {**told, "named": [], "repeated": True}
    again = aftermath(words, run, [], "virtual", problem, resumes=True)["next"]
    assert f"--run {run}" not in again
    assert "--resume was tried" in again
