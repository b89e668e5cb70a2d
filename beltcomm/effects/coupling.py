"""Compliance between motor and driving pulley: coupling and shaft."""

from __future__ import annotations

from beltcomm.effects._effect import Body, Effect, Element, Parameter


def torque(twist: float, rate: float, x: float, stiffness: float, damping: float) -> float:
    """Torque in the coupling:  K twist + D rate, N m at the motor shaft.   twist : rad, motor angle minus pulley angle times
    gear ratio.   Source: data sheet; (2.7) without the assumption of a rigid coupling."""
    return stiffness * twist + damping * rate


def slope(x: float, stiffness: float, damping: float) -> tuple[float, float]:
    """(stiffness N m/rad, damping N m s/rad)."""
    return stiffness, damping


EFFECT = Effect(
    name="coupling",
    slot="body",
    title="compliance of the coupling",
    parameters=(
        Parameter("stiffness", "N m/rad", "motor", 200.0, 1.0, 1e6, "torsional stiffness of the coupling"),
        Parameter("damping", "N m s/rad", "motor", 1e-3, 0.0, 1.0, "torsional damping of the coupling"),
    ),
    bodies=(
        Body(
            "driving_pulley",
            Parameter("inertia", "kg m2", "motor", 2e-5, 1e-8, 1.0, "driving pulley at the motor shaft"),
            rotary=True,
        ),
    ),
    elements=(Element(("motor", "driving_pulley"), torque, slope, angular=True),),
    seen="a stiff belt looks softer than its data sheet; another mode at some hundred hertz",
    causes="elastomer or bellows of the coupling, a long shaft",
    check="clamping screws and elastomer of the coupling",
    remedy="tighten the clamping screws, replace a worn elastomer, or take a stiffer coupling",
    alike={
        "belt_stiffness": "excite near both ends of the travel: what a coupling adds to the compliance is the same everywhere",
        "end_pulley": "excite near both ends of the travel: the mode of a coupling stays where it is, that of the end pulley moves",
    },
    untried=(
        "not identifiable from these data as a diagnosis reads them, from the motor's angle to the torque: a light pulley behind a stiff "
        "coupling (200 to 5000 N m/rad, 1e-5 to 4e-5 kg m²) swings at 380 to 3600 Hz while the motor is held, near and above half of a "
        "sampling rate of 1 kHz, and the calculated torque grows out of all bounds"
    ),
    linear=True,
    source="thesis table A.3; data sheet",
)
