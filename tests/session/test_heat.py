"""Heat of a plan: closed forms, the virtual drive's own I²t, and what a commissioning really took."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.drive import Capabilities, open_drive
from beltcomm.errors import Refused
from beltcomm.experiments import phases
from beltcomm.experiments.agreement import agree, plan_result
from beltcomm.experiments.options import Options
from beltcomm.experiments.plan import Plan, commission_plan, identify_plan, move_plan
from beltcomm.machine.heat import HeatStore, Thermal, heat_plan, path_rms_nm
from beltcomm.plant import IDEAL
from beltcomm.talk import Silence
from beltcomm.trajectory import Trajectory
from beltcomm.virtual.faults import Faults
from beltcomm.virtual.stage import EMMS_AS_70, PowerStage
from session.conftest import Complete

RIG = load_axis("egc-70-600")
MOTOR = Thermal(1.43, 3.10, 2.0, "test")


@pytest.fixture(scope="module")
def capabilities() -> Capabilities:
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        return drive.capabilities


def test_a_load_below_the_rated_torque_fills_no_store() -> None:
    found = heat_plan(MOTOR, [(0.5 * 1.43, 10.0), (1.43, 30.0)])
    assert found.continuous == pytest.approx((0.25 * 10.0 + 30.0) / 40.0)
    assert (found.fullest, found.pauses_s) == (0.0, (0.0, 0.0))


def test_overloads_fill_the_store_and_rest_empties_it() -> None:
    """Twice the rated torque for 1 s is 3 s of excess, of (3.1/1.43)² - 1 = 3.70 times 2 s; before the next one it must be gone."""
    store = ((3.10 / 1.43) ** 2 - 1.0) * 2.0
    found = heat_plan(MOTOR, [(2.86, 1.0), (2.86, 1.0), (0.0, 5.0), (2.86, 1.0)])
    assert found.fullest == pytest.approx(3.0 / store)
    assert found.pauses_s == (0.0, pytest.approx(3.0), 0.0, 0.0)  # the five seconds without torque empty it by themselves
    assert found.continuous == pytest.approx(12.0 / 11.0)
    assert heat_plan(MOTOR, [(3.10, 2.0)]).fullest == pytest.approx(1.0)


class Still:
    """A machine that does not move."""

    position_rad = velocity_rad_s = cart_position_m = belt_force_n = 0.0

    def step(self, torque_nm: float, duration_s: float) -> None:
        pass


@pytest.mark.parametrize("torque_nm", [2.0, 3.10])
def test_the_store_is_full_when_the_virtual_drive_says_so(torque_nm: float) -> None:
    """Its power stage has its own I²t, in ticks of 1 ms."""
    stage = PowerStage(Still(), EMMS_AS_70, 0.0, 0.0, 0, Faults(), (0.0, 0.0), IDEAL, 1e-3)
    heat, ticks = HeatStore(1.43, 0.0), 0
    stage.switch_on()
    while not stage.i2t_exceeded:
        heat.add(1e-3 * ticks, torque_nm)
        stage.run(torque_nm, 1e-3 * ticks)
        ticks += 1
    assert heat.excess_s == pytest.approx(MOTOR.store_s, rel=2e-3)
    assert heat_plan(MOTOR, [(torque_nm, 1e-3 * ticks)]).fullest == pytest.approx(1.0, rel=2e-3)
    heat.moved_until(10.0)
    assert heat.rest_until(11.0) == pytest.approx(MOTOR.store_s - 1.0, rel=2e-3)
    assert heat.rest_until(30.0) == 0.0


def test_the_rms_of_a_path_is_that_of_its_torque() -> None:
    """Half the time ±2 m/s² with 3 kg behind 0.01 m/rad, half at rest:  (0.01/0.01 ... ) worked out by hand."""
    a = np.array([2.0, 2.0, -2.0, -2.0, 0.0, 0.0, 0.0, 0.0])
    v = np.array([1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    path = Trajectory(np.arange(8.0), np.zeros(8), v, a)
    torque = (1e-4 / 0.01 + 0.01 * 3.0) * 2.0  # 0.08 N m
    by_hand = math.sqrt((2 * (torque + 0.05) ** 2 + 2 * (0.05 - torque) ** 2) / 8)
    assert path_rms_nm(path, 1e-4, 0.01, 3.0, 0.05) == pytest.approx(by_hand)


def test_the_weaker_of_motor_and_drive_counts(capabilities: Capabilities) -> None:
    known = replace(capabilities, overload_time_s=1.5, rated_torque_nm=1.40)
    assert Thermal.of(RIG, known) == Thermal(1.40, 3.10, 1.5, "the drive's own I²t time")
    shorter = replace(RIG, motor=replace(RIG.motor, overload_time_s=1.0))
    assert Thermal.of(shorter, known).overload_s == 1.0
    assert "assumed" in Thermal.of(RIG, capabilities).source


def test_the_plan_says_its_thermal_share_and_what_it_assumes(capabilities: Capabilities) -> None:
    plan = replace(identify_plan(RIG, capabilities), thermal=Thermal.of(RIG, capabilities))
    text = "\n".join(plan.lines())
    assert "60 % of the continuous rating (S1) on average, 75 % in the hottest experiment" in text  # 75 % is (1.24/1.43)²
    assert "overload of 3.1 N m for 2 s (assumed: neither axis.yaml nor the drive tells)" in text
    assert plan.heat_dict()["heat"]["hottest"] == pytest.approx((1.24 / 1.43) ** 2, rel=1e-3)


def test_what_was_driven_took_less_heat_than_planned(complete: Complete, capabilities: Capabilities) -> None:
    plan = replace(commission_plan(RIG, capabilities), thermal=MOTOR)
    assert plan.heat is not None
    squares = [(float(np.mean(r.torque**2)), float(np.ptp(r.t_s))) for r in complete.folder.recordings()]
    taken = sum(square * seconds for square, seconds in squares) / sum(seconds for _, seconds in squares) / 1.43**2
    assert 0.0 < taken < plan.heat.continuous
    assert max(square for square, _ in squares) / 1.43**2 < plan.heat.hottest
    assert complete.folder.load("results", "plan")["heat"]["continuous"] == pytest.approx(plan.heat.continuous, rel=1e-3)


@pytest.mark.parametrize(("plant", "shipped"), [("linear_motor", "linear-motor"), ("torque_table", "torque-table")])
def test_an_axis_without_a_stated_motion_is_planned_with_a_gentle_one(plant: str, shipped: str) -> None:
    """As ``init`` leaves it: the move is this side's own choice, a third of the force that the load bears, and no reason to refuse."""
    axis = replace(load_axis(shipped), trajectories={})
    with open_drive(f"virtual:{plant}", {"seed": 1}) as drive:
        thermal = Thermal.of(axis, drive.capabilities)
        plan = replace(commission_plan(axis, drive.capabilities), thermal=thermal)
    assert plan.heat_fault() == ""
    move = plan.experiments[-1]
    rated = axis.motor.rated_torque_nm
    assert rated is not None
    assert move.rms_nm is not None
    assert 0.3 * rated < move.rms_nm < 1.5 * rated


