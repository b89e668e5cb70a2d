"""The sections of ``axis.yaml``: every entry with its meaning and the bounds outside which it cannot be.

A missing entry is None.  SI units, the unit in the name.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

#: Tilt, degrees, up to which an axis counts as level.
LEVEL_DEG = 3.0
#: Targets where nobody stated any: of the design source's chapter 5, "smaller than 1 mm", "smaller than 100 um", read from 0.5 s after the
#: reference has ended, on 0.5 m with the limits T_A.
FOLLOWING_TARGET_M, SETTLED_TARGET_M, SETTLED_AFTER_S = 1e-3, 100e-6, 0.5
TARGET_WAY_M, TARGET_LIMITS = 0.5, "T_A"
#: Where targets may be asked for.
AT = ("motor", "carriage", "both")


@dataclass(frozen=True)
class AxisEntry:
    """Meaning and bounds of one number in ``axis.yaml``.

    Attributes
    ----------
    above : float
        Exclusive.
    at_least, at_most : float
        Inclusive.
    """

    meaning: str
    above: float = -math.inf
    at_least: float = -math.inf
    at_most: float = math.inf
    whole: bool = False

    def fault(self, value: float) -> str:
        """Bound that a value breaks, in words; "" when it is possible."""
        if not math.isfinite(value):
            return "it must be a finite number"
        if self.whole and not float(value).is_integer():
            return "it must be a whole number"
        if value <= self.above:
            return f"it must be above {self.above:g}"
        if value < self.at_least:
            return f"it must be at least {self.at_least:g}" + (", so look at the unit" if self.at_least > 0.0 else "")
        if value > self.at_most:
            return f"it must be at most {self.at_most:g}, so look at the unit"
        return ""


# Bounds catch a data sheet's kg mm², mm or N/mm written as SI, and what nobody can mean; no toothed-belt axis comes near them.
def _known(meaning: str, **bounds: Any) -> Any:
    return field(default=None, metadata={"entry": AxisEntry(meaning, **bounds)})


@dataclass(frozen=True)
class Motor:
    """The motor; all at its shaft."""

    name: str = ""
    inertia_kg_m2: float | None = _known("inertia of the rotor, with encoder and brake", above=0.0, at_least=1e-9, at_most=1.0)
    torque_constant_nm_a: float | None = _known("torque per ampere (rms)", above=0.0, at_least=1e-4, at_most=100.0)
    rated_torque_nm: float | None = _known("continuous rating (S1): torque it holds all the time", above=0.0, at_least=1e-3, at_most=1e4)
    peak_torque_nm: float | None = _known("largest torque of the motor", above=0.0, at_least=1e-3, at_most=1e5)
    encoder_counts_per_rev: int | None = _known("encoder counts per motor revolution", above=0.0, at_most=2.0**32, whole=True)
    brake_torque_nm: float | None = _known(
        "torque of the holding brake that the drive opens and closes; none without", above=0.0, at_least=1e-3, at_most=1e4
    )
    brake_time_s: float | None = _known("time in which the holding brake opens or closes", at_least=0.0, at_most=1.0)
    max_speed_rad_s: float | None = _known("largest speed of the motor", above=0.0, at_least=0.1, at_most=1e4)
    overload_time_s: float | None = _known(
        "time for which the motor bears its peak torque from cold (I²t)", above=0.0, at_least=1e-3, at_most=60.0
    )


@dataclass(frozen=True)
class Gearbox:
    """The gearbox: ratio i_g = motor speed over pulley speed (2.6); its inertia at the output, as Θ_g in (2.8)."""

    ratio: float = field(
        default=1.0, metadata={"entry": AxisEntry("motor speed over pulley speed i_g", above=0.0, at_least=1e-2, at_most=1e3)}
    )
    inertia_kg_m2: float = field(
        default=0.0, metadata={"entry": AxisEntry("inertia of the gearbox at its output shaft", at_least=0.0, at_most=1.0)}
    )


@dataclass(frozen=True)
class Coupling:
    """The coupling on the motor shaft; without a stiffness it is rigid."""

    inertia_kg_m2: float = field(default=0.0, metadata={"entry": AxisEntry("inertia of the coupling", at_least=0.0, at_most=1.0)})
    stiffness_nm_rad: float | None = _known("torsional stiffness of the coupling", above=0.0, at_least=1e-2, at_most=1e8)


@dataclass(frozen=True)
class Pulley:
    """The driving pulley (and, of the same make, the end pulley)."""

    effective_radius_m: float | None = _known(
        "effective radius r: belt travel per radian of the pulley", above=0.0, at_least=1e-3, at_most=1.0
    )
    inertia_kg_m2: float | None = _known("inertia of one pulley", at_least=0.0, at_most=1.0)
    teeth: int | None = _known("teeth of the pulley", above=0.0, at_most=1e3, whole=True)


@dataclass(frozen=True)
class Belt:
    """The toothed belt."""

    specific_stiffness_n: float | None = _known("specific stiffness EA: force per unit strain", above=0.0, at_least=1e2, at_most=1e9)
    pitch_m: float | None = _known("distance of the belt's teeth", above=0.0, at_least=1e-4, at_most=0.1)
    pulley_distance_m: float | None = _known("distance of the pulleys' centres l3", above=0.0, at_least=1e-2, at_most=200.0)
    preload_n: float | None = _known("pretension of the belt", at_least=0.0, at_most=1e6)


@dataclass(frozen=True)
class Travel:
    """Travel of the carriage; its zero is the axis zero."""

    min_m: float | None = _known("lowest position of the carriage", at_least=-100.0, at_most=100.0)
    max_m: float | None = _known("highest position of the carriage", at_least=-100.0, at_most=100.0)
    driven_side_offset_m: float = field(
        default=0.0,
        metadata={"entry": AxisEntry("belt length l1 from driving pulley to carriage at position 0", at_least=0.0, at_most=100.0)},
    )

    @property
    def ends_m(self) -> tuple[float, float]:
        """Lowest and highest position of the carriage, m; 0 for what is not stated."""
        return float(self.min_m or 0.0), float(self.max_m or 0.0)

    @property
    def middle_m(self) -> float:
        """Position between the ends, m."""
        low, high = self.ends_m
        return 0.5 * (low + high)

    @property
    def length_m(self) -> float:
        """Distance between the ends, m."""
        low, high = self.ends_m
        return high - low


@dataclass(frozen=True)
class AxisLimits:
    """Limits of the mechanics, at the carriage and the pulley; the motor's own stand under motor."""

    speed_m_s: float | None = _known("largest speed of the carriage", above=0.0, at_least=1e-3, at_most=100.0)
    acceleration_m_s2: float | None = _known("largest acceleration of the carriage", above=0.0, at_least=1e-3, at_most=1e4)
    feed_force_n: float | None = _known("largest force the belt may carry", above=0.0, at_least=0.1, at_most=1e6)
    pulley_torque_nm: float | None = _known("largest torque at the driving pulley", above=0.0, at_least=1e-3, at_most=1e5)


