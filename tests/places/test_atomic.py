"""A file appears whole or not at all: whoever writes at once, dies meanwhile or has no room."""

from __future__ import annotations

import os
import resource
import stat
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from beltcomm import atomic, journal, locks
from beltcomm.configfiles import write_text
from beltcomm.errors import UsageError
from beltcomm.talk import Silence

WRITING = """
import sys
from pathlib import Path
from beltcomm import atomic, journal, locks
place = Path(sys.argv[1])
print(flush=True)
for k in range(100000):
    atomic.write(place, bytes([k % 256]) * 50000)
"""


def test_a_process_killed_at_any_moment_leaves_the_file_as_it_was_or_whole(tmp_path: Path) -> None:
    place, draw = tmp_path / "file", np.random.default_rng(4711)
    for _ in range(12):
        with subprocess.Popen([sys.executable, "-c", WRITING, str(place)], stdout=subprocess.PIPE) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(float(draw.uniform(0.0, 0.05)))
            process.kill()
        if place.exists():
            content = place.read_bytes()
            assert content == content[:1] * 50000
    atomic.sweep(tmp_path)
    assert set(os.listdir(tmp_path)) <= {"file"}


def test_writing_anew_takes_away_what_a_killed_process_left(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        dead.wait()
    (tmp_path / f".beltcomm-{dead.pid}-00000000.tmp").write_bytes(b"half")
    (mine := tmp_path / f".beltcomm-{os.getpid()}-00000000.tmp").write_bytes(b"on its way")
    atomic.write(tmp_path / "file", b"whole")
    assert set(os.listdir(tmp_path)) == {"file", mine.name}


@pytest.mark.parametrize("room", [0, 1, 100, 4096, 9999])
def test_without_room_the_file_before_stays(tmp_path: Path, room: int) -> None:
    place = tmp_path / "file"
    place.write_bytes(b"before")
    text = (
        "import sys; from pathlib import Path; from beltcomm.configfiles import write_text\n"
        "from beltcomm.errors import UsageError\n"
        "try: write_text(Path(sys.argv[1]), 'x' * 10000)\n"
        "except UsageError as error: print(error)"
    )
    limit = lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))  # noqa: E731
    done = subprocess.run([sys.executable, "-c", text, str(place)], capture_output=True, text=True, preexec_fn=limit)
    assert "cannot be written: File too large; choose another place" in done.stdout
    assert place.read_bytes() == b"before"
    assert os.listdir(tmp_path) == ["file"]


def test_threads_that_write_one_file_at_once_do_not_meet(tmp_path: Path) -> None:
    place = tmp_path / "page"
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda k: atomic.write(place, bytes([k]) * 100_000), range(64)))
    content = place.read_bytes()
    assert content == content[:1] * 100_000
    assert os.listdir(tmp_path) == ["page"]


def test_a_link_in_its_place_is_not_followed(tmp_path: Path) -> None:
    outside, place = tmp_path / "outside", tmp_path / "place"
    outside.write_text("mine")
    place.symlink_to(outside)
    write_text(place, "new")
    assert (outside.read_text(), place.read_text(), place.is_symlink()) == ("mine", "new", False)


def test_what_is_no_file_is_written_into_and_stays_what_it_is(tmp_path: Path) -> None:
    write_text(Path(os.devnull), "gone")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)
    with pytest.raises(UsageError, match="Is a directory"):
        write_text(tmp_path, "x")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs named pipes")
def test_a_pipe_that_nobody_reads_is_waited_for_by_nobody(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UsageError, match="No such device"):
        write_text(tmp_path / "pipe", "x")
    with pytest.raises(UsageError, match="cannot be written"):
        journal.append(tmp_path / "none", "x", "note", "")
    for name in (journal.TEXT, journal.EVENTS):
        os.mkfifo(tmp_path / name)
        reader = os.open(tmp_path / name, os.O_RDONLY | os.O_NONBLOCK)
        with pytest.raises(OSError, match="it is no file"):
            atomic.appending(tmp_path / name)
        os.close(reader)
    with pytest.raises(UsageError, match="cannot be written"):
        journal.append(tmp_path, "x", "note", "")
    with pytest.raises(UsageError, match="is a folder, a pipe or a device"), locks.occupied(tmp_path, Silence()):
        pass


def test_a_file_may_be_read_by_whom_the_user_allows(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_text(tmp_path / "file", "x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "file").stat().st_mode) == 0o640


def test_an_exception_inside_leaves_nothing(tmp_path: Path) -> None:
    def broken_off() -> None:
        with atomic.replacing(tmp_path / "file") as file:
            file.write(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert os.listdir(tmp_path) == []


def test_names_as_long_as_the_system_takes_are_written(tmp_path: Path) -> None:
    write_text(tmp_path / ("n" * 255), "x")
    with pytest.raises(UsageError, match="cannot be written: File name too long"):
        write_text(tmp_path / ("n" * 256), "x")
