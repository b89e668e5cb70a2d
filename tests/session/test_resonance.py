"""Swings of a closed loop around the resonance: seen early, cut early, never seen where there are none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.control import Cascade, CascadeStructure
from beltcomm.errors import SafetyStop
from beltcomm.experiments import phases
from beltcomm.machine import closed_loop_watch
from beltcomm.machine.closed_loop_watch import ResonanceWatch, Swing, _amplitude_nm, _band_of
from beltcomm.machine.machine import Machine
from beltcomm.rundata import analyse
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from beltcomm.trajectory import plan_trajectory, with_dwell
from beltcomm.verify import Loop
from beltcomm.virtual.faults import Faults
from identify.records import true_model
from session.bench import Bench
from truth.rigs import nominal

MakeBench = Callable[..., Bench]
T = 1e-3
BAND = (40.0, 450.0)


def rows_of(torque: np.ndarray) -> list[tuple[float, ...]]:
    return [(n * T, float(value), math.nan, 0.0, 0.0) for n, value in enumerate(torque)]


@pytest.mark.parametrize(("hertz", "share"), [(100.0, 1.0), (200.0, 1.0), (5.0, 0.02)])
def test_the_amplitude_of_a_sine_inside_and_outside_the_band(hertz: float, share: float) -> None:
    """A cos wt has the amplitude A in a band around it; a Butterworth of second order lets (f/40 Hz)^2 = 1.6 % of 5 Hz through."""
    t = T * np.arange(1000)
    found = _amplitude_nm(0.3 * np.sin(2.0 * math.pi * hertz * t), T, BAND)[500:]
    assert found.max() <= 0.3 * share * 1.06
    if share == 1.0:
        assert found.min() >= 0.3 * 0.94


def test_row_by_row_is_the_same_as_at_once_and_the_stop_names_amplitude_and_frequency() -> None:
    random = np.random.default_rng(3)
    t = T * np.arange(600)
    growing = np.where(t > 0.3, 0.1 * np.exp((t - 0.4) / 0.05), 0.0)
    torque = 0.4 + 0.01 * random.standard_normal(600) + growing * np.sin(2.0 * math.pi * 90.0 * t)
    at_once = _amplitude_nm(torque, T, BAND)
    first = int(np.flatnonzero(at_once > 0.05)[0])
    watch = ResonanceWatch(Swing(BAND, 0.05, 0.01), T)
    rows = rows_of(torque)
    for row in rows[:first]:
        watch(row)
    with pytest.raises(SafetyStop, match=r"swings with 0\.05\d* N m at about (8\d|9\d) Hz.*predicted were 0\.01 N m, 0\.05 N m") as stop:
        watch(rows[first])
    assert (stop.value.reason, stop.value.exit_code) == ("resonance", 4)


@pytest.mark.parametrize("rig", ["g_a", "g_b"])
def test_the_band_holds_the_resonance_and_fits_the_sampling(rig: str) -> None:
    model = true_model(nominal(rig))
    mass, inertia, stiffness = model["cart.mass"], model["motor.inertia"], model["belt_stiffness.stiffness"]
    free = math.sqrt(stiffness * (1.0 / mass + 0.01242**2 / inertia)) / (2.0 * math.pi)
    low, high = _band_of(model, (0.0, 0.5), T)
    assert low == pytest.approx(closed_loop_watch.BELOW * free, rel=1e-3)
    assert high == 450.0
    assert _band_of(model, (0.0, 0.5), 6.4e-3) == pytest.approx((0.2 / 6.4e-3, 0.45 / 6.4e-3))  # a drive of 156 Hz sees what it can


#: What commissioning gives a cmmp-as on rig g_a, without feedforward or prefilter.
CMMP = Cascade(0.0133, 0.427, 3.0, 8e-3)


def designed(rig: str, structure: CascadeStructure, known: dict[str, Cascade] = {}) -> Cascade:  # noqa: B006
    """The first loop for a rig known exactly; calculated once."""
    if rig not in known:
        model = true_model(nominal(rig))
        result = analyse.first_loop(model, structure, 0.15, T, 0.0)
        known[rig] = analyse.with_feedforward(result.cascade, model, structure, T)
    return known[rig]


@dataclass
class Tried:
    """planned_nm : largest torque predicted.   acted_nm : on the plant, from the motion's first row to standstill.   stop : if any."""

    planned_nm: float
    acted_nm: np.ndarray
    stop: SafetyStop | None
    bench: Bench


