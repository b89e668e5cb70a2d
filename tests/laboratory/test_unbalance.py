"""A weight on the motor's shaft, by a pendulum integrated here: found by name, its size and where it hangs."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from beltcomm.cli.main import cli
from beltcomm.recording.checks import backwards
from beltcomm.recording.signalfile import write_columns
from beltcomm.rundata.revisions import current_model, revisions
from beltcomm.runfolder import RunFolder

INERTIA, WEIGHT_NM, HANGS_RAD, COULOMB, VISCOUS = 4.2e-4, 0.13, 0.7, 0.05, 1.5e-3
PERIOD_S, SUB = 1e-3, 10


def pendulum(seed: int, size: int = 8000) -> dict[str, np.ndarray]:
    """Torque in steps, angle of a pendulum with friction: J θ'' = τ - m g l sin(θ - θ0) - d θ' - c tanh(θ'/ε), midpoint steps of 0.1 ms."""
    rng = np.random.default_rng(seed)
    torque = np.repeat(rng.normal(0.0, 0.25, size // 40), 40)
    angle, speed, angles = 0.3, 0.0, []
    h = PERIOD_S / SUB

    def rate(theta: float, omega: float, applied: float) -> float:
        weight = WEIGHT_NM * math.sin(theta - HANGS_RAD)
        return (applied - weight - VISCOUS * omega - COULOMB * math.tanh(omega / 0.01)) / INERTIA

    for applied in torque:
        angles.append(angle)
        for _ in range(SUB):
            middle = speed + 0.5 * h * rate(angle, speed, applied)
            speed += h * rate(angle + 0.5 * h * speed, middle, applied)
            angle += h * middle
    step = 2.0 * math.pi / 65536
    return {
        "t_s": PERIOD_S * np.arange(size),
        "torque_nm": torque + rng.normal(0.0, 2e-3, size),
        "position_rad": step * np.round(np.array(angles) / step),
    }


@pytest.mark.examination
def test_a_pendulum_is_named_and_measured(tmp_path: Path) -> None:
    run, runner = tmp_path / "run", CliRunner()
    for name, seed in (("a", 1), ("b", 2), ("held", 3)):
        write_columns(tmp_path / f"{name}.csv", pendulum(seed))
        words = ["import", str(tmp_path / f"{name}.csv"), "--run", str(run), *(["--held-out"] if name == "held" else [])]
        words += ["--set", "name=pendulum", "--set", "motor.inertia_kg_m2=0.0003", "--set", "motor.encoder_counts_per_rev=65536"] * (
            name == "a"
        )
        outcome = runner.invoke(cli, words)
        assert outcome.exit_code == 0, outcome.output
    outcome = runner.invoke(cli, ["diagnose", str(run), "--auto"])
    assert outcome.exit_code == 0, outcome.output
    model = current_model(RunFolder.open(run))
    assert model is not None
    assert "unbalance" in model.effects
    sine, cosine = model["unbalance.sine"], model["unbalance.cosine"]
    assert abs(math.hypot(sine, cosine) / WEIGHT_NM - 1.0) < 0.02
    assert abs(math.atan2(-cosine, sine) - HANGS_RAD) < 0.02
    assert abs(model["motor.inertia"] / INERTIA - 1.0) < 0.02
    assert f"beltcomm report {run}" in outcome.stdout  # a design is refused on an axis without a belt
    removed = runner.invoke(cli, ["remove", "unbalance", str(run)])
    assert removed.exit_code == 0, removed.output
    first, *_, last = revisions(RunFolder.open(run))
    compared = runner.invoke(cli, ["compare", str(run), "--no-pictures", "--json"])
    assert compared.exit_code == 0, compared.output
    shown = json.loads(compared.stdout)["ratio"]["overall"]
    assert last.change == "-unbalance"
    assert (last.ratio, shown) == pytest.approx((first.ratio, first.ratio), rel=1e-9), "the same model reads the same number"
    for wrong, said in (("ordr=1", "has no parameter 'ordr'"), ("order=1e9", "it lies between"), ("order", "is no start value")):
        outcome = runner.invoke(cli, ["add", "unbalance", str(run), "--start", wrong])
        assert outcome.exit_code == 2, outcome.output
        assert said in outcome.output
    outcome = runner.invoke(cli, ["add", "unbalance", str(run), "--start", "order=1", "--start", "sine=0.05"])
    assert outcome.exit_code == 0, outcome.output
    again = current_model(RunFolder.open(run))
    assert again is not None
    assert abs(math.hypot(again["unbalance.sine"], again["unbalance.cosine"]) / WEIGHT_NM - 1.0) < 0.02


def test_a_pendulum_with_a_wrong_sign_is_told_from_one_in_time_backwards() -> None:
    found = pendulum(4)
    t, torque, angle = (found[name] for name in ("t_s", "torque_nm", "position_rad"))
    heavy = torque + 2.0 * np.sin(angle - HANGS_RAD)  # of a motor that bears a weight of more than its friction and inertia
    assert not backwards(t, heavy, angle)
    assert not backwards(t, -heavy, angle)
    assert backwards(t, heavy[::-1], angle[::-1])
