"""The thesis's three tuning knobs (4.4): velocity phase margin, position phase margin, suppression of the resonance.

On a plant, behind a prefilter and with T_R the three numbers fix the three gains:  A_sup is |G_PI G_ω| at the undamped resonance ω_r
(4.7),  φ_ωr the distance to −180° at the first crossover of the open velocity loop (4.8), (4.9),  φ_φr the same of the open position
loop (4.13), all on the continuous plant (2.42) with its dead time.   :func:`knobs_of` reads them off given gains,
:func:`gains_for` goes the other way, :func:`designs_along_knob` moves one of them alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

from beltcomm.control import Cascade, Prefilter, PrefilterKind
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.thesis import ThesisDesign, thesis_design, thesis_margins
from beltcomm.errors import Refused

Knob = Literal["phase_margin_deg", "position_phase_margin_deg", "suppression_db"]
#: Gains count as the same from this relative difference down: margins are solved to 1e-12, their inverse loses a few digits.
SAME = 1e-6


@dataclass(frozen=True)
class Knobs:
    """φ_ωr and φ_φr, deg, and A_sup, dB.   Defaults: the thesis's, tables A.6 and A.7."""

    phase_margin_deg: float = 60.0
    position_phase_margin_deg: float = 80.0
    suppression_db: float = -10.0


@dataclass(frozen=True)
class KnobSetting:
    """Positions of the knobs for given gains.

    Attributes
    ----------
    again : ThesisDesign or None
        The design from these knobs, None when the equations refuse them (``refusal`` says why).
    same : bool
        It has the given gains; otherwise they are another solution of the same equations.
    """

    knobs: Knobs
    again: ThesisDesign | None
    same: bool
    refusal: str = ""


@dataclass(frozen=True)
class Turn:
    """One position of one knob: the design, None where the equations have no solution, with the reason."""

    value: float
    design: ThesisDesign | None
    refusal: str = ""


def knobs_of(plant: DesignPlant, cascade: Cascade) -> KnobSetting:
    """The knobs that give these gains on this plant, exactly, and whether turning them there gives the gains back.

    The prefilter and T_R of ``cascade`` count as given.

    Parameters
    ----------
    plant : DesignPlant
        On which the margins are asked.
    cascade : Cascade
        Gains, prefilter and T_R.

    Returns
    -------
    KnobSetting
        Margins and suppression, and the design that they give.

    Raises
    ------
    Refused
        When a loop of these gains has no crossover.
    """
    achieved = thesis_margins(plant, cascade)
    knobs = Knobs(achieved.phase_margin_deg, achieved.position_phase_margin_deg, achieved.suppression_db)
    try:
        again = gains_for(plant, cascade.prefilter, knobs, cascade.velocity_filter_s)
    except Refused as refusal:
        return KnobSetting(knobs, None, False, str(refusal))
    pairs = (
        (again.cascade.kp_nm_s_rad, cascade.kp_nm_s_rad),
        (again.cascade.ki_nm_rad, cascade.ki_nm_rad),
        (again.cascade.kpp_1_s, cascade.kpp_1_s),
    )
    return KnobSetting(knobs, again, all(abs(one - other) <= SAME * other for one, other in pairs))


def gains_for(plant: DesignPlant, prefilter: PrefilterKind | Prefilter, knobs: Knobs, velocity_filter_s: float = 0.002) -> ThesisDesign:
    """The gains that the knobs stand for.

    Parameters
    ----------
    velocity_filter_s : float
        T_R, s.

    Raises
    ------
    Refused
        As ``thesis.thesis_design``.
    """
    return thesis_design(plant, prefilter, velocity_filter_s, knobs.phase_margin_deg, knobs.suppression_db, knobs.position_phase_margin_deg)


def designs_along_knob(plant: DesignPlant, prefilter: PrefilterKind | Prefilter, knob: Knob, values: Sequence[float]) -> tuple[Turn, ...]:
    """Designs with one knob at several values and the others at their defaults, T_R 2 ms.

    Parameters
    ----------
    plant : DesignPlant
        On which the margins are asked.
    prefilter : PrefilterKind or Prefilter
        Laid out on the plant, or as it is.
    knob : Knob
        Which is turned.
    values : sequence of float
        In the unit of the knob.

    Returns
    -------
    tuple of Turn
        One for each value, with the refusal where there is no design.
    """
    turns = []
    for value in values:
        try:
            turns.append(Turn(value, gains_for(plant, prefilter, replace(Knobs(), **{knob: value}))))
        except Refused as refusal:
            turns.append(Turn(value, None, str(refusal)))
    return tuple(turns)