@pytest.mark.parametrize("rated_nm", [0.5, 0.64, 0.9])
def test_fast_moves_on_a_belt_that_bears_more_than_the_motor_heat_it_no_more_than_it_bears(
    capabilities: Capabilities, rated_nm: float
) -> None:
    motor = replace(RIG.motor, rated_torque_nm=rated_nm, peak_torque_nm=3.0 * rated_nm)
    limits = replace(RIG.limits, acceleration_m_s2=8.0, feed_force_n=400.0, pulley_torque_nm=None)
    axis = replace(RIG, motor=motor, limits=limits, trajectories={})
    own = replace(capabilities, rated_torque_nm=rated_nm, peak_torque_nm=3.0 * rated_nm)
    plan = replace(commission_plan(axis, own), thermal=Thermal.of(axis, own))
    assert plan.heat_fault(axis) == ""
    (moves,) = (item for item in plan.experiments if item.title.startswith("fast moves"))
    assert 0.5 * rated_nm < moves.heating_nm <= rated_nm


def test_a_weak_motor_bounds_the_excitation(capabilities: Capabilities) -> None:
    """A binary excitation heats with its amplitude:  a² + τ_g² ≤ τ_rated²."""
    weak = replace(RIG, motor=replace(RIG.motor, rated_torque_nm=0.5))
    assert phases.excitation_torque_nm(weak, capabilities, 0.0) == pytest.approx(0.5)
    assert phases.excitation_torque_nm(weak, capabilities, 0.3) == pytest.approx(0.4)
    assert phases.excitation_torque_nm(RIG, capabilities, 0.0) == pytest.approx(1.24, rel=1e-2)
    plan = replace(identify_plan(weak, capabilities), thermal=Thermal.of(weak, capabilities))
    assert plan.heat is not None
    assert plan.heat.hottest == pytest.approx(1.0)


def overloading(capabilities: Capabilities, seconds: float) -> Plan:
    plan = move_plan(RIG, 0.1, 0.1, 1.0, 2.86, 90.0, seconds, "move hard")
    return replace(plan, experiments=plan.experiments * 2, thermal=Thermal.of(RIG, capabilities))


def test_a_plan_beyond_continuous_is_spread_by_pauses_and_one_beyond_the_store_refused(capabilities: Capabilities) -> None:
    spread = overloading(capabilities, 1.5)
    assert "The motor rests for up to 4 s in all between the experiments" in "\n".join(spread.lines())
    assert spread.heat_fault() == ""
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        with pytest.raises(Refused, match=r"the motor would be overloaded: move takes up to 2\.86 N m \(rms\) for 10 s.*nothing was moved"):
            agree(overloading(capabilities, 10.0), Options(yes=True), Silence(), drive, RIG)
        shown = plan_result(overloading(capabilities, 10.0), drive.capabilities, Options(), RIG)
    assert shown.exit_code == 1
    assert any("This plan will be refused" in line for line in shown.text)
