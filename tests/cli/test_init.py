"""``beltcomm init``: what an answer means, numbers as data sheets have them, the catalogue, a file for people, schemas for editors."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from beltcomm.axis import Axis, axis_from_dict, load_axis
from beltcomm.axis.answers import USUAL, in_words, parts, usual, with_part
from beltcomm.axis.doubtful import doubts
from beltcomm.axis.entries import COMMISSION_NEEDS, SECTIONS, entries_of, meaning_of
from beltcomm.axis.kinds import KINDS
from beltcomm.axis.written import TITLES, commented
from beltcomm.cli.main import cli
from beltcomm.configfiles import config_names, find_config, read_yaml, to_yaml, write_text
from beltcomm.errors import UsageError
from beltcomm.language import catalogue
from beltcomm.quantities import parse_quantity
from beltcomm.schedule.steps import KEYS


def call(*words: str, answer: str = "") -> Result:
    return CliRunner().invoke(cli, list(words), input=answer)


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("0,449 kg cm2", "inertia_kg_m2", 44.9e-6),
        ("12,5", "travel_m", 12.5),
        ("1,25 mm", "travel_m", 1.25e-3),
        ("0,125", "travel_m", 0.125),
    ],
)
def test_a_decimal_comma_is_read(text: str, name: str, value: float) -> None:
    assert parse_quantity(text, name) == pytest.approx(value)


@pytest.mark.parametrize("text", ["1,250", "1,250,000", "1,2,3", "1,250.5", "12,500 mm"])
def test_what_may_be_thousands_is_asked_for(text: str) -> None:
    with pytest.raises(UsageError, match=r"decimal point|give a number"):
        parse_quantity(text, "travel_m")


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("max_speed_rad_s", 6702.06, "64 000 rpm"),
        ("inertia_kg_m2", 44.9e-6, "0.449 kg cm²"),
        ("effective_radius_m", 0.012414, "12.41 mm (78 mm/rev)"),
        ("encoder_counts_per_rev", 65536, "65536 (16 bit)"),
        ("encoder_counts_per_rev", 10000, "10000"),
        ("specific_stiffness_n", 106250.0, "106.2 kN"),
        ("settled_error_m", 1e-4, "0.1 mm"),
    ],
)
def test_an_answer_is_said_in_the_units_people_think_in(name: str, value: float, words: str) -> None:
    assert in_words(name, value) == words


def test_usual_ranges_are_of_entries_and_hold_the_shipped_axes() -> None:
    assert all(meaning_of(entry) for entry in USUAL)
    for name in config_names("axes"):
        axis = load_axis(name)
        flat = {f"{section}.{key}": one for section, held in axis.to_dict().items() if isinstance(held, dict) for key, one in held.items()}
        assert [entry for entry, one in flat.items() if isinstance(one, float) and not usual(entry, one, axis.kind)] == []


def test_an_unusual_answer_is_asked_for_again(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    # kind, catalogue of motors, name; motor: type, inertia in the wrong unit (no), again right, and nothing more
    answers = ["other", "", "mine", "", "0,449", "0,449 kg cm2", *[""] * 40]
    outcome = call("init", str(path), answer="\n".join(answers) + "\n")
    assert outcome.exit_code == 0, outcome.stderr
    assert "= 4 490 kg cm²: really?" in outcome.stderr.replace("4490", "4 490")
    assert "= 0.449 kg cm²" in outcome.stderr
    assert load_axis(path).motor.inertia_kg_m2 == pytest.approx(44.9e-6)
    assert "[2/" in outcome.stderr


@pytest.mark.parametrize("name", sorted(parts("axes")))
def test_every_axis_of_the_catalogue_is_one_with_its_source(name: str) -> None:
    assert parts("axes")[name]["source"]
    data = with_part(with_part({}, "axes", name), "motors", next(iter(parts("motors"))))
    assert call("init", "--schema", "axis").exit_code == 0
    assert set(data) <= {"name", *SECTIONS}
    for section, values in data.items():
        if section != "name":
            assert set(values) <= {"name", *entries_of(SECTIONS[section])}


@pytest.mark.parametrize("name", sorted(parts("motors")))
def test_every_motor_of_the_catalogue_can_be(name: str, tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    assert call("init", str(path), "--from", "parker-osp-e25bhd", "--motor", name, "--yes").exit_code == 0
    axis = load_axis(path)
    assert axis.motor.rated_torque_nm is not None
    assert axis.transmission_m_rad == pytest.approx(0.18 / 6.283185307, rel=1e-6)
    odd = [entry for entry in USUAL if axis.get(entry) is not None and not usual(entry, axis.get(entry))]
    assert odd == []


def test_a_wrong_name_of_the_catalogue_is_answered_with_the_nearest(tmp_path: Path) -> None:
    outcome = call("init", str(tmp_path / "a.yaml"), "--motor", "yaskawa-sgmah-1a", "--yes")
    assert outcome.exit_code == 2
    assert "did you mean yaskawa-sgmah-01a" in outcome.stderr


@pytest.mark.parametrize("name", [*config_names("axes"), ""])
def test_the_commented_file_says_every_entry_and_comes_back(name: str, tmp_path: Path) -> None:
    axis = load_axis(name) if name else Axis("spindle")
    path = tmp_path / "axis.yaml"
    path.write_text(commented(axis), encoding="utf-8")
    assert load_axis(path).to_dict() == axis.to_dict()
    text = path.read_text(encoding="utf-8")
    if axis.has_transmission:
        own = KINDS.get(axis.kind)
        sections = own.sections() if own is not None else {name: entries_of(kind) for name, kind in SECTIONS.items()}
        assert all(key in text for entries in sections.values() for key in entries)


def test_an_axis_of_another_kind_is_written_by_set_alone(tmp_path: Path) -> None:
    """It began as an empty belt axis, whose entries a screw does not know; and what was typed comes back to the digit."""
    path = tmp_path / "axis.yaml"
    stated = ["transmission.kind=screw", "transmission.lead_m=10mm", "motor.inertia_kg_m2=1.6kgcm2", "limits.feed_force_n=2500"]
    outcome = call("init", str(path), "--yes", *(word for entry in stated for word in ("--set", entry)))
    assert outcome.exit_code == 0
    assert load_axis(path).kind == "screw"
    assert "--home" in outcome.stdout
    text = path.read_text(encoding="utf-8")
    assert "lead_m: 0.01 " in text
    assert "carriage" not in text
    assert "belt may carry" not in text


def schema(file: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(call("init", "--schema", file).stdout)["properties"]
    return found


@pytest.mark.parametrize(("file", "folder"), [("axis", "axes"), ("profile", "drives")])
def test_the_schemas_know_what_is_shipped(file: str, folder: str) -> None:
    known = schema(file)
    for name in config_names(folder):
        assert set(read_yaml(find_config(folder, name))) <= set(known), name


def test_the_schema_of_a_plan_knows_its_steps() -> None:
    kinds = {one["properties"]["kind"]["const"]: set(one["properties"]) - {"kind"} for one in schema("plan")["steps"]["items"]["oneOf"]}
    assert kinds == {kind: set(keys) for kind, keys in KEYS.items()}


def test_done_leaves_out_all_that_commissioning_does_not_need(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    answers = ["belt", "", "", "mine", "", "0.5 kg cm2", "done", *["done"] * 20]
    outcome = call("init", str(path), answer="\n".join(answers) + "\n")
    assert outcome.exit_code == 0, outcome.output
    assert load_axis(path).motor.inertia_kg_m2 == pytest.approx(0.5e-4)
    questions = re.findall(r"\[(\d+)/\d+\]", outcome.output)
    assert questions[:3] == ["1", "2", "3"]
    assert len(questions) == 3 + len([entry for entry in COMMISSION_NEEDS if entry != "motor.inertia_kg_m2"])


@pytest.mark.parametrize("kind", ["belt", *KINDS])
@pytest.mark.parametrize("language", ["", "de"])
def test_the_questions_are_walked_to_the_last(kind: str, language: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every section has a title and every entry its words; the answers come back from the file."""
    monkeypatch.setenv("BELTCOMM_LANG", language)
    path = tmp_path / "axis.yaml"
    own = KINDS.get(kind)
    sections = own.sections() if own is not None else {name: entries_of(one) for name, one in SECTIONS.items()}
    outcome = call(
        "init", str(path), answer="\n".join([kind, *["none"] * ((kind == "belt") + (kind != "linear")), "axis 1", *["", ""] * 80])
    )
    assert outcome.exit_code == 0, outcome.stderr
    count = sum(len(entries) for entries in sections.values()) + 2
    assert f"[{count}/{count}]" in outcome.stderr
    if language:
        known = catalogue(language)
        words = {
            entry.meaning
            for section, entries in (own.sections() if own else {}).items()
            for name, entry in entries.items()
            if f"{section}.{name}" in own.renamed
        }
        assert sorted(words - set(known)) == []
        english = {*TITLES.values(), *(own.titles.values() if own else ())} & set(known)
        assert not any(f"\n{title}\n" in outcome.stderr for title in english if known[title] != title)
    assert load_axis(path).kind == kind


