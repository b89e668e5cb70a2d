"""What a change of the inside must leave as it is: help, keys of ``--json``, public signatures, files of a run, frames on the bus.

The files beside this one hold it.  After a change that is meant, ``pytest tests/golden --regenerate`` writes them anew; look at the diff.
"""

from __future__ import annotations

import hashlib
import inspect
import json
import os
import platform
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import llvmlite.binding
import numba
import numpy as np
import pytest
import scipy
from click.testing import CliRunner

from beltcomm import api
from beltcomm.cli.main import VERBS, cli
from beltcomm.errors import BeltcommError
from beltcomm.virtual.bus import Frame
from frames import FrameHash

HERE = Path(__file__).parent
DRIVE = ("--drive", "virtual", "--seed", "1")
MOVING = (*DRIVE, "--yes")
COMMISSION = ("--axis", "egc-70-600", "--quick", "--no-report")
#: On the machine, for each profile: verb and what follows it.  ``RUN`` is the run of the first, ``RUN_2`` of the second.
ON_THE_MACHINE = (
    ("commission", *MOVING, *COMMISSION, "--run", "RUN"),
    ("identify", *MOVING, "--axis", "egc-70-600", "--run", "RUN_2"),
    ("friction", *MOVING, "--run", "RUN"),
    ("verify", *MOVING, "--run", "RUN"),
)
#: Afterwards, with the run of the reference drive.
OTHERS = (
    ("init", "axis.yaml", "--from", "egc-70-600", "--set", "name=mine"),
    ("fit", "RUN_2"),
    ("design", "RUN"),
    ("calibrate", *MOVING, "--run", "RUN"),
    ("apply", *MOVING, "--run", "RUN"),
    ("rollback", "--run", "RUN", "--backup", "list"),
    ("rollback", *MOVING, "--run", "RUN"),
    ("move", *MOVING, "--axis", "egc-70-600", "--by", "5mm"),
    ("compare", "RUN", "--no-pictures"),
    ("diagnose", "RUN"),
    ("add", "quadratic_drag", "RUN", "--no-pictures"),
    ("ladder", "RUN", "--no-pictures"),
    ("remove", "quadratic_drag", "RUN", "--no-pictures"),
    ("report", "RUN"),
    ("trend", "RUN", "RUN_2"),
    ("study", "tolerances", "--limit", "2", "--out", "STUDY", "--workers", "1", "--no-report"),
    ("simulate", "g_a", "--axis", "egc-70-600", "--run", "RUN_3", "--seed", "1"),
    ("import", "RUN/recordings/sweep.csv", "--axis", "egc-70-600", "--run", "RUN_4"),
    ("trajectory", "move.csv", "--from", "0", "--to", "0.1", "--speed", "1", "--acceleration", "5", "--jerk", "100"),
    ("convert", "RUN"),
    ("thesis",),
    ("doctor", *DRIVE, "--axis", "egc-70-600"),
    ("bundle", "RUN"),
    ("drives",),
    ("effects",),
)


def arithmetic() -> str:
    """What the last digit of a number may depend on: processor, numpy, scipy, compiler."""
    processor = sorted(name for name, has in llvmlite.binding.get_host_cpu_features().items() if has)
    known = (platform.machine(), llvmlite.binding.get_host_cpu_name(), processor, np.__version__, scipy.__version__, numba.__version__)
    return hashlib.sha256(repr(known).encode()).hexdigest()[:16]


def keys(value: Any, at: str = "") -> Iterator[str]:
    """Dotted paths of all keys in a value of ``--json``; the items of a list share one path."""
    if isinstance(value, Mapping):
        for name, item in value.items():
            yield f"{at}.{name}".lstrip(".")
            yield from keys(item, f"{at}.{name}")
    if isinstance(value, list):
        for item in value:
            yield from keys(item, f"{at}[]")


