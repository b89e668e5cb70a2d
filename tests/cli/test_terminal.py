"""What is seen on a terminal: lines fitted to it, tables, the live display of a phase; and that none of it gets into a pipe."""

from __future__ import annotations

import io
import re

import pytest

from beltcomm.cli.display import _window_line
from beltcomm.cli.talk import PlainTalk, RichTalk, terminal_talk
from beltcomm.cli.terminal import WIDEST, _width_of, echo, failure, fitted
from beltcomm.drive.finding import Finding
from beltcomm.jobs.doctor import _lines
from beltcomm.result import jsonable, table
from beltcomm.talk import CarriagePosition

ROWS = [["sign and breakaway", "2 mm", "0.74 N m"], ["excitation, rising in steps", "30 mm", "1.24 N m"]]
TABLE = table(["experiment", ">travel", ">torque"], ROWS)
CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


@pytest.fixture(autouse=True)
def usual_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.setenv("COLUMNS", "70")
    monkeypatch.delenv("NO_COLOR", raising=False)
    monkeypatch.delenv("FORCE_COLOR", raising=False)


def printed(stream: io.StringIO) -> str:
    return CONTROL.sub("", stream.getvalue())


def test_a_line_is_no_wider_than_the_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Broken between words and indented; in a pipe nothing is broken."""
    monkeypatch.setenv("COLUMNS", "40")
    line = "  model:" + 20 * " word"
    lines = fitted(line, Terminal()).splitlines()
    assert max(map(len, lines)) <= 40
    assert all(each.startswith("    word") for each in lines[1:])
    assert " ".join(" ".join(lines).split()) == line.strip()
    assert fitted(line, io.StringIO()) == line
    assert fitted("short", Terminal()) == "short"


@pytest.mark.parametrize("columns", ["-5", "0", "abc", "", "9" * 30])
def test_a_width_that_is_none(monkeypatch: pytest.MonkeyPatch, columns: str) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert 1 <= _width_of(Terminal()) <= WIDEST
    assert fitted("word " * 50, Terminal()).split() == ["word"] * 50


def test_a_row_of_a_table_is_a_line_of_text() -> None:
    """Whoever writes it into a file, joins it or makes JSON of it sees no more than a string."""
    assert [str(row) for row in TABLE] == [
        "experiment                   travel    torque",
        "sign and breakaway             2 mm  0.74 N m",
        "excitation, rising in steps   30 mm  1.24 N m",
    ]
    assert type(jsonable(TABLE)[0]) is str


@pytest.mark.parametrize(("stream", "term"), [(io.StringIO(), "xterm"), (Terminal(), "dumb")])
def test_without_a_terminal_that_draws_a_table_is_its_text(monkeypatch: pytest.MonkeyPatch, stream: io.StringIO, term: str) -> None:
    monkeypatch.setenv("TERM", term)
    echo(["before", *TABLE, "after"], stream)
    assert stream.getvalue().splitlines() == ["before", *TABLE, "after"]
    failure("beltcomm: no", stream)
    assert "\x1b" not in stream.getvalue()


@pytest.mark.parametrize("columns", [100, 60, 44, 30, 16])
def test_a_drawn_table_is_whole_at_any_width(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    """Every cell is there, nothing is wider than the terminal, nothing is cut off; two tables in a row stay two."""
    monkeypatch.setenv("COLUMNS", str(columns))
    stream = Terminal()
    echo([*TABLE, *table(["", "note"], [["a", "[b]"]])], stream)
    lines = printed(stream).splitlines()
    assert max(map(len, lines)) <= columns
    text = " ".join(" ".join(lines).split())
    assert "…" not in text
    assert all(word in text for row in ROWS for cell in row for word in cell.split())
    assert "[b]" in text
    assert text.index("1.24") < text.index("note")


@pytest.mark.parametrize(("no_color", "red"), [("", True), ("1", False)])
def test_errors_are_red_where_colours_are_wanted(monkeypatch: pytest.MonkeyPatch, no_color: str, red: bool) -> None:
    monkeypatch.setenv("NO_COLOR", no_color)
    stream = Terminal()
    failure("beltcomm: the record is clipped", stream)
    assert printed(stream) == "beltcomm: the record is clipped\n"
    assert ("\x1b[31m" in stream.getvalue()) is red


def test_the_talk_of_a_dumb_terminal_is_plain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr", Terminal())
    assert isinstance(terminal_talk(), RichTalk)
    monkeypatch.setenv("TERM", "dumb")
    assert isinstance(terminal_talk(), PlainTalk)


@pytest.mark.parametrize("columns", [100, 60, 40])
def test_the_carriage_is_shown_inside_its_window(columns: int) -> None:
    for share, at in ((-0.1, 0.0), (0.0, 0.0), (0.25, 0.25), (1.0, 1.0), (1.2, 1.0)):
        line = _window_line(CarriagePosition("frf_1", -0.01 + 0.58 * share, (-0.01, 0.57)), columns).plain
        low, bar, high = re.split(r"[\[\]]", line)
        assert (low.strip(), high.split("carriage")[0].rstrip()) == ("-10 mm", " 570 mm")
        assert bar.index("|") == pytest.approx(at * (len(bar) - 1), abs=0.51)
        assert ("(outside)" in line) is not (0.0 <= share <= 1.0)
        assert f"carriage at {-10 + 580 * share:.0f} mm" in line
        assert max(map(len, line.removesuffix(" (outside)").split("\n"))) <= columns
    unknown = _window_line(CarriagePosition("frf_1", 0.003, (-0.02, 0.02), known=False), columns).plain
    assert "+3 mm" in unknown
    assert "-20 mm [" in unknown
    assert "[" not in _window_line(CarriagePosition("frf_1", 0.003, (float("-inf"), float("inf"))), columns).plain


def test_the_display_tells_phase_record_seconds_and_place() -> None:
    now, stream = [0.0], Terminal()
    talk = RichTalk(stream, lambda: now[0])
    talk.phase(6, 8, "strokes [all]")
    talk.moving(CarriagePosition("frf_3", 0.1, (0.0, 0.5), left_s=41.0))
    talk.progress(0.45, 3.0)
    talk._live.refresh()
    shown = printed(stream)
    for words in ("6/8 strokes [all]", "41 s left on the machine", "frf_3", "45 %, 3 s left", "0 mm [", "carriage at 100 mm"):
        assert words in shown
    talk.say("a [remark]", *TABLE)
    now[0] = 12.0
    talk.close(done=True)
    assert "a [remark]" in printed(stream)
    assert printed(stream).rstrip().endswith("6/8 strokes [all]: done in 12 s")
    talk.phase(7, 8, "fit")
    now[0] = 16.0
    talk.progress(0.5, None)
    talk._live.refresh()
    assert "50 %, about 4 s left" in printed(stream)
    talk.close()
    assert printed(stream).rstrip().endswith("7/8 fit: not finished")


def test_a_log_has_a_line_for_each_record() -> None:
    stream = io.StringIO()
    talk = PlainTalk(stream)
    talk.phase(6, 8, "strokes")
    for record in ("sweep", "frf_2"):
        for row in range(1, 5):
            talk.moving(CarriagePosition(record, 0.1 * row, (0.0, 0.5), left_s=50.0 - row))
            talk.progress(row / 5, 5.0 - row)
    assert stream.getvalue().splitlines() == [
        "[6/8] strokes",
        "      sweep: carriage at 100 mm (of 0 mm to 500 mm), 49 s left on the machine",
        "      frf_2: carriage at 100 mm (of 0 mm to 500 mm), 49 s left on the machine",
    ]


def test_a_finding_of_a_doctor_goes_on_below_itself() -> None:
    """Mark, sentence and what to do: on a terminal each is broken between words, and never below its mark."""
    found = Finding("this machine", "can", "warning", "no CAN sockets " * 6, "`sudo modprobe can`, " * 5)
    rows = list(_lines([found]))
    assert [row[:15] for row in rows] == ["this machine:", "  warning      ", " " * 15]
    stream = Terminal()
    echo(rows, stream)
    head, *lines = printed(stream).rstrip().splitlines()
    assert head == "this machine:"
    assert len(lines) > len(rows)
    assert [line[:15].strip() for line in lines] == ["warning", *[""] * (len(lines) - 1)]
    assert [line[15:18] for line in lines if "sudo" in line] == ["-> ", *["   "] * (sum("sudo" in line for line in lines) - 1)]


@pytest.mark.parametrize(("answer", "key"), [("ja", "y"), ("yes", "y"), ("nein", "q"), ("no", "q"), ("", "q")])
def test_a_question_is_answered_in_both_languages(monkeypatch: pytest.MonkeyPatch, answer: str, key: str) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(f"{answer}\n"))
    assert PlainTalk(io.StringIO()).choose("start?", {"y": "start", "q": "quit"}) == key
