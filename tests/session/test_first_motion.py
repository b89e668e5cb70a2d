"""The first motion of a drive that beltcomm never moved: a person answers for it, whatever --yes says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm import api
from beltcomm.axis import Axis, load_axis
from beltcomm.cli.main import cli
from beltcomm.errors import BeltcommError, Refused
from beltcomm.virtual.faults import Faults
from session.bench import Bench
from session.hardware import HardwareBench, Person, Script

Connect = Callable[[Bench], Bench]
YES = api.Options(yes=True, seed=1)
BY_M = 5e-3
QUESTION = "Is all of this so, and may it move for the first time?"


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state" / "beltcomm"


def creep(talk: Script | Person, options: api.Options = YES, axis: object = "egc-70-600") -> api.Result:
    return api.move("virtual:g_a", axis, BY_M, options=options, talk=talk)  # type: ignore[arg-type]


def test_yes_alone_moves_no_unknown_hardware(connect: Connect, state: Path) -> None:
    bench = connect(HardwareBench())
    with pytest.raises(Refused, match=r"CMMP-AS, vendor 29, product 8227, serial number 4711 .*was never moved by beltcomm") as refused:
        creep(Script())
    assert refused.value.exit_code == 1
    assert "--first-motion-confirmed '4711'" in str(refused.value)
    assert bench.plant.cart_position_m == 0.0
    assert bench.stands_disabled()
    assert not list(state.rglob("*.yaml"))


def test_the_command_line_says_so_with_exit_code_1(connect: Connect) -> None:
    bench = connect(HardwareBench())
    outcome = CliRunner().invoke(cli, ["move", "--drive", "virtual:g_a", "--by", "5mm", "--yes"])
    assert outcome.exit_code == 1
    assert "--yes does not answer for its first motion" in outcome.stderr
    assert bench.plant.cart_position_m == 0.0


def test_a_person_is_asked_once_and_the_drive_is_known_afterwards(connect: Connect, state: Path) -> None:
    bench, person = connect(HardwareBench()), Person(answer=True)
    assert creep(person).exit_code == 0
    assert person.asked == [QUESTION]
    assert "the emergency stop is in your hand" in "\n".join(person.said)
    assert bench.plant.cart_position_m == pytest.approx(BY_M, abs=1e-3)
    assert [path.name for path in state.rglob("*.yaml")] == [path.name for path in (state / "drives").glob("29-8227-4711-CMMP-AS-*.yaml")]
    script = Script()
    assert creep(script).exit_code == 0  # known now, by any command
    assert script.asked == []


def test_another_axis_behind_a_known_drive_is_another_machine(connect: Connect) -> None:
    connect(HardwareBench())
    creep(Person(answer=True))
    other = replace(load_axis("egc-70-600"), name="lifter")
    with pytest.raises(Refused, match="was moved on the axis EGC-70-600 before, not on lifter"):
        creep(Script(), axis=other)


def test_a_no_moves_nothing_and_is_not_remembered(connect: Connect) -> None:
    bench = connect(HardwareBench())
    for _ in range(2):
        person = Person(answer=False)
        with pytest.raises(Refused, match="nothing was moved, as you said"):
            creep(person)
        assert person.asked == [QUESTION]
    assert bench.plant.cart_position_m == 0.0


def test_a_script_names_the_drive(connect: Connect) -> None:
    bench = connect(HardwareBench())
    with pytest.raises(Refused, match=r"--first-motion-confirmed names 4712, but this is CMMP-AS.*4711"):
        creep(Script(), replace(YES, first_motion="4712"))
    assert bench.plant.cart_position_m == 0.0
    script = Script()
    assert creep(script, replace(YES, first_motion="4711")).exit_code == 0
    assert any("confirmed by --first-motion-confirmed" in line for line in script.said)


def test_a_drive_without_a_serial_number_is_never_known(connect: Connect) -> None:
    connect(HardwareBench(serial="0"))
    for _ in range(2):
        assert creep(Script(), replace(YES, first_motion="CMMP-AS")).exit_code == 0
        with pytest.raises(Refused, match="tells no serial number"):
            creep(Script())


def test_a_motion_that_failed_made_nothing_known(connect: Connect) -> None:
    connect(HardwareBench(faults=Faults(stuck_from_s=0.0)))
    for _ in range(2):
        person = Person(answer=True)
        with pytest.raises(BeltcommError, match="does not move"):
            creep(person)
        assert person.asked == [QUESTION]


def test_a_virtual_drive_moves_nothing_and_asks_nothing(connect: Connect, state: Path) -> None:
    connect(Bench())
    script = Script()
    assert creep(script).exit_code == 0
    assert script.asked == []
    assert not state.exists()


def confirmed(axis: Axis) -> None:
    assert creep(Person(answer=True), axis=axis).exit_code == 0
    assert creep(Script(), axis=axis).exit_code == 0


@pytest.mark.parametrize(
    ("section", "values", "words"),
    [
        ("travel", {"max_m": 0.65}, r"travel.max_m 0.65 m, was 0.57 m"),
        ("travel", {"min_m": -0.04}, r"travel.min_m -0.04 m, was -0.01 m"),
        ("limits", {"feed_force_n": 900.0}, r"limits.feed_force_n 900 N, was 100 N"),
        ("limits", {"acceleration_m_s2": None}, r"limits.acceleration_m_s2 not stated"),
        ("mounting", {"tilt_deg": 2.0}, r"mounting.tilt_deg 2, was 0"),
        ("motor", {"peak_torque_nm": None}, r"motor.peak_torque_nm not stated, was 3.1 N m"),
    ],
)
def test_another_limit_of_the_axis_file_is_asked_for(connect: Connect, section: str, values: dict[str, float | None], words: str) -> None:
    connect(HardwareBench())
    axis = load_axis("egc-70-600")
    confirmed(axis)
    other = replace(axis, **{section: replace(getattr(axis, section), **values)})
    with pytest.raises(Refused, match=rf"was moved on this axis before, but what was confirmed then was less: .*{words}"):
        creep(Script(), axis=other)
    asked = Person(answer=True)
    assert creep(asked, axis=other).exit_code == 0
    assert asked.asked == ["Is all of this so, and may it move so far?"]
    assert creep(Script(), axis=other).exit_code == 0


def test_a_smaller_one_is_not(connect: Connect) -> None:
    connect(HardwareBench())
    axis = load_axis("egc-70-600")
    confirmed(axis)
    smaller = replace(axis, travel=replace(axis.travel, max_m=0.5), limits=replace(axis.limits, feed_force_n=80.0))
    assert creep(Script(), axis=smaller).exit_code == 0
    assert creep(Script(), axis=axis).exit_code == 0  # what was confirmed once stays so


def test_a_larger_plan_is_asked_for(connect: Connect) -> None:
    bench = connect(HardwareBench())
    confirmed(load_axis("egc-70-600"))
    with pytest.raises(Refused, match=r"was less: .*way with a stop \S+ m, was \S+ m"):
        api.move(bench.name, "egc-70-600", 20.0 * BY_M, options=YES, talk=Script())


@pytest.mark.parametrize("damage", ["confirmed: 3", "confirmed: {machine: 1, most: 2}", "confirmed: {machine: {}, most: {reach_m: far}}"])
def test_what_cannot_be_read_confirms_nothing(connect: Connect, state: Path, damage: str) -> None:
    connect(HardwareBench())
    confirmed(load_axis("egc-70-600"))
    (path,) = state.rglob("drives/*.yaml")
    kept = path.read_text(encoding="utf-8").partition("confirmed:")[0]
    path.write_text(kept + damage + "\n", encoding="utf-8")
    with pytest.raises(Refused, match="what was confirmed then was less"):
        creep(Script())
