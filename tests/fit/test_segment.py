"""The residual at the true parameters is white noise of variance 1; its whitening is a dense Cholesky; its mask is what it says."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from beltcomm.fit.noise.propagation import NoiseSchedule, noise_path, noise_schedule
from beltcomm.fit.noise.whitening import whitener
from beltcomm.fit.residual.segment import STICK_SPEED_RAD_S, Segment, segments
from beltcomm.fit.residual.usable_samples import RUN_IN_S, RUN_IN_TRAVEL_M, resting_samples, run_in_samples
from beltcomm.fit.residual.whitened import evaluate, noise_paths_of, whitened_residual
from beltcomm.model import Model, build_model
from beltcomm.recording import Recording
from beltcomm.simulate.inverse import FineMotion, _interpolate, torque_residuals
from identify.records import COUNTS, NOISE_NM, PERIOD_S, STEP_RAD, Recorder, true_model
from truth import TruthPlant
from truth.rigs import draw

Array = NDArray[np.float64]
Pieces = dict[tuple[str, str], tuple[Segment, Model, float]]
#: Counts per revolution that drown in the torque noise.
FINE = 2**20


def swept(recorder: Recorder, plant: TruthPlant) -> Recording:
    """Slow strokes whose speed changes all the time: at a constant one the encoder's rounding repeats, and is no noise."""
    return recorder.stroked(plant, (0.02, 0.05, 0.1, 0.2, 0.4), 0.0, ramp_m_s2=0.3)


def masked_covariance(keep: NDArray[np.bool_], c0: float, c1: float, c2: float) -> Array:
    n = len(keep)
    full = c0 * np.eye(n)
    for lag, c in ((1, c1), (2, c2)):
        full += c * (np.eye(n, k=lag) + np.eye(n, k=-lag))
    return np.asarray(full[np.ix_(keep, keep)])


def free_inertia(inertia: float, samples: int) -> NoiseSchedule:
    """Without a belt both noises are moving averages, whose covariance is written down in a line."""
    return noise_schedule(build_model("free", (), {"motor.inertia": inertia}, base_bodies=("motor",)), np.zeros(samples), PERIOD_S)


def bands(inertia: float) -> tuple[float, float, float]:
    """Covariance of e = J (q[n+1] - 2 q[n] + q[n-1])/T² - (w[n-1] + w[n])/2 at lags 0, 1 and 2."""
    g = inertia * STEP_RAD / np.sqrt(12.0) / PERIOD_S**2
    return 0.5 * NOISE_NM**2 + 6.0 * g**2, 0.25 * NOISE_NM**2 - 4.0 * g**2, g**2


@pytest.mark.parametrize("share", [1.0, 0.9, 0.5, 0.2])
def test_whitening_is_the_dense_cholesky_of_the_kept_samples(share: float) -> None:
    rng = np.random.default_rng(1)
    residual, keep = rng.normal(size=300), rng.random(300) < share
    keep[:40] = np.arange(40) % 2 == 1  # every second one: only the second band is left; the first is none, as in every stretch
    keep[0] = False
    factor = np.linalg.cholesky(masked_covariance(keep, *bands(7e-5)))
    expected = np.linalg.solve(factor, residual[keep])
    np.testing.assert_allclose(whitener(keep, free_inertia(7e-5, len(keep)), STEP_RAD, NOISE_NM)(residual, keep), expected, rtol=1e-7)


def test_whitening_of_nothing_is_nothing() -> None:
    keep = np.zeros(20, dtype=bool)
    assert whitener(keep, free_inertia(7e-5, 20), STEP_RAD, NOISE_NM)(np.ones(20), keep).shape == (0,)


def test_gains_worked_out_beforehand_give_the_same() -> None:
    plant = draw("g_b", np.random.default_rng(10))
    model = true_model(plant)
    record = Recorder().shaken(plant, 0.3, 1)
    piece = segments(without_rows(record, slice(1300, None)), model, STEP_RAD, NOISE_NM, fitted=True)[0]
    fixed = replace(piece, whitener=whitener(piece.keep, noise_paths_of(piece, model), STEP_RAD, NOISE_NM))
    np.testing.assert_array_equal(whitened_residual(fixed, model, model.vector()), whitened_residual(piece, model, model.vector()))


