"""A loop closed on a plant: compiled and stepped alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from beltcomm.control import Cascade, Prefilter, new_state, reset_state
from beltcomm.errors import Refused
from beltcomm.model import Model, build_model
from beltcomm.simulate.loop import LoopDrive, LoopKind, close_loop, waiting_torque
from beltcomm.simulate.plant import SimulatedPlant
from identify.records import true_model
from truth.rigs import nominal

MODEL = true_model(nominal("g_a"))
CASCADE = Cascade(0.09, 0.37, 15.0, 0.004, Prefilter("butterworth", 123.0))


@dataclass
class Stepped:
    """A plant that only knows how to make a step."""

    inside: SimulatedPlant

    def __getattr__(self, name: str) -> float:
        return float(getattr(self.inside, name))

    def step(self, torque_nm: float, duration_s: float) -> None:
        self.inside.step(torque_nm, duration_s)


def plant(model: Model = MODEL) -> SimulatedPlant:
    return SimulatedPlant(model, 0.25)


LATE = MODEL.with_effect("dead_time", {"time": 1.3e-3}).with_effect("current_lag", {"time": 8e-4})
ERRING = MODEL.with_effect("encoder_eccentricity", {"sine": 2e-3, "cosine": 1e-3}).with_effect("encoder_eccentricity_2", {"sine": 1e-3})


@pytest.mark.parametrize("model", [MODEL, LATE, ERRING], ids=["plain", "late torque", "erring angle"])
@pytest.mark.parametrize("delay_s", [0.0, 0.4e-3, 1e-3, 2.3e-3])
@pytest.mark.parametrize("kind", ["velocity", "position"])
def test_compiled_is_the_same_as_stepped(kind: LoopKind, delay_s: float, model: Model) -> None:
    drive = LoopDrive(1e-3, delay_s, 1.24, 4096, dead_zone_rad=1e-4, output_limit_rad_s=8.0)
    t = 1e-3 * np.arange(600)
    speed = 12.0 * np.sin(9.0 * t)
    path = 3.0 + np.cumsum(speed) * 1e-3
    added = np.random.default_rng(1).normal(0.0, 0.1, len(t))
    fast = close_loop(plant(model), CASCADE, drive, kind, path, speed, added)
    slow = close_loop(Stepped(plant(model)), CASCADE, drive, kind, path, speed, added)
    assert np.abs(fast.position_rad).max() > 0.5
    for name in ("position_rad", "velocity_rad_s", "cart_m", "asked_nm", "torque_nm", "belt_force_n"):
        assert getattr(fast, name) == pytest.approx(getattr(slow, name), rel=1e-9, abs=1e-12), name


def test_a_plant_goes_on_where_a_loop_has_left_it() -> None:
    drive, none = LoopDrive(1e-3, 1e-3, 1.24, 4096), np.zeros(100)
    one = plant()
    close_loop(one, CASCADE, drive, "velocity", none, none + 10.0, none)
    assert one.velocity_rad_s > 1.0
    assert one.time_s == pytest.approx(0.1)
    before, speed = one.position_rad, one.velocity_rad_s
    one.step(0.0, 1e-6)
    assert one.position_rad == pytest.approx(before + 1e-6 * speed, rel=1e-6)


@pytest.mark.parametrize("delay_s", [0.0, 0.4e-3, 1e-3, 2.3e-3])
def test_a_loop_in_two_parts_is_one_loop(delay_s: float) -> None:
    """Also what it has asked for and does not act yet: without, an axis that brakes would be let go for the delay, and its belt swing."""
    drive, t = LoopDrive(1e-3, delay_s, 3.0, 4096), 1e-3 * np.arange(300)
    speed, none = 12.0 * np.sin(9.0 * t), np.zeros(len(t))
    whole = close_loop(plant(), CASCADE, drive, "velocity", none, speed, none, acceleration_rad_s2=none)
    one, state, waiting = plant(), new_state(), waiting_torque(CASCADE, drive)
    reset_state(state, 0.0)
    for part in (slice(0, 120), slice(120, 300)):
        go = (np.full(len(none[part]), one.position_rad), speed[part], none[part])
        last = close_loop(one, CASCADE, drive, "velocity", *go, acceleration_rad_s2=none[part], state=state, waiting_nm=waiting)
    assert last.torque_nm == pytest.approx(whole.torque_nm[120:], rel=1e-9, abs=1e-12)
    assert last.belt_force_n == pytest.approx(whole.belt_force_n[120:], rel=1e-9, abs=1e-9)


def test_a_carriage_that_leaves_its_belt_is_refused() -> None:
    model = build_model("by position", ("belt_spans", "belt_damping", "viscous_cart"), {})
    drive, none = LoopDrive(1e-3, 1e-3, 3.0, 4096), np.zeros(1000)
    with pytest.raises(Refused, match="has no belt; give it end stops"):
        close_loop(SimulatedPlant(model, 0.1), CASCADE, drive, "velocity", none, none, none - 3.0)
