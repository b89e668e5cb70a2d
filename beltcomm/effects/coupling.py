"""Compliance between motor and driving pulley: coupling and shaft."""

from __future__ import annotations

from beltcomm.effects._effect import Body, Effect, Element, Parameter


def _torque(twist: float, rate: float, x: float, stiffness: float, damping: float) -> float:
    """Torque in the coupling:  K twist + D rate, N m at the motor shaft.

    Parameters
    ----------
    twist : float, rad
        Motor angle minus pulley angle times gear ratio.

    References
    ----------
    Data sheet; (2.7) without the assumption of a rigid coupling.
    """
    return stiffness * twist + damping * rate


def slope(x: float, stiffness: float, damping: float) -> tuple[float, float]:
    """(stiffness N m/rad, damping N m s/rad).

    Parameters
    ----------
    x : float, m
        Carriage on the axis; not used.
    stiffness : float, N m/rad
        K.
    damping : float, N m s/rad
        D.
    """
    return stiffness, damping


EFFECT = Effect(
    name="coupling",
    slot="body",
    title="compliance of the coupling",
    parameters=(
        Parameter("stiffness", "N m/rad", "motor", 200.0, 1e-3, 1e6, "torsional stiffness of the coupling"),
        Parameter("damping", "N m s/rad", "motor", 1e-3, 0.0, 1.0, "torsional damping of the coupling"),
    ),
    bodies=(
        Body(
            "driving_pulley",
            Parameter("inertia", "kg m2", "motor", 2e-5, 1e-8, 1.0, "driving pulley at the motor shaft"),
            rotary=True,
        ),
    ),
    elements=(Element(("motor", "driving_pulley"), _torque, slope, angular=True),),
    seen="a stiff belt looks softer than its data sheet; another mode at some hundred hertz",
    causes="elastomer or bellows of the coupling, a long shaft",
    check="clamping screws and elastomer of the coupling",
    remedy="tighten the clamping screws, replace a worn elastomer, or take a stiffer coupling",
    alike={
        "belt_stiffness": "excite near both ends of the travel: what a coupling adds to the compliance is the same everywhere",
        "end_pulley": "excite near both ends of the travel: the mode of a coupling stays where it is, that of the end pulley moves",
    },
    sought=(
        "where nothing else explains what is left far above the noise, alone or together with an end pulley: from a raster of what "
        "motor, pulley and belt may be, for no single effect leads there"
    ),
    linear=True,
    source="thesis table A.3; data sheet",
)
