"""The noise of a torque is found whatever excites the axis, and where it cannot be, that is said."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from beltcomm.fit.noise.level import _noise_untold, noise_colour, repeats_itself, rounding_of_reading, torque_noise
from beltcomm.recording import Recording
from beltcomm.recording.sidecar import ExcitationNote, Sidecar
from identify.records import NOISE_NM, Recorder
from truth.rigs import draw


def shaken(periods: int = 3) -> Recording:
    """Without a setpoint, as it comes from elsewhere."""
    record = Recorder(seed=15).shaken(draw("g_b", np.random.default_rng(15)), 0.3, periods)
    return replace(record, torque_setpoint=None, cart_position_m=None)


def some_rows(record: Recording, kept: slice | np.ndarray) -> Recording:
    return replace(record, t_s=record.t_s[kept], torque=record.torque[kept], position=record.position[kept])


@pytest.mark.parametrize("delay_s", [1.0e-3, 1.4e-3, 2.0e-3])
def test_torque_noise_is_read_from_setpoint_and_torque(delay_s: float) -> None:
    recorder = Recorder(seed=15, delay_s=delay_s)
    plant = draw("g_b", np.random.default_rng(15))
    opened, closed = recorder.shaken(plant, 0.3, 2), recorder.stroked(plant, (0.1, 0.5), 0.2)
    for records in ([opened], [closed], [opened, closed]):
        assert torque_noise(records) == pytest.approx(NOISE_NM, rel=0.1)


def test_torque_noise_without_a_setpoint_comes_from_repeated_periods_and_smooth_records() -> None:
    recorder = Recorder(seed=15)
    plant = draw("g_b", np.random.default_rng(15))
    opened, closed = recorder.shaken(plant, 0.3, 2), recorder.stroked(plant, (0.1, 0.5), 0.2)
    bare = [replace(record, torque_setpoint=None) for record in (opened, closed)]
    for records in ([bare[0]], [bare[1]], bare):
        assert torque_noise(records) == pytest.approx(NOISE_NM, rel=0.1)


def test_torque_noise_has_a_floor() -> None:
    plant = draw("g_b", np.random.default_rng(16))
    quiet = Recorder(noise_nm=0.0).shaken(plant, 0.3, 1)
    assert torque_noise([quiet], quiet_nm=2e-3) == 2e-3


def moved(step_nm: float, noise_nm: float) -> Recording:
    """Stop and go, read in steps; most of the rows the motor stands, with friction that holds what the controller has left."""
    torque = np.where(np.arange(6000) % 1000 < 300, 1.2 * np.sin(np.arange(6000) / 23.0), 0.31)
    read = np.round((torque + np.random.default_rng(4).normal(0.0, noise_nm, 6000)) / step_nm) * step_nm
    return Recording("moved", 1e-3 * np.arange(6000), read, np.cumsum(torque) * 1e-3, sidecar=Sidecar(experiment="trajectory"))


def test_a_torque_read_in_coarse_steps_has_their_noise_at_least() -> None:
    """Most of its differences are 0; one that is read finely has its own noise, and a switched command none of its own steps."""
    assert torque_noise([moved(0.05, 3e-3)]) == pytest.approx(0.05 / np.sqrt(12.0), rel=0.02)
    assert torque_noise([moved(1e-4, 3e-3)]) == pytest.approx(3e-3, rel=0.1)
    switched = moved(0.05, 0.0)
    switched = replace(switched, torque=np.where(switched.torque > 0.5, 1.0, -1.0))
    assert rounding_of_reading(switched) == 0.0


@pytest.mark.parametrize("rows", [1300, 1700, 2200, 2800])
def test_torque_noise_of_less_than_two_periods_is_not_that_of_the_jumps(rows: int) -> None:
    record = some_rows(shaken(), slice(rows))
    assert torque_noise([record]) == pytest.approx(NOISE_NM, rel=0.15)
    assert _noise_untold([record]) == ""


@pytest.mark.parametrize("experiment", ["free", "frf"])
def test_torque_noise_of_an_excitation_whose_period_nobody_stated(experiment: str) -> None:
    record = replace(shaken(), sidecar=Sidecar(experiment))
    assert torque_noise([record]) == pytest.approx(NOISE_NM, rel=0.15)


def test_torque_noise_of_an_excitation_whose_period_is_stated_wrong() -> None:
    record = shaken()
    note = record.sidecar.excitation
    assert note is not None
    wrong = replace(record, sidecar=replace(record.sidecar, excitation=replace(note, period_samples=900)))
    assert torque_noise([wrong]) == pytest.approx(NOISE_NM, rel=0.15)


@pytest.mark.parametrize("lost", [slice(1500, 1720), slice(2600, 3000)])
def test_torque_noise_beside_a_gap_comes_from_rows_that_belong_together_in_time(lost: slice) -> None:
    record = shaken()
    kept = np.ones(len(record.t_s), dtype=bool)
    kept[lost] = False
    assert torque_noise([some_rows(record, kept)]) == pytest.approx(NOISE_NM, rel=0.15)


def excited_by(torque: np.ndarray) -> Recording:
    noise = np.random.default_rng(3).normal(0.0, NOISE_NM, len(torque))
    times = 1e-3 * np.arange(len(torque))
    return Recording(name="excited", t_s=times, torque=torque + noise, position=np.sin(5.0 * times), sidecar=Sidecar("frf"))


def test_torque_noise_of_a_fast_but_smooth_excitation_that_does_not_repeat() -> None:
    times = 1e-3 * np.arange(6000)
    for_ms = np.random.default_rng(4).uniform(0.0, 6.0, 300)
    multisine = 0.02 * np.sum([np.cos(4.0 * k * times + for_ms[k]) for k in range(300)], axis=0)
    chirp = 0.2 * np.cos(12.0 * times + 90.0 * times**2)
    for signal in (multisine, chirp):
        assert torque_noise([excited_by(signal)]) == pytest.approx(NOISE_NM, rel=0.15)


def test_an_excitation_that_changes_with_every_row_hides_the_noise_and_that_is_said() -> None:
    record = excited_by(np.random.default_rng(5).normal(0.0, 0.2, 6000))
    assert "cannot be told" in _noise_untold([record])
    assert _noise_untold([replace(record, torque_setpoint=np.array(record.torque))]) == ""
    stroke = Recorder(seed=15).stroked(draw("g_b", np.random.default_rng(15)), (0.1, 0.5), 0.2)
    assert _noise_untold([record, replace(stroke, torque_setpoint=None)]) == ""


@pytest.mark.parametrize("amplitude_nm", [0.75, 2.5])
def test_torque_noise_of_one_period_of_a_multisine_that_is_fast_and_fades(amplitude_nm: float) -> None:
    """Odd lines up to half the highest frequency, one measured period behind a run-in, a fade that does not repeat."""
    period, rng = 2048, np.random.default_rng(6)
    lines = np.arange(1, period // 4, 2)
    times, phases = np.arange(4796), rng.uniform(0.0, 2.0 * np.pi, len(lines))
    torque = np.sum([np.cos(2.0 * np.pi * k * times / period + phase) for k, phase in zip(lines, phases, strict=True)], axis=0)
    torque *= np.clip(np.minimum(times / 250.0, (4796 - times) / 400.0), 0.0, 1.0) * amplitude_nm / np.abs(torque).max()
    record = excited_by(torque)
    note = ExcitationNote(kind="multisine", amplitude_nm=amplitude_nm, period_samples=period, first_sample=2299)
    for sidecar in (Sidecar("frf", excitation=note), Sidecar("free"), Sidecar("frf")):
        assert torque_noise([replace(record, sidecar=sidecar)]) == pytest.approx(NOISE_NM, rel=0.1)
        assert _noise_untold([replace(record, sidecar=sidecar)]) == ""


def test_an_excitation_that_falls_with_frequency_is_no_plateau_of_noise() -> None:
    """A noise through a lag of the first order has no band that is not excited; less than a tenth of it is nobody's noise."""
    driven = np.random.default_rng(7).normal(0.0, 0.2, 6000)
    record = excited_by(lfilter([0.1], [1.0, -0.9], driven))
    assert torque_noise([record]) > 1.5 * NOISE_NM
    assert "cannot be told" in _noise_untold([record])