@pytest.mark.parametrize(("period_s", "counts"), [(PERIOD_S, COUNTS), (2.0 * PERIOD_S, 500)])
def test_rounding_is_white_behind_a_belt_as_well(period_s: float, counts: int) -> None:
    """The noise path against the model itself: an angle that is nothing but rounding, driven backwards through the kernel."""
    model = true_model(draw("g_b", np.random.default_rng(10))).with_values({"coulomb.level": 0.0, "cart_friction.level": 0.0})
    n, rng, step = 40_000, np.random.default_rng(3), 2.0 * np.pi / counts
    angle, rate = _interpolate(step * (rng.random(n) - 0.5), 16)
    motion = FineMotion(angle + 0.25 / model["transmission.ratio"], rate / period_s, n, period_s, 16, 0.0)
    residual = torque_residuals(model, motion, NOISE_NM * rng.normal(size=n), [model.vector()], [0.0])[0]
    keep = np.ones(n, dtype=bool)
    keep[:500] = keep[-5:] = False  # the carriage starts at rest there, and at the end the spline has no sample behind it
    white = whitener(keep, noise_schedule(model, np.full(n, 0.25), period_s), step, NOISE_NM)(residual, keep)
    for lag in range(4):
        product = white[lag:] * white[: len(white) - lag]
        assert np.mean(product) == pytest.approx(1.0 if lag == 0 else 0.0, abs=4.0 * np.sqrt(2.0 / n))


@pytest.mark.parametrize(("dead_s", "lag_s"), [(3e-4, 0.0), (-2e-4, 0.0), (0.0, 1e-3), (1.4e-3, 5e-4), (2e-4, 8e-3)])
def test_noise_of_a_torque_that_acts_late_is_smoothed(dead_s: float, lag_s: float) -> None:
    """A single sample of it, through the kernel and along the noise path."""
    values = {"motor.inertia": 7e-5, "dead_time.time": dead_s, "current_lag.time": lag_s}
    model = build_model("free", ("dead_time", "current_lag"), values, base_bodies=("motor",))
    n, at, substeps = 80, 40, 64
    fine = np.zeros(substeps * (n - 1) + 1)
    motion = FineMotion(fine, fine, n, PERIOD_S, substeps, 0.0)
    seen = torque_residuals(model, motion, NOISE_NM * (np.arange(n) == at), [model.vector()], [0.0])[0]
    path = noise_path(model, 0.0, PERIOD_S)
    state, expected = np.zeros(len(path.H)), np.zeros(n)
    for k in range(n):
        new = np.array([0.0, NOISE_NM if k == at else 0.0])
        expected[k] = path.H @ state + path.D @ new
        state = path.F @ state + path.G @ new
    whole = math.floor(dead_s / PERIOD_S)  # of no meaning for a noise, and left out of its path
    np.testing.assert_allclose(seen[5:-5], np.roll(expected, whole)[5:-5], atol=2e-3 * NOISE_NM)


def test_rounding_is_white_all_along_a_way_on_which_the_stiffness_changes() -> None:
    """Rounding of an axis that crosses its travel, carried from sample to sample by the path of its own place."""
    effects = ("belt_stiffness", "belt_damping", "stiffness_position")
    values = {"cart.mass": 2.5, "belt_stiffness.stiffness": 2.1e5, "belt_damping.damping": 12.0, "transmission.ratio": 0.0125}
    values |= {"stiffness_position.offset": 0.1, "stiffness_position.pulley_distance": 1.2, "stiffness_position.middle": 0.5}
    model = build_model("axis", effects, values)
    n = 4000
    places = np.linspace(0.0, 0.9, n)
    rng = np.random.default_rng(4)
    rounding, noise = STEP_RAD / np.sqrt(12.0) * rng.normal(size=n), NOISE_NM * rng.normal(size=n)
    state, residual = np.zeros(len(noise_path(model, 0.0, PERIOD_S).H)), np.zeros(n)
    for k in range(n):
        if k % 100 == 0:
            here = noise_path(model, float(places[k + 50]), PERIOD_S)
        new = np.array([rounding[k], noise[k]])
        residual[k] = here.H @ state + here.D @ new
        state = here.F @ state + here.G @ new
    keep = np.ones(n, dtype=bool)
    along = noise_schedule(model, places, PERIOD_S)
    white = whitener(keep, along, STEP_RAD, NOISE_NM)(residual, keep)
    columns = whitener(keep, along, STEP_RAD, NOISE_NM)(np.stack([residual, 2.0 * residual], axis=1), keep)
    np.testing.assert_allclose(columns, np.stack([white, 2.0 * white], axis=1), rtol=0.0, atol=1e-9)
    middle = NoiseSchedule((noise_path(model, 0.45, PERIOD_S),), np.zeros(n, dtype=np.int64))
    blind = whitener(keep, middle, STEP_RAD, NOISE_NM)(residual, keep)
    parts = np.split(np.arange(n), 4)
    assert max(abs(float(np.mean(white[part] ** 2)) - 1.0) for part in parts) < 0.12  # three deviations of 1000 samples
    assert max(abs(float(np.mean(blind[part] ** 2)) - 1.0) for part in parts) > 0.5  # that of one path for all places


