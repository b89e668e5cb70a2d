"""How far an axis runs on when the computer dies: in closed form, predicted, watched, and on the truth."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.drive import Limits, Row
from beltcomm.errors import DriveError, DriveFault, Refused, SafetyStop
from beltcomm.identify.amplitude import DIES, MotionLimits, _predict, family_around, largest_amplitude
from beltcomm.machine import creep, host_loss
from beltcomm.machine.host_loss import guard_times_s
from beltcomm.machine.machine import Machine
from beltcomm.recording.sidecar import Sidecar
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.stopping import Braking, HostLoss, run_on_distance, total_friction, total_inertia
from beltcomm.talk import Silence
from beltcomm.virtual.faults import Faults
from identify.records import true_model
from session.bench import Bench
from truth.rigs import nominal

MakeBench = Callable[..., Bench]
AXIS = "egc-70-600"
RATIO = 0.01242
T = 1e-3


def stepped(speed: float, torque: float, friction: float, inertia: float, held_s: float, deceleration: float, lag_s: float) -> float:
    """The same by small steps: torque held, a lag at constant speed, then the ramp; the furthest place."""
    x, v, dt, far = 0.0, speed, 1e-6, 0.0
    for k in range(round(2.0 / dt)):
        t = k * dt
        if t < held_s:
            v += RATIO * (torque - friction) / inertia * dt
        elif t >= held_s + lag_s:
            v = max(v - deceleration * dt, 0.0)
        x += v * dt
        far = max(far, x)
        if t > held_s + lag_s and v == 0.0:
            break
    return far


@pytest.mark.parametrize("speed", [0.0, 0.3])
def test_the_run_on_is_that_of_its_equation_of_motion(speed: float) -> None:
    """0.3 N m held for 55 ms on 1 kg and 0.1 N m of friction, then 8 m/s2 after 10 ms."""
    inertia = 7.17e-5 + RATIO**2
    loss = HostLoss(0.055, Braking(8.0, 0.010))
    (found,) = run_on_distance(np.array([speed]), 0.3, 0.1, inertia, RATIO, loss)
    assert found == pytest.approx(stepped(speed, 0.3, 0.1, inertia, 0.055, 8.0, 0.010), rel=1e-3)
    (turned,) = run_on_distance(np.array([-speed]), 0.3, 0.1, inertia, RATIO, loss)
    assert turned == run_on_distance(np.zeros(1), 0.3, 0.1, inertia, RATIO, loss)[0]  # one that moves away must first come to rest
    assert math.isinf(run_on_distance(np.array([speed]), 0.3, 0.1, inertia, RATIO, replace(loss, braking=Braking(0.0, 0.0)))[0])
    ways = Braking(2.0, 0.02, besides=Braking(1.0, 0.0))
    speeds = np.linspace(0.0, 2.0, 7)
    assert ways.ways_m(speeds) == pytest.approx([ways.way_m(float(v)) for v in speeds])


def test_200_ms_are_too_long_for_a_light_carriage_and_50_are_not() -> None:
    """drive-protocols 4.4: 0.3 N m held reach 2.1 m/s and 0.32 m with 200 ms, 0.5 m/s and 20 mm with 50 ms; that is 10.5 m/s2, then a stop
    from 2.1 m/s within 0.11 m, along 20 m/s2, and from 0.5 m/s within 7 mm."""
    inertia = RATIO * 0.3 / 10.5
    for held_s, way in ((0.2, 0.32), (0.05, 0.020)):
        (found,) = run_on_distance(np.zeros(1), 0.3, 0.0, inertia, RATIO, HostLoss(held_s, Braking(20.0, 0.0)))
        assert found == pytest.approx(way, rel=0.05)


def test_an_amplitude_shrinks_until_the_run_on_fits_and_a_shorter_guard_time_allows_more() -> None:
    model = true_model(nominal("g_b"))
    shape = np.repeat(np.random.default_rng(2).choice([-1.0, 1.0], 200), 4)
    limits = MotionLimits(0.2, 2.0, 3.0, 1e4, 0.25, ends_m=0.04)

    def found(*held_s: float) -> float:
        losses = [HostLoss(time, Braking(3.0, 0.02)) for time in held_s]
        step = largest_amplitude([model], shape, T, 0.25, limits, 1.2, losses=lambda _model: losses)
        assert step.binds == DIES
        assert 0.97 * limits.ends_m < step.prediction.died_m[-1] <= limits.ends_m
        return step.amplitude_nm

    assert found(0.056) < 0.9 * found(0.056, 0.026)  # the last entry is what can be had
    smooth = model.with_values({"coulomb.level": 0.0, "cart_friction.level": 0.0})
    with pytest.raises(Refused, match=r"if the computer died in one of ±0\.\d+ N m, the carriage could run on by \d+ mm .* 1 mm are left"):
        largest_amplitude([smooth], shape, T, 0.25, replace(limits, ends_m=1e-3), 1.2, losses=lambda _m: [HostLoss(0.2, Braking(0.5, 0.1))])


def test_the_watch_stops_where_the_run_on_reaches_the_end() -> None:
    """From 0.2 m/s: 0.2 (0.055 + 0.01) + 5.3 mm of held torque and its speed..., by the closed form."""
    model = true_model(nominal("g_b"))
    loss = HostLoss(0.055, Braking(8.0, 0.010))
    watch = host_loss.RunOnWatch((0.0, 0.5), RATIO, 0.0, [model], 0.2, lambda _model: loss, 2.0)
    (way,) = run_on_distance(np.array([0.2]), 0.2, total_friction(model), total_inertia(model), RATIO, loss)
    assert watch.run_on_m(0.2) == pytest.approx(way, rel=0.05)
    for sign, end in ((1.0, 0.5), (-1.0, 0.0)):
        watch = host_loss.RunOnWatch((0.0, 0.5), RATIO, 0.0, [model], 0.2, lambda _model: loss, 2.0)
        stopped = None
        for n in range(2000):
            place = 0.25 + sign * 0.2 * n * T
            try:
                watch((n * T, 0.0, 0.0, place / RATIO, sign * 0.2 / RATIO))
            except SafetyStop as stop:
                stopped, text = place, str(stop)
                break
        assert stopped is not None
        assert abs(end - stopped) == pytest.approx(way, abs=0.05 * way + 0.2 * T)
        assert "the carriage would run on by" in text


@pytest.mark.parametrize("coasts", [False, True])
@pytest.mark.parametrize("at_row", [137, 421])
def test_a_computer_that_dies_in_an_excitation(make_bench: MakeBench, tmp_path: Path, coasts: bool, at_row: int) -> None:
    """Nothing is sent any more in the middle of it: the truth stops within what was counted with at that row, and not on a tenth of it."""
    bench = make_bench("g_b", faults=Faults(guarding_coasts=coasts))
    axis, model = load_axis(AXIS), true_model(nominal("g_b"))
    with bench.open(bench.name) as drive, Machine(drive, axis, RunFolder.create(tmp_path / "run", axis), Silence()) as machine:
        guarding = host_loss.prove(machine)
        assert guarding.brakes is not coasts
        drive.write({"kp_nm_s_rad": 0.0088, "ki_nm_rad": 0.17})
        losses = host_loss.losses_of(machine)
        shape = np.repeat(np.random.default_rng(5).choice([-1.0, 1.0], 40), 20) * 0.25
        predicted = _predict(family_around(model), shape, T, 0.25, losses=losses)
        watch = host_loss.RunOnWatch((0.0, 0.5), RATIO, machine.origin_rad, family_around(model), 0.25, lambda m: losses(m)[0], 3.0)
        seen: list[tuple[float, float]] = []

        def die(row: Row) -> None:
            seen.append((row[0], RATIO * row[3]))
            if len(seen) == at_row:
                drive.clock.sleep_until(drive.clock.now() + 1.5)

        with pytest.raises(DriveFault, match="8130h"):
            machine.record("dying", machine.torque_motion(shape), machine.envelope(), Sidecar("frf", 0.25, 0.0), die)
    (t0, x0), (t1, x1) = seen[-13], seen[-1]
    places = bench.start_m + bench.plant.cart_m(0, len(bench.plant.torque_nm))
    way = max(abs(places[-200:].mean() - x1), 1e-6)
    counted = watch.run_on_m(abs(x1 - x0) / (t1 - t0))
    assert counted <= predicted.run_on_m[0] * 1.05
    assert way <= counted
    assert np.abs(places - 0.25).max() <= predicted.died_m[0]
    assert bench.stands_disabled()


def test_a_drive_that_does_not_mind_its_hosts_death_is_not_commissioned(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench(faults=Faults(guarding_ignored=True))
    with pytest.raises(DriveError, match="did not react within 100 ms when the computer fell silent"):
        api.identify(bench.name, AXIS, tmp_path / "run", options=api.Options(yes=True, seed=1))
    assert not np.any(bench.plant.torque_nm)
    assert bench.parameters() == bench.initial


def test_creeping_near_an_end_goes_no_further_than_a_run_on_allows(make_bench: MakeBench) -> None:
    """8 mm to the end and 0.7 N m of friction: 20 ms of guard time and half the torque as friction leave 0.5 N m at most."""
    axis, bench = load_axis(AXIS), make_bench("g_b", faults=Faults(stuck_from_s=0.0))
    with bench.open(bench.name) as drive:
        here = drive.read(["position_rad"])["position_rad"]
        limits = Limits(here - 2.0, here + 2.0, 100.0, 1.5)
        with pytest.raises(Refused, match=r"does not move under (0\.\d+) N m, and more is too much here: .* 8 mm are left") as refused:
            creep.creep(drive, axis, limits, 2e-3, 8e-3, left_m=8e-3)
        torque = float(str(refused.value).split(" under ")[1].split(" ")[0])
        held_s = guard_times_s(drive.capabilities)[-1] + T
        assert creep.run_on_m(axis, torque - 2e-3, held_s) <= 8e-3 < creep.run_on_m(axis, torque + 2e-3, held_s)


def test_the_plan_says_it(make_bench: MakeBench, tmp_path: Path) -> None:
    bench = make_bench()
    result = api.identify(bench.name, AXIS, tmp_path / "run", options=api.Options(dry_run=True))
    assert "A light carriage that just breaks away then coasts by 1" in dict(result.data["plan"]["points"])["PC or bus lost"]


def test_a_creeping_move_proves_the_guarding_first(make_bench: MakeBench) -> None:
    bench = make_bench(faults=Faults(guarding_ignored=True))
    with pytest.raises(DriveError, match="so it gets none"):
        api.move(bench.name, AXIS, 0.005, options=api.Options(yes=True))
    assert not np.any(bench.plant.torque_nm)
