"""A model with a belt so soft that nothing swings, as a fit to a fault may end, has no resonance: and that is said."""

from __future__ import annotations

import pytest

from beltcomm.errors import DataError
from beltcomm.fit.start.model import BELT_BASE
from beltcomm.model import build_model
from beltcomm.rundata.analyse import characteristic_hz


def test_a_carriage_that_does_not_swing_has_no_resonance() -> None:
    values = {"motor.inertia": 7e-5, "cart.mass": 13.0, "transmission.ratio": 0.01242}
    sound = build_model("sound", BELT_BASE, {**values, "belt_stiffness.stiffness": 2e5})
    lowest = sound.parameters["belt_stiffness.stiffness"].low
    with pytest.raises(DataError, match="has no resonance"):
        characteristic_hz(build_model("soft", BELT_BASE, {**values, "belt_stiffness.stiffness": lowest, "cart.mass": 150.0}), 0.2)
    assert characteristic_hz(sound, 0.2)[1] > 50.0
