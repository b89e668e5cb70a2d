"""A second language: every text of the screens is in its catalogue, with the same placeholders, and its screens are screens too."""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import beltcomm
from beltcomm import language
from beltcomm.axis import load_axis
from beltcomm.axis.entries import SECTIONS, entries_of
from beltcomm.cli.help import About, paragraphs
from beltcomm.cli.main import COMMON, GROUPS, VERBS, cli
from beltcomm.drive import open_drive
from beltcomm.effects import EFFECTS
from beltcomm.experiments.plan import commission_plan
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.laboratory.figures import PlainError
from beltcomm.language import catalogue
from beltcomm.sentences.laboratory import STATES, error_words
from doctor.setups import SETUPS, called

SOURCE = Path(beltcomm.__file__).parent
PLACES = re.compile(r"\{[^}]*\}")
#: Texts that are the same in every language, or no text.
SAME = {"", "how", " (", r" -?[\d.]"}


def texts() -> set[str]:
    """Every literal that is given to ``tr``."""
    found: set[str] = set()
    for path in SOURCE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "tr" and node.args:
                found |= {part.value for part in ast.walk(node.args[0]) if isinstance(part, ast.Constant) and isinstance(part.value, str)}
    return found - SAME


@pytest.fixture(params=language.OFFERED)
def spoken(request: pytest.FixtureRequest) -> str:
    language.use(request.param)
    return str(request.param)


def test_every_text_of_the_screens_is_translated(spoken: str) -> None:
    known = language.catalogue(spoken)
    meanings = {entry.meaning for kind in SECTIONS.values() for entry in entries_of(kind).values()}
    assert sorted((texts() | meanings) - known.keys()) == []


def test_every_help_is_translated(spoken: str) -> None:
    verbs = [cli, *(cli.get_command(click.Context(cli), verb) for verb in VERBS)]
    texts = {part for command in verbs for part in paragraphs(command) if not part.startswith("Example: ")} | set(About)
    texts |= {text for one in verbs for param in one.params for text in (getattr(param, "help", ""), getattr(param, "brief", "")) if text}
    assert sorted(texts - language.catalogue(spoken).keys()) == []


def test_placeholders_are_the_same(spoken: str) -> None:
    wrong = [text for text, told in language.catalogue(spoken).items() if sorted(PLACES.findall(text)) != sorted(PLACES.findall(told))]
    assert wrong == []


def test_findings_of_doctor_are_translated_and_whole(spoken: str) -> None:
    shown = [json.loads(called(setup, "--json").stdout) for setup in SETUPS.values()]
    language.use(spoken)  # a command has set that of its environment
    texts = {found[key] for one in shown for found in one["findings"] if found["state"] != "ok" for key in ("area", "text", "remedy")}
    texts |= {one["next"] for one in shown if not one["next"].endswith("`")}
    known = {"", "axis.yaml"}
    assert sorted(text for text in texts - known if language.told(text) == text and not (text[0] == text[-1] == "`")) == []


def test_every_finding_of_the_catalogue_keeps_what_fills_it(spoken: str) -> None:
    for pattern, told in language.findings(spoken):
        assert set(re.findall(r"\{(\w+)\}", told)) == set(pattern.groupindex)


def test_the_catalogue_of_effects_is_translated(spoken: str) -> None:
    """What a screen says of an effect that was found."""
    shown = {text for effect in EFFECTS for text in (effect.title, effect.seen, effect.causes, effect.check, effect.remedy) if text}
    assert sorted(text for text in shown if language.told(text) == text) == []


def test_a_line_keeps_its_indentation_and_its_mark(spoken: str) -> None:
    assert language.line_told("   ! responses differ by place: frf_2 (--details)").startswith("   ! Frequenzgänge")
    assert language.line_told("    beltcomm open runs/a") == "    beltcomm open runs/a"


def test_a_sentence_nobody_knows_stays() -> None:
    language.use("de")
    assert language.told("the moon is full {now}") == "the moon is full {now}"
    assert language.told("node 7 does not answer on can9 at 250 kbit/s") == "Knoten 7 antwortet nicht an can9 mit 250 kbit/s"


def test_a_plan_in_another_language_is_a_screen(spoken: str) -> None:
    axis = load_axis("egc-70-600-vertical")
    with open_drive("virtual:g_b_vertical", {"seed": 1}) as drive:
        lines = plan_screen(commission_plan(axis, drive.capabilities), axis, drive.capabilities)
    assert len(lines) <= 23
    assert max(map(len, lines)) <= 80
    assert "WILL MOVE" not in "".join(lines)


@pytest.mark.parametrize(
    ("environment", "wanted"),
    [({}, ""), ({"LANG": "de_DE.UTF-8"}, "de"), ({"LANG": "de_DE", "BELTCOMM_LANG": "en"}, "en"), ({"LC_ALL": "C", "LANG": "de_AT"}, "c")],
)
def test_the_shell_says_which(environment: dict[str, str], wanted: str) -> None:
    assert language.of_environment(environment) == wanted


def test_a_language_that_is_not_offered_leaves_english() -> None:
    language.use("xx")
    assert language.tr("range") == "range"


def test_answers_of_the_laboratory_are_screens(spoken: str) -> None:
    """Errors and words of state fit beside their label, and none stays English."""
    whole = PlainError(0.0123, 0.0045, 0.25, 12.3, "N m", 240.0)
    words = error_words((1.01, 0.98), (whole, whole))
    assert len(words) + 12 <= 80
    assert not {"noise", "torque", "held"} & set(words.split())
    known = language.catalogue(spoken)
    assert sorted({word for word, _ in STATES.values()} - known.keys()) == []


def test_help_speaks_german_on_the_same_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    english = CliRunner().invoke(cli, ["--help"]).stdout
    monkeypatch.setenv("BELTCOMM_LANG", "de")
    german = CliRunner().invoke(cli, ["--help"]).stdout
    assert len(german.splitlines()) == len(english.splitlines())
    assert max(map(len, german.splitlines())) <= 80
    whole = CliRunner().invoke(cli, ["--help-all"]).stdout
    shown = "".join((german + whole).split())  # however the lines are broken
    assert not [words for words in (*GROUPS, *VERBS.values(), *COMMON[:1]) if "".join(catalogue("de")[words].split()) not in shown]
    assert CliRunner().invoke(cli, ["comission"]).stderr.startswith("beltcomm: einen Befehl 'comission' gibt es nicht; gemeint commission?")
