"""Entries of an axis that cannot be, together with others of it."""

from __future__ import annotations

import math
from collections.abc import Collection

from beltcomm.axis.entries import AT, AxisTargets, Belt, Motor, Pulley, Travel
from beltcomm.configfiles import did_you_mean
from beltcomm.errors import UsageError
from beltcomm.quantities import three_digits

#: rad/s²: rated torque over rotor inertia.  Servo motors have some 1e3 (large, with brake) to 1e5; ten times more room either way.
SLOWEST_ROTOR_RAD_S2, FASTEST_ROTOR_RAD_S2 = 1e2, 1e6
#: m, of a sum of rounded numbers.
_NOTHING_M = 1e-9


class ImpossibleEntry(UsageError):
    """An entry that cannot be; ``entry`` is its dotted name."""

    def __init__(self, message: str, entry: str) -> None:
        super().__init__(message)
        self.entry = entry


def passing_the_pulley(low_m: float, offset_m: float) -> str:
    """That the carriage would pass the driving pulley, as a sentence; "" where it does not.

    Parameters
    ----------
    low_m : float, m
        Lower end of the travel.
    offset_m : float, m
        Belt from the driving pulley to the carriage at position 0.
    """
    if offset_m + low_m >= -_NOTHING_M:
        return ""
    return (
        f"travel.min_m is {low_m:g} m and travel.driven_side_offset_m {offset_m:g} m: the carriage would pass the driving pulley by "
        f"{-low_m - offset_m:.4g} m; the belt from the driving pulley to the carriage at position 0 must be at least {-low_m:.4g} m, or "
        f"travel.min_m at least {0.0 - offset_m:.4g} m"
    )


def check_together(
    motor: Motor,
    pulley: Pulley | None,
    belt: Belt | None,
    travel: Travel,
    targets: AxisTargets,
    moves: Collection[str],
    *,
    driven_by_belt: bool,
    linear_m_rad: float | None,
) -> None:
    """Check entries that are possible each against each other.

    Parameters
    ----------
    motor, pulley, belt, travel, targets : sections of an axis
    moves : collection of str
        Names under ``trajectories``.
    driven_by_belt : bool
        True where a pulley stands at one end of the travel.
    linear_m_rad : float or None, m/rad
        Travel per radian that the drive counts, of a motor that does not turn.

    Raises
    ------
    ImpossibleEntry
        For two that contradict each other.
    """
    low, high = travel.min_m, travel.max_m
    if low is not None and high is not None and low >= high:
        raise ImpossibleEntry(f"travel.min_m is {low:g} m; it must be below travel.max_m, {high:g} m", "travel.min_m")
    rated, peak = motor.rated_torque_nm, motor.peak_torque_nm
    if rated is not None and peak is not None and rated > peak:
        text = f"motor.rated_torque_nm is {rated:g} N m; it must not exceed motor.peak_torque_nm, {peak:g} N m"
        raise ImpossibleEntry(text, "motor.rated_torque_nm")
    inertia = motor.inertia_kg_m2
    if rated is not None and inertia is not None and not SLOWEST_ROTOR_RAD_S2 <= rated / inertia <= FASTEST_ROTOR_RAD_S2:
        rate, slowest, fastest, unit = rated / inertia, SLOWEST_ROTOR_RAD_S2, FASTEST_ROTOR_RAD_S2, "rad/s²"
        hint = "its unit (1 kg cm² is 1e-4 kg m²)"
        if linear_m_rad is not None:
            rate, slowest, fastest, unit, hint = *(linear_m_rad * one for one in (rate, slowest, fastest)), "m/s²", "its unit"
        raise ImpossibleEntry(
            f"motor.inertia_kg_m2 is {inertia:g} kg m²: a motor of {rated:g} N m rated torque would accelerate itself with "
            f"{three_digits(rate)} {unit}, motors do so with {three_digits(slowest)} to {three_digits(fastest)}; look at {hint} and at "
            "motor.rated_torque_nm",
            "motor.inertia_kg_m2",
        )
    if targets.at and targets.at not in AT:
        raise ImpossibleEntry(f"targets.at is {targets.at!r}; choose {', '.join(AT)}", "targets.at")
    if targets.move and targets.move not in moves:
        known = ", ".join(moves) or "none"
        raise ImpossibleEntry(
            f"targets.move is {targets.move!r}{did_you_mean(targets.move, moves)}; under trajectories are {known}",
            "targets.move",
        )
    way = targets.distance_m
    if way is not None and low is not None and high is not None and way > high - low:
        raise ImpossibleEntry(f"targets.distance_m is {way:g} m; the travel is {high - low:g} m", "targets.distance_m")
    l3, offset = belt.pulley_distance_m if belt is not None else None, travel.driven_side_offset_m
    if driven_by_belt and low is not None and offset > 0.0 and (why := passing_the_pulley(low, offset)):  # 0 is what nobody stated
        raise ImpossibleEntry(why, "travel.driven_side_offset_m")
    if l3 is not None and high is not None and offset + high >= l3:
        raise ImpossibleEntry(
            f"belt.pulley_distance_m is {l3:g} m; it must exceed travel.driven_side_offset_m + travel.max_m, {offset + high:g} m",
            "belt.pulley_distance_m",
        )
    radius, teeth = (pulley.effective_radius_m, pulley.teeth) if pulley is not None else (None, None)
    pitch = belt.pitch_m if belt is not None else None
    if radius is not None and teeth is not None and pitch is not None:
        by_teeth = teeth * pitch / math.tau
        # The pitch line lies off the pulley by fractions of a tooth; 5 % tells that from a diameter given as radius.
        if abs(radius - by_teeth) > 0.05 * by_teeth:
            raise ImpossibleEntry(
                f"pulley.effective_radius_m is {radius:g} m, but {teeth:g} teeth of {pitch:g} m make a radius of {by_teeth:.5g} m; "
                "correct the one that is wrong",
                "pulley.effective_radius_m",
            )
