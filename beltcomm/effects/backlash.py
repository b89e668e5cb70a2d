"""A gap between motor and carriage in which nothing is transmitted."""

from __future__ import annotations

from beltcomm.effects._effect import Effect, Ground, Parameter, Trial


def stretch_law(stretch: float, gap: float) -> float:
    """Stretch that loads the belt, m:  0 within ±gap/2, stretch ∓ gap/2 beyond.   gap : m at the belt."""
    half = 0.5 * gap
    if stretch > half:
        return stretch - half
    if stretch < -half:
        return stretch + half
    return 0.0


def slope(stretch: float, gap: float) -> float:
    """1 in contact, 0 in the gap."""
    return 1.0 if abs(stretch) > 0.5 * gap else 0.0


def trials(ground: Ground) -> list[Trial]:
    """Three gaps."""
    return [Trial({"gap": gap}) for gap in (1.5e-5, 5e-5, 1.2e-4)]


EFFECT = Effect(
    name="backlash",
    slot="belt_law",
    title="backlash",
    parameters=(Parameter("gap", "m", "belt", 3e-5, 0.0, 5e-3, "whole width of the gap, at the belt"),),
    law=stretch_law,
    slope=slope,
    trials=trials,
    seen="the belt looks softer at small amplitudes; a jump in position at reversals; rattling",
    causes="loose key, worn teeth, loose clamp",
    check="hold the motor and move the carriage by hand against a dial gauge",
    source="data sheet",
)
