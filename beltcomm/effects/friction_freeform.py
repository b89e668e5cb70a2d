"""Friction over speed without a law: what any law of friction over speed could explain at most.  A bound, not a cause."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: Speeds at which the friction is free, as shares of the fastest; straight between, constant beyond.
KNOTS = (0.0, 0.04, 0.12, 0.35, 1.0)


def _level(
    speed: float, position: float, t: float, fastest: float,
    f1: float, f2: float, f3: float, f4: float, f5: float, b1: float, b2: float, b3: float, b4: float, b5: float,
) -> float:  # fmt: skip
    """Additional level of friction, N m: straight lines between f1..f5 at the knots forward, b1..b5 backward.

    Parameters
    ----------
    fastest : float, rad/s
    """
    share = abs(speed) / fastest
    if speed >= 0.0:
        c1, c2, c3, c4, c5 = f1, f2, f3, f4, f5
    else:
        c1, c2, c3, c4, c5 = b1, b2, b3, b4, b5
    if share < 0.04:
        return c1 + (c2 - c1) * share / 0.04
    if share < 0.12:
        return c2 + (c3 - c2) * (share - 0.04) / 0.08
    if share < 0.35:
        return c3 + (c4 - c3) * (share - 0.12) / 0.23
    if share < 1.0:
        return c4 + (c5 - c4) * (share - 0.35) / 0.65
    return c5


def _slope(
    speed: float, position: float, t: float, fastest: float,
    f1: float, f2: float, f3: float, f4: float, f5: float, b1: float, b2: float, b3: float, b4: float, b5: float,
) -> float:  # fmt: skip
    """d level/d speed."""
    values = (f1, f2, f3, f4, f5) if speed >= 0.0 else (b1, b2, b3, b4, b5)
    share, side = abs(speed) / fastest, 1.0 if speed >= 0.0 else -1.0
    for k in range(len(KNOTS) - 1):
        if share < KNOTS[k + 1]:
            return side * (values[k + 1] - values[k]) / (KNOTS[k + 1] - KNOTS[k]) / fastest
    return 0.0


_NAMES = tuple(f"{way}_{k}" for way in ("forward", "backward") for k in range(1, len(KNOTS) + 1))


def _trials(ground: AxisSummary) -> list[Trial]:
    """All levels at once, each an amplitude of its own."""
    return [Trial({"fastest": ground.fastest, **dict.fromkeys(_NAMES, 0.2 * ground.coulomb)}, amplitudes=_NAMES, signed=True)]


EFFECT = Effect(
    name="friction_freeform",
    slot="friction_level",
    title="friction over speed, free in both directions",
    parameters=(
        Parameter("fastest", "rad/s", "motor", 40.0, 1e-3, 1e5, "speed of the last knot: the fastest recorded", fitted=False),
        *(Parameter(name, "N m", "motor", 0.0, -5.0, 5.0, f"friction above the model's at knot {name[-1]}") for name in _NAMES),
    ),
    law=_level,
    slope=_slope,
    body="motor",
    trials=_trials,
    bound=True,
    seen="how far any law of friction over speed and direction could lower the error",
    causes="none: it is a bound for the named laws of friction",
    check="which named law comes near it",
    remedy="none: it names no cause; look for the named law that comes near it",
    source="(2.21) with a term of its own; effects-and-diagnosis sheet, section 12",
)
