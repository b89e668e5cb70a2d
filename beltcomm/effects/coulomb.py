"""Coulomb friction of a body: a constant level that opposes motion and holds the body at standstill."""

from __future__ import annotations

from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial, body_units

_HIGH = {"motor": 50.0, "cart": 4000.0, "end_pulley": 100.0, "load": 50.0}
_START = {"motor": 0.05, "cart": 3.0, "end_pulley": 1.0, "load": 0.05}
_TITLE = {
    "motor": "Coulomb friction at the motor",
    "cart": "Coulomb friction at the carriage",
    "end_pulley": "Coulomb friction of the end pulley",
    "load": "Coulomb friction of the load behind the shaft",
}
_REMEDY = {
    "motor": "replace dry or worn bearings and seals; what belongs to the motor is sent along",
    "cart": "clean and grease the guide, replace its wipers, a carriage of lower preload",
    "end_pulley": "replace the bearing of the end pulley",
    "load": "replace dry or worn bearings and seals of the load",
}
_ELSEWHERE = (
    "excite around the antiresonance at two amplitudes: friction of the carriage fills the notch at the small one, the motor's does not"
)
_ALIKE = {
    "motor": {
        "cart_friction": _ELSEWHERE,
        "holding_brake": "slow strokes over several turns: friction of bearings is even, a brake rubs once per turn",
    },
    "cart": {"coulomb": _ELSEWHERE},
    "end_pulley": {"cart_friction": "take the belt off and turn the end pulley by hand; no motion of the axis tells the two apart well"},
    "load": {"coulomb": "open the coupling and turn motor and load by hand, one after the other"},
}
_CHECK = {
    "motor": "motor bearings, shaft seal, gearbox; turn the shaft by hand with the belt off",
    "cart": "guide, seals and grease of the carriage; push it by hand with the belt slack",
    "end_pulley": "bearing of the end pulley; turn it by hand with the belt slack",
    "load": "bearings and seals of the load; turn it by hand with the coupling open",
}


def _level(speed: float, position: float, t: float, level_: float) -> float:
    """Level of the set-valued friction.

    |force| <= level at standstill,  force = -level sign(speed) otherwise

    Parameters
    ----------
    level_ : float, N m at the motor shaft
        Or N at the carriage and the end pulley (belt line).

    References
    ----------
    (2.21), (2.23).
    """
    return level_


def _slope(speed: float, position: float, t: float, level_: float) -> float:
    """d level/d speed: none.  At standstill the friction has no linearisation (see ``beltcomm.model.linear``)."""
    return 0.0


def _motor_trials(ground: AxisSummary) -> list[Trial]:
    """At the motor: a twentieth of the largest torque."""
    return [Trial({"level": 0.05 * ground.peak_nm})]


def _cart_trials(ground: AxisSummary) -> list[Trial]:
    """For the carriage: half of the motor's friction acts there instead."""
    return [Trial({"level": 0.5 * ground.coulomb / ground.ratio})]


def _load_trials(ground: AxisSummary) -> list[Trial]:
    """Trials of Coulomb friction for a load that turns."""
    return [Trial({"level": 0.5 * ground.coulomb})]


_NAME = {"motor": "coulomb", "cart": "cart_friction", "end_pulley": "coulomb_end_pulley", "load": "coulomb_load"}
_TRIALS = {"motor": _motor_trials, "cart": _cart_trials, "load": _load_trials}


def _on(body: str) -> Effect:
    """The effect on one body: ``coulomb`` (motor), ``cart_friction``, ``coulomb_end_pulley``, ``coulomb_load``."""
    unit, _, side = body_units(body)
    parameter = Parameter("level", unit, side, _START[body], 0.0, _HIGH[body], "friction that does not depend on speed")
    return Effect(
        name=_NAME[body],
        slot="friction_level",
        title=_TITLE[body],
        parameters=(parameter,),
        law=_level,
        slope=_slope,
        body=body,
        seen="the torque steps when the direction changes; small torques do not move the axis",
        check=_CHECK[body],
        remedy=_REMEDY[body],
        alike=_ALIKE[body],
        trials=_TRIALS.get(body),
        record_sets=("places", "quiet") if body == "cart" else (),  # at the carriage it shows at the antiresonance
        causes="guide and its seals" if body == "cart" else "bearings, seals",
        linear=True,
        source="(2.21), (2.23); measured by (3.36)",
    )


EFFECTS = (_on("motor"), _on("cart"), _on("end_pulley"), _on("load"))
