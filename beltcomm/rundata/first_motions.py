"""Values found by the first motions of a session: breakaway, the torque that holds a tilted axis, the amplitude search."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from beltcomm.fit.torque.path import FAITHFUL, TorquePath
from beltcomm.identify.amplitude import AmplitudeStep
from beltcomm.model import Model
from beltcomm.recording import Recording

#: m: what counts as moving; more than belt and coupling give way before friction breaks.
MOVED_M = 5e-5
#: Sliding friction is at least this share of the torque at which the carriage began to move.
SLIDING_SHARE = 0.5
#: Breakaway torques that differ by less than this share of friction either way are the same.
CLEAR_SHARE = 0.05


@dataclass(frozen=True)
class Breakaway:
    """Torque at which the carriage began to move, N m at the motor shaft, in each direction (both positive on a level axis).

    Attributes
    ----------
    slope_nm_s : float
        How fast the torque rose, N m/s.
    held_nm : float
        Torque that a stop of the drive sends along, N m.
    """

    forward_nm: float
    backward_nm: float
    slope_nm_s: float = 0.0
    held_nm: float = 0.0

    @property
    def coulomb_nm(self) -> float:
        """Half the difference of the two: friction."""
        return 0.5 * (self.forward_nm + self.backward_nm)

    def _overcome_nm(self, inertia_kg_m2: float, ratio: float) -> float:
        """Friction that was overcome, N m, on an axis with this inertia at the motor.

        The torque went on rising until the carriage had moved by ``MOVED_M``:  x = i_t Ṁ t³/6J  gives by how much.
        """
        rising_s = (6.0 * MOVED_M * inertia_kg_m2 / (ratio * self.slope_nm_s)) ** (1.0 / 3.0) if self.slope_nm_s else 0.0
        return max(0.0, self.coulomb_nm - self.slope_nm_s * rising_s)

    def least_friction_nm(self, inertia_kg_m2: float, ratio: float) -> float:
        """Lower bound of the friction in motion on an axis with this inertia, N m, motor shaft; 0 when nothing is known."""
        return max(0.0, SLIDING_SHARE * self._overcome_nm(inertia_kg_m2, ratio) - abs(self.holding_nm - self.held_nm))

    def most_friction_nm(self, stiffness_n_m: float, inertia_kg_m2: float, ratio: float) -> float:
        """Upper bound of the friction in motion, N m; infinite where the carriage may still have stood when the motor moved.

        It did not where a belt stretched by ``MOVED_M`` pulls harder than all that was overcome:  i_t c x > τ.
        """
        overcome_nm = self._overcome_nm(inertia_kg_m2, ratio)
        return overcome_nm if ratio * stiffness_n_m * MOVED_M > overcome_nm else math.inf

    @property
    def holding_nm(self) -> float:
        """Half the sum with sign: what holds the axis against gravity; 0 where that is within the scatter of friction."""
        half = 0.5 * (self.forward_nm - self.backward_nm)
        return half if abs(half) > CLEAR_SHARE * self.coulomb_nm else 0.0


@dataclass(frozen=True)
class HoldingTorque:
    """A holding torque, N m at the motor, with its 95 % interval (half width)."""

    torque_nm: float
    interval_nm: float


@dataclass(frozen=True)
class Settled:
    """The settled integrating controller, N m.

    Attributes
    ----------
    began_nm : float
        Its first torque.
    slipped_m : float
        On the way.
    stood : bool
        At the end.
    """

    torque_nm: float
    began_nm: float
    slipped_m: float
    stood: bool


@dataclass(frozen=True)
class Holding:
    """All that was found of the holding torque.

    Attributes
    ----------
    expected_nm, bounds_nm
        By axis.yaml.
    breakaway, creep
        Way (b).
    integrators : tuple of Settled
        Way (a), from below and from above.
    coulomb_nm : float
        Half the difference at breakaway.
    slipped_m : float
        Furthest that the carriage slipped under a torque that did not hold it.
    held_by : str
        What holds it without torque, in words.
    """

    expected_nm: float
    bounds_nm: tuple[float, float]
    breakaway: HoldingTorque
    coulomb_nm: float
    slipped_m: float
    held_by: str
    integrators: tuple[Settled, ...] = ()
    creep: HoldingTorque | None = None
    creep_coulomb_nm: float | None = None
    why_not: str = ""

    @property
    def best(self) -> HoldingTorque:
        """Holding torque for the records: slow creep where there is one."""
        return self.creep or self.breakaway

    @property
    def friction_nm(self) -> float:
        """Coulomb friction by the same way, N m."""
        return self.coulomb_nm if self.creep_coulomb_nm is None else self.creep_coulomb_nm

    def to_dict(self) -> dict[str, Any]:
        """For ``results/gravity.yaml`` and ``--json``."""
        bands = [{"low_nm": s.torque_nm - self.friction_nm, "high_nm": s.torque_nm + self.friction_nm} for s in self.integrators]
        found = {**asdict(self), "used": asdict(self.best)}
        return {**found, "integrators": [{**asdict(s), **band} for s, band in zip(self.integrators, bands, strict=True)]}


@dataclass(frozen=True)
class Excited:
    """Outcome of the amplitude search: the last step, all recordings, and the model and torque path that they gave.

    Attributes
    ----------
    at_most_nm : float
        Of the next excitation, whatever its sequence: no record is louder than the one before by more than ``raising.GROWTH``.
    """

    step: AmplitudeStep
    recordings: tuple[Recording, ...]
    model: Model
    at_most_nm: float
    path: TorquePath = FAITHFUL
