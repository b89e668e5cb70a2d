"""Settings by the user of a session, and its findings so far."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from beltcomm.control import Cascade, PrefilterKind
from beltcomm.design.cascade import DesignResult
from beltcomm.design.feedforward import FeedforwardKind
from beltcomm.design.specification import Specification
from beltcomm.fit.torque.path import TorquePath
from beltcomm.identify.dead_time import DeadTime
from beltcomm.identify.final import FinalModel
from beltcomm.identify.friction import FrictionFit
from beltcomm.identify.magnitude_fit import MagnitudeFit
from beltcomm.identify.standstill import Standstill
from beltcomm.laboratory.cross_checks import SheetDoubt
from beltcomm.model import Model
from beltcomm.rundata import analyse
from beltcomm.rundata.first_motions import Breakaway, Excited, Holding
from beltcomm.schedule.record_schedule import Extent
from beltcomm.trajectory import Trajectory
from beltcomm.verify import Demand, Verdict

Apply = Literal["keep", "restore", "save"]


@dataclass(frozen=True)
class Settings:
    """Decisions of the user.

    Attributes
    ----------
    payloads_kg : tuple of float
        Further carriage loads the loop must hold for, added to what is mounted now.
    position_m : float or None
        Where the carriage stands, when the drive does not know.
    home : bool
        Run the drive's homing first.
    window_m : tuple of float or None
        How far the carriage may move from where it stands, (low < 0, high > 0).
    ask : bool
        Somebody can be asked.
    apply : Apply or None
        What becomes of the new gains; None asks when somebody can be asked.
    extent : Extent
        Quick is one place and one sweep, thorough holds what every effect needs.
    prefilter : PrefilterKind or None
        None is the best one that the drive has.
    move : Trajectory or None
        The user's own reference motion instead of the standard move.
    """

    apply: Apply | None = "restore"
    position_m: float | None = None
    home: bool = False
    window_m: tuple[float, float] | None = None
    ask: bool = False
    payloads_kg: tuple[float, ...] = ()
    prefilter: PrefilterKind | None = None
    feedforward: FeedforwardKind = "nonlinear"
    specification: Specification | None = None
    extent: Extent = "standard"
    move: Trajectory | None = None


@dataclass
class Findings:
    """Findings so far; every phase adds to it, and an interrupted run keeps what it has.

    Attributes
    ----------
    swing : Model or None
        The model of the first response with a payload that swings, where only that explains it.
    kept_path : TorquePath or None
        Of the torque, as a fit before has left it in the run folder.
    own_loop : bool
        The records and the move were driven with gains that a person has set in the drive, those of the design are to be typed in.
    reservations : list of str
        In words, why it is no success although the move that was driven met its targets.
    """

    breakaway: Breakaway | None = None
    holding: Holding | None = None
    excited: Excited | None = None
    thesis: dict[str, MagnitudeFit] = field(default_factory=dict)
    dead_time: DeadTime | None = None
    assumed_delay_s: float = 0.0
    kept_path: TorquePath | None = None
    final: FinalModel | None = None
    swing: Model | None = None
    characteristics: Mapping[str, analyse.Characteristic] = field(default_factory=dict)
    sheets: tuple[SheetDoubt, ...] = ()
    friction: FrictionFit | None = None
    standstill: Standstill | None = None
    design: DesignResult | None = None
    cascade: Cascade | None = None
    demand: Demand | None = None
    verdict: Verdict | None = None
    move_name: str = ""
    proof: Mapping[str, Any] = field(default_factory=dict)
    remarks: list[str] = field(default_factory=list)
    reservations: list[str] = field(default_factory=list)
    applied: Apply = "restore"
    machine_seconds: float = 0.0
    calibrating_s: float = 0.0
    own_loop: bool = False

    @property
    def path(self) -> TorquePath | None:
        """From setpoint and reading to the torque that acts, as far as it is known."""
        if self.final is not None:
            return self.final.fit.path
        return self.excited.path if self.excited is not None else self.kept_path

    @property
    def meets_targets(self) -> bool:
        """True if the axis meets its targets, by a model that explains it and with nothing that speaks against it."""
        trusted = self.final is not None and not self.final.fit.suspect
        return trusted and self.verdict is not None and self.verdict.passed and not self.reservations
