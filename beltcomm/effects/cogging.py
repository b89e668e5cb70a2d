"""Torque that repeats with the motor angle: cogging.  One order each; ``cogging_2`` and so on take further orders."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: Orders tried, per turn of the motor; a model may hold this many orders at once.
HIGHEST_ORDER, COUNT = 100, 12


def force(position: float, speed: float, t: float, order: float, sine: float, cosine: float) -> float:
    """Torque on the motor:  -(sine sin(order θ) + cosine cos(order θ)), N m.

    Parameters
    ----------
    position : float, rad
        θ, absolute motor angle.
    speed : float, rad/s
        Not used.
    t : float, s
        Not used.
    order : float
        Periods per turn of the motor.
    sine, cosine : float, N m
        Amplitudes.
    """
    return -(sine * math.sin(order * position) + cosine * math.cos(order * position))


def slope(position: float, speed: float, t: float, order: float, sine: float, cosine: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed).

    Parameters
    ----------
    position : float, rad
        θ, absolute motor angle.
    speed : float, rad/s
        Not used.
    t : float, s
        Not used.
    order : float
        Periods per turn of the motor.
    sine, cosine : float, N m
        Amplitudes.

    Returns
    -------
    tuple of float, N m/rad, N m s/rad
        Motor shaft.
    """
    return -order * (sine * math.cos(order * position) - cosine * math.sin(order * position)), 0.0


def _trials(ground: AxisSummary) -> list[Trial]:
    """Every order but that of the pulley's teeth, sine and cosine as two columns."""
    size = {"sine": 0.02, "cosine": 0.02}
    orders = [n for n in range(2, HIGHEST_ORDER + 1) if n != ground.teeth]
    return [Trial({"order": float(n), **size}, amplitudes=("sine", "cosine"), signed=True) for n in orders]


def _harmonic_effect(index: int) -> Effect:
    """``cogging``, ``cogging_2``, ...: the same law for one more order."""
    return Effect(
        name="cogging" if index == 1 else f"cogging_{index}",
        slot="force",
        title="cogging of the motor" + (f", order {index}" if index > 1 else ""),
        parameters=(
            Parameter("order", "1", "motor", 12.0, 1.0, 1000.0, "periods per turn of the motor", fitted=False),
            Parameter("sine", "N m", "motor", 0.0, -5.0, 5.0, "amplitude of the sine"),
            Parameter("cosine", "N m", "motor", 0.0, -5.0, 5.0, "amplitude of the cosine"),
        ),
        law=force,
        slope=slope,
        body="motor",
        trials=_trials,
        harmonic="load",
        twins=("tooth_ripple",),
        separate="take the belt off and turn the motor slowly: cogging stays, the ripple of the teeth goes",
        seen="slow strokes ripple with the motor angle, by the same torque at any load",
        causes="slots and poles of the motor",
        check="number of poles and slots in the motor's data sheet; compare with the order",
        remedy="none at the motor; the ripple is sent along, a motor with skewed slots has less of it",
        alike={
            "torque_ripple": "repeat the slow strokes with a force on the carriage: torque ripple grows with the torque, cogging does not",
            "encoder_eccentricity": "repeat at twice the speed: cogging stays as large, an error of the angle needs four times the torque",
        },
        source="data sheet of the motor",
    )


EFFECTS = tuple(_harmonic_effect(index) for index in range(1, COUNT + 1))
