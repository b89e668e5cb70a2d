"""Limits of the quantities of an axis, over months or from move to move."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from beltcomm.errors import UsageError


@dataclass(frozen=True)
class Limit:
    """Limit of a quantity.

    Attributes
    ----------
    low, high : float or None
        Shares of the first value, or SI values where ``absolute``.
    why : str
        In words.
    """

    low: float | None
    high: float | None
    why: str
    absolute: bool = False

    def values(self, first: float) -> tuple[float | None, float | None]:
        """Lower and upper limit in SI, by the value of the first run; None where there is none."""
        if self.absolute:
            return self.low, self.high
        return tuple(None if share is None else first * (1.0 + share) for share in (self.low, self.high))  # type: ignore[return-value]


_STIFFNESS = Limit(-0.2, 0.2, "20 % move the resonance by 10 %, further than prefilter and margins were proven for")
_LOAD = Limit(-0.1, 0.1, "the feedforward sends torque for the mass found: 10 % of it are missing or too much")
_INERTIA = Limit(-0.1, 0.1, "an inertia does not age: coupling or pulley slips, or the scale of the torque has changed")
#: By key; what is not named here is followed without a limit.
LIMITS: Mapping[str, Limit] = {
    "belt_stiffness.stiffness": _STIFFNESS,
    "belt_spans.specific_stiffness": _STIFFNESS,
    "belt_sections.specific_stiffness": _STIFFNESS,
    "resonance": Limit(-0.1, 0.1, "prefilter and margins were proven for the resonance found; 10 % are one fifth of the belt's stiffness"),
    "coulomb_total": Limit(-0.4, 0.5, "half as much again: grease, guide or bearing; 40 % less: the belt has lost its tension"),
    "friction_at_place": Limit(None, 0.5, "half of the axis's friction more at one place: dirt, a dent, a bent rail, a cable that rubs"),
    "viscous_total": Limit(None, 1.0, "twice as much: grease that has hardened, or dirt"),
    "cart.mass": _LOAD,
    "mass": _LOAD,
    "motor.inertia": _INERTIA,
    "dead_time": Limit(None, 0.5, "half as late again takes the phase margin that the delay was designed with"),
    "model_error": Limit(None, 0.25, "what the model does not know adds half as much again to the power of the noise"),
}

#: Share by which a quantity changes without anything being wrong, see ``docs/report.md``; of one that nobody measured.
USUAL: Mapping[str, float] = {
    "coulomb_total": 0.1,
    "viscous_total": 0.2,
    "belt_stiffness.stiffness": 0.03,
    "belt_spans.specific_stiffness": 0.03,
    "belt_sections.specific_stiffness": 0.03,
    "cart.mass": 0.01,
    "mass": 0.01,
    "motor.inertia": 0.01,
    "model_error": 0.08,
    "belt_damping.damping": 0.2,
    "resonance": 0.015,
    "antiresonance": 0.015,
    "dead_time": 0.05,
    "dynamic_error": 0.2,
    "static_error": 0.5,
}
UNKNOWN = 0.1


def limits_given(limits: Sequence[str]) -> dict[str, Limit]:
    """Limits of quantities as they are typed.

    Parameters
    ----------
    limits : sequence of str
        ``KEY=-20%``, ``KEY=+50%``, ``KEY=0.2`` in SI, ``KEY=none``.

    Returns
    -------
    dict of str to Limit
        By key; per cent as shares.

    Raises
    ------
    UsageError
        For one that cannot be read, or limits of one quantity in per cent and in SI.
    """
    found: dict[str, Limit] = {}
    for text in limits:
        if (free := re.fullmatch(r"([\w.]+)=none", text.strip())) is not None:
            found[free[1]] = Limit(None, None, "given on the command line")
            continue
        match = re.fullmatch(r"([\w.]+)=([-+]?)(\d*\.?\d+(?:e[-+]?\d+)?)(%?)", text.strip())
        if match is None:
            raise UsageError(
                f"the limit {text!r} cannot be read; write KEY=-20%, KEY=+50%, KEY=0.2 for an upper limit in SI, or KEY=none for no limit"
            )
        key, sign, number, share = match.groups()
        value = float(number) * (-1.0 if sign == "-" else 1.0)
        if not math.isfinite(value):
            raise UsageError(f"the limit {text!r} is beyond any number; KEY=none is no limit")
        before = found.get(key) or Limit(None, None, "given on the command line", absolute=not share)
        if before.absolute == bool(share):
            raise UsageError(f"the limits of {key} are given in per cent and in SI; give both in one of them")
        value = value / 100.0 if share else value
        found[key] = replace(before, low=value) if sign == "-" and share else replace(before, high=value)
    return found
