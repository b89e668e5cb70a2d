"""What a phase may use of the axis, and which loop of the drive follows strokes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from beltcomm.drive import Capabilities


@dataclass(frozen=True)
class Room:
    """What the present phase may use.  window_m : (min, max) of the carriage.   speed_m_s, torque_nm (motor shaft).

    lag_m : how far a position loop may be off its reference; None leaves it to the drive's own setting.
    """

    window_m: tuple[float, float]
    speed_m_s: float
    torque_nm: float
    lag_m: float | None = None


def stroking(capabilities: Capabilities) -> Literal["position", "velocity"]:
    """The loop that follows strokes without lag: the position loop where it has a velocity feedforward, else the velocity loop."""
    return "position" if capabilities.structure.velocity_feedforward and "position" in capabilities.kinds else "velocity"
