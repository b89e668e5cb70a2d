"""A fit kept beside a run is evaluated again, not searched for again: every number is the same to the digit."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from beltcomm.axis import load_axis
from beltcomm.errors import BeltcommError
from beltcomm.fit.estimate import evaluate_at
from beltcomm.fit.model_fit import ModelFit, fit_model
from beltcomm.recording import Recording
from beltcomm.rundata.kept import _key_of, _key_of_model, _restore_fit, _store_fit
from identify.records import COUNTS, Recorder, true_model
from truth.rigs import draw


@pytest.fixture(scope="module")
def records() -> list[Recording]:
    """With a delay that is no whole sample, so that the path has a spread, and a record held out."""
    plant = draw("g_b", np.random.default_rng(11))
    recorder = Recorder(11, delay_s=1.4e-3)
    return [
        recorder.shaken(plant, 0.3, 3),
        recorder.stroked(plant, (0.1, 0.5), 0.2),
        recorder.shaken(plant, 0.25, 1, "away", held_out=True),
    ]


@pytest.fixture(scope="module")
def found(records: list[Recording]) -> ModelFit:
    truth = true_model(draw("g_b", np.random.default_rng(11)))
    return fit_model(records, truth.with_values({"cart.mass": 1.05 * truth["cart.mass"]}), counts_per_rev=COUNTS)


@pytest.fixture(scope="module")
def written(found: ModelFit) -> dict[str, Any]:
    """As it stands in a file."""
    there = _store_fit(found.data, found.fitted)
    assert there is not None
    read = json.loads(json.dumps(there))
    assert isinstance(read, dict)
    return read


def test_what_is_read_back_is_the_fit_to_the_digit(records: list[Recording], found: ModelFit, written: dict[str, Any]) -> None:
    began = time.perf_counter()
    data, fitted = _restore_fit(records, written)
    assert time.perf_counter() - began < 5.0, "one evaluation"
    assert (data.noise_nm, data.step_rad, data.substeps, data.reversals) == (
        found.data.noise_nm, found.data.step_rad, found.data.substeps, found.data.reversals,
    )  # fmt: skip
    assert data.path.drive == found.path.drive
    assert data.path.reading == found.path.reading
    np.testing.assert_array_equal(fitted.residual, found.fitted.residual)
    assert (fitted.objective, fitted.ratio, fitted.held_out_ratio) == (
        found.fitted.objective,
        found.fitted.ratio,
        found.fitted.held_out_ratio,
    )
    assert {n: v.value for n, v in fitted.model.parameters.items()} == {n: v.value for n, v in found.fitted.model.parameters.items()}
    np.testing.assert_array_equal(fitted.problem.jacobian(fitted.x).columns, found.fitted.problem.jacobian(found.fitted.x).columns)


@pytest.mark.parametrize(
    "damage", [{"unknowns": [1.0]}, {"path": {}}, {"made_by": {}}, {"shares": {"shaken": 1.0}}, {"noise_nm": None}, {"substeps": "many"}]
)
def test_damaged_contents_are_refused(records: list[Recording], written: dict[str, Any], damage: dict[str, Any]) -> None:
    with pytest.raises((KeyError, TypeError, ValueError, BeltcommError)):
        _restore_fit(records, written | damage)


def test_the_keys_go_with_records_axis_and_start(found: ModelFit) -> None:
    axis, hashes = load_axis("egc-70-600"), {"a.csv": "1", "a.yaml": "2"}
    key = _key_of(hashes, axis)
    assert _key_of(dict(reversed(hashes.items())), axis) == key
    assert len({key, _key_of(hashes | {"a.csv": "3"}, axis), _key_of(hashes, replace(axis, name="another"))}) == 3
    assert len({_key_of_model(start) for start in (None, found.model, found.fitted.problem.model)}) == 3


def test_a_fit_far_off_keeps_where_its_search_begins(records: list[Recording], found: ModelFit) -> None:
    """Told with other values than the likelihood's, both are there again to the digit."""
    told = evaluate_at(found.data, found.fitted.problem, 1.01 * found.fitted.x)
    there = _store_fit(found.data, replace(told, likeliest=found.fitted))
    _, again = _restore_fit(records, json.loads(json.dumps(there)))
    assert again.likeliest is not None
    assert again.objective > again.likeliest.objective
    assert (again.objective, again.likeliest.objective) == (told.objective, found.fitted.objective)
