"""A driving pulley that runs out: its lever arm changes once per turn; twice where it is oval, too."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, DiscriminatingExperiment, Effect, Parameter, Trial
from beltcomm.effects._records import belt_off, moves, sweep


def _travel(theta: float, sine: float, cosine: float) -> float:
    """Angle by which the belt runs ahead:  sine sin θ + cosine cos θ, rad, so that u = i_t (θ + this).   θ : rad, absolute.

    With a gearbox the pulley turns slower than the motor: only ratio 1 is described.

    Parameters
    ----------
    sine, cosine : float
        Run-out over radius.
    """
    return sine * math.sin(theta) + cosine * math.cos(theta)


def _slope(theta: float, sine: float, cosine: float) -> float:
    """d/dθ; the lever arm is i_t (1 + this)."""
    return sine * math.cos(theta) - cosine * math.sin(theta)


def _oval_travel(theta: float, sine: float, cosine: float) -> float:
    """Travel error twice per turn:  sine sin 2θ + cosine cos 2θ, rad."""
    return sine * math.sin(2.0 * theta) + cosine * math.cos(2.0 * theta)


def _oval_slope(theta: float, sine: float, cosine: float) -> float:
    """d/dθ."""
    return 2.0 * (sine * math.cos(2.0 * theta) - cosine * math.sin(2.0 * theta))


def _trials(ground: AxisSummary) -> list[Trial]:
    """Sine and cosine as two columns; none behind a gearbox, where the pulley does not turn with the motor."""
    if ground.gear != 1.0:
        return []
    return [Trial({"sine": 0.01, "cosine": 0.01}, amplitudes=("sine", "cosine"), signed=True)]


def _harmonic_effect(index: int) -> Effect:
    """``pulley_eccentricity``, and ``pulley_eccentricity_2`` for twice per turn."""
    oval = index == 2
    return Effect(
        name="pulley_eccentricity" + ("_2" if oval else ""),
        slot="kinematics",
        of_belt=True,
        title="oval driving pulley" if oval else "run-out of the driving pulley",
        parameters=(
            Parameter("sine", "1", "belt", 0.0, -0.2, 0.2, "run-out over radius, part in phase with the angle"),
            Parameter("cosine", "1", "belt", 0.0, -0.2, 0.2, "run-out over radius, part in quadrature"),
        ),
        law=_oval_travel if oval else _travel,
        slope=_oval_slope if oval else _slope,
        trials=_trials,
        twins=("encoder_eccentricity",),
        separate="take the belt off and spin the motor: the encoder's part stays, that of the pulley goes; or turn the pulley by 180°",
        apart={
            "encoder_eccentricity": DiscriminatingExperiment(
                "torque over speed and acceleration: an error of the angle asks for torque with the square of speed, run-out with the load",
                (*sweep(0.05, 0.3, 0.8), *moves()),
                (belt_off("the encoder's", "the pulley's"),),
            ),
        },
        seen=f"torque varies {'twice' if oval else 'once'} per turn, more with load and acceleration",
        causes="pulley out of round, clamped askew" if oval else "pulley run-out, bent shaft",
        check="dial gauge on the pulley",
        remedy="true or replace the pulley, clamp it straight, straighten the shaft",
        alike={
            "cogging": "repeat with more acceleration: run-out grows with the load, cogging does not",
            "holding_brake": "turn slowly forward and backward: drag turns its sign with the direction, run-out does not",
        },
        source="data sheet of the pulley",
    )


EFFECTS = (_harmonic_effect(1), _harmonic_effect(2))
