"""A strand that goes slack: how stiff the belt is then, and what that does to the noise of a record."""

from __future__ import annotations

import numpy as np
import pytest

from beltcomm.fit.noise.propagation import noise_schedule
from beltcomm.fit.noise.whitening import whitener
from beltcomm.fit.residual.whitened import _stiffness_left
from beltcomm.model import Model, build_model
from beltcomm.simulate.inverse import FineMotion, torque_residuals

PERIOD_S, SUBSTEPS, SAMPLES = 1e-3, 16, 6000
STEP_RAD, NOISE_NM = 2.0 * np.pi / 65536, 1e-3
RATIO, MASS, STIFFNESS, LIMIT, SHARE = 0.0125, 12.0, 2e5, 3e-4, 0.4


def axis(*more: str) -> Model:
    values = {"cart.mass": MASS, "belt_stiffness.stiffness": STIFFNESS, "belt_damping.damping": 20.0, "transmission.ratio": RATIO}
    if "belt_slack" in more:
        values |= {"belt_slack.limit": LIMIT, "belt_slack.share": SHARE, "belt_slack.balance": 0.5}
    return build_model("axis", ("belt_stiffness", "belt_damping", *more), values)


def shaken(rounding: np.ndarray | None = None) -> FineMotion:
    """Pushed and braked with 0.7 Hz, 12 m/s² at the belt, from rest; rounding, rad, (n,), straight between the samples."""
    t = np.arange((SAMPLES - 1) * SUBSTEPS + 1) * PERIOD_S / SUBSTEPS
    w, swing = 2.0 * np.pi * 0.7, 12.0 / RATIO / (2.0 * np.pi * 0.7) ** 2
    theta, omega = swing * (w * t - np.sin(w * t)), swing * w * (1.0 - np.cos(w * t))
    if rounding is not None:
        theta = theta + np.interp(t, np.arange(SAMPLES) * PERIOD_S, rounding)
        omega = omega + np.append(np.repeat(np.diff(rounding) / PERIOD_S, SUBSTEPS), 0.0)
    return FineMotion(theta, omega, SAMPLES, PERIOD_S, SUBSTEPS, 0.0)


def test_what_is_left_of_the_stiffness_follows_the_force() -> None:
    """Force = mass times acceleration: beyond stiffness times limit one of two equal strands is gone."""
    left = _stiffness_left(axis("belt_slack"), shaken())
    assert left is not None
    force = MASS * 12.0 * np.sin(2.0 * np.pi * 0.7 * PERIOD_S * np.arange(SAMPLES))
    slack, tight = np.abs(force) > 1.6 * STIFFNESS * LIMIT, np.abs(force) < 0.5 * STIFFNESS * LIMIT
    assert slack.sum() > 1000
    assert tight.sum() > 500
    np.testing.assert_allclose(left[slack], SHARE, atol=1e-6)
    np.testing.assert_allclose(left[tight], 1.0, atol=1e-6)


@pytest.mark.parametrize("model", [axis(), axis("backlash"), build_model("free", (), {}, base_bodies=("motor",))])
def test_nothing_is_asked_where_no_strand_goes_slack(model: Model) -> None:
    assert _stiffness_left(model, shaken()) is None


def test_rounding_is_white_also_while_a_strand_is_slack() -> None:
    """Rounding through the model's own kernel, which knows nothing of levels, against the filter."""
    model, motion = axis("belt_slack"), shaken()
    left = _stiffness_left(model, motion)
    assert left is not None
    rng = np.random.default_rng(5)
    rounding, noise = STEP_RAD * (rng.random(SAMPLES) - 0.5), rng.normal(0.0, NOISE_NM, SAMPLES)
    silent = np.zeros(SAMPLES)
    residual = (
        torque_residuals(model, shaken(rounding), noise, [model.vector()], [0.0])[0]
        - torque_residuals(model, motion, silent, [model.vector()], [0.0])[0]
    )
    keep = np.ones(SAMPLES, dtype=bool)
    keep[:1000] = keep[-1] = False
    places = motion.theta[::SUBSTEPS] * RATIO
    white, blind = (
        whitener(keep, noise_schedule(model, places, PERIOD_S, share), STEP_RAD, NOISE_NM)(residual, keep) for share in (left, None)
    )
    slack = left[keep] < 0.5
    assert np.mean(slack) > 0.2
    chance = {part: np.sqrt(2.0 / np.count_nonzero(slack == part)) for part in (True, False)}  # of the mean square of white noise
    for part in (True, False):
        assert np.mean(white[slack == part] ** 2) == pytest.approx(1.0, abs=3.0 * chance[part])
    assert np.mean(blind[slack] ** 2) > 1.0 + 10.0 * chance[True], "with the stiffness of both strands"
