"""Belt stiffness that follows the carriage: the free lengths of the two strands change."""

from __future__ import annotations

from beltcomm.compiled import compiled
from beltcomm.effects._effect import BELT_STIFFNESS, DRIVING_END, Effect, Element, Ground, Parameter, Trial

#: Free belt length at carriage position 0 as a share of the pulley distance, where no data sheet tells it.
_OFFSET_SHARES = (0.06, 0.15, 0.3)


@compiled
def change(x: float, share: float, offset: float, pulley_distance: float, middle: float) -> float:
    """Change of the stiffness as a share of that at ``middle``:  share (g(x)/g(middle) - 1),   g = 1/l1 + 1/(2 l3 - l1), l1 = offset + x.

    x, middle, offset, pulley_distance : m.   share : 1 when nothing but the belt gives way; compliance of clamps makes it less.
    Source: (2.10), (2.26).
    """
    here, there = offset + x, offset + middle
    g = 1.0 / here + 1.0 / (2.0 * pulley_distance - here)
    return share * (g / (1.0 / there + 1.0 / (2.0 * pulley_distance - there)) - 1.0)


def force(
    stretch: float, rate: float, x: float, share: float, offset: float, pulley_distance: float, middle: float, stiffness: float
) -> float:
    """What the belt pulls more than at ``middle``:  stiffness change(x) stretch, N.   stiffness : N/m at ``middle``."""
    return stiffness * change(x, share, offset, pulley_distance, middle) * stretch


def slope(x: float, share: float, offset: float, pulley_distance: float, middle: float, stiffness: float) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    return stiffness * change(x, share, offset, pulley_distance, middle), 0.0


def trials(ground: Ground) -> list[Trial]:
    """With the geometry of the data sheet where there is one, else three free lengths."""
    middle = 0.5 * (ground.low_m + ground.high_m)
    distance = ground.pulley_distance_m or 1.2 * (ground.high_m - min(ground.low_m, 0.0)) + 0.1
    offsets = [ground.offset_m] if ground.offset_m > 0.0 else []
    offsets += [share * distance for share in _OFFSET_SHARES]
    return [
        Trial({"share": 0.6, "offset": max(offset, 0.02 - ground.low_m), "pulley_distance": distance, "middle": middle}, signed=True)
        for offset in offsets
    ]


EFFECT = Effect(
    name="stiffness_position",
    slot="element",
    title="belt stiffness by position",
    parameters=(
        Parameter("share", "1", "belt", 1.0, -1.0, 2.0, "share of (2.26) that is seen: 1 when only the belt gives way"),
        Parameter("offset", "m", "belt", 0.1, 0.005, 10.0, "free belt length l1 at carriage position 0"),
        Parameter("pulley_distance", "m", "belt", 1.0, 0.05, 50.0, "distance l3 between the pulley centres", fitted=False),
        Parameter("middle", "m", "cart", 0.3, -50.0, 50.0, "place where belt_stiffness is meant", fitted=False),
    ),
    elements=(Element((DRIVING_END, "cart"), force, slope),),
    uses=(BELT_STIFFNESS,),
    trials=trials,
    seen="antiresonance and resonance move with the carriage position",
    causes="free belt lengths change with the place: every belt axis has it more or less",
    check="belt path, position of the clamp; nothing to repair",
    source="(2.26)",
)
