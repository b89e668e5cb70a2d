"""What a commissioning records: the programme, the paths of its steps, the time it keeps, and what it could name."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.axis import Axis, load_axis
from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.drive import Capabilities, open_drive
from beltcomm.excitation import choose_prbs, prbs
from beltcomm.experiments import detectability, phases
from beltcomm.experiments import detectability as foresight
from beltcomm.experiments.bounds import bounds_of, course_before
from beltcomm.experiments.detectability import Detectability, _foresee, _lines_of
from beltcomm.experiments.execute_step import _at_place, _holding_at, quieter
from beltcomm.experiments.options import Options
from beltcomm.experiments.paths import path_of, start_of
from beltcomm.experiments.plan import Plan, commission_plan
from beltcomm.experiments.raising import _believable
from beltcomm.fit.start.first_estimate import data_sheet_model
from beltcomm.recording import Recording
from beltcomm.rundata import analyse
from beltcomm.schedule import record_schedule
from beltcomm.schedule.orders import sweep_strokes
from beltcomm.schedule.record_schedule import BUDGET_S, BY_EXTENT, STANDARD, THOROUGH, Extent, Item, fitting_records, named_steps
from beltcomm.schedule.sequences import calmer_choice
from beltcomm.schedule.steps import Step
from beltcomm.simulate.forward import simulate_torque
from session.conftest import Complete

AXIS = load_axis("egc-70-600")
STEPS = [item.step for item in (*STANDARD, *THOROUGH)]


@pytest.fixture(scope="module")
def capabilities() -> Capabilities:
    with open_drive("virtual:g_a", {"seed": 1}) as drive:
        return drive.capabilities


def test_the_thorough_session_holds_what_the_diagnosis_needs() -> None:
    steps = [item.step for item in THOROUGH]
    fitted = [s for s in steps if s.kind == "response" and not s.held_out]
    assert all(len({s.share for s in fitted if s.place == place}) >= 2 for place in (0.12, 0.5, 0.88)), "amplitudes at every place"
    strokes = [s for s in steps if s.kind == "strokes"]
    assert len({s.place for s in strokes}) == 3
    assert all(min(s.speeds_m_s) <= 0.01 for s in strokes)
    assert {"reversals", "moves"} <= {s.kind for s in steps}
    assert steps[0].kind == steps[-1].kind == "sweep", "a first and a last one, for what warms up"
    (response,) = [s for s in steps if s.kind == "response" and s.held_out]
    assert response.place not in {s.place for s in fitted}
    assert response.share not in {s.share for s in fitted}
    assert any(s.kind == "moves" and s.held_out and s.seconds for s in steps)


@pytest.mark.parametrize("extent", ["quick", "standard", "thorough"])
def test_the_plan_keeps_its_time(capabilities: Capabilities, extent: str) -> None:
    plan = commission_plan(AXIS, capabilities, extent)  # type: ignore[arg-type]
    assert plan.seconds <= BUDGET_S[extent]
    assert len(plan.experiments) >= len(BY_EXTENT[extent]) + 3, "every experiment has its line"
    assert max(e.belt_force_n for e in plan.experiments) <= AXIS.belt_force_limit_n


@pytest.mark.parametrize("mass_kg", [0.3, 13.4, 30.0])
@pytest.mark.parametrize("step", [s for s in STEPS if s.kind != "response"], ids=lambda s: s.title(0.0))
def test_paths_rest_at_both_ends_and_keep_their_bounds(capabilities: Capabilities, step: Step, mass_kg: float) -> None:
    course = course_before(AXIS, capabilities, mass_kg)
    path = path_of(step, course, start_of(step, course))
    low, high = course.ends_m
    slack = 1e-9
    assert low - slack <= path.position_m.min() <= path.position_m.max() <= high + slack
    assert path.velocity_m_s[0] == path.velocity_m_s[-1] == 0.0
    bounds = bounds_of(AXIS, capabilities, step)
    assert np.abs(path.velocity_m_s).max() <= bounds.speed_m_s + slack
    assert np.ptp(path.position_m) <= bounds.travel_m + slack
    assert mass_kg * np.abs(path.acceleration_m_s2).max() <= bounds.belt_force_n * (1.0 + 1e-6)
    if mass_kg != 13.4 and not (step.kind == "moves" and step.seconds):
        assert path.duration_s < bounds.seconds, "lightest and heaviest bound every carriage"


def test_triangles_turn_where_they_should(capabilities: Capabilities) -> None:
    course = course_before(AXIS, capabilities, 13.4)
    path = path_of(Step("reversals", amplitudes_m=(1e-3, 2e-4)), course, 0.25)
    turns = path.position_m[1:-1][(np.diff(np.sign(np.diff(path.position_m))) != 0) & (np.diff(path.position_m)[:-1] != 0)] - 0.25
    assert sorted({round(abs(1e3 * t), 3) for t in turns} - {0.0}) == [0.2, 1.0]
    assert np.abs(path.velocity_m_s).max() == pytest.approx(4e-3, rel=0.01)


def test_random_moves_are_the_same_for_a_seed_and_slow_ones_are_among_them(capabilities: Capabilities) -> None:
    course, step = course_before(AXIS, capabilities, 13.4), Step("moves", share=0.5, seconds=11.0, seed=1, held_out=True)
    path, again = (path_of(step, course, start_of(step, course)) for _ in range(2))
    assert np.array_equal(path.position_m, again.position_m)
    other = path_of(replace(step, seed=2), course, start_of(step, course))
    assert len(other.position_m) != len(path.position_m) or not np.array_equal(other.position_m, path.position_m)
    assert path.duration_s <= 11.0 + 1.0
    moving = np.abs(path.velocity_m_s[np.abs(path.velocity_m_s) > 1e-4])
    assert moving.min() < 0.05 < moving.max()


def test_what_does_not_fit_is_left_out_by_rank() -> None:
    items = [Item(Step("sweep")), Item(Step("moves"), 2), Item(Step("reversals", amplitudes_m=(1e-3,)), 1), Item(Step("strokes"), 3)]
    seconds = {"sweep": 10.0, "moves": 5.0, "reversals": 4.0, "strokes": 1.0}
    made, left = fitting_records(items, lambda step: seconds[step.kind], 15.0)
    assert [s.kind for s in made] == ["sweep", "reversals", "strokes"], "in the order in which they are made"
    assert [s.kind for s in left] == ["moves"]


def test_names_count_and_leave_those_that_are_taken() -> None:
    steps = [Step("sweep"), Step("response"), Step("response"), Step("sweep", again=True), Step("moves")]
    assert [name for name, _ in named_steps(steps, ("frf_1",))] == ["sweep", "frf_2", "frf_3", "sweep_2", "moves_1"]


def test_a_quieter_excitation_still_overcomes_friction() -> None:
    assert quieter(0.23, 0.125, 1.0) == pytest.approx(0.23)
    assert 0.125 < quieter(0.23, 0.125, 0.3) < quieter(0.23, 0.125, 0.6) < 0.23
    assert quieter(0.23, 0.3, 0.3) == pytest.approx(0.23), "there is nothing between friction and what the limits allow"


def test_a_calmer_sequence_loads_the_belt_less() -> None:
    """At equal torque the belt carries clearly less, and the carriage goes no further."""
    assert AXIS.belt is not None
    stiff = replace(AXIS, belt=replace(AXIS.belt, specific_stiffness_n=106250.0))  # by the data sheet
    model = data_sheet_model(stiff, 0.25, 0.0)
    antiresonance, resonance = analyse.characteristic_hz(model, 0.25)
    usual = choose_prbs(1e-3, antiresonance, resonance, 7.0)
    found = []
    for choice in (usual, calmer_choice(usual, resonance, 1e-3)):
        moved = simulate_torque(model, prbs(choice.order, choice.clock, 0.4, 1e-3, choice.repeats).torque, 1e-3, 0.25)
        found.append((np.abs(moved.belt_force_n).max(), np.ptp(moved.cart_position_m)))
    assert found[1][0] < 0.7 * found[0][0]
    assert found[1][1] < 1.3 * found[0][1]


def test_what_holds_the_axis_is_half_the_difference_of_both_breakaways() -> None:
    assert phases.Breakaway(0.14, 0.06).holding_nm == pytest.approx(0.04)
    assert phases.Breakaway(0.101, 0.100).holding_nm == 0.0, "that is the scatter of friction"


def test_what_the_records_could_name_is_said_beforehand(capabilities: Capabilities) -> None:
    found = _foresee(AXIS, capabilities, "quick")
    entries = {entry["effect"]: entry for entry in found.to_dict()["effects"]}
    assert entries["stribeck"]["seen"]
    assert 0.0 < entries["stribeck"]["weakest"] < 0.02
    assert not entries["belt_slack"]["seen"], "100 N of belt force cannot make a belt slack"
    whole, brief = ("\n".join(_lines_of(found.to_dict(), whole)) for whole in (True, False))
    assert len(whole.splitlines()) - 2 == sum(entry["seen"] for entry in entries.values())
    assert len(brief.splitlines()) < 0.6 * len(whole.splitlines())
    assert all(f"{name} " in brief for name in entries)
    assert all(f"{name} " in whole for name in entries)
    text = brief
    assert "carriage 2 kg" in text
    assert "belt_slack (" in text.splitlines()[-1]
    assert "--thorough" in text.splitlines()[-1]


def test_a_first_estimate_stays_within_what_can_be() -> None:
    """Inside a gap the motor feels a feather on a rod; as soon as the gap is crossed, ten kilograms."""
    sheet = data_sheet_model(AXIS, 0.25, 0.1)
    usual = sheet.with_values({"cart.mass": 5.0})
    assert _believable(usual, sheet, 0.3) is usual
    bounded = _believable(sheet.with_values({"cart.mass": 0.09, "belt_stiffness.stiffness": 5.5e6}), sheet, 0.3)
    assert bounded["cart.mass"] == 0.3
    assert bounded["belt_stiffness.stiffness"] == pytest.approx(4.0 * sheet["belt_stiffness.stiffness"])


def test_slow_strokes_keep_to_where_a_drifting_loop_may_turn() -> None:
    with open_drive("virtual:g_a", {"seed": 1, "profile": "cmmp-as"}) as drive:
        plan = commission_plan(AXIS, drive.capabilities, "thorough")
        course = course_before(AXIS, drive.capabilities, 13.4)
    assert plan.seconds <= 180.0
    step = Step("strokes", 0.88, speeds_m_s=(0.01,))
    path = path_of(step, course, start_of(step, course))
    assert course.ends_m[0] <= path.position_m.min() < path.position_m.max() <= course.ends_m[1]


def test_what_holds_the_carriage_is_read_off_the_strokes() -> None:
    """A tilt of 20 mN m and a chain of 0.1 N m per metre beside friction and noise; nothing where friction alone is there."""
    speed = np.repeat([0.05, -0.05, 0.5, -0.5], 1000) / 0.01242
    angle = np.cumsum(speed) * 1e-3
    noise = np.random.default_rng(5).normal(0.0, 6e-3, len(speed))
    friction = 0.1 * np.sign(speed) + 2e-3 * speed + noise
    for load in (0.02 + 0.1 * 0.01242 * angle, np.zeros(len(speed))):
        columns = {"torque": friction + load, "position": angle, "reference_velocity": speed}
        held = [_holding_at(Recording("sweep", 1e-3 * np.arange(len(speed)), **columns), 0.01242, x) for x in (0.1, 0.4)]
        assert held == pytest.approx([0.03, 0.06] if load.any() else [0.0, 0.0], abs=1e-3)


def test_a_short_sweep_of_a_heavy_carriage_is_slower_in_proportion() -> None:
    assert record_schedule.quick_speeds_m_s(5.0) == pytest.approx(record_schedule.QUICK_M_S)
    assert record_schedule.quick_speeds_m_s(2.5) == pytest.approx([0.5 * speed for speed in record_schedule.QUICK_M_S])


class Counted:
    """What the records could show, counted how often it is worked out."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self, axis: Axis, capabilities: Capabilities, extent: Extent) -> Detectability:
        self.times += 1
        return Detectability((), f"assumed {self.times}", 3, extent)


