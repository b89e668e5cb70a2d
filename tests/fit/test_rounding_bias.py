"""Coarse encoders: what rounding adds to the squares pulls at no parameter; an inertia alone is integrated here, exactly."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.fit import base
from beltcomm.fit.base import refit_with_rebuilt_motion
from beltcomm.fit.estimate import problem_of
from beltcomm.fit.model_fit import ModelFit, fit_model
from beltcomm.fit.records import prepare_records
from beltcomm.fit.residual.rounding_bias import RoundingBias
from beltcomm.fit.residual.whitened import evaluate
from beltcomm.fit.torque.laws import DriveLaw
from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.model import Model, build_model
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar

Array = NDArray[np.float64]
SAMPLE_S, COUNTS, NOISE_NM = 1e-3, 4000, 10e-3
STEP_RAD = math.tau / COUNTS
PROCESS_NM = 10e-3
INERTIA, VISCOUS, COULOMB = 1.2e-4, 7e-5, 0.03


def model(inertia: float = INERTIA) -> Model:
    values = {"motor.inertia": inertia, "viscous.damping": VISCOUS, "coulomb.level": COULOMB, "transmission.ratio": 1.0}
    return build_model("rigid", ("viscous", "coulomb"), values, base_bodies=("motor",))


def turned(seed: int, seconds: float = 10.0, step_rad: float = STEP_RAD, process_nm: float = 0.0) -> Recording:
    """A rigid motor under ±0.045 N m of torque that turns round every 2.5 s, and a square of 0.01 N m and 6 Hz besides.

    With a process torque, N m rms, the reading is only the command, without it.

    Between two samples torque and friction are constant: ω = ω∞ + (ω0 - ω∞) e^(-t/T), and where it turns round friction does.
    """
    rng, n = np.random.default_rng(seed), round(seconds / SAMPLE_S)
    t = SAMPLE_S * np.arange(n)
    asked = 0.045 * np.where((t + 0.6) % 5.0 < 2.5, 1.0, -1.0) + 0.01 * np.sign(np.sin(math.tau * 6.0 * t + rng.uniform(0.0, math.tau)))
    acts = asked + rng.normal(0.0, process_nm, n) if process_nm else asked
    theta, omega, angle = rng.uniform(0.0, step_rad), 0.0, np.empty(n)
    for k in range(n):
        angle[k] = theta
        left = SAMPLE_S
        while left > 0.0:
            side = math.copysign(1.0, omega if omega != 0.0 else acts[k])
            if omega == 0.0 and abs(acts[k]) <= COULOMB:
                break
            end, time = (acts[k] - COULOMB * side) / VISCOUS, INERTIA / VISCOUS
            stops = time * math.log(1.0 - omega / end) if omega * end < 0.0 else math.inf
            lasts = min(left, stops)
            theta += end * lasts + (omega - end) * time * -math.expm1(-lasts / time)
            omega = 0.0 if stops <= left else end + (omega - end) * math.exp(-lasts / time)
            left -= lasts
    counted = step_rad * np.floor(angle / step_rad)
    position, note = counted - counted[0], Sidecar("free")
    if process_nm:
        return Recording(name=f"turned {seed}", t_s=t, torque=asked, position=position, torque_setpoint=asked, sidecar=note)
    return Recording(name=f"turned {seed}", t_s=t, torque=asked + rng.normal(0.0, NOISE_NM, n), position=position, sidecar=note)


@pytest.fixture(scope="module")
def fits() -> list[ModelFit]:
    return [found_from(turned(seed)) for seed in range(8)]


def found_from(record: Recording) -> ModelFit:
    """From an inertia a fifth off; nothing but the reading says what torque acts."""
    return fit_model([record], model(0.8 * INERTIA), counts_per_rev=COUNTS, noise_nm=NOISE_NM, path=FAITHFUL)


def test_a_coarse_encoder_leaves_the_inertia_within_its_interval(fits: list[ModelFit]) -> None:
    """All of eight within 1.5 intervals, 2.9 deviations, and six within one: a right interval of 95 % fails that once in 30."""
    errors = []
    for fit in fits:
        item = fit.model.parameters["motor.inertia"]
        assert item.interval is not None
        assert item.interval < 0.03 * INERTIA, "it is told well"
        errors.append((item.value - INERTIA) / item.interval)
    assert np.abs(errors).max() < 1.5
    assert np.count_nonzero(np.abs(errors) < 1.0) >= 6
    assert abs(np.mean(errors)) < 3.0 * 0.5 / math.sqrt(len(errors)), "and no bias is left: a deviation is half an interval"


def test_the_frictions_are_found_beside_it(fits: list[ModelFit]) -> None:
    for name, true in (("viscous.damping", VISCOUS), ("coulomb.level", COULOMB)):
        errors = [(fit.model[name] - true) / (fit.model.parameters[name].interval or 0.0) for fit in fits]
        assert np.abs(errors).max() < 1.7, name


def test_squares_of_which_nothing_is_taken_off_would_miss_it(monkeypatch: pytest.MonkeyPatch, fits: list[ModelFit]) -> None:
    """By more than five intervals, to the lighter side, and further with each time that the whitening is worked out anew."""
    monkeypatch.setattr(RoundingBias, "_values", lambda bias, _model: np.zeros(len(bias.kinds)))
    monkeypatch.setattr(RoundingBias, "responses", nothing)
    monkeypatch.setattr(base, "least_plain_error", lambda _data, fitted, *_: fitted)  # which would see it, far off as it is
    interval = fits[0].model.parameters["motor.inertia"].interval
    assert interval is not None
    found = found_from(turned(0))
    assert found.model["motor.inertia"] < INERTIA - 5.0 * interval
    data, fitted = refit_with_rebuilt_motion(found.data, found.fitted, 6, found.data.substeps)
    for _ in range(5):
        data, fitted = refit_with_rebuilt_motion(data, fitted, 6, data.substeps)
    assert fitted.model["motor.inertia"] < found.model["motor.inertia"] - 5.0 * interval


@pytest.mark.parametrize("seed", range(3))
def test_torque_that_acts_unread_makes_no_motor_lighter(seed: int) -> None:
    """Of a command; the motor is moved by as much beside it.  Regression of the command on such a motion finds 0.8 times the inertia."""
    fine = math.tau / 2**20
    record = turned(seed, step_rad=fine, process_nm=PROCESS_NM)
    found = fit_model([record], model(0.8 * INERTIA), counts_per_rev=2**20, path=TorquePath(DriveLaw(0.0), commanded=True))
    item = found.model.parameters["motor.inertia"]
    assert item.interval is not None
    assert item.interval < 0.1 * INERTIA
    assert abs(item.value - INERTIA) < 1.5 * item.interval
    assert found.noise_nm == pytest.approx(PROCESS_NM, rel=0.05)


def nothing(bias: RoundingBias, _vector: Array, others: list[Array], _steps: Array) -> tuple[Array, Array]:
    k, segments = len(others), len(bias.of_segment)
    return np.zeros((segments, k)), np.zeros((segments, k, k))


@pytest.mark.parametrize("share", [0.5, 1.0, 1.5])
def test_the_squares_taken_off_are_those_that_rounding_leaves(share: float) -> None:
    """Encoder and torque noise of a motor that turns evenly, whitened for one inertia and seen by another: its motion tells of none."""
    rng, n = np.random.default_rng(3), 40_000
    t = SAMPLE_S * np.arange(n)
    even = 3.0 * t + STEP_RAD * (rng.random(n) - 0.5)
    torque = VISCOUS * 3.0 + COULOMB + rng.normal(0.0, NOISE_NM, n)
    record = Recording(name="even", t_s=t, torque=torque, position=even, sidecar=Sidecar("free"))
    data = prepare_records([record], model(), NOISE_NM, STEP_RAD, {})
    (piece,) = data.fitted
    other = model(share * INERTIA)
    bias = RoundingBias(data.fitted, model())
    here = piece.white(evaluate(piece, other, other.vector()))
    at_first = piece.white(evaluate(piece, model(), model().vector()))
    more = float(np.mean(here**2) - np.mean(at_first**2))
    assert np.mean(at_first**2) == pytest.approx(1.0, abs=4.0 * math.sqrt(2.0 / len(here)))
    assert bias(other.vector())[0] == pytest.approx(more, abs=4.0 * math.sqrt(2.0 / len(here)) * max(1.0, np.mean(here**2)))
    assert bias(model().vector())[0] == 0.0


def test_slope_and_curvature_are_those_of_what_is_taken_off() -> None:
    data = prepare_records([turned(1, 2.0)], model(), NOISE_NM, STEP_RAD, {})
    problem = problem_of(data, model())
    x = problem.start()
    slope, curvature = problem.rounding_derivatives(x)
    blocks, j = problem.count[:, None], problem.free.index("motor.inertia")

    def taken_off(change: float) -> float:
        ahead = x.copy()
        ahead[j] += change
        return float(problem.bias(problem.full(ahead))[0])

    step = 1e-2
    assert slope[0, j] / blocks[0, 0] == pytest.approx((taken_off(step) - taken_off(-step)) / (2.0 * step), rel=5e-3)
    # The residual is linear in the inertia, so there is no other part of the curvature.
    assert curvature[0, j, j] / blocks[0, 0] == pytest.approx((taken_off(step) + taken_off(-step)) / (2.0 * step**2), rel=5e-3)
    assert slope[0, problem.free.index("coulomb.level")] == 0.0, "friction of one level leaves the noise as it is"


def test_the_objective_is_that_of_the_segments_wherever_a_search_began() -> None:
    """Else a fit that began at a heavier motor would seem the better one, by what rounding adds there: 1300 nats on 16 600 values."""
    data = prepare_records([turned(1, 4.0)], model(), NOISE_NM, STEP_RAD, {})
    at = model(1.05 * INERTIA)
    levels = []
    for begun in (model(), model(0.8 * INERTIA), at):
        problem = problem_of(data, begun)
        x = problem.start() * 0.0
        x[:] = [at[name] for name in problem.free] / problem.scale
        levels.append(problem.objective(problem.residual(x), x))
    assert levels == [pytest.approx(levels[0], rel=1e-9)] * 3


def test_a_model_that_does_not_hold_its_bodies_is_no_better_one() -> None:
    """A rounding that grows without end would take off any square: it has no objective, and pulls nowhere."""
    data = prepare_records([turned(1, 2.0)], model(), NOISE_NM, STEP_RAD, {})
    bias = RoundingBias(data.fitted, model())
    kind = bias.kinds[0]
    kind.response = lambda _model: np.array([1e200, 1e200])  # type: ignore[method-assign]
    vector = model(1.1 * INERTIA).vector()
    assert bias(vector)[0] == math.inf
    slope, curvature = bias.responses(vector, [vector], np.array([1e-3]))
    assert np.all(slope == 0.0)
    assert np.all(curvature == 0.0)
    problem = problem_of(data, model())
    problem.bias = bias
    x = problem.start()
    assert problem.objective(problem.residual(x), 1.1 * x) == math.inf
