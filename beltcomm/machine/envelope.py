"""Envelope in which a phase may use the axis, and the loop of the drive that follows strokes."""

from __future__ import annotations

from dataclasses import dataclass

from beltcomm.drive import GUARD_S, Capabilities, LoopKind


@dataclass(frozen=True)
class Envelope:
    """Envelope of the present phase.

    Attributes
    ----------
    window_m : tuple[float, float]
        (min, max) of the carriage. speed_m_s, torque_nm (motor shaft).
    lag_m : float or None
        How far a position loop may be off its reference; None leaves it to the drive's own setting.
    guard_s : float
        Within which the drive is to notice that its host is gone.
    """

    window_m: tuple[float, float]
    speed_m_s: float
    torque_nm: float
    lag_m: float | None = None
    guard_s: float = GUARD_S


def stroking(capabilities: Capabilities) -> LoopKind:
    """The loop that follows strokes with the least lag, or the drive's own strokes where it offers nothing else.

    Parameters
    ----------
    capabilities : Capabilities
    """
    if capabilities.kinds == {"profile"}:
        return "profile"
    return "position" if capabilities.structure.velocity_feedforward and "position" in capabilities.kinds else "velocity"
