"""Torque that falls behind the current at large currents."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial


def _torque_path(torque: float, theta: float, t: float, loss: float, peak: float, exponent: float) -> float:
    """Acting torque:  torque (1 - loss |torque/peak|^exponent), N m.

    Parameters
    ----------
    loss : float
        Share lost at the torque ``peak``.
    """
    return torque * (1.0 - loss * math.pow(abs(torque / peak), exponent))


def _trials(ground: AxisSummary) -> list[Trial]:
    """One, measured at the largest torque recorded."""
    return [Trial({"loss": 0.1, "peak": ground.peak_nm}, signed=True)]


EFFECT = Effect(
    name="torque_saturation",
    slot="torque_path",
    title="saturation of the torque",
    parameters=(
        Parameter("loss", "1", "drive", 0.05, -0.3, 0.6, "share of the torque that is missing at the stated torque"),
        Parameter("peak", "N m", "drive", 3.0, 0.01, 1000.0, "torque at which the loss is stated: the largest recorded", fitted=False),
        Parameter("exponent", "1", "drive", 2.0, 0.5, 12.0, "how suddenly the loss sets in", fitted=False, form=True),
    ),
    law=_torque_path,
    trials=_trials,
    seen="large torques accelerate less than small ones",
    causes="saturation of the iron, field weakening, hot magnets",
    check="torque constant against current at standstill, at rated and at peak current",
    remedy="keep the torque below where it begins, let the motor cool, or take a larger one",
    alike={
        "load_friction": (
            "drive and brake at the same torque: a lost torque works against the torque both times, friction against the motion"
        ),
        "belt_slack": "hold the motor and pull the carriage with a spring balance: only a slack strand bends the way over the force",
    },
    source="data sheet of the motor",
)
