"""Closed-loop identification through the CAN bus, on the independent truth machine: short records, judged by the plant's own response."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete

from beltcomm import api
from beltcomm.control import Cascade
from beltcomm.errors import Refused, UsageError
from beltcomm.experiments import loop_plan, loop_record
from beltcomm.identify.loop_response import KnownController, controller_of, plant_response
from beltcomm.recording import Recording
from beltcomm.response import FrequencyResponse
from beltcomm.runfolder import RunFolder
from session.bench import Bench, Listener

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """One rising record, and two measured periods in one stroke."""
    monkeypatch.setattr(loop_plan, "RISES", 1)
    monkeypatch.setattr(loop_record, "RISES", 1)
    monkeypatch.setattr(loop_plan, "PERIODS", 2)


def identify(bench: Bench, run: Path, talk: Any = None, **options: Any) -> api.Result:
    return api.identify(bench.name, axis_of(run), run, options=api.Options(yes=True, seed=1, pictures=False, **options), talk=talk)


def axis_of(run: Path) -> Any:
    return RunFolder.open(run).axis


def true_response(truth: dict[str, float], freq_hz: np.ndarray, sample_s: float = 1e-3) -> np.ndarray:
    """Held torque to motor angle of the moving axis, Coulomb friction a constant: two masses, belt and dampers, by scipy's hold."""
    i, m, c = truth["transmission_m_rad"], truth["mass_kg"], truth["stiffness_n_m"]
    theta, b, d = truth["inertia_kg_m2"], truth["belt_damping_n_s_m"], truth["viscous_nm_s_rad"]
    a = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-(i**2) * c / theta, i * c / theta, -(i**2 * b + d) / theta, i * b / theta],
            [i * c / m, -c / m, i * b / m, -b / m],
        ]
    )
    b_torque = np.array([[0.0], [0.0], [1.0 / theta], [0.0]])
    discrete_a, discrete_b, *_ = cont2discrete((a, b_torque, np.eye(4), np.zeros((4, 1))), sample_s)
    z = np.exp(2j * np.pi * freq_hz * sample_s)
    return np.array([np.linalg.solve(one * np.eye(4) - discrete_a, discrete_b)[0, 0] for one in z])


def agrees(found: FrequencyResponse, truth: dict[str, float], highest_hz: float, least: int) -> None:
    """Within the radius that holds 95 % of the noise's errors: of many lines no more than 10 % outside, of few three deviations, no bias.

    Bias: the mean of the errors over their noise has a standard deviation of 1/√n and the noise of two periods is known to a factor.
    """
    lines = (found.freq_hz > 2.0) & (found.freq_hz < highest_hz)
    off = (found.h - true_response(truth, found.freq_hz))[lines]
    assert lines.sum() >= least
    assert np.mean(np.abs(off) > found.error_radius()[lines]) < max(0.10, 0.05 + 3.0 * np.sqrt(0.05 * 0.95 / lines.sum()))
    share = np.abs(found.h[lines] / true_response(truth, found.freq_hz)[lines])
    strong = (found.noise / np.abs(found.h))[lines] < 0.2
    assert abs(np.mean(20.0 * np.log10(share[strong]))) < 0.1


def table(result: api.Result) -> dict[tuple[str, str], dict[str, Any]]:
    return {(way["record"], way["way"]): way for way in result.to_json()["ways"]}


