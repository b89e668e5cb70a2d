"""Strokes with an excitation in each: where the periods are, that they repeat, and that the travel is what was planned."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.errors import DataError, UsageError
from beltcomm.excitation import chirp, prbs
from beltcomm.excitation.moving import REST_S, TAIL_S, moving_excitation, ramp_s, stroke_m
from beltcomm.recording import ExcitationNote, Sidecar
from beltcomm.recording.sidecar import _sidecar_from_dict
from beltcomm.response import estimate_response

T = 1e-3


def test_every_measured_period_is_the_same_at_constant_speed() -> None:
    signal = prbs(7, 2, 0.2, T, 3, torque_step_nm=1e-3)
    motion = moving_excitation(signal, -0.1, 2, 0.2, 0.3)
    assert len(motion.starts) == 6
    for k, start in enumerate(motion.starts):
        part = slice(start, start + motion.period_samples)
        np.testing.assert_array_equal(motion.added[part], signal.period)
        np.testing.assert_array_equal(motion.added[part.start - motion.period_samples : part.start], signal.period)  # the run-in too
        assert set(motion.base_m_s[part]) == {-0.1 if k < 3 else 0.1}
        assert motion.excited[part].all()
    assert not motion.added[~motion.excited].any()
    assert (motion.base_m_s[0], motion.base_m_s[-1], motion.added[-1]) == (0.0, 0.0, 0.0)


def test_a_stroke_goes_as_far_as_it_is_planned_with_and_comes_back() -> None:
    signal = prbs(7, 2, 0.2, T, 2)
    motion = moving_excitation(signal, 0.1, 2, 0.2, 0.3)
    excited_s = (3 * signal.period_samples + 2) * T  # run-in, two periods, one sample to bring the momentum in and one to take it out
    assert motion.base_m.max() == pytest.approx(stroke_m(0.1, 0.2, 0.3, excited_s), rel=1e-3)
    assert motion.base_m[-1] == pytest.approx(0.0, abs=1e-12)
    assert np.gradient(motion.base_m_s, T).max() == pytest.approx(np.pi * 0.1 / (2 * 0.2), rel=1e-3)
    assert ramp_s(0.1, np.pi * 0.1 / 0.4) == pytest.approx(0.2)
    assert len(motion.base_m) * T == pytest.approx(2 * (REST_S + 2 * 0.2 + 0.3 + excited_s + TAIL_S) + REST_S, abs=4 * T)


def test_a_signal_that_begins_with_nothing_keeps_its_place() -> None:
    signal = chirp(500, 5.0, 100.0, 0.1, T, 2)
    motion = moving_excitation(signal, 0.0, 1, 0.1, 0.1)
    np.testing.assert_array_equal(motion.added[motion.starts[0] : motion.starts[0] + 500], signal.period)
    assert not motion.base_m.any()
    with pytest.raises(UsageError, match="at least one"):
        moving_excitation(signal, 0.1, 0, 0.1, 0.1)


def test_only_the_periods_named_are_used() -> None:
    """y[n] = y[n-1] + u[n-1]: between the strokes something else happens, which must not be seen."""
    rng = np.random.default_rng(1)
    period = rng.normal(size=64)
    u = np.concatenate([rng.normal(size=30), np.tile(period, 3), rng.normal(size=50), np.tile(period, 3), rng.normal(size=9)])
    y = np.concatenate(([0.0], np.cumsum(u)[:-1]))
    starts = (94, 158, 336, 400)
    found = estimate_response(u, y, T, 64, 94, starts=starts)
    z = np.exp(2j * np.pi * found.freq_hz * T)
    assert found.n_periods == 4
    np.testing.assert_allclose(found.h, 1.0 / (z - 1.0), rtol=1e-9)
    blind = estimate_response(u, y + 5.0 * rng.normal(size=len(y)) * (np.arange(len(y)) > 222) * (np.arange(len(y)) < 272), T, 64, 94)
    assert np.median(blind.noise / np.abs(blind.h)) > 1e-3  # all periods behind the first sample: the stretch between them is noise
    with pytest.raises(DataError, match="at least 2"):
        estimate_response(u, y, T, 64, 94, starts=(94,))


def test_the_note_comes_back_from_its_file() -> None:
    note = ExcitationNote("prbs", 0.04, 64, 94, (94, 158), None, 0.1)
    sidecar = Sidecar("frf", 0.1, closed_loop=True, excitation=note, controller={"loop": "velocity"})
    read, remarks = _sidecar_from_dict(sidecar.to_dict())
    assert read == sidecar
    assert read.moving
    assert remarks == ()
    assert not Sidecar("frf", excitation=ExcitationNote("prbs", 0.04, 64, 94)).moving
    with pytest.raises(DataError, match="period_starts"):
        _sidecar_from_dict({"excitation": {"kind": "prbs", "period_starts": ["a"]}})
