"""Signals of different rasters: what is exact, what is interpolated and by how much that can be wrong, and that torque never is."""

from __future__ import annotations

import re

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.errors import DataError
from beltcomm.foreign.convert import Converted, Reading, convert
from beltcomm.foreign.table import Table

MAPPING = ("torque_nm=M*1", "position_rad=phi*1")


def signal(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Torque and position of an inertia of 1 g m² under a sinusoidal torque."""
    return 0.3 * np.sin(20.0 * t), -0.3 / (1e-3 * 400.0) * np.sin(20.0 * t)


def merged(t_m: NDArray[np.float64], t_phi: NDArray[np.float64], unit: str = "s", **more: NDArray[np.float64]) -> Converted:
    scale = {"s": 1.0, "ms": 1e3}[unit]
    columns = {"time of M": t_m * scale, "M": signal(t_m)[0], "time of phi": t_phi * scale, "phi": signal(t_phi)[1], **more}
    clocks = {"M": "time of M", "phi": "time of phi"} | dict.fromkeys(more, "time of phi")
    table = Table("log.mf4", columns, {"time of M": unit, "time of phi": unit}, (), clocks)
    return convert(table, Reading(mapping=MAPPING, keep=tuple(more)))


def test_stamps_that_coincide_are_taken_as_they_are() -> None:
    t = np.arange(0.0, 1.0, 2e-3)
    found = merged(t, np.arange(0.0, 1.0, 1e-3), "ms")
    np.testing.assert_allclose(found.columns["t_s"], t, atol=1e-12)
    np.testing.assert_array_equal(found.columns["torque_nm"], signal(t)[0])
    np.testing.assert_allclose(found.columns["position_rad"], signal(t)[1], atol=1e-12)
    assert any("position_rad is of another raster, 'time of phi': taken at the stamps that both have" in note for note in found.notes)


def test_a_faster_torque_is_averaged_over_each_step_of_the_position() -> None:
    fine, coarse = np.arange(0.0, 1.0, 1e-4), np.arange(0.0, 1.0, 4e-3)
    found = merged(fine, coarse)
    np.testing.assert_array_equal(found.columns["position_rad"], signal(coarse)[1])
    ends = coarse + 4e-3
    mean = 0.3 * (np.cos(20.0 * coarse) - np.cos(20.0 * ends)) / (20.0 * 4e-3)  # the integral, in closed form
    # each sample is held for 0.1 ms: late by half of that, times the torque's slope
    np.testing.assert_allclose(found.columns["torque_nm"], mean, atol=0.3 * 20.0 * 0.5e-4 * 1.1)
    assert any("torque_nm is of another raster, 'time of M': its mean over each step of 4 ms" in note for note in found.notes)


def test_position_between_its_samples_is_wrong_by_no_more_than_is_said() -> None:
    t = np.arange(0.0, 1.0, 1e-3)
    found = merged(t + 0.4e-3, t)
    said = next(float(m[1]) for note in found.notes if (m := re.search(r"wrong by up to (\S+) in", note)))
    wrong = np.abs(found.columns["position_rad"] - signal(found.columns["t_s"])[1]).max()
    assert wrong <= said < 4.0 * wrong
    np.testing.assert_array_equal(found.columns["torque_nm"], signal(t + 0.4e-3)[0][: len(found.columns["t_s"])])
    assert "1 rows at the ends left out, in which not every signal was recorded" in found.notes


def test_everything_else_holds_its_last_value() -> None:
    t, slow = np.arange(0.0, 1.0, 1e-3), np.arange(0.0, 1.0, 1e-3) + 0.3e-3
    found = merged(t, slow, state=np.arange(len(slow), dtype=np.float64))
    np.testing.assert_array_equal(found.columns["state"], np.arange(len(found.columns["state"])))


def test_signals_of_two_measurements_do_not_go_together() -> None:
    with pytest.raises(DataError, match="phi was not recorded while the others were"):
        merged(np.arange(0.0, 1.0, 1e-3), np.arange(5.0, 6.0, 1e-3))
    backwards = np.arange(0.0, 1.0, 1e-3)
    backwards[500] = 0.0
    with pytest.raises(DataError, match=r"the time 'time of phi' of its signals goes back by 0\.499 s in value 501"):
        merged(np.arange(0.0, 1.0, 1e-3), backwards)
