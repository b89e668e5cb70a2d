"""Tilted axes: what holds the carriage, found by two ways on the independent simulator, and that it never falls."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import Axis, Mounting, load_axis
from beltcomm.errors import DriveError, Refused, UsageError
from beltcomm.experiments import execute_step, holding
from beltcomm.machine import gravity, stops
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.stopping import Braking, Stop
from beltcomm.trajectory import constant_speed_strokes
from session.bench import RATIO, Bench, Listener
from truth.plant import TruthPlant
from truth.rigs import nominal

MakeBench = Callable[..., Bench]
UPRIGHT, TILTED = "egc-70-600-vertical", "egc-70-600-25deg"
#: N m: three deviations of a mean over 0.3 s in 6 mN m of noise, and how much of 0.1 % of rated torque (1.43 mN m) rounding can leave.
MEAN_NM = 3.0 * 6e-3 / math.sqrt(300.0) + 0.5e-3
#: m: what the first motions may take, and the excitations with their stop.
FIRST_ROOM_M, ROOM_M = 10e-3, 36e-3


def tilted(rig: str, tilt_deg: float) -> TruthPlant:
    """The thesis's rig on the independent simulator, tilted."""
    level = nominal(rig)
    return TruthPlant(replace(level.axis, tilt_rad=math.radians(tilt_deg)), truth=level.truth)


def holding_torque_nm(plant: TruthPlant) -> float:
    """i_t m_c g sin(α)."""
    axis = plant.axis
    return axis.transmission_m_rad * axis.mass_kg * 9.80665 * math.sin(axis.tilt_rad)


def standing(axis: Axis | str, tilt_deg: float, **motor: Any) -> Axis:
    """An axis file with another tilt and brake."""
    known = load_axis(axis) if isinstance(axis, str) else axis
    return replace(known, mounting=Mounting(tilt_deg), motor=replace(known.motor, **motor))


@pytest.fixture
def soft_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    """The search for the hardest stop takes seconds and is examined in tests/test_stopping.py: here any that is soft enough.  A second of
    response less is no worse here."""
    monkeypatch.setattr(execute_step, "RESPONSE_S", 5.0)
    found = Braking(1.5, 0.06, 5e-3), Stop(0.0, 0.0)
    monkeypatch.setattr(stops, "braked_by_loop", lambda *_args, **_kwargs: found)


def furthest_m(bench: Bench) -> float:
    """How far the carriage was from where it began, at most."""
    return float(np.max(np.abs(bench.plant.cart_m(0, len(bench.plant.torque_nm)))))


@pytest.mark.parametrize(
    ("rig", "tilt_deg", "axis", "drive"),
    [("g_b", 90.0, UPRIGHT, "g_b_vertical"), pytest.param("g_a", 25.0, TILTED, "g_a_25deg", marks=pytest.mark.examination)],
)
@pytest.mark.usefixtures("soft_stops")
def test_identify_holds_the_axis_and_finds_it(
    make_bench: MakeBench, tmp_path: Path, rig: str, tilt_deg: float, axis: str, drive: str
) -> None:
    plant = tilted(rig, tilt_deg)
    bench = make_bench(name=f"virtual:{drive}", plant=plant)
    result = api.identify(bench.name, axis, tmp_path / "run", options=api.Options(yes=True, seed=1))
    data, truth, torque = result.to_json(), plant.truth, holding_torque_nm(plant)
    for name, real in (("cart.mass", truth["mass_kg"]), ("belt_stiffness.stiffness", truth["stiffness_n_m"])):
        found = data["model"]["parameters"][name]
        assert abs(found["value"] - real) <= found["interval"], name
        assert found["interval"] < 0.02 * real
    ways, friction = data["gravity"], truth["coulomb_total_nm"]
    for way in (ways["breakaway"], ways["creep"]):  # (b): friction cancels
        assert abs(way["torque_nm"] - torque) <= way["interval_nm"]
        assert way["interval_nm"] < 0.05 * friction
    below, above = ways["integrators"]  # (a): anywhere within friction, at the side that it came from
    for settled in (below, above):
        assert settled["stood"]
        assert abs(settled["torque_nm"] - torque) <= friction + MEAN_NM
        assert settled["low_nm"] - MEAN_NM <= torque <= settled["high_nm"] + MEAN_NM
    assert above["torque_nm"] - below["torque_nm"] > 1.5 * friction
    assert "held by the brake (2 N m)" in "\n".join(result.details)
    assert "mN m: that fits" in "\n".join(result.details)
    assert "(a) slow integrating controller, from above" in (tmp_path / "run" / "journal.txt").read_text(encoding="utf-8")
    assert furthest_m(bench) < ROOM_M
    # of the first motions too, before a loop is known: no stop lets the carriage fall into its closing brake (this plant begins with a
    # belt that nothing has stretched yet: it swings for a second)
    assert np.max(np.abs(bench.plant.belt_force_n[1000:])) < load_axis(axis).belt_force_limit_n
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


