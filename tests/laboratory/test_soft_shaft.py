"""A load on a coupling so soft that it swings at a few hertz, moved and never excited; values that a user knows; a sensor at the load."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from beltcomm.cli.main import cli
from beltcomm.laboratory.cross_checks import SecondSensor
from beltcomm.recording.signalfile import write_columns
from beltcomm.sentences.cross_checks import sensor_lines
from foreign.judged import as_run

PERIOD_S, SUB, STEP = 2e-3, 10, math.tau / 65536


def swinging(seed: int, values: Sequence[float], rows: int = 6000) -> dict[str, np.ndarray]:
    """Moves by a PI velocity loop: J θ'' = τ - b θ' - C sign θ' - F,  M x'' = F = k (θ - x) + d (θ' - x'); midpoint steps.

    values : J, M, k, d, b, C.
    """
    motor, load, stiffness, damping, viscous, friction = values
    rng, time, h = np.random.default_rng(seed), PERIOD_S * np.arange(rows), PERIOD_S / SUB
    wanted = sum(rng.uniform(2.0, 8.0) * np.sin(math.tau * hz * time + rng.uniform(0.0, math.tau)) for hz in rng.uniform(0.05, 1.5, 5))
    wanted = wanted * np.clip(time / 0.5, 0.0, 1.0) * np.clip((time[-1] - time) / 0.5, 0.0, 1.0)
    gain, summed = motor * math.tau * 15.0, 0.0
    state, torque, angle, beyond = np.zeros(4), np.zeros(rows), np.zeros(rows), np.zeros(rows)

    def rate(theta: float, omega: float, x: float, v: float) -> np.ndarray:
        pull = stiffness * (theta - x) + damping * (omega - v)
        return np.array([omega, (torque[k] - viscous * omega - friction * math.tanh(omega / 0.02) - pull) / motor, v, pull / load])

    for k in range(rows):
        summed += 10.0 * gain * PERIOD_S * (wanted[k] - state[1])
        torque[k] = gain * (wanted[k] - state[1]) + summed
        angle[k], beyond[k] = state[0], state[2]
        for _ in range(SUB):
            state = state + h * rate(*(state + 0.5 * h * rate(*state)))
    read = torque + rng.normal(0.0, 1e-3 * torque.std(), rows)
    return {
        "t_s": time,
        "torque_nm": read,
        "position_rad": STEP * np.round(angle / STEP),
        "load_position_rad": STEP * np.round(beyond / STEP),
    }


def drawn(seed: int, folder: Path) -> tuple[Path, tuple[float, ...], float]:
    """A run of three records, the values that they were made with, and how fast the load swings on a held motor, Hz."""
    rng = np.random.default_rng(seed)
    motor = 10.0 ** rng.uniform(-3.7, -3.0)
    load, hertz = motor * rng.uniform(1.0, 5.0), rng.uniform(1.0, 3.0)
    stiffness = load * (math.tau * hertz) ** 2
    values = (motor, load, stiffness, 2.0 * rng.uniform(0.01, 0.04) * math.sqrt(stiffness * load), 2.0 * motor, rng.uniform(0.01, 0.03))
    files = {name: folder / f"{name}.csv" for name in ("a", "b", "held")}
    for number, file in enumerate(files.values()):
        write_columns(file, swinging(10 * seed + number, values))
    return as_run(files, folder / "run", 0.95 * motor, 65536, ["--closed-loop"]), values, hertz


def call(*words: object) -> Result:
    return CliRunner().invoke(cli, [str(word) for word in words])


@pytest.mark.examination
@pytest.mark.parametrize("seed", [31, 32])
def test_a_soft_shaft_is_named_with_its_values_and_a_sensor_at_the_load_confirms_it(seed: int, tmp_path: Path) -> None:
    run, (_, load, stiffness, *_rest), hertz = drawn(seed, tmp_path)
    outcome = call("diagnose", run, "--auto", "--no-cost", "--json")
    assert outcome.exit_code == 0, outcome.output
    assert "+elastic_shaft" in json.loads(outcome.stdout)["revisions"][1]["change"]
    found = json.loads(call("compare", run, "--no-pictures", "--json").stdout)
    model = found["model"]["parameters"]
    assert model["load.inertia"]["value"] == pytest.approx(load, rel=0.1)
    assert model["elastic_shaft.stiffness"]["value"] == pytest.approx(stiffness, rel=0.1)
    assert found["second_sensor"]["antiresonance_hz"] == pytest.approx(hertz, rel=0.02)
    assert found["second_sensor"]["confirmed"] is True


def test_values_that_a_user_knows_are_taken_by_name_within_their_bounds_and_once(tmp_path: Path) -> None:
    rng, time = np.random.default_rng(7), PERIOD_S * np.arange(1500)
    angle = sum(rng.uniform(1.0, 3.0) * np.sin(math.tau * hz * time) for hz in (0.4, 0.9, 1.7))
    speed = np.gradient(angle, PERIOD_S)
    torque = 2e-4 * np.gradient(speed, PERIOD_S) + 0.02 * np.tanh(speed) + rng.normal(0.0, 1e-3, len(time))
    write_columns(tmp_path / "a.csv", {"t_s": time, "torque_nm": torque, "position_rad": STEP * np.round(angle / STEP)})
    run = as_run({"a": tmp_path / "a.csv"}, tmp_path / "run", 2e-4, 65536)
    for given, said in (
        (("stifness=3",), "did you mean stiffness"),
        (("load.inertia=99",), "it lies between 1e-08 and 10 kg m2"),
        (("stiffness=nan",), "no start value"),
        (("elastic_shaft.stiffness=3", "stiffness=4"), "--start says stiffness twice"),
    ):
        outcome = call("add", "elastic_shaft", run, *(word for one in given for word in ("--start", one)), "--no-cost", "--no-pictures")
        assert (outcome.exit_code, said in outcome.stderr) == (2, True), outcome.output
    outcome = call("add", "quadratic_drag", run, "--start", "quadratic_drag.factor=1e-6", "--no-cost", "--no-pictures", "--json")
    assert outcome.exit_code == 0, outcome.output
    assert json.loads(outcome.stdout)["change"] == "+quadratic_drag"


@pytest.mark.parametrize(("model_hz", "said"), [(None, "one rigid body"), (5.5, "which confirms it"), (7.0, "which does not agree")])
def test_what_a_sensor_at_the_load_shows_stands_where_a_screen_cuts_no_sentence(model_hz: float | None, said: str) -> None:
    (line,) = sensor_lines(SecondSensor("load_position_rad", 5.458, 0.0027, 0.9, model_hz))
    assert said in line
    assert len(line.partition(",")[0]) < 70
