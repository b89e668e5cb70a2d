"""Viscous friction of a body: proportional to speed."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial, body_units

_HIGH = {"motor": 0.5, "cart": 2000.0, "end_pulley": 500.0, "load": 0.5}
_START = {"motor": 0.002, "cart": 5.0, "end_pulley": 1.0, "load": 0.002}
_TITLE = {
    "motor": "viscous friction at the motor",
    "cart": "viscous friction at the carriage",
    "end_pulley": "viscous friction of the end pulley",
    "load": "viscous friction of the load behind the shaft",
}

_ALIKE = {
    "motor": {
        "quadratic_drag": "strokes at four speeds up to the fastest: viscous friction is a straight line, drag bends upwards",
        "warmup": "repeat the fast strokes after ten minutes of running: what has gone was cold grease",
    },
    "cart": {"viscous": "take the belt off and turn the motor alone: what is left is the motor's"},
    "end_pulley": {"viscous_cart": "take the belt off and turn the end pulley by hand; no motion of the axis tells the two apart well"},
    "load": {"viscous": "open the coupling and turn the motor alone: what is left is the motor's"},
}


def _force(position: float, speed: float, t: float, damping: float) -> float:
    """Force on the body:  force = -damping speed.

    Parameters
    ----------
    damping : float, N m s/rad at the motor shaft
        N s/m at the carriage and the end pulley (belt line).

    References
    ----------
    (2.21), (2.23). The thesis also writes d_m in N s/m at the belt: d_m[N m s/rad] = i_t² d_m[N s/m] (errata).
    """
    return -damping * speed


def _slope(position: float, speed: float, t: float, damping: float) -> tuple[float, float]:
    """(d force/d position, d force/d speed)."""
    return 0.0, -damping


def _trials(ground: AxisSummary) -> list[Trial]:
    """At the motor: a twentieth of the largest torque at the highest speed."""
    return [Trial({"damping": 0.05 * ground.peak_nm / max(ground.fastest, 1.0)})]


def _cart_trials(ground: AxisSummary) -> list[Trial]:
    """At the carriage: the same, seen through the belt."""
    return [Trial({"damping": 0.05 * ground.peak_nm / max(ground.fastest, 1.0) / ground.ratio**2})]


def _load_trials(ground: AxisSummary) -> list[Trial]:
    """For a load that turns: what damps it with a time constant of half a second."""
    return [Trial({"damping": 2.0 * ground.inertia})]


_TRIALS = {"motor": _trials, "cart": _cart_trials, "load": _load_trials}


def _on(body: str) -> Effect:
    """The effect on one body: ``viscous`` (motor), ``viscous_cart``, ``viscous_end_pulley``, ``viscous_load``."""
    _, unit, side = body_units(body)
    parameter = Parameter("damping", unit, side, _START[body], 0.0, _HIGH[body], "friction in proportion to speed")
    return Effect(
        name="viscous" if body == "motor" else f"viscous_{body}",
        slot="force",
        title=_TITLE[body],
        parameters=(parameter,),
        law=_force,
        slope=_slope,
        body=body,
        trials=_TRIALS.get(body),
        seen="the torque of a constant-speed stroke grows with speed",
        causes="grease, seals, bearings",
        check="grease, seals, bearing preload; repeat warm",
        remedy="grease by the data sheet, less preload; what is usual for the axis is sent along",
        alike=_ALIKE[body],
        linear=True,
        source="(2.21), (2.23); measured by (3.36)",
    )


EFFECTS = (_on("motor"), _on("cart"), _on("end_pulley"), _on("load"))
