"""The first loop: closed right after the first frequency response, when little is known for certain."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

from beltcomm.control import CascadeStructure
from beltcomm.design.cascade import DesignResult, design_cascade
from beltcomm.design.design_plant import DesignPlant, with_friction_fractions
from beltcomm.design.specification import Specification

#: Mass and stiffness of the first fit may be this far off: friction moves it (thesis sheet, errata 14), and the axis was
#: measured at one position only.
UNCERTAINTY = 0.3

#: The least damping ratio of a belt resonance that the first loop counts on (an assumption; the rigs of the thesis have 3 %).
LEAST_RESONANCE_DAMPING = 0.01


def cautious_specification() -> Specification:
    """Margins of the first loop: 45 degrees, 16 dB of suppression, 10 dB of gain; they hold on all uncertain plants.

    The position loop is asked for 60 degrees, which leaves it slow against the velocity loop.
    """
    return Specification(
        phase_margin_deg=45.0,
        suppression_db=-16.0,
        gain_margin_db=10.0,
        sensitivity_db=6.0,
        position_phase_margin_deg=60.0,
    )


def uncertain_plants(plant: DesignPlant) -> list[DesignPlant]:
    """``plant`` and its corners: mass and stiffness ±30 %, each with none, a tenth and all of its friction damping.

    The damping of the frequency response is mostly Coulomb friction, so that the resonance is given the belt damper that
    makes ``LEAST_RESONANCE_DAMPING`` of it, unless the plant states a belt damper itself.
    """
    corners = [
        replace(plant, mass_kg=m * plant.mass_kg, stiffness_n_m=c * plant.stiffness_n_m, name=f"mass x {m:g}, stiffness x {c:g}")
        for m, c in [(1.0, 1.0), *itertools.product((1.0 - UNCERTAINTY, 1.0 + UNCERTAINTY), repeat=2)]
    ]
    result = []
    for corner in corners:
        if corner.belt_damping_ns_m == 0.0:
            relative_mass = corner.inertia_kg_m2 * corner.mass_kg / corner.total_inertia_kg_m2
            least = 2.0 * LEAST_RESONANCE_DAMPING * math.sqrt(corner.stiffness_n_m * relative_mass)
            corner = replace(corner, belt_damping_ns_m=least)
        result += with_friction_fractions(corner, (0.0, 0.1, 1.0))
    return result


def cautious_cascade(plant: DesignPlant, structure: CascadeStructure, specification: Specification | None = None) -> DesignResult:
    """A cascade with large margins on the plant and on all its uncertain neighbours (:func:`uncertain_plants`).

    plant : fitted to the first frequency response, damping as it shows.   structure : what the drive offers.
    specification : default :func:`cautious_specification`.   Raises Infeasible with the nearest feasible request.
    """
    return design_cascade(uncertain_plants(plant), structure, specification or cautious_specification())
