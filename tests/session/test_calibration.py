"""What a drive's gains mean: measured on virtual drives whose meaning is another than the profile's guess, and nothing written before."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.control import Cascade
from beltcomm.drive.parameters import parameters_to_cascade
from beltcomm.errors import DataError, Refused, SafetyStop, UsageError
from beltcomm.experiments import gain_steps, phases
from beltcomm.experiments.plan import commission_plan
from beltcomm.machine.machine import Machine
from beltcomm.rundata import calibration
from beltcomm.rundata.calibration import Calibration, GainUnit, check
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from beltcomm_adapters.profiles import load_profile
from identify.records import true_model
from session.bench import Bench

MakeBench = Callable[..., Bench]
AXIS = load_axis("egc-70-600")
YES = api.Options(yes=True, seed=3)
UNIT = 0.02 / 256  # N m s/rad per unit of 60F9h:1, as docs/reference-drive.md has it
FACTORS = (0.37, 2.5, 1.6)  # velocity gain, position gain, integral time


@pytest.mark.parametrize(("rig", "factors"), [("g_a", FACTORS), ("g_b", (8.0, 0.2, 1.0)), ("g_b", (0.03, 15.0, 0.5))])
def test_another_meaning_than_the_profiles_is_found(make_bench: MakeBench, tmp_path: Path, rig: str, factors: tuple[float, ...]) -> None:
    bench = make_bench(rig, profile="cmmp-as", gain_units=factors)
    folder = RunFolder.create(tmp_path / "run", AXIS)
    with bench.open(bench.name, {"seed": 3}) as drive, Machine(drive, AXIS, folder, Silence()) as machine:
        breakaway = phases.sign_and_scale(machine).coulomb_nm
        before = drive.objects()
        tick, machine_s = len(bench.plant.torque_nm), bench.now_s
        found = gain_steps.measure(machine, breakaway)
        assert [item.raw for item in drive.objects()] == [item.raw for item in before]  # put back
        assert drive.capabilities.uncalibrated  # measuring alone is not believing
    assert bench.now_s - machine_s < gain_steps.SECONDS
    for name, true in zip(("kp_nm_s_rad", "kpp_1_s", "ki_nm_rad"), factors, strict=True):
        unit = found.units[name]
        assert abs(unit.factor - true) < 1.5 * max(unit.interval / unit.assumed, 0.0) or (unit.interval, true) == (0.0, 1.0), name
        assert unit.interval < 0.12 * unit.value
    # friction held the carriage, and the torque stayed below what the plan tells
    assert np.ptp(bench.plant.cart_m(tick, len(bench.plant.torque_nm) - tick)) < 1e-3
    assert np.abs(bench.plant.torque_nm[tick:]).max() < breakaway
    assert bench.stands_disabled()


def test_a_loop_designed_with_what_was_found_is_the_one_in_the_drive(make_bench: MakeBench, tmp_path: Path) -> None:
    """With the profile's guess K_P would be 0.37 times what it was designed as, K_PP 2.5 times; a whole commissioning of such a drive
    stands in ``test_machines``."""
    bench = make_bench("g_a", profile="cmmp-as", gain_units=FACTORS)
    folder = RunFolder.create(tmp_path / "run", AXIS)
    model = true_model(bench.plant.plant)
    designed = Cascade(0.02, 0.02 / 0.03, 3.0, 0.4e-3)
    with bench.open(bench.name, {"seed": 3}) as drive, Machine(drive, AXIS, folder, Silence()) as machine:
        with pytest.raises(Refused, match=r"nothing was written.*beltcomm calibrate"):
            machine.write_cascade(designed)
        assert drive.write(drive.backup()) == drive.backup()  # what stands there may be written: it changes nothing
        gain_steps.ensure(machine, phases.sign_and_scale(machine).coulomb_nm)
        assert not drive.capabilities.uncalibrated
        machine.write_cascade(replace(designed, ki_nm_rad=0.022 / drive.capabilities.structure.highest["integral_time_s"]))
        inside = bench._bus._nodes[0]._servo._loops
        inside.reload_gains()
        true: Any = inside._cascade
        assert true.kp_nm_s_rad == pytest.approx(0.02, rel=0.05)
        assert true.kpp_1_s == pytest.approx(3.0, rel=0.06)
        at = machine.position_m
        phases.move_to(machine, at + 0.05, model)  # and it is closed as it was designed; a velocity loop ends a little beside its goal
        assert machine.position_m == pytest.approx(at + 0.05, abs=5e-3)
    # a resumed session, and another command on the run, are told
    assert bench.parameters()["kp_nm_s_rad"] == bench.initial["kp_nm_s_rad"]  # not told: the profile's guess
    with bench.open(bench.name, {}) as drive:
        calibration.recall(drive, folder)
        assert not drive.capabilities.uncalibrated
        kp = parameters_to_cascade(drive.backup()).kp_nm_s_rad
        assert kp == pytest.approx(26 * 0.37 * UNIT, rel=0.05)
        # the first backup speaks of the same drive
        assert folder.load("results", "backup")["parameters"]["kp_nm_s_rad"] == pytest.approx(kp)
    assert folder.load("results", "drive")["uncalibrated"] == []


def test_the_plan_says_so_where_it_will_be_needed(make_bench: MakeBench) -> None:
    for profile, told in (("cmmp-as", True), ("reference", False)):
        with make_bench("g_a", profile=profile).open("virtual:g_a", {}) as drive:
            lines = commission_plan(AXIS, drive.capabilities).lines()
        assert any("small steps: what its gains mean" in line for line in lines) is told


def test_the_command_measures_keeps_and_goes_on(make_bench: MakeBench, tmp_path: Path) -> None:
    bench, run = make_bench("g_a", profile="cmmp-as", gain_units=(0.37, 1.0, 1.0)), tmp_path / "run"
    dry = api.calibrate(bench.name, AXIS, run, options=replace(YES, dry_run=True))
    assert "Nothing was moved" in dry.text[-1]
    assert bench.plant.cart_position_m == 0.0
    with pytest.raises(Refused, match="nothing was moved: the plan was to be agreed to"):
        api.calibrate(bench.name, AXIS, run)
    result = api.calibrate(bench.name, AXIS, run, options=YES)
    assert result.data["units"]["kp_nm_s_rad"]["unit"] == pytest.approx(0.37 * UNIT, rel=0.04)
    assert re.search(r"0\.3[678]\d? times what its profile has", "\n".join(result.text))
    assert not calibration._store_of("cmmp-as").exists()  # a simulated drive tells nothing of a real one
    assert bench.parameters() == bench.initial
    again = api.calibrate(bench.name, None, run, options=YES)  # in the same run; now held against the first
    assert again.data["units"]["kp_nm_s_rad"]["unit"] == pytest.approx(0.37 * UNIT, rel=0.04)
    (run / "results" / "calibration.yaml").write_text("units: {kp_nm_s_rad: {unit: -1}}\n", encoding="utf-8")
    with pytest.raises(DataError, match="is damaged"):
        api.calibrate(bench.name, None, run, options=YES)


def test_a_documented_meaning_that_does_not_hold_is_refused(make_bench: MakeBench, tmp_path: Path) -> None:
    """The reference drive says what its gains are; this one means three times as much."""
    bench = make_bench("g_a", gain_units=(3.0, 1.0, 1.0))
    with pytest.raises(Refused, match=r"2100h:1 \(kp_nm_s_rad\) was measured as (2\.9|3).*times the 1 of its documents"):
        api.calibrate(bench.name, AXIS, tmp_path / "run", options=YES)
    assert bench.parameters() == bench.initial
    assert RunFolder.open(tmp_path / "run").load_result("calibration") is None


def test_a_drive_measured_before_is_held_against(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibration, "user_data_path", lambda _name: tmp_path)
    found = Calibration("cmmp-as", 1.43, 2.2, {"kp_nm_s_rad": GainUnit(1e-4, 1e-6, UNIT, "60F9h:1")})
    assert calibration.calibration_of("cmmp-as") is None
    assert str(tmp_path) in calibration.keep_for_kind(found)
    assert calibration.calibration_of("cmmp-as") == found
    assert check(found, False, found) == []
    other = replace(found, units={"kp_nm_s_rad": GainUnit(2.1e-4, 1e-6, UNIT, "60F9h:1")})
    with pytest.raises(Refused, match=r"2\.1 times the 0\.0001 of a drive of this kind measured before"):
        check(other, False, found)
    (remark,) = check(replace(other, rated_torque_nm=5.0), False, found)
    assert "with another motor" in remark
    assert check(replace(found, units={"kp_nm_s_rad": GainUnit(1.9e-4, 1e-6, UNIT, "60F9h:1")}), False, found) == []
    calibration._store_of("cmmp-as").write_text("kind: [", encoding="utf-8")
    with pytest.raises(DataError):
        calibration.calibration_of("cmmp-as")


def test_what_cannot_be_calibrated_is_refused(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench("g_a", profile="cmmp-as")
    folder = RunFolder.create(tmp_path / "run", AXIS)
    with bench.open(bench.name, {}) as drive, Machine(drive, AXIS, folder, Silence()) as machine:
        machine.axis = replace(AXIS, mounting=replace(AXIS.mounting, tilt_deg=25.0))
        with pytest.raises(Refused, match="tilted and would fall"):
            gain_steps.measure(machine, 0.1)
        machine.axis = AXIS
        drive.capabilities = replace(drive.capabilities, parameters={})
        with pytest.raises(Refused, match="no velocity gain"):
            gain_steps.measure(machine, 0.1)
    assert load_profile("cia402").parameters == {}


def test_an_axis_that_moves_under_the_steps_is_stopped(make_bench: MakeBench, tmp_path: Path) -> None:
    """Told of three times the friction there is, the steps break the carriage loose: it is stopped and the gains are put back.

    What the torque works over 2 mm, friction uses up over 2 mm times torque over friction, less than the 10 mm of the plan.
    """
    bench = make_bench("g_b", profile="cmmp-as")
    folder = RunFolder.create(tmp_path / "run", AXIS)
    with (
        bench.open(bench.name, {}) as drive,
        Machine(drive, AXIS, folder, Silence()) as machine,
        pytest.raises(SafetyStop, match="small steps"),
    ):
        gain_steps.measure(machine, 0.4)
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()
    assert abs(bench.plant.cart_position_m) < gain_steps.REACH_M


def test_a_unit_must_be_a_number(make_bench: MakeBench) -> None:
    with make_bench("g_a", profile="cmmp-as").open("virtual:g_a", {}) as drive:
        for unit in (0.0, -1.0, float("nan")):
            with pytest.raises(UsageError, match="positive number"):
                drive.calibrate({"kp_nm_s_rad": unit})
        with pytest.raises(UsageError, match="no parameter k"):
            drive.calibrate({"k": 1.0})