@dataclass(frozen=True)
class TrajectoryLimits:
    """Limits of a reference motion, at the carriage (table A.8)."""

    jerk_m_s3: float = field(metadata={"entry": AxisEntry("largest jerk", above=0.0, at_least=1e-3, at_most=1e7)})
    acceleration_m_s2: float = field(metadata={"entry": AxisEntry("largest acceleration", above=0.0, at_least=1e-3, at_most=1e4)})
    speed_m_s: float = field(metadata={"entry": AxisEntry("largest speed", above=0.0, at_least=1e-4, at_most=100.0)})

    def slower(self, share: float) -> TrajectoryLimits:
        """Limits of the same path with its time stretched by 1/share: speed, acceleration and jerk fall with its powers.

        Parameters
        ----------
        share : float
            Of the speed.

        Returns
        -------
        TrajectoryLimits
        """
        return TrajectoryLimits(share**3 * self.jerk_m_s3, share**2 * self.acceleration_m_s2, share * self.speed_m_s)


@dataclass(frozen=True)
class Mounting:
    """Tilt of the axis: α of figure 2.5, positive when positive travel goes up."""

    tilt_deg: float = field(default=0.0, metadata={"entry": AxisEntry("tilt against the horizontal", at_least=-90.0, at_most=90.0)})

    @property
    def tilted(self) -> bool:
        """True if gravity must be held: it is steeper than friction can be hoped to hold."""
        return abs(self.tilt_deg) > LEVEL_DEG


