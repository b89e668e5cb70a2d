"""A run folder from somebody else: what it names or links to outside of itself is neither read nor packed."""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from beltcomm.configfiles import to_yaml, write_text
from beltcomm.jobs.bundle import write_bundle
from foreign.samples import options, text, write

SECRET = "-----BEGIN OPENSSH PRIVATE KEY-----"


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, [*map(str, words)])


@pytest.fixture
def run(tmp_path: Path) -> Path:
    log, folder = write(tmp_path / "log.csv", text()), tmp_path / "run"
    assert call("import", log, "--run", folder, "--axis", "egc-70-600", *options()).exit_code == 0
    return folder


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    (tmp_path / "home").mkdir()
    path = tmp_path / "home" / "id.txt"
    path.write_text(SECRET)
    return path


@pytest.mark.parametrize("recordings", [True, False])
def test_a_bundle_packs_nothing_that_a_link_points_to(run: Path, secret: Path, tmp_path: Path, recordings: bool) -> None:
    (run / "notes.txt").symlink_to(secret)
    (run / "results").mkdir(exist_ok=True)
    (run / "results" / "more.yaml").symlink_to(secret)
    (run / "recordings" / "more.csv").symlink_to(secret)
    (run / "elsewhere").symlink_to(secret.parent)
    (run / "relative.txt").symlink_to(os.path.relpath(secret, run))
    os.mkfifo(run / "pipe.txt")
    names = write_bundle(run, tmp_path / "out.zip", recordings=recordings)
    with zipfile.ZipFile(tmp_path / "out.zip") as archive:
        assert all(SECRET.encode() not in archive.read(name) for name in archive.namelist())
    assert "axis.yaml" in names
    assert ("recordings/log.csv" in names) is recordings


def test_a_bundle_does_not_follow_a_link_in_its_own_place(run: Path, secret: Path) -> None:
    (run / "bundle.zip").symlink_to(secret)
    write_bundle(run, run / "bundle.zip")
    assert secret.read_text() == SECRET
    assert zipfile.is_zipfile(run / "bundle.zip")


@pytest.mark.parametrize("way", ["absolute", "upwards", "link", "folder", "dbc", "dots", "nothing", "number"])
def test_repeating_imports_reads_no_file_outside(run: Path, secret: Path, way: str, monkeypatch: pytest.MonkeyPatch) -> None:
    sidecar = run / "recordings" / "log.yaml"
    data = yaml.safe_load(sidecar.read_text())
    about = data["import"]
    if way == "absolute":
        about["original"] = str(secret)
    elif way == "upwards":
        about["original"] = f"originals/../../home/{secret.name}"
    elif way == "dots":
        about["original"] = "originals/.."
    elif way == "nothing":
        about["original"] = None
    elif way == "number":
        about["original"] = 7
    elif way == "link":
        (run / "originals" / "log.csv").unlink()
        (run / "originals" / "log.csv").symlink_to(secret)
    elif way == "folder":
        (run / "originals" / "log.csv").rename(secret.parent / "log.csv")
        (run / "originals").rmdir()
        (run / "originals").symlink_to(secret.parent)
    else:
        about["reading"]["dbc"] = str(secret)
    write_text(sidecar, to_yaml(data))
    read: list[str] = []

    def watched(plain: Callable[..., Any]) -> Callable[..., Any]:
        def noting(path: Any, *given: Any, **named: Any) -> Any:
            if not isinstance(path, int):
                read.append(os.path.realpath(path))
            return plain(path, *given, **named)

        return noting

    monkeypatch.setattr("io.open", watched(io.open))
    monkeypatch.setattr("os.open", watched(os.open))
    done = call("import", "--check", "--run", run)
    if way == "folder":  # the whole run is refused
        assert done.exit_code == 3
        assert "is a link out of the run folder" in done.stderr
    else:
        assert done.exit_code == 1
        assert ("is a link" if way == "link" else "which is not a file in originals/") in done.stdout
    assert way == "folder" or any("recordings" in path for path in read), "what was read is seen"
    assert not [path for path in read if path.startswith(str(secret.parent))]


def test_links_in_a_circle_are_no_program_error(run: Path) -> None:
    (run / "one").symlink_to("two")
    (run / "two").symlink_to("one")
    done = call("compare", run)
    assert done.exit_code in (0, 3)
    assert "unexpected" not in done.stderr
