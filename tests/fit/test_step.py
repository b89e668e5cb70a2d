"""Step of an encoder by the angles alone: fine and coarse, rounded by the file, or none; and a motor that is right with each."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from beltcomm import api
from beltcomm.fit.noise.decimation import smallest_step
from beltcomm.foreign.convert import Reading
from beltcomm.recording.signalfile import write_columns
from marks import quick

T = np.arange(6000) * 1e-3


def angle(bits: int) -> np.ndarray:
    step = 2.0 * np.pi / 2**bits
    return np.asarray(np.round((4.0 * np.sin(4.4 * T) + 1.2 * np.sin(18.0 * T)) / step) * step)


@pytest.mark.parametrize("bits", [9, 12, 14, 16, 18, 20, 22])
@pytest.mark.parametrize("digits", [None, 7])
def test_the_step_of_a_fine_encoder_is_not_a_few_of_it(bits: int, digits: int | None) -> None:
    position = angle(bits) if digits is None else np.round(angle(bits), digits)
    assert smallest_step(position) == pytest.approx(2.0 * np.pi / 2**bits, rel=0.005)


def test_an_angle_without_steps_has_none() -> None:
    position = angle(14) + np.random.default_rng(1).normal(0.0, 1e-4, len(T))
    assert smallest_step(position) == pytest.approx(np.percentile(np.diff(np.unique(position)), 2))


def motor(seed: int, bits: int, *, after_the_row: bool = False, analog: bool = False) -> dict[str, np.ndarray]:
    """A motor with friction, asked by a loop of its own, integrated in steps of 25 us; 6 s at 1 kHz.

    after_the_row : the angle is that at the end of the period of its torque, as some recorders write it.
    analog : the angle has noise of 0.1 mrad and no steps.
    """
    draw = np.random.default_rng(seed)
    inertia, damping, coulomb, noise = draw.uniform(1e-3, 4e-3), draw.uniform(2e-3, 1e-2), draw.uniform(0.05, 0.2), draw.uniform(1e-3, 6e-3)
    frequencies = draw.uniform((0.5, 2.0, 20.0), (0.9, 4.0, 45.0))
    place, speed, angles, torques = 0.0, 0.0, [], []
    for t in T:
        wanted = 4.0 * np.sin(2.0 * np.pi * frequencies[0] * t) + 1.2 * np.sin(2.0 * np.pi * frequencies[1] * t)
        shaken = 0.15 * np.sin(2.0 * np.pi * frequencies[2] * t) * (t % 2.0 < 1.0)
        torque = float(np.clip(0.9 * (wanted - place) - 0.05 * speed + shaken, -2.5, 2.5))
        before = place
        for _ in range(40):
            gained = (torque - damping * speed - coulomb * np.tanh(speed / 0.01)) / inertia * 2.5e-5
            place += (speed + 0.5 * gained) * 2.5e-5
            speed += gained
        angles.append(place if after_the_row else before)
        torques.append(torque)
    step = 2.0 * np.pi / 2**bits
    asked = np.array(torques)
    read = asked + draw.normal(0.0, noise, len(T))
    shown = np.array(angles) + draw.normal(0.0, 1e-4, len(T)) if analog else np.round(np.array(angles) / step) * step
    return {"t_s": T, "torque_nm": read, "torque_setpoint_nm": asked, "position_rad": shown}


def diagnosis_of(columns: dict[str, np.ndarray], place: Path) -> api.Result:
    write_columns(place / "log.csv", columns)
    api.import_recordings([place / "log.csv"], place / "run", Reading())
    return api.diagnose(place / "run")


@pytest.mark.parametrize(("seed", "bits"), quick([(4, 18), (5, 20), (6, 22), (7, 16), (8, 19), (9, 24)], 1))
@pytest.mark.parametrize("asked", quick([True, False], 1))
def test_nothing_is_missing_with_any_encoder(tmp_path: Path, seed: int, bits: int, asked: bool) -> None:
    columns = motor(seed, bits)
    found = diagnosis_of(columns if asked else {n: c for n, c in columns.items() if n != "torque_setpoint_nm"}, tmp_path)
    assert found.data["verdict"] == "nothing missing"
    assert found.data["base"]["ratio"] == pytest.approx(1.0, abs=0.05)


def test_a_torque_that_stands_a_row_early_is_told_with_the_way_out(tmp_path: Path) -> None:
    found = diagnosis_of(motor(4, 18, after_the_row=True), tmp_path)
    assert "import the records again with --torque-acts before" in "\n".join(found.lines())


@pytest.mark.parametrize("seed", quick([21, 22, 23, 27], 1))
def test_an_angle_without_steps_is_noisy_and_nothing_is_missing(tmp_path: Path, seed: int) -> None:
    """Where the torque never rests nothing shows how noisy it is, but its own roughness: by its small differences it had no noise."""
    found = diagnosis_of(motor(seed, 16, analog=True), tmp_path)
    assert found.data["verdict"] == "nothing missing"
    assert found.data["base"]["ratio"] == pytest.approx(1.0, abs=0.05)
