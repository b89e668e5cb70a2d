"""Limits of what cannot be negative, and what is said of intervals that are none."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from beltcomm.fit.remarks import remark_on_rounding, upper_limit


@pytest.mark.parametrize("deviations", [-12.0, -1.0, -1e-3, 0.0, 0.5, 8.0, 30.0])
def test_an_upper_limit_is_the_quantile_of_the_normal_law_cut_off_at_none(deviations: float) -> None:
    scale = 3.3e-4
    expected = truncnorm.ppf(0.95, -deviations, np.inf, loc=deviations * scale, scale=scale)
    assert upper_limit(deviations * scale, scale) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("beyond", [1e40, np.inf, np.nan, 100.0])
def test_an_interval_beyond_all_measure_is_not_identifiable_and_no_number(beyond: float) -> None:
    text = remark_on_rounding(("cart.mass", "motor.inertia"), np.array([beyond, 1.0]))
    assert text.startswith("cart.mass: not identifiable from this data")
    assert "times" not in text
    assert "2.0 times as wide" in remark_on_rounding(("cart.mass",), np.array([2.0]))
    assert remark_on_rounding(("cart.mass",), np.array([1.1])) == ""
