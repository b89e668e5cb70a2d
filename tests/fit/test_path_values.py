"""The values of a torque path that motion and reading tell together; bounds of what can be asked for at all."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.fit.base import fit_base
from beltcomm.fit.estimate import fit
from beltcomm.fit.path_values import path_nuisance, refine_path
from beltcomm.fit.records import prepare_records
from beltcomm.fit.torque_path import DriveLaw, Lag, ReadingLaw, TorquePath
from fit.test_rounding_bias import model, turned
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
