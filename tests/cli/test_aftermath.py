"""What a failed command says of its folder, of the drive and of the command to type next."""

from __future__ import annotations

from pathlib import Path

from beltcomm.cli.aftermath import aftermath
from beltcomm.cli.frame import Frame


def test_how_an_earlier_command_left_the_drive_is_not_told_as_todays_state(tmp_path: Path) -> None:
    journal = tmp_path / "journal.txt"
    journal.write_text("connected\nall parameters restored\n", encoding="utf-8")
    frame = Frame(["verify", "--drive", "can0", "--run", str(tmp_path)])
    frame.run = tmp_path
    assert frame._aftermath(5)["drive"] == "nothing was written to it"
    with journal.open("a", encoding="utf-8") as file:
        file.write("connected\nrestoring the drive failed: no answer\n")
    assert frame._aftermath(5)["drive"].startswith("NOT restored: `beltcomm rollback --drive")


def test_a_run_without_a_record_is_begun_anew(tmp_path: Path) -> None:
    """The folder is there, so the same command would be refused; its axis file is a copy, so what was mended would not count."""
    words = ["commission", "--drive", "can0", "--run", str(tmp_path), "--resume", "--yes"]
    assert aftermath(words, tmp_path, [], "can0", 1, resumes=True)["next"].startswith("beltcomm commission --drive can0 --yes   (when")
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "frf_1.csv").touch()
    assert f"--run {tmp_path} --resume" in aftermath(words, tmp_path, [], "can0", 1, resumes=True)["next"]
    words = ["verify", "--drive", "can0", "--run", str(tmp_path)]
    assert f"--run {tmp_path}   (when" in aftermath(words, tmp_path, [], "can0", 1, resumes=False)["next"]