@pytest.mark.parametrize("offset_m", [0.001, 0.49])
def test_where_a_law_holds_nothing_at_one_end_the_middle_stands_for_all(offset_m: float) -> None:
    """Strands of no length, or of a negative one, as a search may come by."""
    model = build_model("axis", ("belt_spans", "belt_damping"), {"belt_spans.offset": offset_m, "belt_spans.pulley_distance": 1.25})
    places = np.linspace(-0.5 if offset_m > 0.1 else -offset_m, 0.5, 50)
    assert len(noise_schedule(model, places, PERIOD_S).paths) == 1
    assert len(noise_schedule(model, places + 0.1, PERIOD_S).paths) > 1


def test_whitened_noise_is_white() -> None:
    """Uniform rounding and normal torque noise by their definition, on a free inertia."""
    rng = np.random.default_rng(2)
    n, inertia = 400_000, 7e-5
    q, w = STEP_RAD * (rng.random(n) - 0.5), rng.normal(0.0, NOISE_NM, n)
    e = inertia * (q[2:] - 2.0 * q[1:-1] + q[:-2]) / PERIOD_S**2 - 0.5 * (w[:-2] + w[1:-1])
    white = whitener(np.ones(n - 2, dtype=bool), free_inertia(inertia, n - 2), STEP_RAD, NOISE_NM)(e, np.ones(n - 2, dtype=bool))
    for lag in range(4):
        product = white[lag:] * white[: len(white) - lag]
        assert np.mean(product) == pytest.approx(1.0 if lag == 0 else 0.0, abs=4.0 * np.sqrt(2.0 / n))


@pytest.fixture(scope="module")
def at_truth() -> Pieces:
    """Per rig and experiment: the record as a stretch, the true model, and where the carriage's friction had left it before."""
    found = {}
    for rig, seed in (("g_a", 11), ("g_b", 12)):
        for kind in ("prbs", "strokes", "strokes with a fine encoder"):
            plant = draw(rig, np.random.default_rng(seed))
            Recorder(seed=1).shaken(plant, 0.25, 1)  # leaves motor and carriage stuck somewhere
            offset = plant.cart_position_m - plant.axis.transmission_m_rad * plant.position_rad
            recorder = Recorder(seed=seed, counts=FINE if "fine" in kind else COUNTS)
            record = recorder.shaken(plant, 0.3, 4) if kind == "prbs" else swept(recorder, plant)
            model = true_model(plant)
            (piece,) = segments(record, model, 2.0 * np.pi / recorder.counts, NOISE_NM, fitted=True)
            found[rig, kind] = (piece, model, offset)
    return found


def assert_white(white: Array, tolerance: float) -> None:
    """Standard deviation of a variance is √(2/n), of a correlation 1/√n, of n independent normal values."""
    n = len(white)
    assert n > 1500
    assert np.mean(white) == pytest.approx(0.0, abs=tolerance / np.sqrt(n))
    assert np.var(white) == pytest.approx(1.0, abs=tolerance * np.sqrt(2.0 / n))
    for lag in (1, 2, 3, 10):
        assert np.mean(white[lag:] * white[:-lag]) == pytest.approx(0.0, abs=tolerance / np.sqrt(n)), lag


@pytest.mark.parametrize("rig", ["g_a", "g_b"])
@pytest.mark.parametrize("kind", ["prbs", "strokes with a fine encoder"])
def test_true_parameters_leave_white_noise_of_variance_one(at_truth: Pieces, rig: str, kind: str) -> None:
    piece, model, offset = at_truth[rig, kind]
    assert_white(whitened_residual(piece, model, model.vector(), offset), 4.0)


