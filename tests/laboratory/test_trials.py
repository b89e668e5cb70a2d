"""Where effects begin on trial: what a fit from there could not mend."""

from __future__ import annotations

import math

import pytest

from beltcomm.effects import AxisSummary, effect_named
from beltcomm.effects.payload_mode import _force

ACCELERATION_M_S2 = 12.0
GROUND = AxisSummary(
    inertia=7e-5, mass=2.0, stiffness=2e5, damping=15.0, coulomb=0.1, ratio=0.0125, low_m=0.1, high_m=0.9, antiresonance_hz=50.0,
    teeth=26.0, peak_nm=2.0, peak_force_n=2.0 * ACCELERATION_M_S2,
)  # fmt: skip


def test_a_soft_payload_begins_as_a_straight_spring() -> None:
    """One of 5 Hz swings by centimetres: begun with 1000/m² it was a tenth stiffer there, and a fit ended at 13 times the noise."""
    trials = effect_named("payload_mode").trials
    assert trials is not None
    for trial in trials(GROUND):
        own, mass = dict(trial.values), trial.values["payload.mass"]
        stretch = mass * ACCELERATION_M_S2 / own["stiffness"]  # by the largest acceleration of the carriage
        pull = _force(stretch, 0.0, 0.0, own["stiffness"], own["damping"], own["hardening"])
        assert pull == pytest.approx(mass * ACCELERATION_M_S2, rel=0.005)
    frequencies = [math.sqrt(t.values["stiffness"] / t.values["payload.mass"]) / math.tau for t in trials(GROUND)]
    assert min(frequencies) < 5.0 < 50.0 < max(frequencies)
