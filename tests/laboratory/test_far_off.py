"""Models that lack something large, whose error could pass for noise: told as least squares has them, not by a noise that is theirs."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.fit.band_error import band_limited_errors, band_of
from beltcomm.fit.estimate import evaluate_at
from beltcomm.fit.least_squares import least_plain_error
from beltcomm.recording.signalfile import write_columns
from beltcomm.rundata.fitted_run import open_fitted
from beltcomm.talk import Silence
from foreign.judged import as_run, least_squares

PERIOD_S, SUB = 1e-3, 10


def pushed(
    seed: int,
    torque: np.ndarray,
    inertia: float,
    friction: tuple[float, float, float],
    weight_nm: float,
    counts: int,
    *,
    stiff: float = 0.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Torque that acts, with a soft spring's pull, and angle as shown: J θ'' = τ - c± tanh(θ'/ε) - d θ' - m g l sin θ, midpoint steps."""
    forward, backward, damping = friction
    theta, omega, h = 0.0, 0.0, PERIOD_S / SUB
    acting, angle = torque.copy(), np.zeros(len(torque))

    def rate(at: float, speed: float, applied: float) -> float:
        level = forward if speed > 0.0 else backward
        return (applied - weight_nm * math.sin(at) - damping * speed - level * math.tanh(speed / 0.05)) / inertia

    for k in range(len(torque)):
        angle[k] = theta
        acting[k] -= stiff * (theta + 0.1 * omega)
        for _ in range(SUB):
            middle = omega + 0.5 * h * rate(theta, omega, acting[k])
            omega += h * rate(theta + 0.5 * h * omega, middle, acting[k])
            theta += h * middle
    step = math.tau / counts
    return acting, step * np.round(angle / step)


@pytest.mark.examination
def test_a_command_in_steps_is_fitted_no_worse_than_by_least_squares(tmp_path: Path) -> None:
    """Friction that differs much by direction, by no term of the model: nothing but the motion tells how noisy a command is."""
    files = {}
    for name, seed in (("a", 1), ("b", 2)):
        rng = np.random.default_rng(seed)
        command = np.repeat(rng.permutation(np.tile([0.06, 0.05, -0.045, -0.03], 2)), 1000)
        _, angle = pushed(seed, command, 1.2e-4, (0.045, 0.02, 1e-4), 0.0, 154)
        files[name] = tmp_path / f"{name}.csv"
        write_columns(files[name], {"t_s": PERIOD_S * np.arange(len(angle)), "torque_nm": command, "position_rad": angle})
    opened = open_fitted(as_run(files, tmp_path / "run", 1.2e-4), Silence())
    data, fitted = opened.data, opened.fitted
    # whatever led a likelihood astray whose noise is what the model leaves
    astray = evaluate_at(data, fitted.problem, fitted.x * np.where(np.array(fitted.problem.free) == "coulomb.level", 0.7, 1.0))
    assert astray.ratio < 2.0
    band = band_of(data, fitted.model)
    for found in (fitted, least_plain_error(data, astray, 10)):
        pairs = list(zip((*data.fitted, *data.held_out), band_limited_errors(data, found, band), strict=True))
        own = [pair for pair in pairs if not pair[0].held_out]
        (squares,) = least_squares([own], [own], band)
        error, torque = (np.concatenate([getattr(part, name)[part.keep] for _, part in own]) for name in ("error", "torque"))
        assert np.linalg.norm(error) / np.linalg.norm(torque) < 1.03 * squares


