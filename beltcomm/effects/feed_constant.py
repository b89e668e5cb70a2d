"""Travel per turn that is not that of the data sheet; only a second sensor at the carriage can show it."""

from __future__ import annotations

from beltcomm.effects._effect import Effect, Parameter


def _travel(theta: float, error: float) -> float:
    """Angle by which the belt runs ahead:  error θ, rad, so that u = i_t (1 + error) θ.   θ : rad, absolute motor angle."""
    return error * theta


def _slope(theta: float, error: float) -> float:
    """d/dθ; the lever arm is i_t (1 + this)."""
    return error


EFFECT = Effect(
    name="feed_constant",
    slot="kinematics",
    title="error of the feed constant",
    parameters=(Parameter("error", "1", "belt", 0.0, -0.1, 0.1, "true travel per turn over that of the axis file, minus one"),),
    law=_travel,
    slope=_slope,
    seen="a scale at the carriage and the motor angle drift apart in proportion to the way",
    causes="worn or wrong pulley, belt that creeps, a wrong data sheet",
    check="dial gauge or tape over the whole travel; number of teeth and pitch of the belt",
    remedy="write the measured travel per turn into axis.yaml; replace a worn pulley",
    alike={
        "pulley_eccentricity": "measure over several turns: run-out comes back after each turn, a wrong feed constant adds up",
    },
    source="(2.16); data sheet of the pulley",
)
