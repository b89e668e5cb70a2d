"""Names of strangers as they leave: nothing that is obeyed reaches a terminal, a page, a comment or a file name."""

from __future__ import annotations

import io
import json
import os
import re
import unicodedata
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from rich.console import Console

from beltcomm.axis import Axis
from beltcomm.borders import for_archive, for_comment, for_file_name, for_html, for_json, for_terminal
from beltcomm.cli.main import cli
from beltcomm.cli.talk import PlainTalk, RichTalk
from beltcomm.cli.terminal import draw, echo, failure
from beltcomm.export.dcf import dcf_text
from beltcomm.export.program import controller_of
from beltcomm.export.texts import text_of
from beltcomm.report.page import Page, render
from beltcomm.result import table
from beltcomm.runfolder import RunFolder
from export.drive import CASCADES, LIMIT_NM, PERIOD_S

#: Title of a window, colours, a question whose answer is typed, eight bits in place of seven, a cleared screen, turned direction.
NASTY = (
    *("\x1b]0;owned\x07", "\x1b[31;1m", "\x1b[5n", "\x9b2J", "\x1bc", "a\x08b", "\u202egnp.exe", "x\u2066y"),
    *("\x00", "\ud800", "\x85", "\u2028", "\x7f"),
)
ENDINGS = ("*/", "/*", "*)", "(*", "</script>", "", "??/", "\\")


def drawn(count: int, seed: int) -> list[str]:
    """Texts of any characters, half of them of the dangerous kind."""
    draw, found = np.random.default_rng(seed), []
    for _ in range(count):
        length = int(draw.integers(1, 40))
        letters = [chr(int(draw.integers(0, 0x110000 if draw.random() < 0.2 else 0x100))) for _ in range(length)]
        found.append("".join(letters) + str(draw.choice(NASTY[:10])) + str(draw.choice(ENDINGS)))
    return found


TEXTS = [*NASTY, *drawn(300, 37)]


def obeyed(shown: str) -> list[str]:
    """Characters that do something in place of being seen."""
    turning = ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI", "BN")
    return [
        c
        for c in shown
        if c not in "\t\n"
        and unicodedata.category(c) in ("Cc", "Cf", "Cs", "Zl", "Zp")
        and (unicodedata.category(c) != "Cf" or unicodedata.bidirectional(c) in turning)
        and not 0x1BCA0 <= ord(c) <= 0x1D17A  # marks of shorthand and of music
    ]


@pytest.mark.parametrize(
    "border", [for_terminal, for_html, for_comment, for_archive, lambda t: for_file_name(t, "x"), lambda t: for_json({"a": t})]
)
def test_nothing_that_is_obeyed_leaves(border: Callable[[str], str]) -> None:
    for given in TEXTS:
        assert obeyed(border(given)) == [], repr(given)
        border(given).encode()  # no half characters


def test_what_is_meant_stays_as_it_is() -> None:
    for plain in ("Achse 3, 5 µm ± 2 °C − 10⁻³ N m²", "轴 1", "a\tb\nc", "½ │ █", "قاطرة"):
        assert for_terminal(plain) == for_html(plain) == plain
    assert for_terminal("\x1b[31m") == "\\x1b[31m"


def test_json_stays_json_with_the_same_values() -> None:
    for given in TEXTS:
        assert json.loads(for_json({"name": given})) == {"name": given}
    with pytest.raises(ValueError, match="not JSON compliant"):
        for_json({"x": float("nan")})


def test_a_comment_stays_a_comment() -> None:
    for given in TEXTS:
        found = for_comment(given)
        assert found.isascii()
        assert "\n" not in found
        assert not any(mark in found for mark in ("/*", "*/", "(*", "*)"))


def test_a_file_name_is_one_on_any_system() -> None:
    for given in [*TEXTS, "../../etc/passwd", "..", "~", "con\x00", "n" * 400, "/", "-rf", ".bashrc"]:
        assert re.fullmatch(r"[A-Za-z0-9]([A-Za-z0-9_.-]{0,58}[A-Za-z0-9])?", for_file_name(given, "axis")), repr(given)
    assert for_file_name("Prüfstand 3", "axis") == "Prufstand-3"


def test_a_name_in_a_zip_stays_in_its_folder() -> None:
    assert for_archive("results/Prüfstand 3.yaml") == "results/Prüfstand 3.yaml"
    assert for_archive("a\\..\\\n\x1b.txt") == "a%5C..%5C%0A%1B.txt"
    assert len({for_archive(os.fsdecode(bytes([byte]))) for byte in range(1, 256)}) == 255


def test_everything_that_prints_goes_through_the_border(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    for given in TEXTS[:60]:
        said = io.StringIO()
        echo([given, *table(["name"], [[given]])], said)
        failure(f"beltcomm: {given}", said)
        PlainTalk(said).say(given)
        console = Console(file=said, width=200, color_system=None, highlight=False, markup=False, emoji=False)
        draw([given, *table(["name", "x"], [[given, given]])], console, said)
        assert obeyed(said.getvalue()) == [], repr(given)
    assert hasattr(RichTalk, "say")


def test_exported_code_and_files_of_a_stranger_s_run_obey_nobody() -> None:
    cascade = CASCADES["butterworth"]
    for given in TEXTS[:60]:
        for format_ in ("c", "st"):
            made = text_of(controller_of(cascade, PERIOD_S, LIMIT_NM, {"run": given, "model": given}, [given]), format_)
            assert obeyed(made) == [], (format_, repr(given))
        lines = dcf_text([], {"device_name": f"drive\r\n[6060]\r\n{given}"}, [given]).split("\r\n")
        assert "[6060]" not in lines
        assert obeyed("\n".join(lines)) == []


def test_a_page_obeys_nobody() -> None:
    for given in TEXTS[:30]:
        html = render(Page(given, given, given, "good", [], [given]))
        assert obeyed(html) == []
        assert html.count("</script>") == render(Page("", "", "", "good", [], [""])).count("</script>")


def test_a_stranger_s_axis_in_a_command(tmp_path: Path) -> None:
    """From the file to what a terminal gets, with a name of 300 letters that asks for a window's title."""
    name = "x\x1b]0;owned\x07" * 30
    folder = RunFolder.create(tmp_path / "run", Axis(name=name))
    done = CliRunner().invoke(cli, ["compare", str(folder.path)])
    assert done.exit_code == 3
    assert obeyed(done.output) == []
    done = CliRunner().invoke(cli, ["export", str(folder.path), "--format", "c"])
    assert obeyed(done.output) == []