@pytest.mark.examination
def test_a_rough_command_is_not_taken_for_noise_that_hides_a_weight(tmp_path: Path) -> None:
    """What acts jumps from row to row, as a noisy speed in a loop makes it, and the model lacks as much as the roughness looks like."""
    files = {}
    for name, seed in (("a", 3), ("b", 4), ("held", 5)):
        rng, time = np.random.default_rng(seed), PERIOD_S * np.arange(4000)
        slow = sum(0.35 * np.sin(math.tau * hz * time + rng.uniform(0.0, math.tau)) for hz in rng.uniform(0.3, 2.5, 4))
        acting, angle = pushed(seed, slow + rng.normal(0.0, 0.3, len(time)), 4e-3, (0.05, 0.05, 2e-3), 0.35, 65536, stiff=0.05)
        files[name] = tmp_path / f"{name}.csv"
        columns = {"t_s": time, "torque_nm": acting + rng.normal(0.0, 5e-3, len(time)), "position_rad": angle}
        write_columns(files[name], columns)
    run = as_run(files, tmp_path / "run", 3e-3, 65536)
    outcome = CliRunner().invoke(cli, ["diagnose", str(run), "--auto"])
    assert outcome.exit_code == 0, outcome.output
    assert "unbalance: weight of a load that turns" in outcome.stdout, outcome.output
    model = open_fitted(run, Silence()).fitted.model
    assert abs(math.hypot(model["unbalance.sine"], model["unbalance.cosine"]) / 0.35 - 1.0) < 0.02
    assert abs(model["motor.inertia"] / 4e-3 - 1.0) < 0.02


def shaken(seed: int, levels: tuple[float, float], shake: float, values: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """A command in two steps and the angle read, rougher than its counts; beside the command a torque that nobody records."""
    inertia, damping, friction, offset = values
    rng, rows = np.random.default_rng(seed), 12000
    command, turns, step = np.repeat(levels, rows // 2), math.tau * rng.uniform(20.0, 60.0), math.tau / 4096
    beside, angle, at, rate, theta, omega = np.zeros(rows), np.zeros(rows), 0.0, 0.0, 0.0, 0.0
    for k, kick in enumerate(rng.normal(size=rows)):
        rate += PERIOD_S * (-(turns**2) * at - 0.2 * turns * rate) + kick
        at += PERIOD_S * rate
        beside[k] = at
    acting, h = command - offset + beside * (shake / beside.std()), PERIOD_S / SUB
    for k in range(rows):
        angle[k] = theta
        for _ in range(SUB):
            middle = omega + 0.5 * h * (acting[k] - damping * omega - friction * math.tanh(2.0 * omega)) / inertia
            omega += h * (acting[k] - damping * middle - friction * math.tanh(2.0 * middle)) / inertia
            theta += h * middle
    return command, step * np.round(angle / step + rng.normal(0.0, rng.uniform(0.3, 0.8), rows))


@pytest.mark.examination
@pytest.mark.parametrize("seed", [61, 62])
def test_an_inertia_that_a_commands_motion_hides_is_not_lost_with_the_offset(seed: int, tmp_path: Path) -> None:
    """Each record goes one way: friction, offset and an inertia of nothing explain them alike, were it not for how fast they start."""
    rng = np.random.default_rng(seed)
    inertia, fast = 10.0 ** rng.uniform(-4.3, -3.7), rng.uniform(120.0, 250.0)
    damping = inertia / rng.uniform(0.5, 1.5)
    friction = rng.uniform(0.3, 1.5) * damping * fast
    offset = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 0.6) * friction
    files = {}
    for number, (name, way, share) in enumerate((("forward", 1.0, 0.6), ("backward", -1.0, 0.65), ("held", 1.0, 0.7))):
        levels = (way * (friction + share * damping * fast) + offset, way * (friction + damping * fast) + offset)
        shake = rng.uniform(0.03, 0.15) * damping * fast
        command, angle = shaken(10 * seed + number, levels, shake, (inertia, damping, friction, offset))
        files[name] = tmp_path / f"{name}.csv"
        write_columns(files[name], {"t_s": PERIOD_S * np.arange(len(angle)), "torque_nm": command, "position_rad": angle})
    run = as_run(files, tmp_path / "run", 0.8 * inertia, 4096)
    outcome = CliRunner().invoke(cli, ["diagnose", str(run), "--auto", "--no-cost", "--json"])
    assert outcome.exit_code == 0, outcome.output
    assert [rung["change"] for rung in json.loads(outcome.stdout)["revisions"]] == ["base", "+constant_offset"]
    model = open_fitted(run, Silence()).fitted.model
    assert abs(model["motor.inertia"] / inertia - 1.0) < 0.2
    assert abs(model["constant_offset.torque"] / offset - 1.0) < 0.2
