"""What is installed beside this package: bounded on both sides, free of what is known to be unsafe, with its licences named."""

from __future__ import annotations

import runpy
import tomllib
from importlib.metadata import metadata
from pathlib import Path
from typing import Any

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

CHECKOUT = Path(__file__).parents[2]
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
DIRECT = [Requirement(line) for lines in (PROJECT["dependencies"], *PROJECT["optional-dependencies"].values()) for line in lines]


@pytest.fixture(scope="module")
def audit() -> dict[str, Any]:
    """The functions of the check that CI runs."""
    return runpy.run_path(str(CHECKOUT / ".ci" / "audit"))


def bounds(wanted: Requirement) -> tuple[list[Version], list[Version]]:
    """From where on, and up to where, a package is taken."""
    from_, below = ([Version(one.version) for one in wanted.specifier if one.operator == operator] for operator in (">=", "<"))
    return from_, below


@pytest.mark.parametrize("wanted", DIRECT, ids=str)
def test_every_package_is_bounded_on_both_sides_and_from_no_unsafe_version_on(wanted: Requirement, audit: dict[str, Any]) -> None:
    ((least,), (below,)) = bounds(wanted)
    assert least < below
    unsafe = [
        words for known, words in audit["known"]() if known.name == canonicalize_name(wanted.name) and known.specifier.contains(least)
    ]
    assert unsafe == []


def test_what_is_installed_here_is_free_of_what_is_known_to_be_unsafe(audit: dict[str, Any], capsys: pytest.CaptureFixture[str]) -> None:
    assert audit["main"]() == 0, capsys.readouterr().err
    assert {"numba", "filelock", "werkzeug", "pillow"} <= set(audit["installed"]())


def test_the_check_finds_an_unsafe_version(audit: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "advisories.txt").write_text("# none\nnumba<99   CVE-0: a trial\nnumba<0.1  CVE-1: long ago\n", encoding="utf-8")
    audit["main"].__globals__["ADVISORIES"] = tmp_path / "advisories.txt"
    assert audit["main"]() == 1
    audit["main"].__globals__["ADVISORIES"] = CHECKOUT / ".ci" / "advisories.txt"


def test_the_hashes_of_ci_are_of_versions_that_are_asked_for() -> None:
    lines = [line for line in (CHECKOUT / ".ci" / "requirements.txt").read_text(encoding="ascii").splitlines() if not line.startswith("#")]
    assert all(" --hash=sha256:" in line for line in lines)
    locked = {canonicalize_name(line.partition("==")[0]): line.partition("==")[2].partition(" ")[0] for line in lines}
    asked = [Requirement(line) for line in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"]["dev"])]
    for wanted in asked:
        assert wanted.specifier.contains(locked[canonicalize_name(wanted.name)]), f"{wanted}: run .ci/lock"


def test_every_package_that_a_user_gets_has_its_licence_named(audit: dict[str, Any]) -> None:
    named = (CHECKOUT / "docs" / "licences.md").read_text(encoding="utf-8")
    for name in audit["installed"](extras=("", "mdf", "dbc", "study")):
        assert name == "beltcomm" or f"| {name} |" in named, f"{metadata(name)['Name']} is missing in docs/licences.md: run .ci/licences"
