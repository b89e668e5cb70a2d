"""Limits of what cannot be negative."""

import numpy as np
import pytest
from scipy.stats import truncnorm

from beltcomm.fit.uncertainty.remarks import _upper_limit


@pytest.mark.parametrize("deviations", [-12.0, -1.0, -1e-3, 0.0, 0.5, 8.0, 30.0])
def test_an_upper_limit_is_the_quantile_of_the_normal_law_cut_off_at_none(deviations: float) -> None:
    scale = 3.3e-4
    expected = truncnorm.ppf(0.95, -deviations, np.inf, loc=deviations * scale, scale=scale)
    assert _upper_limit(deviations * scale, scale) == pytest.approx(expected, rel=1e-12)
