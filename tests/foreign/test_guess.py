"""Columns guessed from names and units, how sure that is, and the questions where it is not."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.axis import Axis, load_axis
from beltcomm.cli import import_
from beltcomm.cli.main import cli
from beltcomm.errors import DataError
from beltcomm.foreign.guess import Guess, NeedsAnswers, completed
from beltcomm.foreign.names import meaning_of
from beltcomm.foreign.table import Table
from beltcomm.runfolder import RunFolder
from foreign.samples import swing, text, write

AXIS = load_axis("egc-70-600")
T, CURRENT, ENCODER = swing(400)


def table(*names: str, **columns: Any) -> Table:
    values = {"t": T, "i": CURRENT, "x": ENCODER}
    return Table("log.csv", {name: values[key] for name, key in zip(names, "tix", strict=False)} | columns)


@pytest.mark.parametrize(
    ("name", "unit", "quantity", "role", "suffix"),
    [
        ("Drehmoment", "Nm", "torque", "none", "nm"),
        ("Istdrehmoment [Nm]", "", "torque", "actual", "nm"),
        ("act_trq", "", "torque", "actual", ""),
        ("ActTorque", "N·m", "torque", "actual", "nm"),
        ("M_ist (Nm)", "", "torque", "actual", "nm"),
        ("trq_cmd", "Nm", "torque", "setpoint", "nm"),
        ("Torque actual value [0.1%]", "", "torque", "actual", ""),
        ("vel_fbk", "rpm", "velocity", "actual", "rad_s"),
        ("Drehzahl Istwert [U/min]", "", "velocity", "actual", "rad_s"),
        ("Position feedback [mm]", "", "position", "actual", "m"),
        ("Istposition", "°", "position", "actual", "rad"),
        ("Sollposition", "°", "position", "setpoint", "rad"),
        ("Lage (mm)", "", "position", "none", "m"),
        ("PositionActualValue", "", "position", "actual", ""),
        ("i_q", "", "current", "none", ""),
        ("theta_m", "", "position", "none", ""),
        ("pos_m", "", "position", "none", "m"),
        ("field.effort0", "", "torque", "none", ""),
        ("PL.FB (Counts16Bit)", "", "position", "actual", ""),
        ("Iq_A", "", "current", "none", "a"),
        ("Strom", "A", "current", "none", "a"),
        ("Kraft [N]", "", "force", "none", "n"),
        ("time_ms", "", "time", "none", "s"),
        ("t in ms", "", "time", "none", "s"),
        ("Torque in N m", "", "torque", "none", "nm"),
        ("Istdrehzahl in 1/min", "", "velocity", "actual", "rad_s"),
        ("Par real", "Nm", "torque", "actual", "nm"),
        ("Posición real", "mrad", "position", "actual", "rad"),
        ("Ángulo in U", "", "position", "none", "rad"),
        ("Zeit", "s", "time", "none", "s"),
        ("Motortemperatur", "°C", "temperature", "none", "c"),
        ("Temps (s)", "", "time", "none", "s"),
        ("Couple (N.m)", "", "torque", "none", "nm"),
        ("Coppia", "Nm", "torque", "none", "nm"),
        ("Par motor [Nm]", "", "torque", "none", "nm"),
        ("Posición [°]", "", "position", "none", "rad"),
        ("Consigne de couple", "Nm", "torque", "setpoint", "nm"),
        ("6077h", "", "torque", "actual", ""),
        ("0x6064", "", "position", "actual", ""),
    ],
)
def test_names_and_units(name: str, unit: str, quantity: str, role: str, suffix: str) -> None:
    meaning = meaning_of(Table("a", {name: T}, {name: unit} if unit else {}), name)
    assert meaning is not None
    assert (meaning.quantity, meaning.role, meaning.suffix) == (quantity, role, suffix)


@pytest.mark.parametrize(
    "name", ["Schleppabstand [mm]", "TorqueLimit [Nm]", "Status", "velocity error", "Kp", "packet index", "U_dc [V]", "acceleration [m/s2]"]
)
def test_names_that_are_something_else(name: str) -> None:
    assert meaning_of(Table("a", {name: T}), name) is None


def test_what_is_sure_is_taken_and_said() -> None:
    found, notes = completed(
        table("Zeit [ms]", "Drehmoment [Nm]", "Istposition [°]", **{"Sollposition [°]": ENCODER}), (), AXIS, timed=True
    )
    assert found == (
        't_s="Zeit [ms]"*ms',
        'torque_nm="Drehmoment [Nm]"*nm',
        'position_rad="Istposition [°]"*deg',
        'reference_position_rad="Sollposition [°]"*deg',
    )
    assert notes[1] == 'guessed torque_nm="Drehmoment [Nm]"*nm: its name, and its unit nm by the file'


def test_a_complete_mapping_is_left_alone() -> None:
    written = ("t_s=time", "current_a=Iq", "position_rad=enc*rev/65536")
    assert completed(table("time", "Iq", "enc"), written, AXIS, timed=True) == (written, ())


@pytest.mark.parametrize(
    ("names", "column", "confidence", "words"),
    [
        (("t", "torque", "pos [°]"), "torque_nm", "unsure", "its unit is not stated; its largest value is"),
        (("t", "torque [%]", "pos [°]"), "torque_nm", "likely", "per cent of a rated torque, that of the axis file"),
        (("t", "I_act [%]", "pos [°]"), "torque_nm", "likely", "per cent of a rated current, taken as the same share of the rated torque"),
        (("t", "torque [Nm]", "pos"), "position_rad", "unsure", "in whole numbers"),
        (("t", "torque [Nm]", "pos [inc]"), "position_rad", "likely", "in counts, 65536 per revolution by the axis file"),
        (("t", "torque [Nm]", "pos [mm]"), "position_rad", "likely", "the motor's angle is that over the 0.01242 m/rad"),
        (("t", "nothing", "pos [°]"), "torque_nm", "unsure", "looks like what drives column 3"),
    ],
)
def test_what_is_not_sure_is_asked(names: tuple[str, ...], column: str, confidence: str, words: str) -> None:
    asked: list[Guess] = []

    def ask(guesses: Sequence[Guess]) -> list[str]:
        asked.extend(guesses)
        return [guess.choices[0] for guess in guesses if guess.choices]

    with pytest.raises(NeedsAnswers, match="not sure which column is which"):
        completed(table(*names), (), AXIS, timed=True)
    completed(table(*names), (), AXIS, timed=True, ask=ask)
    guess = next((guess for guess in asked if guess.column == column), None)
    assert guess is not None
    assert guess.confidence == confidence
    assert words in guess.why


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"t": T[::-1].copy()}, "log.csv: t falls from row to row, the last row was recorded first; turn the order of the rows"),
        ({"pos": np.array(["0x001F3A"] * len(T), dtype=object)}, "position_rad: pos holds no numbers but '0x001F3A': export it as numbers"),
    ],
)
def test_a_column_that_has_the_name_alone_is_told(changed: dict[str, Any], words: str) -> None:
    with pytest.raises((NeedsAnswers, DataError), match=words):
        completed(table(**({"t": T, "torque [Nm]": CURRENT, "pos": ENCODER} | changed)), (), AXIS, timed=True)


def test_two_torques_are_not_sure() -> None:
    asked: list[Guess] = []
    two = table("t", "Torque A1 [Nm]", "pos [°]", **{"Torque A2 [Nm]": CURRENT})

    def ask(guesses: Sequence[Guess]) -> list[str]:
        asked.extend(guess for guess in guesses if guess.confidence != "sure")
        return [guess.choices[-1] for guess in guesses]

    completed(two, (), AXIS, timed=True, ask=ask)
    assert [guess.column for guess in asked] == ["torque_nm"]
    assert "'Torque A1 [Nm]' (c2), 'Torque A2 [Nm]' (c4) could be meant" in asked[0].why


def test_time_without_a_unit_is_told_by_its_steps() -> None:
    plain = Axis(name="a")
    sure, _ = completed(table("t", "M [Nm]", "phi [rad]"), (), plain, timed=True)
    assert sure[0] == "t_s=t*s"
    with pytest.raises(NeedsAnswers, match=r"t_s: its name; it rises by 1 per row.*t_s=t\*ms"):
        completed(Table("a", {"t": 1e3 * T, "M [Nm]": CURRENT, "phi [rad]": ENCODER}), (), plain, timed=True)


def test_a_file_of_mappings_is_written_edited_and_given_back(tmp_path: Path) -> None:
    log, run = write(tmp_path / "log.csv", text("Zeit [s],Drehmoment,enc [inc]")), tmp_path / "run"
    words = ["import", str(log), "--run", str(run), "--axis", "egc-70-600"]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 1, outcome.output
    made = tmp_path / "run.map"
    assert f"Edit {made}, which holds what was found, and import again with --map {made}" in outcome.stderr
    assert not run.exists()
    content = made.read_text(encoding="utf-8")
    assert 't_s="Zeit [s]"*s\n' in content
    assert '# position_rad="enc [inc]"*rev/65536\n' in content
    edited = content.replace("# torque_nm=Drehmoment*1\n", "torque_nm=Drehmoment*0.65\n")
    edited = edited.replace('# position_rad="enc', 'position_rad="enc')
    made.write_text(edited, encoding="utf-8")
    outcome = CliRunner().invoke(cli, [*words, "--map", str(made)])
    assert outcome.exit_code == 0, outcome.output
    np.testing.assert_allclose(RunFolder.open(run).recording("log").torque, 0.65 * swing()[1], rtol=1e-12)
    assert "1 of 1 imports" in CliRunner().invoke(cli, ["import", "--check", "--run", str(run)]).stdout
    assert "is no mapping and no file of mappings" in CliRunner().invoke(cli, [*words, "--map", "nothing"]).stderr


def test_a_file_that_was_edited_is_not_overwritten(tmp_path: Path) -> None:
    log = write(tmp_path / "log.csv", text("Zeit [s],Drehmoment,enc"))
    (tmp_path / "run.map").write_text("torque_nm=mine\n", encoding="utf-8")
    outcome = CliRunner().invoke(cli, ["import", str(log), "--run", str(tmp_path / "run")])
    assert f"--map {tmp_path / 'run-2.map'}" in outcome.stderr
    assert (tmp_path / "run.map").read_text(encoding="utf-8") == "torque_nm=mine\n"


def test_at_a_terminal_the_whole_mapping_is_asked_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log, run = write(tmp_path / "log.csv", text("Zeit [s],Drehmoment,enc")), tmp_path / "run"
    monkeypatch.setattr(import_, "_can_be_asked", lambda: True)
    words = ["import", str(log), "--run", str(run), "--axis", "egc-70-600"]
    outcome = CliRunner().invoke(cli, words, input="torque_nm=Drehmoment*0.65\n\n")
    assert outcome.exit_code == 0, outcome.output
    assert "unsure; its unit is not stated; its largest value is" in outcome.stderr
    assert "position_rad=enc*rev/65536" in outcome.stderr
    assert "    1  or torque_nm=Drehmoment*" in outcome.stderr
    np.testing.assert_allclose(RunFolder.open(run).recording("log").torque, 0.65 * swing()[1], rtol=1e-12)
    assert CliRunner().invoke(cli, words, input="99\n").exit_code == 2


def test_numbers_tell_columns_without_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    time, current, encoder = swing()
    speed = np.gradient(2.0 * np.pi / 65536 * encoder, 1e-3)
    angle = 2.0 * np.pi / 65536 * encoder
    rows = zip(time * 1e3, np.full(len(time), 24.0), angle, 0.65 * current, 1e-3 * speed, strict=True)
    log = write(tmp_path / "log.txt", "\n".join(" ".join(f"{value:.7g}" for value in row) for row in rows) + "\n")
    monkeypatch.setattr(import_, "_can_be_asked", lambda: True)
    outcome = CliRunner().invoke(cli, ["import", str(log), "--run", str(tmp_path / "run")], input="\n")
    assert outcome.exit_code == 0, outcome.output
    assert "position_rad=c3" in outcome.stderr
    assert "column 5 looks like its derivative" in outcome.stderr
    assert "column 4 looks like what drives column 3" in outcome.stderr
    found = RunFolder.open(tmp_path / "run").recording("log")
    np.testing.assert_allclose(found.torque, 0.65 * current, atol=1e-6)
    np.testing.assert_allclose(np.diff(found.t_s), 1e-3, atol=1e-7)


def test_the_api_raises_with_the_file_of_mappings(tmp_path: Path) -> None:
    log = write(tmp_path / "log.csv", text("Zeit [s],Drehmoment,enc"))
    with pytest.raises(NeedsAnswers) as error:
        api.import_recordings([log], tmp_path / "run", api.Reading())
    assert "# torque_nm: unsure" in error.value.template
    assert not (tmp_path / "run").exists()
