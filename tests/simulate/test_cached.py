"""The cache of kernels: what is half imported is not used, what nobody will look for is taken away, and nothing else."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from beltcomm.simulate.kernels import ahead, compile_largest, compose
from beltcomm.simulate.kernels.ahead import VERSION, prune, write_note

DIGITS = "0123456789abcdef0123"
OLD, NOW, LATER = (f"kernel_{VERSION + k}_{DIGITS}" for k in (-1, 0, 1))


@pytest.fixture
def kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    (tmp_path / "beltcomm" / "kernels" / "__pycache__").mkdir(parents=True)
    return tmp_path / "beltcomm" / "kernels"


@pytest.mark.parametrize("error", ["RuntimeError", "KeyboardInterrupt"])
def test_a_kernel_that_is_imported_by_half_is_not_used(kernels: Path, error: str) -> None:
    source = f"begun = True\nraise {error}('half')\nended = True\n"
    before = set(sys.modules)
    for _ in range(2):
        with pytest.raises((RuntimeError, KeyboardInterrupt), match="half"):
            compose.import_stable(source)
    assert not [name for name in set(sys.modules) - before if name.startswith("kernel_")]
    assert len(list(kernels.glob("kernel_*.py"))) == 1


def test_a_kernel_whose_file_goes_before_it_is_read_is_taken_from_its_source(kernels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compose, "_source_file", lambda name, _: kernels / f"{name}.py")
    module = compose.import_stable("from beltcomm.compiled import compiled\n\n\n@compiled\ndef twice(x):\n    return 2 * x\n# gone\n")
    assert module.twice(2) == 4
    sys.modules.pop(module.__name__)


def left_of(files: dict[str, str], kernels: Path) -> set[str]:
    """Of these files, those that are left."""
    for name, text in files.items():
        (kernels / name).write_text(text, encoding="utf-8")
    note = kernels / f"ahead_{'f' * 20}"
    write_note(note)
    prune(note)
    assert note.is_file()
    return {name for name in files if (kernels / name).exists()}


def test_notes_of_programs_that_are_no_more_go(kernels: Path, tmp_path: Path) -> None:
    def told(package: Path | str, cache: str = "") -> str:
        return json.dumps({"package": str(package), "numba_cache": cache})

    (tmp_path / "other").mkdir()
    go = {f"ahead_{1:020x}": "", f"ahead_{2:020x}": told(ahead.package()), f"ahead_{3:020x}": told(tmp_path / "gone")}
    stay = {
        f"ahead_{4:020x}": told(tmp_path / "other"), f"ahead_{5:020x}": told(ahead.package(), "/another/cache"),
        f"ahead_{6:020x}": "a letter", f"ahead_{7:020x}": told("relative"), f"ahead_{8:020x}": "[]", "ahead_of_time": "", "ahead_123": "",
        f"ahead_{9:020x}.txt": "",
    }  # fmt: skip
    assert left_of({**go, **stay}, kernels) == set(stay)


def test_machine_code_and_drafts_of_earlier_versions_go(kernels: Path) -> None:
    code = ("advance-20.py311.nbi", f"advance-20.py311.{DIGITS}.nbc", "cpython-311.pyc")
    go = {f"__pycache__/{OLD}.{kind}": "" for kind in code} | {f"{OLD}ab_c12.draft": ""}
    stay = {f"__pycache__/{name}.{kind}": "" for name in (NOW, LATER) for kind in code}
    stay |= {f"{NOW}ab.draft": "", f"{OLD}.py": "", f"{OLD}.txt": "", f"__pycache__/{OLD}.txt": "", f"__pycache__/my_{OLD}.{code[0]}": ""}
    assert left_of({**go, **stay}, kernels) == set(stay)


def test_links_and_folders_are_somebody_elses(kernels: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").touch()
    (kernels / f"ahead_{1:020x}").symlink_to(tmp_path / "mine")
    (kernels / f"ahead_{2:020x}").mkdir()
    (kernels / "__pycache__" / f"{OLD}.advance-20.py311.nbi").symlink_to(tmp_path / "mine")
    assert left_of({}, kernels) == set()
    assert len(list(kernels.glob("ahead_*"))) == 3
    assert (kernels / "__pycache__" / f"{OLD}.advance-20.py311.nbi").is_symlink()
    prune(tmp_path / "nowhere" / "note")


def test_what_numba_writes_is_known_by_its_name(kernels: Path) -> None:
    """The names of a kernel that was compiled here, but for the number."""
    module = compose.import_stable("from beltcomm.compiled import compiled\n\n\n@compiled\ndef thrice(x):\n    return 3 * x\n")
    assert module.thrice(2) == 6
    sys.modules.pop(module.__name__)
    made = list((kernels / "__pycache__").iterdir())
    assert {path.suffix for path in made} >= {".nbc"}
    for path in made:
        path.rename(path.with_name(path.name.replace(f"kernel_{VERSION}_", f"kernel_{VERSION - 1}_")))
    left_of({}, kernels)
    assert list((kernels / "__pycache__").iterdir()) == []


def test_an_earlier_version_whose_machine_code_went_only_compiles_again(kernels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = "from beltcomm.compiled import compiled\n\n\n@compiled\ndef four(x):\n    return 4 * x\n"
    monkeypatch.setattr(compose, "VERSION", VERSION - 1)
    running = compose.import_stable(source)
    assert running.four(2) == 8
    sys.modules.pop(running.__name__)
    left_of({}, kernels)
    assert running.four(2.5) == 10.0, "a running one"
    again = compose.import_stable(source)
    assert again.four(2) == 8
    assert again is not running
    sys.modules.pop(again.__name__)


def test_the_note_that_is_written_ahead_says_whose_it_is_and_prunes(kernels: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "beltcomm.simulate.kernels.compose.load_module", lambda: type("Module", (), {"load": staticmethod(lambda *_: None)})
    )
    (kernels / f"ahead_{1:020x}").touch()
    compile_largest.main()
    (note,) = kernels.glob("ahead_*")
    assert note == ahead.note_file()
    assert json.loads(note.read_text(encoding="utf-8")) == {"package": str(ahead.package()), "numba_cache": ""}
