"""An encoder whose tracks are not alike: its lines are found by their number, far above the sampling rate, and nowhere else."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from numpy.typing import NDArray

from beltcomm.cli.main import cli
from beltcomm.effects import AxisSummary, effect_named
from beltcomm.effects.encoder_interpolation import LINES, _correction, _implausible, _trials
from beltcomm.fit.estimate import Fitted
from beltcomm.fit.start.model import start_model
from beltcomm.laboratory.acceptance import EVIDENCE
from beltcomm.laboratory.diagnosis import diagnose, fit_base_of
from beltcomm.laboratory.score import Scored, Scorer, ground_of
from beltcomm.laboratory.selection import _expected_gain
from beltcomm.runfolder import RunFolder
from beltcomm.simulate.imperfect import angle_sensor
from beltcomm.simulate.inverse import reconstruct, true_motion
from identify.records import true_model
from truth.hidden import Machine, draw, write_session
from truth.hidden import layout as at
from truth.hidden.machines import Base
from truth.rigs import nominal

NAME = "encoder_interpolation"
#: What the third harmonic, which the law leaves out, adds to the error over the noise: without it 1.01 is left.
THIRD = 0.04


@pytest.fixture(scope="module", autouse=True)
def fine_counts() -> Iterator[None]:
    """Encoders of a million counts, as sin/cos encoders are read; the machines' own have 31 000."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Base, "quantum_rad", property(lambda _: math.tau / 2**20))
        yield


def with_lines(seed: int, lines: int) -> Machine:
    """A machine whose encoder errs by 1e-4 rad once per line, twice and three times by its draw."""
    machine = draw(seed, (NAME,))
    machine.p[[at.LINE, at.LINE_SECOND, at.LINE_THIRD]] *= 1e-4 / machine.p[at.LINE]
    machine.p[at.LINES] = lines
    return machine


@pytest.fixture(scope="module")
def erring(tmp_path_factory: pytest.TempPathFactory) -> tuple[RunFolder, Machine]:
    """The run folder of a machine with an encoder of 512 lines."""
    machine = with_lines(951002, 512)
    folder = tmp_path_factory.mktemp("lines") / "run"
    write_session(machine, folder, plan="default")
    return RunFolder.open(folder), machine


def scored(run: RunFolder, *, without: str = "frf") -> tuple[Fitted, list[Scored]]:
    """The base model fitted to records that are quick, and the ways of the effect, best first."""
    recordings = [r for r in run.recordings() if without not in r.name]
    data, base = fit_base_of(recordings, run.axis, start_model(run.axis, recordings))
    return base, Scorer(base).score(effect_named(NAME), ground_of(base, data.fitted, run.axis))


@pytest.mark.examination
def test_the_lines_are_named_and_counted(erring: tuple[RunFolder, Machine]) -> None:
    run, machine = erring
    found = diagnose(run.recordings(), run.axis, start_model(run.axis, run.recordings()))
    assert found.added_effects == [NAME]
    model = found.final_fit.model
    assert model[f"{NAME}.lines"] == 512
    once, twice = (math.hypot(model[f"{NAME}.sine{n}"], model[f"{NAME}.cosine{n}"]) for n in ("", "_2"))
    assert once == pytest.approx(1e-4, rel=0.05)
    assert twice == pytest.approx(machine.p[at.LINE_SECOND], rel=0.1)
    assert found.base.ratio > 1.5
    assert found.final_fit.ratio == pytest.approx(1.0 + THIRD, abs=0.03)


@pytest.mark.examination
def test_added_by_hand_the_error_falls(erring: tuple[RunFolder, Machine], tmp_path: Path) -> None:
    run = shutil.copytree(erring[0].path, tmp_path / "run")
    result = CliRunner().invoke(cli, ["add", NAME, str(run), "--no-cost", "--no-pictures", "--json"], standalone_mode=False)
    assert result.exception is None, result.exception
    added = json.loads(result.stdout)
    assert added["confirmed"]
    assert added["parameters"][f"{NAME}.lines"]["value"] == 512
    assert added["after"]["ratio"] < 1.03 + THIRD < added["before"]["ratio"]
    assert added["after"]["held_out"] < added["before"]["held_out"]


