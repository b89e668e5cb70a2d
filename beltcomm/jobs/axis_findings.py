"""Statements of a drive beside those of axis.yaml: encoder, gear, feed, ratings, place."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from beltcomm.axis import Axis
from beltcomm.drive.finding import Finding
from beltcomm.errors import BeltcommError
from beltcomm.experiments.referencing import suitable
from beltcomm.machine.ratings import counts_rating, limit_ratings

AREA: Final = "axis.yaml"
#: Ratings of drive and axis file may differ by this share: nameplates are rounded.
RATING_TOLERANCE: Final = 0.05
#: Feed constants are entered with four digits and more.
_FEED_TOLERANCE: Final = 5e-3
_REMEDY: Final = "correct the drive's data with the maker's tool, or axis.yaml: one of them belongs to another axis"


def compared(findings: Sequence[Finding], axis: Axis) -> list[Finding]:
    """One finding per entry that both know; entries that one of them lacks are left out.

    Parameters
    ----------
    findings : sequence of Finding
        With what was read from the drive.
    axis : Axis
        Data sheets.
    """
    said = {name: value for finding in findings for name, value in finding.values.items()}
    seen = {name: float(value) for name, value in said.items() if isinstance(value, (int, float))}
    if not seen:  # nothing was read
        return []
    gear = list(_gear(seen, axis))
    if any(finding.state == "wrong" for finding in gear):  # feed and position follow from it
        return [*_entries(axis), *_ratings(seen, axis), *_limits(seen, axis), *_encoder(seen, axis), *gear]
    rest = (*_encoder(seen, axis), *gear, *_feed(seen, axis), *_position(seen, axis))
    return [*_entries(axis), *_ratings(seen, axis), *_limits(seen, axis), *rest]


def _entries(axis: Axis) -> Iterator[Finding]:
    """Findings on entries that commissioning needs; silent where the file has them."""
    try:
        suitable(axis)
    except BeltcommError as error:
        text, remedy = error.fault_and_remedy
        yield Finding(AREA, "entries", "wrong", text, remedy)


def _ratings(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    motor = axis.motor
    constant = motor.torque_constant_nm_a
    pairs = [
        ("rated torque", "6076h", "rated_torque_nm", seen.get("rated_torque_nm"), motor.rated_torque_nm, "N m"),
        (
            "torque per current",
            "6076h / 6075h",
            "torque_constant_nm_a",
            _ratio(seen, "rated_torque_nm", "rated_current_a"),
            constant,
            "N m/A",
        ),
    ]
    for what, objects, entry, drive_value, file_value, unit in pairs:
        if not drive_value or not file_value:
            continue
        share = drive_value / file_value
        text = f"{what} {drive_value:.4g} {unit} ({objects}), axis.yaml says {file_value:.4g} {unit} (motor.{entry})"
        if abs(share - 1.0) <= RATING_TOLERANCE:
            yield Finding(AREA, what, "ok", text, "", {"share": share})
        else:
            words = f"{text}: every torque, mass and gain would be wrong by the factor {share:.2f}"
            yield Finding(AREA, what, "wrong", words, _REMEDY, {"share": share})


def _limits(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """Only a limit above what the motor bears is worth a line."""
    if {"peak_torque_nm", "max_speed_rad_s"} <= set(seen):
        for rating in limit_ratings(axis, seen["peak_torque_nm"], seen["max_speed_rad_s"]):
            if rating.wrong:
                text, _, remedy = rating.words().partition("; ")
                yield Finding(AREA, rating.what, "wrong", text, remedy)


def _ratio(seen: dict[str, float], over: str, under: str) -> float | None:
    return seen[over] / seen[under] if seen.get(over) and seen.get(under) else None


def _encoder(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    counts, expected = seen.get("counts_per_rev"), axis.motor.encoder_counts_per_rev
    if not counts or not expected:
        return
    text = f"the drive counts {counts:.10g} increments per motor revolution, axis.yaml says {expected:.10g} (motor.encoder_counts_per_rev)"
    rating = counts_rating(axis, counts)
    if counts == expected:
        yield Finding(AREA, "encoder", "ok", text)
    else:
        yield Finding(AREA, "encoder", "wrong" if rating.wrong else "warning", text, rating.remedy)


def _gear(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """6091h: 1 when the drive counts at the motor, else it must be the axis's gear."""
    gear, expected = seen.get("gear_ratio"), axis.gearbox.ratio
    if gear is None or (gear == 1.0 and expected == 1.0):
        return
    text = f"the drive's gear ratio is {gear:g} (6091h), axis.yaml says {expected:g} (gearbox.ratio)"
    if gear == 1.0:
        yield Finding(AREA, "gear", "ok", f"{text}; the drive counts at the motor, beltcomm takes the gear into account")
    elif abs(gear / expected - 1.0) <= _FEED_TOLERANCE:
        yield Finding(AREA, "gear", "ok", text)
    else:
        yield Finding(AREA, "gear", "wrong", f"{text}: positions would be wrong by the factor {gear / expected:.3g}", _REMEDY)


