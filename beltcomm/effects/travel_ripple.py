"""Force that repeats along the travel: turns of a screw, balls of a nut, magnets of a linear motor, teeth of a rack."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, ManualCheck, Parameter, Trial
from beltcomm.effects._records import AGAIN

#: m; the shortest period tried.
SHORTEST_M = 1e-3
#: Periods in the travel: the fewest tried, and the step, fine enough not to step over a line.
FEWEST, STEP = 4.0, 0.7


def _force(position: float, speed: float, t: float, period: float, sine: float, cosine: float) -> float:
    """Force on the carriage:  -(sine sin(2 π x/period) + cosine cos(2 π x/period)), N.   x : m, absolute carriage position."""
    phase = 2.0 * math.pi * position / period
    return -(sine * math.sin(phase) + cosine * math.cos(phase))


def _slope(position: float, speed: float, t: float, period: float, sine: float, cosine: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed)."""
    rate = 2.0 * math.pi / period
    return -rate * (sine * math.cos(rate * position) - cosine * math.sin(rate * position)), 0.0


def _trials(ground: AxisSummary) -> list[Trial]:
    """Periods from a quarter of the travel down to a millimetre; only where no motor angle is known, whose orders are tried else."""
    span = ground.high_m - ground.low_m
    if ground.side != "load" or span <= FEWEST * SHORTEST_M:
        return []
    size = {"sine": 1.0, "cosine": 1.0}
    counts = range(math.floor((span / SHORTEST_M - FEWEST) / STEP) + 1)
    return [Trial({"period": span / (FEWEST + STEP * k), **size}, amplitudes=("sine", "cosine"), signed=True) for k in counts]


EFFECT = Effect(
    name="travel_ripple",
    slot="force",
    title="ripple along the travel",
    parameters=(
        Parameter("period", "m", "cart", 1e-2, 1e-4, 1.0, "distance after which it repeats"),
        Parameter("sine", "N", "cart", 0.0, -1000.0, 1000.0, "amplitude of the sine"),
        Parameter("cosine", "N", "cart", 0.0, -1000.0, 1000.0, "amplitude of the cosine"),
    ),
    law=_force,
    slope=_slope,
    body="cart",
    trials=_trials,
    twins=("cogging", "tooth_ripple"),
    separate="compare the period with the lead of the screw, the pitch of the magnets, the teeth of the rack",
    apart={
        name: DiscriminatingExperiment(
            "nothing that moves by the motor: without slip place and angle are one",
            hands=(
                ManualCheck(
                    "slacken the belt and let it skip a tooth at the driving pulley, or turn the screw in its coupling",
                    AGAIN,
                    "what keeps its place on the rail is a travel_ripple, what keeps its angle of the motor the other",
                ),
            ),
        )
        for name in ("cogging", "tooth_ripple")
    },
    seen="slow strokes ripple with the position, by the same force in both directions",
    causes="run-out of a screw, balls entering the nut, magnets of a linear motor, teeth",
    check="lead of the screw or pitch of the magnets against the period",
    remedy="replace a bent screw or a worn nut; what repeats exactly is sent along",
    source="data sheet of the screw or motor",
)
