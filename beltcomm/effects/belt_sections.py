"""The belt as three sections by its geometry, with the end pulley as a third mass between them."""

from __future__ import annotations

from beltcomm.effects._effect import BELT_SPRING, DRIVING_END, Body, Effect, Element, Parameter
from beltcomm.effects.belt_spans import BELT_PARAMETERS


def _front(stretch: float, rate: float, x: float, ea: float, l3: float, offset: float, da: float) -> float:
    """Section 1, driving end to carriage:  (EA stretch + DA rate)/l1, N, with l1 = offset + x.   Source: (2.10), (2.14)."""
    return (ea * stretch + da * rate) / (offset + x)


def _return_section(stretch: float, rate: float, x: float, ea: float, l3: float, offset: float, da: float) -> float:
    """Section 2, end pulley to carriage:  (EA stretch + DA rate)/l2, N, with l2 = l3 - l1.   Source: (2.10), (2.14)."""
    return (ea * stretch + da * rate) / (l3 - offset - x)


def _span(stretch: float, rate: float, x: float, ea: float, l3: float, offset: float, da: float) -> float:
    """Section 3, driving end to end pulley:  (EA stretch + DA rate)/l3, N.   Source: (2.10), (2.12)."""
    return (ea * stretch + da * rate) / l3


def _front_slope(x: float, ea: float, l3: float, offset: float, da: float) -> tuple[float, float]:
    """(stiffness c1, damping d1)."""
    return ea / (offset + x), da / (offset + x)


def _return_section_slope(x: float, ea: float, l3: float, offset: float, da: float) -> tuple[float, float]:
    """(stiffness c2, damping d2)."""
    return ea / (l3 - offset - x), da / (l3 - offset - x)


def _span_slope(x: float, ea: float, l3: float, offset: float, da: float) -> tuple[float, float]:
    """(stiffness c3, damping d3)."""
    return ea / l3, da / l3


EFFECT = Effect(
    name="belt_sections",
    slot="body",
    of_belt=True,
    title="three belt sections and the end pulley",
    parameters=(
        *BELT_PARAMETERS,
        Parameter("specific_damping", "N s", "belt", 8.0, 0.0, 1000.0, "damping of a belt section times its length"),
    ),
    bodies=(Body("end_pulley", Parameter("mass", "kg", "belt", 0.2, 1e-3, 100.0, "inertia of the end pulley over r²")),),
    elements=(
        Element((DRIVING_END, "cart"), _front, _front_slope),
        Element(("end_pulley", "cart"), _return_section, _return_section_slope),
        Element((DRIVING_END, "end_pulley"), _span, _span_slope),
    ),
    group=BELT_SPRING,
    seen="a second resonance above the first one, the same at all amplitudes",
    causes="inertia of the idler and the returning span",
    check="mass and bearing of the idler",
    remedy="none needed; a lighter end pulley moves the second resonance up",
    alike={
        "end_pulley": "the same physics without lengths: only the lengths of the data sheet, or records at three places, prefer this one",
        "coupling": "excite near both ends of the travel: the mode of the end pulley moves with the carriage, that of a coupling stays",
    },
    source="(2.11)-(2.20)",
)
