"""An encoder disc off centre: the measured angle errs once per turn; twice where it is tilted, too."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial


def _correction(theta: float, sine: float, cosine: float) -> float:
    """True minus measured angle:  -(sine sin θ + cosine cos θ), rad.   θ : rad, measured, absolute."""
    return -(sine * math.sin(theta) + cosine * math.cos(theta))


def _slope(theta: float, sine: float, cosine: float) -> float:
    """d/dθ of the correction."""
    return -(sine * math.cos(theta) - cosine * math.sin(theta))


def _oval_correction(theta: float, sine: float, cosine: float) -> float:
    """Correction of the angle twice per turn:  -(sine sin 2θ + cosine cos 2θ), rad."""
    return -(sine * math.sin(2.0 * theta) + cosine * math.cos(2.0 * theta))


def _oval_slope(theta: float, sine: float, cosine: float) -> float:
    """d/dθ of it."""
    return -2.0 * (sine * math.cos(2.0 * theta) - cosine * math.sin(2.0 * theta))


def _trials(ground: AxisSummary) -> list[Trial]:
    """Sine and cosine as two columns."""
    return [Trial({"sine": 0.003, "cosine": 0.003}, amplitudes=("sine", "cosine"), signed=True)]


def _harmonic_effect(index: int) -> Effect:
    """``encoder_eccentricity``, and ``encoder_eccentricity_2`` for twice per turn."""
    oval = index == 2
    return Effect(
        name="encoder_eccentricity" + ("_2" if oval else ""),
        slot="sensor",
        title="encoder disc tilted" if oval else "encoder off centre",
        parameters=(
            Parameter("sine", "rad", "motor", 0.0, -0.1, 0.1, "error of the angle, part in phase with the angle"),
            Parameter("cosine", "rad", "motor", 0.0, -0.1, 0.1, "error of the angle, part in quadrature"),
        ),
        law=_oval_correction if oval else _correction,
        slope=_oval_slope if oval else _slope,
        trials=_trials,
        twins=("pulley_eccentricity",),
        separate="take the belt off and spin the motor: the encoder's part stays, that of the pulley goes",
        seen=f"torque {'twice' if oval else 'once'} per turn that grows with the square of speed",
        causes="encoder disc tilted on its shaft" if oval else "encoder disc off centre, coupling of the encoder",
        check="spin the motor without the belt; mounting of the encoder",
        remedy="mount the disc or the encoder's coupling anew, or use the correction table of the drive",
        alike={
            "cogging": "repeat at twice the speed: an error of the angle needs four times the torque, cogging the same",
        },
        source="data sheet of the encoder",
    )


EFFECTS = (_harmonic_effect(1), _harmonic_effect(2))
