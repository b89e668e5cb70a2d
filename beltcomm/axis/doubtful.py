"""Entries of an axis that are possible each and do not go together: what physics forbids is refused when an axis is made, this is told.

A motor may be too weak for its belt and too slow for its guide; a person who types that in often has mistaken a unit, a gear or a line.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from beltcomm.axis import Axis
from beltcomm.axis.impossible import passing_the_pulley
from beltcomm.quantities import mm, three_digits

#: m/s².
_GRAVITY_M_S2 = 9.81
#: Share by which two limits may differ and still count as one; by more than ``_APART`` one of them is hardly meant.
_SAME, _APART = 1.02, 2.0
#: Peak over rated torque: servo motors bear two to six times.
_MOST_OVERLOAD = 10.0


def doubts(axis: Axis) -> list[str]:
    """Sentences on entries that contradict each other and yet can be, each with both values and what follows.

    Parameters
    ----------
    axis : Axis
        Of any kind; the sentences are in the words of a belt axis.
    """
    return [*_of_motor(axis), *_of_motor_and_load(axis), *_of_limits(axis), *_of_travel(axis), *_of_targets(axis)]


def _of_motor(axis: Axis) -> Iterator[str]:
    rated, peak = axis.motor.rated_torque_nm, axis.motor.peak_torque_nm
    if rated is not None and peak is not None and peak > _MOST_OVERLOAD * rated:
        yield (
            f"motor.peak_torque_nm, {three_digits(peak)} N m, is {peak / rated:.3g} times motor.rated_torque_nm, {three_digits(rated)} N m"
            "; motors bear 2 to 6 times: look at both"
        )


def _of_motor_and_load(axis: Axis) -> Iterator[str]:
    ratio, speed, force = axis.known_transmission_m_rad, axis.limits.speed_m_s, axis.limits.feed_force_n
    if ratio is None or not axis.has_transmission:
        return
    fastest, peak = axis.motor.max_speed_rad_s, axis.motor.peak_torque_nm
    if fastest is not None and speed is not None and speed > _SAME * fastest * ratio:
        yield (
            f"limits.speed_m_s is {three_digits(speed)} m/s; the motor drives the carriage with no more than "
            f"{three_digits(fastest * ratio)} m/s by motor.max_speed_rad_s and the transmission: look at these, or leave it so"
        )
    if peak is not None and force is not None and force > _SAME * peak / ratio:
        yield (
            f"limits.feed_force_n is {three_digits(force)} N; the motor pulls with no more than {three_digits(peak / ratio)} N by "
            "motor.peak_torque_nm and the transmission: look at these, or leave it so"
        )
    mass, held = axis.payload.mass_kg, abs(math.sin(math.radians(axis.mounting.tilt_deg)))
    if mass is None or not axis.mounting.tilted:
        return
    weight_nm = mass * _GRAVITY_M_S2 * held * ratio
    for torque, entry, what in (
        (axis.motor.rated_torque_nm, "motor.rated_torque_nm", "the motor cannot hold it all the time"),
        (axis.motor.brake_torque_nm, "motor.brake_torque_nm", "the brake lets it fall"),
    ):
        if torque is not None and torque < weight_nm:
            yield (
                f"payload.mass_kg, {three_digits(mass)} kg at this tilt, needs {three_digits(weight_nm)} N m at the motor, {entry} is "
                f"{three_digits(torque)} N m: {what}"
            )


def _of_limits(axis: Axis) -> Iterator[str]:
    limits, radius = axis.limits, axis.get("pulley.effective_radius_m")
    force, torque = limits.feed_force_n, limits.pulley_torque_nm
    if force is not None and torque is not None and radius is not None:
        by_torque = torque / radius
        if max(force / by_torque, by_torque / force) > _APART:
            yield (
                f"limits.feed_force_n is {three_digits(force)} N, limits.pulley_torque_nm makes it {three_digits(by_torque)} N: "
                "the smaller one holds; look at both"
            )


def _of_travel(axis: Axis) -> Iterator[str]:
    low, offset = axis.travel.min_m, axis.travel.driven_side_offset_m
    if axis.has_transmission and axis.transmission is None and low is not None and (why := passing_the_pulley(low, offset)):
        yield why


def _of_targets(axis: Axis) -> Iterator[str]:
    following, settled = axis.targets.following_error_m, axis.targets.settled_error_m
    if following is not None and settled is not None and settled > following:
        yield f"targets.settled_error_m, {mm(settled)}, is more than targets.following_error_m, {mm(following)}: they may be exchanged"
