"""Records with different loads, integrated here: stated or named with the records, on a motor alone and behind a belt."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm.axis.kinds import ARC_M
from beltcomm.cli.main import cli
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.uncertainty.intervals import with_intervals
from beltcomm.model.value import Value
from beltcomm.recording.signalfile import write_columns
from beltcomm.rundata.fitted_run import _own_loads, open_fitted
from beltcomm.talk import Silence

PERIOD_S, SUB, STEP = 1e-3, 20, math.tau / 65536
INERTIA, DISC, CUP, COULOMB, VISCOUS = 2e-3, 1.6e-3, 5e-4, 0.05, 2e-3
RATIO, MOTOR, MASS, MORE, STIFFNESS, DAMPING = 0.01242, 7.3e-5, 1.4, 0.9, 4.2e5, 40.0
MOTOR_ALONE = ("name=disc", "motor.inertia_kg_m2=0.0003", "motor.encoder_counts_per_rev=65536")


def columns(rng: np.random.Generator, torque: np.ndarray, angle: list[float], noise_nm: float) -> dict[str, np.ndarray]:
    """As a logger writes them."""
    return {
        "t_s": PERIOD_S * np.arange(len(angle)),
        "torque_nm": torque + rng.normal(0.0, noise_nm, len(angle)),
        "position_rad": STEP * np.round(np.array(angle) / STEP),
    }


def turning(seed: int, inertia: float, size: int = 6000) -> dict[str, np.ndarray]:
    """A motor with a load on its shaft, shaken by sines and held by a soft controller: semi-implicit steps of 50 µs."""
    rng, h = np.random.default_rng(seed), PERIOD_S / SUB
    hz, size_nm, phase = rng.uniform(0.5, 6.0, 6), rng.uniform(0.05, 0.15, 6), rng.uniform(0.0, math.tau, 6)
    theta, omega, angle, torque = 0.0, 0.0, [], []
    for k in range(size):
        applied = float(np.sum(size_nm * np.sin(math.tau * hz * k * PERIOD_S + phase))) - 0.05 * theta - 0.02 * omega
        angle.append(theta)
        torque.append(applied)
        for _ in range(SUB):
            omega += h * (applied - VISCOUS * omega - COULOMB * math.tanh(omega / 0.02)) / inertia
            theta += h * omega
    return columns(rng, np.array(torque), angle, 3e-3)


def carried(seed: int, mass: float, size: int = 6000) -> dict[str, np.ndarray]:
    """A carriage on a belt, shaken by steps of 20 ms: the same steps, in which the motor's friction acts."""
    rng, h = np.random.default_rng(seed), PERIOD_S / SUB
    torque = np.repeat(rng.normal(0.0, 0.35, size // 20), 20)
    theta, omega, x, v, angle = 0.0, 0.0, 0.0, 0.0, []
    for k in range(size):
        torque[k] -= 0.01 * theta + 0.002 * omega
        applied = float(torque[k])
        angle.append(theta)
        for _ in range(SUB):
            pull = STIFFNESS * (RATIO * theta - x) + DAMPING * (RATIO * omega - v)
            omega += h * (applied - RATIO * pull - 3e-4 * omega - COULOMB * math.tanh(omega / 0.02)) / MOTOR
            v += h * pull / mass
            theta += h * omega
            x += h * v
    return columns(rng, torque, angle, 2e-3)


def run_of(folder: Path, records: dict[str, tuple[dict[str, np.ndarray], tuple[str, ...]]], axis: tuple[str, ...]) -> Path:
    """A run folder of records, each with words of its own on the command line."""
    for name, (signals, words) in records.items():
        write_columns(folder / f"{name}.csv", signals)
        outcome = call("import", str(folder / f"{name}.csv"), "--run", str(folder / "run"), *words, *axis)
        assert outcome.exit_code == 0, outcome.output
        axis = ()
    return folder / "run"


def call(*words: str) -> Result:
    """A command."""
    return CliRunner().invoke(cli, list(words))


def fitted(run: Path) -> Fitted:
    """Its model fitted to its records."""
    return open_fitted(run, Silence()).fitted


def inside(item: Value, truth: float, widest: float) -> bool:
    """True if a value is known, well, and right within three quarters more than its interval."""
    assert item.interval is not None
    return abs(item.value - truth) < 1.75 * item.interval < 1.75 * widest * truth


def set_words(*entries: str) -> tuple[str, ...]:
    """Entries of an axis file on the command line."""
    return tuple(word for entry in entries for word in ("--set", entry))


@pytest.mark.examination
def test_loads_that_are_named_are_found_with_intervals(tmp_path: Path) -> None:
    records = {
        "a": (turning(1, INERTIA), ("--load", "bare")),
        "b": (turning(2, INERTIA + DISC), ("--load", "disc")),
        "c": (turning(3, INERTIA + CUP), ("--load", "cup")),
        "d": (turning(4, INERTIA + DISC), ("--load", "disc", "--held-out")),
    }
    run = run_of(tmp_path, records, set_words(*MOTOR_ALONE))
    found = fitted(run)
    model = with_intervals(found).parameters
    assert inside(model["motor.inertia"], INERTIA, 0.004)
    assert inside(model["other_inertia.inertia"], INERTIA + DISC, 0.004)
    assert inside(model["other_inertia_2.inertia"], INERTIA + CUP, 0.004)
    assert max(found.ratio, found.held_out_ratio or 9.0) < 1.05
    outcome = call("compare", str(run), "--details")
    assert "in b, d with 'disc'" in outcome.stdout, outcome.output
    told = json.loads(call("compare", str(run), "--json").stdout)["model"]["parameters"]["motor.inertia"]
    assert (told["value"], told["interval"]) == (model["motor.inertia"].value, model["motor.inertia"].interval)
    outcome = call("diagnose", str(run))
    assert "NOTHING MISSING" in outcome.stdout, outcome.output
    outcome = call("add", "cogging", str(run))
    assert outcome.exit_code == 0, outcome.output
    assert "other_inertia_2" in "".join(fitted(run).model.effects)


def test_loads_that_are_stated_are_one_inertia(tmp_path: Path) -> None:
    records = {
        "a": (turning(1, INERTIA), ()),
        "b": (turning(2, INERTIA + DISC), ("--payload", "16kgcm2")),
        "c": (turning(3, INERTIA + CUP), ("--payload", "0.0005 kg m²", "--held-out")),
    }
    found = fitted(run_of(tmp_path, records, set_words(*MOTOR_ALONE)))
    assert inside(with_intervals(found).parameters["motor.inertia"], INERTIA, 0.004)
    assert "other_inertia" not in found.model.effects
    assert max(found.ratio, found.held_out_ratio or 9.0) < 1.05


@pytest.mark.examination
@pytest.mark.parametrize("word", ["--payload", "--load"])
def test_a_carriage_with_and_without_a_payload(tmp_path: Path, word: str) -> None:
    given = {"--payload": ("--payload", f"{MORE:g}kg"), "--load": ("--load", "box")}[word]
    records = {"a": (carried(5, MASS), ()), "b": (carried(6, MASS + MORE), given), "c": (carried(7, MASS + MORE), (*given, "--held-out"))}
    run = run_of(tmp_path, records, ("--axis", "egc-70-600"))
    found = fitted(run)
    model = with_intervals(found).parameters
    assert inside(model["cart.mass"], MASS, 0.02)
    if word == "--load":
        assert inside(model["other_load.mass"], MASS + MORE, 0.02)
    assert max(found.ratio, found.held_out_ratio or 9.0) < 1.1


@pytest.mark.examination
def test_a_table_with_and_without_a_workpiece_in_its_own_terms(tmp_path: Path) -> None:
    records = {
        "a": (turning(1, 0.0222), ("--payload", "0kgm2")),
        "b": (turning(2, 0.0222 + 0.006), ("--payload", "60kgcm2")),
        "c": (turning(3, 0.0222 + 0.004), ("--load", "vice")),
    }
    run = run_of(tmp_path, records, ("--axis", "torque-table"))
    parameters = with_intervals(fitted(run)).parameters
    assert inside(parameters["cart.mass"], 0.013 / ARC_M**2, 0.2)  # so heavy a table hardly moves under this torque
    assert inside(parameters["other_load.mass"], 0.017 / ARC_M**2, 0.2)
    said = call("compare", str(run), "--details").stdout
    assert "b (and +0.006 kg m², stated)" in said, said


def test_loads_that_nobody_mentions_are_refused_with_the_way_out(tmp_path: Path) -> None:
    records = {"a": (turning(1, INERTIA), ()), "b": (turning(2, INERTIA + DISC), ())}
    outcome = call("compare", str(run_of(tmp_path, records, set_words(*MOTOR_ALONE))), "--details")
    assert outcome.exit_code == 3
    assert "a show an inertia of 0.00200" in outcome.output.replace("0.002 ", "0.00200 ")
    assert "--load" in outcome.output


def test_a_load_that_no_fitted_record_carries_is_refused(tmp_path: Path) -> None:
    records = {"a": (turning(1, INERTIA), ()), "b": (turning(2, INERTIA + CUP), ("--load", "cup", "--held-out"))}
    outcome = call("compare", str(run_of(tmp_path, records, set_words(*MOTOR_ALONE))), "--details")
    assert outcome.exit_code == 3
    assert "b is held out and carries 'cup'" in outcome.output


@pytest.mark.examination
def test_a_load_that_nobody_mentions_and_that_is_not_refused_is_told(tmp_path: Path) -> None:
    records = {"a": (turning(1, INERTIA), ()), "b": (turning(2, 1.12 * INERTIA), ()), "c": (turning(3, INERTIA), ())}
    (tmp_path / "alike").mkdir()
    found = _own_loads(fitted(run_of(tmp_path, records, set_words(*MOTOR_ALONE))))
    assert [load.record for load in found][:1] == ["b"]
    assert abs(found[0].mass / (1.12 * INERTIA) - 1.0) < 0.02
    alike = {"a": records["a"], "c": records["c"]}
    assert _own_loads(fitted(run_of(tmp_path / "alike", alike, set_words(*MOTOR_ALONE)))) == []
