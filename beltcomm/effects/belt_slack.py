"""A belt that loses one strand at large force: pretension too low."""

from __future__ import annotations

from beltcomm.effects._effect import Effect, Ground, Parameter, Trial


def stretch_law(stretch: float, limit: float, share: float) -> float:
    """Stretch that loads the belt, m:  beyond ±limit only ``share`` of what is added counts.   limit : m.   share : of the stiffness."""
    if stretch > limit:
        return limit + share * (stretch - limit)
    if stretch < -limit:
        return -limit + share * (stretch + limit)
    return stretch


def slope(stretch: float, limit: float, share: float) -> float:
    """1 with both strands tight, ``share`` with one."""
    return 1.0 if abs(stretch) <= limit else share


def trials(ground: Ground) -> list[Trial]:
    """Four limits between a quarter and four fifths of the largest stretch recorded."""
    largest = ground.peak_force_n / ground.stiffness
    return [Trial({"limit": part * largest, "share": 0.6}) for part in (0.25, 0.4, 0.6, 0.8)]


EFFECT = Effect(
    name="belt_slack",
    slot="belt_law",
    title="slack strand at large force",
    parameters=(
        Parameter("limit", "m", "belt", 2e-4, 1e-6, 1e-2, "stretch at which one strand goes slack"),
        Parameter("share", "1", "belt", 0.6, 0.05, 1.0, "share of the stiffness that is left"),
    ),
    law=stretch_law,
    slope=slope,
    trials=trials,
    seen="the belt looks softer at large amplitudes and in fast moves",
    causes="pretension too low",
    check="tension meter, or frequency of the plucked strand",
    source="data sheet of the belt",
)