@pytest.fixture
def travelled(make_bench: MakeBench, tmp_path: Path) -> Callable[..., Tried]:
    """A gentle move of 0.2 m with the loop designed for ``rig``, on ``plant``, with a gain that is ``factor`` times what it says."""

    def travel(rig: str, plant: str, factor: float, profile: str = "reference") -> Tried:
        faults, model, axis = Faults(), true_model(nominal(rig)), load_axis("egc-70-600")
        bench = make_bench(plant, name=f"virtual:{rig}", start_m=0.15, faults=faults, profile=profile)
        kind = "position" if profile == "reference" else "velocity"
        stop = None
        with bench.open(bench.name) as drive, Machine(drive, axis, RunFolder.create(tmp_path / "run", axis), Silence()) as machine:
            drive.calibrate({name: drive.capabilities.parameters[name].scale for name in drive.capabilities.uncalibrated})
            own = drive.capabilities
            machine.keep_gains = True  # as if the user wanted that
            faults.gain_factor = factor
            machine.write_cascade(CMMP if kind == "velocity" else designed(rig, own.structure))
            machine.closed, machine.friction, machine.deceleration_m_s2 = (model, T), (0.2, 3e-3), 3.0
            path = plan_trajectory(machine.position_m, 0.35, phases.gentle_limits(machine, model, 0.5), T)
            motion = machine.follow(with_dwell(path, 0.3), kind)  # type: ignore[arg-type]
            assert machine.cascade is not None
            in_drive = Loop(own.structure, T, own.peak_torque_nm, own.counts_per_rev)
            planned = closed_loop_watch._predicted_torque(model, machine.cascade, motion, in_drive, machine.ratio, machine.origin_rad)
            stopping = machine.deceleration_m_s2 * (model["motor.inertia"] / machine.ratio + machine.ratio * model["cart.mass"])
            begun = len(bench.plant.torque_nm)
            try:
                machine.run(motion, phases.untuned_envelope(machine))
            except SafetyStop as caught:
                stop = caught
                machine.keep_gains = True
                machine.__exit__(SafetyStop, caught, None)
        most = max(float(np.abs(planned).max()), stopping + 0.15)
        return Tried(most, bench.plant.torque_nm[begun:], stop, bench)

    return travel


@pytest.mark.parametrize("profile", ["reference", "cmmp-as"])
def test_a_loop_that_fits_is_left_alone(travelled: Callable[..., Tried], profile: str) -> None:
    tried = travelled("g_a", "g_a", 1.0, profile)
    assert tried.stop is None
    assert np.abs(tried.acted_nm).max() < 1.05 * tried.planned_nm


@pytest.mark.parametrize(("rig", "plant", "factor", "profile"), [("g_b", "g_b", 9.0, "reference"), ("g_a", "g_a", 9.0, "cmmp-as")])
def test_a_loop_that_rings_is_cut_and_the_old_gains_come_back(
    travelled: Callable[..., Tried], rig: str, plant: str, factor: float, profile: str
) -> None:
    """Within ten swings from where the plant first gets more than the plan, and never more than 1.5 times the planned torque."""
    tried = travelled(rig, plant, factor, profile)
    assert tried.stop is not None
    assert tried.stop.reason == "resonance"
    floor_nm = 1.43 if profile == "cmmp-as" else 0.0  # this drive's torque limit goes no lower than the rated one
    assert np.abs(tried.acted_nm).max() <= max(1.5 * tried.planned_nm, floor_nm) * 1.02
    assert tried.bench.stands_disabled()
    assert tried.bench.parameters() == tried.bench.initial


def test_the_drive_gets_the_planned_torque_as_its_limit(travelled: Callable[..., Tried], monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[float] = []
    true = closed_loop_watch.within

    def seen(envelope: closed_loop_watch.Envelope, found: closed_loop_watch.Foreseen) -> closed_loop_watch.Envelope:
        given.append(true(envelope, found).torque_nm)
        return true(envelope, found)

    monkeypatch.setattr("beltcomm.machine.machine.within", seen)
    tried = travelled("g_b", "g_b", 1.0)
    assert given == [pytest.approx(1.5 * tried.planned_nm, rel=0.1)]