def _feed(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """Position units of one motor revolution: encoder increments, degrees, or the feed in some decimal unit of length.

    Other numbers are no proof of a mistake: a drive may count as it likes.  What is told is what to compare.
    """
    units, counts = seen.get("units_per_rev"), seen.get("counts_per_rev")
    if not units or not counts or axis.get("pulley.effective_radius_m") is None:
        return
    units = abs(units)
    feed_m = 2.0 * math.pi * axis.transmission_m_rad
    if abs(units / counts - 1.0) <= _FEED_TOLERANCE:
        yield Finding(
            AREA, "feed", "ok", f"one motor revolution is {units:g} position units, the encoder's increments, and {1e3 * feed_m:.2f} mm"
        )
    elif _decimal_of(units, feed_m):
        yield Finding(AREA, "feed", "ok", f"one motor revolution is {units:g} position units, the {1e3 * feed_m:.2f} mm of axis.yaml")
    elif _decimal_of(units, 360.0) or _decimal_of(units, 1.0):
        yield Finding(
            AREA, "feed", "ok", f"one motor revolution is {units:g} position units, a decimal part of a turn, and {1e3 * feed_m:.2f} mm"
        )
    else:
        yield Finding(
            AREA, "feed", "warning",
            f"one motor revolution is {units:g} position units: neither the encoder's {counts:g} increments ({units / counts:.4g} times) "
            f"nor the {1e3 * feed_m:.2f} mm of axis.yaml in any decimal unit",
            "with the power off, push the carriage 100 mm by hand between two runs of doctor: the position below must change by 100 mm; "
            "else correct 6092h, 6091h or 6093h with the maker's tool",
            {"factor": units / counts},
        )  # fmt: skip


def _decimal_of(value: float, base: float) -> bool:
    """True if ``value`` is ``base`` times a power of ten."""
    exponent = math.log10(value / base)
    return math.isclose(10.0 ** (exponent - round(exponent)), 1.0, rel_tol=_FEED_TOLERANCE)


def _position(seen: dict[str, float], axis: Axis) -> Iterator[Finding]:
    """Position of the carriage when the drive knows its zero; else counted from the drive's own."""
    angle, low, high = seen.get("position_rad"), axis.travel.min_m, axis.travel.max_m
    if angle is None or axis.get("pulley.effective_radius_m") is None:
        return
    position_m = angle * axis.transmission_m_rad
    if not seen.get("referenced"):
        text = f"by the drive's counter the carriage is at {1e3 * position_m:.1f} mm, but its zero is not known"
        yield Finding(AREA, "position", "unknown", text, "", {"position_m": position_m})
        return
    if low is None or high is None:
        return
    text = f"the carriage stands at {1e3 * position_m:.1f} mm, the travel is {1e3 * low:g} to {1e3 * high:g} mm"
    if low <= position_m <= high:
        yield Finding(AREA, "position", "ok", text, "", {"position_m": position_m})
    else:
        remedy = "push the carriage inside by hand, with the power off; if it is inside, home the drive anew or correct travel in axis.yaml"
        yield Finding(AREA, "position", "wrong", f"{text}: outside", remedy, {"position_m": position_m})