@pytest.mark.parametrize("rig", ["g_a", "g_b"])
def test_encoder_steps_also_reach_the_belt(at_truth: Pieces, rig: str) -> None:
    """What the whitening leaves out: the counted angle drives the carriage as well, most of all at its antiresonance.

    White rounding of variance q²/12 passes  J (z - 2 + 1/z)/T² + sinc²(ωT/2) r² P,  P = (c + s d) s² m/(s² m + s d + c); its
    covariance explains the slow strokes of a 65536-count encoder, the stated one (without P) leaves them correlated.
    """
    piece, model, offset = at_truth[rig, "strokes"]
    mass, stiffness, damping = (model[n] for n in ("cart.mass", "belt_stiffness.stiffness", "belt_damping.damping"))
    freq = (np.arange(500_000) + 0.5) / 1000.0
    s = 2j * np.pi * freq
    belt = (stiffness + s * damping) * mass * s**2 / (mass * s**2 + damping * s + stiffness)
    inertia = 2.0 * model["motor.inertia"] * (np.cos(2.0 * np.pi * freq * PERIOD_S) - 1.0) / PERIOD_S**2
    power = np.abs(inertia + np.sinc(freq * PERIOD_S) ** 2 * model["transmission.ratio"] ** 2 * belt) ** 2 * STEP_RAD**2 / 12.0
    g = model["motor.inertia"] * STEP_RAD / np.sqrt(12.0) / PERIOD_S**2
    raw, keep = evaluate(piece, model, model.vector(), offset), piece.keep
    tolerance = 4.0 * np.sqrt(2.0 / keep.sum()) * np.var(raw[keep])
    far_off = False
    for lag, noise, stated in ((0, 0.5, 6.0), (1, 0.25, -4.0), (2, 0.0, 1.0), (3, 0.0, 0.0), (4, 0.0, 0.0)):
        both = keep[lag:] & keep[: len(keep) - lag]
        found = float(np.mean((raw[lag:] * raw[: len(raw) - lag])[both])) - noise * NOISE_NM**2
        expected = float(np.mean(power * np.cos(2.0 * np.pi * freq * PERIOD_S * lag)))
        assert found == pytest.approx(expected, abs=tolerance), lag
        far_off |= abs(found - stated * g**2) > tolerance
    assert far_off, "the stated covariance would do as well: the whitening can be trusted with the belt"


WRONG = {
    "motor.inertia": 1.1,
    "cart.mass": 1.05,
    "belt_stiffness.stiffness": 0.95,
    "belt_damping.damping": 2.0,
    "coulomb.level": 1.1,
    "cart_friction.level": 1.5,
}


@pytest.mark.parametrize("name", WRONG)
@pytest.mark.parametrize("rig", ["g_a", "g_b"])
def test_a_wrong_parameter_raises_the_misfit(at_truth: Pieces, rig: str, name: str) -> None:
    piece, model, offset = at_truth[rig, "prbs"]
    right = np.mean(whitened_residual(piece, model, model.vector(), offset) ** 2)
    wrong = model.with_values({name: WRONG[name] * model[name]})
    assert np.mean(whitened_residual(piece, wrong, wrong.vector(), offset) ** 2) > right + 4.0 * np.sqrt(2.0 / piece.keep.sum())


@pytest.mark.parametrize("rig", ["g_a", "g_b"])
def test_without_noise_the_torque_is_explained_far_below_the_noise(rig: str) -> None:
    """What numerics and interpolation leave at the true parameters is a tenth of the noise where the motor slides on, PRBS included."""
    floor = np.sqrt(0.5 * NOISE_NM**2 + 6.0 * (7.173e-5 * STEP_RAD / np.sqrt(12.0) / PERIOD_S**2) ** 2)
    clean = Recorder(noise_nm=0.0, counts=2**28)
    for kind in ("prbs", "strokes"):
        plant = draw(rig, np.random.default_rng(13))
        model = true_model(plant)
        record = clean.shaken(plant, 0.3, 2) if kind == "prbs" else swept(clean, plant)
        (piece,) = segments(record, model, STEP_RAD, NOISE_NM, fitted=True)
        assert np.sqrt(np.mean(evaluate(piece, model, model.vector())[piece.keep] ** 2)) < 0.1 * floor


def swing(freq_hz: float, amplitude_rad: float, drift_rad_s: float = 0.0, samples: int = 600, substeps: int = 16) -> FineMotion:
    t = PERIOD_S / substeps * np.arange((samples - 1) * substeps + 1, dtype=np.float64)
    w = 2.0 * np.pi * freq_hz
    return FineMotion(
        amplitude_rad * np.sin(w * t) + drift_rad_s * t,
        amplitude_rad * w * np.cos(w * t) + drift_rad_s,
        samples, PERIOD_S, substeps, 0.0,
    )  # fmt: skip


