"""Differences to the present design: a table and one sentence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from beltcomm.control import Cascade
from beltcomm.design.margins import WorstMargins
from beltcomm.quantities import three_digits
from beltcomm.verify import TrackingError

#: Relative change below which a number counts as the same; what follows from several gains moves by more between two steps of a slider.
SAME_SHARE, SAME_PRODUCT = 0.03, 0.1


@dataclass(frozen=True)
class TuningChange:
    """One number, present and new, in ``unit``.

    Attributes
    ----------
    better : bool or None
        None for a matter of taste.
    same_share : float
        Relative change that is none.
    """

    name: str
    unit: str
    present: float
    new: float
    better: bool | None
    same_share: float = SAME_SHARE

    @property
    def same(self) -> bool:
        """True if both are alike but for the sliders' steps."""
        return math.isclose(self.present, self.new, rel_tol=self.same_share, abs_tol=0.3 if self.unit in ("deg", "dB") else 1e-9)


def changes(present: tuple[Cascade, WorstMargins], new: tuple[Cascade, WorstMargins]) -> tuple[TuningChange, ...]:
    """Gains, margins of the least favourable variant and bandwidths of two designs against each other.

    Parameters
    ----------
    present : tuple of Cascade and WorstMargins
        Controller and margins of the run's design.
    new : tuple of Cascade and WorstMargins
        Controller and margins of the sliders.
    """
    (old, was), (cascade, worst) = present, new
    return (
        TuningChange("velocity gain Kp", "N m s/rad", old.kp_nm_s_rad, cascade.kp_nm_s_rad, None),
        TuningChange("integral gain Ki", "N m/rad", old.ki_nm_rad, cascade.ki_nm_rad, None),
        TuningChange("position gain Kv", "1/s", old.kpp_1_s, cascade.kpp_1_s, None),
        _judged("stiffness Ki Kv", "N m/(rad s)", old.ki_nm_rad * old.kpp_1_s, cascade.ki_nm_rad * cascade.kpp_1_s, True, SAME_PRODUCT),
        _judged("velocity bandwidth", "Hz", was.bandwidth_hz, worst.bandwidth_hz, True),
        _judged("velocity bandwidth at rest", "Hz", was.bandwidth_at_rest_hz, worst.bandwidth_at_rest_hz, True),
        _judged("position bandwidth", "Hz", was.position_bandwidth_hz, worst.position_bandwidth_hz, True),
        _judged("position bandwidth at rest", "Hz", was.position_bandwidth_at_rest_hz, worst.position_bandwidth_at_rest_hz, True),
        _judged("velocity phase margin", "deg", was.phase_margin_deg, worst.phase_margin_deg, True),
        _judged("position phase margin", "deg", was.position_phase_margin_deg, worst.position_phase_margin_deg, True),
        _judged("open loop at the resonance", "dB", was.suppression_db, worst.suppression_db, False),
        _judged("sensitivity", "dB", was.sensitivity_db, worst.sensitivity_db, False),
    )


def error_changes(present: TrackingError, new: TrackingError) -> tuple[TuningChange, ...]:
    """Predicted errors of the move at the motor, of two designs against each other.

    Parameters
    ----------
    present : TrackingError, m
        By the run's design.
    new : TrackingError, m
        By the sliders.
    """
    return (
        _judged("predicted following error", "mm", 1e3 * present.dynamic_m, 1e3 * new.dynamic_m, False, SAME_PRODUCT),
        _judged("predicted settled error", "mm", 1e3 * present.static_m, 1e3 * new.static_m, False, SAME_PRODUCT),
    )


def sentence(found: Sequence[TuningChange]) -> str:
    """Differences, largest numbers of interest first, in one line.

    Parameters
    ----------
    found : sequence of TuningChange
        Differences, in the order of their interest.
    """
    told = [change for change in found if change.better is not None and not change.same]
    if not told:
        return "Nothing changed against the present design."
    parts = [f"{change.name} {_number(change.present)} → {_number(change.new)} {change.unit}" for change in told]
    return f"Against the present design: {'; '.join(parts)}."


def _number(value: float) -> str:
    return three_digits(value) if math.isfinite(value) else "none"


def _judged(name: str, unit: str, present: float, new: float, larger_is_better: bool, same_share: float = SAME_SHARE) -> TuningChange:
    return TuningChange(name, unit, present, new, (new > present) == larger_is_better, same_share)
