"""What a diagnosis may be called."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.effects import effect_named
from beltcomm.laboratory.acceptance import fitted_to_nothing
from beltcomm.laboratory.diagnosis import run_away
from beltcomm.laboratory.structure import excess
from beltcomm.model import build_model

BASE = build_model("axis", ("belt_stiffness", "belt_damping", "viscous", "viscous_cart", "coulomb"), {})


@pytest.mark.parametrize(
    ("effect", "values", "wanted"),
    [
        ("torque_ripple", {"sine": 0.1, "cosine": -0.5}, ["torque_ripple.cosine"]),
        ("torque_ripple", {"sine": 0.1, "cosine": -0.4}, []),
        ("stribeck", {"amount": 0.0, "speed_scale": 10.0}, ["stribeck.speed_scale"]),
        ("stribeck", {"amount": 0.0, "speed_scale": 0.2}, []),
    ],
)
def test_a_parameter_that_ran_into_its_bound_is_named(effect: str, values: dict[str, float], wanted: list[str]) -> None:
    assert run_away(BASE.with_effect(effect, values), BASE) == wanted


@pytest.mark.parametrize(("gap_m", "nothing"), [(0.0, True), (2e-5, False)])
def test_a_gap_fitted_to_no_width_explains_nothing(gap_m: float, nothing: bool) -> None:
    assert fitted_to_nothing(BASE.with_effect("backlash", {"gap": gap_m}), effect_named("backlash")) is nothing


def test_noise_has_no_structure_and_a_small_constant_has() -> None:
    random = np.random.default_rng(3)
    number = np.repeat(np.arange(40), 500)
    noise = random.standard_normal(len(number))
    assert abs(excess(noise, number)) < 5.0
    assert excess(noise + 0.2 * (number % 2), number) > 25.0
    assert excess(noise, np.arange(len(noise))) == 0.0, "bins of one value say nothing"
