"""Two columns that could be the same signal: both are named and asked for, the first is never taken as sure."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.axis import Axis
from beltcomm.cli.main import cli
from beltcomm.foreign.guess import NeedsAnswers, completed
from beltcomm.foreign.table import Table
from beltcomm.runfolder import RunFolder
from foreign.samples import swing, write

CASE = Path(__file__).parents[2].parent / "shared" / "cases" / "twin-headers"
T, TORQUE, COUNTS = swing(400)
POSITION = COUNTS * 2.0 * np.pi / 65536
AXIS = Axis(name="bare")


def header(*names: str) -> str:
    """A file of two axes: time, torque, position, and those of the second axis in the order of the names."""
    values = [T, TORQUE, POSITION, 0.5 * TORQUE, 0.5 * POSITION]
    return "\n".join([",".join(names), *(",".join(f"{x:.7g}" for x in row) for row in zip(*values, strict=True))]) + "\n"


PAIRS = [
    ("Torque [Nm]", "Position [rad]", "Torque [Nm]", "Position [rad]"),
    ("Torque [Nm]", "Position [rad]", "Torque [%]", "Position [inc]"),
    ("Torque [Nm]", "Position [rad]", "Torque", "Position"),
    ("Torque [Nm]", "Position [rad]", "torque [nm]", "POSITION [rad]"),
    ("Torque [Nm]", "Position [rad]", "Torque 2 [Nm]", "Position 2 [rad]"),
    ("Torque_1 [Nm]", "Position_1 [rad]", "Torque_2 [mNm]", "Position_2 [deg]"),
    ("X.Torque [Nm]", "X.Position [rad]", "Y.Torque [Nm]", "Y.Position [rad]"),
    ("Axis1/Torque (Nm)", "Axis1/Position (rad)", "Axis2/Torque (Nm)", "Axis2/Position (rad)"),
    ("torque_nm", "position_rad", "torque_nm", "position_rad"),
    ("torque_nm", "position_rad", "Torque_NM", "Position_RAD"),
    ("torque_nm", "position_rad", "torque_nm_2", "position_rad_2"),
    ("torque_nm", "position_rad", "torque_nm.1", "position_rad.1"),
    ("torque_nm", "position_rad", "torque_nm_b", "position_rad_b"),
    ("torque_nm", "position_rad", "axis2_torque_nm", "axis2_position_rad"),
    ("torque_nm", "position_rad", "y.torque_nm", "y.position_rad"),
    ("torque_nm", "position_rad", "Torque [Nm]", "Position [rad]"),
    ("Torque [Nm]", "Position [rad]", "Torque no 2 [Nm]", "Position no. 2 [rad]"),
    ("Drehmoment Nr. 1 [Nm]", "Lage Nr. 1 [rad]", "Drehmoment Nr. 2 [Nm]", "Lage Nr. 2 [rad]"),
    ("Actual Torque [Nm]", "Actual Position [rad]", "Torque Y [Nm]", "Position Y [rad]"),
    ("Drehmoment [Nm]", "Istposition [rad]", "Moment [Nm]", "Lage [rad]"),
]


@pytest.mark.parametrize("names", PAIRS)
def test_both_are_named_and_nothing_is_written(names: tuple[str, ...], tmp_path: Path) -> None:
    path = write(tmp_path / "two.csv", header("t [s]", *names))
    outcome = CliRunner().invoke(cli, ["import", str(path), "--run", str(tmp_path / "run"), "--map", 't_s="t [s]"*1'])
    assert outcome.exit_code == 1, outcome.output
    assert not (tmp_path / "run").exists()
    for place in ("(c2)", "(c3)", "(c4)", "(c5)"):
        assert place in outcome.output


@pytest.mark.parametrize("names", PAIRS)
def test_the_second_axis_is_taken_by_its_place(names: tuple[str, ...], tmp_path: Path) -> None:
    path = write(tmp_path / "two.csv", header("t [s]", *names))
    maps = ["--map", "t_s=c1*1", "--map", "torque_nm=c4*1", "--map", "position_rad=c5*1"]
    outcome = CliRunner().invoke(cli, ["import", str(path), "--run", str(tmp_path / "run"), *maps])
    assert outcome.exit_code == 0, outcome.output
    (record,) = RunFolder.open(tmp_path / "run").recordings()
    np.testing.assert_allclose(record.torque, 0.5 * TORQUE, rtol=1e-6)


X = {"torque_nm": TORQUE.tolist(), "position_rad": POSITION.tolist()}
Y = {"torque_nm": (0.5 * TORQUE).tolist(), "position_rad": (0.5 * POSITION).tolist()}
NAMES = ["t_s", *X, *Y]
ROWS = [list(row) for row in zip(T.tolist(), *X.values(), *Y.values(), strict=True)]


def members(names: Sequence[str], values: Sequence[object]) -> str:
    """A JSON object in which names may repeat."""
    return "{" + ", ".join(f"{json.dumps(name)}: {json.dumps(value)}" for name, value in zip(names, values, strict=True)) + "}"


def signals() -> str:
    """Signals of one name, each with its values, as a list."""
    known = [("time", "s", T.tolist()), *((name, unit, side[key]) for side in (X, Y) for name, unit, key in SIGNALS)]
    return json.dumps([{"name": name, "unit": unit, "values": values} for name, unit, values in known])


SIGNALS = (("Torque", "Nm", "torque_nm"), ("Position", "rad", "position_rad"))
JSON = {
    "columns": members(NAMES, [T.tolist(), *X.values(), *Y.values()]),
    "records": "[" + ", ".join(members(NAMES, row) for row in ROWS) + "]",
    "lines": "\n".join(members(NAMES, row) for row in ROWS),
    "split, as pandas writes it": json.dumps({"columns": NAMES, "data": ROWS}),
    "rows below their names": json.dumps([NAMES, *ROWS]),
    "signals": signals(),
}


@pytest.mark.parametrize("kind", JSON)
def test_members_of_one_name_in_json_are_all_there(kind: str, tmp_path: Path) -> None:
    """JSON itself keeps the last of them, the second axis, and says nothing."""
    path = write(tmp_path / "two.json", JSON[kind])
    words = ["import", str(path), "--run", str(tmp_path / "run")]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 1, outcome.output
    assert all(place in outcome.output for place in ("(c2)", "(c3)", "(c4)", "(c5)"))
    outcome = CliRunner().invoke(cli, [*words, "--map", "torque_nm=c2*1", "--map", "position_rad=c3*1"])
    assert outcome.exit_code == 0, outcome.output
    (record,) = RunFolder.open(tmp_path / "run").recordings()
    np.testing.assert_allclose(record.torque, TORQUE, rtol=1e-6)


def test_our_own_columns_are_no_twins_of_each_other() -> None:
    """What a run has beside torque and position: setpoints, references, a second sensor."""
    beside = (
        "torque_setpoint_nm",
        "reference_position_rad",
        "velocity_rad_s",
        "load_position_rad",
        "torque_limit_nm",
        "position_error_rad",
    )
    columns = {"t_s": T, "torque_nm": TORQUE, "position_rad": POSITION} | dict.fromkeys(beside, POSITION)
    assert completed(Table("log.csv", columns), (), AXIS, timed=True) == ((), ())


@pytest.mark.parametrize("names", [("Speed [rad/s]", "Speed [rad/s]_2"), ("Speed",)])
def test_a_speed_that_is_not_sure_is_asked_for_and_is_no_position(names: tuple[str, ...]) -> None:
    columns = {"t [s]": T, "Torque [Nm]": TORQUE} | dict.fromkeys(names, POSITION)
    with pytest.raises(NeedsAnswers) as told:
        completed(Table("log.csv", columns), (), AXIS, timed=True)
    assert "velocity_rad_s" in str(told.value)
    assert "position_rad" not in told.value.template


@pytest.mark.parametrize("actual", ["Motorangle_deg", "motor angle [deg]", "Istwinkel [deg]"])
@pytest.mark.parametrize(
    "other", ["Positioncommand_deg", "targetposition [deg]", "Schleppfehler [deg]", "Loadposition_deg", "Lastwinkel [deg]"]
)
def test_compounds_say_what_was_asked_for_and_what_is_another_thing(actual: str, other: str) -> None:
    """A commanded position was taken for the actual one, whose name was a compound that said nothing."""
    columns = {"t [s]": T, "Torque / N m": TORQUE, "torquelimit / N m": TORQUE, actual: POSITION, other: 0.5 * POSITION}
    mapping, _ = completed(Table("log.csv", columns), (), AXIS, timed=True)
    found = {text.partition("=")[0]: text.partition("=")[2] for text in mapping}
    assert found["torque_nm"].startswith('"Torque / N m"')
    assert found["position_rad"].strip('"').startswith(actual)


def test_a_setpoint_or_another_quantity_is_no_twin() -> None:
    columns = {"t [s]": T, "Torque [Nm]": TORQUE, "Torque setpoint [Nm]": TORQUE, "Torque limit [Nm]": TORQUE, "Position [rad]": POSITION}
    mapping, _ = completed(Table("log.csv", columns), (), AXIS, timed=True)
    assert [text.partition("=")[0] for text in mapping] == ["t_s", "torque_nm", "position_rad", "torque_setpoint_nm"]


def test_a_twin_beside_is_left_and_a_needed_one_is_offered() -> None:
    columns = {"t [s]": T, "Torque [Nm]": TORQUE, "Position [rad]": POSITION, "Speed [rad/s]": TORQUE, "Speed [rpm]": TORQUE}
    mapping, _ = completed(Table("log.csv", columns), (), AXIS, timed=True)
    assert not any(text.startswith("velocity") for text in mapping)
    with pytest.raises(NeedsAnswers) as told:
        completed(Table("log.csv", columns | {"Torque": TORQUE}), (), AXIS, timed=True)
    assert '# torque_nm="Torque [Nm]"*nm\n# torque_nm=Torque' in told.value.template


@pytest.mark.skipif(not CASE.is_dir(), reason="the cases are not beside the checkout")
def test_the_case(tmp_path: Path) -> None:
    words = ["import", str(CASE / "two-axes.csv"), "--run", str(tmp_path / "run")]
    outcome = CliRunner().invoke(cli, words)
    assert outcome.exit_code == 1
    assert "'Torque [Nm]' (c2), 'Torque [Nm]_2' (c4) could be meant" in outcome.output
    assert "'Position [rad]' (c3), 'Position [rad]_2' (c5) could be meant" in outcome.output
    second = ["--map", 'torque_nm="Torque [Nm]_2"', "--map", 'position_rad="Position [rad]_2"']
    assert CliRunner().invoke(cli, [*words, *second]).exit_code == 0