def test_the_default_plan_says_what_its_records_could_name_and_keeps_it(
    capabilities: Capabilities, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(detectability, "user_cache_path", lambda _: tmp_path)
    found = Counted()
    monkeypatch.setattr(foresight, "_foresee", found)
    bare = Plan("", (), notes=("first",))
    told = [foresight.with_detectability(bare, AXIS, capabilities, Options()) for _ in range(2)]
    assert found.times == 1, "the second time it is read from the cache"
    assert told[0] == told[1]
    assert told[0].notes[0] == "first"
    assert "assumed 1" in told[0].notes[1]
    assert told[0].visible is not None
    quick = foresight.with_detectability(bare, AXIS, capabilities, Options(quick=True))
    assert found.times == 1
    assert quick.visible is None
    assert "--visible" in quick.notes[-1]
    foresight.with_detectability(bare, AXIS, replace(capabilities, counts_per_rev=4096), Options())
    assert found.times == 2, "another encoder sees other things"
    foresight.with_detectability(bare, AXIS, capabilities, Options())
    assert found.times == 2, "two drives in turn are both known"


def test_strokes_fit_into_a_short_travel_however_slowly_their_acceleration_rises() -> None:
    """Limits of the same path with its time stretched: acceleration over jerk grows as they fall."""
    limits = TrajectoryLimits(jerk_m_s3=20.0 * 9.0, acceleration_m_s2=9.0, speed_m_s=2.8)
    for share in phases.STOPPABLE_SHARES:
        sent = sweep_strokes(0.026, 0.4, limits.slower(share), 1e-3).trajectory
        assert 0.0 < np.abs(sent.velocity_m_s).max() <= 0.8 * share * 2.8
        assert (sent.position_m.min(), sent.position_m.max()) == pytest.approx((0.026, 0.4), abs=1e-3)


def test_a_response_is_planned_with_the_stiffness_that_the_belt_has_at_its_place(complete: Complete) -> None:
    """EA/l1 + EA/(2 l3 - l1), from where the first response was made, in the middle; without its lengths it stays as it is."""
    machine: Any = SimpleNamespace(axis=AXIS, folder=complete.folder, position_m=0.02, place_m=lambda at_m: at_m)
    found_m = complete.folder.recording("frf_1").sidecar.start_position_m
    assert found_m is not None
    model = data_sheet_model(AXIS, found_m, 0.1).with_values({"belt_stiffness.stiffness": 2e5})
    shares = [1.0 / (0.05 + x) + 1.0 / (1.58 - 0.05 - x) for x in (0.02, found_m)]
    assert _at_place(machine, model)["belt_stiffness.stiffness"] == pytest.approx(2e5 * shares[0] / shares[1])
    machine.axis = replace(AXIS, travel=replace(AXIS.travel, driven_side_offset_m=0.0))
    assert _at_place(machine, model) == model
    machine.axis, machine.position_m = AXIS, found_m
    assert _at_place(machine, model) == model
    machine.position_m, machine.place_m = -0.05, lambda _: None  # from where it began, which nobody knows
    assert _at_place(machine, model) == model
