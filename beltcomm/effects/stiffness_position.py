"""Belt stiffness that follows the carriage: the free lengths of the two strands change."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from beltcomm.arrays import Array
from beltcomm.compiled import compiled
from beltcomm.effects._effect import BELT_DAMPING, BELT_STIFFNESS, DRIVING_END, AxisSummary, Effect, Element, Parameter, Trial

#: Free belt length at carriage position 0 as a share of the pulley distance, where no data sheet tells it.
_OFFSET_SHARES = (0.06, 0.15, 0.3)
#: m; places nearer to each other than this are one.   Share by which compliances of the strands differ at two places that tell something.
_APART_M, _APART = 0.1, 0.05
#: Shortest driven strand at ``middle`` that a search begins with, as a share of the pulley distance: at none the law has no slope.
_NEXT_TO_PULLEY = 0.05
#: Share of the compliance at ``middle`` below which no belt gets.
LEAST_COMPLIANCE = 0.05
_STIFFNESS = "belt_stiffness.stiffness"


@compiled
def _change(x: float, share: float, offset: float, pulley_distance: float, middle: float) -> float:
    """Change of the stiffness as a share of that at ``middle``:  1/(1 - share + share h(x)/h(middle)) - 1,   h = l1 (2 l3 - l1).

    h is the compliance of the two strands side by side, l1 = offset + x; clamps and teeth are as soft everywhere, in series.  Together
    every parabola that bends down:  with them, offset is no length to be measured any more.

    Parameters
    ----------
    x, middle, offset, pulley_distance : float, m
    share : float
        Of the compliance at ``middle`` that follows the carriage; 1 when nothing but the belt gives way.

    References
    ----------
    (2.10), (2.26).
    """
    here, there = offset + x, offset + middle
    soft = here * (2.0 * pulley_distance - here) / (there * (2.0 * pulley_distance - there))
    return 1.0 / max(1.0 - share + share * soft, LEAST_COMPLIANCE) - 1.0


def _force(
    stretch: float,
    rate: float,
    x: float,
    share: float,
    offset: float,
    pulley_distance: float,
    middle: float,
    stiffness: float,
    damping: float,
) -> float:
    """Force that the belt pulls more than at ``middle``:  change(x) (stiffness stretch + damping rate), N.

    A strand half as long is twice as stiff and damps twice as much.

    Parameters
    ----------
    stiffness, damping : float, N/m
        N s/m at ``middle``.
    """
    return _change(x, share, offset, pulley_distance, middle) * (stiffness * stretch + damping * rate)


def _slope(
    x: float, share: float, offset: float, pulley_distance: float, middle: float, stiffness: float, damping: float
) -> tuple[float, float]:
    """(stiffness N/m, damping N s/m)."""
    more = _change(x, share, offset, pulley_distance, middle)
    return stiffness * more, damping * more


def _trials(ground: AxisSummary) -> list[Trial]:
    """Trials from the stiffness at each place; with the geometry of the data sheet where there is one, else three free lengths."""
    middle = 0.5 * (ground.low_m + ground.high_m)
    distance = ground.pulley_distance_m or 1.2 * (ground.high_m - min(ground.low_m, 0.0)) + 0.1
    offsets = [ground.offset_m] if ground.offset_m > 0.0 else []
    offsets += [share * distance for share in _OFFSET_SHARES]
    geometry = {"pulley_distance": distance, "middle": middle}
    offsets = [max(offset, 0.02 - ground.low_m) for offset in offsets]
    plain = [Trial({"share": 0.6, "offset": offset, **geometry}, signed=True) for offset in offsets]
    return [*_compliance_trials(ground, geometry, offsets[0]), *plain]


def _compliance_trials(ground: AxisSummary, geometry: Mapping[str, float], offset: float) -> list[Trial]:
    """The law through the compliance seen at three places or more, or with the strands of ``offset``, m, through that seen at two."""
    if not ground.stiffness_at:
        return []
    place, amplitude, seen = np.array(ground.stiffness_at).T
    middle, distance = geometry["middle"], geometry["pulley_distance"]
    places = 1 + np.count_nonzero(np.diff(np.sort(place)) >= _APART_M)
    if places < 2:
        return []
    if places == 2:
        found = _of_strands(offset + place, offset + middle, distance, 1.0 / seen, amplitude)
    else:
        found = _of_parabola(place - middle, distance, 1.0 / seen, amplitude)
    if found is None:
        return []
    share, length, whole = found
    values = {"share": float(share), "offset": float(length - middle), **geometry}
    return [Trial(values, signed=True, base={_STIFFNESS: float(1.0 / whole)})]


def _of_strands(lengths: Array, length: float, distance: float, compliance: Array, weights: Array) -> tuple[float, float, float] | None:
    """Share, l1 at ``middle`` (m) and compliance there (m/N) of strands whose l1, m, is known; None where they say nothing."""
    soft = lengths * (2.0 * distance - lengths) / (length * (2.0 * distance - length))
    if np.ptp(soft) < _APART:
        return None
    rise, whole = np.polyfit(soft - 1.0, compliance, 1, w=weights)
    return (rise / whole, length, whole) if whole > 0.0 else None


def _of_parabola(places: Array, distance: float, compliance: Array, weights: Array) -> tuple[float, float, float] | None:
    """Geometry of the parabola through places, m from ``middle``; where no two strands bend like it, of the nearest that rise alike."""
    curve, rise, whole = np.polyfit(places, compliance, 2, w=weights)
    if not whole > 0.0:
        return None
    length = distance + 0.5 * rise / curve if curve < 0.0 else -math.inf
    if _NEXT_TO_PULLEY * distance < length < (2.0 - _NEXT_TO_PULLEY) * distance:
        return -curve / whole * length * (2.0 * distance - length), length, whole
    length = (_NEXT_TO_PULLEY if rise > 0.0 else 2.0 - _NEXT_TO_PULLEY) * distance
    return 0.5 * rise / whole * length * (2.0 * distance - length) / (distance - length), length, whole


EFFECT = Effect(
    name="stiffness_position",
    slot="element",
    of_belt=True,
    title="belt stiffness by position",
    parameters=(
        Parameter(
            "share", "1", "belt", 1.0, -1.0, 3.0, "share of the compliance that follows the carriage: 1 when only the belt gives way"
        ),
        Parameter("offset", "m", "belt", 0.1, -10.0, 10.0, "free belt length l1 at carriage position 0"),
        Parameter("pulley_distance", "m", "belt", 1.0, 0.05, 50.0, "distance l3 between the pulley centres", fitted=False),
        Parameter("middle", "m", "cart", 0.3, -50.0, 50.0, "place where belt_stiffness is meant", fitted=False),
    ),
    elements=(Element((DRIVING_END, "cart"), _force, _slope),),
    uses=(BELT_STIFFNESS, BELT_DAMPING),
    trials=_trials,
    seen="antiresonance and resonance move with the carriage position",
    causes="free belt lengths change with the place: every belt axis has it more or less",
    check="belt path, position of the clamp; nothing to repair",
    remedy="nothing to repair: the design must hold at both ends of the travel",
    alike={
        "belt_slack": "excite at one place at two amplitudes: the place does not matter then, a slack strand does",
        "backlash": "excite at one place at two amplitudes: a gap shows at the small one, the place at neither",
    },
    source="(2.26)",
)
