"""A reference led by the inverse of a P-PI cascade, on the simulated loop itself; and the gains that such a move tells."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from beltcomm.axis.entries import TrajectoryLimits
from beltcomm.control import Cascade, CascadeStructure, Feedforward
from beltcomm.design.led_reference import can_lead, led_reference
from beltcomm.errors import Refused
from beltcomm.identify.led_gains import gain_factors
from beltcomm.model import load_plant
from beltcomm.simulate.loop import SetpointGrid
from beltcomm.trajectory import Trajectory, plan_trajectory, with_dwell
from beltcomm.verify import REST_S, Loop, predict_move, tracking_error

PLAIN = Feedforward(velocity=0.0)


def drawn(seed: int) -> tuple[Any, Cascade, Loop, Trajectory]:
    """An axis, gains that hardly follow by themselves and do not ring, the drive, and a move."""
    draw = np.random.default_rng(seed)
    model = load_plant(("g_a", "g_b")[seed % 2]).model
    kp = draw.uniform(0.004, 0.012)
    cascade = Cascade(kp, kp / draw.uniform(0.3, 1.5), draw.uniform(0.5, 2.0), draw.uniform(0.0, 0.008), feedforward=PLAIN)
    structure = CascadeStructure("drawn", float(draw.choice([5e-4, 1e-3])))
    limits = TrajectoryLimits(speed_m_s=draw.uniform(0.2, 0.6), acceleration_m_s2=2.0, jerk_m_s3=15.0)
    ends = (0.05, 0.45) if draw.integers(2) else (0.45, 0.05)
    return model, cascade, Loop(structure, draw.uniform(5e-4, 2e-3), 3.1, 65536), plan_trajectory(*ends, limits, 1e-3)


@pytest.mark.parametrize("seed", range(6))
def test_the_axis_follows_what_it_could_not_follow(seed: int) -> None:
    model, cascade, drive, path = drawn(seed)
    whole = with_dwell(path, REST_S)
    plain = predict_move(model, cascade, whole, drive).error
    led = led_reference(model, whole, cascade, drive.structure, drive.delay_s)
    run = predict_move(model, cascade, led.sent, drive)
    grid = SetpointGrid(1e-3, drive.structure.period_s, len(led.motor.t_s))
    error = tracking_error(run.t_s, grid.in_loop(led.motor.position_m), run.motor_m)
    assert plain.dynamic_m > 5e-3
    assert error.dynamic_m < 2e-4
    assert error.static_m < 2e-4
    assert led.lead_m[0] == 0.0
    assert abs(led.lead_m[-1]) < 0.02 * np.max(np.abs(led.lead_m))  # the reference has come back to the axis


def test_after_a_fast_move_it_stands() -> None:
    """The integral is far from what friction holds when a fast move ends: the torque must not pass friction while it comes back."""
    model, drive = load_plant("g_a").model, Loop(CascadeStructure("P-PI", 1e-3), 1e-3, 3.1, 65536)
    cascade = Cascade(0.0136, 0.424, 3.1, 0.008, feedforward=PLAIN)
    path = with_dwell(plan_trajectory(0.05, 0.45, TrajectoryLimits(40.0, 45.0, 5.0), 1e-3), REST_S)
    led = led_reference(model, path, cascade, drive.structure, drive.delay_s)
    run = predict_move(model, cascade, led.sent, drive)
    error = tracking_error(run.t_s, SetpointGrid(1e-3, 1e-3, len(led.motor.t_s)).in_loop(led.motor.position_m), run.motor_m)
    assert error.static_m < 1e-5  # 1.7 mm where the controller's error faded away by itself
    assert error.settling_s == 0.0


def test_other_cascades_are_refused() -> None:
    model, cascade, drive, path = drawn(0)
    for structure in (replace(drive.structure, velocity_feedforward=True), replace(drive.structure, torque_feedforward=True)):
        assert not can_lead(structure, cascade)
        with pytest.raises(Refused, match="cannot be led"):
            led_reference(model, path, cascade, structure, 1e-3)
    notch = replace(cascade, prefilter=replace(cascade.prefilter, kind="notch", omega_rad_s=600.0, d_n=1.0))
    assert not can_lead(drive.structure, notch)


@pytest.mark.parametrize("seed", range(4))
def test_a_led_move_tells_the_gains(seed: int) -> None:
    """Gains a few percent off in the drive, 6 mN m of noise in its torque, whole counts: found to a thousandth or so."""
    model, cascade, drive, path = drawn(seed)
    drive = replace(drive, structure=replace(drive.structure, period_s=1e-3))
    draw = np.random.default_rng(100 + seed)
    real = replace(
        cascade,
        kp_nm_s_rad=(factor := draw.uniform(0.95, 1.05)) * cascade.kp_nm_s_rad,
        ki_nm_rad=factor * cascade.ki_nm_rad,
        kpp_1_s=(position := draw.uniform(0.95, 1.05)) * cascade.kpp_1_s,
    )
    led = led_reference(model, with_dwell(path, REST_S), cascade, drive.structure, drive.delay_s)
    run, ratio, count = predict_move(model, real, led.sent, drive), model["transmission.ratio"], math.tau / 65536
    lag = drive.delay_s + 0.5e-3  # acting torque, mean over the period that begins at the sample
    acted = np.interp(run.t_s - lag + 0.5e-3, run.t_s, run.torque_nm)
    torque = acted + draw.normal(0.0, 6e-3, len(run.t_s))
    record: Any = SimpleNamespace(
        t_s=run.t_s,
        sample_period_s=1e-3,
        reference_position=led.motor.position_m / ratio,
        position=np.round(run.motor_m / ratio / count) * count,
        torque=torque,
    )
    found = gain_factors(record, led.lead_m / ratio, cascade, drive.structure, drive.delay_s)
    assert found is not None
    assert found.kp == pytest.approx(factor, abs=6e-3 + found.kp_interval)
    assert found.kpp == pytest.approx(position, abs=2e-3 + found.kpp_interval)
    kept = np.delete(np.arange(len(run.t_s)), [5, 300, 301, 302, 700])  # rows whose answers were lost
    lost: Any = SimpleNamespace(
        **{name: getattr(record, name)[kept] for name in ("t_s", "reference_position", "position", "torque")}, sample_period_s=1e-3
    )
    again = gain_factors(lost, led.lead_m / ratio, cascade, drive.structure, drive.delay_s)
    assert again is not None
    assert (again.kp, again.kpp) == (pytest.approx(found.kp, abs=2e-3), pytest.approx(found.kpp, abs=5e-4))
    still: Any = SimpleNamespace(**{**vars(record), "torque": draw.normal(0.0, 6e-3, len(run.t_s))})
    assert gain_factors(still, led.lead_m / ratio, cascade, drive.structure, drive.delay_s) is None
    # read every seventh time only: a row has the torque that the loop asked for last before the next one
    rare = np.arange(0, len(run.t_s) - 7, 7)
    seldom: Any = SimpleNamespace(
        **{name: getattr(record, name)[rare] for name in ("t_s", "reference_position", "position")},
        torque=acted[rare + 6] + draw.normal(0.0, 2e-3, len(rare)),
        sample_period_s=7e-3,
    )
    told = gain_factors(seldom, led.lead_m[rare] / ratio, cascade, drive.structure, drive.delay_s)
    assert told is not None
    assert (told.kp, told.kpp) == (
        pytest.approx(factor, abs=1e-2 + told.kp_interval),
        pytest.approx(position, abs=3e-3 + told.kpp_interval),
    )
