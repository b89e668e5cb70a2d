"""Caches mend themselves: what cannot be read is thrown away and made again, and a place that cannot be written is told."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

SCRIPT = """
import numpy as np
from beltcomm import machine_code
from beltcomm.model import build_model
from beltcomm.simulate.compose import kernel_for
machine_code.listen(print)
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


@pytest.mark.parametrize("damage", [emptied, zeroed, cut, turned, longer])
@pytest.mark.parametrize("kind", ["*.nbi", "*.nbc", "*.py", "*"])
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
    # a bit of the marker that turns the file into one of numba's own is silent, as an earlier version's are
    assert [line for line in said if MENDED not in line] == []
    assert len(said) == len({line.partition(" in ")[2] for line in said}) <= 2
    assert used(tmp_path) == [f"{result.split()[0]} 1"], "and now everything is found"


def test_files_that_numba_itself_has_written_are_replaced_in_silence(tmp_path: Path) -> None:
    (result,) = used(tmp_path)
    for path in tmp_path.rglob("*.nbi"):
        path.write_bytes(b"\x80\x05\x8c\x060.61.0\x94.")
    assert used(tmp_path) == [result]
    assert used(tmp_path) == [f"{result.split()[0]} 1"]


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