class Performance:
    """All commands, once.   keys, frames : of each command.   files : of the run folder of each profile, after commissioning."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.keys: dict[str, list[str]] = {}
        self.frames: dict[str, list[str | int]] = {}
        self.files: dict[str, list[str]] = {}
        self._log: Any = None
        with pytest.MonkeyPatch.context() as patch:
            patch.chdir(folder)
            patch.setattr(api, "open_drive", self._open(api.open_drive))
            for profile in ("cmmp-as", "reference"):  # the run of the reference drive is that which the others look at
                self._on_the_machine(profile)
            for words in OTHERS:
                self._call("rollback --backup list" if "list" in words else words[0], words)

    def _open(self, opened: Any) -> Any:
        return lambda name, options=None: opened(name, {**(options or {}), "log": self._log} if self._log else options)

    def _on_the_machine(self, profile: str) -> None:
        for run in ("RUN", "RUN_2"):
            if (self.folder / run).exists():
                os.rename(self.folder / run, self.folder / f"{run} before")
        for words in ON_THE_MACHINE:
            count, frames = 0, FrameHash()

            def log(frame: Frame, frames: FrameHash = frames) -> None:
                nonlocal count
                count += 1
                frames(frame)

            self._log = log
            title = f"{words[0]} {profile}"
            code = self._call(title, (*words, "--profile", profile))
            self._log = None
            self.frames[title] = [code, count, frames.hexdigest()]
            if words[0] == "commission":
                run = self.folder / "RUN"
                self.files[profile] = sorted(path.relative_to(run).as_posix() for path in run.rglob("*") if path.is_file())

    def _call(self, title: str, words: tuple[str, ...]) -> int:
        outcome = CliRunner().invoke(cli, [*words, "--json"])
        said = json.loads(outcome.stdout) if outcome.stdout else {}
        self.keys[title] = [f"exit code {outcome.exit_code}", *sorted(set(keys(said)))]
        return outcome.exit_code


@pytest.fixture(scope="module")
def performance(tmp_path_factory: pytest.TempPathFactory) -> Performance:
    return Performance(tmp_path_factory.mktemp("golden"))


def compared(request: pytest.FixtureRequest, name: str, found: str) -> None:
    """Hold what was found against the golden file of this name, or write it."""
    path = HERE / name
    if request.config.getoption("--regenerate"):
        path.write_text(found, encoding="utf-8")
    kept = path.read_text(encoding="utf-8")
    assert found.splitlines() == kept.splitlines(), f"if it was meant: pytest tests/golden --regenerate, and look at the diff of {name}"


def as_text(found: Any) -> str:
    return json.dumps(found, indent=1, ensure_ascii=False) + "\n"


def test_help_of_every_verb(request: pytest.FixtureRequest) -> None:
    said = []
    for words in (("--help",), ("--help-all",), *((verb, asked) for verb in VERBS for asked in ("--help", "--help-all"))):
        outcome = CliRunner().invoke(cli, words, prog_name="beltcomm", terminal_width=80 if words[-1] == "--help" else 120)
        assert outcome.exit_code == 0
        said.append(f"$ beltcomm {' '.join(words)}\n{outcome.stdout}")
    compared(request, "help.txt", "\n".join(said))


def test_public_functions_and_their_signatures(request: pytest.FixtureRequest) -> None:
    public = {name: getattr(api, name) for name in sorted(api.__all__)}
    said = [f"{name}{'' if item is BeltcommError else inspect.signature(item)}" for name, item in public.items()]
    compared(request, "api.txt", "\n".join(said) + "\n")


@pytest.mark.examination
def test_keys_of_every_json(request: pytest.FixtureRequest, performance: Performance) -> None:
    compared(request, "json_keys.json", as_text(performance.keys))


@pytest.mark.examination
def test_files_of_a_run(request: pytest.FixtureRequest, performance: Performance) -> None:
    compared(request, "run_files.json", as_text(performance.files))


@pytest.mark.examination
def test_frames_of_what_moves(request: pytest.FixtureRequest, performance: Performance) -> None:
    """Exit code, number and hash of all frames.  The amplitude and the gains come from fits: their last digits are the processor's."""
    here = arithmetic()
    if not request.config.getoption("--regenerate"):
        kept = json.loads((HERE / "frames.json").read_text(encoding="utf-8"))
        if kept["arithmetic"] != here:
            assert set(kept["frames"]) == set(performance.frames)
            pytest.skip("the frames were noted on another processor, or with another numpy, scipy or numba: their bytes may differ")
    compared(request, "frames.json", as_text({"arithmetic": here, "frames": performance.frames}))
