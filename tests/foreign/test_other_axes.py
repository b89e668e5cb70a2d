"""What real records of axes without a belt brought: the motor's voltage, setpoints, speeds at a rate, a torque that comes seldom."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from beltcomm.axis import axis_from_dict, load_axis
from beltcomm.cli.main import cli
from beltcomm.errors import DataError, UsageError
from beltcomm.fit.noise.level import is_held
from beltcomm.fit.path_fit import choice as path_choice
from beltcomm.fit.start.model import start_model
from beltcomm.fit.start.rigid import least_squares
from beltcomm.foreign.guess import NeedsAnswers, _guesses_for, completed
from beltcomm.foreign.plausibility import findings
from beltcomm.foreign.relations import relations
from beltcomm.foreign.table import Table
from beltcomm.laboratory.cross_checks import second_sensor, sheet_doubts
from beltcomm.model import build_model, load_plant
from beltcomm.recording import Recording
from beltcomm.recording.checks import MOST_JUDGED, _livelier, rigid_inertia
from beltcomm.recording.signalfile import write_columns
from beltcomm.runfolder import RunFolder
from beltcomm.schedule.next_plan import load_plan, plan_for
from beltcomm.sentences.cross_checks import sensor_lines

Array = NDArray[np.float64]
NO_BELT = axis_from_dict({"name": "bench"}, "a")


def moved(seed: int, size: int = 6000, period_s: float = 1e-3) -> tuple[Array, Array, Array]:
    """Time, angle and speed of a smooth random motion."""
    rng = np.random.default_rng(seed)
    t = period_s * np.arange(size)
    parts = zip(rng.uniform(0.5, 2.0, 6), rng.uniform(0.2, 3.0, 6), rng.uniform(0.0, 6.0, 6), strict=True)
    angle = sum(a * np.sin(math.tau * f * t + p) for a, f, p in parts)
    return t, np.asarray(angle), np.gradient(angle, period_s)


def test_a_setpoint_of_the_position_is_no_torque() -> None:
    """It moves more roughly than the position and explains it fully; what drives it stands beside it."""
    t, angle, speed = moved(1)
    steps = np.repeat(angle[::50], 50)
    torque = 2e-3 * np.gradient(speed, 1e-3) + 0.05 * np.sign(speed) + np.random.default_rng(2).normal(0, 0.01, len(t))
    found = relations(Table("a", {"c1": t, "c2": steps, "c3": angle, "c4": speed, "c5": torque}))
    assert (found.time, found.position, found.velocity, found.torques) == ("c1", "c3", "c4", ("c5",))


def test_a_speed_stands_for_the_position_at_a_rate() -> None:
    table = Table("a", {"i": np.ones(9), "v": np.arange(9.0), "x": np.arange(9.0)})
    assert completed(table, ("current_a=i", "velocity_rad_s=v"), NO_BELT, timed=False)[1] == ()


@pytest.mark.parametrize(("drives", "moves", "wanted"), [
    ("current_a=i", "position_m=x*mm", "position_rad=x*mm*rev/10mm"),
    ("torque_nm=i", "velocity_m_s=x*mm/s", "velocity_rad_s=x*mm/s*rev/10mm"),
])  # fmt: skip
def test_a_torque_beside_a_place_asks_what_lies_between(drives: str, moves: str, wanted: str) -> None:
    table = Table("a", {"t_s": np.arange(9.0), "i": np.ones(9), "x": np.arange(9.0)})
    with pytest.raises(UsageError, match=r"--map " + wanted.replace("*", r"\*")):
        completed(table, (drives, moves), NO_BELT, timed=True)


def test_a_driver_that_is_called_a_voltage_is_offered_as_one() -> None:
    t, angle, speed = moved(3)
    volts = 0.1 * speed + 4e-3 * np.gradient(speed, 1e-3) + 0.4 * np.sign(speed) + np.random.default_rng(1).normal(0, 0.02, len(t))
    table = Table("a", {"zeit": t, "a": angle, "b": speed, "pwm": volts})
    with pytest.raises(NeedsAnswers, match="motor_voltage_v=pwm"):
        completed(table, (), NO_BELT, timed=True)
    assert any(guess.choices[:1] == ("position_rad=a*1",) for guess in _guesses_for(table, {}, NO_BELT, timed=True))


def test_a_voltage_is_offered_by_its_name_where_nothing_else_drives() -> None:
    t, angle, _ = moved(3)
    file = {"Time [s]": t, "Motor voltage [mV]": 1e3 * np.sin(t), "DC bus voltage [V]": 48.0 + t, "Angle [rad]": angle}
    with pytest.raises(NeedsAnswers, match=r'motor_voltage_v="Motor voltage \[mV\]"\*mv\)'):
        completed(Table("a", file), (), NO_BELT, timed=True)
    with pytest.raises(NeedsAnswers, match=r"current_a=") as told:
        completed(Table("a", {**file, "Current [A]": np.cos(t), "i2 [A]": np.cos(t)}), (), NO_BELT, timed=True)
    assert "motor_voltage_v" not in str(told.value)


@pytest.mark.examination
def test_volts_through_import_and_fit(tmp_path: Path) -> None:
    """Gain and back-EMF are what the inertia and the damping in volt say: J R / K_t, and K_e + d R / K_t."""
    gain, emf, inertia, damping, coulomb = 0.05, 0.08, 2e-4, 5e-4, 0.01
    runner, run = CliRunner(), tmp_path / "run"
    for name, seed in (("a", 4), ("held", 5)):
        t, angle, speed = moved(seed)
        torque = inertia * np.gradient(speed, 1e-3) + damping * speed + coulomb * np.sign(speed)
        volts = torque / gain + emf * speed + np.random.default_rng(seed).normal(0, 0.01, len(t))
        step = math.tau / 4096
        write_columns(tmp_path / f"{name}.csv", {"t_s": t, "motor_voltage_v": np.append(volts[1:], volts[-1]) * 0.5 + volts * 0.5,
                                                 "position_rad": step * np.round(angle / step)})  # fmt: skip
        words = ["import", str(tmp_path / f"{name}.csv"), "--run", str(run), *(["--held-out"] if name == "held" else ["--set", "name=m"])]
        outcome = runner.invoke(cli, words)
        assert outcome.exit_code == 0, outcome.output
        assert "everything is identified in volt: viscous friction has the back-EMF in it" in outcome.output.replace("\n", " ")
    outcome = runner.invoke(cli, ["compare", str(run), "--json"])
    assert outcome.exit_code == 0, outcome.output
    found = RunFolder.open(run).recordings()
    assert {record.side for record in found} == {"volt"}
    rows = least_squares(found)
    assert rows == pytest.approx([inertia / gain, emf + damping / gain, coulomb / gain], rel=0.03)
    assert '"V"' in outcome.stdout


def test_a_torque_that_gets_a_new_value_seldom_and_rows_read_twice_are_told_with_the_way_out() -> None:
    t, angle, speed = moved(6)
    torque = 2e-3 * np.gradient(speed, 1e-3) + 0.05 * np.sign(speed)
    held = Recording(name="a", t_s=t, torque=np.repeat(torque[::20], 20), position=angle)
    (told,) = [str(one) for one in findings(held, NO_BELT) if "new value" in one.what]
    assert "20 ms, 20 rows" in told
    assert "--resample 35Hz" in told
    noisy = torque + np.random.default_rng(1).normal(0, 0.01, len(t))
    twice = np.arange(len(t))
    twice[100::40] -= 1
    found = [str(one) for one in findings(Recording(name="a", t_s=t, torque=noisy[twice], position=angle[twice]), NO_BELT)]
    assert any("stand still between steps" in one and "--resample 1e+02Hz" in one for one in found), found
    assert findings(Recording(name="a", t_s=t, torque=noisy, position=angle), NO_BELT) == ()


def test_a_command_in_steps_is_told_from_a_coarse_reading() -> None:
    t, angle, speed = moved(7)
    torque = 2e-3 * np.gradient(speed, 1e-3) + 0.05 * np.sign(speed)

    def record(values: Array) -> Recording:
        return Recording(name="a", t_s=t, torque=values, position=angle)

    assert is_held([record(np.repeat(torque[::500], 500))])
    coarse = 0.01 * np.round((torque + np.random.default_rng(1).normal(0, 0.004, len(t))) / 0.01)
    assert not is_held([record(coarse)])


def test_the_start_of_a_rigid_axis_is_not_bent_by_a_weight_that_turns() -> None:
    """m g l of five times the friction; without it the same numbers."""
    for weight in (0.0, 0.4):
        t, angle, speed = moved(8)
        exact = 2e-3 * np.gradient(speed, 1e-3) + 5e-3 * speed + 0.08 * np.sign(speed) + weight * np.sin(angle - 0.3)
        record = Recording(name="a", t_s=t, torque=exact + np.random.default_rng(1).normal(0, 0.01, len(t)), position=angle)
        assert least_squares([record]) == pytest.approx([2e-3, 5e-3, 0.08], rel=0.05)


def test_counts_of_the_encoder_are_held_against_the_data_sheet_without_a_belt() -> None:
    t, angle, speed = moved(9)
    step = math.tau / 4096
    record = Recording(name="a", t_s=t, torque=1e-3 * np.gradient(speed, 1e-3), position=step * np.round(angle / step))
    model = build_model("m", ("viscous", "coulomb"), {"transmission.ratio": 1.0}, base_bodies=("motor",), origin="a")

    def told(counts: int) -> list[float]:
        axis = axis_from_dict({"name": "b", "motor": {"encoder_counts_per_rev": counts}}, "a")
        return [doubt.found for doubt in sheet_doubts(model, 1.0, axis, [record])]

    assert told(4096) == told(16384) == []  # a coarser reading of the same encoder
    assert told(2000) == pytest.approx([4096.0])
    assert told(1024) == pytest.approx([4096.0])


def test_what_to_record_next_on_an_axis_without_a_belt_is_for_its_own_drive(tmp_path: Path) -> None:
    plan = plan_for(("cogging", "tooth_ripple"), [], belt=False)
    text = " ".join(plan.lines(tmp_path))
    assert not plan.steps
    assert plan.command(tmp_path) == ""
    assert "moved by its own drive" in text
    assert "identify" not in text
    folder = RunFolder.create(tmp_path / "run", load_axis("egc-70-600"))
    folder.save("results", "next", plan.to_dict())
    with pytest.raises(UsageError, match="By hand: speeds held for a second"):
        load_plan(plan.file(folder.path))


def test_a_long_record_is_judged_by_the_rows_that_move_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("beltcomm.recording.checks.MOST_JUDGED", 4000)
    t, angle, speed = moved(10, 12_000)
    angle[:4000], speed[:4000] = angle[4000], 0.0
    torque = 2e-3 * np.gradient(speed, 1e-3) + 0.05 * np.sign(speed)
    kept = _livelier(t, torque, angle)
    assert len(kept[0]) == 4000
    assert kept[0][0] >= t[4000]
    found = rigid_inertia(t, torque, angle)
    assert found is not None
    assert found.inertia == pytest.approx(2e-3, rel=0.03)
    assert MOST_JUDGED > 100_000


@pytest.mark.parametrize("ratio", [1.0, 0.25])
def test_a_sensor_at_the_load_shows_the_antiresonance_by_itself(ratio: float) -> None:
    """J θ'' + d θ' + c sign θ' = k (motor - θ): the load is drawn, and the motor angle follows; 24 Hz, whatever the sensor counts in."""
    stiffness, inertia = 9.0, 9.0 / (math.tau * 24.0) ** 2
    t, slow, _ = moved(11, 12_000)
    rng = np.random.default_rng(5)
    load = slow + sum(
        0.02 * np.sin(math.tau * f * t + p) for f, p in zip(rng.uniform(5.0, 60.0, 12), rng.uniform(0.0, 6.0, 12), strict=True)
    )
    speed = np.gradient(load, 1e-3)
    motor = load + (inertia * np.gradient(speed, 1e-3) + 2e-3 * speed + 0.05 * np.sign(speed)) / stiffness
    step = math.tau / 65536
    record = Recording(
        name="a", t_s=t, torque=speed + rng.normal(0, 0.1, len(t)), position=step * np.round(motor / step),
        load_position_rad=ratio * step * np.round(load / step),
    )  # fmt: skip
    found = second_sensor([record], [24.1, 80.0])
    assert found is not None
    assert abs(found.antiresonance_hz - 24.0) < 0.01 * 24.0
    assert found.confirms
    assert not second_sensor([record], [30.0]).confirms  # type: ignore[union-attr]
    assert "one rigid body" in sensor_lines(second_sensor([record]))[0]
    stiff = Recording(name="a", t_s=t, torque=record.torque, position=step * np.round(load / step), load_position_rad=load)
    assert second_sensor([stiff]) is None


def test_no_path_of_the_torque_is_looked_for_behind_a_model_without_inertia() -> None:
    values = {"transmission.ratio": 1.0, "motor.inertia": 1e-8}
    rigid = build_model("m", ("viscous", "coulomb"), values, base_bodies=("motor",), origin="a")
    assert path_choice._without_inertia(rigid)
    assert not path_choice._without_inertia(rigid.with_values({"motor.inertia": 1e-3}))
    assert not path_choice._without_inertia(load_plant("g_a").model.with_values({"motor.inertia": 1e-8}))


@pytest.mark.parametrize(
    ("viscous", "coulomb", "stated", "refused"),
    [
        (1.2, 0.5, "", False),
        (1.2, 270.0, "", True),
        (1.2, 270.0, "0.4", False),
        (60.0, 270.0, "0.4", False),
        (1.2, 270.0, "4e-3", True),
        (1.2, 0.5, "4e-3", True),
    ],
)
def test_a_large_machine_is_none_of_another_unit_where_its_inertia_is_stated(
    viscous: float, coulomb: float, stated: str, refused: bool
) -> None:
    t, angle, speed = moved(8)
    torque = 0.5 * np.gradient(speed, 1e-3) + viscous * speed + coulomb * np.sign(speed) + np.random.default_rng(1).normal(0, 2.0, len(t))
    record = Recording(name="a", t_s=t, torque=torque, position=angle)
    axis = replace(NO_BELT, motor=replace(NO_BELT.motor, inertia_kg_m2=float(stated) if stated else None))
    if refused:
        with pytest.raises(DataError, match=r"state motor\.inertia_kg_m2 of so large a machine"):
            start_model(axis, [record])
        return
    found = start_model(axis, [record])
    assert (found["viscous.damping"], found["coulomb.level"]) == pytest.approx((viscous, coulomb), rel=0.05, abs=0.3)
    assert found.parameters["viscous.damping"].high >= 5.0 * viscous
