"""A virtual machine made of one's own axis file."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner

from beltcomm.axis import load_axis
from beltcomm.cli.main import cli
from beltcomm.configfiles import read_yaml, to_yaml, write_text
from beltcomm.drive import open_drive
from beltcomm.experiments.options import Options
from beltcomm.jobs.virtual_axis import axis_behind, machine_of
from beltcomm.machine.ratings import check_ratings


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """The shipped axis with another motor, ratio and travel."""
    data = read_yaml(Path("configs/axes/egc-70-600.yaml"))
    data |= {"name": "OWN", "travel": {"min_m": 0.0, "max_m": 0.2, "driven_side_offset_m": 0.05}}
    data["motor"] |= {"rated_torque_nm": 2.4, "peak_torque_nm": 7.2, "torque_constant_nm_a": 0.9, "encoder_counts_per_rev": 131072}
    write_text(tmp_path / "own.yaml", to_yaml(data))
    return tmp_path / "own.yaml"


def test_an_axis_file_becomes_a_machine_that_its_own_nameplate_does_not_contradict(own: Path) -> None:
    drive, said = machine_of(f"virtual:{own}")
    assert "friction" in said
    assert axis_behind(drive) == own
    axis = load_axis(own)
    with open_drive(drive, Options().for_drive(axis)) as connected:
        assert check_ratings(axis, connected.capabilities) == []
        place = connected.read(["position_rad"])["position_rad"] * axis.transmission_m_rad
        assert place == pytest.approx(0.1, abs=1e-3)
    write_text(Path(drive.partition(":")[2]), "edited: true\n")
    assert machine_of(f"virtual:{own}")[0] == drive
    assert read_yaml(Path(drive.partition(":")[2])) == {"edited": True}


def test_other_names_of_drives_stay_as_they_are(own: Path) -> None:
    for name in ("virtual", "virtual:g_a", "can0", f"virtual:{own.with_name('none.yaml')}"):
        assert machine_of(name) == (name, "")
        assert axis_behind(name) is None


def test_a_verb_takes_axis_and_machine_of_the_one_file(own: Path) -> None:
    done = CliRunner().invoke(cli, ["commission", "--drive", f"virtual:{own}", "--run", str(own.parent / "run"), "--dry-run"])
    assert done.exit_code == 0, done.output
    assert "OWN" in done.output
    assert "7.2 N m" in done.output


def test_a_file_that_a_virtual_drive_contradicts_is_refused_with_the_way_to_its_own_machine(own: Path) -> None:
    done = CliRunner().invoke(cli, ["commission", "--drive", "virtual", "--axis", str(own), "--run", str(own.parent / "run"), "--yes"])
    assert done.exit_code == 2, done.output
    assert "--drive virtual:AXIS.yaml" in done.output


@pytest.mark.parametrize("language", ["", "de"])
def test_doctor_says_how_the_axis_of_the_file_is_simulated(own: Path, language: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one command that is named, the next one finds nothing that differs."""
    monkeypatch.setenv("BELTCOMM_LANG", language)
    found = CliRunner().invoke(cli, ["doctor", "--drive", "virtual", "--axis", str(own)])
    assert found.exit_code == 1
    assert f"`--drive virtual:{own}` {'simuliert' if language else 'simulates'}" in found.stdout
    assert "maker's tool" not in found.stdout
    command = next(line for line in found.stdout.splitlines() if line.startswith(f"    beltcomm doctor --drive virtual:{own}"))
    again = CliRunner().invoke(cli, command.split()[1:])
    assert again.exit_code == 0, again.stdout
    assert "virtual:" not in "".join(line for line in again.stdout.splitlines() if "->" in line)


def test_a_shipped_axis_on_another_virtual_machine_is_told_the_way_by_its_word() -> None:
    found = CliRunner().invoke(cli, ["doctor", "--drive", "virtual", "--axis", "ball-screw"])
    assert "`--drive virtual:AXIS.yaml` simulates" in found.stdout
