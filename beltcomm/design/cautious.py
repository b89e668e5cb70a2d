"""The first loop: closed right after the first frequency response, when little is known for certain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

from beltcomm.control import CascadeStructure
from beltcomm.design.cascade import DesignResult, design_cascade
from beltcomm.design.design_plant import DesignPlant, with_friction_fractions
from beltcomm.design.specification import Specification
from beltcomm.errors import UsageError

#: The least damping ratio of a belt resonance that the first loop counts on (an assumption; the rigs of the thesis have 3 %).
LEAST_RESONANCE_DAMPING = 0.01
#: Shares of the friction of a first response that the loop must hold with: most of it is Coulomb friction in disguise.
FRICTIONS = (0.0, 0.1, 1.0)


def cautious_specification() -> Specification:
    """Margins of the first loop: 45 degrees, 12 dB of suppression, 8 dB of gain; the position loop slow, 60 degrees."""
    return Specification(
        phase_margin_deg=45.0,
        suppression_db=-12.0,
        gain_margin_db=8.0,
        sensitivity_db=6.0,
        position_phase_margin_deg=60.0,
    )


def uncertain_plants(plant: DesignPlant, uncertainty: float = 0.3) -> list[DesignPlant]:
    """``plant`` and its corners: mass and stiffness each times 1 ± uncertainty, with none, a tenth and all of its damping.

    The damping of a first frequency response is mostly Coulomb friction in disguise.  A plant that states no belt damper gets
    the one that makes a third of the resonance's damping; any has one that makes ``LEAST_RESONANCE_DAMPING`` at least.

    Parameters
    ----------
    plant : DesignPlant
        Of a first frequency response.
    uncertainty : float
        Share of mass and stiffness that they may be wrong by.

    Returns
    -------
    list of DesignPlant
        Named for what was changed.

    Raises
    ------
    UsageError
        For an uncertainty not between 0 and 1.
    """
    if not 0.0 < uncertainty < 1.0:
        raise UsageError(f"the uncertainty of the first plant is {uncertainty}; give a share between 0 and 1, such as 0.3")
    plant = with_least_damping(plant)
    ends = (1.0 - uncertainty, 1.0 + uncertainty)
    result = []
    for m, c in [(1.0, 1.0), *itertools.product(ends, repeat=2)]:
        name = f"mass x {m:g}, stiffness x {c:g}"
        corner = replace(plant, mass_kg=m * plant.mass_kg, stiffness_n_m=c * plant.stiffness_n_m, name=name)
        result += with_friction_fractions(corner, FRICTIONS)
    return result


def with_least_damping(plant: DesignPlant) -> DesignPlant:
    """The plant with the belt damper that a first loop may count on.

    Parameters
    ----------
    plant : DesignPlant
        Of a first frequency response.
    """
    if plant.belt_damping_ns_m == 0.0:
        plant = with_resonance_damping(plant, max(LEAST_RESONANCE_DAMPING, plant.resonance_damping / 3.0))
    least = with_resonance_damping(plant, LEAST_RESONANCE_DAMPING)
    # A first response hardly tells it, and without it there is no loop at all.
    return least if plant.belt_damping_ns_m < least.belt_damping_ns_m else plant


def with_resonance_damping(plant: DesignPlant, ratio: float) -> DesignPlant:
    """The plant with the belt damper that alone gives the resonance this damping ratio.

    Parameters
    ----------
    plant : DesignPlant
        With any belt damper.
    ratio : float
        ζ of the resonance.

    Returns
    -------
    DesignPlant
        Friction of motor and carriage as it was.
    """
    relative_mass = plant.inertia_kg_m2 * plant.mass_kg / plant.total_inertia_kg_m2
    return replace(plant, belt_damping_ns_m=2.0 * ratio * math.sqrt(plant.stiffness_n_m * relative_mass))


def cautious_cascade(
    plant: DesignPlant,
    structure: CascadeStructure,
    uncertainty: float = 0.3,
    specification: Specification | None = None,
    besides: Sequence[DesignPlant] = (),
) -> DesignResult:
    """A cascade with large margins on the plant and on all its uncertain neighbours (:func:`uncertain_plants`).

    Raises Infeasible with the nearest feasible request.

    Parameters
    ----------
    plant : DesignPlant
        Fitted to the first frequency response, damping as it shows.
    structure : CascadeStructure
        What the drive offers.
    uncertainty : float
        Of mass and stiffness; friction moves the fit, and the axis was measured at one position only.
    specification : Specification or None
        Default :func:`cautious_specification`.
    besides : sequence of DesignPlant
        For which it must hold, too.
    """
    return design_cascade([*uncertain_plants(plant, uncertainty), *besides], structure, specification or cautious_specification())
