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
from beltcomm.axis.entries import COMMISSION_NEEDS, SECTIONS, entries_of
from beltcomm.axis.kinds import KINDS
from beltcomm.cli.help import About, paragraphs
from beltcomm.cli.interview import label
from beltcomm.cli.main import COMMON, GROUPS, VERBS, cli
from beltcomm.drive import open_drive
from beltcomm.effects import EFFECTS
from beltcomm.experiments.plan import commission_plan
from beltcomm.experiments.plan_screen import plan_screen
from beltcomm.laboratory.figures import PlainError
from beltcomm.language import catalogue
from beltcomm.sentences.cross_checks import _CHECKS
from beltcomm.sentences.laboratory import STATES, error_words
from doctor.setups import SETUPS, called

SOURCE = Path(beltcomm.__file__).parent
PLACES = re.compile(r"\{[^}]*\}")
#: Texts that are the same in every language, or no text.
SAME = {"", "how", " (", r" -?[\d.]"}
#: Words that no German sentence has; "in", "an", "also", "die" and "war" it has.
ENGLISH = set(
    re.findall(
        r"\w+",
        """the of is are and not with no its it this that be has have for from by than or to when where at on if both there does only look
        torque speed force belt carriage position units setpoints encoder gear voltage current rated peak largest lowest highest inertia
        ratio offset travel teeth pitch preload radius stiffness distance error acceleration tilt mass either keep leave""",
    )
)


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
    texts = {found[key] for one in shown for found in one["findings"] for key in ("area", "text", "remedy")}
    texts |= {one["next"] for one in shown if not one["next"].endswith("`")}
    known = {"", "axis.yaml"}
    assert sorted(text for text in texts - known if language.told(text) == text and not (text[0] == text[-1] == "`")) == []
    assert {text: left for text in texts if (left := english_in(language.told(text)))} == {}, "a word inside stayed English"


def english_in(text: str) -> set[str]:
    """English words in a German sentence, without what is typed and the names that somebody gave."""
    plain = re.sub(r"`[^`]*`|'[^']*'|--[\w-]+|\w+\.[\w.]+|\w+-\w+|in travel|travel in|behält belt|/\S+|^  \w+  +|\w+:\w+", "", text)
    return {word for word in re.findall(r"[^\W\d_]+", plain) if word in ENGLISH}


def test_init_says_nothing_in_english(spoken: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrong answers, such as contradict others, doubtful ones, and the list that is changed by number."""
    monkeypatch.setenv("BELTCOMM_LANG", spoken)
    entries = [(section, name) for section, kind in SECTIONS.items() for name in entries_of(kind)]
    answers: dict[str, list[str]] = {
        "motor.inertia_kg_m2": ["0.449", "nein", "0,449 kg cm2"],
        "motor.rated_torque_nm": ["17 bit", "400", "1,43"],
        "motor.peak_torque_nm": ["1", "15"],
        "motor.max_speed_rad_s": ["3000 rpm"],
        "motor.brake_torque_nm": ["keine"],
        "pulley.effective_radius_m": ["12,42 mm"],
        "pulley.teeth": ["26"],
        "belt.pitch_m": ["5 mm", "3 mm"],
        "belt.pulley_distance_m": ["0,8"],
        "travel.min_m": ["-0.2"],
        "travel.max_m": ["-0,3", "0,9", "0,5"],
        "travel.driven_side_offset_m": ["", "0,25"],
        "limits.speed_m_s": ["5"],
        "limits.acceleration_m_s2": ["50"],
        "limits.feed_force_n": ["1500"],
        "limits.pulley_torque_nm": ["1,24"],
        "payload.mass_kg": ["5"],
        "targets.following_error_m": ["0,1 mm"],
        "targets.settled_error_m": ["1 mm"],
        "targets.distance_m": ["3", "0,5"],
    }
    lines = [
        "riemen",
        "keine",
        "keine",
        "Achse",
        "",
        *(
            line
            for key in entries
            for line in answers.get(".".join(key), ["", ""][: 1 + (".".join(key) in COMMISSION_NEEDS)])
            if key[1] != "brake_time_s"
        ),
    ]
    at = next(k for k, line in enumerate(lines) if line == "0,1 mm")
    first = CliRunner().invoke(cli, ["init", str(tmp_path / "a.yaml")], input="\n".join([*lines[:at], "beide", *lines[at:]]) + "\n")
    assert first.exit_code == 0, first.stderr
    changed = CliRunner().invoke(cli, ["init", str(tmp_path / "b.yaml"), "--from", "egc-70-600"], input="fertig\n2\n0,5 kg cm2\n99\n\n")
    assert changed.exit_code == 0, changed.stderr
    said = [line for one in (first, changed) for line in re.split(r"\n|: {4}", one.stderr + one.stdout)]
    assert {line: left for line in said if (left := english_in(line))} == {}
    for word in ("Nennmoment", "Antriebsscheibe hinaus", "Hinweis: limits.feed_force_n ist 1500 N", "vielleicht vertauscht", "Fache"):
        assert word in first.stderr + changed.stderr


@pytest.mark.parametrize("kind", ["belt", *KINDS])
def test_every_key_of_the_axis_has_its_word(spoken: str, kind: str) -> None:
    sections = KINDS[kind].sections() if kind in KINDS else {name: entries_of(one) for name, one in SECTIONS.items()}
    known = set(language.catalogue(spoken).values())
    assert [f"{section}.{name}" for section, entries in sections.items() for name in entries if label(section, name) not in known] == []


def test_every_finding_of_the_catalogue_keeps_what_fills_it(spoken: str) -> None:
    for pattern, told in language.findings(spoken):
        assert set(re.findall(r"\{(\w+)\}", told)) == set(pattern.groupindex)


def test_the_catalogue_of_effects_is_translated(spoken: str) -> None:
    """What a screen says of an effect that was found."""
    shown = {text for effect in EFFECTS for text in (effect.title, effect.seen, effect.causes, effect.check, effect.remedy) if text}
    shown |= {parameter.meaning for effect in EFFECTS for parameter in effect.parameters}
    assert sorted(text for text in shown if language.told(text) == text) == []


@pytest.mark.parametrize(
    "line",
    [
        "N m and % up to 240 Hz; x noise at all frequencies, by its own noise: no quotient.",
        "  The model explains these records: what differs between them is in it.",
        *(f"  {line}" for line in _CHECKS["belt.specific_stiffness_n"]),
    ],
)
def test_details_of_a_comparison_are_translated(spoken: str, line: str) -> None:
    assert language.line_told(line) != line


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
