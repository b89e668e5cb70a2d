"""Requirements on a cascade, and the refusal when no cascade meets them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from beltcomm.control import PrefilterKind
from beltcomm.errors import Refused, UsageError


@dataclass(frozen=True)
class Specification:
    """Conditions on both loops, as inequalities that hold for every plant of the design.

    Defaults are the thesis's; gain margin and sensitivity, which it does not state, are 6 dB, what a phase margin of 29
    degrees implies.

    Attributes
    ----------
    phase_margin_deg : float
        Velocity loop, at every crossover (4.9).
    suppression_db : float
        A_sup, bound on the velocity loop's open-loop gain at and above the resonance and at every local peak (4.7).
    gain_margin_db : float
        Both loops.
    sensitivity_db : float
        Bound on max |1/(1 + L)| of both loops.
    position_phase_margin_deg : float
        Position loop (4.13).
    notch_db, butterworth_db : float
        A_Notch, A_bw, the prefilter's attenuation at the antiresonance (4.2), (4.4).
    velocity_filters_s : tuple of float
        T_R to try, s; a drive that bounds T_R gets the nearest it has.
    prefilters : tuple of PrefilterKind or None
        Kinds to try; None: all that the drive offers.

    Raises
    ------
    UsageError
        For a number outside its range.
    """

    phase_margin_deg: float = 60.0
    suppression_db: float = -10.0
    gain_margin_db: float = 6.0
    sensitivity_db: float = 6.0
    position_phase_margin_deg: float = 80.0
    notch_db: float = -6.0
    butterworth_db: float = -3.0
    velocity_filters_s: tuple[float, ...] = (0.002,)
    prefilters: tuple[PrefilterKind, ...] | None = None

    def __post_init__(self) -> None:
        ranges = {
            "phase_margin_deg": (0.0, 90.0),
            "suppression_db": (-60.0, 0.0),
            "gain_margin_db": (0.0, 40.0),
            "sensitivity_db": (0.0, 40.0),
            "position_phase_margin_deg": (0.0, 90.0),
            "notch_db": (-60.0, 0.0),
            "butterworth_db": (-60.0, 0.0),
        }
        for name, (low, high) in ranges.items():
            value = getattr(self, name)
            if not low < value < high:
                raise UsageError(f"{name} is {value}; it must lie between {low:g} and {high:g}")
        if not self.velocity_filters_s or not all(math.isfinite(t) and t >= 0.0 for t in self.velocity_filters_s):
            raise UsageError(f"velocity_filters_s is {self.velocity_filters_s}; give one or more times in s, not negative")


#: What is asked of the final loop.  45 and 70 degrees hold for every damping down to none (the thesis's published gains have 30 to 36
#: there); 60 and 80 would cost the stiffness K_I K_PP a factor of 17 on rig g_a, and with 3 % error of the feedforward both targets.
PRODUCT_SPECIFICATION = Specification(
    phase_margin_deg=45.0, position_phase_margin_deg=70.0, velocity_filters_s=(0.001, 0.002, 0.004, 0.008, 0.016, 0.032)
)


class Infeasible(Refused):
    """No cascade of the drive meets the request.

    Parameters
    ----------
    binding : tuple of str
        The conditions that stand in the way, in words.
    nearest : Specification or None
        The nearest request that is feasible, or None.
    """

    def __init__(self, message: str, binding: tuple[str, ...], nearest: Specification | None) -> None:
        super().__init__(message)
        self.binding = binding
        self.nearest = nearest


#: Groups of conditions that are relaxed together, with words for the refusal.
GROUPS = {
    "velocity": "the velocity loop's margins",
    "suppression": "the resonance suppression",
    "position": "the position loop's phase margin",
}

#: Phase margin of the velocity loop of a specification that is relaxed all the way.
HARDLY_DEG = 5.0


def relax(specification: Specification, groups: tuple[str, ...], share: float) -> Specification:
    """The specification with the named groups moved by ``share`` (0: as asked, 1: hardly any margin left).

    Margins and sensitivity of the velocity loop move together, because |1/(1 + L)| at a crossover is 1/(2 sin(margin/2)).

    Parameters
    ----------
    specification : Specification
        What was asked for.
    groups : tuple of str
        Of "velocity", "suppression" and "position".
    share : float
        0 to 1.

    Returns
    -------
    Specification
        Other groups as they were.
    """
    if "velocity" in groups:
        margin = _between(specification.phase_margin_deg, HARDLY_DEG, share)
        implied_db = -20.0 * math.log10(2.0 * math.sin(math.radians(0.5 * margin)))
        specification = replace(
            specification,
            phase_margin_deg=margin,
            sensitivity_db=max(specification.sensitivity_db, implied_db + 1.0),
            gain_margin_db=_between(specification.gain_margin_db, 1.0, share),
        )
    if "suppression" in groups:
        specification = replace(specification, suppression_db=-_between(-specification.suppression_db, 1.0, share))
    if "position" in groups:
        margin = _between(specification.position_phase_margin_deg, 20.0, share)
        specification = replace(specification, position_phase_margin_deg=margin)
    return specification


def relaxed_to(specification: Specification, phase_margin_deg: float) -> Specification:
    """The specification with the margins of both loops relaxed together until the velocity loop has this phase margin.

    Parameters
    ----------
    specification : Specification
        What was asked for; one that asks for no more stays as it is.
    phase_margin_deg : float, deg
        Of the velocity loop, above 5.

    Returns
    -------
    Specification
        The suppression as it was.
    """
    asked = specification.phase_margin_deg
    if asked <= phase_margin_deg:
        return specification
    return relax(specification, ("velocity", "position"), (asked - phase_margin_deg) / (asked - HARDLY_DEG))


def _between(asked: float, least: float, share: float) -> float:
    return asked + share * (min(asked, least) - asked)


def describe(specification: Specification) -> str:
    """The request in one line, for messages.

    Parameters
    ----------
    specification : Specification

    Returns
    -------
    str
        Margins, suppression and sensitivity with units.
    """
    return (
        f"phase margin {specification.phase_margin_deg:.1f} deg, suppression {specification.suppression_db:.1f} dB, "
        f"gain margin {specification.gain_margin_db:.1f} dB, sensitivity {specification.sensitivity_db:.1f} dB, "
        f"position phase margin {specification.position_phase_margin_deg:.1f} deg"
    )
