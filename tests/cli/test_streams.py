"""Standard streams as a shell may leave them: closed, full, without letters; each is a sentence, and no other file is written into."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from beltcomm.borders import spelled
from beltcomm.cli import streams

FULL = Path("/dev/full")


def shell(line: str, folder: Path, **more: str) -> subprocess.CompletedProcess[str]:
    """A line of a shell, in which BELTCOMM is the program."""
    text = line.replace("BELTCOMM", f"'{sys.executable}' -m beltcomm")
    return subprocess.run(
        ["sh", "-c", text], cwd=folder, env={**os.environ, **more}, capture_output=True, text=True, encoding="utf-8", check=False
    )


@pytest.mark.skipif(not FULL.exists(), reason="needs a device that is always full")
@pytest.mark.parametrize("more", ["", " --json"])
def test_a_full_output_is_a_sentence(tmp_path: Path, more: str) -> None:
    done = shell(f"BELTCOMM effects{more} > {FULL}", tmp_path)
    assert done.returncode == 2
    assert done.stderr == "beltcomm: standard output cannot be written: No space left on device; make room, or send it elsewhere\n"


def test_a_closed_descriptor_is_given_to_no_file(tmp_path: Path) -> None:
    done = shell("exec BELTCOMM convert --help <&- >&- 2>&-", tmp_path)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    program = "from beltcomm.cli.streams import prepare; prepare(); import sys; file = open('a'); sys.stderr.write(str(file.fileno() > 2))"
    (tmp_path / "a").touch()
    assert shell(f"'{sys.executable}' -c \"{program}\" <&- >&-", tmp_path).stderr == "True"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "cp437"])
def test_letters_that_are_not_there_are_spelled(tmp_path: Path, encoding: str) -> None:
    done = shell("BELTCOMM effects cogging", tmp_path, PYTHONIOENCODING=encoding)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_is_spelled_stays_json() -> None:
    raw = io.BytesIO()
    streams.codecs.register_error("spelled", spelled)
    stream = streams.NamedStream(raw, "ascii", "spelled")
    print(json.dumps({"ü\ud800😀": "±2 m/s²"}, ensure_ascii=False), file=stream, flush=True)
    assert json.loads(raw.getvalue()) == {"ü\ud800😀": "+-2 m/s2"}


def test_a_stream_fails_once(tmp_path: Path) -> None:
    program = (
        "import sys; from beltcomm.cli.streams import prepare; prepare()\n"
        "def tell():\n    print('x' * 100000, flush=True)\n"
        "try:\n    tell()\nexcept OSError as error:\n    print(error.filename, file=sys.stderr)\n"
        "tell()\nprint('on', file=sys.stderr)\n"
    )
    (tmp_path / "p.py").write_text(program, encoding="utf-8")
    if FULL.exists():
        assert shell(f"'{sys.executable}' p.py > {FULL}", tmp_path).stderr == "standard output\non\n"
