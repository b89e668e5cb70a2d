"""Caches mend themselves: what cannot be read is thrown away and made again, and a place that cannot be written is told."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from beltcomm import caches, machine_code
from beltcomm.axis import load_axis
from beltcomm.locks import changes_run
from beltcomm.result import Result
from beltcomm.rundata.kept import kept_or_new
from beltcomm.runfolder import RunFolder
from marks import quick

SCRIPT = """
import numpy as np
from beltcomm import caches
from beltcomm.model import build_model
from beltcomm.simulate.kernels.compose import kernel_for
caches.listen(print)
model = build_model('m', ('belt_stiffness',), {})
kernel = kernel_for(model)
q, v = np.zeros(2), np.zeros(2)
kernel.advance(q, v, model.vector(), 0.1, 0.0, 5e-5, 20)
print(float(q[0]).hex(), sum(kernel.advance.stats.cache_hits.values()))
"""
MENDED = "are thrown away and made again"


def used(home: Path, *, largest: int | None = None) -> list[str]:
    """What a process says that needs a kernel, with its caches in ``home``.   largest : bytes that a file may have."""
    environment = {**os.environ, "XDG_CACHE_HOME": str(home), "NUMBA_CACHE_DIR": ""}
    limit = None if largest is None else lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (largest, largest))
    done = subprocess.run([sys.executable, "-B", "-c", SCRIPT], env=environment, capture_output=True, text=True, preexec_fn=limit)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What caches say, from nothing on."""
    said: list[str] = []
    monkeypatch.setattr(caches, "_said", [])
    monkeypatch.setattr(caches, "_listeners", [said.append])
    return said


def emptied(content: bytes, draw: np.random.Generator) -> bytes:
    return b""


def zeroed(content: bytes, draw: np.random.Generator) -> bytes:
    return bytes(len(content))


def cut(content: bytes, draw: np.random.Generator) -> bytes:
    return content[: int(draw.integers(1, len(content)))]


def turned(content: bytes, draw: np.random.Generator) -> bytes:
    """One bit of it."""
    found = bytearray(content)
    found[int(draw.integers(len(found)))] ^= 1 << int(draw.integers(8))
    return bytes(found)


def longer(content: bytes, draw: np.random.Generator) -> bytes:
    return content + draw.bytes(9)


@pytest.mark.parametrize(("kind", "damage"), quick([("*", emptied), ("*.nbc", turned), ("*.py", cut)], 1))
def test_damaged_files_of_compiled_code_are_made_again_and_that_is_one_line(
    tmp_path: Path, kind: str, damage: Callable[[bytes, np.random.Generator], bytes]
) -> None:
    (result,) = used(tmp_path)
    draw = np.random.default_rng([ord(letter) for letter in kind + damage.__name__])
    files = [path for path in tmp_path.rglob(kind) if path.is_file()]
    assert files
    for path in files:
        path.write_bytes(damage(path.read_bytes(), draw))
    *said, again = used(tmp_path)
    assert again.split()[0] == result.split()[0]
    assert [line for line in said if MENDED not in line] == []
    assert len(said) == len({line.partition(" in ")[2] for line in said}) <= 2
    assert used(tmp_path) == [f"{result.split()[0]} 1"], "and now everything is found"


@pytest.mark.parametrize("damage", [emptied, zeroed, cut, turned, longer])
def test_no_damaged_byte_is_ever_executed(tmp_path: Path, told: list[str], damage: Callable[[bytes, np.random.Generator], bytes]) -> None:
    files, draw = machine_code._Files(str(tmp_path), "function-1.py311", "source"), np.random.default_rng(7)
    for _ in range(40):
        files.save("types", {"code": draw.bytes(200)})
        (path,) = tmp_path.glob("*.nbc")
        path.write_bytes(damage(path.read_bytes(), draw))
        assert files.load("types") is None
    assert len(told) <= 1
    files.save("types", "whole")
    assert files.load("types") == "whole"
    assert machine_code._Files(str(tmp_path), "function-1.py311", "another source").load("types") is None


