"""Drag of the carriage with the square of speed."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial


def _force(position: float, speed: float, t: float, factor: float) -> float:
    """Force on the carriage:  -factor speed |speed|, N.

    Parameters
    ----------
    factor : float, N s²/m²

    References
    ----------
    Data sheet of covers; air drag.
    """
    return -factor * speed * abs(speed)


def _slope(position: float, speed: float, t: float, factor: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed)."""
    return 0.0, -2.0 * factor * abs(speed)


def _trials(ground: AxisSummary) -> list[Trial]:
    """One: the column is linear in the factor."""
    return [Trial({"factor": 2.0})]


EFFECT = Effect(
    name="quadratic_drag",
    record_sets=("sweep", "fast"),
    slot="force",
    title="drag with the square of speed",
    parameters=(Parameter("factor", "N s2/m2", "cart", 1.0, 0.0, 200.0, "force over speed squared"),),
    law=_force,
    slope=_slope,
    body="cart",
    trials=_trials,
    seen="fast strokes need more torque than viscous friction says",
    causes="air drag, large covers, bellows, seals",
    check="take covers or bellows off and repeat the fast strokes",
    remedy="vents or smaller covers, bellows with more room for the air; else a lower top speed",
    alike={
        "viscous": "strokes at four speeds up to the fastest: viscous friction is a straight line, drag bends upwards",
    },
    source="data sheet",
)
