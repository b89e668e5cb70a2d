"""Largest excitation of a moving axis in closed loop: predicted on a family of models before every record.

Beside the limits of open loop there is one more: neither motor nor carriage may turn round, or friction changes its sign and is no constant
any more (thesis 3.3.2).  While it does not, everything grows in proportion with the excitation, so few predictions find the largest one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from beltcomm.control import Cascade
from beltcomm.errors import Refused
from beltcomm.excitation.moving import MovingExcitation
from beltcomm.identify.amplitude import MotionLimits
from beltcomm.model import Model
from beltcomm.simulate.loop import LoopDrive, LoopKind, LoopRun, simulate_loop
from beltcomm.simulate.stopping import Braking

Into = Literal["torque", "velocity"]

#: Share of the base speed below which no model of the family may slow motor and carriage down: for what no model knows.
SLOWEST_SHARE = 0.2
#: The search ends when this share of a limit is used; it aims at the second, and looks so often.
ENOUGH, AIM, TRIES = 0.9, 0.95, 8
#: Share of the largest amplitude thought of with which it begins.
FIRST_SHARE = 0.1


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The excited loop.

    Attributes
    ----------
    cascade : Cascade
        In the drive.
    kind : LoopKind
        Of its loop.
    into : Into
        The controller's torque or the speed setpoint.
    """

    cascade: Cascade
    drive: LoopDrive
    kind: LoopKind
    into: Into
    sample_period_s: float


@dataclass(frozen=True)
class MovingPrediction:
    """Worst case over a family.

    Attributes
    ----------
    slowest : float
        Least speed of motor and carriage over base speed, while excited; nan at rest.
    low_m, high_m : float
        The carriage with a stop at any moment.
    speed_m_s : float
        Motor times i_t.
    deviation_m : float
        Motor from the base motion.
    """

    slowest: float
    low_m: float
    high_m: float
    speed_m_s: float
    torque_nm: float
    belt_force_n: float
    deviation_m: float

    def use_of(self, limits: MotionLimits) -> dict[str, float]:
        """Share of each limit that is used.

        Parameters
        ----------
        limits : MotionLimits
            ``travel_m`` counts where the carriage stands.
        """
        moving = math.isfinite(self.slowest)
        return {
            "turning round": (1.0 - self.slowest) / (1.0 - SLOWEST_SHARE) if moving else 0.0,
            "travel": 0.0 if moving else self.deviation_m / limits.travel_m,
            "speed": self.speed_m_s / limits.speed_m_s,
            "motor torque": self.torque_nm / limits.torque_nm,
            "belt force": self.belt_force_n / limits.belt_force_n,
        }


@dataclass(frozen=True)
class LoopStep:
    """The amplitude found, N m or rad/s.

    Attributes
    ----------
    binds : str
        The limit it reaches, or "what was asked for".
    """

    amplitude: float
    prediction: MovingPrediction
    binds: str


def simulate_record(model: Model, loop: ClosedLoop, motion: MovingExcitation, start_m: float) -> LoopRun:
    """One record on one model; an exchange slower than the loop holds its setpoints.

    Parameters
    ----------
    model : Model
    loop : ClosedLoop
        That the drive closes.
    motion : MovingExcitation
        Base motion and excitation.
    start_m : float
        Carriage, m.
    """
    ratio = model["transmission.ratio"]
    held = max(1, round(loop.sample_period_s / loop.drive.period_s))
    base, speed, added = (np.repeat(v, held) for v in (motion.base_m / ratio, motion.base_m_s / ratio, motion.added))
    nothing = np.zeros(len(added))
    torque, faster = (added, nothing) if loop.into == "torque" else (nothing, added)
    return simulate_loop(model, loop.cascade, loop.drive, loop.kind, start_m, base, speed + faster, torque)


