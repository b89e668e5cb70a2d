"""A ramp with a rounded corner: what contacts and slack strands do."""

from __future__ import annotations

import math

from beltcomm.compiled import compiled


@compiled
def ramp(x: float, width: float) -> float:
    """0 below, x above, over a corner of ``width``:  width ln(1 + e^(x/width))."""
    if x > 30.0 * width:
        return x
    if x < -30.0 * width:
        return 0.0
    return width * math.log1p(math.exp(x / width))


@compiled
def ramp_slope(x: float, width: float) -> float:
    """Slope of :func:`ramp`:  1/(1 + e^(-x/width))."""
    if x > 30.0 * width:
        return 1.0
    if x < -30.0 * width:
        return 0.0
    return 1.0 / (1.0 + math.exp(-x / width))
