"""An encoder disc off centre: the measured angle errs once per turn."""

from __future__ import annotations

import math

from beltcomm.effects._effect import Effect, Ground, Parameter, Trial


def correction(theta: float, sine: float, cosine: float) -> float:
    """True minus measured angle:  -(sine sin θ + cosine cos θ), rad.   θ : rad, measured, absolute."""
    return -(sine * math.sin(theta) + cosine * math.cos(theta))


def slope(theta: float, sine: float, cosine: float) -> float:
    """d/dθ of the correction."""
    return -(sine * math.cos(theta) - cosine * math.sin(theta))


def trials(ground: Ground) -> list[Trial]:
    """Sine and cosine as two columns."""
    return [Trial({"sine": 0.003, "cosine": 0.003}, amplitudes=("sine", "cosine"), signed=True)]


EFFECT = Effect(
    name="encoder_eccentricity",
    slot="sensor",
    title="encoder off centre",
    parameters=(
        Parameter("sine", "rad", "motor", 0.0, -0.1, 0.1, "error of the angle, part in phase with the angle"),
        Parameter("cosine", "rad", "motor", 0.0, -0.1, 0.1, "error of the angle, part in quadrature"),
    ),
    law=correction,
    slope=slope,
    trials=trials,
    twins=("pulley_eccentricity",),
    separate="take the belt off and spin the motor: the encoder's part stays, that of the pulley goes",
    seen="torque once per turn that grows with the square of speed",
    causes="encoder disc off centre, coupling of the encoder",
    check="spin the motor without the belt; mounting of the encoder",
    source="data sheet of the encoder",
)
