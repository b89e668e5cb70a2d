"""Viscous friction that falls while the axis warms up."""

from __future__ import annotations

import math

from beltcomm.effects._effect import AxisSummary, Effect, EffectState, Parameter, Trial


def _force(position: float, speed: float, t: float, amount: float, time: float, damping: float) -> float:
    """Torque on the motor:  -damping amount exp(-t/time) speed, N m.

    Parameters
    ----------
    t, time : float, s
        Session clock.
    damping : float, N m s/rad
        When warm.
    """
    return -damping * amount * math.exp(-t / time) * speed


def _slope(position: float, speed: float, t: float, amount: float, time: float, damping: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed)."""
    return 0.0, -damping * amount * math.exp(-t / time)


def _trials(ground: AxisSummary) -> list[Trial]:
    """Three time constants."""
    return [Trial({"amount": 0.5, "time": time}) for time in (20.0, 50.0, 120.0)]


EFFECT = Effect(
    name="warmup",
    record_sets=("sweep", "places", "sweep again"),
    slot="force",
    title="warming up",
    parameters=(
        Parameter("amount", "1", "motor", 0.2, 0.0, 20.0, "viscous friction at the start of the session above that when warm, as a share"),
        Parameter("time", "s", "motor", 50.0, 3.0, 2000.0, "time constant on the session's clock"),
    ),
    law=_force,
    slope=_slope,
    body="motor",
    uses=("viscous.damping",),
    trials=_trials,
    state=(EffectState("time since the session began", "s", "clock", "clock"),),
    seen="fast strokes at the end of the session need less torque than at its start",
    causes="cold grease",
    check="repeat after ten minutes of running",
    remedy="run the axis warm before commissioning; a grease for lower temperatures",
    alike={
        "viscous": "repeat the fast strokes after ten minutes of running: what is still there is viscous friction",
    },
    source="data sheet of the grease",
)
