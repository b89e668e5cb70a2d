"""The first loop holds on plants it has never seen, inside the uncertainty it was designed for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from beltcomm.control import CascadeStructure
from beltcomm.design.cautious import cautious_cascade, cautious_specification, uncertain_plants
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.margins import margins
from beltcomm.errors import UsageError

RATIO = 0.01242
PERIOD = 1e-3
REFERENCE = CascadeStructure("reference", PERIOD, ("none", "notch", "butterworth"), True, True, True)
#: What the thesis's frequency responses show: no belt damper, friction as damping.
FITTED = {
    "G_A": DesignPlant(71.73e-6, RATIO, 13.44, 203.74e3, 33.17 * RATIO**2, 226.42, 0.0, 1e-3),
    "G_B": DesignPlant(71.73e-6, RATIO, 0.96, 222.39e3, 0.01 * RATIO**2, 53.70, 0.0, 1e-3),
}


@pytest.mark.parametrize("name", ["G_A", "G_B"])
def test_true_plants_within_the_uncertainty_keep_large_margins(name: str) -> None:
    """Random masses and stiffnesses within ±30 %, friction of the moving axis, belt damper 20 N s/m."""
    cascade = cautious_cascade(FITTED[name], REFERENCE).cascade
    rng = np.random.default_rng(3)
    true = replace(FITTED[name], motor_damping_nm_s_rad=2.4e-3, cart_damping_ns_m=0.0, belt_damping_ns_m=20.0)
    drawn = [replace(true, mass_kg=true.mass_kg * m, stiffness_n_m=true.stiffness_n_m * c) for m, c in rng.uniform(0.7, 1.3, (12, 2))]
    for one in margins(cascade, drawn, PERIOD):
        assert one.stable
        assert one.velocity_stable
        assert one.phase_margin_deg > 44.0
        assert one.suppression_db < -12.0
        assert one.gain_margin_db > 8.0
        assert one.position_phase_margin_deg > 59.0


def test_corners_carry_less_damping_than_the_response_shows() -> None:
    plants = uncertain_plants(FITTED["G_A"])
    assert {round(p.mass_kg / 13.44, 3) for p in plants} == {0.7, 1.0, 1.3}
    assert {round(p.stiffness_n_m / 203.74e3, 3) for p in plants} == {0.7, 1.0, 1.3}
    frictionless = [p for p in plants if p.friction_damping_nm_s_rad == 0.0]
    assert len(frictionless) == 5
    nominal = frictionless[0]
    assert nominal.resonance_damping == pytest.approx(FITTED["G_A"].resonance_damping / 3.0, rel=1e-6)
    # G_B's response shows 1.1 %, a third of which would be less than the assumed least of 1 %.
    nominal_b = next(p for p in uncertain_plants(FITTED["G_B"]) if p.friction_damping_nm_s_rad == 0.0)
    assert nominal_b.resonance_damping == pytest.approx(0.01, rel=1e-6)


def test_a_stated_belt_damper_is_kept() -> None:
    assert {p.belt_damping_ns_m for p in uncertain_plants(replace(FITTED["G_A"], belt_damping_ns_m=20.0))} == {20.0}


def test_a_stated_belt_damper_damps_the_resonance_at_least_as_any_does() -> None:
    """A first response with a coarse encoder told 15 of 104 N s/m: the loop came out eight times too weak."""
    hardly = next(p for p in uncertain_plants(replace(FITTED["G_A"], belt_damping_ns_m=0.5)) if p.friction_damping_nm_s_rad == 0.0)
    assert hardly.resonance_damping == pytest.approx(0.01, rel=1e-6)


def test_more_uncertainty_costs_stiffness() -> None:
    butterworth = replace(REFERENCE, prefilters=("butterworth",))
    little = cautious_cascade(FITTED["G_A"], butterworth, uncertainty=0.1)
    much = cautious_cascade(FITTED["G_A"], butterworth, uncertainty=0.3)
    assert much.stiffness < little.stiffness
    assert much.specification == cautious_specification()


@pytest.mark.parametrize("uncertainty", [0.0, 1.0, -0.3])
def test_impossible_uncertainty_is_refused(uncertainty: float) -> None:
    with pytest.raises(UsageError, match="uncertainty"):
        uncertain_plants(FITTED["G_A"], uncertainty)
