"""The values of a torque path that motion and reading tell together; bounds of what can be asked for at all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import stdtrit

from beltcomm.fit.base import fit_base
from beltcomm.fit.estimate import fit
from beltcomm.fit.path_fit.values import path_nuisance, refine_path
from beltcomm.fit.records import prepare_records
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw, ReadingLaw
from beltcomm.fit.torque.path import TorquePath
from beltcomm.fit.uncertainty.intervals import parameter_spread
from beltcomm.fit.uncertainty.nuisance import with_nuisance
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar
from fit.test_rounding_bias import COULOMB, COUNTS, INERTIA, SAMPLE_S, VISCOUS, model, turned
from identify.records import NOISE_NM, STEP_RAD, Recorder, true_model
from truth.rigs import draw


@pytest.mark.parametrize(
    "path",
    [
        TorquePath(DriveLaw(0.0), ReadingLaw(0.8)),
        TorquePath(DriveLaw(1.0), ReadingLaw(0.4, (Lag("first order", (5e-4,)),))),
        TorquePath(DriveLaw(1.0, (Lag("slew rate", (40.0,)),)), ReadingLaw(0.0, (Lag("first order", (3e-4,)),), at_end=True)),
    ],
)
def test_any_path_is_refined_to_finite_values(path: TorquePath) -> None:
    """Also a wrong one, whose drive has no delay at all: nothing is divided by it."""
    plant = draw("g_b", np.random.default_rng(41))
    truth, record = true_model(plant), Recorder(41).shaken(plant, 0.3, 2)
    data = prepare_records([record], truth, NOISE_NM, STEP_RAD, {}, path=path)
    data, fitted = fit_base(data, truth, path=path, publish=False)
    data, fitted = refine_path(data, fitted)
    drive = data.path.drive
    assert drive is not None
    values = [*(value for lag in (*drive.lags, *data.path.reading.lags) for value in lag.values), data.path.reading.late, drive.delay]
    assert np.all(np.isfinite(values))
    assert min(values) >= 0.0
    assert np.isfinite(fitted.objective)


def test_a_whole_delay_is_divided_within_a_sample_where_the_motion_asks_for_it() -> None:
    """A command that changes at 0.3 of the period, read 0.7 of one later: setpoint and reading show two whole samples and no more.

    To a tenth of the 0.3 by which each whole division is off.
    """
    rng, n, sample_s = np.random.default_rng(8), 4000, SAMPLE_S
    asked = COULOMB + 40.0 * VISCOUS + 0.02 * rng.choice([-1.0, 1.0], n)
    theta, omega, angle = 0.0, 40.0, np.empty(n)
    for k in range(n):
        angle[k] = theta
        for back, share in ((2, 0.3), (1, 0.7)):
            end, time, lasts = (asked[max(k - back, 0)] - COULOMB) / VISCOUS, INERTIA / VISCOUS, share * sample_s
            theta += end * lasts + (omega - end) * time * -math.expm1(-lasts / time)
            omega = end + (omega - end) * math.exp(-lasts / time)
    reading = np.concatenate((asked[:1], asked[:1], asked[:-2])) + rng.normal(0.0, 0.002, n)
    step = math.tau / 2**20
    position = step * np.floor(angle / step)
    record = Recording("divided", sample_s * np.arange(n), reading, position, torque_setpoint=asked, sidecar=Sidecar("free"))
    data, fitted = fit_base(prepare_records([record], model(), 0.002, step, {}), model(0.8 * INERTIA), publish=False)
    assert data.path.drive is not None
    assert data.path.drive.delay == pytest.approx(1.3, abs=0.03)
    assert data.path.reading.late == pytest.approx(0.7, abs=0.03)
    assert fitted.ratio == pytest.approx(1.0, abs=0.05)
    half = parameter_spread(fitted).half_width({"motor.inertia": 1.0})
    assert half is not None
    assert abs(fitted.model["motor.inertia"] - INERTIA) < 1.5 * half < 0.05 * INERTIA


def test_a_coarse_record_tells_the_values_of_a_path_too() -> None:
    """Every second sample of its angle is taken; how the torque acts is asked at all of them."""
    fine, step = turned(3), math.tau / 1500
    coarse = replace(fine, position=step * np.floor(fine.position / step), torque_setpoint=fine.torque)
    path = TorquePath(DriveLaw(0.3), ReadingLaw(0.1))
    data = prepare_records([coarse], model(), 0.01, step, {}, path=path)
    assert data.fitted[0].motion.sample_s == 2.0 * fine.sample_period_s
    nuisance = path_nuisance(data, fit(data, model(), 3))
    assert nuisance is not None
    assert np.all(np.linalg.norm(nuisance.columns, axis=0) > 0.0)


def test_a_rival_that_nothing_tells_widens_the_intervals_by_what_it_differs_by() -> None:
    record = turned(3)
    record = replace(record, torque_setpoint=record.torque)
    taken, rival = TorquePath(DriveLaw(1.0)), TorquePath(DriveLaw(1.0), ReadingLaw(3.0))

    def told(path: TorquePath) -> tuple[float, float, float]:
        data = prepare_records([record], model(), 0.01, math.tau / COUNTS, {}, path=path)
        spread = parameter_spread(fitted := with_nuisance(data, fit(data, model(), 8)))
        half = spread.half_width({"motor.inertia": 1.0})
        assert half is not None
        return fitted.model["motor.inertia"], half, float(stdtrit(spread.freedom, 0.975))

    (value, alone, wide), (other, _, _), (_, beside, _) = told(taken), told(rival), told(replace(taken, rivals=(rival,)))
    assert beside > 1.5 * alone
    assert math.sqrt(beside**2 - alone**2) == pytest.approx(abs(other - value) * wide / 1.96, rel=0.2)
