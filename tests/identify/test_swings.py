"""What still swings when a record begins: the whitening filter finds it out from the first samples."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from beltcomm.fit.noise.propagation import NoiseSchedule, noise_path
from beltcomm.fit.noise.whitening import whitener
from beltcomm.model import build_model

PERIOD_S, STEP_RAD, NOISE_NM = 1e-3, 2.0 * math.pi / 65536, 2e-3


def test_a_payload_that_still_swings_when_the_record_begins_leaves_no_trace() -> None:
    plain = build_model("axis", ("belt_stiffness", "belt_damping"), {"transmission.ratio": 0.0125})
    model = plain.with_effect("payload_mode", {"stiffness": 2.6e3, "damping": 2.0, "hardening": 0.0, "payload.mass": 2.0})
    path = noise_path(model, 0.3, PERIOD_S)
    swing = np.zeros(len(path.H))
    swing[[body.name for _, body in model.bodies()].index("payload") - 1] = 1e-3
    residual = np.empty(3000)
    for n in range(len(residual)):
        residual[n] = path.H @ swing
        swing = path.F @ swing
    keep = np.ones(len(residual), dtype=bool)
    one = NoiseSchedule((path,), np.zeros(len(residual), dtype=np.int64))
    left = whitener(keep, one, STEP_RAD, NOISE_NM)(residual, keep)
    forgotten = replace(one, paths=(replace(path, begins=path.begins * [0.0, 1.0, 1.0, 1.0]),))
    unknown = whitener(keep, forgotten, STEP_RAD, NOISE_NM)(residual, keep)
    assert np.abs(unknown[500:]).max() > 3.0  # it rings for seconds, and is far above the noise
    assert np.abs(left[500:]).max() < 0.1


def test_a_carriage_that_still_swings_when_the_record_begins_leaves_no_trace() -> None:
    """Heavy and hardly braked, it swings on for seconds behind a motor at rest:  m x'' + d x' + k x = 0, torque  r <k x + d x'>."""
    mass, stiffness, damping, ratio = 12.7, 1.66e5, 10.0, 0.0125
    values = {"transmission.ratio": ratio, "cart.mass": mass, "belt_stiffness.stiffness": stiffness, "belt_damping.damping": damping}
    path = noise_path(build_model("axis", ("belt_stiffness", "belt_damping"), values), 0.3, PERIOD_S)
    fine = np.arange(3000 * 20 + 21) * PERIOD_S / 20 - PERIOD_S
    decay = 0.5 * damping / mass
    poles = np.array([-decay + 1j * math.sqrt(stiffness / mass - decay**2)])
    pull = 1e-4 * ((stiffness + damping * poles[0]) * np.exp(poles[0] * fine)).real
    residual = -ratio * np.convolve(pull, np.bartlett(41) / 20, mode="valid")[::20]
    keep = np.arange(len(residual)) > 0  # the first is behind half a triangle
    one = NoiseSchedule((path,), np.zeros(len(residual), dtype=np.int64))
    left = whitener(keep, one, STEP_RAD, NOISE_NM)(residual, keep)
    forgotten = replace(one, paths=(replace(path, begins=path.begins * [0.0, 1.0, 1.0, 1.0]),))
    unknown = whitener(keep, forgotten, STEP_RAD, NOISE_NM)(residual, keep)
    assert np.sum(left[:500] ** 2) < 10.0, "no more than a few values of white noise"
    assert np.sum(unknown[:500] ** 2) > 500.0, "as much again as the noise itself"
