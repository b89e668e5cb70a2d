"""Verbs that need no API: init, drives, effects; and the talk on stderr."""

from __future__ import annotations

import io
import json
import math
import re
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from beltcomm import drive
from beltcomm.axis import load_axis
from beltcomm.axis.entries import COMMISSION_NEEDS
from beltcomm.cli.frame import Invocation
from beltcomm.cli.main import VERBS, cli
from beltcomm.cli.questions import otherwise
from beltcomm.cli.talk import PlainTalk, RichTalk
from beltcomm.effects import EFFECTS
from beltcomm.errors import DataError, UsageError
from beltcomm.experiments.referencing import suitable


def call(*words: str, answer: str | None = None) -> Result:
    return CliRunner().invoke(cli, list(words), input=answer)


def test_init_without_questions_understands_data_sheet_units(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    entries = [
        "name=mine", "motor.inertia_kg_m2=0.449 kg cm2", "pulley.effective_radius_m=12.42mm", "pulley.teeth=26",
        "belt.pitch_m=3 mm", "travel.min_m=0", "travel.max_m=570mm", "trajectories.T_A.jerk_m_s3=40",
        "trajectories.T_A.acceleration_m_s2=45", "trajectories.T_A.speed_m_s=5",
    ]  # fmt: skip
    outcome = call("init", str(path), *(word for entry in entries for word in ("--set", entry)), "--json")
    assert outcome.exit_code == 0, outcome.stderr
    axis = load_axis(path)
    assert axis.motor.inertia_kg_m2 == pytest.approx(44.9e-6)
    assert axis.transmission_m_rad == pytest.approx(0.01242)
    assert (axis.travel.max_m, axis.get("pulley.teeth"), axis.trajectory("T_A").jerk_m_s3) == (0.57, 26, 40.0)
    assert set(json.loads(outcome.stdout)["missing"]) == {
        "belt.specific_stiffness_n", "belt.pulley_distance_m", "limits.speed_m_s", "limits.feed_force_n",
    }  # fmt: skip


def test_init_by_questions_asks_again_after_a_wrong_answer(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    # kind (asked again), motor of the catalogue, name (asked again), motor: type, inertia (needed, wrong unit, impossible, right) ...
    known = ["EMMS", "", "3 mm", "-1", "0.449 kg cm2", "0.65"]
    answers = ["nope", "other", "", "", "spindle", *known, *[""] * 6, "0", "600 mm", *[""] * 16]
    outcome = call("init", str(path), answer="\n".join(answers) + "\n")
    assert outcome.exit_code == 0, outcome.stderr
    axis = load_axis(path)
    assert (axis.name, axis.has_transmission, axis.motor.name, axis.travel.max_m) == ("spindle", False, "EMMS", 0.6)
    assert axis.motor.inertia_kg_m2 == pytest.approx(44.9e-6)
    assert "motor.inertia_kg_m2 is needed for" in outcome.stderr
    assert "'nope': belt, screw, rack, rotary, linear, other" in outcome.stderr
    assert "'mm' is not a unit of it" in outcome.stderr
    assert "motor.inertia_kg_m2 is -1 kg m²; it must be above 0" in outcome.stderr
    assert outcome.stdout.startswith(f"{path} is written: spindle.")


def test_init_takes_what_data_sheets_write_and_goes_back(tmp_path: Path) -> None:
    """Bits, rpm, teeth times pitch, no brake and so no question for its time; a mistake is put right by going back."""
    path = tmp_path / "axis.yaml"
    motor = ["", "0.449 kg cm2", "", "", "", "20 bit", "none", "300 rpm", "back", "3000 rpm", "back", "", ""]
    answers = ["", "", "", "belt axis", *motor, "", "", "", "", "24 x 5 mm", *[""] * 30]
    outcome = call("init", str(path), answer="\n".join(answers) + "\n")
    assert outcome.exit_code == 0, outcome.stderr
    axis = load_axis(path)
    assert (axis.motor.encoder_counts_per_rev, axis.motor.brake_torque_nm) == (2**20, None)
    assert axis.motor.max_speed_rad_s == pytest.approx(100.0 * math.pi)
    assert axis.pulley.effective_radius_m == pytest.approx(0.12 / math.tau)
    assert "(Enter keeps 3000 rpm)" in outcome.stderr, "what was answered is kept by going back and Enter"
    assert "in which the holding brake" not in outcome.stderr
    assert f"    beltcomm init {path} --from {path}\n" in outcome.stdout
    assert otherwise("effective_radius_m", "120 mm/rev") == pytest.approx(0.12 / math.tau)
    other = tmp_path / "other.yaml"
    assert call("init", str(other), "--set", "pulley.effective_radius_m=22 x 8 mm").exit_code == 0
    assert (load_axis(other).get("pulley.teeth"), load_axis(other).pulley.effective_radius_m) == (22, pytest.approx(0.176 / math.tau))


def test_init_broken_off_keeps_its_answers_and_holds_each_against_those_before(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    unfinished = tmp_path / "axis.yaml.unfinished"
    motor = ["", "0.449 kg cm2", "", "5", "3", "7", "20 bit", "none", "", ""]  # a peak below the rated torque is asked again
    outcome = call("init", str(path), answer="\n".join(["", "", "", "belt axis", *motor, "", "", "", "", "22 x 8 mm", ""]) + "\n")
    assert outcome.exit_code == 2, "stdin is closed"
    assert "must not exceed motor.peak_torque_nm, 3 N m; give another value, or .back. to change" in outcome.stderr.replace("'", ".")
    assert "kept in" in outcome.stderr
    assert not path.exists()
    assert unfinished.is_file()
    outcome = call("init", str(path), answer="\n".join(["", *[""] * 45]) + "\n")
    assert outcome.exit_code == 0, outcome.stderr
    axis = load_axis(path)
    assert (axis.name, axis.motor.peak_torque_nm, axis.get("pulley.teeth"), axis.get("belt.pitch_m")) == ("belt axis", 7.0, 22, 0.008)
    assert not unfinished.exists()


def test_init_begins_with_a_shipped_axis(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    assert call("init", str(path), "--from", "egc-70-600", "--set", "payload.mass_kg=11.2").exit_code == 0
    axis, rig = load_axis(path), load_axis("egc-70-600")
    assert axis.changes(rig) == ["payload.mass_kg 11.2 -> not known"]


def test_an_empty_axis_still_needs_all_that_commissioning_requires(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    outcome = call("init", str(path), "--set", "name=new")
    with pytest.raises(UsageError) as refused:
        suitable(load_axis(path))
    for entry in COMMISSION_NEEDS:
        assert re.search(rf"Still needed: .*{re.escape(entry)}", outcome.stdout)
        assert entry in str(refused.value)
    assert "Next: beltcomm commission" not in outcome.stdout
    assert "Still needed: motor.inertia_kg_m2" in outcome.stdout
    assert f"    beltcomm init {path} --from {path}\n" in outcome.stdout


def test_init_does_not_overwrite_without_a_yes(tmp_path: Path) -> None:
    path = tmp_path / "axis.yaml"
    path.write_text("name: old\n", encoding="utf-8")
    for answer, code in (("n\n", 1), ("", 2)):
        outcome = call("init", str(path), "--set", "name=new", answer=answer)
        assert outcome.exit_code == code
        assert path.read_text(encoding="utf-8") == "name: old\n"
    assert call("init", str(path), "--set", "name=new", answer="y\n").exit_code == 0
    assert load_axis(path).name == "new"


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["--set", "motor.inertia_kgm2=1"], "did you mean inertia_kg_m2?"),
        (["--set", "motor.inertia_kg_m2"], "write it as KEY=VALUE"),
        (["--set", "motor.inertia_kg_m2=1,450"], "decimal point"),
        (["--set", "motor.inertia_kg_m2=-1"], "motor.inertia_kg_m2 is -1 kg m²; it must be above 0"),
        (["--set", "name=a", "--set", "name.x=1"], "name is a value, not a section"),
        (["--from", "egc"], "known are"),
        ([], "nobody answers"),
    ],
)
def test_init_writes_nothing_on_a_fault(tmp_path: Path, words: list[str], hint: str) -> None:
    path = tmp_path / "axis.yaml"
    outcome = call("init", str(path), *words, answer="")
    assert outcome.exit_code == 2, outcome.output
    assert hint in outcome.stderr
    assert list(tmp_path.iterdir()) == []


def test_drives_shows_a_broken_adapter_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    good = drive.Adapter("good", "a drive", ("good",), lambda address, options: None)  # type: ignore[arg-type, return-value]
    found = [drive.FoundAdapter("pkg:GOOD", good), drive.FoundAdapter("pkg:BAD", None, "ImportError: no module named x")]
    monkeypatch.setattr(drive, "find_adapters", lambda: found)
    outcome = call("drives")
    assert outcome.exit_code == 0
    assert re.search(r"^pkg:BAD +is broken: ImportError: no module named x$", outcome.stdout, re.M)
    listed = json.loads(call("drives", "--json").stdout)["drives"]
    assert [(item["name"], item["works"]) for item in listed] == [("good", True), (None, False)]


def test_drives_says_what_to_do_without_adapters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive, "find_adapters", list)
    assert "pip install" in call("drives").stdout


def test_effects_lists_the_catalogue_and_explains_one() -> None:
    listed = json.loads(call("effects", "--json").stdout)["effects"]
    assert [item["name"] for item in listed] == [effect.name for effect in EFFECTS]
    text = call("effects", "belt_damping").stdout
    assert "What to check:" in text
    assert call("effects", "belt_dampng").exit_code == 2


def test_plain_talk_reports_each_quarter_once() -> None:
    stream = io.StringIO()
    talk = PlainTalk(stream)
    talk.phase(2, 5, "friction")
    for percent in range(0, 101, 5):
        talk.progress(percent / 100, 20.0 * (1 - percent / 100))
    assert stream.getvalue().splitlines() == [
        "[2/5] friction",
        "      25 %, 15 s left",
        "      50 %, 10 s left",
        "      75 %, 5 s left",
        "      100 %",
    ]


def test_plain_talk_tells_the_seconds_of_a_calculation_from_its_pace() -> None:
    """A fit knows its share, not its seconds: 4 s for the first quarter leave about 12 s; within the first second nothing is told."""
    now, stream = [100.0], io.StringIO()
    talk = PlainTalk(stream, lambda: now[0])
    talk.phase(1, 1, "fit")
    for seconds, fraction in ((0.5, 0.25), (4.0, 0.5), (20.0, 0.8), (21.0, 1.0)):
        now[0] = 100.0 + seconds
        talk.progress(fraction, None)
    assert stream.getvalue().splitlines()[1:] == ["      25 %", "      50 %, about 4 s left", "      80 %, about 5 s left", "      100 %"]


def test_what_init_does_not_miss_commissioning_does_not_miss_either(tmp_path: Path) -> None:
    """Every entry that commissioning asks for is asked for by init: with one of them gone, both say so by name."""
    rig = load_axis("egc-70-600")
    for entry in COMMISSION_NEEDS:
        path = tmp_path / f"{entry}.yaml"
        outcome = call("init", str(path), "--from", "egc-70-600", "--set", f"{entry}=null", "--json")
        assert set(json.loads(outcome.stdout)["missing"]) == {entry}
        with pytest.raises(UsageError, match=re.escape(entry)):
            suitable(load_axis(path))
    suitable(rig)


@pytest.mark.parametrize(("answer", "agreed"), [("y\n", True), ("YES\n", True), ("\n", False), ("no\n", False)])
def test_only_a_yes_is_a_yes(monkeypatch: pytest.MonkeyPatch, answer: str, agreed: bool) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(answer))
    stream = io.StringIO()
    assert PlainTalk(stream).confirm("Move?") is agreed
    assert stream.getvalue() == "Move? [y/N] "


def test_nobody_to_ask_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    with pytest.raises(UsageError, match="use --yes"):
        PlainTalk(io.StringIO()).confirm("Move?")


def test_a_failure_in_a_phase_gives_the_terminal_back(capfd: pytest.CaptureFixture[str]) -> None:
    frame = Invocation([])
    talk = RichTalk(sys.stderr)
    frame._talk = talk

    def fail() -> None:
        talk.phase(1, 2, "friction")
        talk.progress(0.5, 3.0)
        raise DataError("the record is clipped")

    assert frame.guarded(fail) == 3
    assert talk._live is None
    assert capfd.readouterr().err.endswith("beltcomm: the record is clipped\n")


@pytest.mark.parametrize("verb", VERBS)
def test_every_help_shows_an_example_whose_options_it_has(verb: str) -> None:
    shown = call(verb, "--help-all").stdout
    found = re.search(rf"Example: beltcomm {verb}\b(.*?)\n\s*\n", shown, re.DOTALL)
    assert found
    assert [
        option for option in re.findall(r"--[a-z-]+", found[1]) if not re.search(rf"^\s+(?:-\w, )?{option}\b", shown, re.MULTILINE)
    ] == []
