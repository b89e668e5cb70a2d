"""A whole commissioning of another drive than the one in ``test_complete``, against the independent truth; both rigs on both drives, and
gearboxes: tests/benchmarks.

One test per machine holds everything it is examined for: a commissioning takes longer than all the questions about it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm import api, verify
from beltcomm.axis import Axis, load_axis
from beltcomm.errors import Refused
from beltcomm.experiments import phases, proving, verification
from beltcomm.machine.machine import Machine
from beltcomm.recording import Recording
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from beltcomm.verify import PredictedMove, TrackingError, Verdict, tracking_error
from identify.records import true_model
from session.bench import Bench, geared_bench

Array = NDArray[np.float64]
YES = api.Options(yes=True, seed=2)
#: Shares that the issue allows; name in the model or among the characteristics, name in the truth.
ALLOWED = (
    ("cart.mass", "mass_kg", 0.03),
    ("belt_stiffness.stiffness", "stiffness_n_m", 0.03),
    ("motor.inertia", "inertia_kg_m2", 0.03),
    ("resonance", "resonance_hz", 0.01),
    ("antiresonance", "antiresonance_hz", 0.01),
    ("coulomb_total", "coulomb_total_nm", 0.05),
)
Connect = Callable[[Bench], Bench]


def at_the_carriage(bench: Bench, run: Path, name: str, planned: tuple[Array, Array] | None = None) -> TrackingError:
    """Error of the true carriage in a move.

    planned : time, s, and where the carriage was to be, m; None where that is the motor's reference.
    """
    move = RunFolder.open(run).recording(name)
    assert move.reference_position is not None
    first, reference = bench.plant.first_tick_of(move, bench.start_m), bench.plant.ratio * move.reference_position
    if planned is not None:
        reference = reference[0] + np.interp(move.t_s - move.t_s[0], planned[0], planned[1] - planned[1][0])
    cart = bench.start_m + bench.plant.cart_m(first, len(move.t_s))
    return tracking_error(move.t_s, reference, cart)


def check_commissioned(
    bench: Bench,
    axis: Axis,
    run: Path,
    result: api.Result,
    exit_code: int = 0,
    verified: str = "move_1",
    planned: tuple[Array, Array] | None = None,
) -> None:
    """Model and prediction are right, the limits were kept, the drive is as it was found.

    verified : name of the verification move.   planned : as in :func:`at_the_carriage`.
    """
    assert result.exit_code == exit_code, result.text
    found = {name: item for name, item in result.data["model"]["parameters"].items()}
    found |= result.data["fit"]["characteristics"]
    for name, true, share in ALLOWED:
        truth, item = bench.plant.truth[true], found[name]
        assert item["value"] == pytest.approx(truth, rel=share), name
        assert abs(item["value"] - truth) < 2.0 * item["interval"], name  # missed once in 10 000 by a right interval
    verdict, cart = result.data["verdict"], at_the_carriage(bench, run, verified, planned)
    assert max(verdict.measured.dynamic_m, cart.dynamic_m) < 1e-3
    assert max(verdict.measured.static_m, cart.static_m) < 100e-6
    if planned is None:
        assert cart.dynamic_m == pytest.approx(verdict.predicted_cart.dynamic_m, rel=0.2, abs=20e-6)
    else:  # along a led reference the carriage is as far from its own path as the motor from its reference
        assert cart.dynamic_m == pytest.approx(verdict.measured.dynamic_m, abs=20e-6)
    low, high = verdict.predicted_range
    assert 0.9 * low.dynamic_m - 5e-6 < verdict.measured.dynamic_m < 1.1 * high.dynamic_m + 5e-6
    move = bench.plant.first_tick_of(RunFolder.open(run).recording(verified), bench.start_m)
    assert np.abs(bench.plant.belt_force_n[:move]).max() <= axis.belt_force_limit_n
    places = bench.start_m + bench.plant.cart_m(0, len(bench.plant.torque_nm))
    assert places.min() >= float(axis.travel.min_m or 0.0)
    assert places.max() <= float(axis.travel.max_m or 0.0)
    assert bench.now_s <= 75.0
    assert bench.parameters() == bench.initial
    assert bench.stands_disabled()


def test_a_geared_axis_is_not_asked_for_more_speed_than_its_motor_has(connect: Connect, tmp_path: Path) -> None:
    """10:1: the drive's 6300 1/min are 0.82 m/s, a sixth of the axis's limit; a motor revolution is 7.8 mm, no measure for a lag."""
    bench, axis = geared_bench(tmp_path, "g_a", 10.0)
    connect(bench)
    model = true_model(bench.plant.plant)
    record = RunFolder.create(tmp_path / "run", axis)
    with bench.open(bench.name) as drive, Machine(drive, axis, record, Silence()) as machine:
        top = drive.capabilities.max_speed_rad_s * 0.01242 / 10.0
        assert top < 0.2 * float(axis.limits.speed_m_s or 0.0)
        strokes = phases.sweep(machine, model).trajectory
        standard = verification.standard_move(machine, model)
        limits = machine.drive_limits(phases.untuned_envelope(machine))
    assert 0.5 * top < np.abs(strokes.velocity_m_s).max() < top
    assert 0.9 * top < np.abs(standard.at(1.0, 1e-3).velocity_m_s).max() < top  # T_A would take 1.36 m/s
    assert "the speed would be 1.356 m/s" in standard.remark
    assert limits.speed_rad_s == pytest.approx(top * 10.0 / 0.01242)
    assert limits.lag_rad is not None
    assert limits.lag_rad > 2.0 * math.tau


@pytest.mark.examination
def test_a_drive_without_feedforward_gets_the_move_it_can_follow(connect: Connect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """cmmp-as lags by speed over K_PP: T_A is predicted to miss by far, a slower move with a led reference to follow, and both come true.

    Its gains mean 0.37 and 1.6 times what its profile guesses; they are calibrated before the first loop, or none of this would be so.
    ``benchmarks/verify_table.py`` does the same with both rigs.
    """
    bench = connect(Bench("g_a", profile="cmmp-as", gain_units=(0.37, 1.6, 1.0)))
    run, judged = tmp_path / "run", dict[str, tuple[Array, Array]]()

    def judge(recording: Recording, ratio: float, predicted: PredictedMove, **known: Any) -> Verdict:
        judged[recording.name] = predicted.t_s, known["carriage_m"]
        return verify.judge(recording, ratio, predicted, **known)

    monkeypatch.setattr(proving, "judge", judge)
    result = api.commission(bench.name, "egc-70-600", run, options=replace(YES, quick=True))
    units = RunFolder.open(run).load("results", "calibration")["units"]
    assert [units[n]["unit"] / units[n]["assumed"] for n in ("kp_nm_s_rad", "kpp_1_s")] == pytest.approx([0.37, 1.6], rel=0.05)
    controller = RunFolder.open(run).recording("move_2").sidecar.controller
    _, planned_m = judged["move_2"]
    assert controller["led_by"] == "led"
    assert [planned_m[0], planned_m[-1]] == pytest.approx(controller["path"][:2], abs=1e-5)
    check_commissioned(bench, load_axis("egc-70-600"), run, result, exit_code=1, verified="move_2", planned=judged["move_2"])
    headline = result.data["headline"]
    assert headline["state"] == "fail"
    assert " met its targets in this move, but " in headline["sentence"]
    assert result.lines()[1].strip().startswith("FAIL   ")
    assert "this drive cannot follow the standard move within the target, only slower ones" in result.data["reservations"]
    thin = min(one["phase_margin_deg"] for one in RunFolder.open(run).load("designs", "final")["margins"])
    assert any("of phase margin" in reservation for reservation in result.data["reservations"]) is (thin < 30.0)
    with pytest.raises(Refused, match="only slower ones"):
        api.apply(bench.name, run, options=YES)
    verdict = result.data["verdict"]
    assert verdict.measured.dynamic_m < 0.1e-3, "the reference is led by the inverse of the cascade"
    assert any("would reach the bound of the position controller's output, 0.65 m/s" in remark for remark in result.data["remarks"])

    fast = api.verify(bench.name, run, options=replace(YES, feedforward="none"))
    assert fast.exit_code == 1
    measured, predicted = fast.data["measured"], fast.data["predicted"]
    assert measured["dynamic_m"] > 0.1
    assert measured["dynamic_m"] == pytest.approx(predicted["dynamic_m"], rel=0.02)
    bound = "the bound of the position controller's output, 0.65 m/s" in "".join(fast.data["reasons"])
    assert bound is (measured["dynamic_m"] * RunFolder.open(run).load("designs", "final")["parameters"]["kpp_1_s"] > 0.65)
    assert bench.parameters() == bench.initial


def test_the_standard_move_keeps_off_the_ends_of_the_travel(connect: Connect, tmp_path: Path) -> None:
    """A travel that begins at 0: a move from there could not stop inside it, once the axis swings by a micrometre."""
    bench, axis = connect(Bench("g_a")), load_axis("egc-70-600")
    axis = replace(axis, travel=replace(axis.travel, min_m=0.0, max_m=0.55))
    with bench.open(bench.name) as drive, Machine(drive, axis, RunFolder.create(tmp_path / "run", axis), Silence()) as machine:
        path = verification.standard_move(machine, true_model(bench.plant.plant)).at(1.0, 1e-3).position_m
    assert 0.002 < path.min() < path.max() < 0.548
    assert path.max() - path.min() > 0.4


@pytest.mark.examination
def test_a_data_sheet_with_a_belt_twice_as_stiff_does_not_mislead_the_first_estimate(connect: Connect, tmp_path: Path) -> None:
    """The carriage was taken for a feather on a rod, half the motor's inertia beside it, and the drive's torque was blamed for that."""
    bench, axis = connect(Bench("g_a")), load_axis("egc-70-600")
    axis = replace(axis, belt=replace(axis.belt, specific_stiffness_n=250e3), coupling=replace(axis.coupling, stiffness_nm_rad=None))
    result = api.identify(bench.name, axis, tmp_path / "run", options=YES)
    assert result.data["model"]["parameters"]["cart.mass"]["value"] == pytest.approx(bench.plant.truth["mass_kg"], rel=0.03)