@dataclass(frozen=True)
class Payload:
    """Load on the carriage."""

    mass_kg: float | None = _known("mass on the carriage, when known", at_least=0.0, at_most=1e5)


@dataclass(frozen=True)
class AxisTargets:
    """Demands of the user on the axis: errors of a move, where they count, and the move.  None is not stated: a default holds.

    Attributes
    ----------
    at : str
        "motor", "carriage" or "both"; what nothing measures is judged as predicted.
    move : str
        Limits under ``trajectories``.
    """

    following_error_m: float | None = _known("largest following error while it moves", above=0.0, at_least=1e-7, at_most=1.0)
    settled_error_m: float | None = _known("largest position error once settled", above=0.0, at_least=1e-7, at_most=0.1)
    settled_after_s: float | None = _known("time after the move until it counts as settled", at_least=0.0, at_most=1.0)
    at: str = ""
    move: str = ""
    distance_m: float | None = _known("length of the move that is judged", above=0.0, at_least=1e-3, at_most=100.0)

    @property
    def following_m(self) -> float:
        """Largest following error, m."""
        return FOLLOWING_TARGET_M if self.following_error_m is None else self.following_error_m

    @property
    def settled_m(self) -> float:
        """Largest error once settled, m."""
        return SETTLED_TARGET_M if self.settled_error_m is None else self.settled_error_m

    @property
    def after_s(self) -> float:
        """From the end of the reference on, s."""
        return SETTLED_AFTER_S if self.settled_after_s is None else self.settled_after_s

    @property
    def places(self) -> tuple[str, ...]:
        """Bodies at which they count: motor, carriage."""
        return {"carriage": ("carriage",), "both": ("motor", "carriage")}.get(self.at, ("motor",))

    @property
    def limits(self) -> str:
        """Name of the limits of the move."""
        return self.move or TARGET_LIMITS

    @property
    def way_m(self) -> float:
        """Length of the move, m."""
        return TARGET_WAY_M if self.distance_m is None else self.distance_m

    @property
    def stated(self) -> bool:
        """True if a person stated an error; else both are defaults."""
        return self.following_error_m is not None or self.settled_error_m is not None


#: What is asked where nobody stated anything.
NO_TARGETS = AxisTargets()
#: Sections of ``axis.yaml`` in their order.
SECTIONS: Mapping[str, type[Any]] = {
    "motor": Motor,
    "gearbox": Gearbox,
    "coupling": Coupling,
    "pulley": Pulley,
    "belt": Belt,
    "travel": Travel,
    "limits": AxisLimits,
    "mounting": Mounting,
    "payload": Payload,
    "targets": AxisTargets,
}


#: What commissioning cannot do without, and what it is for: asked for by ``init``, required by ``commission``.
COMMISSION_NEEDS: Mapping[str, str] = {
    "motor.inertia_kg_m2": "start values and the plausibility of the model",
    "pulley.effective_radius_m": "travel per motor revolution",
    "belt.specific_stiffness_n": "the belt force before anything is measured",
    "belt.pulley_distance_m": "the belt force before anything is measured",
    "travel.min_m": "the travel window",
    "travel.max_m": "the travel window",
    "limits.speed_m_s": "the speed limit",
    "limits.feed_force_n": "the belt force limit",
}


def entries_of(section: type[Any]) -> dict[str, AxisEntry]:
    """The numbers of a section by name.

    Parameters
    ----------
    section : type of Any
        Dataclass of a section of axis.yaml.

    Returns
    -------
    dict of str to AxisEntry
        Fields without an entry are left out.
    """
    return {item.name: item.metadata["entry"] for item in fields(section) if "entry" in item.metadata}


def meaning_of(entry: str) -> str:
    """Meaning of a dotted entry such as ``pulley.teeth``; "" for an unknown one.

    Parameters
    ----------
    entry : str
        ``SECTION.NAME``.
    """
    section, _, key = entry.partition(".")
    known = entries_of(SECTIONS[section]) if section in SECTIONS else {}
    return known[key].meaning if key in known else ""