@pytest.mark.parametrize("motion", [swing(11.0, 0.5), swing(137.0, 0.02), swing(60.0, 0.02, 7.7), swing(3.0, 0.03)], ids=range(4))
def test_samples_near_a_reversal_or_standstill_are_left_out(motion: FineMotion) -> None:
    """Sample n counts when the motor keeps one sign and the stick speed from t[n-1] to t[n+1], both ends included."""
    m, expected = motion.substeps, np.ones(motion.samples, dtype=bool)
    for n in range(1, motion.samples - 1):
        part = motion.omega[(n - 1) * m : (n + 1) * m + 1]
        expected[n] = not (np.all(part >= STICK_SPEED_RAD_S) or np.all(part <= -STICK_SPEED_RAD_S))
    found = resting_samples(motion, STICK_SPEED_RAD_S)
    np.testing.assert_array_equal(found, expected)
    assert found[0]
    assert found[-1]
    assert 0.0 < np.mean(found) < 1.0


def test_the_carriage_runs_in_before_anything_counts() -> None:
    """At v = 0.05 m/s from t = 0.1 s on: moved at 0.1 s + travel/v, counted 0.2 s later."""
    lever, speed = 0.01242, 0.05
    t = PERIOD_S / 16 * np.arange(599 * 16 + 1, dtype=np.float64)
    motion = FineMotion(7.0 - speed / lever * np.maximum(t - 0.1, 0.0), np.where(t > 0.1, -speed / lever, 0.0), 600, PERIOD_S, 16, 0.0)
    first = int(np.argmax(run_in_samples(motion, lever)))
    assert first * PERIOD_S == pytest.approx(0.1 + RUN_IN_TRAVEL_M / speed + RUN_IN_S, abs=1.01 * PERIOD_S)
    assert np.all(run_in_samples(motion, lever)[first:])
    assert not np.any(run_in_samples(swing(20.0, 0.9 * RUN_IN_TRAVEL_M / lever), lever))


def without_rows(record: Recording, *lost: slice) -> Recording:
    kept = np.ones(len(record.t_s), dtype=bool)
    for part in lost:
        kept[part] = False
    return replace(
        record,
        t_s=record.t_s[kept],
        torque=record.torque[kept],
        torque_setpoint=None,
        position=record.position[kept],
        cart_position_m=None,
    )


def test_lost_samples_split_a_record() -> None:
    plant = draw("g_b", np.random.default_rng(14))
    record = Recorder().shaken(plant, 0.3, 1, at_m=0.2)
    model = true_model(plant)
    lever = model["transmission.ratio"]
    torn = without_rows(record, slice(500, 503), slice(540, 541), slice(1200, 1300))  # 37 rows between the first two: too few
    pieces = segments(torn, model, STEP_RAD, NOISE_NM)
    firsts, lasts = [0, 541, 1300], [500, 1200, len(record.t_s)]
    assert [len(p.position) for p in pieces] == [b - a for a, b in zip(firsts, lasts, strict=True)]
    for piece, a, b in zip(pieces, firsts, lasts, strict=True):
        np.testing.assert_array_equal(piece.torque, record.torque[a:b])
        assert lever * piece.motion.theta[0] == pytest.approx(0.2 + lever * (record.position[a] - record.position[0]), abs=1e-12)
        assert piece.motion.time_s == pytest.approx(record.t_s[a])
        assert not np.any(piece.keep[: int(RUN_IN_S / PERIOD_S)])


def test_a_stretch_that_begins_in_motion_is_explained_as_well() -> None:
    """Five lost rows in the middle of a stroke; the ringing of rig G_B dies out with 10/s, 0.2 s are left out."""
    plant = draw("g_b", np.random.default_rng(22))
    model = true_model(plant)
    record = Recorder(1).stroked(plant, (0.6,), 0.5)
    middle = int(np.argmax(np.gradient(record.position))) + 50
    _, after = segments(without_rows(record, slice(middle, middle + 5)), model, STEP_RAD, NOISE_NM, fitted=True)
    assert np.mean(whitened_residual(after, model, model.vector()) ** 2) < 1.5


@pytest.mark.parametrize(("start_m", "same"), [(1.2000010, True), (1.2, True), (0.7, False), (1.21, False)])
def test_the_recorded_angle_is_absolute_where_the_start_position_says_the_same(start_m: float, *, same: bool) -> None:
    """A radius is known to five digits and less; the lines of an encoder are counted by the thousand, from one angle in all records."""
    plant = draw("g_b", np.random.default_rng(3))
    model = true_model(plant)
    ratio = model["transmission.ratio"]
    recording = swept(Recorder(seed=3), plant)
    moved = replace(
        recording,
        position=recording.position - recording.position[0] + 1.2 / ratio,
        sidecar=replace(recording.sidecar, start_position_m=start_m),
    )
    first = float(segments(moved, model, STEP_RAD, NOISE_NM)[0].motion.theta[0])
    assert first == pytest.approx(moved.position[0] if same else start_m / ratio, rel=1e-12)
