"""Basis of the tuning of one run, and the setting of the page's controls."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from beltcomm.axis.entries import NO_TARGETS, AxisTargets
from beltcomm.control import Cascade, CascadeStructure, Prefilter
from beltcomm.design.design_plant import DesignPlant
from beltcomm.design.knobs import Knobs
from beltcomm.errors import UsageError
from beltcomm.model import Model
from beltcomm.sending import Sending
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Loop

#: What the sliders reach.  Below 30 degrees a design is in doubt; the position loop alone, an integrator, has less than 90.
RANGES = {"phase_margin_deg": (30.0, 88.0), "position_phase_margin_deg": (30.0, 89.0), "suppression_db": (-40.0, -1.0)}
UNITS = {"phase_margin_deg": "deg", "position_phase_margin_deg": "deg", "suppression_db": "dB"}
TITLES = {
    "phase_margin_deg": "the velocity loop's phase margin",
    "position_phase_margin_deg": "the position loop's phase margin",
    "suppression_db": "the suppression",
}
#: kg: more is no payload of a belt axis.
MOST_PAYLOAD_KG = 1000.0


@dataclass(frozen=True)
class DesignInput:
    """Of one run.

    Attributes
    ----------
    plants : callable
        Of places, m, and payloads beyond what is mounted, kg: every variant a design must hold for.
    with_feedforward : callable
        Completes a cascade.
    ends_m : tuple[float, float]
        Of the travel.
    move : Trajectory
        That the tracking error is predicted for, with its rest.
    loop : Loop
        What the drive adds.
    present : Cascade
        The design in the run.
    velocity_filters_s : tuple of float
        T_R to choose from.
    targets : AxisTargets
        Of the axis, by which a move counts as settled.
    driven : Cascade or None
        The present design as it ran in the drive in the move that verified it, to the drive's own digits; None where none did.
    sending : Sending
        What the host sends along with a move.
    time_s : float
        Session's clock at the start of the move.
    """

    model: Model
    structure: CascadeStructure
    plants: Callable[[Sequence[float], Sequence[float]], list[DesignPlant]]
    with_feedforward: Callable[[Cascade], Cascade]
    ends_m: tuple[float, float]
    move: Trajectory
    loop: Loop
    present: Cascade
    velocity_filters_s: tuple[float, ...]
    targets: AxisTargets = NO_TARGETS
    driven: Cascade | None = None
    sending: Sending = "nothing"
    time_s: float = 0.0


@dataclass(frozen=True)
class SliderSetting:
    """Setting of the controls.

    Attributes
    ----------
    prefilter : str
        Its key, see :func:`key_of`.
    velocity_filter_s : float
        T_R.
    payload_kg : float
        Heaviest load beyond what is mounted; the design holds for it and for none.
    loaded : bool
        The curves are drawn with it.
    position_m : float
        Where they are drawn.
    """

    phase_margin_deg: float
    position_phase_margin_deg: float
    suppression_db: float
    prefilter: str
    velocity_filter_s: float
    payload_kg: float
    loaded: bool
    position_m: float

    @property
    def knobs(self) -> Knobs:
        """The three of the thesis."""
        return Knobs(self.phase_margin_deg, self.position_phase_margin_deg, self.suppression_db)

    @property
    def shown_kg(self) -> float:
        """Payload of the curves, kg."""
        return self.payload_kg if self.loaded else 0.0

    def turned(self, knobs: Knobs) -> SliderSetting:
        """Setting with other knobs."""
        return replace(
            self,
            phase_margin_deg=knobs.phase_margin_deg,
            position_phase_margin_deg=knobs.position_phase_margin_deg,
            suppression_db=knobs.suppression_db,
        )


def key_of(prefilter: Prefilter, centre_rad_s: float) -> str:
    """Name of a prefilter among those of a run: its kind, and the low-pass behind it as a multiple of its centre.

    Parameters
    ----------
    prefilter : Prefilter
        Of any kind.
    centre_rad_s : float, rad/s
        Of its kind.
    """
    return prefilter.kind if not prefilter.roll_off_rad_s else f"{prefilter.kind}+{prefilter.roll_off_rad_s / centre_rad_s:.0f}"


def setting_from(data: Any, ground: DesignInput) -> SliderSetting:
    """The controls as a program sent them.

    Parameters
    ----------
    data : Any
        Entries of a :class:`SliderSetting`.
    ground : DesignInput
        For the ends of the travel.

    Raises
    ------
    UsageError
        For anything missing, of another kind or out of range, naming the entry.
    """
    if not isinstance(data, dict) or set(data) != {field.name for field in fields(SliderSetting)}:
        raise UsageError(f"the controls are {', '.join(field.name for field in fields(SliderSetting))}; send these and no others")
    low, high = ground.ends_m
    ranges = RANGES | {"payload_kg": (0.0, MOST_PAYLOAD_KG), "position_m": (low, high), "velocity_filter_s": (0.0, 1.0)}
    for name, (least, most) in ranges.items():
        value = data[name]
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not least - 1e-9 <= value <= most + 1e-9:
            raise UsageError(f"{name} is {value!r}; it must be a number from {least:g} to {most:g}")
    if not isinstance(data["loaded"], bool) or not isinstance(data["prefilter"], str):
        raise UsageError("loaded must be true or false, prefilter a name")
    numbers = {name: float(data[name]) for name in ranges}
    return SliderSetting(**numbers, loaded=data["loaded"], prefilter=data["prefilter"])
