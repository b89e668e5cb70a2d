"""What must stay true of the whole checkout; style, docstrings and banned calls are ruff's, types mypy's (see .ci/run)."""

from __future__ import annotations

import ast
import os
import re
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from beltcomm import __version__
from beltcomm.axis import load_axis
from beltcomm.model import load_plant
from beltcomm.study.file import load_study
from beltcomm.virtual.foreign import profile_named
from beltcomm_adapters.profiles import load_profile

CHECKOUT = Path(__file__).parent.parent
SOURCES = [path for folder in ("beltcomm", "adapters", "tests", "docs", "examples") for path in (CHECKOUT / folder).rglob("*.py")]
TEXTS = [path for path in CHECKOUT.glob("*.*") if path.suffix in (".md", ".toml", ".yml", ".yaml")] + [
    path
    for folder in ("beltcomm", "adapters", "tests", "configs", "docs", "examples", ".ci", ".github")
    for path in (CHECKOUT / folder).rglob("*")
    if path.is_file() and path.suffix in ("", ".py", ".md", ".yaml", ".yml", ".csv", ".json", ".toml", ".ipynb")
]
LOADERS: dict[str, Callable[[str], Any]] = {
    **{"axes": load_axis, "plants": load_plant, "drives": load_profile, "studies": load_study},
    "slaves": profile_named,
}
#: Held by tests/cli/test_init.py.
OWN_TESTS = ("catalogue",)
CONFIGS = [path for path in sorted((CHECKOUT / "configs").rglob("*.*")) if path.parent.name not in OWN_TESTS]

#: Files of more than 400 lines beside their docstrings, and why each is one thing.
LONG: dict[str, str] = {}

RUN = "python3 -m venv .venv && .venv/bin/pip install -q . && .venv/bin/beltcomm commission --drive virtual --yes"
TEST = "python3 -m venv .venv && .venv/bin/pip install -q -e '.[dev]' && .venv/bin/python -m pytest"


def settings() -> dict[str, Any]:
    with open(CHECKOUT / "pyproject.toml", "rb") as file:
        return tomllib.load(file)


def lines_of_code(text: str) -> int:
    """Lines beside docstrings: what a reader meets behind the reference."""
    bodies = [node.body for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)]
    docstrings = [body[0] for body in bodies if body and isinstance(body[0], ast.Expr) and isinstance(body[0].value, ast.Constant)]
    return len(text.splitlines()) - sum((node.end_lineno or 0) - node.lineno + 1 for node in docstrings)


def test_a_long_file_has_its_reason() -> None:
    """A file that is read in one go has no more than 400 lines; one that says a single thing at greater length is not cut for that."""
    lengths = {path.relative_to(CHECKOUT).as_posix(): lines_of_code(path.read_text(encoding="utf-8")) for path in SOURCES}
    assert {name for name, lines in lengths.items() if lines > 400} == set(LONG)


def test_no_text_names_a_folder_of_one_machine() -> None:
    machine_path = re.compile(r"(?<![\w.$}/])(/(home|root|work|Users|mnt|srv)/\w+|[A-Z]:\\\\?\w+)")
    found = {
        f"{path.relative_to(CHECKOUT).as_posix()}:{number}": match[0]
        for path in TEXTS
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if (match := machine_path.search(line))
    }
    assert found == {}


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_every_shipped_file_loads_by_its_name(path: Path) -> None:
    LOADERS[path.parent.name](path.stem)


def test_the_two_commands_are_in_the_readme_and_ci_runs_the_second() -> None:
    readme = [line.strip() for line in (CHECKOUT / "README.md").read_text(encoding="utf-8").splitlines()]
    script = CHECKOUT / ".ci" / "run"
    assert RUN in readme
    assert TEST in readme
    assert TEST in script.read_text(encoding="utf-8").splitlines()
    assert os.access(script, os.X_OK)


def test_the_hooks_are_the_checks_of_ci() -> None:
    settings = yaml.safe_load((CHECKOUT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    steps = (CHECKOUT / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    hooks = [hook for repository in settings["repos"] for hook in repository["hooks"]]
    assert {repository["repo"] for repository in settings["repos"]} == {"local"}, "nothing is downloaded"
    assert [hook["entry"] for hook in hooks if hook["entry"] not in steps] == []


def test_the_changelog_tells_of_this_version() -> None:
    log = (CHECKOUT / "CHANGELOG.md").read_text(encoding="utf-8")
    told = re.findall(r"^## \[(.+?)\]", log, re.MULTILINE)
    assert told[:2] == ["Unreleased", __version__]


def test_the_structure_page_shows_the_layers_that_are_enforced() -> None:
    page = (CHECKOUT / "docs" / "architecture.md").read_text(encoding="utf-8")
    contracts = settings()["tool"]["importlinter"]["contracts"]
    (layers,) = [contract["layers"] for contract in contracts if contract.get("containers") == ["beltcomm"]]
    shown = re.findall(r"```layers\n(.*?)```", page, re.DOTALL)
    assert [text.splitlines() for text in shown] == [layers]


def test_the_structure_page_names_every_module() -> None:
    page = (CHECKOUT / "docs" / "architecture.md").read_text(encoding="utf-8")
    first_cells = "".join(line.split("|")[1] for line in page.splitlines() if line.startswith("|"))
    named = {name.removesuffix("/") for name in re.findall(r"`([\w/]+)`", first_cells)}
    modules = {path.stem for path in (CHECKOUT / "beltcomm").iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    rooms = {path.parent.name for path in (CHECKOUT / "beltcomm" / "fit").glob("*/__init__.py")}
    assert (modules | rooms) - {"__init__"} <= named


def test_a_class_name_means_one_thing() -> None:
    """And so does a page of the reference that is generated of them."""
    places: dict[str, list[str]] = {}
    for path in (path for path in SOURCES if path.relative_to(CHECKOUT).parts[0] in ("beltcomm", "adapters")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name, []).append(str(path.relative_to(CHECKOUT)))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_no_module_hides_a_function_of_its_package() -> None:
    """Python binds a submodule to its package's name for it when it is imported, over whatever stood there."""
    for path in CHECKOUT.glob("beltcomm/**/__init__.py"):
        beside = {item.stem for item in path.parent.iterdir()} - {"__init__"}
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                assert node.name not in beside, path
