"""Which of setpoint and reading acts is told by the motion; machines of the independent simulator behind drives made here."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from beltcomm.fit.model_fit import ModelFit, fit_model
from beltcomm.fit.path_fit.trial_paths import splits, ways_of
from beltcomm.fit.torque.lag import Lag
from beltcomm.fit.torque.laws import DriveLaw
from beltcomm.model import Model
from beltcomm.recording import Recording
from fit.drives import Array, behind, first_order, held, smoothed
from identify.records import COUNTS, NOISE_NM, PERIOD_S, Recorder, true_model
from truth.rigs import draw

#: Mean square of what a right model leaves: 1, beside 5 % by which the noise is known and 5 deviations √(2/n) of 5000 samples.
RIGHT = 1.1
#: What a wrong torque would move first.
TOLD = ("motor.inertia", "cart.mass", "belt_stiffness.stiffness")


def session(
    seed: int,
    *,
    delay_s: float = 1e-3,
    lag_s: float = 0.0,
    share: float = 1.0,
    read: Callable[[Array], Array] = np.array,
    periods: int = 2,
) -> tuple[list[Recording], Model]:
    """A response and strokes behind a drive; what it reads of the torque, means over the samples without noise, is made by ``read``."""
    plant, rng = draw("g_b", np.random.default_rng(seed)), np.random.default_rng(seed + 100)
    recorder = Recorder(seed, delay_s=delay_s, lag_s=lag_s, share=share, noise_nm=0.0)
    silent = [recorder.shaken(plant, 0.3, periods), recorder.stroked(plant, (0.1, 0.5), 0.2)]
    records = [replace(record, torque=read(record.torque) + rng.normal(0.0, NOISE_NM, len(record.torque))) for record in silent]
    return records, true_model(plant)


def fitted(records: list[Recording], truth: Model) -> ModelFit:
    """From start values a few per cent off."""
    start = truth.with_values({name: factor * truth[name] for name, factor in zip(TOLD, (1.05, 0.95, 1.07), strict=True)})
    return fit_model(records, start, counts_per_rev=COUNTS)


def assert_right(fit: ModelFit, truth: Model) -> None:
    """Noise is left, and what is found lies within 1.5 intervals, 2.9 deviations."""
    assert fit.misfit < RIGHT
    for name in TOLD:
        item = fit.model.parameters[name]
        assert item.interval is not None
        assert abs(item.value - truth[name]) < 1.5 * item.interval, name


def filtered(torque: Array) -> Array:
    """Behind a filter of first order of 2 ms; between the samples the torque is held."""
    return behind(held(torque, 0.0), PERIOD_S, *first_order(2e-3)).mean(axis=1)


def test_a_faithful_reading_of_a_plain_drive_is_the_torque_that_acts() -> None:
    fit = fitted(*(case := session(1)))
    assert fit.path.reading.faithful
    assert fit.path.drive is not None
    assert (fit.path.drive.delay, fit.path.drive.lags) == (1.0, ())
    assert_right(fit, case[1])


@pytest.mark.examination
def test_a_filter_of_the_reading_is_told_from_one_of_the_drive() -> None:
    records, truth = session(2, read=filtered)
    fit = fitted(records, truth)
    assert fit.path.drive is not None
    assert fit.path.drive.lags == ()
    assert fit.path.drive.delay_s(PERIOD_S) == pytest.approx(PERIOD_S, abs=2e-5)
    assert fit.path.reading.delay_s(PERIOD_S) == pytest.approx(2e-3, rel=0.02)
    assert_right(fit, truth)


def test_a_filter_of_the_reading_is_not_taken_for_the_drives_where_the_motion_comes_a_sample_late() -> None:
    """By a model without a dead time the drive's filter would explain the motion better."""
    fit = fitted(*session(3, read=lambda torque: np.roll(filtered(torque), -1)))
    assert fit.path.drive is not None
    assert fit.path.drive.lags == ()
    assert fit.path.reading.delay_s(PERIOD_S) == pytest.approx(2e-3, rel=0.02)
    assert fit.suspect  # the dead time is for a search to find


def test_a_filter_of_the_drive_is_told_from_one_of_the_reading() -> None:
    """As one of a drive that smooths its setpoint: the reading is what acts, and hardly differs from that of the case before."""
    records, truth = session(3, share=0.5)
    fit = fitted(records, truth)
    assert fit.path.reading.faithful
    assert fit.path.drive is not None
    assert fit.path.drive.delay_s(PERIOD_S) == pytest.approx(2.0 * PERIOD_S, rel=0.01)
    assert_right(fit, truth)


@pytest.mark.examination
def test_a_current_loop_is_the_drives() -> None:
    records, truth = session(4, lag_s=4e-4)
    fit = fitted(records, truth)
    assert fit.path.reading.faithful
    assert fit.path.drive is not None
    assert fit.path.drive.delay_s(PERIOD_S) == pytest.approx(1.4e-3, rel=0.01)
    assert_right(fit, truth)


def test_a_reading_that_is_late_is_told_from_a_drive_that_is() -> None:
    """Two samples from setpoint to reading: one before the torque acts, one behind it."""
    late, truth = session(5, read=lambda torque: np.append(0.0, torque[:-1]))
    fit = fitted(late, truth)
    assert fit.path.drive is not None
    assert (fit.path.drive.delay, fit.path.reading.late) == (1.0, 1.0)
    assert_right(fit, truth)

    slow, truth = session(5, delay_s=2e-3)
    fit = fitted(slow, truth)
    assert fit.path.drive is not None
    assert (fit.path.drive.delay, fit.path.reading.late) == (2.0, 0.0)
    assert_right(fit, truth)


