"""Torque path of an axis whose motion comes later than its reading tells, by an effect that is looked for only once the path is known.

Where a filter of the setpoint stands before the torque, and a dead time behind it, the motion comes as late as by a slower filter: a path
chosen without that effect takes a part of it over, and what is left of it looks like another effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from beltcomm.fit.estimate import Fitted
from beltcomm.fit.torque.path import TorquePath
from beltcomm.model import Model

#: Effects between the torque that is read and the motion, each with one time, and what is tried beside them by the chosen path: a lag of
#: the reading is no reason for another one, which has such lags of its own.
BETWEEN, BESIDE = ("dead_time", "current_lag"), ("measurement_lag",)
#: What most guides have and hides a path as well, beside how many of the likeliest paths it is tried, whose values are not the last ones,
#: and share of what lies above the noise that it may leave there.
RUBS, LIKELIEST, RUBS_LEAVES = "cart_friction", 4, 0.5
#: Share of what lies above the noise that such an effect may leave, and how much of it per sample.
MAY_LEAVE, MOST_LEFT = 0.3, 0.5


def effect_between(
    fit_by: Callable[[Model, TorquePath], Fitted],
    start: Model,
    chosen: TorquePath,
    fitted: Fitted,
    others: Sequence[TorquePath],
    clear: float,
) -> str:
    """Name of the effect between reading and motion with which another path explains the records better than the chosen one.

    Empty where the start model has such an effect, none explains enough, or the chosen path is as likely.

    Parameters
    ----------
    fit_by : callable
        Of a start model and a path, the fit.
    start : Model
        Without such an effect.
    chosen : TorquePath
        By a model without one.
    fitted : Fitted
        The fit by it.
    others : sequence of TorquePath
        The other ways to divide the same chain.
    clear : float
        Fall of -2 ln L that makes another path more than as likely.
    """
    if any(name in start.effects for name in (*BETWEEN, *BESIDE)):
        return ""
    samples = max(fitted.problem.samples, 1)

    def tried(path: TorquePath, names: Sequence[str] = BETWEEN) -> list[tuple[float, str]]:
        found = [(fit_by(start.with_effect(name), path), name) for name in names]
        return [(_level(f) if 2 * f.problem.samples > samples else math.inf, name) for f, name in found]

    own, _ = min(tried(chosen, (*BETWEEN, *BESIDE)))
    least, best = min((one for path in others for one in tried(path)), default=(math.inf, ""))
    explains = least - 1.0 < min(MAY_LEAVE * (_level(fitted) - 1.0), MOST_LEFT)
    return best if explains and samples * (own - least) > clear else ""


def rubs_instead(fit_by: Callable[[Model, TorquePath], Fitted], start: Model, fitted: Fitted, likeliest: Sequence[TorquePath]) -> bool:
    """True if friction at the carriage explains most of what a base leaves above the noise.

    Parameters
    ----------
    fit_by : callable
        Of a start model and a path, the fit.
    start : Model
        Of the base.
    fitted : Fitted
        The base.
    likeliest : sequence of TorquePath
        The likeliest first; a few of them are tried.
    """
    if "cart" not in start.base_bodies or RUBS in start.effects:
        return False
    may_leave = RUBS_LEAVES * (_level(fitted) - 1.0)
    rubbing = start.with_effect(RUBS)
    for path in likeliest[:LIKELIEST]:
        found = fit_by(rubbing, path)
        if 2 * found.problem.samples > fitted.problem.samples and _level(found) - 1.0 < may_leave:
            return True
    return False


def _level(fitted: Fitted) -> float:
    return fitted.objective / max(fitted.problem.samples, 1)
