"""``--simulate-first``: the job on a twin, its table against the limits, and what it refuses."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from beltcomm import api
from beltcomm.axis import load_axis
from beltcomm.drive import open_drive
from beltcomm.errors import Refused, UsageError
from beltcomm.experiments import rehearsal
from beltcomm.experiments.options import Options
from beltcomm.experiments.rehearsal import Bounds, RehearsedRecord, _play_record, _twin_of
from beltcomm.model import load_plant
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from beltcomm.runfolder import RunFolder
from session.bench import Bench, Listener

MakeBench = Callable[..., Bench]
Copy = Callable[..., Path]
AXIS = "egc-70-600"
RIG = load_axis(AXIS)


@pytest.fixture
def beside(make_bench: MakeBench, monkeypatch: pytest.MonkeyPatch) -> MakeBench:
    """Makes the drive that the commands find; a twin, which brings its own plant, is another one."""

    def make(**options: Any) -> Bench:
        bench = make_bench(**options)
        monkeypatch.setattr(api, "open_drive", lambda name, given: (open_drive if "plant" in given else bench.open)(name, given))
        return bench

    return make


def test_a_record_is_measured_by_hand() -> None:
    """10 rad/s for a second, then at rest, under 0.5 N m: 124 mm, 0.124 m/s, 0.5/0.01242 = 40 N where nothing accelerates."""
    t_s = 1e-3 * np.arange(2001)
    angle = 10.0 * np.minimum(t_s, 1.0)
    torque = np.where(t_s < 1.5, 0.5, 0.4)
    found = _play_record(Recording("r", t_s, torque, angle, sidecar=Sidecar("trajectory", 0.1)), RIG, 0.0)
    assert (found.low_m, found.high_m) == pytest.approx((0.1, 0.1 + 10.0 * 0.01242))
    assert found.speed_m_s == pytest.approx(0.1242)
    assert found.torque_nm == 0.5
    inertia = RIG.motor_side_inertia_kg_m2
    jerk = 0.25 * inertia * (10.0 / 1e-3) / 0.01242  # the stop within one sample, in the mean of four
    assert found.belt_force_n == pytest.approx(0.5 / 0.01242 + jerk, rel=1e-6)


def test_every_limit_that_is_left_is_named() -> None:
    bounds = Bounds(0.0, 0.5, 1.0, 2.0, 100.0)
    assert bounds.broken(RehearsedRecord("a", 0.0, 0.5, 1.0, 2.0, 100.0)) == []
    broken = bounds.broken(RehearsedRecord("a", -0.01, 0.4, 1.1, 2.5, 130.0))
    assert [text.split(" ")[1] for text in broken] == ["speed", "torque", "belt", "the"]
    assert "a: belt force 130 N, limit 100 N" in broken


@pytest.mark.examination
@pytest.mark.usefixtures("fitted")
def test_the_verifying_move_is_played_first_and_then_driven(beside: MakeBench, copy_of_complete: Copy) -> None:
    run, bench, talk = copy_of_complete(), beside(start_m=0.2), Listener()
    result = api.verify(bench.name, run, options=Options(yes=True, seed=1, simulate_first=True), talk=talk)
    assert result.exit_code == 0
    said = "\n".join(talk.said)
    assert "Played on a twin first: the run's model." in said
    saved = RunFolder.open(run).load("results", "rehearsal")
    (twin,) = saved["records"]
    move = RunFolder.open(run).recording("move_2")
    real = _play_record(move, RIG, 0.0)
    assert twin["record"] == "move_2"
    assert twin["high_m"] == pytest.approx(real.high_m, abs=1e-3)
    assert twin["speed_m_s"] == pytest.approx(real.speed_m_s, rel=0.05)
    assert twin["torque_nm"] == pytest.approx(real.torque_nm, rel=0.1)  # the real torque is noisy
    assert saved["whole"]["belt_force_n"] == pytest.approx(float(np.max(np.abs(bench.plant.belt_force_n))), rel=0.15)
    assert bench.opened == 1  # the twin is another drive
    assert bench.parameters() == bench.initial


@pytest.mark.usefixtures("fitted")
def test_a_twin_that_leaves_a_limit_keeps_the_axis_at_rest(
    beside: MakeBench, copy_of_complete: Copy, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, bench = copy_of_complete(), beside(start_m=0.2)
    monkeypatch.setattr(rehearsal, "_bounds_of", lambda *_args: Bounds(-0.01, 0.57, 0.5, 3.4, 135.0))
    before = RunFolder.open(run).finished_names()
    with pytest.raises(Refused, match=r"on the twin a limit is left \(move_2: speed 1\.\d+ m/s, limit 0\.5 m/s.*nothing was moved"):
        api.verify(bench.name, run, options=Options(yes=True, seed=1, simulate_first=True))
    assert bench.plant.cart_position_m == 0.0
    assert RunFolder.open(run).finished_names() == before
    assert bench.parameters() == bench.initial


def test_a_job_that_ends_badly_on_the_twin_is_refused_with_its_reason(beside: MakeBench, tmp_path: Path) -> None:
    """A belt that may carry next to nothing: friction holds the twin, as it would hold the axis."""
    bench = beside()
    weak = replace(RIG, limits=replace(RIG.limits, feed_force_n=4.0))
    with pytest.raises(Refused, match=r"on the twin \(a guess from the data sheets.*the job ends so: .*Nothing was moved"):
        api.identify(bench.name, weak, tmp_path / "run", options=Options(yes=True, seed=1, simulate_first=True))
    assert bench.plant.cart_position_m == 0.0


def test_a_creep_has_no_twin(make_bench: MakeBench) -> None:
    bench = make_bench()
    with pytest.raises(UsageError, match=r"a creep .*is not played on a twin"):
        api.move(bench.name, AXIS, 5e-3, options=Options(yes=True, simulate_first=True))


def test_without_a_model_the_twin_is_a_guess_that_says_so(tmp_path: Path) -> None:
    model, words = _twin_of(RIG, RunFolder.create(tmp_path / "run", RIG))
    assert model["cart.mass"] == 2.0
    assert "a guess from the data sheets, a carriage of 2 kg" in words
    upright = load_axis("egc-70-600-vertical")
    tilted, _ = _twin_of(upright, RunFolder.create(tmp_path / "upright", upright))
    assert tilted["tilt.angle"] == pytest.approx(load_plant("g_b_vertical").model["tilt.angle"])