def test_too_steep_is_refused_before_anything_moves(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(name="virtual:g_a_25deg", plant=tilted("g_a", 60.0))
    with pytest.raises(Refused, match=r"1\.29 N m hold .* takes 1\.53 N m .* are 1\.12 N m at the motor; with 12\.2 kg up to 36 deg"):
        api.identify(bench.name, standing(TILTED, 60.0), tmp_path / "run", options=api.Options(yes=True))
    assert bench.opened == 0
    # 90 % of 1.24 N m less friction of twice 10 % of it, over the weight of 11.2 kg and a carriage of 1 kg
    steepest = math.degrees(math.asin(0.7 * 1.24 / (RATIO * 12.2 * 9.80665)))
    gravity.suitable(standing(TILTED, steepest - 0.1))
    with pytest.raises(Refused):
        gravity.suitable(standing(TILTED, steepest + 0.1))
    with pytest.raises(Refused):
        gravity.suitable(standing(TILTED, -steepest - 0.1))
    gravity.suitable(standing(UPRIGHT, 90.0))


def test_what_axis_yaml_must_say() -> None:
    nothing = replace(load_axis(TILTED), payload=replace(load_axis(TILTED).payload, mass_kg=None))
    with pytest.raises(UsageError, match=r"needs payload\.mass_kg"):
        gravity.suitable(nothing)
    gravity.suitable(replace(nothing, mounting=Mounting(2.9)))
    with pytest.raises(Refused, match=r"stands upright \(90 deg\) and no brake is stated"):
        gravity.suitable(standing(UPRIGHT, 90.0, brake_torque_nm=None))
    gravity.suitable(standing(UPRIGHT, 60.0, brake_torque_nm=None))  # what friction holds is found on the machine
    with pytest.raises(Refused, match=r"brake of 0\.5 N m .* is too weak"):
        gravity.suitable(standing(TILTED, 25.0, brake_torque_nm=0.5))
    with pytest.raises(UsageError, match="would let it fall"):
        api.move("virtual:g_a_25deg", TILTED, 5e-3, options=api.Options(yes=True))


@pytest.mark.parametrize(("stated_deg", "words"), [(-25.0, "sign of mounting.tilt_deg"), (15.0, "")])
def test_a_wrong_tilt_is_felt(
    make_bench: MakeBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, stated_deg: float, words: str
) -> None:
    """With the wrong sign it is refused; 10 degrees too few are found in some tries.  It never slips out of the room of first motions."""
    bench = make_bench(name="virtual:g_a_25deg", plant=tilted("g_a", 25.0))
    monkeypatch.setattr(holding, "_break_away", reached)
    with pytest.raises(Refused if words else Reached, match=words or "0\\."):
        api.identify(bench.name, standing(TILTED, stated_deg), tmp_path / "run", options=api.Options(yes=True))
    assert "do not hold the carriage" in (tmp_path / "run" / "journal.txt").read_text(encoding="utf-8")
    assert furthest_m(bench) < FIRST_ROOM_M
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


class Reached(Exception):
    """A torque that holds was found."""


def reached(_machine: Any, torque_nm: float, release: bool) -> None:
    assert release
    assert abs(torque_nm - holding_torque_nm(tilted("g_a", 25.0))) < nominal("g_a").truth["coulomb_total_nm"]
    raise Reached(str(torque_nm))


def test_torque_and_encoder_that_count_apart(make_bench: MakeBench, tmp_path: Path) -> None:
    """The least that a wrong polarity does: nothing is closed on it, and the brake stops what moved."""
    from beltcomm.virtual.faults import Faults

    bench = make_bench(name="virtual:g_a_25deg", plant=tilted("g_a", 25.0), referenced=False, faults=Faults(encoder_sign=-1))
    with pytest.raises((DriveError, Refused), match="polarity"):
        api.identify(bench.name, TILTED, tmp_path / "run", options=api.Options(yes=True, position_m=0.25))
    assert furthest_m(bench) < FIRST_ROOM_M
    assert bench.stands_disabled()


@pytest.mark.parametrize(("phase", "speed_rad_s"), [(1, 1.0), (2, 4.0)])
@pytest.mark.usefixtures("soft_stops")
def test_ctrl_c_ends_held(make_bench: MakeBench, tmp_path: Path, phase: int, speed_rad_s: float) -> None:
    bench = make_bench(name="virtual:g_a_25deg", plant=tilted("g_a", 25.0))

    def arm(index: int) -> None:
        if index == phase:
            bench.interrupt_when(bench.faster_than(speed_rad_s))

    with pytest.raises(KeyboardInterrupt):
        api.identify(bench.name, TILTED, tmp_path / "run", options=api.Options(yes=True, seed=1), talk=Listener(at_phase=arm))
    assert bench.signals == 1
    assert furthest_m(bench) < FIRST_ROOM_M
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


def test_nothing_holds_it(make_bench: MakeBench, tmp_path: Path) -> None:
    """A heavy tilted carriage without a brake slides already: said, and no stage is switched on."""
    bench = make_bench(name="virtual:g_a", plant=tilted("g_a", 25.0))
    with pytest.raises(Refused, match=r"moves by itself, -\d+\.\d\d mm in 0\.3 s, with the stage off, which has no brake"):
        api.identify(bench.name, standing(TILTED, 25.0, brake_torque_nm=None), tmp_path / "run", options=api.Options(yes=True))
    assert not np.any(bench.plant.torque_nm)


def test_friction_alone_holds_a_light_carriage(make_bench: MakeBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """g_b at 30 degrees: 58 mN m of gravity against 115 of friction, found without a brake; at 60 degrees (101) that is refused."""
    seen = []

    def stop_here(machine: Any, coulomb_nm: float) -> None:
        del machine
        seen.append(coulomb_nm)
        raise Reached

    monkeypatch.setattr(holding, "PAIRS", 2)
    monkeypatch.setattr("beltcomm.experiments.sameness.check_breakaway", stop_here)
    bench = make_bench(name="virtual:g_b", plant=tilted("g_b", 30.0))
    with pytest.raises(Reached):
        api.identify(bench.name, standing(UPRIGHT, 30.0, brake_torque_nm=None), tmp_path / "run", options=api.Options(yes=True))
    assert seen[0] == pytest.approx(0.115, rel=0.25)  # the ramp finds breakaway too high
    said = [line for line in (tmp_path / "run" / "journal.txt").read_text(encoding="utf-8").splitlines() if "hold the carriage" in line]
    assert float(said[0].split("backward: ")[1].split(" ")[0]) == pytest.approx(holding_torque_nm(tilted("g_b", 30.0)), abs=3e-3)
    machine = SimpleNamespace(axis=standing(UPRIGHT, 60.0, brake_torque_nm=None))
    with pytest.raises(Refused, match="no brake is stated"):
        gravity.held_by(machine, 0.101, 0.115)  # type: ignore[arg-type]
    assert gravity.held_by(machine, 0.058, 0.115) == "friction (0.115 N m) alone"  # type: ignore[arg-type]


def test_the_tilt_that_would_work_leaves_the_belt_what_an_excitation_needs() -> None:
    """Of 90 N, 60 N of weight at 27 degrees leave 30; for 32 N the weight must fall to 58 N."""
    machine: Any = SimpleNamespace(axis=standing(TILTED, 27.0), weight_n=60.0)
    works = math.degrees(math.asin(58.0 / 60.0 * math.sin(math.radians(27.0))))
    assert f"up to {works:.0f} deg would work" in gravity.less_steep(machine, 90.0, 32.0)
    assert works < 27.0
    assert "no tilt would work" in gravity.less_steep(machine, 90.0, 95.0)


def test_a_drive_that_cannot_hold_in_its_quick_stop(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(name="virtual:g_a_25deg", plant=tilted("g_a", 25.0))
    with pytest.raises(Refused, match="a quick stop would begin without what holds the carriage"):
        api.identify(bench.name, TILTED, tmp_path / "run", options=api.Options(yes=True, profile="cmmp-as"))
    assert furthest_m(bench) < 1e-3  # the belt's stretch
    with pytest.raises(UsageError, match="homing"):
        api.identify(bench.name, TILTED, tmp_path / "other", options=api.Options(yes=True, home=True))


def test_half_sums_against_a_record_made_by_hand() -> None:
    """Strokes at 4 mm/s with 0.3 N m of gravity, 0.1 of friction and a drift: the half sum has neither friction nor viscous friction."""
    limits = load_axis(TILTED).trajectories["T_A"]
    strokes = constant_speed_strokes(0.1, 0.104, [holding.CREEP_M_S] * 5, limits, 1e-3, run_in_s=0.05, rest_s=0.05, longest_plateau_s=1.0)
    path = strokes.trajectory
    noise = np.random.default_rng(3).normal(0.0, 6e-3, len(path.t_s))
    torque = 0.3 + 0.1 * np.sign(path.velocity_m_s) + 2.0 * path.velocity_m_s + 1e-4 * path.t_s + noise
    record = Recording(
        "holding",
        path.t_s,
        torque,
        path.position_m / RATIO,
        reference_velocity=path.velocity_m_s / RATIO,
        sidecar=Sidecar("reversal", 0.1, closed_loop=True),
    )
    found, friction = holding._half_sums(record, RATIO)
    assert found.torque_nm == pytest.approx(0.3, abs=1.5e-3)
    assert abs(found.torque_nm - 0.3) < found.interval_nm + 6e-4  # the drift over the whole record
    assert friction == pytest.approx(0.108, abs=1e-3)


def test_a_mass_that_does_not_fit_the_tilt_is_said() -> None:
    axis, best = load_axis(TILTED), holding.HoldingTorque(0.692, 5e-4)
    found = holding.Holding(0.63, (0.43, 0.93), best, 0.125, 0.0, "the brake (2 N m)")

    def said(tilt_deg: float, mass_kg: float) -> str:
        mass = SimpleNamespace(value=mass_kg, interval=0.06)
        model: Any = SimpleNamespace(parameters={"cart.mass": mass})
        return holding.plausibility(found, model, replace(axis, mounting=Mounting(tilt_deg)))[0]

    assert "at 25 deg would need 691.8 ± 3.1 mN m: that fits" in said(25.0, 13.44)
    assert "as at a tilt of 25.0 deg: check mounting.tilt_deg" in said(20.0, 13.44)
    assert "a spirit level reads no better" in said(24.5, 13.44)
    assert "more is held than a vertical axis would need" in said(25.0, 5.0)


def test_run_folder_keeps_the_comparison(tmp_path: Path) -> None:
    way = holding.Holding(0.63, (0.43, 0.93), holding.HoldingTorque(0.69, 2e-3), 0.135, 1e-3, "the brake (2 N m)")
    whole = replace(
        way,
        creep=holding.HoldingTorque(0.692, 5e-4),
        creep_coulomb_nm=0.125,
        integrators=(holding.Settled(0.57, 0.53, 1e-4, True),),
    )
    data = whole.to_dict()
    assert data["used"] == {"torque_nm": 0.692, "interval_nm": 5e-4}
    assert (data["integrators"][0]["low_nm"], data["integrators"][0]["high_nm"]) == pytest.approx((0.445, 0.695))
    assert way.best.torque_nm == 0.69
    folder = RunFolder.create(tmp_path / "run", load_axis(TILTED))
    folder.save("results", "gravity", data)
    assert folder.load("results", "gravity")["creep"]["torque_nm"] == 0.692
