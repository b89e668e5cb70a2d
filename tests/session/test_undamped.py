"""A design for a model whose fit left nothing to the damping of the belt."""

from __future__ import annotations

import pytest

from beltcomm.design.cautious import LEAST_RESONANCE_DAMPING
from beltcomm.rundata import analyse
from beltcomm.rundata.offline import THESIS_STRUCTURE
from identify.records import true_model
from truth.rigs import nominal


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
