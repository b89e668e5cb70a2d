"""Ways to the frequency response: each against the true one where it must be right, and wrong where it must be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from beltcomm.errors import DataError
from beltcomm.report.style import Caption
from beltcomm.response import FrequencyResponse
from beltcomm.response.closed_loop import feedback, from_setpoint_excitation, from_torque_excitation, setpoint_path
from beltcomm.thesis import identification
from beltcomm.thesis.figures.identification import figures
from beltcomm.thesis.identification import PERIOD_S, STRONG, WEAK


@pytest.fixture(scope="module")
def study() -> identification.IdentificationStudy:
    return identification.compare()


def test_a_closed_loop_is_opened_exactly() -> None:
    """(3.20) and (3.23) made by hand from a plant that is known, and taken back; the noise by differentiation."""
    freq = np.geomspace(0.5, 300.0, 60)
    s = 2j * np.pi * freq
    plant = 1.0 / (2e-3 * s**2 + 3e-3 * s)
    for cascade in (WEAK, STRONG):
        for loop in ("velocity", "position"):
            controller = feedback(cascade, freq, PERIOD_S, loop)
            path = setpoint_path(cascade, freq, PERIOD_S)
            noise = np.full(len(freq), 1e-6)
            one = np.ones(len(freq))

            def seen(h: np.ndarray, noise: np.ndarray = noise, one: np.ndarray = one) -> FrequencyResponse:
                return FrequencyResponse(freq, h, noise, one, 4, PERIOD_S)

            by_torque = plant / (1.0 + plant * controller)
            found = from_torque_excitation(seen(by_torque), controller)
            np.testing.assert_allclose(found.h, plant, rtol=1e-9)
            step = 1e-9 * np.abs(by_torque)
            slope = np.abs(from_torque_excitation(seen(by_torque + step), controller).h - found.h) / step
            np.testing.assert_allclose(found.noise, slope * 1e-6, rtol=1e-4)
            by_setpoint = plant * path / (1.0 + plant * controller)
            np.testing.assert_allclose(from_setpoint_excitation(seen(by_setpoint), controller, path).h, plant, rtol=1e-9)


def test_a_loop_that_hides_the_plant_is_said() -> None:
    freq = np.array([1.0, 2.0, 3.0])
    seen = FrequencyResponse(freq, np.ones(3), np.full(3, 1e-3), np.ones(3), 3, PERIOD_S)
    with pytest.raises(DataError, match="weaker loop"):
        from_torque_excitation(seen, np.ones(3) + 1e-5j)
    partly = from_torque_excitation(seen, np.array([1.0, 0.5, 0.2]) + 0j)
    assert len(partly.freq_hz) == 2
    assert "1 of 3 lines" in partly.remarks[-1]


def test_moving_without_reversal_is_right_and_standing_is_not(study: identification.IdentificationStudy) -> None:
    """thesis.md 2.7: an FRF around standstill sees Coulomb friction as damping: many times the 2.53 mN m s of the sweep."""
    ways = {way.name: way for way in study.ways}
    assert ways["open loop, standing"].viscous_nm_s_rad > 10.0 * study.viscous_nm_s_rad
    assert ways["open loop, standing"].crosses_zero
    for name in ("direct", "indirect, C as it runs", "speed setpoint"):
        assert not ways[name].crosses_zero
        assert abs(ways[name].high_db) < 0.1
        assert ways[name].mass_kg == pytest.approx(study.mass_kg, rel=0.02)


def test_the_indirect_bias_is_that_of_a_controller_not_known(study: identification.IdentificationStudy) -> None:
    """ΔG/G = -G C ΔC/C to first order: the low band of a strong loop, where |G C| is above 1, and hardly elsewhere."""
    ways = {way.name: way for way in study.ways}
    assert abs(ways["strong loop, indirect"].low_db) < 0.1
    assert abs(ways["strong, C 20 % off"].low_db) > 1.0
    assert abs(ways["strong, C 20 % off"].high_db) < 0.2
    found = ways["strong, C 20 % off"].response
    low = found.freq_hz < 3.0
    right = ways["strong loop, indirect"].response.h[low]
    late = np.exp(-2j * np.pi * found.freq_hz[low] * PERIOD_S)
    product = right * late * feedback(STRONG, found.freq_hz[low], PERIOD_S, "velocity")
    exact = 1.0 / (1.0 + 0.2 * product)  # S/(1 - 0.8 S C) over S/(1 - S C), with S C = G C/(1 + G C)
    np.testing.assert_allclose(np.abs(found.h[low] / right), np.abs(exact), rtol=1e-6)


def test_dead_time_and_averaging_are_those_of_the_thesis(study: identification.IdentificationStudy) -> None:
    """(3.30): 1 ms.  √n: the medians of 150 lines scatter by some 10 %."""
    assert study.dead_time.value_s == pytest.approx(1e-3, abs=max(study.dead_time.interval_s, 1e-6))
    for n, value in study.averaging.items():
        assert value == pytest.approx(1.0 / math.sqrt(n), rel=0.3)


def test_words_and_figures(study: identification.IdentificationStudy) -> None:
    text = identification.lines(study)
    assert sum(line.startswith(tuple(w.name for w in study.ways)) for line in text) >= len(study.ways)
    assert set(figures(study, Caption("test", "none"))) == {"identification_ways", "identification_averaging", "identification_3_5"}