@pytest.mark.examination
def test_lines_that_pass_faster_than_samples_are_counted(tmp_path: Path) -> None:
    write_session(with_lines(951001, 2048), tmp_path / "run", plan="default")
    base, ways = scored(RunFolder.open(tmp_path / "run"))
    assert _expected_gain(ways[0], base, len(LINES)) > EVIDENCE
    assert ways[0].values["lines"] == 2048


@pytest.mark.examination
def test_no_lines_are_seen_where_there_are_none(tmp_path: Path) -> None:
    write_session(draw(951003), tmp_path / "run", plan="default")
    base, ways = scored(RunFolder.open(tmp_path / "run"))
    assert _expected_gain(ways[0], base, len(LINES)) < 0.0, "not even promising"


def test_only_what_the_angle_resolves_is_tried() -> None:
    ground = AxisSummary(7e-5, 4.0, 2e5, 20.0, 0.1, 0.0125, 0.0, 0.5, 35.0, 26.0, 2.0, 100.0)

    def tried(counts: float, steps: float) -> set[float]:
        return {t.values["lines"] for t in _trials(replace(ground, counts=counts, step_rad=math.tau / steps))}

    assert {128, 512, 1000, 1024, 1250, 2000, 2048, 2500, 4096, 5000} <= tried(2.0**20, 2.0**20)
    assert 3 * 2**10 - 1 not in tried(2.0**20, 2.0**20)
    assert 3 * 2**10 - 1 in tried(64.0 * (3 * 2**10 - 1), 1e6), "the counts of the axis file in 64 steps a line"
    assert max(tried(2.0**20, 4096.0)) == 512, "whatever the axis file says, the angle in the records has no more steps"


def lines_of(sine: float, cosine: float, sine_2: float, cosine_2: float, angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """What an encoder of 2048 lines shows at true angles, by the definition."""
    n = 2048.0 * angle
    return angle + sine * np.sin(n) + cosine * np.cos(n) + sine_2 * np.sin(2.0 * n) + cosine_2 * np.cos(2.0 * n)


def test_the_law_is_the_inverse_of_what_the_encoder_shows() -> None:
    values = (8e-5, -6e-5, 3e-5, 4e-5)  # the angle shown rises by up to 0.4 more or less than the true one
    angle = np.linspace(3.0, 3.01, 301)
    shown = lines_of(*values, angle)
    true = [theta + _correction(theta, 2048.0, *values) for theta in shown.tolist()]
    assert np.abs(true - angle).max() < 1e-9
    model = true_model(nominal("g_a")).with_effect(
        NAME, {"lines": 2048.0, **dict(zip(("sine", "cosine", "sine_2", "cosine_2"), values, strict=True))}
    )
    assert np.abs(np.array([angle_sensor(model)(a) for a in angle.tolist()]) - shown).max() < 1e-9


def test_between_samples_the_error_of_many_lines_is_not_there() -> None:
    """At 40 rad/s 13 lines pass in a millisecond: made true, the motion is as smooth as it was, speed and all."""
    values, fine, t = (8e-5, -6e-5, 3e-5, 4e-5), 16, 1e-3 / 16 * np.arange(16 * 400 + 1)
    angle, speed = 2.0 + 40.0 * t + 0.3 * np.sin(30.0 * t), 40.0 + 9.0 * np.cos(30.0 * t)
    shown = lines_of(*values, angle[::fine])
    model = true_model(nominal("g_a")).with_effect(
        NAME, {"lines": 2048.0, **dict(zip(("sine", "cosine", "sine_2", "cosine_2"), values, strict=True))}
    )
    motion = reconstruct(shown, np.zeros(len(shown)), 1e-3, model["motor.inertia"], start_rad=float(shown[0]), substeps=fine)
    true = true_motion(model, motion)
    inside = slice(10 * fine, -10 * fine)
    assert np.abs(motion.omega - speed)[inside].max() > 0.1, "the shown speed is noisy"
    assert np.abs(true.omega - speed)[inside].max() < 1e-3
    assert np.abs(true.theta - angle)[inside].max() < 1e-8


def test_an_angle_that_runs_back_is_no_machine() -> None:
    size = {"sine": 1e-4, "cosine": 0.0, "sine_2": 0.0, "cosine_2": 1e-4}
    assert _implausible({"lines": 2048.0, **size}) == ""
    assert _implausible({"lines": 5000.0, **size}) == "an error that moves 1.5 times as fast as the shaft"