def test_two_processes_that_compile_at_once_never_execute_each_others_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write, both = machine_code.atomic.write, threading.Barrier(2)

    def written_together(path: Path, content: bytes) -> None:
        both.wait(timeout=10.0)
        write(path, content)

    monkeypatch.setattr(machine_code.atomic, "write", written_together)
    for k in range(20):
        types = [f"types {k} {name}" for name in "ab"]
        threads = [
            threading.Thread(target=machine_code._Files(str(tmp_path), "function-1.py311", "source").save, args=(name, name))
            for name in types
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        files = machine_code._Files(str(tmp_path), "function-1.py311", "source")
        assert [files.load(name) for name in types] == types


@pytest.mark.examination
def test_a_full_place_is_told_and_costs_nothing_but_time(tmp_path: Path) -> None:
    *said, result = used(tmp_path, largest=2000)
    assert float.fromhex(result.split()[0]) > 0.0
    assert any("cannot be kept in" in line and "File too large" in line for line in said)
    assert [path for path in tmp_path.rglob("*") if path.name.endswith(".tmp")] == []
    assert used(tmp_path)[-1] == result


def test_a_place_where_nothing_can_be_written_is_told(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("no folder")
    said = used(file)
    assert any("cannot be kept" in line for line in said[:-1])


DAMAGED = (b"", b"\x00" * 40, b'{"key": "k", "x"', b"[1, 2]", b'"text"', b"null", b"\xff\xfe", b"[" * 200_000, b'{"x": 1}')


@pytest.mark.parametrize("content", DAMAGED, ids=lambda content: repr(content[:12]))
def test_a_damaged_answer_is_thrown_away_and_said_once(tmp_path: Path, told: list[str], content: bytes) -> None:
    path = tmp_path / "kept" / "answer.json"
    assert caches.found(path, "k") is None
    assert told == []
    path.parent.mkdir()
    for _ in range(2):
        path.write_bytes(content)
        assert caches.found(path, "k") is None
        assert not path.exists()
    assert told == [f"{path} is damaged; it is thrown away and made again."]
    caches.keep(path, "k", {"x": 1.5})
    assert caches.found(path, "k") == {"key": "k", "x": 1.5}
    assert caches.found(path, "another") is None
    assert path.exists()


def test_an_answer_that_cannot_be_kept_is_said_and_no_more(tmp_path: Path, told: list[str]) -> None:
    (tmp_path / "kept").write_text("no folder")
    caches.keep(tmp_path / "kept" / "answer.json", "k", {})
    assert len(told) == 1
    assert "cannot be kept (" in told[0]


def test_a_command_finds_its_answer_again(tmp_path: Path) -> None:
    """What keeps other commands out of the folder meanwhile is not part of the question."""
    folder, made = RunFolder.create(tmp_path / "run", load_axis("egc-70-600")), []

    @changes_run()
    def asked(run: Path) -> Result:
        return kept_or_new(RunFolder.open(run), "x", (), lambda: made.append(1) or Result({}, ["found"]))

    assert [asked(folder.path).text, asked(folder.path).text] == [["found"], ["found"]]
    assert len(made) == 1
    (folder.path / "kept" / "x.json").write_bytes(b"")
    assert asked(folder.path).text == ["found"]
    assert len(made) == 2


def test_the_newest_answers_stay(tmp_path: Path) -> None:
    for number in range(5):
        caches.keep(tmp_path / f"answer_{number}.json", str(number), {})
        os.utime(tmp_path / f"answer_{number}.json", (number, number))
    caches.keep(tmp_path / "other.json", "x", {})
    caches.keep_newest(tmp_path, "answer_*.json", 2)
    assert {path.name for path in tmp_path.iterdir()} == {"answer_3.json", "answer_4.json", "other.json"}
