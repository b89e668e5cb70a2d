"""Effects of a diagnosis that the data tell apart badly, although each has evidence of its own: two delays, lines beside a ripple."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from beltcomm.fit.estimate import Fitted
from beltcomm.fit.uncertainty.intervals import parameter_spread
from beltcomm.laboratory.acceptance import DELAYS

#: Share of a lag up to which a dead time beside it may be the lag's own second pole.
SECOND_POLE = 0.25
#: Periods per turn by which a line may lie beside a ripple whose amplitude changes once per turn, and room for rounding.
BESIDE, ROUNDED = 1.0, 0.05
#: A size that changes by all of itself writes lines of half of it.
MOST = 0.5


@dataclass(frozen=True)
class ConfoundedEffects:
    """effects : which.   parameter : what of them is known together, "" where nothing is summed.   value, interval : in ``unit``.
    text : a sentence.
    """

    effects: tuple[str, ...]
    parameter: str
    value: float | None
    interval: float | None
    unit: str
    text: str


def find_confounded(fitted: Fitted, named: Sequence[str]) -> list[ConfoundedEffects]:
    """All that is to be said of effects that were named side by side."""
    return [*delays_of(fitted, named), *ripples_of(fitted, named)]


def delays_of(fitted: Fitted, named: Sequence[str]) -> list[ConfoundedEffects]:
    """Two or three delays of which one at least was named: their sum."""
    model = fitted.model
    present = [name for name in DELAYS if f"{name}.time" in fitted.problem.free]
    if len(present) < 2 or not set(present) & set(named):
        return []
    value = sum(model[f"{name}.time"] for name in present)
    width = parameter_spread(fitted).half_width({f"{name}.time": 1.0 for name in present})
    known = f"{1e6 * value:.0f}" + ("" if width is None else f" ± {1e6 * width:.0f}")
    alone = " and ".join(f"{name} ({1e6 * model[f'{name}.time']:.0f} us)" for name in present)
    text = f"The sum of the delays is known to be {known} us; each alone is not, whatever its interval says: {alone}."
    lag = max((name for name in present if name != "dead_time"), key=lambda name: model[f"{name}.time"])
    if "dead_time" in present and 0.0 < model["dead_time.time"] < SECOND_POLE * model[f"{lag}.time"]:
        text += f" A dead time as short as this may be a second pole of the {lag}, and no cause of its own."
    return [ConfoundedEffects(tuple(present), "time", value, width, "s", text)]


def ripples_of(fitted: Fitted, named: Sequence[str]) -> list[ConfoundedEffects]:
    """A line of the motor one period per turn beside the ripple of the teeth, and weaker: the teeth's own, where pulley or belt wobble."""
    model = fitted.model
    if "tooth_ripple" not in model.effects:
        return []
    teeth, mesh = model["tooth_ripple.teeth"], amplitude(fitted, "tooth_ripple")
    found = []
    for name in named:
        if not name.startswith("cogging"):
            continue
        beside = abs(model[f"{name}.order"] - teeth)
        if amplitude(fitted, name) < MOST * mesh and abs(beside - BESIDE) < ROUNDED:
            text = (
                f"{name} of order {model[f'{name}.order']:g} lies one period per turn beside the {teeth:g} teeth: that is what a tooth "
                "ripple writes whose size changes once per turn (pulley out of true). It may be part of the tooth_ripple and no cause of "
                "its own."
            )
            found.append(ConfoundedEffects((name, "tooth_ripple"), "", None, None, "", text))
    return found


def amplitude(fitted: Fitted, name: str) -> float:
    """Of a ripple, N m."""
    return float((fitted.model[f"{name}.sine"] ** 2 + fitted.model[f"{name}.cosine"] ** 2) ** 0.5)
