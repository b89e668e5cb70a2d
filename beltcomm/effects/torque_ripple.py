"""Gain of the torque that varies with the motor angle."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: Orders tried, per turn of the motor.
HIGHEST_ORDER = 60


def _torque_path(torque: float, theta: float, t: float, order: float, sine: float, cosine: float) -> float:
    """Acting torque:  torque (1 + sine sin(order θ) + cosine cos(order θ)), N m.   θ : rad, absolute motor angle."""
    return torque * (1.0 + sine * math.sin(order * theta) + cosine * math.cos(order * theta))


def _trials(ground: AxisSummary) -> list[Trial]:
    """Every order, sine and cosine as two columns."""
    size = {"sine": 0.05, "cosine": 0.05}
    return [Trial({"order": float(n), **size}, amplitudes=("sine", "cosine"), signed=True) for n in range(1, HIGHEST_ORDER + 1)]


EFFECT = Effect(
    name="torque_ripple",
    slot="torque_path",
    title="torque ripple",
    parameters=(
        Parameter("order", "1", "drive", 6.0, 1.0, 1000.0, "periods per turn of the motor", fitted=False),
        Parameter("sine", "1", "drive", 0.0, -0.5, 0.5, "amplitude of the sine, as a share of the torque"),
        Parameter("cosine", "1", "drive", 0.0, -0.5, 0.5, "amplitude of the cosine, as a share of the torque"),
    ),
    law=_torque_path,
    trials=_trials,
    harmonic="gain",
    seen="ripple with the motor angle that grows with torque",
    causes="gain of one current sensor, commutation angle",
    check="calibration of the current sensors, commutation offset",
    remedy="let the drive calibrate its current sensors and find its commutation offset anew",
    alike={
        "cogging": "repeat the slow strokes with a force on the carriage: torque ripple grows with the torque, cogging does not",
    },
    source="data sheet of the drive",
)