@pytest.mark.parametrize("colour", [0.0, 0.5, 0.9])
def test_the_colour_of_the_noise_shows_between_periods(colour: float) -> None:
    """Without a setpoint: differences of a high order would show little of a noise that changes slowly."""
    plant = draw("g_b", np.random.default_rng(15))
    silent = Recorder(seed=15, noise_nm=0.0).shaken(plant, 0.3, 3)
    white = np.random.default_rng(16).normal(0.0, NOISE_NM, len(silent.torque))
    noise = lfilter([np.sqrt(1.0 - colour**2)], [1.0, -colour], white)
    record = replace(silent, torque=silent.torque + noise, torque_setpoint=None, cart_position_m=None)
    assert noise_colour([record]) == pytest.approx(colour, abs=0.08)
    assert torque_noise([record]) == pytest.approx(NOISE_NM, rel=0.25)


def test_a_command_that_comes_back_repeats_itself_and_a_measured_torque_does_not() -> None:
    plant = draw("g_b", np.random.default_rng(15))
    command = Recorder(seed=15, noise_nm=0.0).shaken(plant, 0.3, 3)
    rounded = replace(command, torque=np.round(command.torque / 4e-4) * 4e-4, torque_setpoint=None, cart_position_m=None)
    assert repeats_itself([rounded])
    assert not repeats_itself([shaken()])
    coarse = shaken()
    assert not repeats_itself([replace(coarse, torque=np.round(coarse.torque / 0.02) * 0.02)])
