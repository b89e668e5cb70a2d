"""A belt that loses one strand at large force: pretension too low."""

from __future__ import annotations

from beltcomm.effects._corner import ramp, ramp_slope
from beltcomm.effects._effect import AxisSummary, Effect, Parameter, Trial

#: Share of the stiffness that a slack strand takes away at most.
MOST_LOST = 0.95
#: By the share of the stiffness that is left: what a belt with both strands tight is stiffer by than one fitted to all states of it.
STIFFER = {0.8: 1.15, 0.6: 1.3}
_STIFFNESS = "belt_stiffness.stiffness"


def _stretch_law(stretch: float, limit: float, share: float, balance: float, rounding: float) -> float:
    """Stretch that loads the belt, m: beyond +limit/(2(1 - balance)) and below -limit/(2 balance) one strand has lost its pretension.

    A strand that carries the part a of the stiffness takes (1 - share) 2 a of it away when it goes slack: with equal strands
    (balance = 1/2) only ``share`` is left beyond ±limit.

    Parameters
    ----------
    limit : float, m
    balance : float
        Part of the strand that goes slack in the negative direction.
    rounding : float
        Width of the corners as a share of the limit.
    """
    plus, minus = 0.5 * limit / (1.0 - balance), 0.5 * limit / balance
    lost = 2.0 * (1.0 - share)
    above = min(lost * (1.0 - balance), MOST_LOST) * ramp(stretch - plus, rounding * plus)
    below = min(lost * balance, MOST_LOST) * ramp(-stretch - minus, rounding * minus)
    return stretch - above + below


def _slope(stretch: float, limit: float, share: float, balance: float, rounding: float) -> float:
    """1 with both strands tight, less with one."""
    plus, minus = 0.5 * limit / (1.0 - balance), 0.5 * limit / balance
    lost = 2.0 * (1.0 - share)
    above = min(lost * (1.0 - balance), MOST_LOST) * ramp_slope(stretch - plus, rounding * plus)
    below = min(lost * balance, MOST_LOST) * ramp_slope(-stretch - minus, rounding * minus)
    return 1.0 - above - below


def _trials(ground: AxisSummary) -> list[Trial]:
    """Limits between an eighth and four fifths of the largest stretch recorded: with the belt as it was fitted, and with a stiffer one.

    A belt fitted without the slack is as soft as both states in the mean; with that stiffness no limit may be better than none.  Where
    it was fitted to what it explains, the strands go slack where that ends:  1/s₊ + 1/s₋ = 2/limit,  balance = limit/(2 s₋).
    """
    largest = ground.peak_force_n / ground.stiffness
    plain = [Trial({"limit": part * largest, "share": 0.7, "balance": 0.5}) for part in (0.25, 0.4, 0.6, 0.8)]
    minus, plus = ground.explained_m
    if min(minus, plus) > 0.0:
        limit = 2.0 / (1.0 / plus + 1.0 / minus)
        balance = min(max(0.5 * limit / minus, 0.25), 0.75)
        plain += [Trial({"limit": limit, "share": share, "balance": balance}) for share in (0.55, 0.7, 0.85)]
    return plain + [
        Trial({"limit": part * largest, "share": share, "balance": 0.5}, base={_STIFFNESS: stiffer * ground.stiffness})
        for share, stiffer in STIFFER.items()
        for part in (0.125, 0.2, 0.3, 0.45)
    ]


EFFECT = Effect(
    name="belt_slack",
    slot="belt_law",
    of_belt=True,
    title="slack strand at large force",
    parameters=(
        Parameter("limit", "m", "belt", 2e-4, 1e-6, 1e-2, "stretch at which one strand goes slack, with equal strands"),
        Parameter("share", "1", "belt", 0.6, 0.05, 1.0, "share of the stiffness that is left, with equal strands"),
        Parameter("balance", "1", "belt", 0.5, 0.2, 0.8, "part of the stiffness in the strand that goes slack in the negative direction"),
        Parameter("rounding", "1", "belt", 0.07, 0.005, 0.5, "width of the corner as a share of the limit"),
    ),
    law=_stretch_law,
    slope=_slope,
    trials=_trials,
    seen="the belt looks softer at large amplitudes and in fast moves",
    causes="pretension too low",
    check="tension meter, or frequency of the plucked strand",
    remedy="raise the pretension to the value of the belt's data sheet, at least half of the largest force in the belt",
    alike={
        "backlash": "excite at two amplitudes: a slack strand makes the belt softer at the large one, a gap at the small one",
        "torque_saturation": (
            "hold the motor and pull the carriage with a spring balance: the way over the force bends where a strand goes slack"
        ),
    },
    source="data sheet of the belt",
)
