"""The values of a torque path that motion and reading tell together; bounds of what can be asked for at all."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.fit.base import fit_base
from beltcomm.fit.path_values import refine_path
from beltcomm.fit.records import made
from beltcomm.fit.torque_path import DriveLaw, Lag, ReadingLaw, TorquePath
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
    data = made([record], truth, NOISE_NM, STEP_RAD, {}, path=path)
    data, fitted = fit_base(data, truth, path=path, publish=False)
    data, fitted = refine_path(data, fitted)
    drive = data.path.drive
    assert drive is not None
    values = [*(value for lag in (*drive.lags, *data.path.reading.lags) for value in lag.values), data.path.reading.late, drive.delay]
    assert np.all(np.isfinite(values))
    assert min(values) >= 0.0
    assert np.isfinite(fitted.objective)