@pytest.mark.examination
@pytest.mark.usefixtures("fitted")
def test_the_ways_agree_with_the_plant_and_moving_takes_friction_away(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    """thesis.md 2.7: around standstill friction poses as damping; truth in motion is 2.53 mN m s/rad (A.10)."""
    run, bench = copy_of_complete(), make_bench()
    folder, truth = RunFolder.open(run), bench.plant.truth
    by_torque = identify(bench, run, loop="indirect")
    record = folder.recording("indirect_1")
    agrees(plant_response(record, "direct"), truth, 150.0, 100)
    agrees(plant_response(record, "indirect"), truth, 150.0, 100)
    wrong_controller(record)
    by_speed = identify(bench, run, loop="setpoint", base_speed_m_s=0.12)
    agrees(plant_response(folder.recording("setpoint_1"), "setpoint"), truth, 60.0, 50)
    assert folder.recording("setpoint_1").torque_offset is None

    found = table(by_torque) | table(by_speed)
    for key in (("indirect_1", "indirect"), ("setpoint_1", "setpoint")):
        damping = found[key]["damping"]
        assert damping["value"] == pytest.approx(truth["viscous_nm_s_rad"], abs=1.5 * damping["interval"])
        assert damping["interval"] < 0.3 * truth["viscous_nm_s_rad"]
        assert found[key]["resonance"]["value"] == pytest.approx(truth["resonance_hz"], rel=0.01)
    (standing,) = (way for way in by_torque.to_json()["ways"] if way["way"] == "open")
    assert standing["damping"]["value"] > 5.0 * truth["viscous_nm_s_rad"]
    assert any("poses as damping" in line or "reverses" in line for line in by_torque.lines())

    assert 0.0 < by_torque.to_json()["slowest_share"] < 1.0
    kept = np.loadtxt(run / "results" / "indirect_1_indirect.csv", delimiter=",", skiprows=1)
    assert kept[:, 1] == pytest.approx(plant_response(record, "indirect").h.real)
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


def wrong_controller(record: Recording) -> None:
    """(3.22) with C' = 1.2 C:  Ĝ'/Ĝ = (1 - S C)/(1 - S C')  exactly, so a bias below the crossover and hardly one above."""
    known = controller_of(record.sidecar.controller, record.name)
    doubted = replace(
        known, cascade=replace(known.cascade, kp_nm_s_rad=1.2 * known.cascade.kp_nm_s_rad, ki_nm_rad=1.2 * known.cascade.ki_nm_rad)
    )
    other = replace(record, sidecar=replace(record.sidecar, controller=doubted.to_dict()))
    right, wrong = plant_response(record, "indirect"), plant_response(other, "indirect")
    late = np.exp(-2j * np.pi * right.freq_hz * known.delay_s)
    through = right.h * late / (1.0 + right.h * late * known.feedback(right.freq_hz))
    expected = (1.0 - through * known.feedback(right.freq_hz)) / (1.0 - 1.2 * through * known.feedback(right.freq_hz))
    assert wrong.h / right.h == pytest.approx(expected, rel=1e-6)
    shift = np.abs(20.0 * np.log10(np.abs(wrong.h / right.h)))
    assert shift[0] > 1.0
    assert np.median(shift[right.freq_hz > 40.0]) < 0.05


def test_the_sidecar_holds_what_the_indirect_way_needs() -> None:
    known = KnownController(Cascade(0.05, 0.2, 3.0, 0.002), "velocity", 1e-3, 0.9e-3)
    assert controller_of(known.to_dict(), "x") == known


@pytest.mark.usefixtures("fitted")
def test_a_plan_shows_the_base_speed_and_moves_nothing(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()
    before = RunFolder.open(run).finished_names()
    result = identify(bench, run, loop="direct", base_speed_m_s=0.02, dry_run=True)
    assert result.to_json()["base_speed_m_s"] == 0.02
    assert "20 mm/s" in "\n".join(result.lines())
    assert result.to_json()["bound_by"] == "turning round"
    assert bench.plant.cart_position_m == 0.0
    assert bench.parameters() == bench.initial
    assert RunFolder.open(run).finished_names() == before


@pytest.mark.usefixtures("fitted")
def test_what_cannot_be_is_refused_with_the_reason(make_bench: MakeBench, copy_of_complete: Copy, tmp_path: Path) -> None:
    run, bench = copy_of_complete(), make_bench()
    with pytest.raises(Refused, match=r"base speed of 800 mm/s cannot be.*or 0 to stand"):
        identify(bench, run, loop="direct", base_speed_m_s=0.8)
    for options, said in (
        ({"base_speed_m_s": 0.1}, "needs a closed loop"),
        ({"loop": "direct", "base_speed_m_s": -0.1}, "positive"),
        ({"loop": "sideways"}, "loop is 'sideways'; choose one of open"),
        ({"loop": "direct", "resume": True}, "--resume"),
    ):
        with pytest.raises(UsageError, match=said):
            identify(bench, run, **options)
    with pytest.raises(UsageError, match="does not exist"):
        api.identify(bench.name, axis_of(run), tmp_path / "none", options=api.Options(yes=True, loop="direct"))
    assert bench.plant.cart_position_m == 0.0


@pytest.mark.usefixtures("fitted")
def test_a_drive_without_torque_offset_is_sent_to_the_speed_setpoint(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench(profile="cmmp-as")
    with pytest.raises(Refused, match=r"60B2h.*--loop setpoint"):
        identify(bench, run, loop="indirect")
    with bench.open(bench.name) as drive:
        bare = replace(drive.capabilities, kinds=frozenset({"torque", "position"}))
        with pytest.raises(Refused, match="no speed setpoints"):
            loop_plan.require_offered(bare, "setpoint", frozenset(drive.backup()))
        with pytest.raises(Refused, match="only --loop open"):
            loop_plan.require_offered(drive.capabilities, "setpoint", frozenset())


@pytest.mark.usefixtures("fitted")
def test_ctrl_c_leaves_a_stopped_axis_and_its_own_gains(make_bench: MakeBench, copy_of_complete: Copy) -> None:
    run, bench = copy_of_complete(), make_bench()

    def interrupt(index: int, fraction: float) -> None:
        if index == 3 and fraction > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        identify(bench, run, Listener(at_progress=interrupt), loop="direct")
    assert bench.stands_disabled()
    assert bench.parameters() == bench.initial
    folder = RunFolder.open(run)
    assert folder.unfinished() == ["direct_1"]
    assert "direct_1_rise_1" in folder.finished_names()
    said = re.findall(r"direct_1: interrupted after (\d+) of", (run / "journal.txt").read_text(encoding="utf-8"))
    assert len(said) == 1
