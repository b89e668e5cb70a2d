"""Units of a drive that somebody changed between two commands, or that it tells otherwise: noticed before anything moves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from beltcomm import api
from beltcomm.cli.main import cli
from beltcomm.configfiles import read_yaml, to_yaml
from beltcomm.errors import Refused
from beltcomm.machine.ratings import other_units_than
from beltcomm.virtual.faults import Faults
from session.bench import Bench
from session.hardware import HardwareBench, Person, Script

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
#: What the drive tells of its feed, twice what it is; its own loops go on in the old unit.
TWICE: dict[tuple[int, int], int] = {(0x6092, 1): 2 * 65536, (0x6093, 1): 2}


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in (*words, "--drive", "virtual:g_a", "--yes", "--seed", 1)])


@pytest.mark.parametrize(
    "words",
    [("verify",), ("friction",), ("apply", "--force"), ("rollback",), ("identify", "--resume"), ("commission", "--resume", "--quick")],
)
def test_a_run_is_not_gone_on_with_in_other_units(make_bench: MakeBench, copy_of_complete: Copy, words: tuple[str, ...]) -> None:
    run, bench = copy_of_complete(), make_bench(faults=Faults(misread=TWICE))
    before = read_yaml(run / "results" / "drive.yaml")
    outcome = call(*words, "--run", run)
    assert outcome.exit_code == 2, outcome.output
    for word in ("one unit of position is", "0.5 times", "6092h", "Nothing was moved", "begin a new run"):
        assert word in outcome.stderr
    assert bench.plant.cart_position_m == 0.0
    assert bench.parameters() == bench.initial
    assert read_yaml(run / "results" / "drive.yaml") == before


TENTH = 0.1 * 1.43  # N m: 6076h is 143, which is right in cN m


@pytest.mark.parametrize("words", [("verify",), ("apply", "--force"), ("rollback",)])
def test_a_run_is_not_gone_on_with_where_the_rated_torque_counts_in_another_unit(
    make_bench: MakeBench, copy_of_complete: Copy, words: tuple[str, ...]
) -> None:
    """Torques are scaled as they were, and yet somebody has been at the motor's data."""
    run, bench = copy_of_complete(), make_bench(faults=Faults(rated_torque_nm=TENTH))
    outcome = call(*words, "--run", run)
    assert outcome.exit_code == 2, outcome.output
    assert "one unit of rated torque is 0.01 N m, it was 0.001 (10 times; 6076h)" in outcome.stderr
    assert bench.parameters()["kp_nm_s_rad"] == bench.initial["kp_nm_s_rad"]


@pytest.mark.parametrize("words", [("apply", "--force"), ("rollback",)])
def test_what_6076h_is_taken_for_is_said_before_anything_is_written(
    make_bench: MakeBench, copy_of_complete: Copy, words: tuple[str, ...]
) -> None:
    """In a run that has known it so from the beginning."""
    run = copy_of_complete()
    make_bench(faults=Faults(rated_torque_nm=TENTH))
    _forget_units(run)
    outcome = call(*words, "--run", run)
    assert outcome.exit_code == 0, outcome.output
    assert "6076h = 143 is 1.43 N m if it counts in cN m" in outcome.output


def test_gains_are_not_written_where_axis_yaml_has_another_rated_torque(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    axis: dict[str, Any] = read_yaml(run / "axis.yaml")
    axis["motor"]["rated_torque_nm"] = 2.86
    (run / "axis.yaml").write_text(to_yaml(axis), encoding="utf-8")
    outcome = call("apply", "--force", "--run", run)
    assert outcome.exit_code == 2, outcome.output
    assert "nothing was written or moved: the drive's rated torque is 1.43 N m, axis.yaml says 2.86 N m" in outcome.stderr
    assert bench.parameters() == bench.initial


@pytest.mark.parametrize(("share", "code", "said"), [(0.1, 0, "if it counts in cN m"), (10.0, 2, "the drive's rated torque is 14.3 N m")])
def test_a_creep_asks_what_torques_count_in(make_bench: MakeBench, share: float, code: int, said: str) -> None:
    bench = make_bench(faults=Faults(rated_torque_nm=share * 1.43))
    outcome = call("move", "--by", "5mm", "--axis", "egc-70-600")
    assert outcome.exit_code == code, outcome.output
    assert said in outcome.output + outcome.stderr
    assert code == 0 or bench.plant.cart_position_m == 0.0


def _forget_units(run: Path) -> None:
    """As a run of an older version: nothing to compare the units with."""
    file = run / "results" / "drive.yaml"
    told: dict[str, Any] = read_yaml(file)
    assert told.pop("units")
    file.write_text(to_yaml(told), encoding="utf-8")


def test_a_run_of_an_older_version_tells_no_units(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run = copy_of_complete()
    make_bench()
    _forget_units(run)
    assert call("verify", "--run", run, "--dry-run").exit_code == 0


def test_a_real_drive_that_has_moved_before_is_asked_for_anew(
    connect: Callable[[Bench], Bench], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))

    def creep(talk: Script | Person) -> api.Result:
        return api.move("virtual:g_a", "egc-70-600", 5e-3, options=api.Options(yes=True, seed=1), talk=talk)

    connect(HardwareBench())
    assert creep(Person(answer=True)).exit_code == 0
    assert creep(Script()).exit_code == 0
    bench = connect(HardwareBench(faults=Faults(misread=TWICE)))
    with pytest.raises(Refused, match=r"in other units: one unit of position .*0\.5 times"):
        creep(Script())
    assert bench.plant.cart_position_m == 0.0


def test_only_what_was_told_both_times_is_compared() -> None:
    assert other_units_than({"position": 1.0}, {"position": 1.0 + 1e-9, "speed": 2.0}) == []
    assert other_units_than({}, {"position": 1.0}) == []
    (said,) = other_units_than({"position": 1.0, "acceleration": 10.0}, {"position": 1.0, "acceleration": 1.0})
    assert said.startswith("one unit of acceleration is 1 rad/s², it was 10 (0.1 times; 60AAh")
