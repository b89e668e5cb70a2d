"""A gap between motor and carriage in which nothing is transmitted."""

from __future__ import annotations

from beltcomm.effects._corner import ramp, ramp_slope
from beltcomm.effects._effect import AxisSummary, Effect, EffectState, Parameter, Trial

#: m; a harder contact than this none of the time steps can follow.
LEAST_WIDTH_M = 1e-8


def _stretch_law(stretch: float, gap: float, rounding: float) -> float:
    """Stretch that loads the belt, m:  0 within ±gap/2, stretch ∓ gap/2 beyond, over corners of ``rounding`` times the gap."""
    half, width = 0.5 * gap, max(rounding * gap, LEAST_WIDTH_M)
    return ramp(stretch - half, width) - ramp(-stretch - half, width)


def _slope(stretch: float, gap: float, rounding: float) -> float:
    """1 in contact, 0 in the gap."""
    half, width = 0.5 * gap, max(rounding * gap, LEAST_WIDTH_M)
    return ramp_slope(stretch - half, width) + ramp_slope(-stretch - half, width)


def _trials(ground: AxisSummary) -> list[Trial]:
    """Six gaps, each twice the one before; one three times too wide already lets the carriage stray more than it explains."""
    return [Trial({"gap": gap}) for gap in (3.75e-6, 7.5e-6, 1.5e-5, 3e-5, 6e-5, 1.2e-4)]


EFFECT = Effect(
    name="backlash",
    record_sets=("places", "quiet", "reversals"),
    slot="belt_law",
    title="backlash",
    parameters=(
        Parameter("gap", "m", "belt", 3e-5, 0.0, 5e-3, "whole width of the gap, at the belt"),
        Parameter("rounding", "1", "belt", 0.1, 0.002, 0.5, "way over which contact builds up, as a share of the gap"),
    ),
    law=_stretch_law,
    slope=_slope,
    trials=_trials,
    state=(EffectState("place of the carriage in the gap", "m", "estimated", "end"),),
    least=1e-6,  # an encoder of 65536 counts on a pulley of 78 mm resolves 1.2 um
    seen="the belt looks softer at small amplitudes; a jump in position at reversals; rattling",
    causes="loose key, worn teeth, loose clamp",
    check="hold the motor and move the carriage by hand against a dial gauge",
    remedy="tighten the key or clamping set of the pulley and the clamp at the carriage; replace belt and pulley with worn teeth together",
    alike={
        "belt_slack": "excite at two amplitudes: a gap makes the belt softer at the small one, a slack strand at the large one",
        "presliding": "let the torque turn round slowly: in a gap the motor turns freely, elastic friction holds it like a spring",
    },
    source="data sheet",
)