def predict_moving(
    family: Sequence[Model], loop: ClosedLoop, motion: MovingExcitation, start_m: float, braking: Braking | None = None
) -> MovingPrediction:
    """Worst case of one record.

    Parameters
    ----------
    family : sequence of Model
        Models that the axis may be.
    loop : ClosedLoop
        That the drive closes.
    motion : MovingExcitation
        Base motion and excitation.
    start_m : float, m
        Carriage on the axis.
    braking : Braking or None
        Counted into the travel, where given.
    """
    ratio = family[0]["transmission.ratio"]
    held = max(1, round(loop.sample_period_s / loop.drive.period_s))
    base, speed = np.repeat(motion.base_m, held), np.repeat(motion.base_m_s, held)
    excited = np.repeat(motion.excited, held)
    travels = bool(np.any(speed))
    slowest, low, high = (math.inf if travels else math.nan), start_m, start_m
    top = torque = force = off = 0.0
    for model in family:
        run = simulate_record(model, loop, motion, start_m)
        moved = np.gradient(run.cart_m, loop.drive.period_s)
        if travels:  # the carriage rubs as well, and where the motor hardly answers it swings most
            slower = np.minimum(ratio * run.velocity_rad_s[excited] / speed[excited], moved[excited] / speed[excited])
            slowest = min(slowest, float(np.min(slower)))
        span = braking.span_m(run.cart_m, moved, loop.drive.period_s) if braking else (float(run.cart_m.min()), float(run.cart_m.max()))
        low, high = min(low, span[0]), max(high, span[1])
        top = max(top, ratio * float(np.max(np.abs(run.velocity_rad_s))))
        torque, force = max(torque, float(np.max(np.abs(run.torque_nm)))), max(force, float(np.max(run.belt_force_n)))
        off = max(off, float(np.max(np.abs(ratio * run.position_rad - base))))
    return MovingPrediction(slowest, low, high, top, torque, force, off)


def largest_moving(
    family: Sequence[Model], loop: ClosedLoop, shape: MovingExcitation, start_m: float, limits: MotionLimits, at_most: float, least: float
) -> LoopStep:
    """The largest amplitude up to ``at_most`` that keeps every member of the family inside all limits.

    Parameters
    ----------
    family : sequence of Model
        Models that the axis may be.
    loop : ClosedLoop
        That the drive closes.
    shape : MovingExcitation
        With unit amplitude.
    start_m : float, m
        Carriage on the axis.
    limits : MotionLimits
        Of the axis.
    at_most : float
        In the unit of the excitation.
    least : float
        Below it nothing is seen.

    Raises
    ------
    Refused
        With what binds.
    """
    low, high = 0.0, math.inf
    best: LoopStep | None = None
    trial, binds = max(FIRST_SHARE * at_most, least), "what was asked for"
    for _ in range(TRIES):
        prediction = predict_moving(family, loop, shape.louder(trial), start_m)
        use = prediction.use_of(limits)
        most = max(use, key=lambda name: use[name])
        if use[most] <= 1.0:
            low, best = trial, LoopStep(trial, prediction, most if use[most] > ENOUGH else "what was asked for")
            if use[most] > ENOUGH or trial >= at_most:
                break
        else:
            high, binds = trial, most
            if high <= least:
                break
        aimed = trial * AIM / use[most] if use[most] > 0.0 else at_most
        if not low < aimed < high:
            aimed = 0.5 * (low + high) if math.isfinite(high) else at_most
        trial = max(min(aimed, at_most), least)
    if best is None:
        raise Refused(_excess_words(binds, least, loop.into))
    return best


def _excess_words(binds: str, least: float, into: Into) -> str:
    unit = "N m" if into == "torque" else "rad/s"
    remedy = "travel faster (--base-speed)" if binds == "turning round" else "look at that limit in axis.yaml, or travel more slowly"
    what = "the motor would turn round" if binds == "turning round" else f"the limit on {binds} would be broken"
    return f"already ±{least:.3g} {unit}, the least that is seen, is too much: {what}; {remedy}"
