"""A holding brake that does not release fully: its disc rubs once per turn."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, ManualCheck, Parameter, Trial
from beltcomm.effects._records import AGAIN, sweep


def _level(speed: float, position: float, t: float, sine: float, cosine: float, ratio: float) -> float:
    """Level of friction of a disc that runs out:  hypot(sine, cosine) + sine sin θ + cosine cos θ, N m,   θ = position/ratio, rad.

    It touches from not at all to twice its mean; the mean is part of the Coulomb level for whoever looks at it from outside.
    """
    angle = position / ratio
    return math.sqrt(sine * sine + cosine * cosine) + sine * math.sin(angle) + cosine * math.cos(angle)


def _slope(speed: float, position: float, t: float, sine: float, cosine: float, ratio: float) -> float:
    """d level/d speed: none."""
    return 0.0


def _trials(ground: AxisSummary) -> list[Trial]:
    """Sine and cosine as two columns; not where no motor angle is known."""
    if ground.side == "load":
        return []
    size = 0.2 * ground.coulomb
    return [Trial({"sine": size, "cosine": size}, amplitudes=("sine", "cosine"), signed=True)]


EFFECT = Effect(
    name="holding_brake",
    slot="friction_level",
    title="drag of the holding brake",
    parameters=(
        Parameter("sine", "N m", "motor", 0.0, -5.0, 5.0, "part of the drag that follows the sine of the motor angle"),
        Parameter("cosine", "N m", "motor", 0.0, -5.0, 5.0, "part of the drag that follows the cosine"),
    ),
    law=_level,
    slope=_slope,
    body="motor",
    uses=("transmission.ratio",),
    trials=_trials,
    twins=("pulley_eccentricity", "encoder_eccentricity"),
    separate="turn slowly forward and backward: drag turns its sign with the direction, run-out does not; or lift the brake by hand",
    apart={
        name: DiscriminatingExperiment(
            "slow turns both ways: drag changes its sign with the direction, run-out does not",
            sweep(0.01, 0.03, 0.1),
            (ManualCheck("lift the brake by hand", AGAIN, "what is gone was the brake's drag"),),
        )
        for name in ("pulley_eccentricity", "encoder_eccentricity")
    },
    seen="friction varies once per turn of the motor, with the direction of motion; the brake gets warm",
    causes="brake voltage too low, worn release spring, air gap out of adjustment, disc that runs out",
    check="voltage at the brake while released, air gap, temperature of the brake after ten minutes",
    remedy="restore the brake's voltage, adjust its air gap, replace the spring or the brake",
    alike={
        "coulomb": "slow strokes over several turns: friction of bearings is even, a brake rubs once per turn",
    },
    source="data sheet of the brake",
)