def test_an_interruption_keeps_what_the_catalogue_said(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    begun = call("init", str(path), answer="belt\nback\nbelt\nfesto-egc-70\ndone\nback\naxis 1\n\n0,449 kg cm2\n")
    assert begun.exit_code == 2
    assert "is kept in" in begun.stderr
    outcome = call("init", str(path), answer="\n" * 90)
    assert outcome.exit_code == 0, outcome.stderr
    axis = load_axis(path)
    assert (axis.name, axis.pulley.teeth, axis.motor.inertia_kg_m2) == ("axis 1", 26, pytest.approx(44.9e-6))


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    """A shipped axis without its preload, with a speed that no axis has."""
    data = load_axis("egc-70-600").to_dict()
    del data["belt"]["preload_n"]
    data["limits"]["speed_m_s"] = 50.0
    write_text(tmp_path / "sheet.yaml", to_yaml(data))
    return tmp_path / "sheet.yaml"


def test_of_a_file_only_what_is_missing_or_unusual_is_asked(sheet: Path, tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    outcome = call("init", str(path), "--from", str(sheet), answer="done\n5\n\n")
    assert outcome.exit_code == 0, outcome.output
    asked = re.findall(r"^\[\d+/\d+\] ([^:\[]*)", outcome.stderr, re.MULTILINE)
    assert all("inertia" not in question and "travel" not in question for question in asked)
    assert "[2] inertia 0.449 kg cm²" in outcome.stderr
    assert load_axis(path).limits.speed_m_s == 5.0, "asked for, done or not"


def test_an_unusual_value_of_a_file_is_asked_for_and_said_to_be_so(sheet: Path, tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    outcome = call("init", str(path), "--from", str(sheet), answer="\n" * 3 + "105\n" + "5\n" + "\n" * 20)
    assert outcome.exit_code == 0, outcome.output
    assert "usual are" in outcome.stderr
    assert load_axis(path).belt.preload_n == 105.0
    assert load_axis(path).limits.speed_m_s == 5.0
    known = load_axis(sheet).to_dict()
    assert load_axis(path).to_dict()["motor"] == known["motor"]


def test_a_number_changes_what_was_kept(sheet: Path, tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    outcome = call("init", str(path), "--from", str(sheet), answer="done\n\n2\n0.5 kg cm2\n99\n\n")
    assert outcome.exit_code == 0, outcome.output
    assert load_axis(path).motor.inertia_kg_m2 == pytest.approx(0.5e-4)
    assert "'99': 1 ... " in outcome.stderr


def test_everything_is_asked_where_that_is_wished(sheet: Path, tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    outcome = call("init", str(path), "--from", str(sheet), "--ask-all", answer="\n" * 60)
    assert outcome.exit_code == 0, outcome.output
    assert "[2/" in outcome.stderr
    assert load_axis(path).to_dict() == load_axis(sheet).to_dict()


def walked(path: Path, answers: dict[str, list[str]], *, last: str = "") -> Result:
    """Questions of a belt axis answered by key, the others by Enter; twice where commissioning needs one.   last : key before 'done'."""
    lines = ["belt", "", "", "axis 1", ""]
    for section, kind in SECTIONS.items():
        for name in entries_of(kind):
            key = f"{section}.{name}"
            if name != "brake_time_s":
                lines += answers.get(key, [""] * (1 + (key in COMMISSION_NEEDS)))
            if key == last:
                return call("init", str(path), answer="\n".join([*lines, *["done"] * 8, *answers.get("done", [])]) + "\n")
        lines += [""] * (section == "targets")
    return call("init", str(path), answer="\n".join(lines) + "\n")


def test_a_carriage_does_not_pass_the_driving_pulley(tmp_path: Path) -> None:
    """It was accepted; the belt before position 0 is asked after the travel, so it is told there."""
    path = tmp_path / "axis.yaml"
    travel = {"travel.min_m": ["-200 mm"], "travel.max_m": ["0.5"]}
    outcome = walked(
        path, {"pulley.effective_radius_m": ["12.4 mm"], **travel, "travel.driven_side_offset_m": ["", "none", "0.19", "0.25"]}
    )
    assert outcome.exit_code == 0, outcome.stderr
    assert len(re.findall("the carriage would pass the driving pulley by 0.2 m", outcome.stderr)) == 2
    assert "must be at least 0.2 m, or travel.min_m at least -0.19 m" in outcome.stderr
    axis = load_axis(path)
    assert (axis.travel.min_m, axis.travel.driven_side_offset_m) == (-0.2, 0.25)


def test_done_does_not_leave_a_contradiction_behind(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    outcome = walked(path, {"travel.min_m": ["-0.2"], "travel.max_m": ["0.5"], "done": ["0.3", *["done"] * 9]}, last="travel.max_m")
    assert outcome.exit_code == 0, outcome.stderr
    assert "would pass the driving pulley" in outcome.stderr
    assert load_axis(path).travel.driven_side_offset_m == 0.3


def test_a_file_whose_carriage_passes_the_pulley_is_refused_at_its_line(tmp_path: Path) -> None:
    data = load_axis("egc-70-600").to_dict()
    data["travel"]["min_m"] = -0.06
    write_text(tmp_path / "axis.yaml", to_yaml(data))
    with pytest.raises(
        UsageError, match=r"axis\.yaml, line \d+: travel\.min_m is -0\.06 m .* at least 0\.06 m, or travel\.min_m at least -0\.05"
    ):
        load_axis(tmp_path / "axis.yaml")


#: Two entries that contradict each other and can be -> what is told, and a value of the latter that goes with the former.
DOUBTFUL = {
    "speed": ({"motor.max_speed_rad_s": 314.0, "limits.speed_m_s": 5.0}, "no more than 3.9 m/s by motor.max_speed_rad_s", 3.9),
    "force": ({"limits.pulley_torque_nm": 3.0, "limits.feed_force_n": 260.0}, "no more than 250 N by motor.peak_torque_nm", 240.0),
    "torque": ({"limits.feed_force_n": 100.0, "limits.pulley_torque_nm": 5.0}, "makes it 403 N", 1.24),
    "overload": ({"motor.peak_torque_nm": 3.1, "motor.rated_torque_nm": 0.3}, "is 10.3 times motor.rated_torque_nm", 1.43),
    "targets": ({"targets.settled_error_m": 1e-3, "targets.following_error_m": 1e-4}, "they may be exchanged", 1e-2),
    "weight": ({"payload.mass_kg": 13.0, "mounting.tilt_deg": 90.0}, "the motor cannot hold it all the time", 0.0),
    "brake": ({"motor.brake_torque_nm": 0.1, "mounting.tilt_deg": -30.0, "payload.mass_kg": 3.0}, "the brake lets it fall", 1.0),
}


def doubtful(values: dict[str, float]) -> Axis:
    """A shipped axis with other values."""
    data = load_axis("egc-70-600").to_dict()
    for key, value in values.items():
        section, _, name = key.partition(".")
        data.setdefault(section, {})[name] = value
    return axis_from_dict(data)


@pytest.mark.parametrize("name", DOUBTFUL)
def test_what_contradicts_and_yet_can_be_is_told_at_the_end_with_both_values(name: str, tmp_path: Path) -> None:
    values, told, _ = DOUBTFUL[name]
    (sentence,) = doubts(doubtful(values))
    assert told in sentence
    words = [word for key, value in values.items() for word in ("--set", f"{key}={value}")]
    outcome = call("init", str(tmp_path / "a.yaml"), "--from", "egc-70-600", "--yes", *words)
    assert outcome.exit_code == 0, outcome.stderr
    assert f"Note: {sentence}" in outcome.stdout


@pytest.mark.parametrize("name", DOUBTFUL)
def test_two_that_go_together_leave_no_doubt(name: str) -> None:
    values, _, fitting = DOUBTFUL[name]
    values = {**values, list(values)[-1]: fitting}
    assert doubts(doubtful(values)) == []


@pytest.mark.parametrize("name", config_names("axes"))
def test_a_shipped_axis_leaves_no_doubt(name: str) -> None:
    assert doubts(load_axis(name)) == []


def test_a_doubt_is_told_once_at_its_answer_and_nothing_is_asked_otherwise(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    known = {"motor.max_speed_rad_s": ["3000 rpm"], "pulley.effective_radius_m": ["78 mm/rev"], "limits.speed_m_s": ["5"]}
    outcome = walked(path, known)
    assert outcome.exit_code == 0, outcome.stderr
    (at,) = [found.start() for found in re.finditer(r"Note: limits\.speed_m_s is 5 m/s", outcome.stderr)]
    assert outcome.stderr.rindex("[25/35]", 0, at) < at < outcome.stderr.index("[26/35]")
    asked = [int(number) for number in re.findall(r"\[(\d+)/35\]", outcome.stderr)]
    assert asked == sorted(asked)
    assert set(asked) == set(range(1, 36)) - {8}, "no time of a brake that is not there"


def test_a_file_of_before_whose_belt_before_position_0_nobody_stated_is_read(tmp_path: Path) -> None:
    """It stands as 0 in the axis.yaml of every run; rounding at the end of the belt is no contradiction either."""
    axis = axis_from_dict({"pulley": {"effective_radius_m": 0.0124}, "travel": {"min_m": -0.3, "max_m": 0.3}})
    assert any("would pass the driving pulley by 0.3 m" in sentence for sentence in doubts(axis))
    data = load_axis("egc-70-600").to_dict()
    data["travel"] |= {"min_m": -0.1 - 0.2, "max_m": 0.1, "driven_side_offset_m": 0.3}
    assert not any("pass" in sentence for sentence in doubts(axis_from_dict(data)))
