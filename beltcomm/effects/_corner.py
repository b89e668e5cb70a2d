"""A ramp with a rounded corner: what contacts and slack strands do."""

from __future__ import annotations

from beltcomm.compiled import compiled

#: Half the way over which the corner turns, in units of its width:  16 ln(2)/3, so that the ramp stands at width ln 2 in the middle.
REACH = 3.6967848


@compiled
def ramp(x: float, width: float) -> float:
    """0 below, x above, and between -w and w a corner with continuous curvature:  w (1 + u)³ (3 - u)/16,  u = x/w,  w = REACH width.

    Parameters
    ----------
    x : float
        Of any unit.
    width : float
        In that unit.
    """
    half = REACH * width
    if x >= half:
        return x
    if x <= -half:
        return 0.0
    u = x / half
    v = 1.0 + u  # a power takes three times as long to compile
    return half * (v * v * v) * (3.0 - u) / 16.0


@compiled
def ramp_slope(x: float, width: float) -> float:
    """Slope of :func:`ramp`:  (1 + u)² (2 - u)/4.

    Parameters
    ----------
    x : float
        Of any unit.
    width : float
        In that unit.
    """
    half = REACH * width
    if x >= half:
        return 1.0
    if x <= -half:
        return 0.0
    u = x / half
    return (1.0 + u) * (1.0 + u) * (2.0 - u) / 4.0
