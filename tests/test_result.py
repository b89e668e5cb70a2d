"""What a command gives back, as programs get it."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
import pytest

from beltcomm import api
from beltcomm.result import plain, with_unit


@dataclass(frozen=True)
class Measured:
    """A value as commands have them."""

    freq_hz: np.ndarray
    h: np.ndarray
    _hidden: int = 1


@pytest.mark.parametrize(
    ("value", "wanted"),
    [
        (Measured(np.array([1.0]), np.array([1.0 - 2.0j])), {"freq_hz": [1.0], "h": {"real": [1.0], "imag": [-2.0]}}),
        (3.0 + 4.0j, {"real": 3.0, "imag": 4.0}),
        (np.complex128(1j), {"real": 0.0, "imag": 1.0}),
        ({2: (np.float64(0.5), frozenset({"a"}))}, {"2": [0.5, ["a"]]}),
    ],
)
def test_values_become_those_that_json_has(value: object, wanted: object) -> None:
    assert json.loads(json.dumps(plain(value))) == wanted


@pytest.mark.parametrize(
    ("unit", "wanted"), [("1", "0.5"), ("", "0.5"), ("N s2/m2", "0.5 N s²/m²"), ("kg m2", "0.5 kg m²"), ("mN m", "0.5 mN m")]
)
def test_units_are_those_that_people_write(unit: str, wanted: str) -> None:
    assert with_unit("0.5", unit) == wanted


def test_frequency_responses_of_a_study_are_numbers_in_json() -> None:
    data = json.loads(json.dumps(api.thesis("models").to_json()))
    assert all(isinstance(part, float) for h in data["parameter_sets"].values() for part in (*h["real"], *h["imag"]))
