"""One command at a time changes a folder, by whatever it is called; who comes second waits or is told; links lead nowhere."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from beltcomm import locks
from beltcomm.axis import load_axis
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.errors import UsageError
from beltcomm.locks import changes_run, occupied
from beltcomm.recording.sidecar import Sidecar
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence

HOLDING = """
import sys, time
from pathlib import Path
from beltcomm.locks import occupied
from beltcomm.talk import Silence
with occupied(Path(sys.argv[1]), Silence()):
    print(flush=True)
    sys.stdin.readline()
"""
COUNTING = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from places.test_locks import count
for _ in range(10):
    count(run=sys.argv[1])
"""


class Told(Silence):
    def __init__(self) -> None:
        self.said: list[str] = []

    def say(self, *lines: str) -> None:
        self.said.extend(lines)


@changes_run()
def count(run: str | Path, talk: Told | None = None) -> int:
    """One more, read and written as ``add`` does with a ladder."""
    path = Path(run) / "count.yaml"
    known = read_yaml(path)["count"] if path.is_file() else 0
    write_text(path, to_yaml({"count": known + 1}))
    return int(known) + 1


@changes_run(waits=False)
def move(run: str | Path) -> bool:
    return True


def holder(folder: Path) -> subprocess.Popen[bytes]:
    process = subprocess.Popen([sys.executable, "-c", HOLDING, str(folder)], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.readline()
    return process


def test_many_at_once_lose_nothing(tmp_path: Path) -> None:
    words = [sys.executable, "-c", COUNTING, str(tmp_path), str(Path(__file__).parents[1])]
    others = [subprocess.Popen(words) for _ in range(2)]
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda _: [count(tmp_path) for _ in range(5)], range(4)))
    assert [process.wait() for process in others] == [0, 0]
    assert read_yaml(tmp_path / "count.yaml")["count"] == 2 * 10 + 4 * 5
    assert os.listdir(tmp_path) == ["count.yaml"]


def test_a_calculation_waits_and_says_for_whom_a_machine_does_not(tmp_path: Path) -> None:
    talk = Told()
    with holder(tmp_path) as process:
        with pytest.raises(UsageError, match=rf"another session is at work in .* \(process {process.pid} on .*\); wait for its end"):
            move(tmp_path)
        ends = threading.Timer(0.3, lambda: process.communicate(b"\n"))
        ends.start()
        assert count(tmp_path, talk=talk) == 1
        ends.join()  # before its pipes are closed
    assert len(talk.said) == 1
    assert f"is in use by process {process.pid} on" in talk.said[0]
    assert move(tmp_path)


def test_a_killed_command_leaves_nothing_in_the_way(tmp_path: Path) -> None:
    with holder(tmp_path) as process:
        (tmp_path / f".beltcomm-{process.pid}-0123abcd.tmp").write_text("half")
        mine = tmp_path / f".beltcomm-{os.getpid()}-0123abcd.tmp"
        mine.write_text("on its way")
        process.kill()
    assert count(tmp_path) == 1
    assert sorted(os.listdir(tmp_path)) == [mine.name, "count.yaml"]


def test_what_a_command_calls_is_in_the_folder_already_but_one_machine_moves(tmp_path: Path) -> None:
    with occupied(tmp_path, Silence(), session=True):
        assert count(tmp_path) == 1
        with pytest.raises(UsageError, match="in use by this process"), occupied(tmp_path, Silence(), session=True):
            pass
        assert count(tmp_path) == 2
    with occupied(tmp_path, Silence(), session=True):
        pass


def test_two_threads_of_one_process_take_turns(tmp_path: Path) -> None:
    with occupied(tmp_path, Silence()), ThreadPoolExecutor(1) as pool, pytest.raises(UsageError, match="at work"):
        pool.submit(move, tmp_path).result()
    assert move(tmp_path)


def test_where_nothing_can_be_written_a_calculation_goes_on_and_a_machine_does_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(locks, "take", refused)
    assert count(tmp_path) == 1
    with pytest.raises(UsageError, match=r"cannot be written: Permission denied; choose another --run folder"):
        RunFolder(tmp_path, None).occupy(Silence())


@pytest.mark.parametrize("name", ["results", "designs", "kept", "bus", "pictures", "journal.txt", ".lock"])
def test_nothing_is_written_through_links_inside_a_run(tmp_path: Path, name: str) -> None:
    folder, outside = RunFolder.create(tmp_path / "run", load_axis("egc-70-600")), tmp_path / "outside"
    if "." in name:
        outside.write_text("mine\n")
    else:
        outside.mkdir()
    (folder.path / name).symlink_to(outside)
    with pytest.raises(UsageError, match=rf"{name} is a link to {outside}; nothing is written through links inside a run"):
        count(folder.path)
    with pytest.raises(UsageError):
        folder.journal("x") if name == "journal.txt" else folder.occupy(Silence())
    assert outside.read_text() == "mine\n" if outside.is_file() else not list(outside.iterdir())


def test_records_behind_a_link_are_read_and_none_is_written_there(tmp_path: Path) -> None:
    folder, outside = RunFolder.create(tmp_path / "run", load_axis("egc-70-600")), tmp_path / "outside"
    outside.mkdir()
    folder.recordings_folder.rmdir()
    folder.recordings_folder.symlink_to(outside)
    assert count(folder.path) == 1
    with pytest.raises(UsageError, match="recordings is a link"):
        folder.new_recording("x", Sidecar())
    assert not list(outside.iterdir())


def test_a_run_may_be_reached_through_a_link(tmp_path: Path) -> None:
    RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    (tmp_path / "latest").symlink_to("run")
    assert count(tmp_path / "latest") == 1
    with (
        occupied(tmp_path / "run", Silence(), session=True),
        pytest.raises(UsageError, match="in use by this process"),
        occupied(tmp_path / "latest", Silence(), session=True),
    ):
        pass


def test_a_lock_that_is_no_file_is_told(tmp_path: Path) -> None:
    (tmp_path / ".lock").mkdir(mode=stat.S_IRWXU)
    with pytest.raises(UsageError, match=r"\.lock is a folder, a pipe or a device, no file"):
        count(tmp_path)
