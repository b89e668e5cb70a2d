"""Where a system lacks what Linux has: every module imports, commands run, and what cannot be there is said in a sentence."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).parents[1]
#: What Windows has not; macOS has all of it.
LACKING = ("fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "_posixshmem", "readline")
#: Run before anything else: as if these modules, and what of ``os`` rests on them, were not there.
BLOCKED = f"""
import os, sys
import serial  # has a part of its own for Windows
for name in {LACKING!r}:
    sys.modules[name] = None
for name in ("openpty", "fchdir", "O_PATH", "O_NOFOLLOW", "O_NONBLOCK", "O_NOCTTY", "O_CLOEXEC", "sched_getaffinity"):
    if hasattr(os, name):
        delattr(os, name)
"""
#: Tests of the core that need neither a bus nor a compiler of their own time: axis files, models, recordings, controllers, moves, pages.
CORE = ("test_axis.py", "test_model.py", "test_runfolder.py", "test_transfer.py", "test_control.py", "test_result.py", "recording", "web")


def python(program: str, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", BLOCKED + program, *words], capture_output=True, text=True, cwd=CHECKOUT)


def test_every_module_imports() -> None:
    done = python(
        "import importlib, json, pkgutil, beltcomm, beltcomm_adapters\n"
        "faults = {}\n"
        "for package in (beltcomm, beltcomm_adapters):\n"
        "    for found in pkgutil.walk_packages(package.__path__, package.__name__ + '.', onerror=lambda name: None):\n"
        "        if found.name.endswith('__main__'): continue\n"
        "        try: importlib.import_module(found.name)\n"
        "        except Exception as error: faults[found.name] = repr(error)\n"
        "print(json.dumps(faults))\n"
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == {}


def test_commands_say_what_the_system_lacks() -> None:
    done = python(
        "from beltcomm.cli.hold import HeldKey\n"
        "from beltcomm.errors import BeltcommError\n"
        "from beltcomm.virtual.slcan import SlcanTerminal\n"
        "os.isatty = lambda fd: True\n"
        "for asked in (SlcanTerminal, HeldKey(0, b' ', print).begin):\n"
        "    try: asked()\n"
        "    except BeltcommError as error: print(error)\n"
    )
    assert done.returncode == 0, done.stderr
    assert "use --on socket:PORT" in done.stdout
    assert "hold to run by a script" in done.stdout


@pytest.mark.examination
def test_a_simulated_run_is_fitted(tmp_path: Path) -> None:
    done = python(
        "from beltcomm.cli.main import main\n"
        "for words in (['simulate', 'g_b', '--run', sys.argv[1], '--seed', '1'], ['fit', sys.argv[1]], ['compare', sys.argv[1]]):\n"
        "    sys.argv = ['beltcomm', *words]\n"
        "    try: main()\n"
        "    except SystemExit as end: assert not end.code, words\n",
        str(tmp_path / "run"),
    )
    assert done.returncode == 0, done.stderr
    assert "above the noise (1.0" in done.stdout


@pytest.mark.examination
def test_the_core_subset_passes() -> None:
    parts = [f"tests/{part}" for part in CORE]
    done = python(f"import pytest; sys.exit(pytest.main(['-q', '-n', '0', '-p', 'no:cacheprovider', *{parts}]))")
    assert done.returncode == 0, done.stdout[-3000:]
