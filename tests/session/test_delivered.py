"""Excitation delivered against excitation asked for, on signals whose fault is known."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import bilinear, butter, lfilter

from beltcomm.errors import DriveError, Refused
from beltcomm.machine.delivered import _delivered, _notch, check
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import Sidecar

Array = NDArray[np.float64]
N, PERIOD_S = 3000, 1e-3


def asked(levels: int = 2) -> Array:
    """Chips of 4 samples with 2 or more levels, ±0.3 N m, around 0.1 N m that hold the axis."""
    random = np.random.default_rng(3)
    chips = random.choice(np.linspace(-0.3, 0.3, levels), N // 4)
    return np.asarray(0.1 + np.repeat(chips, 4))


def record(setpoint: Array, made: Callable[[Array], Array], lost: slice | None = None, noise_nm: float = 6e-3) -> Recording:
    late = np.concatenate([[0.0], setpoint[:-1]])
    torque = made(late) + np.random.default_rng(4).normal(0.0, noise_nm, N)
    t_s, position = PERIOD_S * np.arange(N), np.cumsum(np.cumsum(torque - torque.mean())) * 1e-2
    keep: Any = np.delete(np.arange(N), lost) if lost is not None else slice(None)
    sidecar = Sidecar("frf", 0.25)
    return Recording("frf_1", t_s[keep], torque[keep], position[keep], setpoint[keep], sidecar=sidecar)


def test_what_was_asked_for_is_not_talked_about() -> None:
    found = _delivered(record(asked(), lambda u: u))
    assert found is not None
    assert found.lag == 1
    assert found.share == pytest.approx(1.0, abs=0.01)
    assert found.sound
    assert check(record(asked(), lambda u: u, noise_nm=0.1)) == ""  # noise is no loss
    assert _delivered(record(np.full(N, 0.2), lambda u: u)) is None  # nothing was asked for that could be compared


def test_a_limit_in_the_drive() -> None:
    words = check(record(asked(), lambda u: np.clip(u, 0.1 - 0.213, 0.1 + 0.213)))
    assert words.startswith("frf_1: the drive delivered 71 % of the torque asked for: 0.213 of 0.3 N m where it was largest")
    assert "6072h" in words


def test_a_limit_that_cuts_the_loudest_of_many_levels() -> None:
    found = _delivered(record(asked(9), lambda u: np.clip(u, 0.1 - 0.15, 0.1 + 0.15)))
    assert found is not None
    assert found.largest_nm / found.largest_asked_nm == pytest.approx(0.5, abs=0.02)
    assert not found.sound


def slow(most_per_sample: float) -> Callable[[Array], Array]:
    def made(u: Array) -> Array:
        out = np.empty(len(u))
        now = u[0]
        for k, wanted in enumerate(u):
            now += float(np.clip(wanted - now, -most_per_sample, most_per_sample))
            out[k] = now
        return out

    return made


def test_a_rate_limit_is_named_with_its_rate() -> None:
    """0.15 N m per ms against steps of 0.6 N m: four samples each."""
    words = check(record(asked(), slow(0.15)))
    assert re.search(r"limited by its rate, 15[01] N m/s; a switch takes 4 samples", words)
    assert "6087h" in words


def test_a_wrong_scale() -> None:
    assert "delivered 130 % of the torque asked for" in check(record(asked(), lambda u: 1.3 * u))
    assert "6076h" in check(record(asked(), lambda u: 1.3 * u))


def test_missing_samples_are_said() -> None:
    assert "10.0 % of its samples are missing" in check(record(asked(), lambda u: u, slice(1000, 1300)))


def test_a_wrong_sign_is_the_drives_fault() -> None:
    with pytest.raises(DriveError, match="with the wrong sign"):
        check(record(asked(), lambda u: -u))


@pytest.mark.parametrize("made", [lambda u: 0.3 * u, lambda u: np.roll(u, 500), lambda u: 2.5 * u])
def test_what_shows_something_else_is_not_used(made: Callable[[Array], Array]) -> None:
    with pytest.raises(Refused, match="the record is not used"):
        check(record(asked(), made))


def notched(hz: float, width_hz: float, depth_db: float) -> Callable[[Array], Array]:
    """(s² + 2 d0 w s + w²)/(s² + 2 d w s + w²) by the bilinear rule."""

    def made(u: Array) -> Array:
        w, d = 2.0 * np.pi * hz, 0.5 * width_hz / hz
        d0 = d * 10.0 ** (-depth_db / 20.0)
        return np.asarray(lfilter(*bilinear([1.0, 2.0 * d0 * w, w * w], [1.0, 2.0 * d * w, w * w], 1.0 / PERIOD_S), u), dtype=np.float64)

    return made


def test_a_notch_of_the_drives_own_is_named_and_no_limit_blamed() -> None:
    found = _delivered(record(asked(9), notched(60.0, 40.0, 12.0)))
    assert found is not None
    assert found.notch is not None
    assert found.share == pytest.approx(1.0, abs=0.05)
    assert not found.sound
    words = found.words()
    assert found.notch.hz == pytest.approx(60.0, abs=4.0)
    assert "notch of its own" in words
    assert "6072h" not in words


@pytest.mark.parametrize(("hz", "width_hz", "depth_db"), [(107.0, 60.0, 20.0), (80.0, 120.0, 30.0), (200.0, 60.0, 15.0)])
def test_the_middle_of_a_notch(hz: float, width_hz: float, depth_db: float) -> None:
    """Within a line or two; the bilinear rule lowers 107 Hz to 103 and 200 Hz to 179."""
    done = record(asked(9), notched(hz, width_hz, depth_db))
    assert done.torque_setpoint is not None
    found = _notch(done.torque_setpoint, done.torque, 1.0 / PERIOD_S)
    assert found is not None
    assert found.hz == pytest.approx(np.arctan(np.pi * hz * PERIOD_S) / (np.pi * PERIOD_S), abs=8.0)
    assert found.share < 0.5


@pytest.mark.parametrize("seed", range(8))
def test_filters_limits_and_noise_are_no_notch(seed: int) -> None:
    """First and second order, a share of a sample of delay, a limit of the torque, and noise of a third of the torque."""
    draw = np.random.default_rng([58, seed])
    low_pass = butter(1 + seed % 2, float(draw.uniform(30.0, 300.0)), fs=1.0 / PERIOD_S)
    late, limit = float(draw.uniform()), float(draw.uniform(0.1, 0.3))
    ways: list[Callable[[Array], Array]] = [
        lambda u: np.asarray(lfilter(*low_pass, u)),
        lambda u: (1.0 - late) * u + late * np.roll(u, 1),
        lambda u: np.clip(u, 0.1 - limit, 0.1 + limit),
    ]
    for made in ways:
        for noise_nm in (6e-3, 0.1):
            done = record(asked(2 + 7 * (seed % 2)), made, noise_nm=noise_nm)
            assert done.torque_setpoint is not None
            assert _notch(done.torque_setpoint, done.torque, 1.0 / PERIOD_S) is None
