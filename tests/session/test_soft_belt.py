"""A model with a belt so soft that nothing swings, as a fit to a fault may end, has no resonance: and that is said;
and a design for a model whose fit left nothing to the damping of the belt.
"""

from __future__ import annotations

import pytest

from beltcomm.design.cautious import LEAST_RESONANCE_DAMPING
from beltcomm.errors import DataError
from beltcomm.fit.start.model import BELT_BASE
from beltcomm.model import build_model
from beltcomm.rundata import analyse
from beltcomm.rundata.analyse import characteristic_hz
from beltcomm.rundata.offline import THESIS_STRUCTURE
from identify.records import true_model
from truth.rigs import nominal


def test_a_carriage_that_does_not_swing_has_no_resonance() -> None:
    values = {"motor.inertia": 7e-5, "cart.mass": 13.0, "transmission.ratio": 0.01242}
    sound = build_model("sound", BELT_BASE, {**values, "belt_stiffness.stiffness": 2e5})
    lowest = sound.parameters["belt_stiffness.stiffness"].low
    with pytest.raises(DataError, match="has no resonance"):
        characteristic_hz(build_model("soft", BELT_BASE, {**values, "belt_stiffness.stiffness": lowest, "cart.mass": 150.0}), 0.2)
    assert characteristic_hz(sound, 0.2)[1] > 50.0


def test_a_fit_that_tells_no_damping_of_the_belt_is_counted_with_a_little_and_says_so() -> None:
    """884001: with none at all the gains of the final design were three hundred times too small, and the proving move drifted off."""
    told = true_model(nominal("g_a"))
    untold = told.with_values({"belt_damping.damping": 0.0})
    (plant, *_) = analyse.design_plants(told, [0.25], [told["cart.mass"]], 1e-3, 0.0)
    share = LEAST_RESONANCE_DAMPING / plant.resonance_damping
    assert share < 1.0, "less than this machine has"
    little = told.with_values({"belt_damping.damping": share * told["belt_damping.damping"], "viscous.damping": 0.0})
    found = {}
    for name, model in (("untold", untold.with_values({"viscous.damping": 0.0})), ("little", little)):
        found[name], _ = analyse.design(
            model, THESIS_STRUCTURE, positions_m=(0.25,), masses_kg=(model["cart.mass"],), dead_time_s=1e-3, apparent_damping_nm_s_rad=0.0
        )
    assert found["untold"].cascade.kp_nm_s_rad == pytest.approx(found["little"].cascade.kp_nm_s_rad, rel=0.05)
    assert [text for text in found["untold"].remarks if "damped by 1 %" in text]
    assert not [text for text in found["little"].remarks if "damped by" in text]
