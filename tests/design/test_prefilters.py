"""Prefilter layout against the thesis's numbers and its own conditions (4.2), (4.4)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.control import Prefilter
from beltcomm.design.prefilters import butterworth_cutoff_rad_s, continuous_prefilter, notch_width
from beltcomm.errors import UsageError

OMEGA_Z = math.sqrt(203.74e3 / 13.44)
OMEGA_R = math.sqrt(203.74e3 * (71.73e-6 + 0.01242**2 * 13.44) / (71.73e-6 * 13.44))


def test_notch_width_of_g_a() -> None:
    """Thesis sheet, section 3: 4.584 at exactly −6 dB; the published 4.60 belongs to one half."""
    assert notch_width(OMEGA_R, OMEGA_Z, -6.0) == pytest.approx(4.584, abs=5e-4)
    assert notch_width(OMEGA_R, OMEGA_Z, 20.0 * math.log10(0.5)) == pytest.approx(4.60, abs=5e-3)


def test_butterworth_cutoff_of_g_a() -> None:
    """Thesis sheet, section 3: 123.27 rad/s at −3 dB."""
    assert butterworth_cutoff_rad_s(OMEGA_Z, -3.0) == pytest.approx(123.27, abs=5e-3)


@pytest.mark.parametrize("attenuation_db", [-1.0, -3.0, -6.0, -20.0])
def test_both_prefilters_attenuate_the_antiresonance_as_asked(attenuation_db: float) -> None:
    notch = Prefilter("notch", OMEGA_R, notch_width(OMEGA_R, OMEGA_Z, attenuation_db))
    butterworth = Prefilter("butterworth", butterworth_cutoff_rad_s(OMEGA_Z, attenuation_db))
    for prefilter in (notch, butterworth):
        gain = abs(continuous_prefilter(np.array([OMEGA_Z]), prefilter)[0])
        assert 20.0 * math.log10(gain) == pytest.approx(attenuation_db, abs=1e-9)


@pytest.mark.parametrize(("resonance", "antiresonance", "decibel"), [(100.0, 100.0, -6.0), (100.0, 0.0, -6.0), (100.0, 50.0, 1.0)])
def test_impossible_layouts_are_refused(resonance: float, antiresonance: float, decibel: float) -> None:
    with pytest.raises(UsageError, match="antiresonance"):
        notch_width(resonance, antiresonance, decibel)