@pytest.mark.examination
def test_a_fraction_of_a_sample_is_divided_between_drive_and_reading() -> None:
    """Torque that switches 0.12 ms after the sample, read as the mean of a period that ended 0.85 ms before: 0.03 of it is new."""
    records, truth = session(8, delay_s=1.12e-3)
    rng, late = np.random.default_rng(9), []
    for record in records:
        assert record.torque_setpoint is not None
        one, two = (np.append(np.full(k, record.torque_setpoint[0]), record.torque_setpoint[:-k]) for k in (1, 2))
        late.append(replace(record, torque=0.03 * one + 0.97 * two + rng.normal(0.0, NOISE_NM, len(one))))
    fit = fitted(late, truth)
    assert fit.path.drive is not None
    assert fit.path.drive.delay_s(PERIOD_S) == pytest.approx(1.12e-3, abs=0.02e-3)
    assert fit.path.drive.delay_s(PERIOD_S) + fit.path.reading.late * PERIOD_S == pytest.approx(1.97e-3, abs=0.01e-3)
    assert_right(fit, truth)


@pytest.mark.examination
def test_a_drive_that_switches_between_samples_is_the_drives() -> None:
    """1.57 ms from setpoint to torque: without the setpoint the motion tells at which share of the sample."""
    records, truth = session(6, delay_s=1.57e-3)
    fit = fitted(records, truth)
    assert fit.path.reading.faithful
    assert fit.path.drive is not None
    assert fit.path.drive.delay == pytest.approx(1.57, abs=0.01)
    assert_right(fit, truth)
    untold = fitted([replace(r, torque_setpoint=None) for r in records], truth)
    assert untold.path.without_setpoint
    assert untold.path.drive is not None
    assert untold.path.drive.delay_s(PERIOD_S) == pytest.approx(0.57 * PERIOD_S, abs=0.02 * PERIOD_S)
    assert_right(untold, truth)


@pytest.mark.examination
def test_a_filter_of_the_reading_is_told_without_a_setpoint_too() -> None:
    """Read at the end of each sample, as a filter of the samples' clock does; its noise is made five times as loud by undoing it."""
    share = 1.0 - np.exp(-0.5)
    records, truth = session(7, read=lambda torque: smoothed(torque, share), periods=1)
    fit = fitted([replace(r, torque_setpoint=None) for r in records], truth)
    assert fit.path.drive is None
    (lag,) = fit.path.reading.lags
    assert lag.values[0] == pytest.approx(2e-3, rel=0.03)
    for name in TOLD:
        assert fit.model[name] == pytest.approx(truth[name], rel=0.02), name


@pytest.mark.examination
def test_a_reading_that_is_the_command_does_not_hide_the_drives_filter() -> None:
    """What it reports is its setpoint, one sample later, without noise; the torque comes behind 2 ms more."""
    records, truth = session(8, lag_s=2e-3, periods=1)
    commands = [replace(r, torque=np.append(0.0, r.torque_setpoint[:-1])) for r in records if r.torque_setpoint is not None]
    fit = fitted(commands, truth)
    assert fit.path.commanded
    assert fit.path.drive is not None
    assert fit.path.drive.delay_s(PERIOD_S) == pytest.approx(3e-3, rel=0.03)
    for name in TOLD:
        assert fit.model[name] == pytest.approx(truth[name], rel=0.02), name


def test_every_split_of_a_chain_is_the_same_chain() -> None:
    """Each filter once, on one side; the whole delay of a slow torque is that of the chain, the first leaves the reading faithful."""
    law = DriveLaw(1.4, (Lag("sampled", (0.5,)), Lag("first order", (1e-3,))), 0.9)
    ways = list(splits(law))
    assert ways[0].drive == law
    assert ways[0].reading.faithful
    assert len(set(ways)) == len(ways) == 12
    for way in ways:
        assert way.drive is not None
        assert way.drive.gain == law.gain
        assert sorted([*way.drive.lags, *way.reading.lags], key=str) == sorted(law.lags, key=str)
        assert way.drive.delay_s(PERIOD_S) + way.reading.delay_s(PERIOD_S) == pytest.approx(law.delay_s(PERIOD_S))
    assert len(list(splits(DriveLaw(0.0)))) == 1, "nothing to divide"


def test_what_a_limit_of_the_slew_rate_is_given_is_the_drives() -> None:
    lags = (Lag("sampled", (0.7,)), Lag("slew rate", (150.0,)), Lag("first order", (1e-3,)))
    divided = list(splits(DriveLaw(1.0, lags)))
    assert {path.drive.lags[:2] for path in divided if path.drive is not None} == {lags[:2]}
    assert {path.reading.lags for path in divided} == {(), lags[2:]}


@pytest.mark.parametrize(("damping", "pairs"), [(0.7, 0), (1.2, 2), (3.0, 2)])
def test_a_filter_that_does_not_swing_may_be_one_of_the_drive_and_one_of_its_reading(damping: float, pairs: int) -> None:
    law = DriveLaw(1.0, (Lag("second order", (200.0, damping)),))
    divided = [
        p for p in ways_of([(law, False)], PERIOD_S) if p.drive is not None and p.drive.delay == 1.0 and p.drive.lags and p.reading.lags
    ]
    assert len(divided) == pairs
    omega = 2.0 * np.pi * 200.0
    for path in divided:
        assert path.drive is not None
        times = [lag.values[0] for lag in (*path.drive.lags, *path.reading.lags)]
        assert sum(times) == pytest.approx(2.0 * damping / omega)  # (1 + T_1 s)(1 + T_2 s) = 1 + 2 D s/ω + s²/ω²
        assert np.prod(times) == pytest.approx(1.0 / omega**2)
