"""Encoders so coarse that a difference of two angles says nothing of the speed; the same machine with a fine one tells the truth."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.fit.model_fit import fit_model
from beltcomm.fit.noise.decimation import decimate_torque, decimated_noise, decimation
from beltcomm.fit.residual.segment import segments
from beltcomm.fit.residual.smoother import smooth_motion
from beltcomm.fit.uncertainty.nuisance import HELD, TOLERANCES
from beltcomm.model import Model
from beltcomm.recording import Recording
from identify.records import NOISE_NM, PERIOD_S, Recorder, true_model
from truth.rigs import draw

COUNTS, FINE = 600, 2**22


def recorded(counts: int, amplitude_nm: float = 0.3) -> tuple[list[Recording], Model]:
    plant = draw("g_b", np.random.default_rng(31))
    recorder = Recorder(seed=31, counts=counts)
    return [recorder.shaken(plant, amplitude_nm, 3)], true_model(plant)


def test_the_likeliest_speed_is_nearer_than_a_difference_and_says_how_near() -> None:
    (coarse,), truth = recorded(COUNTS)
    (fine,), _ = recorded(FINE)
    step = 2.0 * np.pi / COUNTS
    (piece,) = segments(coarse, truth, 2.0 * np.pi / FINE, NOISE_NM, fitted=True)  # as if it were fine: nothing is smoothed
    found = smooth_motion(truth, piece.motion, coarse.torque, step, NOISE_NM)
    assert found is not None
    right = np.gradient(fine.position, PERIOD_S)
    moving = np.abs(right) > 1.0  # where it rests the model slides
    off = (np.gradient(found.theta[:: piece.motion.substeps], PERIOD_S) - right)[moving]
    plain = (np.gradient(coarse.position, PERIOD_S) - right)[moving]
    assert float(np.std(off)) < 0.3 * float(np.std(plain))
    assert 0.3 < float(np.std(off)) / found.off_rad_s < 3.0


def test_a_belt_axis_with_a_coarse_encoder_is_fitted() -> None:
    records, truth = recorded(COUNTS, 0.5)
    start = truth.with_values({name: f * truth[name] for name, f in (("motor.inertia", 1.05), ("cart.mass", 0.95))})
    fit = fit_model(records, start, counts_per_rev=COUNTS)
    assert fit.misfit < 1.3
    for name in ("motor.inertia", "cart.mass", "belt_stiffness.stiffness"):
        item = fit.model.parameters[name]
        assert item.interval is not None, name
        assert abs(item.value - truth[name]) < 1.5 * item.interval, name


@pytest.mark.examination
def test_intervals_cover_behind_a_coarse_encoder_where_slow_strokes_are_recorded_too() -> None:
    """In strokes rounding follows the motion.  With one filter for all models twice the noise was left, and the inertia 5 to 100 % off."""
    widths = []
    for seed in range(31, 36):
        plant = draw("g_b", np.random.default_rng(seed))
        truth = true_model(plant)
        recorder = Recorder(seed=seed, counts=1000)
        records = [recorder.shaken(plant, 0.3, 3, "prbs"), recorder.stroked(plant, (0.02, 0.05, 0.1, 0.2, 0.4), 0.3, "strokes")]
        away = {"motor.inertia": 1.1, "cart.mass": 0.9, "belt_stiffness.stiffness": 0.85}
        fit = fit_model(records, truth.with_values({name: f * truth[name] for name, f in away.items()}), counts_per_rev=1000)
        assert all(piece.own_noise for piece in fit.data.fitted)
        assert fit.misfit == pytest.approx(1.0, abs=0.05 + 4.0 / np.sqrt(2.0 * fit.samples)), "means over 25 ms are few"
        for name in away:
            item = fit.model.parameters[name]
            assert item.interval is not None, name
            assert item.value == pytest.approx(truth[name], rel=0.04), name
            widths.append(abs(item.value - truth[name]) / item.interval)
    assert max(widths) < 1.0, "15 values"


def test_an_inertia_that_records_do_not_tell_is_the_data_sheets_and_the_others_bear_its_tolerance() -> None:
    records, truth = recorded(COUNTS, 0.13)
    sheet = truth.with_values(
        {"motor.inertia": 1.06 * truth["motor.inertia"], "belt_stiffness.stiffness": truth["belt_stiffness.stiffness"]}
    )
    sheet = replace(sheet, parameters={name: replace(item, origin="data sheet") for name, item in sheet.parameters.items()})
    free = fit_model(records, truth, counts_per_rev=COUNTS)
    own = free.model.parameters["motor.inertia"]
    assert own.interval is None or own.interval > 0.3 * own.value, "else this is no case of it"
    fit = fit_model(records, truth, counts_per_rev=COUNTS, sheet=sheet)
    inertia = fit.model.parameters["motor.inertia"]
    assert (inertia.value, inertia.origin) == (sheet["motor.inertia"], HELD)
    assert inertia.interval == pytest.approx(TOLERANCES["motor.inertia"] * inertia.value)
    assert any("do not tell motor.inertia" in remark for remark in fit.remarks)
    mass = fit.model.parameters["cart.mass"]
    assert mass.interval is not None
    assert abs(mass.value - truth["cart.mass"]) < 1.5 * mass.interval


@pytest.mark.parametrize("every", [2, 4])
def test_the_second_difference_over_some_periods_is_the_mean_torque_over_them(every: int) -> None:
    """An inertia under a torque that is held over each period, integrated exactly."""
    inertia, n = 2e-4, 64 * every
    torque = np.random.default_rng(5).normal(0.0, 0.1, n)
    speed = np.concatenate(([0.0], np.cumsum(torque / inertia * PERIOD_S)))
    angle = np.concatenate(([0.0], np.cumsum((speed[:-1] + 0.5 * torque / inertia * PERIOD_S) * PERIOD_S)))[:n]
    means, within = decimate_torque(torque, None, every)
    taken, sample = angle[::every], every * PERIOD_S
    needed = inertia * np.diff(taken, 2) / sample**2
    given = (0.5 * (means[:-1] + means[1:]) + within.triangular()[1:])[: len(needed)]
    np.testing.assert_allclose(given, needed, atol=1e-9)


def test_the_noise_of_a_thinned_torque_is_that_of_its_mean_with_the_triangular_weight() -> None:
    noise = np.random.default_rng(6).normal(0.0, 1.0, 400_000)
    for every in (1, 2, 4):
        means, within = decimate_torque(noise, None, every)
        weighted = 0.5 * (means[:-1] + means[1:]) + within.triangular()[1:]
        assert float(np.std(weighted[:-1])) == pytest.approx(decimated_noise(every) * np.sqrt(0.5), rel=0.01)


@pytest.mark.parametrize(("sample_s", "counts", "belt", "every"), [(5e-4, 865, True, 2), (5e-4, 65536, True, 1), (1e-3, 500, True, 1),
                                                                   (5e-4, 600, False, 4), (2e-3, 500, False, 1)])  # fmt: skip
def test_only_coarse_and_fast_records_are_thinned(sample_s: float, counts: int, belt: bool, every: int) -> None:
    assert decimation(sample_s, 2.0 * np.pi / counts, belt) == every
