"""Loops so weak that the friction sent along takes the axis where it goes: noticed before motion, and mended by short strokes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from beltcomm.axis import TrajectoryLimits, load_axis
from beltcomm.control import Feedforward
from beltcomm.errors import Refused
from beltcomm.experiments import commission, friction_feedforward, phases, recording_steps
from beltcomm.experiments.friction_feedforward import _shown_by_passes
from beltcomm.experiments.stops_out_of_move import allowed_lag_m, room_beyond_m
from beltcomm.identify.amplitude import family_around
from beltcomm.identify.friction import Plateau
from beltcomm.machine import stops
from beltcomm.machine.machine import Machine
from beltcomm.model import Model
from beltcomm.rundata.findings import Findings
from beltcomm.runfolder import RunFolder
from beltcomm.talk import Silence
from beltcomm.trajectory import Trajectory, plan_trajectory
from beltcomm.verify import PredictedMove
from session.bench import Bench
from session.conftest import Complete

AXIS = "egc-70-600"
MakeBench = Callable[..., Bench]
PATH = plan_trajectory(0.0, 0.1, TrajectoryLimits(jerk_m_s3=50.0, acceleration_m_s2=2.0, speed_m_s=0.3), sample_period_s=1e-3)
FRICTION = Feedforward(coulomb_nm=0.125, viscous_nm_s_rad=2.5e-3)


def passes(*speeds_rad_s: float, coulomb_nm: float = 0.125, viscous_nm_s_rad: float = 2.5e-3, offset_nm: float = 0.0) -> list[Plateau]:
    """Passes both ways on an axis with this friction."""
    both = [sign * speed for speed in speeds_rad_s for sign in (1.0, -1.0)]
    return [Plateau(v, v, math.copysign(coulomb_nm, v) + viscous_nm_s_rad * v + offset_nm, 1e-3, 0.0, 0.3) for v in both]


@pytest.mark.parametrize("seed", range(5))
def test_friction_of_passes_replaces_what_was_sent(seed: int) -> None:
    draw = np.random.default_rng(seed)
    coulomb, viscous, offset = draw.uniform(0.05, 0.3), draw.uniform(1e-3, 6e-3), draw.uniform(-0.02, 0.02)
    sent = replace(FRICTION, offset_nm=offset)
    found = _shown_by_passes(sent, passes(7.0, 12.0, 20.0, coulomb_nm=coulomb, viscous_nm_s_rad=viscous, offset_nm=offset))
    assert (found.coulomb_nm, found.viscous_nm_s_rad) == pytest.approx((coulomb, viscous))
    of_one = _shown_by_passes(FRICTION, passes(7.0, coulomb_nm=coulomb, viscous_nm_s_rad=viscous))
    assert of_one.coulomb_nm + 7.0 * of_one.viscous_nm_s_rad == pytest.approx(coulomb + 7.0 * viscous)
    assert of_one.viscous_nm_s_rad / of_one.coulomb_nm == pytest.approx(FRICTION.viscous_nm_s_rad / FRICTION.coulomb_nm)


def test_passes_that_show_nothing_change_nothing() -> None:
    assert _shown_by_passes(FRICTION, []) is FRICTION
    driving = [replace(one, torque_nm=-one.torque_nm) for one in passes(7.0)]
    assert _shown_by_passes(FRICTION, driving) == FRICTION
    assert _shown_by_passes(Feedforward(), passes(7.0, 14.0)) == Feedforward()


def test_a_weak_loop_is_not_sure_to_keep_a_sweep_inside_and_a_strong_one_is(
    make_bench: MakeBench, complete: Complete, tmp_path: Path
) -> None:
    bench, folder = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS))
    model = complete.final.fit.model
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Silence()) as machine:
        strong, _ = commission.first_cascade(machine, Findings(), model, 0.25)
        stops.count_on_loop(machine, family_around(model), machine.write_cascade(strong), 1e-3)
        assert phases.sweep_is_sure(machine, model)
        assert machine.cascade is not None
        machine.cascade = replace(machine.cascade, kp_nm_s_rad=1.3e-3, ki_nm_rad=4e-4, kpp_1_s=0.27)
        assert not phases.sweep_is_sure(machine, model)
        machine.family = (model,)
        assert phases.sweep_is_sure(machine, model), "one known model leaves nothing unsure"


def test_drives_with_a_filter_against_the_resonance_make_no_short_strokes(make_bench: MakeBench) -> None:
    bench = make_bench()
    with bench.open(bench.name) as drive:
        own = drive.capabilities
        assert not friction_feedforward._may_be_weak(own)
        assert friction_feedforward.line(load_axis(AXIS), own) == ()
        bare = replace(own, structure=replace(own.structure, prefilters=("none",)))
        (line,) = friction_feedforward.line(load_axis(AXIS), bare)
        assert line.travel_m == pytest.approx(0.2)


def test_room_is_what_a_motion_leaves_at_the_ends_that_it_goes_to() -> None:
    forth = np.linspace(0.0, 0.5, 50)
    window = (-0.01, 0.57)
    assert room_beyond_m(window, forth) == pytest.approx(0.07), "it only sets out from the near end"
    assert room_beyond_m(window, np.concatenate([forth, forth[::-1]])) == pytest.approx(0.01)
    assert room_beyond_m(window, forth[::-1]) == pytest.approx(0.01)
    assert room_beyond_m(window, forth + 0.1) == 0.0
    assert room_beyond_m(window, np.full(9, 0.2)) == 0.0


@pytest.mark.parametrize(("off_m", "allowed_m"), [(1e-4, 2.3e-3), (5e-3, 17e-3), (50e-3, 35e-3)])
def test_an_axis_may_be_off_by_what_is_not_known_of_it_but_for_half_of_the_room(complete: Complete, off_m: float, allowed_m: float) -> None:
    model, t = complete.final.fit.model, np.linspace(0.0, 1.0, 9)

    def predict(on: Model, _stretch_m: float) -> PredictedMove:
        error = 1e-4 if on is model else off_m
        return PredictedMove(t, t, t - error, t - error, t, 0.0 * t, 0.0, ())

    assert allowed_lag_m(model, predict, 0.07) == pytest.approx(allowed_m)


@pytest.mark.parametrize(("leaves_mm", "chosen"), [([0.0, 5.0, 9.0], 0), ([58.0, 28.0, 6.0, 7.0, 11.0], 2), ([30.0, 0.0, 5.0], 1)])
def test_of_motions_of_which_none_keeps_inside_that_which_leaves_it_least_is_made(leaves_mm: list[float], chosen: int) -> None:
    """Slower is no remedy: friction that a weak loop does not know drives the axis the further, the longer a motion takes."""

    class Stops:
        def stops_badly(self, *_: object) -> str:
            return ""

    paths = [replace(PATH, position_m=PATH.position_m + number) for number in range(len(leaves_mm))]
    tried = iter(paths + paths[-1:] * 99)

    def leaves_by_m(path: Trajectory, _enough_m: float) -> float:
        return 1e-3 * leaves_mm[round(float(path.position_m[0]))]

    assert phases.stoppable(Stops(), lambda _: next(tried), leaves_by_m) is paths[chosen]  # type: ignore[arg-type]


def test_a_sweep_begins_inside_what_short_strokes_left_to_it(
    make_bench: MakeBench, complete: Complete, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench, folder, began = make_bench(), RunFolder.create(tmp_path / "run", load_axis(AXIS)), []
    model = complete.final.fit.model

    def unsure(machine: Machine, _: Model) -> None:
        machine.free_share = 0.2

    def recorded(*_: object) -> None:
        began.append((machine.position_m, phases.stroke_ends(machine)))
        raise Refused("enough")

    monkeypatch.setattr(friction_feedforward, "learn_friction", unsure)
    with bench.open(bench.name) as drive, Machine(drive, load_axis(AXIS), folder, Silence()) as machine:
        strong, _ = commission.first_cascade(machine, Findings(), model, 0.25)
        stops.count_on_loop(machine, family_around(model), machine.write_cascade(strong), 1e-3)
        monkeypatch.setattr(machine, "record", recorded)
        with pytest.raises(Refused, match="enough"):
            recording_steps.measure_friction(machine, model)
    ((at_m, (first_m, last_m)),) = began
    assert first_m - 1e-3 < at_m < last_m + 1e-3
